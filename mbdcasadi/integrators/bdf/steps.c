/* Backward differentiation formulas of order 1 to 5 for free bodies, on native/run.c, which stands above.

   Newton's iterations are those of (v, z) under the matrix I - c J, reduced to these: q, whose rate is v, satisfies its
   rows at every iterate. The factorisation passes over zeros: what is apart costs little. The slopes J are kept for some
   steps, and found again if iterations do not converge. Integrals are those of the trapezoidal rule over the same steps.

   In backward differences at a quasi-constant step: L. F. Shampine, M. W. Reichelt, The MATLAB ODE suite, SIAM J. Sci.
   Comput. 18 (1997) 1, with kappa = 0, which was the more accurate at equal cost. Sizes and orders of steps are chosen
   as in SciPy's BDF, the iterations ended as in CVODE. */

enum { MOST_ORDER = 5, ITERATIONS = 4, LASTING = 20 };  /* the last: steps for which slopes are kept */
/* Rows of run->k behind the differences. */
enum { RATE = MOST_ORDER + 3, INTEGRAND, NEXT_INTEGRAND, CHANGE, CORRECTION, PREDICTED, HISTORY };

#define SAFETY 0.9         /* share of the estimated size that a step has */
#define WORTHWHILE 1.2     /* growth of the step for which the matrix is factorised again */
#define CONVERGED 0.03     /* correction, in tolerances, that ends the iterations */

/* Sums of 1/k up to an order. */
static const double GAMMA[] = {0.0, 1.0, 1.5, 11.0 / 6.0, 25.0 / 12.0, 137.0 / 60.0};

static double* row(const run_t* run, integer k) { return run->k + k * run->n_y; }
static double error_constant(integer order) { return 1.0 / (double)(order + 1); }

static void set_scale(run_t* run, const stretch_t* task, const double* x) {
  for (integer i = 0; i < run->n_x; ++i) run->scale[i] = task->abstol + task->reltol * fabs(x[i]);
}

static void find_state_rate(run_t* run, double t, const double* x, double* rate) {
  const integer n = run->n;
  memcpy(rate, x + n, (size_t)n * sizeof(double));
  find_accelerations(run, t, x, rate + n, rate + 2 * n, run->lam);
}

static void find_integrand(run_t* run, double t, const double* x, const double* a, double* integrand) {
  if (!run->system->integrals) return;
  const integer n = run->n;
  const double* arg[8] = {&t, x, x + n, a, x + 2 * n, run->lam, run->u, run->task->p};
  double* res[1] = {integrand};
  evaluate(&run->system->quadrature, arg, res, run->work);
}

/* --- linear algebra ---------------------------------------------------------------------------------- */

/* y -= factor x */
static void subtract(double factor, const double* restrict x, double* restrict y, integer count) {
  if (factor == 0.0) return;
  for (integer i = 0; i < count; ++i) y[i] -= factor * x[i];
}

static void find_slopes(run_t* run, double t, const double* x) {
  const integer n = run->n;
  find_inputs(run, t, x);
  const double* arg[8] = {&t, x, x + n, x + 2 * n, run->u, run->task->p, run->task->levels, run->channel};
  double* res[1] = {run->slopes};
  evaluate(&run->system->slopes, arg, res, run->work);
  run->slopes_age = run->is_factorised = 0;
}

/* Factors of the reduced matrix, by columns with pivots; 0 if it is singular. */
CLONES static int factorise(run_t* run, double c) {
  const integer n = run->n, m = run->n_x - n;
  double* a = run->matrix;
  for (integer j = 0; j < m; ++j) {
    const double *by_q = run->slopes + j * m, *by_rest = run->slopes + (n + j) * m;
    double* column = a + j * m;
    for (integer i = 0; i < m; ++i) column[i] = -c * by_rest[i];
    if (j < n) subtract(c * c, by_q, column, m);
    column[j] += 1.0;
  }
  for (integer k = 0; k < m; ++k) {
    double* const column = a + k * m;
    integer best = k;
    for (integer i = k + 1; i < m; ++i)
      if (fabs(column[i]) > fabs(column[best])) best = i;
    run->pivots[k] = (int)best;
    if (best != k)
      for (integer j = 0; j < m; ++j) {
        const double held = a[j * m + k];
        a[j * m + k] = a[j * m + best];
        a[j * m + best] = held;
      }
    if (column[k] == 0.0 || !isfinite(column[k])) return 0;
    for (integer i = k + 1; i < m; ++i) column[i] /= column[k];
    for (integer j = k + 1; j < m; ++j) subtract(a[j * m + k], column + k + 1, a + j * m + k + 1, m - k - 1);
  }
  return 1;
}

