// --- integrators: explicit Runge–Kutta of order 8 (DOP853), and Radau IIA of order 5 where the motion is stiff ------
// Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, section II.5; II, section IV.8.

// Tolerances, relative and absolute, of the explicit and of the implicit method.
const EXPLICIT_TOLERANCE = 1e-11, IMPLICIT_TOLERANCE = 1e-9, STIFF_STEPS = 15, STIFF_LIMIT = 6.1, SHORTEST_STEP = 1e-13;
function scaledNorm(error, y, z) {
  let sum = 0;
  for (let i = 0; i < error.length; i++) {
    const e = error[i] / (1 + Math.max(Math.abs(y[i]), Math.abs(z[i])));
    sum += e * e;
  }
  return Math.sqrt(sum / error.length) / IMPLICIT_TOLERANCE;
}

class Explicit {
  constructor(n) {
    this.n = n;
    this.K = Array.from({ length: 13 }, () => new Float64Array(n));
    this.stage = new Float64Array(n); this.next = new Float64Array(n); this.stiff = 0;
  }
  // One step from y over h, into this.next; the norm of its error, in tolerances.
  attempt(t, y, rate, h) {
    const K = this.K, n = this.n, A = LIVE.tableau.A, B = LIVE.tableau.B, C = LIVE.tableau.C, stage = this.stage, next = this.next;
    K[0].set(rate);
    for (let s = 1; s < 12; s++) {
      stage.set(y);
      for (let j = 0; j < s; j++) {
        const a = h * A[s][j], k = K[j];
        if (a !== 0) for (let i = 0; i < n; i++) stage[i] += a * k[i];
      }
      rateOf(t + C[s] * h, stage, K[s]);
    }
    next.set(y);
    for (let j = 0; j < 12; j++) { const b = h * B[j]; if (b !== 0) for (let i = 0; i < n; i++) next[i] += b * K[j][i]; }
    rateOf(t + h, next, K[12]);
    let five = 0, three = 0, apart = 0, change = 0;
    for (let i = 0; i < n; i++) {
      let e5 = 0, e3 = 0;
      for (let j = 0; j < 13; j++) { e5 += LIVE.tableau.E5[j] * K[j][i]; e3 += LIVE.tableau.E3[j] * K[j][i]; }
      const scale = EXPLICIT_TOLERANCE * (1 + Math.max(Math.abs(y[i]), Math.abs(next[i])));
      five += e5 * e5 / (scale * scale);
      three += e3 * e3 / (scale * scale);
      change += (K[12][i] - K[11][i]) * (K[12][i] - K[11][i]);
      apart += (next[i] - stage[i]) * (next[i] - stage[i]);
    }
    // the size of h lambda, by the two estimates at the end of the step
    this.eigenvalue = apart > 0 ? h * Math.sqrt(change / apart) : 0;
    return five === 0 && three === 0 ? 0 : h * five / Math.sqrt((five + 0.01 * three) * n);
  }
  accepted() {
    this.stiff = this.eigenvalue > STIFF_LIMIT ? this.stiff + 1 : Math.max(0, this.stiff - 1 / 6);
  }
  factorFor(error) { return error === 0 ? 10 : Math.min(10, Math.max(0.2, 0.9 * Math.pow(error, -1 / 8))); }
}

const S6 = Math.sqrt(6), CBRT3 = Math.cbrt(3);
const RADAU = {
  C: [(4 - S6) / 10, (4 + S6) / 10, 1], E: [(-13 - 7 * S6) / 3, (-13 + 7 * S6) / 3, -1 / 3],
  real: 3 + CBRT3 * CBRT3 - CBRT3, re: 3 + 0.5 * (CBRT3 - CBRT3 * CBRT3), im: -0.5 * (Math.pow(3, 5 / 6) + Math.pow(3, 7 / 6)),
  T: [[0.09443876248897524, -0.14125529502095421, 0.03002919410514742],
      [0.25021312296533332, 0.20412935229379994, -0.38294211275726192], [1, 1, 0]],
  TI: [[4.17871859155190428, 0.32768282076106237, 0.52337644549944951],
       [-4.17871859155190428, -0.32768282076106237, 0.47662355450055044],
       [0.50287263494578682, -2.57192694985560522, 0.59603920482822492]],
};

