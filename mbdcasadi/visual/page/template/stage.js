// --- the drawing -------------------------------------------------------------------------
const stage = document.getElementById("stage");
const canvasPen = stage.getContext("2d");
let pen = canvasPen;                                         // another one while the picture is written as SVG
const view = { x: 0, y: 0, zoom: 1, held: false };    // shift in pixels, how much nearer than the whole; held by the reader
let pixels = { width: 0, height: 0, ratio: 1, scale: 1, left: 0, top: 0 };
const EDGE = 0.03;                                            // part of the picture about the mechanism
let box = DATA.box.slice();                                  // what is seen at the zoom 1, m

function fit() {
  const wide = box[2] - box[0], high = box[3] - box[1], ratio = window.devicePixelRatio || 1;
  const width = stage.clientWidth, height = stage.clientHeight, room = 1 - 2 * EDGE, scale = Math.min(room * width / wide, room * height / high);
  if (stage.width !== Math.round(width * ratio)) stage.width = Math.round(width * ratio);
  if (stage.height !== Math.round(height * ratio)) stage.height = Math.round(height * ratio);
  pixels = { width: width, height: height, ratio: ratio, scale: scale,
             left: (width - scale * wide) / 2, top: (height - scale * high) / 2 };
}

function toScreen(x, y) {
  const s = pixels.scale, u = pixels.left + s * (x - box[0]), w = pixels.top + s * (box[3] - y);
  return [view.x + view.zoom * u, view.y + view.zoom * w];
}
function fromScreen(at) {
  const s = pixels.scale * view.zoom;
  return [box[0] + (at[0] - view.x) / s - pixels.left / pixels.scale, box[3] - (at[1] - view.y) / s + pixels.top / pixels.scale];
}

// The smallest box about another one and points.
function around(corners, points) {
  for (const [x, y] of points) corners = [Math.min(corners[0], x), Math.min(corners[1], y), Math.max(corners[2], x), Math.max(corners[3], y)];
  return corners;
}
const NOTHING = [Infinity, Infinity, -Infinity, -Infinity];
// Boxes of the bodies of a moment, by item.
function bodyBoxes(valueOf) {
  const boxes = new Map();
  for (const mark of DATA.marks) {
    if (mark.b === null || mark.i === null || isArrow(mark)) continue;
    boxes.set(mark.i, around(boxes.get(mark.i) || NOTHING, placesOf(mark, poseOf(mark.f, valueOf))));
  }
  return boxes;
}
// The whole mechanism as it is seen: nearer and farther than before if parts of it would be outside.
function keepInView(always) {
  if ((view.held || pulling) && !always) return;
  const boxes = Array.from(bodyBoxes(shownValue).values());
  const outside = b => { const [x, y] = toScreen((b[0] + b[2]) / 2, (b[1] + b[3]) / 2); return !(x > 0 && y > 0 && x < pixels.width && y < pixels.height); };
  if (!boxes.some(outside) || !boxes.every(b => isFinite(b[0] + b[1] + b[2] + b[3]))) return;
  const parts = boxes.reduce((all, b) => around(all, [[b[0], b[1]], [b[2], b[3]]]), NOTHING);
  for (const k of [0, 1]) {                                   // what still has room is followed, what has not makes the picture larger
    const middle = (parts[k] + parts[k + 2]) / 2, half = Math.max(box[k + 2] - box[k], 1.15 * (parts[k + 2] - parts[k])) / 2;
    if (parts[k] >= box[k] && parts[k + 2] <= box[k + 2]) continue;
    box[k] = middle - half; box[k + 2] = middle + half;
  }
  fit();
}
function showWhole() {
  Object.assign(view, { x: 0, y: 0, zoom: 1, held: false });
  box = wholeBox();
  fit();
  keepInView(true);
}