/* Solve the reduced equations in place. */
CLONES static void solve(const run_t* run, double* x) {
  const integer m = run->n_x - run->n;
  for (integer k = 0; k < m; ++k) {
    const integer p = run->pivots[k];
    const double held = x[p];
    x[p] = x[k];
    x[k] = held;
  }
  for (integer k = 0; k < m; ++k) subtract(x[k], run->matrix + k * m + k + 1, x + k + 1, m - k - 1);
  for (integer k = m - 1; k >= 0; --k) {
    x[k] /= run->matrix[k * m + k];
    subtract(x[k], run->matrix + k * m, x, k);
  }
}

/* --- steps ------------------------------------------------------------------------------------------- */

/* Change the size of the step: the differences are those of the same polynomial at other distances. */
CLONES static void rescale(run_t* run, stretch_t* task, double factor) {
  const integer order = run->order;
  double r[MOST_ORDER + 1][MOST_ORDER + 1], u[MOST_ORDER + 1][MOST_ORDER + 1], both[MOST_ORDER + 1][MOST_ORDER + 1];
  for (integer j = 0; j <= order; ++j) {
    r[0][j] = u[0][j] = 1.0;
    for (integer i = 1; i <= order; ++i) {
      r[i][j] = j ? r[i - 1][j] * ((double)(i - 1) - factor * (double)j) / (double)i : 0.0;
      u[i][j] = j ? u[i - 1][j] * (double)(i - 1 - j) / (double)i : 0.0;
    }
  }
  for (integer i = 0; i <= order; ++i)
    for (integer j = 0; j <= order; ++j) {
      both[i][j] = 0.0;
      for (integer k = 0; k <= order; ++k) both[i][j] += r[i][k] * u[k][j];
    }
  for (integer i = 0; i < run->n_x; ++i) {
    double old[MOST_ORDER + 1];
    for (integer k = 0; k <= order; ++k) old[k] = row(run, k)[i];
    for (integer j = 0; j <= order; ++j) {
      double sum = 0.0;
      for (integer k = 0; k <= order; ++k) sum += both[k][j] * old[k];
      row(run, j)[i] = sum;
    }
  }
  task->step *= factor;
  run->equal_steps = run->is_factorised = 0;
}

/* Begin at order 1 from run->y; 0 if the equations have no value there. */
static int begin(run_t* run, stretch_t* task, double end) {
  const integer n_x = run->n_x;
  find_state_rate(run, run->time, run->y, run->k);
  for (integer i = 0; i < n_x; ++i)
    if (!isfinite(run->k[i])) return 0;
  find_integrand(run, run->time, run->y, run->k + run->n, row(run, INTEGRAND));
  memcpy(row(run, RATE), run->k, (size_t)n_x * sizeof(double));
  const double h = first_step(run, task, run->time, fmin(task->max_step, end - run->time), 2.0);
  memset(run->k, 0, (size_t)(RATE * run->n_y) * sizeof(double));
  memcpy(row(run, 0), run->y, (size_t)n_x * sizeof(double));
  for (integer i = 0; i < n_x; ++i) row(run, 1)[i] = h * row(run, RATE)[i];
  task->step = h;
  run->order = 1;
  run->slopes_age = LASTING;
  run->equal_steps = run->is_factorised = 0;
  return 1;
}

