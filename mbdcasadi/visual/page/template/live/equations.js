// --- the equations of motion: M a + Phi_q' lam = Q, Phi_q a = gamma, from the functions of the model ----------------

const LIVE = DATA.live;
const N = LIVE.n, MULTIPLIERS = LIVE.m, STATES = LIVE.z0.length, POSITION_ROWS = LIVE.positionRows;

// The state of the mechanism and all that is known of it: the arguments of every function of the model.
const now = {
  t: new Float64Array([LIVE.t0]), q: Float64Array.from(LIVE.q0), v: Float64Array.from(LIVE.v0), a: new Float64Array(N),
  z: Float64Array.from(LIVE.z0), lam: new Float64Array(MULTIPLIERS), u: Float64Array.from(LIVE.u0), p: Float64Array.from(LIVE.p0),
};
function evaluated(name, x) {
  const f = MODEL[name];
  f.call(x.t, x.q, x.v, x.a, x.z, x.lam, x.u, x.p, f.values);
  return f.values;
}

// A point of a body that is pulled to the pointer by a spring and a damper; null if none is.
let pull = null;
function pointOf(body, place, x) {
  const k = 3 * body, c = Math.cos(x.q[k + 2]), s = Math.sin(x.q[k + 2]);
  const bx = -s * place[0] - c * place[1], by = c * place[0] - s * place[1];    // derivatives by the angle
  return { x: x.q[k] + by, y: x.q[k + 1] - bx, vx: x.v[k] + bx * x.v[k + 2], vy: x.v[k + 1] + by * x.v[k + 2], bx: bx, by: by };
}
function addPull(force, x) {
  const point = pointOf(pull.body, pull.place, x), k = 3 * pull.body;
  const fx = pull.stiffness * (pull.target[0] - point.x) - pull.damping * point.vx;
  const fy = pull.stiffness * (pull.target[1] - point.y) - pull.damping * point.vy;
  force[k] += fx;
  force[k + 1] += fy;
  force[k + 2] += point.bx * fx + point.by * fy;
}

const ranks = { position: POSITION_ROWS.length, all: MULTIPLIERS };
const solver = {
  mass: new Float64Array(N), force: new Float64Array(N), gamma: new Float64Array(MULTIPLIERS),
  rows: new Factors(N, MULTIPLIERS), factor: new Float64Array(N * N), y: new Float64Array(N), c: new Float64Array(MULTIPLIERS),
  sizes: new Float64Array(MULTIPLIERS), whole: LIVE.slope ? new LU(N + MULTIPLIERS) : null, gradient: new Float64Array(N * MULTIPLIERS),
};

// Dense gradients of the rows, one after the other, from entries of Phi_q.
function spread(entries, at, gradients) {
  gradients.fill(0);
  const rows = LIVE.jacobian.rows, columns = LIVE.jacobian.columns;
  for (let k = 0; k < rows.length; k++) gradients[rows[k] * N + columns[k]] = entries[at + k];
}

// Accelerations and multipliers of a state, into x.a and x.lam.
function accelerations(x) {
  const mass = evaluated("mass", x), values = evaluated("dynamics", x), force = solver.force, gamma = solver.gamma;
  for (let i = 0; i < N; i++) force[i] = values[i];
  for (let j = 0; j < MULTIPLIERS; j++) gamma[j] = values[N + j];
  if (pull) addPull(force, x);
  if (LIVE.slope) withFriction(x, mass, values);
  else withoutFriction(x, mass, values);
}

function withoutFriction(x, mass, values) {
  const rows = solver.rows, y = solver.y, light = LIVE.effectiveMasses, L = solver.factor;
  spread(values, N + MULTIPLIERS, rows.A);
  for (let i = 0; i < N; i++) y[i] = solver.force[i];
  if (light) {                                               // the matrix M + Phi_q' A Phi_q, which joints make regular
    L.fill(0);
    for (let i = 0; i < N; i++) L[i * N + i] = mass[i];
    for (let j = 0; j < MULTIPLIERS; j++) {
      const at = j * N;
      for (let i = 0; i < N; i++) {
        const g = light[j] * rows.A[at + i];
        if (g === 0) continue;
        y[i] += g * solver.gamma[j];
        for (let l = 0; l <= i; l++) L[i * N + l] += g * rows.A[at + l];
      }
    }
    if (!cholesky(L, N)) { x.a.fill(NaN); return; }
    for (let j = 0; j < MULTIPLIERS; j++) forward(L, N, rows.A, j * N);
    forward(L, N, y, 0);
  } else {
    for (let i = 0; i < N; i++) { const root = Math.sqrt(mass[i]); L[i] = root; y[i] /= root; }
    for (let j = 0; j < MULTIPLIERS; j++) for (let i = 0; i < N; i++) rows.A[j * N + i] /= L[i];
  }
  rows.factor(ranks.all);
  rows.timesQt(y);
  rows.leading(solver.gamma, solver.c);
  for (let j = 0; j < rows.rank; j++) { const wanted = solver.c[j]; solver.c[j] = y[j] - wanted; y[j] = wanted; }
  if (x !== trial || STATES) rows.multipliers(solver.c, x.lam, usualSizes(rows));  // within a step only rates of states may need them
  rows.timesQ(y);
  if (light) backward(L, N, y);
  else for (let i = 0; i < N; i++) y[i] /= L[i];
  x.a.set(y);
}