class Implicit {
  constructor(n) {
    this.n = n;
    const column = () => new Float64Array(n);
    this.J = new Float64Array(n * n); this.fresh = false; this.factored = 0;
    this.realLU = new LU(n); this.complexLU = new ComplexLU(n);
    this.Z = [column(), column(), column()]; this.W = [column(), column(), column()]; this.F = [column(), column(), column()];
    this.dW = [column(), column(), column()]; this.next = column(); this.stage = column(); this.error = column();
    this.iterations = 0;
    this.tolerance = Math.max(10 * 2.2e-16 / IMPLICIT_TOLERANCE, Math.min(0.03, Math.sqrt(IMPLICIT_TOLERANCE)));
  }
  differentiate(t, y, rate) {
    const n = this.n, moved = this.stage, there = this.error;
    moved.set(y);
    for (let k = 0; k < n; k++) {
      const by = 1.5e-8 * Math.max(Math.abs(y[k]), 1e-2);
      moved[k] = y[k] + by;
      const exact = moved[k] - y[k];
      rateOf(t, moved, there);
      for (let i = 0; i < n; i++) this.J[i * n + k] = (there[i] - rate[i]) / exact;
      moved[k] = y[k];
    }
    this.fresh = true;
    this.factored = 0;
  }
  factor(h) {
    if (this.factored === h) return;
    const n = this.n;
    for (let i = 0; i < n * n; i++) { this.realLU.A[i] = -this.J[i]; this.complexLU.A[i] = -this.J[i]; this.complexLU.B[i] = 0; }
    for (let i = 0; i < n; i++) { const k = i * n + i; this.realLU.A[k] += RADAU.real / h; this.complexLU.A[k] += RADAU.re / h; this.complexLU.B[k] += RADAU.im / h; }
    this.realLU.factor();
    this.complexLU.factor();
    this.factored = h;
  }
  newton(t, y, h) {
    const n = this.n, Z = this.Z, W = this.W, F = this.F, dW = this.dW, T = RADAU.T, TI = RADAU.TI;
    for (let s = 0; s < 3; s++) { Z[s].fill(0); W[s].fill(0); }
    let before = null;
    for (let round = 0; round < 10; round++) {
      for (let s = 0; s < 3; s++) {
        for (let i = 0; i < n; i++) this.stage[i] = y[i] + Z[s][i];
        rateOf(t + RADAU.C[s] * h, this.stage, F[s]);
      }
      for (let i = 0; i < n; i++) {
        const f0 = F[0][i], f1 = F[1][i], f2 = F[2][i];
        dW[0][i] = TI[0][0] * f0 + TI[0][1] * f1 + TI[0][2] * f2 - RADAU.real / h * W[0][i];
        dW[1][i] = TI[1][0] * f0 + TI[1][1] * f1 + TI[1][2] * f2 - (RADAU.re * W[1][i] - RADAU.im * W[2][i]) / h;
        dW[2][i] = TI[2][0] * f0 + TI[2][1] * f1 + TI[2][2] * f2 - (RADAU.re * W[2][i] + RADAU.im * W[1][i]) / h;
      }
      this.realLU.solve(dW[0]);
      this.complexLU.solve(dW[1], dW[2]);
      let sum = 0;
      for (let s = 0; s < 3; s++) for (let i = 0; i < n; i++) { const e = dW[s][i] / (IMPLICIT_TOLERANCE * (1 + Math.abs(y[i]))); sum += e * e; }
      const size = Math.sqrt(sum / (3 * n)), rate = before === null ? null : size / before;
      if (!(size < 1e200) || (rate !== null && (rate >= 1 || Math.pow(rate, 10 - round) / (1 - rate) * size > this.tolerance))) return false;
      for (let s = 0; s < 3; s++) for (let i = 0; i < n; i++) W[s][i] += dW[s][i];
      for (let s = 0; s < 3; s++) for (let i = 0; i < n; i++) Z[s][i] = T[s][0] * W[0][i] + T[s][1] * W[1][i] + T[s][2] * W[2][i];
      this.iterations = round + 1;
      if (size === 0 || (rate !== null && rate / (1 - rate) * size < this.tolerance)) return true;
      before = size;
    }
    return false;
  }
  attempt(t, y, rate, h) {
    const n = this.n;
    for (let round = 0; ; round++) {
      if (!this.fresh && (round > 0 || this.iterations === 0)) this.differentiate(t, y, rate);
      this.factor(h);
      if (this.newton(t, y, h)) break;
      if (round > 0 || this.fresh) { this.iterations = 0; return Infinity; }
    }
    const error = this.error;
    const estimate = (first) => {
      for (let i = 0; i < n; i++) error[i] = first[i] + (RADAU.E[0] * this.Z[0][i] + RADAU.E[1] * this.Z[1][i] + RADAU.E[2] * this.Z[2][i]) / h;
      this.realLU.solve(error);
    };
    estimate(rate);
    for (let i = 0; i < n; i++) this.next[i] = y[i] + this.Z[2][i];
    let size = scaledNorm(error, y, this.next);
    if (size > 1) {                                          // the estimate itself may be stiff
      for (let i = 0; i < n; i++) this.stage[i] = y[i] + error[i];
      rateOf(t, this.stage, this.F[0]);
      estimate(this.F[0]);
      size = scaledNorm(error, y, this.next);
    }
    return size;
  }
  accepted() { this.fresh = false; if (this.iterations > 3) this.iterations = 0; }  // slow: a new Jacobian at the next step
  factorFor(error) {
    if (error === Infinity) return 0.5;
    return error === 0 ? 8 : Math.min(8, Math.max(0.2, 0.9 * 13 / (12 + this.iterations) * Math.pow(error, -0.25)));
  }
}