const SHAPES = DATA.shapes.map(([size, ...loops]) => loops.map(loop => loop.map(x => size * x)));
// Points of a mark, m, loop after loop; and its path in pixels.
function* placesOf(mark, pose) { for (const loop of SHAPES[mark.p]) yield* placesOn(loop, mark.k, pose); }
function* placesOn(loop, k, pose) {
  const c = pose[2], s = pose[3], length = pose[4];
  for (let i = 0; i < loop.length; i += k) {
    const u = k === 4 ? loop[i] + loop[i + 1] * length : loop[i];
    const w = k === 4 ? loop[i + 2] + loop[i + 3] * Math.abs(length) : loop[i + 1];
    yield [pose[0] + c * u - s * w, pose[1] + s * u + c * w];
  }
}
// The poses of a mark: of a piece of a line without an end those that cover the picture.
function piecesOf(mark, pose) {
  if (!mark.e) return [pose];
  const x = pose[2] * mark.e[0] - pose[3] * mark.e[1], y = pose[3] * mark.e[0] + pose[2] * mark.e[1], start = SHAPES[mark.p][0];
  const [beginX, beginY] = placesOn(start, mark.k, pose).next().value, pieces = [];
  const shares = [[0, 0], [pixels.width, 0], [0, pixels.height], [pixels.width, pixels.height]].map(fromScreen)
    .map(at => ((at[0] - beginX) * x + (at[1] - beginY) * y) / (x * x + y * y));
  for (let k = Math.floor(Math.min(...shares)); k <= Math.max(...shares); k++) pieces.push([pose[0] + k * x, pose[1] + k * y, ...pose.slice(2)]);
  return pieces;
}
function trace(mark, pose) {
  pen.beginPath();
  for (const piece of piecesOf(mark, pose)) for (const loop of SHAPES[mark.p]) {
    let first = true;
    for (const place of placesOn(loop, mark.k, piece)) {
      const at = toScreen(place[0], place[1]);
      if (first) pen.moveTo(at[0], at[1]); else pen.lineTo(at[0], at[1]);
      first = false;
    }
    if (mark.c) pen.closePath();
  }
}

// --- arrows: to scale, up to a part of the picture; longer ones are broken off and carry their number ---
const LONGEST = 0.3, LARGEST_RADIUS = 0.09, HEAD = 13;        // parts of the picture, and pixels
const REACH = window.matchMedia("(pointer: coarse)").matches ? 24 : 12;     // pixels about a line at which it is pointed at
const isArrow = mark => DATA.frames[mark.f].u !== undefined;
const isStraight = mark => DATA.frames[mark.f].v !== undefined;
// The pose of an arrow as it is drawn; the size that was left out, or 0.
function shortened(mark, pose) {
  const size = Math.abs(pose[4]), most = (isStraight(mark) ? LONGEST : LARGEST_RADIUS) * Math.min(pixels.width, pixels.height) / (pixels.scale * view.zoom);
  return size > most ? [[pose[0], pose[1], pose[2], pose[3], Math.sign(pose[4]) * most], size] : [pose, 0];
}
function drawArrow(mark, pose, theme, broken) {
  const unit = DATA.frames[mark.f].u, straight = isStraight(mark);
  const size = Math.abs(pose[4]) * pixels.scale * view.zoom, from = toScreen(pose[0], pose[1]), along = [pose[2], -pose[3]];
  const to = straight ? [from[0] + size * along[0], from[1] + size * along[1]] : [from[0], from[1] - size];
  if (size < 2) return;
  if (straight) {
    const head = Math.min(0.35 * size, HEAD), at = (share, side) => [from[0] + share * along[0] - side * along[1], from[1] + share * along[1] + side * along[0]];
    const pieces = broken ? [[0, 0.55 * size - 3], [0.55 * size + 3, size - 0.8 * head]] : [[0, size - 0.8 * head]];
    for (const [begin, end] of pieces) drawLine(...at(begin, 0), ...at(end, 0));
    if (broken) for (const place of [-3, 3]) drawLine(...at(0.55 * size + place - 2, -5), ...at(0.55 * size + place + 2, 5));
    pen.beginPath();
    pen.moveTo(...to); pen.lineTo(...at(size - head, 0.38 * head)); pen.lineTo(...at(size - head, -0.38 * head)); pen.closePath();
    pen.fillStyle = pen.strokeStyle;
    pen.fill();
  }
  if (broken) {
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = straight && along[0] < -0.3 ? "right" : straight && along[0] > 0.3 ? "left" : "center";
    drawText(measured(broken * DATA.scale[unit], unit), to[0] + (straight ? 6 * along[0] : 0), to[1] + (straight ? 4 + 10 * along[1] : -4), theme, pen.strokeStyle);
    pen.textAlign = "left";
  }
}

function colours(mark, dark) {
  const style = DATA.styles[mark.s], theme = dark ? DATA.dark : DATA.light, bodies = dark ? DATA.bodiesDark : DATA.bodiesLight;
  const pair = mark.b === null ? [theme.soil, theme.ground] : bodies[mark.b % bodies.length];
  return [style.fill === "body" ? pair[0] : theme[style.fill], style.stroke === "body" ? pair[1] : theme[style.stroke]];
}

