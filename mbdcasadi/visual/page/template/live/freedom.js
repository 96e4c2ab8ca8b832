// --- the freedom of the linkage: the way that follows the pointer, and the whole way of what can move in one way only ---
const TURN = 0.06, SHIFT = 0.03;                              // largest step: rad, and sizes of the mechanism
LIVE.holds = LIVE.driven && ranks.position === N;             // drivers determine every pose

// What unit forces along x and y at a point do to the pose, in coordinates scaled by the metric; and what they would do
// to the free body.
function responses(body, place) {
  const point = pointOf(body, place, now), k = 3 * body, zero = new Float64Array(closure.count), g = [new Float64Array(N), new Float64Array(N)];
  closure.evaluate(now);
  closure.factor(projectionRoots, ranks.position);
  g[0][k] = projectionRoots[k]; g[0][k + 2] = point.bx * projectionRoots[k + 2];
  g[1][k + 1] = projectionRoots[k + 1]; g[1][k + 2] = point.by * projectionRoots[k + 2];
  let size = 0;
  for (const part of g) { size = Math.max(size, dot(part, part)); closure.factors.nearest(part, zero); }
  return { g: g, size: size };
}
function dot(a, b) { let sum = 0; for (let i = 0; i < N; i++) sum += a[i] * b[i]; return sum; }

// The step dq (for the time dt) by which a point comes as near to a place as it can.
function stepTowards(body, place, target) {
  const point = pointOf(body, place, now), ex = target[0] - point.x, ey = target[1] - point.y;
  if (LIVE.holds) {                                           // along the time
    const speed = point.vx * point.vx + point.vy * point.vy, dt = speed > 0 ? (ex * point.vx + ey * point.vy) / speed : 0;
    return { dt: dt, dq: now.v.map(v => v * dt) };
  }
  const { g, size } = responses(body, place);
  const a = dot(g[0], g[0]) + 1e-6 * size, b = dot(g[0], g[1]), d = dot(g[1], g[1]) + 1e-6 * size, det = a * d - b * b;
  const cx = (d * ex - b * ey) / det, cy = (a * ey - b * ex) / det;
  return { dt: 0, dq: now.q.map((_, i) => (cx * g[0][i] + cy * g[1][i]) * projectionRoots[i]) };
}
// The multiple of a step that turns and shifts nothing far; infinite for none.
function longest(dq) {
  let turn = 0, shift = 0;
  for (let i = 0; i < N; i++) { if (LIVE.angles[i]) turn = Math.max(turn, Math.abs(dq[i])); else shift = Math.max(shift, Math.abs(dq[i])); }
  return Math.min(TURN / turn, SHIFT * LIVE.size / shift);
}
// Move a state by a share of a step, onto the constraints; false if that leads elsewhere.
function stepped(x, dq, dt, share) {
  const from = Float64Array.from(x.q), t = x.t[0];
  for (let i = 0; i < N; i++) x.q[i] += share * dq[i];
  x.t[0] = Math.max(t + share * dt, LIVE.t0);
  let most = 0;
  const met = close(closure, x, projectionRoots, ranks.position);
  for (let i = 0; i < N; i++) if (LIVE.angles[i]) most = Math.max(most, Math.abs(x.q[i] - from[i]));
  if (met && most < LARGEST_TURN) return true;
  x.q.set(from);
  x.t[0] = t;
  return false;
}

// Move a point of a body towards a place, by the least motion of all parts; every step is kept. False if nothing can move there.
function followPointer(body, place, target) {
  const kept = new Float64Array(N), apart = () => { const p = pointOf(body, place, now); return Math.hypot(target[0] - p.x, target[1] - p.y); };
  let moved = false;
  for (let round = 0; round < 200; round++) {
    const before = apart(), { dt, dq } = stepTowards(body, place, target), t = now.t[0];
    let better = false;
    kept.set(now.q);
    for (let half = 0, share = Math.min(1, longest(dq)); half < 8 && !better; half++, share /= 2) {
      better = stepped(now, dq, dt, share) && apart() < before * (1 - 1e-6);
      if (!better) { now.q.set(kept); now.t[0] = t; }
    }
    if (!better) break;
    if (!moved) { now.v.fill(0); course.touched = true; course.h = 1e-4; }
    moved = true;
    speeds(now, new Float64Array(N), projectionRoots, false);
    accelerations(now);
    remember(true);
  }
  return moved;
}

