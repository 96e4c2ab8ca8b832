// --- what a motion and a live mechanism have in common: switches, keys, readings, and the pointer ---------------------
const element = id => document.getElementById(id);
const ICONS = { play: '<svg width="16" height="16" viewBox="0 0 16 16"><path d="M3 1l11 7-11 7z"/></svg>',
                pause: '<svg width="16" height="16" viewBox="0 0 16 16"><path d="M2 1h4v14H2zM10 1h4v14h-4z"/></svg>' };
const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4];
const state = { time: DATA.t0, playing: false, factor: 1, loop: true, forces: DATA.forces, loads: DATA.forces, velocities: false, names: DATA.names,
                dark: window.matchMedia && window.matchMedia("(prefers-color-scheme: dark)").matches, degrees: false, millimetres: false, item: null, kept: false };
let shownAt = null, frames = 0;

function tell(text) {
  element("notice").textContent = text;
  element("notice").hidden = !text;
}

function show() {
  keepInView(false);
  drawStage(state.time, state);
  drawHint();
  // numbers and plots of a mechanism that runs follow at every third frame: they take as long as the drawing
  if (DATA.live && state.playing && ++frames % 3) return;
  drawPlots(state.time, state.dark);
  element("clock").textContent = "t = " + state.time.toFixed(DATA.digits).replace("-", "\u2212") + " s";
  element("slider").value = shareOfSlider();
  element("slider").setAttribute("aria-valuetext", element("clock").textContent);
  if (DATA.live) showValues();
  showReading();
  noteAddress();
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
    const row = table.insertRow(), [label, unit] = parted(reading.label);
    row.insertCell().textContent = label;
    row.insertCell().textContent = measured(shownValue(reading.column), unit, reading.d);
  }
  box.append(name, kind, table);
}

function showPlaying(on) {
  state.playing = on;
  shownAt = null;
  element("play").innerHTML = on ? ICONS.pause : ICONS.play;
  element("play").setAttribute("aria-label", on ? "pause" : "play");
}

function setSpeed(factor) {
  state.factor = factor;
  element("speed").value = String(factor);
}

function setSwitch(id, on) {
  state[id === "theme" ? "dark" : id] = on;
  element(id).setAttribute("aria-pressed", String(on));
  if (id === "theme") document.documentElement.dataset.theme = on ? "dark" : "light";
  if (id === "forces") state.loads = on;
  show();
}

for (const factor of SPEEDS) {
  const option = document.createElement("option"), times = factor * DATA.speed;
  option.value = String(factor);
  option.textContent = String(Number(times.toPrecision(3))) + " ×";
  element("speed").appendChild(option);
}
// A number that is kept is plotted, or no longer. The table is written anew while it is pointed at.
element("reading").addEventListener("pointerdown", event => {
  const row = event.target.closest("tr"), item = DATA.items[state.item];
  if (!row) return;
  const reading = item.readings[row.rowIndex], label = item.name + ": " + reading.label;
  if (!dropPlot(label)) addPlot({ label: label, lines: [{ name: "", column: reading.column, d: reading.d }] });
  resize();
});
element("play").addEventListener("click", () => { setPlaying(!state.playing); });
element("speed").addEventListener("change", () => { setSpeed(Number(element("speed").value)); });
element("fit").addEventListener("click", () => { showWhole(); letScroll(); show(); });
element("slider").addEventListener("input", () => {
  const share = Number(element("slider").value);              // what is shown on pausing sets it
  setPlaying(false);
  slideTo(share);
});
const SWITCHES = ["loop", "forces", "velocities", "names", "degrees", "millimetres", "theme"].filter(element);
for (const id of SWITCHES) {
  element(id).addEventListener("click", () => { setSwitch(id, element(id).getAttribute("aria-pressed") !== "true"); });
}

