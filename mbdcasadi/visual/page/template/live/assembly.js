// --- poses and velocities on the constraints: Newton's method, always the nearest in a metric ---------------------

const LARGEST_TURN = 0.3, SMALLEST_STEP = 1 / 2048;
function inverseRoots(weights) { return Float64Array.from(weights, w => 1 / Math.sqrt(w)); }
const projectionRoots = inverseRoots(LIVE.projectionWeights);

// Rows of positions: constraints, and with `conditions` those of the start as well.
class PositionRows {
  constructor(conditions) {
    this.conditions = conditions ? LIVE.conditions : null;
    this.count = POSITION_ROWS.length + (this.conditions ? this.conditions.count : 0);
    this.residual = new Float64Array(this.count);
    this.gradients = new Float64Array(this.count * N);
    this.factors = new Factors(N, this.count);
    this.all = new Float64Array(MULTIPLIERS * N);
  }
  evaluate(x) {
    const values = evaluated("constraints", x), first = POSITION_ROWS.length;
    spread(values, first, this.all);
    for (let k = 0; k < first; k++) {
      this.residual[k] = values[k];
      this.gradients.set(this.all.subarray(POSITION_ROWS[k] * N, POSITION_ROWS[k] * N + N), k * N);
    }
    if (!this.conditions) return;
    const more = evaluated("conditions", x), count = this.conditions.count;
    this.gradients.fill(0, first * N);
    for (let k = 0; k < count; k++) this.residual[first + k] = more[k];
    this.conditions.rows.forEach((row, k) => { this.gradients[(first + row) * N + this.conditions.columns[k]] = more[count + k]; });
  }
  factor(roots, rank) {
    const A = this.factors.A;
    for (let j = 0; j < this.count; j++) for (let i = 0; i < N; i++) A[j * N + i] = this.gradients[j * N + i] * roots[i];
    return this.factors.factor(rank);
  }
}
const closure = new PositionRows(false), startRows = new PositionRows(true);

// Bring x.q onto rows by the least change; false if that does not converge.
function close(rows, x, roots, rank) {
  const step = new Float64Array(N), wanted = new Float64Array(rows.count);
  let before = Infinity;
  for (let round = 0; round < 30; round++) {
    rows.evaluate(x);
    const left = largest(rows.residual);
    if (!(left < 1e6)) return false;
    if (left <= LIVE.tolerance && (left <= 1e-3 * LIVE.tolerance || left >= 0.5 * before)) return true;
    before = left;
    if (round > 3 && left > 10) return false;
    rows.factor(roots, rank);
    for (let k = 0; k < rows.count; k++) wanted[k] = -rows.residual[k];
    step.fill(0);
    rows.factors.nearest(step, wanted);
    let share = 1;
    for (let i = 0; i < N; i++) if (LIVE.angles[i] && Math.abs(step[i] * roots[i]) * share > 0.5) share = 0.5 / Math.abs(step[i] * roots[i]);
    for (let i = 0; i < N; i++) x.q[i] += share * step[i] * roots[i];
  }
  return before <= LIVE.tolerance;
}

// Slide x.q along rows to the pose nearest to a target.
function slide(rows, x, target, roots, rank) {
  const step = new Float64Array(N), wanted = new Float64Array(rows.count), kept = new Float64Array(N);
  let share = 1, before = Infinity;
  for (let round = 0; round < 300; round++) {
    rows.evaluate(x);
    rows.factor(roots, rank);
    for (let k = 0; k < rows.count; k++) wanted[k] = -rows.residual[k];
    for (let i = 0; i < N; i++) step[i] = (target[i] - x.q[i]) / roots[i];
    rows.factors.nearest(step, wanted);
    let length = 0, turn = 0;
    for (let i = 0; i < N; i++) {
      length += step[i] * step[i];
      if (LIVE.angles[i]) turn = Math.max(turn, Math.abs(step[i] * roots[i]));
    }
    if (length <= 1e-28 || (round > 20 && length >= before && turn < 1e-12)) break;
    if (length > before) share = Math.max(share / 2, 1 / 16);
    before = length;
    kept.set(x.q);
    const by = share * Math.min(1, LARGEST_TURN / Math.max(turn, 1e-300));
    for (let i = 0; i < N; i++) x.q[i] += by * step[i] * roots[i];
    if (!close(rows, x, roots, rank)) { x.q.set(kept); share /= 2; if (share < 1e-3) return false; }
  }
  return close(rows, x, roots, rank);
}

