// --- the motion: start, steps with projection, and values of sliders ----------------------------------------------------

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
  cutPast(false);
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
  remember(true);
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
  swept = null;
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
  if (slider.input) {
    cutPast(true);
    now.u[slider.index] = value;
    accelerations(now);
    revised++;
    remember(true);
    return value;
  }
  const values = Float64Array.from(now.p);
  values[slider.index] = value;
  const fresh = now.t[0] === LIVE.t0 && !course.touched;
  if (fresh) { now.p.set(values); restart(); }
  else {
    cutPast(true);
    swept = null;
    const aim = x => close(closure, x, projectionRoots, ranks.position);
    follow(now, values, aim);
    bring(now, projectionRoots);
    accelerations(now);
    revised++;
    remember(true);
  }
  return now.p[slider.index];
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