const KEYS = {
  " ": () => { setPlaying(!state.playing); },
  ArrowLeft: event => { stepBy(event.shiftKey ? -10 : -1); },
  ArrowRight: event => { stepBy(event.shiftKey ? 10 : 1); },
  ArrowUp: () => { setSpeed(SPEEDS[Math.min(SPEEDS.indexOf(state.factor) + 1, SPEEDS.length - 1)]); },
  ArrowDown: () => { setSpeed(SPEEDS[Math.max(SPEEDS.indexOf(state.factor) - 1, 0)]); },
  f: () => { element("forces").click(); },
  v: () => { element("velocities").click(); },
  n: () => { element("names").click(); },
  d: () => { element("theme").click(); },
  "0": () => { element("fit").click(); },
};
document.addEventListener("keydown", event => {
  const own = event.target.tagName;                  // a select, a slider and a focused button keep their own keys
  const action = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
  if (own === "SELECT" || own === "SUMMARY" || (own === "BUTTON" && event.key === " ")) return;
  if (own === "INPUT" && event.target.id !== "slider") return;
  event.preventDefault();
  action(event);
});

// --- pointer: read, move, come nearer; a page may take it to pull at what is under it (see `grab`) ---
const touching = new Map();
let moved = 0, pulling = false;
function place(event) {
  const corner = stage.getBoundingClientRect();
  return [event.clientX - corner.left, event.clientY - corner.top];
}
// a finger scrolls the page over the whole drawing, and moves an enlarged one
function letScroll() { stage.style.touchAction = view.zoom !== 1 || DATA.live ? "none" : "pan-y"; }
function zoomAbout(at, factor) {
  const zoom = Math.min(Math.max(view.zoom * factor, 0.2), 60), by = zoom / view.zoom;
  view.x = at[0] - by * (at[0] - view.x);
  view.y = at[1] - by * (at[1] - view.y);
  view.zoom = zoom;
  view.held = true;
  letScroll();
  show();
}
stage.addEventListener("pointerdown", event => {
  const at = place(event);
  touching.set(event.pointerId, at);
  moved = 0;
  stage.setPointerCapture(event.pointerId);
  if (touching.size > 1 && pulling) { release(); pulling = false; }
  else if (touching.size === 1) pulling = grab(at, itemAt(at[0], at[1], state.forces, null));
});
stage.addEventListener("pointermove", event => {
  const at = place(event), before = touching.get(event.pointerId);
  if (before && touching.size === 2) {
    const other = Array.from(touching.entries()).find(entry => entry[0] !== event.pointerId)[1];
    const apart = p => Math.hypot(p[0] - other[0], p[1] - other[1]);
    moved += 10;
    zoomAbout(other, apart(at) / Math.max(apart(before), 1));
  } else if (before) {
    moved += Math.hypot(at[0] - before[0], at[1] - before[1]);
    if (pulling) drag(at);
    else if (moved > 4 && (event.pointerType === "mouse" || stage.style.touchAction === "none")) {
      view.x += at[0] - before[0];
      view.y += at[1] - before[1];
      view.held = true;
      show();
    }
  } else if (!state.kept) {
    const item = itemAt(at[0], at[1], state.forces, null);
    stage.classList.toggle("over", item !== null);
    if (item !== state.item) { state.item = item; show(); }
  }
  if (before) touching.set(event.pointerId, at);
});
stage.addEventListener("pointerup", event => {
  touching.delete(event.pointerId);
  if (pulling) { release(); pulling = false; }
  if (moved > 6) return;
  // a further click takes what lies under it, and after all of it nothing
  const at = place(event), item = itemAt(at[0], at[1], state.forces, state.kept ? state.item : null);
  state.kept = item !== null && !(state.kept && item === state.item);
  state.item = item;
  show();
});
stage.addEventListener("pointercancel", event => {
  touching.delete(event.pointerId);
  if (pulling) { release(); pulling = false; }
});
stage.addEventListener("pointerleave", () => {
  if (!state.kept && !pulling && state.item !== null) { state.item = null; show(); }
});
// within a page of another (a notebook) the wheel moves that page on, unless the drawing was clicked
const framed = window.self !== window.top;
stage.addEventListener("wheel", event => {
  if (framed && !event.ctrlKey && document.activeElement !== stage) return;
  event.preventDefault();
  zoomAbout(place(event), Math.exp(-0.0015 * event.deltaY));
}, { passive: false });

