// --- the motion: start, steps with projection, values of sliders, and what is remembered for plots ------------------

class Stopped extends Error {}
const explicit = new Explicit(DIMENSION), implicit = new Implicit(DIMENSION);
const course = { y: new Float64Array(DIMENSION), rate: new Float64Array(DIMENSION), method: explicit, h: 1e-4, steps: 0, touched: false };
let revised = 0;                                             // counts changes of the state

function bring(x, roots) {
  if (!close(closure, x, roots, ranks.position)) return false;
  speeds(x, Float64Array.from(x.v), roots, false);
  return true;
}

// Integrate to a time; every step ends on the constraints.
function advance(end) {
  const y = course.y, rate = course.rate;
  let refused = 0;
  const load = () => {
    y.set(now.q); y.set(now.v, N); y.set(now.z, 2 * N);
    rateOf(now.t[0], y, rate);
  };
  load();
  while (now.t[0] < end) {
    const t = now.t[0], left = end - t, method = course.method;
    const wanted = Math.min(course.h, LIVE.maxStep), last = left <= wanted * 1.0001, h = last ? left : wanted;
    const error = method.attempt(t, y, rate, h);
    if (!(error <= 1)) {
      course.h = h * Math.min(0.9, error > 1 ? method.factorFor(error) : 0.2);
      if (course.h < SHORTEST_STEP * Math.max(1, Math.abs(t)) || ++refused > 200) { settle(); throw new Stopped(stopReason()); }
      continue;
    }
    const growth = refused ? Math.min(1, method.factorFor(error)) : method.factorFor(error);
    refused = 0;
    course.h = last ? Math.max(course.h, Math.min(h * growth, LIVE.maxStep)) : h * growth;
    method.accepted();
    for (let i = 0; i < N; i++) { now.q[i] = method.next[i]; now.v[i] = method.next[N + i]; }
    for (let i = 0; i < STATES; i++) now.z[i] = method.next[2 * N + i];
    now.t[0] = last ? end : t + h;
    course.steps++;
    if (!bring(now, projectionRoots)) { settle(); throw new Stopped(stopReason()); }
    if (method === explicit && explicit.stiff >= STIFF_STEPS) { course.method = implicit; implicit.fresh = false; implicit.iterations = 0; }
    remember(false);
    load();
  }
  settle();
}

function stopReason() {
  return "stopped at t = " + now.t[0].toPrecision(6) + " s: the linkage locks or passes a singular pose, or forces have no solution there";
}

// Accelerations, multipliers and with them all readings of the present state.
function settle() {
  now.lam.set(trial.lam);
  now.a.set(trial.a);
  accelerations(now);
  revised++;
}

// --- start ------------------------------------------------------------------------------------------------------------
const start = { q: Float64Array.from(LIVE.q0), v: Float64Array.from(LIVE.v0), p: Float64Array.from(LIVE.p0), rank: 0 };

// Pose and velocity of the start for values of the parameters; the share of the way that was reached.
function assembleStart(values) {
  const x = Object.assign({}, now, { t: Float64Array.of(LIVE.t0), q: Float64Array.from(start.q), v: new Float64Array(N), z: Float64Array.from(LIVE.z0), p: Float64Array.from(start.p) });
  const estimate = Float64Array.from(LIVE.estimate.q);
  const reached = follow(x, values, one => {
    const roots = inverseRoots(evaluated("weights", one));
    return close(startRows, one, roots, start.rank) && slide(startRows, one, estimate, roots, start.rank);
  });
  if (!startValues(x.p)) speeds(x, Float64Array.from(LIVE.estimate.v), inverseRoots(evaluated("weights", x)), true);
  else { x.q.set(LIVE.q0); x.v.set(LIVE.v0); }
  start.q.set(x.q); start.v.set(x.v); start.p.set(x.p);
  return reached;
}
function startValues(p) { return p.every((value, k) => value === LIVE.p0[k]); }

