// --- the drawing -------------------------------------------------------------------------
const stage = document.getElementById("stage");
const canvasPen = stage.getContext("2d");
let pen = canvasPen;                                         // another one while the picture is written as SVG
const view = { x: 0, y: 0, zoom: 1 };                 // shift in pixels, and how much nearer than the whole
let pixels = { width: 0, height: 0, ratio: 1, scale: 1, left: 0, top: 0 };

function fit() {
  const box = DATA.box, wide = box[2] - box[0], high = box[3] - box[1];
  const width = stage.parentElement.clientWidth;
  const phone = window.innerWidth <= 760, room = Math.max(220, window.innerHeight * (phone ? 0.55 : 0.86) - (phone ? 0 : 120));
  const height = Math.round(Math.max(Math.min(width * high / wide, room), Math.min(220, width * 0.6)));
  const ratio = window.devicePixelRatio || 1;
  stage.style.height = height + "px";
  stage.width = Math.round(width * ratio);
  stage.height = Math.round(height * ratio);
  const scale = Math.min(width / wide, height / high);
  pixels = { width: width, height: height, ratio: ratio, scale: scale,
             left: (width - scale * wide) / 2, top: (height - scale * high) / 2 };
}

function toScreen(x, y) {
  const s = pixels.scale, u = pixels.left + s * (x - DATA.box[0]), w = pixels.top + s * (DATA.box[3] - y);
  return [view.x + view.zoom * u, view.y + view.zoom * w];
}

const SHAPES = DATA.shapes.map(([size, ...loops]) => loops.map(loop => loop.map(x => size * x)));
// Path of a mark in pixels, for the pose of its frame.
function trace(mark, pose) {
  const c = pose[2], s = pose[3], length = pose[4], k = mark.k;
  pen.beginPath();
  for (const loop of SHAPES[mark.p]) {
    for (let i = 0; i < loop.length; i += k) {
      const u = k === 4 ? loop[i] + loop[i + 1] * length : loop[i];
      const w = k === 4 ? loop[i + 2] + loop[i + 3] * Math.abs(length) : loop[i + 1];
      const at = toScreen(pose[0] + c * u - s * w, pose[1] + s * u + c * w);
      if (i === 0) pen.moveTo(at[0], at[1]); else pen.lineTo(at[0], at[1]);
    }
    if (mark.c) pen.closePath();
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
  const poses = DATA.frames.map((_, k) => poseOf(k, time));
  let traced = false;
  for (const mark of DATA.marks) {
    if (mark.g && !options[mark.g]) continue;
    if (!traced && mark.l >= DATA.traceLayer) { drawTraces(time, theme); traced = true; }
    pen.globalAlpha = mark.i === null ? 1 : strengthOf(DATA.items[mark.i].w, time);
    const style = DATA.styles[mark.s], pair = colours(mark, options.dark);
    trace(mark, poses[mark.f]);
    if (mark.c && pair[0]) { pen.fillStyle = pair[0]; pen.fill(); }
    if (pair[1] && style.width) {
      pen.strokeStyle = pair[1];
      pen.lineWidth = style.width * 1.2 * (mark.i !== null && mark.i === options.item ? 1.9 : 1);
      pen.setLineDash(style.dash);
      pen.stroke();
      pen.setLineDash([]);
    }
  }
  pen.globalAlpha = 1;
  drawScale(options, theme);
  if (options.names) for (const label of DATA.labels) drawLabel(label, poses[label.f], theme);
  if (DATA.live) drawPull();
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
    drawText(written(value) + " " + unit + (couple ? " (radius)" : ""), left - 6, y + 4, theme, theme.ink);
    pen.strokeStyle = theme.ink;
    pen.lineWidth = 1.3;
    drawLine(left, y, right, y);
    for (const end of couple ? [left, right] : [right]) for (const side of [-4, 4]) drawLine(end, y, couple ? end : end - 7, y + side);
    y += 18;
  }
  pen.textAlign = "left";
}

function drawTraces(time, theme) {
  for (const path of paths()) {
    for (const past of [false, true]) {
      pen.beginPath();
      for (let k = 0; k < path.points.length; k++) {
        if (past && path.times[k] > time) break;
        const at = toScreen(...path.points[k]);
        if (k === 0) pen.moveTo(...at); else pen.lineTo(...at);
      }
      if (past) {
        const pose = poseOf(path.frame, time), at = toScreen(pose[0], pose[1]);
        pen.lineTo(at[0], at[1]);
      }
      pen.strokeStyle = theme.trace;
      pen.globalAlpha = past ? 1 : 0.25;
      pen.lineWidth = past ? 1.8 : 1.2;
      pen.stroke();
      pen.globalAlpha = 1;
    }
  }
}

// Round distances for ticks: 1, 2 or 5 times a power of ten.
function roundStep(least) {
  const power = Math.pow(10, Math.floor(Math.log10(least)));
  for (const factor of [1, 2, 5, 10]) if (factor * power >= least) return factor * power;
  return 10 * power;
}

function drawLine(x, y, u, w) { pen.beginPath(); pen.moveTo(x, y); pen.lineTo(u, w); pen.stroke(); }

function drawGrid(theme) {
  const scale = pixels.scale * view.zoom, step = roundStep(80 / scale), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const left = DATA.box[0] - view.x / scale - pixels.left / pixels.scale;
  const top = DATA.box[3] + view.y / scale + pixels.top / pixels.scale;
  const tick = x => (Math.abs(x) < 1e-9 * step ? 0 : x).toFixed(digits).replace("-", "\u2212");
  pen.font = "11px system-ui, sans-serif";
  pen.lineWidth = 1;
  pen.strokeStyle = theme.soil;
  pen.fillStyle = theme.muted;
  for (let x = Math.ceil(left / step) * step; toScreen(x, 0)[0] < pixels.width; x += step) {
    const at = toScreen(x, 0)[0];
    drawLine(at, 0, at, pixels.height);
    // the unit stands in the corner
    if (at < pixels.width - 48) pen.fillText(tick(x), at + 3, pixels.height - 4);
  }
  for (let y = Math.floor(top / step) * step; toScreen(0, y)[1] < pixels.height - 24; y -= step) {
    const at = toScreen(0, y)[1];
    drawLine(0, at, pixels.width, at);
    if (at > 14) pen.fillText(tick(y), 3, at - 3);
  }
  pen.fillText("m", pixels.width - 14, pixels.height - 4);
}

// Number of the item whose mark lies uppermost at a point, or null.
function itemAt(x, y, time, forces) {
  pen.setTransform(1, 0, 0, 1, 0, 0);
  for (let k = DATA.marks.length - 1; k >= 0; k--) {
    const mark = DATA.marks[k];
    if (mark.i === null || (mark.g && !(forces && mark.g === "loads"))) continue;
    trace(mark, poseOf(mark.f, time));
    pen.lineWidth = 10;
    if ((mark.c && pen.isPointInPath(x, y)) || pen.isPointInStroke(x, y)) return mark.i;
  }
  return null;
}