/* Find the state at the end of a step by Newton's iterations; 0 if they do not converge. */
static int iterate(run_t* run, double t, double c) {
  const integer n = run->n, n_x = run->n_x;
  const double *predicted = row(run, PREDICTED), *history = row(run, HISTORY);
  double *correction = row(run, CORRECTION), *change = row(run, CHANGE), *rate = row(run, RATE), before = 0.0;
  for (integer i = 0; i < n_x; ++i) correction[i] = i < n ? c * predicted[n + i] - history[i] : 0.0;
  for (integer i = 0; i < n_x; ++i) run->next[i] = predicted[i] + correction[i];
  for (int k = 0; k < ITERATIONS; ++k) {
    find_state_rate(run, t, run->next, rate);
    for (integer i = n; i < n_x; ++i) change[i] = c * rate[i] - history[i] - correction[i];
    solve(run, change + n);
    for (integer i = 0; i < n; ++i) change[i] = c * change[n + i];
    const double size = norm(run, change);
    if (!isfinite(size) || (k && size > 2.0 * before)) return 0;
    for (integer i = 0; i < n_x; ++i) {
      correction[i] += change[i];
      run->next[i] = predicted[i] + correction[i];
    }
    if (k) run->convergence = fmax(0.3 * run->convergence, size / before);
    if (size * fmin(1.0, run->convergence) < CONVERGED) return 1;
    before = size;
  }
  return 0;
}

/* The same with the slopes that there are. */
static int converges(run_t* run, double t, double c) {
  if (!run->is_factorised) {
    run->is_factorised = factorise(run, c);
    run->convergence = 1.0;
  }
  return run->is_factorised && iterate(run, t, c);
}

/* Shorten the next step so that it ends at a time, or ends beyond it by rounding alone. */
static void fit(run_t* run, stretch_t* task, double end) {
  const double left = end - run->time, longest = fmin(task->max_step, left), least = least_step(end);
  if (task->step > longest || (task->step > left - least && task->step != left)) {
    rescale(run, task, longest / task->step);
    task->step = longest;
  }
}

/* Predicted state of the next step, and what the formula takes from earlier ones. */
CLONES static void predict(run_t* run) {
  const integer order = run->order;
  for (integer i = 0; i < run->n_x; ++i) {
    double sum = 0.0, weighted = 0.0;
    for (integer k = order; k >= 1; --k) {
      sum += row(run, k)[i];
      weighted += GAMMA[k] * row(run, k)[i];
    }
    row(run, PREDICTED)[i] = row(run, 0)[i] + sum;
    row(run, HISTORY)[i] = weighted / GAMMA[order];
  }
}

/* Take a step of at most the present size, which ends at `end` at the latest. */
static int step_until(run_t* run, stretch_t* task, double end) {
  for (;;) {
    fit(run, task, end);
    if (task->step < fmin(least_step(end), end - run->time)) return TOO_SMALL;
    const integer order = run->order;
    const double t = task->step == end - run->time ? end : run->time + task->step, c = task->step / GAMMA[order];
    predict(run);
    set_scale(run, task, row(run, PREDICTED));
    int found = (run->is_factorised || run->slopes_age < LASTING) && converges(run, t, c);
    if (!found) {
      find_slopes(run, t, row(run, PREDICTED));
      found = converges(run, t, c);
    }
    if (!found) { ++task->rejected; rescale(run, task, 0.5); continue; }
    set_scale(run, task, run->next);
    const double error = error_constant(order) * norm(run, row(run, CORRECTION));
    if (error > 1.0) {
      ++task->rejected;
      rescale(run, task, fmax(LEAST, SAFETY * pow(error, -1.0 / (double)(order + 1))));
      continue;
    }
    double *correction = row(run, CORRECTION), *last = row(run, order + 1), *beyond = row(run, order + 2);
    for (integer i = 0; i < run->n_x; ++i) {
      beyond[i] = correction[i] - last[i];
      last[i] = correction[i];
    }
    for (integer k = order; k >= 0; --k)
      for (integer i = 0; i < run->n_x; ++i) row(run, k)[i] += row(run, k + 1)[i];
    run->time = t;
    ++task->steps;
    ++run->equal_steps;
    ++run->slopes_age;
    return DONE;
  }
}