function restart() {
  const reached = start.p.every((value, k) => value === now.p[k]) ? 1 : assembleStart(Float64Array.from(now.p));
  now.t[0] = LIVE.t0;
  now.q.set(start.q); now.v.set(start.v); now.z.set(LIVE.z0); now.p.set(start.p);
  now.a.fill(0); now.lam.fill(0); trial.lam.fill(0); trial.a.fill(0);
  Object.assign(course, { method: explicit, h: 1e-4, touched: false });
  explicit.stiff = 0;
  accelerations(now);
  forget();
  return reached;
}

// --- values of inputs and parameters -------------------------------------------------------------------------------
function sliderOf(name) {
  const found = LIVE.sliders.find(one => one.name === name);
  if (!found) throw new RangeError("there is no slider '" + name + "'; there are " + LIVE.sliders.map(one => "'" + one.name + "'").join(", "));
  return found;
}
function sliderValue(slider) { return slider.input ? now.u[slider.index] : now.p[slider.index]; }

// Set a value, and put the linkage together anew on its branch. Returns the value that could be reached.
function setValue(name, value) {
  const slider = sliderOf(name);
  if (!(value >= slider.low && value <= slider.high)) throw new RangeError(name + " goes from " + slider.low + " to " + slider.high);
  if (slider.input) { now.u[slider.index] = value; accelerations(now); revised++; return value; }
  const values = Float64Array.from(now.p);
  values[slider.index] = value;
  const fresh = now.t[0] === LIVE.t0 && !course.touched;
  if (fresh) { now.p.set(values); restart(); }
  else {
    const aim = x => close(closure, x, projectionRoots, ranks.position);
    follow(now, values, aim);
    bring(now, projectionRoots);
    accelerations(now);
    revised++;
  }
  return now.p[slider.index];
}

// --- the pointer: along the freedom of the linkage ------------------------------------------------------------------
// Move a point of a body towards a place, by the least motion of all parts; false if nothing can move there.
function followPointer(body, place, target) {
  const kept = new Float64Array(N), step = [new Float64Array(N), new Float64Array(N)];
  let moved = false;
  for (let round = 0; round < 60; round++) {
    const point = pointOf(body, place, now), ex = target[0] - point.x, ey = target[1] - point.y, apart = Math.hypot(ex, ey);
    if (apart < 1e-6 * LIVE.size) break;
    closure.evaluate(now);
    closure.factor(projectionRoots, ranks.position);
    const k = 3 * body, g = step;
    g[0].fill(0); g[1].fill(0);
    g[0][k] = projectionRoots[k]; g[0][k + 2] = point.bx * projectionRoots[k + 2];
    g[1][k + 1] = projectionRoots[k + 1]; g[1][k + 2] = point.by * projectionRoots[k + 2];
    const zero = new Float64Array(closure.count);
    let size = 0;
    for (const part of g) { const free = part.reduce((s, x) => s + x * x, 0); closure.factors.nearest(part, zero); size = Math.max(size, free); }
    const dot = (a, b) => { let s = 0; for (let i = 0; i < N; i++) s += a[i] * b[i]; return s; };
    const a = dot(g[0], g[0]) + 1e-6 * size, b = dot(g[0], g[1]), d = dot(g[1], g[1]) + 1e-6 * size, det = a * d - b * b;
    const cx = (d * ex - b * ey) / det, cy = (a * ey - b * ex) / det;
    let turn = 0, shift = 0, share = 1, better = false;
    for (let i = 0; i < N; i++) {
      const by = Math.abs((cx * g[0][i] + cy * g[1][i]) * projectionRoots[i]);
      if (LIVE.angles[i]) turn = Math.max(turn, by); else shift = Math.max(shift, by);
    }
    share = Math.min(1, 0.15 / Math.max(turn, 1e-12), 0.15 * LIVE.size / Math.max(shift, 1e-12));
    kept.set(now.q);
    for (let half = 0; half < 8 && !better; half++, share /= 2) {
      for (let i = 0; i < N; i++) now.q[i] = kept[i] + share * (cx * g[0][i] + cy * g[1][i]) * projectionRoots[i];
      if (!close(closure, now, projectionRoots, ranks.position)) continue;
      let most = 0;
      for (let i = 0; i < N; i++) if (LIVE.angles[i]) most = Math.max(most, Math.abs(now.q[i] - kept[i]));
      const after = pointOf(body, place, now);
      better = most < LARGEST_TURN && Math.hypot(target[0] - after.x, target[1] - after.y) < apart * (1 - 1e-6);
    }
    if (!better) { now.q.set(kept); break; }
    moved = true;
  }
  if (moved) {
    now.v.fill(0);
    speeds(now, new Float64Array(N), projectionRoots, false);
    course.touched = true;
    course.h = 1e-4;
    accelerations(now);
    revised++;
  }
  return moved;
}

