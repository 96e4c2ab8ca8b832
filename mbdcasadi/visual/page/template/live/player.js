// --- a live mechanism: play, step, reset, sliders, and the pointer that pulls ----------------------------------------
const BUSY = 0.014;                                           // seconds of a frame for the solution
let slow = 0;

function tell(text) {
  element("notice").textContent = text;
  element("notice").hidden = !text;
}

// Show the present state of the mechanism.
function showNow() {
  state.time = now.t[0];
  show();
}

function showControls() {
  for (const slider of LIVE.sliders) {
    const value = sliderValue(slider);
    if (document.activeElement !== slider.field) slider.field.value = String(Number(value.toPrecision(6)));
    slider.range.value = String(value);
  }
}

function setPlaying(on) {
  showPlaying(on);
  if (on) { tell(""); window.requestAnimationFrame(step); } else show();
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
    element("slow").hidden = slow < 10;
    if (state.playing) tell(warnings().join(" "));
    showNow();
  }
  shownAt = clock;
  window.requestAnimationFrame(step);
}

function scrub() { }                                          // the past of a mechanism is not kept

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
  const row = document.createElement("label"), name = document.createElement("span");
  slider.range = document.createElement("input");
  slider.field = document.createElement("input");
  name.textContent = slider.name + (slider.unit ? ", " + slider.unit : "");
  Object.assign(slider.range, { type: "range", min: slider.low, max: slider.high, step: "any" });
  Object.assign(slider.field, { type: "number", min: slider.low, max: slider.high, step: "any" });
  slider.range.setAttribute("aria-label", slider.name);
  slider.field.setAttribute("aria-label", slider.name + ", as a number");
  slider.range.addEventListener("input", () => { change(slider, Number(slider.range.value)); });
  slider.range.addEventListener("dblclick", () => { change(slider, slider.value); });
  slider.field.addEventListener("change", () => { if (slider.field.value !== "") change(slider, Number(slider.field.value)); });
  row.append(name, slider.range, slider.field);
  element("values").appendChild(row);
}

// --- pulling: kinematic while paused, by a spring while it runs ---
function globalPlace(at) {
  const s = pixels.scale * view.zoom;
  return [DATA.box[0] + (at[0] - view.x) / s - pixels.left / pixels.scale, DATA.box[3] - (at[1] - view.y) / s + pixels.top / pixels.scale];
}
function grab(at, item) {
  const body = item === null ? null : LIVE.bodyOfItem[item];
  if (body === null || body === undefined) return false;
  const target = globalPlace(at), k = 3 * body, c = Math.cos(now.q[k + 2]), s = Math.sin(now.q[k + 2]);
  const dx = target[0] - now.q[k], dy = target[1] - now.q[k + 1];
  pull = { body: body, place: [c * dx + s * dy, -s * dx + c * dy], target: target, stiffness: LIVE.pull.stiffness, damping: LIVE.pull.damping };
  return true;
}
function drag(at) {
  pull.target = globalPlace(at);
  if (state.playing) return;
  const held = pull;
  pull = null;                                                // no spring acts in the pose that is found
  const free = followPointer(held.body, held.place, held.target);
  pull = held;
  if (!free && LIVE.driven) tell("the drivers hold every part; let it run, or change what they follow");
  showNow();
}
function release() { pull = null; accelerations(now); revised++; show(); }
function drawPull() {
  if (!pull) return;
  const point = pointOf(pull.body, pull.place, now), from = toScreen(point.x, point.y), to = toScreen(pull.target[0], pull.target[1]);
  pen.strokeStyle = (state.dark ? DATA.dark : DATA.light).motion;
  pen.lineWidth = 2;
  drawLine(from[0], from[1], to[0], to[1]);
  pen.beginPath(); pen.arc(to[0], to[1], 4, 0, 7); pen.stroke();
}

function single(seconds) {
  setPlaying(false);
  tell("");
  if (solveOn(seconds)) tell(warnings().join(" "));
  showNow();
}
element("step").addEventListener("click", () => { single(DATA.speed * state.factor / 30); });
element("reset").addEventListener("click", reset);
Object.assign(KEYS, { r: reset, ArrowRight: event => { single(DATA.speed * state.factor / 30 * (event.shiftKey ? 10 : 1)); } });
element("precision").textContent = "The equations of motion are solved in this page, by an adaptive integrator that keeps to the constraints.";

restart();
begin();
window.mechanism = Object.defineProperties({
  live: true,
  // integrate on over some seconds, without drawing until the end
  run: seconds => {
    try { advance(now.t[0] + seconds); } finally { showNow(); }
    return now.t[0];
  },
  reset: reset,
  set: (name, value) => { const reached = setValue(name, value); showNow(); return reached; },
  values: () => { return Object.fromEntries(LIVE.sliders.map(one => [one.name, sliderValue(one)])); },
  violation: () => violationOf(now),
  // for comparisons: the whole state, and what its solution took
  state: () => { return { t: now.t[0], q: Array.from(now.q), v: Array.from(now.v), z: Array.from(now.z), a: Array.from(now.a), lam: Array.from(now.lam) }; },
  get effort() { return { steps: course.steps, evaluations: evaluations, stiff: course.method === implicit }; },
}, Object.getOwnPropertyDescriptors(controls));
