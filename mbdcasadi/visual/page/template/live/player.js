// --- a live mechanism: play, step, reset, sliders, and the pointer that pulls ----------------------------------------
const BUSY = 0.014;                                           // seconds of a frame for the solution
let slow = 0;

// Show the present state of the mechanism.
function showNow() {
  state.time = now.t[0];
  show();
  tellOuter();
}

function showValues() {
  for (const slider of LIVE.sliders) {
    const value = sliderValue(slider), [name, unit] = parted(slider.name), shown = unitFor(unit, Math.max(Math.abs(slider.low), Math.abs(slider.high)));
    slider.factor = shown.factor;
    slider.label.textContent = name + (shown.name ? ", " + shown.name : "");
    slider.field.min = slider.low * shown.factor; slider.field.max = slider.high * shown.factor;
    if (document.activeElement !== slider.field) slider.field.value = String(Number((value * shown.factor).toPrecision(6)));
    slider.range.value = String(value);
  }
}

function setPlaying(on) {
  showPlaying(on);
  hint = null;
  if (on) { tell(""); window.requestAnimationFrame(step); } else showNow();
}

// Integrate on; a linkage that stops is reported, and left in its pose.
function solveOn(seconds) {
  try {
    advance(now.t[0] + seconds);
    return true;
  } catch (error) {
    if (!(error instanceof Stopped)) throw error;
    setPlaying(false);
    tell(error.message);
    return false;
  }
}

function step(clock) {
  if (!state.playing) return;
  if (shownAt !== null) {
    // what takes longer than a frame is shown in slow motion
    const wanted = Math.min((clock - shownAt) / 1000, 0.05) * DATA.speed * state.factor, began = performance.now();
    let left = wanted;
    while (left > 0 && performance.now() - began < 1000 * BUSY) {
      const piece = left > 0.025 ? 0.02 : left;
      if (!solveOn(piece)) break;
      left -= piece;
    }
    slow = left > 0 ? slow + 1 : Math.max(0, slow - 1);
    element("clock").classList.toggle("slow", slow >= 10);
    if (state.playing) tell(warnings().join(" "));
    showNow();
  }
  shownAt = clock;
  window.requestAnimationFrame(step);
}

// --- the slider of time: back and on over what was run ---
function timeSpanOfSlider() { return [past.samples[0].t, lastSample().t]; }
function shareOfSlider() { return past.samples.length < 2 ? 0 : past.at === null ? 1 : past.at / (past.samples.length - 1); }
function slideTo(share) { restore(Math.round(share * (past.samples.length - 1))); showNow(); }
function seek(time) { restore(nearestSample(time)); showNow(); }
function stepBy(count) {
  setPlaying(false);
  const at = past.at === null ? past.samples.length - 1 : past.at;
  if (count > 0 && at === past.samples.length - 1) single(DATA.speed * state.factor / 30 * count);
  else { restore(at + count); showNow(); }
}

function change(slider, value) {
  const reached = setValue(slider.name, Math.min(Math.max(value, slider.low), slider.high));
  const missed = Math.abs(reached - value) > 1e-9 * (1 + Math.abs(value));
  tell(missed ? slider.name + " = " + written(value) + " cannot be reached on this branch of the linkage; it stays at " + written(reached) : "");
  showNow();
}

function reset() {
  const asked = Float64Array.from(now.p), reached = restart();
  tell(reached < 1 ? "with these values the start cannot be reached; they go as far as it can" : "");
  showNow();
  return reached === 1 || asked;
}

// --- sliders ---
for (const slider of LIVE.sliders) {
  const row = document.createElement("label");
  slider.label = document.createElement("span");
  slider.range = document.createElement("input");
  slider.field = document.createElement("input");
  Object.assign(slider.range, { type: "range", min: slider.low, max: slider.high, step: "any" });
  Object.assign(slider.field, { type: "number", step: "any" });
  slider.range.setAttribute("aria-label", slider.name);
  slider.field.setAttribute("aria-label", slider.name + ", as a number");
  slider.range.addEventListener("input", () => { change(slider, Number(slider.range.value)); });
  slider.range.addEventListener("dblclick", () => { change(slider, slider.value); });
  slider.field.addEventListener("change", () => { if (slider.field.value !== "") change(slider, Number(slider.field.value) / slider.factor); });
  row.append(slider.label, slider.range, slider.field);
  element("values").appendChild(row);
}

