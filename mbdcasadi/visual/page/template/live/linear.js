// --- linear algebra: dense, in typed arrays, of the size of a mechanism ----------------------------

// Orthogonal factors A P = Q R of a matrix n × k of constraint gradients, by Householder reflections with column
// pivoting. Columns are stored one after the other and are scaled to length one, so that a pivot below RANK is no
// row of its own: dependent rows are known by their number, and left out.
const RANK = 1e-9;
class Factors {
  constructor(n, k) {
    this.n = n; this.k = k; this.rank = 0;
    this.A = new Float64Array(n * k); this.scale = new Float64Array(k); this.tau = new Float64Array(k);
    this.order = new Int32Array(k); this.work = new Float64Array(k); this.norms = new Float64Array(k);
    this.places = new Int32Array(n);
  }

  // Factors of the columns in A; at most `rank` of them.
  factor(most) {
    const n = this.n, k = this.k, A = this.A, order = this.order, norms = this.norms, places = this.places;
    for (let j = 0; j < k; j++) {
      let sum = 0;
      for (let i = 0; i < n; i++) sum += A[j * n + i] * A[j * n + i];
      const scale = sum > 0 ? 1 / Math.sqrt(sum) : 1;
      for (let i = 0; i < n; i++) A[j * n + i] *= scale;
      this.scale[j] = scale;
      order[j] = j;
      norms[j] = sum > 0 ? 1 : 0;
    }
    const limit = Math.min(n, k, most === undefined ? k : most);
    this.rank = limit;
    for (let step = 0; step < limit; step++) {
      let best = step;
      for (let j = step + 1; j < k; j++) if (norms[order[j]] > norms[order[best]]) best = j;
      const swap = order[best]; order[best] = order[step]; order[step] = swap;
      const c = swap * n;
      let sum = 0;
      for (let i = step; i < n; i++) sum += A[c + i] * A[c + i];
      const size = Math.sqrt(sum);
      if (size <= RANK && most === undefined) { this.rank = step; break; }
      const alpha = A[c + step] > 0 ? -size : size, head = A[c + step] - alpha;
      this.tau[step] = -head / alpha;                       // reflection I - tau v v', v = [1, …]
      let filled = 0;                                       // entries of v that are not zero: joints have few
      for (let i = step + 1; i < n; i++) if (A[c + i] !== 0) { A[c + i] /= head; places[filled++] = i; }
      A[c + step] = alpha;
      for (let j = step + 1; j < k; j++) {
        const d = order[j] * n;
        let dot = A[d + step];
        for (let l = 0; l < filled; l++) dot += A[c + places[l]] * A[d + places[l]];
        if (dot === 0) continue;
        dot *= this.tau[step];
        A[d + step] -= dot;
        for (let l = 0; l < filled; l++) A[d + places[l]] -= dot * A[c + places[l]];
        // what is left of the length; found anew where rounding would show
        let rest = norms[order[j]] * norms[order[j]] - A[d + step] * A[d + step];
        if (rest < 1e-6) { rest = 0; for (let i = step + 1; i < n; i++) rest += A[d + i] * A[d + i]; }
        norms[order[j]] = Math.sqrt(rest);
      }
    }
    return this;
  }

  reflect(y, step) {
    const n = this.n, A = this.A, c = this.order[step] * n;
    let dot = y[step];
    for (let i = step + 1; i < n; i++) dot += A[c + i] * y[i];
    dot *= this.tau[step];
    y[step] -= dot;
    for (let i = step + 1; i < n; i++) y[i] -= dot * A[c + i];
  }
  timesQt(y) { for (let step = 0; step < this.rank; step++) this.reflect(y, step); }
  timesQ(y) { for (let step = this.rank - 1; step >= 0; step--) this.reflect(y, step); }