function drawStage(time, options) {
  const theme = options.dark ? DATA.dark : DATA.light;
  pen.setTransform(pixels.ratio, 0, 0, pixels.ratio, 0, 0);
  pen.fillStyle = theme.paper;
  pen.fillRect(0, 0, pixels.width, pixels.height);
  drawGrid(theme);
  pen.lineCap = pen.lineJoin = "round";
  const poses = DATA.frames.map((_, k) => shownPose(k));
  let traced = false;
  for (const mark of DATA.marks) {
    if (mark.g && !options[mark.g]) continue;
    if (!traced && mark.l >= DATA.traceLayer) { drawTraces(time, theme); traced = true; }
    pen.globalAlpha = mark.i === null ? 1 : strengthOf(DATA.items[mark.i].w, time);
    const style = DATA.styles[mark.s], pair = colours(mark, options.dark), arrow = isArrow(mark);
    const [pose, broken] = arrow ? shortened(mark, poses[mark.f]) : [poses[mark.f], 0];
    const width = style.width * 1.2 * (mark.i !== null && mark.i === options.item ? 1.9 : 1);
    pen.lineWidth = width;
    pen.strokeStyle = pair[1] || theme.ink;
    if (arrow && !mark.c) drawArrow(mark, pose, theme, broken);  // a straight one with its head
    pen.lineWidth = width;
    if (arrow && isStraight(mark)) continue;
    trace(mark, pose);
    if (mark.c && pair[0]) { pen.fillStyle = pair[0]; pen.fill(); }
    if (pair[1] && style.width) {
      pen.setLineDash(style.dash);
      pen.stroke();
      pen.setLineDash([]);
    }
  }
  if (!traced) drawTraces(time, theme);
  pen.globalAlpha = 1;
  drawScale(options, theme);
  if (options.names) for (const label of DATA.labels) drawLabel(label, poses[label.f], theme);
  if (DATA.live && pen === canvasPen) drawPull(theme);
}

// Opacity of an item that appears and disappears in turn at some times, or of one that stays.
function strengthOf(times, time) { return !times || times.filter(t => t <= time).length % 2 ? 1 : 0.2; }

function drawLabel(label, pose, theme) {
  const c = pose[2], s = pose[3];
  const at = toScreen(pose[0] + c * label.x - s * label.y, pose[1] + s * label.x + c * label.y);
  pen.font = (label.b ? "italic " : "") + "12px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  if (label.e) {
    pen.lineWidth = 1;
    pen.strokeStyle = theme.muted;
    drawLine(at[0], at[1], at[0] + label.e[0], at[1] - label.e[1]);
  }
  // a name of a part in the picture stays in it
  canvasPen.font = pen.font;
  const half = 2 + Math.max(...label.t.map(line => canvasPen.measureText(line).width)) / 2, seen = at[0] > 0 && at[0] < pixels.width;
  const middle = at[0] + label.d[0], x = seen ? Math.max(half, Math.min(middle, pixels.width - half)) : middle;
  label.t.forEach((line, k) => {
    drawText(line, x, at[1] - label.d[1] + 14 * (k - (label.t.length - 1) / 2), theme, label.b ? theme.ink : theme.ground);
  });
  pen.textAlign = "left";
  pen.textBaseline = "alphabetic";
}

function drawText(text, x, y, theme, colour) {
  pen.lineWidth = 3;
  pen.strokeStyle = theme.paper;
  pen.fillStyle = colour;
  pen.strokeText(text, x, y);
  pen.fillText(text, x, y);
}

// Sizes of the arrows that are shown: round values, as long as they are drawn at this zoom.
function drawScale(options, theme) {
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "right";
  let y = 14;
  for (const unit of Object.keys(DATA.scale)) {
    if (!options[unit === "m/s" ? "velocities" : "loads"]) continue;
    const couple = unit === "N m", size = pixels.scale * view.zoom / DATA.scale[unit], value = roundStep((couple ? 18 : 40) / size);
    const right = pixels.width - 12, left = right - value * size;
    const shown = unitFor(unit, value);
    drawText(tick(value * shown.factor, value * shown.factor) + " " + shown.name + (couple ? " (radius)" : ""), left - 6, y + 4, theme, theme.ink);
    pen.strokeStyle = theme.ink;
    pen.lineWidth = 1.3;
    drawLine(left, y, right, y);
    for (const end of couple ? [left, right] : [right]) for (const side of [-4, 4]) drawLine(end, y, couple ? end : end - 7, y + side);
    y += 18;
  }
  pen.textAlign = "left";
}