// Sizes of multipliers, by which those of dependent rows are least: in m and in rad apart.
function usualSizes(rows) {
  if (rows.rank === MULTIPLIERS) return null;
  if (LIVE.effectiveMasses) { for (let j = 0; j < MULTIPLIERS; j++) solver.sizes[j] = 1 / LIVE.effectiveMasses[j]; return solver.sizes; }
  const sums = [0, 0], counts = [0, 0];
  for (let j = 0; j < MULTIPLIERS; j++) { sums[LIVE.angular[j]] += 1 / (rows.scale[j] * rows.scale[j]); counts[LIVE.angular[j]]++; }
  for (let j = 0; j < MULTIPLIERS; j++) solver.sizes[j] = sums[LIVE.angular[j]] / counts[LIVE.angular[j]];
  return solver.sizes;
}

// Forces that depend on multipliers: Newton's method, from the multipliers known last.
function withFriction(x, mass, values) {
  const size = N + MULTIPLIERS, matrix = solver.whole.A, gradient = solver.gradient, right = new Float64Array(size);
  spread(values, size, gradient);
  for (let round = 0; round < 60; round++) {
    if (round > 0) {
      const again = evaluated("dynamics", x);
      for (let i = 0; i < N; i++) solver.force[i] = again[i];
      if (pull) addPull(solver.force, x);
    }
    matrix.fill(0);
    let terms = 1;
    for (let i = 0; i < N; i++) { matrix[i * size + i] = mass[i]; right[i] = solver.force[i] - mass[i] * x.a[i]; terms = Math.max(terms, Math.abs(solver.force[i])); }
    for (let j = 0; j < MULTIPLIERS; j++) {
      right[N + j] = solver.gamma[j];
      for (let i = 0; i < N; i++) {
        const g = gradient[j * N + i];
        if (g === 0) continue;
        matrix[i * size + N + j] = g;
        matrix[(N + j) * size + i] = g;
        right[i] -= g * x.lam[j];
        right[N + j] -= g * x.a[i];
      }
    }
    const slope = evaluated("slope", x);
    for (let k = 0; k < LIVE.slope.rows.length; k++) matrix[LIVE.slope.rows[k] * size + N + LIVE.slope.columns[k]] -= slope[k];
    solver.whole.factor().solve(right);
    for (let i = 0; i < N; i++) x.a[i] += right[i];
    for (let j = 0; j < MULTIPLIERS; j++) x.lam[j] += right[N + j];
    let change = 0;
    for (let i = 0; i < size; i++) change = Math.max(change, Math.abs(right[i]) / (1 + Math.abs(i < N ? x.a[i] : x.lam[i - N])));
    if (change <= 1e-12) return;
    if (!(change < 1e100)) break;
    if (round === 59 && change <= 1e-9) return;
  }
  x.a.fill(NaN);
  x.lam.fill(0);                                              // where the next attempt begins
}

// Rates of the state [q, v, z], as an integrator takes them.
const DIMENSION = 2 * N + STATES;
const trial = Object.assign({}, now, {
  t: new Float64Array(1), q: new Float64Array(N), v: new Float64Array(N), a: new Float64Array(N), z: new Float64Array(STATES),
  lam: new Float64Array(MULTIPLIERS),
});
let evaluations = 0;
function rateOf(t, y, rate) {
  evaluations++;
  trial.t[0] = t;
  for (let i = 0; i < N; i++) { trial.q[i] = y[i]; trial.v[i] = y[N + i]; }
  for (let i = 0; i < STATES; i++) trial.z[i] = y[2 * N + i];
  accelerations(trial);
  for (let i = 0; i < N; i++) { rate[i] = trial.v[i]; rate[N + i] = trial.a[i]; }
  if (STATES) { const rates = evaluated("rates", trial); for (let i = 0; i < STATES; i++) rate[2 * N + i] = rates[i]; }
}