  // The first entries c of Q'y for which A'y = right.
  leading(right, c) {
    const n = this.n, A = this.A, order = this.order;
    for (let j = 0; j < this.rank; j++) {
      let sum = right[order[j]] * this.scale[order[j]];
      for (let i = 0; i < j; i++) sum -= A[order[j] * n + i] * c[i];
      c[j] = sum / A[order[j] * n + j];
    }
    return c;
  }

  // y with A'y = right that is nearest to y; both changed in place.
  nearest(y, right) {
    this.timesQt(y);
    this.leading(right, y);
    this.timesQ(y);
    return y;
  }

  // Multipliers x with A x = b for b in the range of A, given Q'b: of dependent rows those of least norm, measured by
  // `sizes` (x'D x).
  multipliers(b, x, sizes) {
    const n = this.n, k = this.k, r = this.rank, A = this.A, order = this.order;
    x.fill(0);
    if (r === k) {
      for (let j = r - 1; j >= 0; j--) {
        let sum = b[j];
        for (let i = j + 1; i < r; i++) sum -= A[order[i] * n + j] * this.work[i];
        this.work[j] = sum / A[order[j] * n + j];
      }
      for (let j = 0; j < r; j++) x[order[j]] = this.work[j] * this.scale[order[j]];
      return x;
    }
    // B = [R1 R2] with columns scaled by their sizes; x = B'(B B')⁻¹ b
    const column = j => order[j] * n;
    const weight = (j) => 1 / (this.scale[order[j]] * Math.sqrt(sizes[order[j]]));
    const G = new Float64Array(r * r), right = Float64Array.from(b.subarray(0, r));
    for (let j = 0; j < k; j++) {
      const w = weight(j) * weight(j), c = column(j), filled = Math.min(j + 1, r);
      for (let i = 0; i < filled; i++) for (let l = 0; l < filled; l++) G[i * r + l] += w * A[c + i] * A[c + l];
    }
    const lu = new LU(r);
    lu.A.set(G);
    lu.factor();
    lu.solve(right);
    for (let j = 0; j < k; j++) {
      let sum = 0;
      const c = column(j), filled = Math.min(j + 1, r);
      for (let i = 0; i < filled; i++) sum += A[c + i] * right[i];
      x[order[j]] = weight(j) * weight(j) * sum * this.scale[order[j]];
    }
    return x;
  }
}

// LU factors of a square matrix, by rows, with partial pivoting.
class LU {
  constructor(n) { this.n = n; this.A = new Float64Array(n * n); this.pivots = new Int32Array(n); this.regular = true; }
  factor() {
    const n = this.n, A = this.A;
    this.regular = true;
    for (let k = 0; k < n; k++) {
      let best = k;
      for (let i = k + 1; i < n; i++) if (Math.abs(A[i * n + k]) > Math.abs(A[best * n + k])) best = i;
      this.pivots[k] = best;
      if (best !== k) for (let j = 0; j < n; j++) { const swap = A[k * n + j]; A[k * n + j] = A[best * n + j]; A[best * n + j] = swap; }
      if (!(Math.abs(A[k * n + k]) > 0)) { this.regular = false; continue; }
      for (let i = k + 1; i < n; i++) {
        const factor = A[i * n + k] / A[k * n + k];
        A[i * n + k] = factor;
        if (factor !== 0) for (let j = k + 1; j < n; j++) A[i * n + j] -= factor * A[k * n + j];
      }
    }
    return this;
  }
  solve(b) {
    const n = this.n, A = this.A;
    for (let k = 0; k < n; k++) {
      const best = this.pivots[k], swap = b[k];
      b[k] = b[best]; b[best] = swap;
    }
    for (let i = 0; i < n; i++) { let sum = b[i]; for (let j = 0; j < i; j++) sum -= A[i * n + j] * b[j]; b[i] = sum; }
    for (let i = n - 1; i >= 0; i--) { let sum = b[i]; for (let j = i + 1; j < n; j++) sum -= A[i * n + j] * b[j]; b[i] = sum / A[i * n + i]; }
    return b;
  }
}