// --- pulling: kinematic while paused, by a spring while it runs; by the pointer, or by keys ---
let hint = null, byKey = null;                                // the body and the point to drag first; the item that keys pull at
// The place on a body, in its axes, that is seen at a point.
function placeOn(body, at) {
  const target = fromScreen(at), k = 3 * body, c = Math.cos(now.q[k + 2]), s = Math.sin(now.q[k + 2]);
  const dx = target[0] - now.q[k], dy = target[1] - now.q[k + 1];
  return [c * dx + s * dy, -s * dx + c * dy];
}
function grab(at, item) {
  const body = item === null ? null : LIVE.bodyOfItem[item];
  hint = byKey = null;
  if (body === null || body === undefined) { pull = null; return false; }
  pull = { body: body, place: placeOn(body, at), target: fromScreen(at), stiffness: LIVE.pull.stiffness, damping: LIVE.pull.damping };
  return true;
}
function drag(at) {
  if (!pull.dragged) { cutPast(true); remember(true); }      // a click alone changes nothing
  pull.dragged = true;
  pull.target = fromScreen(at);
  if (state.playing) return;
  const held = pull;
  pull = null;                                                // no spring acts in the pose that is found
  if (LIVE.holds && STATES) tell("the drivers hold every part; let it run, or change what they follow");
  else {
    pulledNow = true;
    followPointer(held.body, held.place, held.target);
    pulledNow = false;
    if (ranks.position === N && !LIVE.holds) tell("no part can be moved: the joints hold all of them" + (LIVE.sliders.some(one => !one.input) ? "; a slider changes them" : ""));
  }
  pull = held;
  showNow();
}
function release() {
  const dragged = pull.dragged;
  pull = null;
  accelerations(now);
  revised++;
  if (dragged) { cutPast(true); remember(true); }
  showNow();
}
function drawPull(theme) {
  if (!pull) return;
  const point = pointOf(pull.body, pull.place, now), from = toScreen(point.x, point.y), to = toScreen(pull.target[0], pull.target[1]);
  pen.strokeStyle = theme.motion;
  pen.lineWidth = 2;
  drawLine(from[0], from[1], to[0], to[1]);
  pen.beginPath(); pen.arc(to[0], to[1], 4, 0, 7); pen.stroke();
}
// The next body for the keys, and a move of what they pull at, in pixels.
function takeNext() {
  const items = DATA.items.flatMap((item, k) => item.kind === "body" && controls.place(item.name) ? [k] : []);
  if (!items.length) return;
  const next = items[(items.indexOf(byKey) + 1) % items.length];
  grab(controls.place(DATA.items[next].name), next);
  Object.assign(state, { item: next, kept: true });
  byKey = next;
  show();
}
function nudge(x, y, event) {
  const by = event.shiftKey ? 30 : 8, point = pointOf(pull.body, pull.place, now);
  const at = state.playing ? toScreen(...pull.target) : toScreen(point.x, point.y);
  drag([at[0] + by * x, at[1] + by * y]);
}
// What moves most easily is shown as the first thing to drag.
function findHint() {
  let most = 0;
  DATA.bodies.forEach((item, body) => {
    const at = controls.place(DATA.items[item].name);
    if (!at) return;
    const place = placeOn(body, at), { g, size } = responses(body, place);
    const free = LIVE.holds ? Math.hypot(pointOf(body, place, now).vx, pointOf(body, place, now).vy) : (dot(g[0], g[0]) + dot(g[1], g[1])) / size;
    if (free > most * 1.01 && free > 1e-6) { most = free; hint = { body: body, place: place }; }
  });
}
function drawHint() {
  if (!hint) return;
  const theme = state.dark ? DATA.dark : DATA.light, point = pointOf(hint.body, hint.place, now), [x, y] = toScreen(point.x, point.y);
  pen.setTransform(pixels.ratio, 0, 0, pixels.ratio, 0, 0);
  pen.strokeStyle = theme.motion;
  pen.lineWidth = 2;
  for (const radius of [9, 14]) { pen.beginPath(); pen.arc(x, y, radius, 0, 7); pen.stroke(); }
  pen.font = "600 13px system-ui, sans-serif";
  const beside = x > pixels.width - 90;                       // where there is room
  pen.textAlign = beside ? "right" : "left";
  drawText("drag me", x + (beside ? -20 : 20), y - 14, theme, theme.motion);
  pen.textAlign = "left";
}

