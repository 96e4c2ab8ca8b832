// --- play, pause, keys, pointer ------------------------------------------------------------
const element = function (id) { return document.getElementById(id); };
const ICONS = { play: '<svg width="16" height="16" viewBox="0 0 16 16"><path d="M3 1l11 7-11 7z"/></svg>',
                pause: '<svg width="16" height="16" viewBox="0 0 16 16"><path d="M2 1h4v14H2zM10 1h4v14h-4z"/></svg>' };
const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4];
const state = { time: DATA.t0, playing: false, factor: 1, loop: true, forces: DATA.forces,
                dark: window.matchMedia && window.matchMedia("(prefers-color-scheme: dark)").matches, item: null, kept: false };
let shownAt = null;

function show() {
  drawStage(state.time, state);
  drawPlots(state.time, state.dark);
  element("clock").textContent = "t = " + state.time.toFixed(DATA.digits).replace("-", "\u2212") + " s";
  element("slider").value = (state.time - DATA.t0) / (DATA.t1 - DATA.t0);
  element("slider").setAttribute("aria-valuetext", element("clock").textContent);
  showReading();
}

function showReading() {
  const box = element("reading");
  box.hidden = state.item === null;
  if (box.hidden) return;
  const item = DATA.items[state.item];
  box.className = state.kept ? "kept" : "";
  box.replaceChildren();
  const name = document.createElement("b"), kind = document.createElement("small"), table = document.createElement("table");
  name.textContent = item.name;
  kind.textContent = item.kind;
  for (const reading of item.readings) {
    const row = table.insertRow(), comma = reading.label.lastIndexOf(", ");
    row.insertCell().textContent = reading.label.slice(0, comma);
    row.insertCell().textContent = written(valueAt(reading.column, state.time), reading.d) + " " + reading.label.slice(comma + 2);
  }
  box.append(name, kind, table);
}

function seek(time) {
  state.time = Math.min(Math.max(time, DATA.t0), DATA.t1);
  show();
}

function setPlaying(on) {
  if (on && state.time >= DATA.t1) state.time = DATA.t0;
  state.playing = on;
  shownAt = null;
  element("play").innerHTML = on ? ICONS.pause : ICONS.play;
  element("play").setAttribute("aria-label", on ? "pause" : "play");
  if (on) window.requestAnimationFrame(step);
}

function step(now) {
  if (!state.playing) return;
  if (shownAt !== null) {
    let time = state.time + (now - shownAt) / 1000 * DATA.speed * state.factor;
    if (time > DATA.t1) {
      if (state.loop) time = DATA.t0 + (time - DATA.t1) % (DATA.t1 - DATA.t0);
      else { seek(DATA.t1); setPlaying(false); return; }
    }
    seek(time);
  }
  shownAt = now;
  window.requestAnimationFrame(step);
}

function setSpeed(factor) {
  state.factor = factor;
  element("speed").value = String(factor);
}

function setSwitch(id, on) {
  state[id === "theme" ? "dark" : id] = on;
  element(id).setAttribute("aria-pressed", String(on));
  if (id === "theme") document.documentElement.dataset.theme = on ? "dark" : "light";
  if (id === "forces") element("scale").hidden = !on || !DATA.scale;
  show();
}

for (const factor of SPEEDS) {
  const option = document.createElement("option"), times = factor * DATA.speed;
  option.value = String(factor);
  option.textContent = written(times) + " ×";
  element("speed").appendChild(option);
}
element("scale").textContent = DATA.scale;
element("precision").textContent = "Numbers, curves and poses are those of the motion at any time; numbers to " + DATA.precision +
  " digits of the largest value of each.";
element("play").addEventListener("click", function () { setPlaying(!state.playing); });
element("slider").addEventListener("input", function () { seek(DATA.t0 + Number(element("slider").value) * (DATA.t1 - DATA.t0)); });
element("speed").addEventListener("change", function () { setSpeed(Number(element("speed").value)); });
for (const id of ["loop", "forces", "theme"]) {
  element(id).addEventListener("click", function () { setSwitch(id, element(id).getAttribute("aria-pressed") !== "true"); });
}

const KEYS = {
  " ": function () { setPlaying(!state.playing); },
  ArrowLeft: function (event) { setPlaying(false); seek(timeOf(Math.ceil(frameOf(state.time) - 1e-6) - (event.shiftKey ? 10 : 1))); },
  ArrowRight: function (event) { setPlaying(false); seek(timeOf(Math.floor(frameOf(state.time) + 1e-6) + (event.shiftKey ? 10 : 1))); },
  Home: function () { seek(DATA.t0); },
  End: function () { seek(DATA.t1); },
  ArrowUp: function () { setSpeed(SPEEDS[Math.min(SPEEDS.indexOf(state.factor) + 1, SPEEDS.length - 1)]); },
  ArrowDown: function () { setSpeed(SPEEDS[Math.max(SPEEDS.indexOf(state.factor) - 1, 0)]); },
  f: function () { element("forces").click(); },
  d: function () { element("theme").click(); },
  l: function () { element("loop").click(); },
  "0": function () { view.x = view.y = 0; view.zoom = 1; letScroll(); show(); },
};
document.addEventListener("keydown", function (event) {
  const own = event.target.tagName;                  // a select and a focused button keep their own keys
  const action = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
  if (own === "SELECT" || own === "SUMMARY" || (own === "BUTTON" && event.key === " ")) return;
  event.preventDefault();
  action(event);
});

