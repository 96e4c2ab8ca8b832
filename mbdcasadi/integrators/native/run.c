/* A run of a method around the equations of a mechanism: its task, its memory, and what every method needs.

   Above this file stand, written by run.py: OPERATIONS, the cases of the interpreter of tapes, the constants of
   stretch.py, and the structures and statuses of shared.py; below it the method itself, with its `mbd_advance`.

   A state is y = (q, v, z, integrals); the integrals take no part in the error test. Nothing is allocated in a step,
   and all that changes belongs to one run: runs in several threads share nothing but the functions. */

/* --- a run ------------------------------------------------------------------------------------------- */

#define ROWS 16

typedef struct {
  const system_t* system;
  integer n, n_x, n_y;
  double* k;                  /* (ROWS, n_y) */
  double *y, *next, *stage, *trial, *scale, *dense, *point, *moved;
  double *u, *lam, *accelerations, *work;
  double* events;             /* three rows of values, and one of times */
  double* sign;
  double passed;              /* when a zero was passed last */
  int across;                 /* whether a tiny step is to go across one */
  double *from, *now;         /* what switches, at the start of a step and at a trial end */
  double *before, *beyond;    /* and at both ends of a bracket of the first zero */
  double hint;                /* least regularity since it was set */
  const stretch_t* task;
  const double* channel;
  integer evaluations;
  /* of an implicit method */
  double *slopes, *matrix;
  int* pivots;
  integer order, equal_steps, slopes_age;
  int is_factorised;
  double convergence, time;
} run_t;

static integer largest(integer a, integer b) { return a > b ? a : b; }

/* fmax(b, a), which compilers call; of NaN and a number the number if it is the second. */
static inline double larger(double a, double b) { return a > b ? a : b; }

void mbd_free(run_t* run) {
  if (run) { free(run->k); free(run->pivots); }
  free(run);
}

run_t* mbd_new(const system_t* system) {
  run_t* run = calloc(1, sizeof(run_t));
  if (!run) return NULL;
  const integer n = system->coordinates, n_x = 2 * n + system->states, n_y = n_x + system->integrals;
  integer work = system->input.work;
  work = largest(work, system->dynamics.work);
  work = largest(work, system->quadrature.work);
  work = largest(work, system->projection.work);
  work = largest(work, system->switching.work);
  work = largest(work, system->event.work);
  work = largest(work, system->slopes.work);
  const integer m = system->slopes.work ? n_x - n : 0;
  const integer size = (ROWS + 7 + 6) * n_y + n_x + system->inputs + system->multipliers + n + work +
                       5 * system->events + 3 + 4 * system->switches + m * (n_x + m);
  double* place = calloc((size_t)size, sizeof(double));
  run->pivots = calloc((size_t)m + 1, sizeof(int));
  if (!place || !run->pivots) { free(place); free(run->pivots); free(run); return NULL; }
  run->system = system;
  run->n = n; run->n_x = n_x; run->n_y = n_y;
  run->k = place; place += ROWS * n_y;
  run->dense = place; place += 7 * n_y;
  run->y = place; place += n_y;
  run->next = place; place += n_y;
  run->stage = place; place += n_y;
  run->trial = place; place += n_y;
  run->scale = place; place += n_y;
  run->point = place; place += n_y;
  run->moved = place; place += n_x;
  run->u = place; place += system->inputs;
  run->lam = place; place += system->multipliers;
  run->accelerations = place; place += n;
  run->events = place; place += 4 * system->events + 3;
  run->sign = place; place += system->events;
  run->slopes = place; place += m * n_x;
  run->matrix = place; place += m * m;
  run->from = place; place += system->switches;
  run->before = place; place += system->switches;
  run->beyond = place; place += system->switches;
  run->now = place; place += system->switches;
  run->work = place;
  return run;
}

/* --- evaluating the equations ------------------------------------------------------------------------ */

static void interpret(const function_t* f, const double** arg, double** res, double* w) {
  const int* i = f->tape;
  const int* end = i + 4 * f->count;
  for (; i < end; i += 4) {
    switch (i[0]) {
      case 0: w[i[1]] = f->constants[i[2]]; break;
      case 1: w[i[1]] = arg[i[2]] ? arg[i[2]][i[3]] : 0.0; break;
      case 2: if (res[i[1]]) res[i[1]][i[3]] = w[i[2]]; break;
      OPERATIONS
    }
  }
}

static void evaluate(const function_t* f, const double** arg, double** res, double* w) {
  if (f->code) f->code(arg, res, NULL, w, 0);
  else interpret(f, arg, res, w);
}

static void find_inputs(run_t* run, double t, const double* x) {
  if (!run->system->inputs) return;
  const stretch_t* task = run->task;
  const double* arg[7] = {&t, x, x + run->n, x + 2 * run->n, task->p, task->levels, run->channel};
  double* res[1] = {run->u};
  evaluate(&run->system->input, arg, res, run->work);
}