function single(seconds) {
  setPlaying(false);
  tell("");
  if (solveOn(seconds)) tell(warnings().join(" "));
  showNow();
}
element("step").addEventListener("click", () => { single(DATA.speed * state.factor / 30); });
element("reset").addEventListener("click", reset);
Object.assign(KEYS, {
  r: reset, b: takeNext, Escape: () => { if (pull) release(); byKey = null; Object.assign(state, { item: null, kept: false }); show(); },
  Home: () => { slideTo(0); }, End: () => { slideTo(1); },
});
for (const [key, x, y] of [["ArrowLeft", -1, 0], ["ArrowRight", 1, 0], ["ArrowUp", 0, -1], ["ArrowDown", 0, 1]]) {
  const otherwise = KEYS[key];
  KEYS[key] = event => { if (byKey !== null && pull) nudge(x, y, event); else otherwise(event); };
}
element("precision").textContent = "The equations of motion are solved in this page, by an adaptive integrator that keeps to the constraints.";

// --- the address: values, and the state if it is not that of the start ---
function addressOfModel() {
  const set = LIVE.sliders.filter(slider => sliderValue(slider) !== slider.value).map(slider => ["value", slider.name + "~" + sliderValue(slider)]);
  if (now.t[0] === LIVE.t0 && !course.touched) return set;
  const numbers = Float64Array.from([...now.t, ...now.q, ...now.v, ...now.z]);
  return [...set, ["state", btoa(String.fromCharCode(...new Uint8Array(numbers.buffer)))]];
}
function takeAddressOfModel(asked) {
  for (const pair of asked.getAll("value")) {
    const cut = pair.lastIndexOf("~"), slider = LIVE.sliders.find(one => one.name === pair.slice(0, cut)), value = Number(pair.slice(cut + 1));
    if (slider && value >= slider.low && value <= slider.high) setValue(slider.name, value);
  }
  if (!asked.has("state")) return;
  const bytes = Uint8Array.from(atob(asked.get("state")), letter => letter.charCodeAt(0));
  if (bytes.length !== 8 * (1 + 2 * N + STATES)) return;       // of another mechanism
  const numbers = new Float64Array(bytes.buffer);
  now.t[0] = numbers[0];
  now.q.set(numbers.subarray(1, 1 + N)); now.v.set(numbers.subarray(1 + N, 1 + 2 * N)); now.z.set(numbers.subarray(1 + 2 * N));
  course.touched = true;
  if (!bring(now, projectionRoots)) { restart(); return; }
  accelerations(now);
  forget();
  state.time = now.t[0];
}

// --- a page around this one, which gives values and takes them ---
let outer = null;
function tellOuter() {
  if (outer) outer.postMessage({ mechanism: { time: now.t[0], playing: state.playing, values: controls.values(), q: Array.from(now.q), v: Array.from(now.v) } }, "*");
}
window.addEventListener("message", event => {
  if (event.source !== window.parent || !event.data || !event.data.mechanism) return;
  outer = window.parent;
  const { values, playing, reset: again } = event.data.mechanism;
  if (again) reset();
  for (const [name, value] of Object.entries(values || {})) if (controls.values()[name] !== value) change(sliderOf(name), value);
  if (playing !== undefined && playing !== state.playing) setPlaying(playing);
  tellOuter();
});

controls.values = () => Object.fromEntries(LIVE.sliders.map(one => [one.name, sliderValue(one)]));
restart();
begin();
if (now.t[0] === LIVE.t0 && !course.touched) findHint();
show();
window.mechanism = Object.defineProperties({
  live: true, seek: seek,
  // integrate on over some seconds, without drawing until the end
  run: seconds => {
    hint = null;
    try { advance(now.t[0] + seconds); } finally { showNow(); }
    return now.t[0];
  },
  reset: reset,
  set: (name, value) => { const reached = setValue(name, value); showNow(); return reached; },
  violation: () => violationOf(now),
  // for comparisons: the whole state, and what its solution took
  state: () => { return { t: now.t[0], q: Array.from(now.q), v: Array.from(now.v), z: Array.from(now.z), a: Array.from(now.a), lam: Array.from(now.lam) }; },
  get effort() { return { steps: course.steps, evaluations: evaluations, stiff: course.method === implicit }; },
}, Object.getOwnPropertyDescriptors(controls));