// --- what the drawing and the plots read ------------------------------------------------------------------------------
const SHORTEST_WINDOW = 2, WINDOW = 10, MOST_POINTS = 6000;  // seconds of a plot, and samples that are kept
let shownRevision = -1;
function valueAt(index) {
  if (shownRevision !== revised) { evaluated("outputs", now); shownRevision = revised; }
  return MODEL.outputs.values[index];
}
function timeSpan() { const end = Math.max(now.t[0], LIVE.t0 + SHORTEST_WINDOW); return [Math.max(LIVE.t0, end - WINDOW), end]; }
function revision() { return revised; }
// What is plotted, as a table: names of columns, and rows over time.
function table() {
  const lines = plots.flatMap(plot => { return plot.lines.map(line => [line.name ? plot.label + ", " + line.name : plot.label, line.column]); });
  const times = lines.length ? pointsOf(lines[0][1]).map(point => point[0]) : [];
  return { names: lines.map(line => line[0]), rows: times.map((time, k) => { return [time, ...lines.map(line => pointsOf(line[1])[k][1])]; }) };
}

const samples = { last: -Infinity, lines: new Map(), paths: DATA.traces.map(frame => { return { frame: frame, times: [], points: [] }; }) };
for (const plot of DATA.plots) for (const line of plot.lines) samples.lines.set(line.column, []);
function pointsOf(index) { return samples.lines.get(index); }
// Keep a column from now on.
function watch(index) {
  if (samples.lines.has(index)) return;
  const [others] = samples.lines.values(), points = others ? others.slice(0, -1).map(point => [point[0], NaN]) : [];
  points.push([now.t[0], valueAt(index)]);
  samples.lines.set(index, points);
}
function paths() { return samples.paths; }
function remember(always) {
  if (!always && now.t[0] - samples.last < 0.008) return;
  if (!samples.lines.size && !samples.paths.length) return;
  samples.last = now.t[0];
  if (!always) { now.lam.set(trial.lam); now.a.set(trial.a); accelerations(now); }
  revised++;
  samples.lines.forEach((points, index) => {
    points.push([now.t[0], valueAt(index)]);
    if (points.length > MOST_POINTS) points.splice(0, MOST_POINTS / 2);
  });
  for (const path of samples.paths) {
    path.times.push(now.t[0]);
    path.points.push(poseOf(path.frame, now.t[0]));
    if (path.times.length > MOST_POINTS) { path.times.splice(0, MOST_POINTS / 2); path.points.splice(0, MOST_POINTS / 2); }
  }
}
function forget() {
  samples.lines.forEach(points => { points.length = 0; });
  for (const path of samples.paths) path.times.length = path.points.length = 0;
  samples.last = -Infinity;
  revised++;
  remember(true);
}

// Messages of elements that leave their range of validity in the present state.
function warnings() {
  if (!LIVE.validity.length) return [];
  const values = evaluated("validity", now);
  return LIVE.validity.filter((_, k) => values[k] < -1e-6 * (1 + Math.abs(values[k])));
}

startRows.evaluate(now);
start.rank = startRows.factor(inverseRoots(evaluated("weights", now))).rank;
findRanks(now);
accelerations(now);
