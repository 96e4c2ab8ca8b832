// --- what was run: states and all that is read of them, for curves, paths, and the way back ---------------------------
const SHORTEST_WINDOW = 2, WINDOW = 10, MOST_SAMPLES = 6000;  // seconds of a plot, and samples that are kept
const PACE = 0.008, BEND = 0.08;                              // seconds and rad between samples
const FIELDS = ["t", "q", "v", "a", "z", "lam", "u", "p"];
const past = { samples: [], at: null, stroke: 0 };            // at: the sample that is shown, null if the state lies after all of them
let shownRevision = -1;
function valueAt(index) {
  if (shownRevision !== revised) { evaluated("outputs", now); shownRevision = revised; }
  return MODEL.outputs.values[index];
}
function lastSample() { return past.samples[past.samples.length - 1]; }

// Keep the present state, unless it is as good as the last one.
function remember(always) {
  const last = lastSample();
  if (last && last.stroke === past.stroke) {
    const apart = now.t[0] - last.t;
    let turn = 0, same = apart === 0;
    for (let i = 0; i < N; i++) {
      const change = Math.abs(now.q[i] - last.values.q[i]);
      if (LIVE.angles[i]) turn = Math.max(turn, change);
      same = same && change === 0;
    }
    if (same || (!always && apart < PACE && turn < BEND)) return;
  }
  if (!always) { now.lam.set(trial.lam); now.a.set(trial.a); accelerations(now); }
  revised++;
  valueAt(0);
  const outputs = Float64Array.from(MODEL.outputs.values), values = {};
  for (const name of FIELDS) values[name] = Float64Array.from(now[name]);
  const places = DATA.traces.map(frame => poseOf(frame, index => outputs[index]));
  past.samples.push({ t: now.t[0], stroke: past.stroke, pulled: pulledNow, touched: course.touched, values: values, outputs: outputs, places: places });
  if (past.samples.length > MOST_SAMPLES) past.samples.splice(0, MOST_SAMPLES / 2);
}
let pulledNow = false;                                        // the pointer moves it, and no time
// What lies after the sample that is shown is gone, if it goes on from there; `anew`: on a stroke of its own.
function cutPast(anew) {
  if (past.at !== null && past.at < past.samples.length - 1) { past.samples.length = past.at + 1; anew = true; }
  past.at = null;
  if (anew) past.stroke++;
}
function forget() {
  past.samples.length = 0;
  past.at = null;
  past.stroke++;
  revised++;
  remember(true);
}
// Go back or on to a sample.
function restore(number) {
  past.at = Math.min(Math.max(number, 0), past.samples.length - 1);
  const sample = past.samples[past.at];
  for (const name of FIELDS) now[name].set(sample.values[name]);
  Object.assign(course, { h: 1e-4, method: explicit, touched: sample.touched });
  explicit.stiff = 0;
  trial.lam.set(now.lam); trial.a.set(now.a);
  revised++;
}
function nearestSample(time) {
  let best = 0;
  past.samples.forEach((sample, k) => { if (Math.abs(sample.t - time) <= Math.abs(past.samples[best].t - time)) best = k; });
  return best;
}

// --- what the drawing and the plots read ---
function timeSpan() {
  let end = Math.max(now.t[0], LIVE.t0 + SHORTEST_WINDOW);
  for (const sample of past.samples) end = Math.max(end, sample.t);
  const start = Math.max(LIVE.t0, Math.min(end - WINDOW, now.t[0]));
  return [start, Math.min(end, start + WINDOW)];
}
function revision() { return revised + past.samples.length; }
// Points of a column over another one, or over time from a time on, with their strokes. Over time what was pulled has none.
function series(x, index, start = -Infinity) {
  const kept = past.samples.filter(sample => x !== null || (sample.t >= start && !(sample.pulled && !LIVE.holds)));
  return { points: kept.map(sample => [x === null ? sample.t : sample.outputs[x], sample.outputs[index]]),
           strokes: kept.map(sample => sample.stroke), times: kept.map(sample => sample.t) };
}
function paths() {
  if (!DATA.traces.length) return [];
  const strokes = past.samples.map(sample => sample.stroke), whole = sweep();
  return DATA.traces.map((frame, k) => {
    return { frame: frame, strokes: strokes, points: past.samples.map(sample => sample.places[k]), whole: whole ? whole.paths[k] : [],
             past: () => past.at === null ? past.samples.length : past.at + 1 };
  });
}
function wholeBox() { const whole = sweep(); return (whole ? whole.box : DATA.box).slice(); }
// Everything that is read or plotted, as a table over what was run.
function table() {
  const columns = quantities();
  return { names: columns.map(column => column[0]), rows: past.samples.map(sample => [sample.t, ...columns.map(column => sample.outputs[column[1]])]) };
}