// The same of a complex matrix, real and imaginary parts apart.
class ComplexLU {
  constructor(n) { this.n = n; this.A = new Float64Array(n * n); this.B = new Float64Array(n * n); this.pivots = new Int32Array(n); }
  factor() {
    const n = this.n, A = this.A, B = this.B;
    for (let k = 0; k < n; k++) {
      let best = k, most = -1;
      for (let i = k; i < n; i++) { const size = Math.abs(A[i * n + k]) + Math.abs(B[i * n + k]); if (size > most) { most = size; best = i; } }
      this.pivots[k] = best;
      if (best !== k) for (let j = 0; j < n; j++) for (const M of [A, B]) { const swap = M[k * n + j]; M[k * n + j] = M[best * n + j]; M[best * n + j] = swap; }
      const p = A[k * n + k], q = B[k * n + k], size = p * p + q * q;
      for (let i = k + 1; i < n; i++) {
        const a = A[i * n + k], b = B[i * n + k];
        if (a === 0 && b === 0) continue;
        const f = (a * p + b * q) / size, g = (b * p - a * q) / size;
        A[i * n + k] = f; B[i * n + k] = g;
        for (let j = k + 1; j < n; j++) {
          const c = A[k * n + j], d = B[k * n + j];
          A[i * n + j] -= f * c - g * d;
          B[i * n + j] -= f * d + g * c;
        }
      }
    }
    return this;
  }
  solve(x, y) {
    const n = this.n, A = this.A, B = this.B;
    for (let k = 0; k < n; k++) for (const v of [x, y]) { const swap = v[k]; v[k] = v[this.pivots[k]]; v[this.pivots[k]] = swap; }
    for (let i = 0; i < n; i++) for (let j = 0; j < i; j++) {
      const a = A[i * n + j], b = B[i * n + j];
      x[i] -= a * x[j] - b * y[j];
      y[i] -= a * y[j] + b * x[j];
    }
    for (let i = n - 1; i >= 0; i--) {
      for (let j = i + 1; j < n; j++) {
        const a = A[i * n + j], b = B[i * n + j];
        x[i] -= a * x[j] - b * y[j];
        y[i] -= a * y[j] + b * x[j];
      }
      const p = A[i * n + i], q = B[i * n + i], size = p * p + q * q, re = x[i], im = y[i];
      x[i] = (re * p + im * q) / size;
      y[i] = (im * p - re * q) / size;
    }
  }
}

// Cholesky factor L of a symmetric positive definite matrix, in place, by rows; false if it is none.
function cholesky(A, n) {
  for (let i = 0; i < n; i++) {
    for (let j = 0; j <= i; j++) {
      let sum = A[i * n + j];
      for (let k = 0; k < j; k++) sum -= A[i * n + k] * A[j * n + k];
      if (i === j) { if (!(sum > 0)) return false; A[i * n + i] = Math.sqrt(sum); }
      else A[i * n + j] = sum / A[j * n + j];
    }
  }
  return true;
}
// x = L⁻¹ x for a column that begins at a place, and x = L⁻ᵀ x.
function forward(L, n, x, at) {
  for (let i = 0; i < n; i++) { let sum = x[at + i]; for (let j = 0; j < i; j++) sum -= L[i * n + j] * x[at + j]; x[at + i] = sum / L[i * n + i]; }
}
function backward(L, n, x) {
  for (let i = n - 1; i >= 0; i--) { let sum = x[i]; for (let j = i + 1; j < n; j++) sum -= L[j * n + i] * x[j]; x[i] = sum / L[i * n + i]; }
}

function largest(values) {
  let most = 0;
  for (let i = 0; i < values.length; i++) { const size = Math.abs(values[i]); if (!(size <= most)) most = size; }
  return most;                                              // NaN, if one is
}