// The whole way of a linkage of one freedom, or of one that drivers hold in its time: paths of points, and a box about
// all bodies; null if it has more freedoms, or leads far away.
const MOST_STEPS = 500, FAR = 8, LONGEST_TIME = 0.1;          // steps of a way, sizes of the mechanism that it may lead to, and seconds of a step
let swept = null;
function sweep() {
  if (swept === null) swept = { way: LIVE.holds || N - ranks.position === 1 ? walkedWay() : null };
  return swept.way;
}
function walkedWay() {
  const x = Object.assign({}, now, { t: Float64Array.from(now.t), q: Float64Array.from(now.q), v: Float64Array.from(now.v) });
  const start = { t: x.t[0], q: Float64Array.from(x.q) }, zero = new Float64Array(closure.count), steps = [[], []];
  let along = null, end = "";
  const freedom = before => {                                 // the direction of the freedom that goes on from another one
    closure.evaluate(x);
    closure.factor(projectionRoots, ranks.position);
    if (before) { closure.factors.nearest(before, zero); return before; }
    let best = null;
    for (let i = 0; i < N; i++) {
      const unit = new Float64Array(N);
      unit[i] = 1;
      closure.factors.nearest(unit, zero);
      if (!best || dot(unit, unit) > dot(best, best)) best = unit;
    }
    return best;
  };
  const returned = () => {
    for (let i = 0; i < N; i++) {
      const d = x.q[i] - start.q[i];
      if (LIVE.angles[i] ? Math.abs(d - 2 * Math.PI * Math.round(d / (2 * Math.PI))) > TURN : Math.abs(d) > SHIFT * LIVE.size) return false;
    }
    return true;
  };
  const read = list => {
    const values = Float64Array.from(evaluated("outputs", x)), valueOf = index => values[index];
    list.push({ places: DATA.traces.map(frame => poseOf(frame, valueOf)), boxes: list.length % 3 ? [] : Array.from(bodyBoxes(valueOf).values()) });
  };
  for (const way of LIVE.holds ? [0] : [0, 1]) {
    x.q.set(start.q); x.t[0] = start.t;
    let left = false;
    read(steps[way]);
    if (!LIVE.holds) along = freedom(null).map(d => way ? -d : d);
    for (end = ""; !end;) {
      if (LIVE.holds) speeds(x, new Float64Array(N), projectionRoots, false); else along = freedom(along);
      const dq = LIVE.holds ? x.v : along.map((d, i) => d * projectionRoots[i]);
      let size = Math.min(longest(dq), LIVE.holds ? LONGEST_TIME : Infinity), met = false;
      if (!(size > 0 && size < Infinity)) { end = "locked"; break; }
      for (let half = 0; half < 5 && !met; half++, size /= 2) met = stepped(x, dq, LIVE.holds ? 1 : 0, size);
      if (!met) { end = "locked"; break; }
      read(steps[way]);
      const far = x.q.some((q, i) => !LIVE.angles[i] && Math.abs(q - start.q[i]) > FAR * LIVE.size);
      if (left && returned()) { steps[way].push(steps[way][0]); end = "closed"; }
      else if (far || steps[way].length > MOST_STEPS) end = far ? "far" : "long";
      left = left || !returned();
    }
    if (end !== "locked") break;
  }
  shownRevision = -1;
  const all = [...steps[1].reverse(), ...steps[0]];
  const boxes = all.flatMap(step => step.boxes);
  const corners = boxes.reduce((sum, b) => around(sum, [[b[0], b[1]], [b[2], b[3]]]), DATA.box);
  if (end === "far") return null;
  return { paths: DATA.traces.map((_, k) => all.map(step => step.places[k])), box: corners };
}