// The velocity on the constraints that is nearest to a target; `start`: with the conditions of the start.
const speedRows = { plain: new Factors(N, MULTIPLIERS), start: new Factors(N, MULTIPLIERS + LIVE.speeds.count), all: new Float64Array(MULTIPLIERS * N) };
function speeds(x, target, roots, start) {
  const rows = start ? speedRows.start : speedRows.plain, values = evaluated("constraints", x), first = MULTIPLIERS;
  const entries = LIVE.jacobian.rows.length, places = POSITION_ROWS.length;
  spread(values, places, speedRows.all);
  rows.A.fill(0);
  rows.A.set(speedRows.all);
  const wanted = new Float64Array(rows.k), y = new Float64Array(N);
  for (let j = 0; j < first; j++) wanted[j] = values[places + entries + j];
  if (start && LIVE.speeds.count) {
    const more = evaluated("speeds", x);
    for (let k = 0; k < LIVE.speeds.count; k++) wanted[first + k] = -more[k];
    LIVE.speeds.rows.forEach((row, k) => { rows.A[(first + row) * N + LIVE.speeds.columns[k]] = more[LIVE.speeds.count + k]; });
  }
  for (let j = 0; j < rows.k; j++) for (let i = 0; i < N; i++) rows.A[j * N + i] *= roots[i];
  rows.factor(start ? undefined : ranks.all);
  for (let i = 0; i < N; i++) y[i] = target[i] / roots[i];
  rows.nearest(y, wanted);
  for (let i = 0; i < N; i++) x.v[i] = y[i] * roots[i];
}

// Number of independent rows, in a pose on the constraints.
function findRanks(x) {
  closure.evaluate(x);
  ranks.position = closure.factor(projectionRoots).rank;
  const all = new Factors(N, MULTIPLIERS), values = evaluated("constraints", x);
  spread(values, POSITION_ROWS.length, all.A);
  for (let j = 0; j < MULTIPLIERS; j++) for (let i = 0; i < N; i++) all.A[j * N + i] *= projectionRoots[i];
  ranks.all = all.factor().rank;
}

function violationOf(x) {
  const values = evaluated("constraints", x);
  return largest(values.subarray(0, POSITION_ROWS.length));
}

// Move parameters to values in steps that turn no body far, so that the branch of the linkage is kept; `meet(x)` brings
// a pose onto the constraints. Returns the share of the way that was reached.
function follow(x, values, meet) {
  const from = Float64Array.from(x.p), pose = new Float64Array(N);
  let done = 0, step = 1;
  while (done < 1) {
    const to = Math.min(1, done + step);
    pose.set(x.q);
    for (let k = 0; k < from.length; k++) x.p[k] = to === 1 ? values[k] : from[k] + to * (values[k] - from[k]);
    let turn = meet(x) ? 0 : Infinity;
    for (let i = 0; i < N && turn < Infinity; i++) if (LIVE.angles[i]) turn = Math.max(turn, Math.abs(x.q[i] - pose[i]));
    if (turn <= LARGEST_TURN) { done = to; step *= 2; continue; }
    x.q.set(pose);
    step /= 2;
    if (step < SMALLEST_STEP) {
      for (let k = 0; k < from.length; k++) x.p[k] = from[k] + done * (values[k] - from[k]);
      break;
    }
  }
  return done;
}