/* Choose size and order of the next steps after some of equal size. */
static void adapt(run_t* run, stretch_t* task) {
  const integer order = run->order;
  if (run->equal_steps <= order) return;
  double best = 0.0;
  integer chosen = order;
  for (integer k = order - 1; k <= order + 1; ++k) {
    if (k < 1 || k > MOST_ORDER) continue;
    const double error = error_constant(k) * norm(run, row(run, k + 1));
    const double factor = error > 0.0 ? pow(error, -1.0 / (double)(k + 1)) : INFINITY;
    if (factor > best) { best = factor; chosen = k; }
  }
  const double factor = fmin(fmin(MOST, SAFETY * best), task->max_step / task->step);
  if (chosen == order && factor >= 1.0 && factor < WORTHWHILE) return;
  run->order = chosen;
  rescale(run, task, factor);
}

/* State at a time inside the last step. */
static void interpolate(const run_t* run, double step, double t, double* x) {
  double product = 1.0;
  memcpy(x, run->k, (size_t)run->n_x * sizeof(double));
  for (integer k = 0; k < run->order; ++k) {
    product *= (t - (run->time - step * (double)k)) / (step * (double)(k + 1));
    subtract(-product, row(run, k + 1), x, run->n_x);
  }
}

/* Record outputs up to the end of a step that began at a time, and continue the integrals. */
static void record_up_to_now(run_t* run, stretch_t* task, double began) {
  const integer n = run->n, n_x = run->n_x, integrals = run->system->integrals;
  const double h = run->time - began, c = h / GAMMA[run->order];
  double *integral = run->y + n_x, *before = row(run, INTEGRAND), *now = row(run, NEXT_INTEGRAND);
  double* a = row(run, RATE) + n;
  for (integer i = 0; i < n; ++i) a[i] = (row(run, HISTORY)[n + i] + row(run, CORRECTION)[n + i]) / c;
  find_integrand(run, run->time, run->k, a, now);
  while (task->reached < task->count && task->times[task->reached] <= run->time) {
    const double t = task->times[task->reached], s = t - began;
    if (t == run->time) memcpy(run->point, run->k, (size_t)n_x * sizeof(double));
    else interpolate(run, task->step, t, run->point);
    for (integer i = 0; i < integrals; ++i)
      run->point[n_x + i] = integral[i] + s * (before[i] + s / h * (now[i] - before[i]) / 2.0);
    record(run, task, t, run->point, task->reached++);
  }
  for (integer i = 0; i < integrals; ++i) integral[i] += h / 2.0 * (before[i] + now[i]);
  memcpy(before, now, (size_t)integrals * sizeof(double));
  memcpy(run->y, run->k, (size_t)n_x * sizeof(double));
}

/* Integrate over a stretch, or for some steps; the run continues if it ended where the stretch begins. */
int mbd_advance(run_t* run, stretch_t* task) {
  const size_t state = (size_t)run->n_x * sizeof(double);
  if (!(task->step > 0.0 && run->time == task->start && !memcmp(run->y, task->x, state))) run->order = 0;
  run->task = task;
  run->channel = task->channels;
  run->evaluations = 0;
  run->time = task->start;
  task->recorded = task->reached = task->steps = task->rejected = 0;
  task->status = DONE;
  memcpy(run->y, task->x, state);
  memset(run->y + run->n_x, 0, (size_t)run->system->integrals * sizeof(double));
  integer stop = 0;
  while (task->reached < task->count && task->status == DONE) {
    while (stop < task->count - 1 && (stop < task->reached || !task->stops[stop])) ++stop;
    const double end = task->times[stop], from = run->time;
    if (!run->order && !begin(run, task, end)) { task->status = NOT_FINITE; break; }
    task->status = step_until(run, task, end);
    if (task->status != DONE) break;
    record_up_to_now(run, task, from);
    if (run->time == end) {
      run->order = 0;
      if (task->reached < task->count) run->channel = task->channels + task->reached * task->channel;
    } else adapt(run, task);
    if (task->reached == task->count) break;
    if (*task->halt) task->status = HALTED;
    else if (task->most_steps && task->steps >= task->most_steps) task->status = PAUSED;
  }
  if (run->time > task->start && !(task->recorded && task->out_times[task->recorded - 1] >= run->time))
    record(run, task, run->time, run->y, -1);
  task->time = run->time;
  task->evaluations = run->evaluations;
  return task->status;
}