// A page within one that has a theme of its own, as the documentation has, follows it.
function followTheme() {
  let outer = null;
  try { outer = framed ? window.parent.document.body : null; } catch (error) { return; }  // a frame that is shut off
  if (!outer || outer.dataset.theme === undefined) return;
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  const take = () => { setSwitch("theme", outer.dataset.theme === "dark" || (outer.dataset.theme === "auto" && system.matches)); };
  new MutationObserver(take).observe(outer, { attributes: true, attributeFilter: ["data-theme"] });
  take();
}

function resize() {
  document.querySelector("main").classList.toggle("alone", !plots.length);
  element("side").hidden = !plots.length && !element("values").childElementCount;
  fit(); fitPlots(); show();
}
window.addEventListener("resize", resize);

function begin() {
  setSpeed(1);
  showPlaying(false);
  letScroll();
  takeAddress();
  box = wholeBox();
  fit();
  lookAtWanted();
  resize();
  for (const id of SWITCHES) setSwitch(id, state[id === "theme" ? "dark" : id]);
  element("forces").hidden = !DATA.scale.N && !DATA.scale["N m"];
  followTheme();
}

// What tests, and pages around this one, may use.
const itemOf = name => { return DATA.items.find(one => one.name === name); };
const controls = {
  svg: drawnAsSvg, csv: commaSeparated,
  play: () => { setPlaying(true); }, pause: () => { setPlaying(false); },
  get time() { return state.time; }, get playing() { return state.playing; },
  names: DATA.items.map(item => item.name),
  reading: name => {
    const values = {};
    for (const reading of itemOf(name).readings) values[reading.label] = shownValue(reading.column);
    return values;
  },
  // the same as it is shown
  shown: name => {
    const texts = {};
    for (const reading of itemOf(name).readings) texts[reading.label] = measured(shownValue(reading.column), parted(reading.label)[1], reading.d);
    return texts;
  },
  // lines of a plot by name: the value at the time, and the points [t, value] that are drawn
  plot: label => {
    const plot = plots.find(one => one.label === label), lines = {};
    for (const line of plot.lines) lines[line.name] = { value: shownValue(line.column), points: series(plot.x, line.column).points };
    return lines;
  },
  // the ends of the vertical axis of a plot; paths as they are drawn, m: what was followed, and the whole
  range: label => { const plot = plots.find(one => one.label === label); return [plot.low, plot.high]; },
  traced: () => paths().map(path => { return { points: path.points.map(point => point.slice(0, 2)), whole: path.whole.map(point => point.slice(0, 2)) }; }),
  // the arrow of a body's velocity as it is drawn, m
  arrow: name => {
    const number = DATA.items.findIndex(one => one.name === name);
    const pose = shownPose(DATA.marks.find(one => one.i === number && one.g === "velocities").f);
    return [pose[2] * pose[4], pose[3] * pose[4]];
  },
  // where a mark of an item is drawn, in pixels of the drawing; null if it has none
  place: name => {
    const number = DATA.items.findIndex(one => one.name === name);
    const marks = DATA.marks.filter(one => one.i === number && one.c && !one.g), shapes = DATA.marks.filter(one => one.c && !one.g && itemsOf(one).includes(number));
    const mark = marks.filter(one => one.k === 2).pop() || marks.pop() || shapes.pop();
    if (!mark) return null;
    let x = 0, y = 0, count = 0;
    for (const place of placesOn(SHAPES[mark.p][0], mark.k, shownPose(mark.f))) { x += place[0]; y += place[1]; count++; }
    return toScreen(x / count, y / count);
  },
};