// --- pointer: read, move, come nearer ---
const touching = new Map();
let moved = 0;
function place(event) {
  const corner = stage.getBoundingClientRect();
  return [event.clientX - corner.left, event.clientY - corner.top];
}
// a finger scrolls the page over the whole drawing, and moves an enlarged one
function letScroll() { stage.style.touchAction = view.zoom > 1 ? "none" : "pan-y"; }
function zoomAbout(at, factor) {
  const zoom = Math.min(Math.max(view.zoom * factor, 1), 60), by = zoom / view.zoom;
  view.x = at[0] - by * (at[0] - view.x);
  view.y = at[1] - by * (at[1] - view.y);
  view.zoom = zoom;
  if (zoom === 1) view.x = view.y = 0;
  letScroll();
  show();
}
stage.addEventListener("pointerdown", function (event) {
  touching.set(event.pointerId, place(event));
  moved = 0;
  stage.setPointerCapture(event.pointerId);
});
stage.addEventListener("pointermove", function (event) {
  const at = place(event), before = touching.get(event.pointerId);
  if (before && touching.size === 2) {
    const other = Array.from(touching.entries()).find(function (entry) { return entry[0] !== event.pointerId; })[1];
    const apart = function (p) { return Math.hypot(p[0] - other[0], p[1] - other[1]); };
    moved += 10;
    zoomAbout(other, apart(at) / Math.max(apart(before), 1));
  } else if (before) {
    moved += Math.hypot(at[0] - before[0], at[1] - before[1]);
    if (moved > 4 && view.zoom > 1) { view.x += at[0] - before[0]; view.y += at[1] - before[1]; show(); }
  } else if (!state.kept) {
    const item = itemAt(at[0], at[1], state.time, state.forces);
    stage.classList.toggle("over", item !== null);
    if (item !== state.item) { state.item = item; show(); }
  }
  if (before) touching.set(event.pointerId, at);
});
stage.addEventListener("pointerup", function (event) {
  touching.delete(event.pointerId);
  if (moved > 6) return;
  const at = place(event), item = itemAt(at[0], at[1], state.time, state.forces);
  state.kept = item !== null && !(state.kept && item === state.item);
  state.item = item;
  show();
});
stage.addEventListener("pointercancel", function (event) { touching.delete(event.pointerId); });
stage.addEventListener("pointerleave", function () {
  if (!state.kept && state.item !== null) { state.item = null; show(); }
});
// within a page of another (a notebook) the wheel moves that page on, unless the drawing was clicked
const framed = window.self !== window.top;
stage.addEventListener("wheel", function (event) {
  if (framed && !event.ctrlKey && document.activeElement !== stage) return;
  event.preventDefault();
  zoomAbout(place(event), Math.exp(-0.0015 * event.deltaY));
}, { passive: false });

for (const plot of plots) {
  const go = function (event) {
    const left = plot.canvas.getBoundingClientRect().left;
    const share = (event.clientX - left - MARGIN.left) / (plot.width - MARGIN.left - MARGIN.right);
    seek(DATA.t0 + share * (DATA.t1 - DATA.t0));
  };
  plot.canvas.addEventListener("pointerdown", function (event) { setPlaying(false); go(event); });
  plot.canvas.addEventListener("pointermove", function (event) { if (event.buttons) go(event); });
}

function resize() { fit(); fitPlots(); show(); }
window.addEventListener("resize", resize);
setSpeed(1);
setPlaying(false);
letScroll();
fit(); fitPlots();
for (const id of ["loop", "forces", "theme"]) setSwitch(id, state[id === "theme" ? "dark" : id]);
element("forces").hidden = !DATA.scale;

// for tests, and for pages around this one
window.mechanism = {
  seek: seek, play: function () { setPlaying(true); }, pause: function () { setPlaying(false); },
  get time() { return state.time; }, get playing() { return state.playing; },
  names: DATA.items.map(function (item) { return item.name; }),
  reading: function (name) {
    const item = DATA.items.find(function (one) { return one.name === name; }), values = {};
    for (const reading of item.readings) values[reading.label] = valueAt(reading.column, state.time);
    return values;
  },
  // the same as it is shown
  shown: function (name) {
    const item = DATA.items.find(function (one) { return one.name === name; }), texts = {};
    for (const reading of item.readings) texts[reading.label] = written(valueAt(reading.column, state.time), reading.d);
    return texts;
  },
  // lines of a plot by name: the value at the time, and the points [t, value] that are drawn
  plot: function (label) {
    const plot = plots.find(function (one) { return one.label === label; }), lines = {};
    for (const line of plot.lines) lines[line.name] = { value: valueAt(line.column, state.time), points: line.points };
    return lines;
  },
  // where a mark of an item is drawn, in pixels of the drawing; null if it has none
  place: function (name) {
    const number = DATA.items.findIndex(function (one) { return one.name === name; });
    const mark = DATA.marks.filter(function (one) { return one.i === number && one.k === 2 && one.c; }).pop();
    if (!mark) return null;
    const pose = poseOf(mark.f, state.time), loop = DATA.shapes[mark.p][0], c = pose[2], s = pose[3];
    let x = 0, y = 0;
    for (let i = 0; i < loop.length; i += 2) { x += loop[i]; y += loop[i + 1]; }
    x /= loop.length / 2; y /= loop.length / 2;
    return toScreen(pose[0] + c * x - s * y, pose[1] + s * x + c * y);
  },
};