static void find_accelerations(run_t* run, double t, const double* x, double* a, double* rates, double* lam) {
  find_inputs(run, t, x);
  double hint = INFINITY;
  const double* arg[6] = {&t, x, x + run->n, x + 2 * run->n, run->u, run->task->p};
  double* res[4] = {a, rates, lam, run->task->fall > 0.0 ? &hint : NULL};
  evaluate(&run->system->dynamics, arg, res, run->work);
  if (hint < run->hint) run->hint = hint;
  ++run->evaluations;
}

/* dy/dt at a state. */
static void find_rate(run_t* run, double t, const double* y, double* rate) {
  const integer n = run->n;
  memcpy(rate, y + n, (size_t)n * sizeof(double));
  find_accelerations(run, t, y, rate + n, rate + 2 * n, run->lam);
  if (run->system->integrals) {
    const double* arg[8] = {&t, y, y + n, rate + n, y + 2 * n, run->lam, run->u, run->task->p};
    double* res[1] = {rate + run->n_x};
    evaluate(&run->system->quadrature, arg, res, run->work);
  }
}

/* Bring a state onto the constraints; 0 if this does not succeed. */
static int project(run_t* run, double t, double* x) {
  if (!run->system->multipliers) return 1;
  const stretch_t* task = run->task;
  const integer n = run->n;
  double before = INFINITY, left = INFINITY, size = 1.0;
  for (int k = 0; k < PROJECTIONS; ++k) {
    const double* arg[6] = {&t, x, x + n, x + 2 * n, task->p, task->weights};
    double* res[3] = {run->moved, run->moved + n, &left};
    evaluate(&run->system->projection, arg, res, run->work);
    if (!isfinite(left)) return 0;
    memcpy(x, run->moved, (size_t)(2 * n) * sizeof(double));
    size = 0.0;
    for (integer i = 0; i < n; ++i) size = larger(fabs(x[i]), size);
    size += 1.0;
    if (left <= task->accuracy * size) return 1;
    if (left >= before / 2) break;
    before = left;
  }
  return left <= LOOSE * size;
}

/* --- steps ------------------------------------------------------------------------------------------- */

static double norm(const run_t* run, const double* x) {
  double sum = 0.0;
  for (integer i = 0; i < run->n_x; ++i) { const double e = x[i] / run->scale[i]; sum += e * e; }
  return sqrt(sum / (double)largest(run->n_x, 1));
}

static double least_step(double t) { return 10.0 * fabs(nextafter(t, INFINITY) - t); }

/* Size of the first step of a method, as in section II.4 of the book; its rate at the start is in the first row. */
static double first_step(run_t* run, const stretch_t* task, double t, double limit, double order) {
  double* k0 = run->k;
  for (integer i = 0; i < run->n_x; ++i) run->scale[i] = task->abstol + fabs(run->y[i]) * task->reltol;
  const double d0 = norm(run, run->y), d1 = norm(run, k0);
  double h0 = d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : 0.01 * d0 / d1;
  h0 = fmin(h0, limit);
  for (integer i = 0; i < run->n_y; ++i) run->stage[i] = run->y[i] + h0 * k0[i];
  find_rate(run, t + h0, run->stage, run->k + run->n_y);
  for (integer i = 0; i < run->n_x; ++i) run->next[i] = run->k[run->n_y + i] - k0[i];
  const double d2 = norm(run, run->next) / h0;
  if (!isfinite(d2)) return fmin(1e-6, limit);
  const double h1 = d1 <= 1e-15 && d2 <= 1e-15 ? fmax(1e-6, h0 * 1e-3) : pow(0.01 / fmax(d1, d2), 1.0 / order);
  return fmin(fmin(100.0 * h0, h1), limit);
}

static void record(run_t* run, stretch_t* task, double t, const double* y, integer index) {
  const integer r = task->recorded++;
  task->out_times[r] = t;
  task->out_index[r] = index;
  memcpy(task->out_x + r * run->n_x, y, (size_t)run->n_x * sizeof(double));
  if (run->system->integrals)
    memcpy(task->out_integrals + r * run->system->integrals, y + run->n_x,
           (size_t)run->system->integrals * sizeof(double));
}

/* Inputs, accelerations and multipliers at states by row. */
void mbd_complete(run_t* run, stretch_t* task, integer count, const double* times, const double* x,
                  const double* channels, double* a, double* lam, double* u) {
  const system_t* s = run->system;
  run->task = task;
  for (integer i = 0; i < count; ++i) {
    const double* row = x + i * run->n_x;
    run->channel = channels + i * task->channel;
    find_accelerations(run, times[i], row, a + i * run->n, run->moved, lam + i * s->multipliers);
    memcpy(u + i * s->inputs, run->u, (size_t)s->inputs * sizeof(double));
  }
}