// A line through points; it begins anew with each stroke.
function drawThrough(points, strokes, count, place) {
  pen.beginPath();
  for (let k = 0; k < count; k++) {
    const at = place(points[k]);
    if (k === 0 || (strokes && strokes[k] !== strokes[k - 1])) pen.moveTo(at[0], at[1]); else pen.lineTo(at[0], at[1]);
  }
}
function drawTraces(time, theme) {
  const place = point => toScreen(point[0], point[1]);
  pen.strokeStyle = theme.trace;
  for (const path of paths()) {
    const past = path.past(time);
    pen.globalAlpha = 0.4;
    pen.lineWidth = 1.2;
    if (path.whole.length) { drawThrough(path.whole, null, path.whole.length, place); pen.stroke(); }
    drawThrough(path.points, path.strokes, path.points.length, place);
    pen.stroke();
    pen.globalAlpha = 1;
    pen.lineWidth = 1.8;
    drawThrough(path.points, path.strokes, past, place);
    if (past) pen.lineTo(...place(shownPose(path.frame)));
    pen.stroke();
  }
}

function drawLine(x, y, u, w) { pen.beginPath(); pen.moveTo(x, y); pen.lineTo(u, w); pen.stroke(); }

function drawGrid(theme) {
  const scale = pixels.scale * view.zoom, unit = unitFor("m", 0), step = roundStep(80 / scale * unit.factor) / unit.factor;
  const [left, top] = fromScreen([0, 0]), text = x => tick(x * unit.factor, step * unit.factor);
  pen.font = "11px system-ui, sans-serif";
  pen.lineWidth = 1;
  pen.strokeStyle = theme.soil;
  pen.fillStyle = theme.muted;
  for (let x = Math.ceil(left / step) * step; toScreen(x, 0)[0] < pixels.width; x += step) {
    const at = toScreen(x, 0)[0];
    drawLine(at, 0, at, pixels.height);
    // the unit stands in the corner
    if (at < pixels.width - 60) pen.fillText(text(x), at + 3, pixels.height - 4);
  }
  for (let y = Math.floor(top / step) * step; toScreen(0, y)[1] < pixels.height - 24; y -= step) {
    const at = toScreen(0, y)[1];
    drawLine(0, at, pixels.width, at);
    if (at > 44) pen.fillText(text(y), 3, at - 3);
  }
  pen.fillText(unit.name, pixels.width - 24, pixels.height - 4);
}

// Items that a mark belongs to: what drew it, and the body whose shape it is.
function itemsOf(mark) {
  const body = mark.b === null || DATA.styles[mark.s].fill !== "body" ? null : DATA.bodies[mark.b];
  return [mark.i, body].filter((item, k, both) => item !== null && both.indexOf(item) === k);
}
// Number of the item at a point, or null: of several the smallest, which others cover, and of `after` the next larger one.
function itemAt(x, y, forces, after) {
  const found = new Map();
  pen.setTransform(1, 0, 0, 1, 0, 0);
  for (const mark of DATA.marks) {
    if (mark.i === null || (mark.g && !(forces && mark.g === "loads"))) continue;
    const pose = shownPose(mark.f);
    trace(mark, isArrow(mark) ? shortened(mark, pose)[0] : pose);
    pen.lineWidth = REACH;
    if ((mark.c && DATA.styles[mark.s].fill && pen.isPointInPath(x, y)) || pen.isPointInStroke(x, y)) for (const item of itemsOf(mark)) found.set(item, -1);
  }
  for (const mark of DATA.marks) {
    const items = mark.i === null || mark.g || isArrow(mark) ? [] : itemsOf(mark).filter(item => found.has(item));
    if (!items.length) continue;
    const b = around(NOTHING, placesOf(mark, shownPose(mark.f))), size = Math.hypot(b[2] - b[0], b[3] - b[1]);
    for (const item of items) found.set(item, Math.max(found.get(item), size));
  }
  const size = item => found.get(item) < 0 ? Infinity : found.get(item);   // arrows alone come last
  const order = Array.from(found.keys()).sort((a, b) => size(a) < size(b) ? -1 : size(a) > size(b) ? 1 : b - a);
  return order.length ? order[(order.indexOf(after) + 1) % order.length] : null;
}
