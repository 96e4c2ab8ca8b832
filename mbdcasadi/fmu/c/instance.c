/* One instance of the mechanism: start, co-simulation, derivatives and values; the same for every version of FMI.

   This file is compiled after model.h, which is written for the mechanism, and engine.c, the integrator.

   A state is x = (q, v, z). All that changes in the course of a simulation is one block of doubles, so that a saved
   state is a copy of it. */

/* Places of single numbers in the block. */
enum {
  IDENTITY,      /* of the model, so that no saved state of another one is taken */
  TIME, START_TIME, STOP_TIME, RELTOL, MODE,
  IS_UNSETTLED,  /* parameters changed, and the state is not on the constraints yet */
  IS_AHEAD,      /* the integrator is ahead of the communication point, between these times: */
  AHEAD_BEGIN, AHEAD_END,
  STEP,          /* size of the next step of the integrator */
  LAST_STEP, LAST_GAIN, /* of its last step, or 0 */
  IS_ACROSS,     /* that is a tiny one across a zero of what switches */
  PASSED,        /* time at which such a zero was passed last */
  EIGENVALUE,    /* size of the largest one of late */
  SHORT_STEP, SHORT_FROM, SHORT_UNTIL, /* longest step between these times: the force of a contact is followed */
  SCALARS
};

#define N_X (2 * N_COORDINATES + N_STATES)
#define N_LEVELS (2 * N_INPUTS + 1)
#define BLOCK (SCALARS + 10 * N_X + N_PARAMETERS + N_LEVELS)
#define LENGTH(n) ((n) > 0 ? (n) : 1)
/* Halvings of a step in which a gap closes; looks that are kept, and the length of one. */
#define HALVINGS 60
#define LOOKS (N_GAPS ? HALVINGS + 2 : 0)
#define LOOK (4 * N_GAPS)
/* Rows that the integrator may return. */
#define ROWS_OUT (MOST_SAMPLES + 64)
/* Steps of Newton's method, and of the parameters on their way from the values at the export. */
#define NEWTON_STEPS 50
#define NEAREST_STEPS 300
#define PARAMETER_STEPS 16
#define MET 1e-11
#define NEARLY_MET 1e-8

struct instance {
  double* block;
  double *x, *p, *levels;                 /* in the block */
  double *start, *finish, *dense;         /* ends and dense output of the step that is ahead, in the block */
  system_t system;
  run_t* run;
  stretch_t task;
  int halt;
  double *times_out, *x_out;
  integer* index_out;
  double *a, *zdot, *lam, *y, *xdot, *work, *scratch, *switches, *looks;
  int has_outputs, has_derivatives;       /* true if y, xdot belong to the present state */
  char* warned;
  report_t report;
  void* host;
};

static void changed(instance* s) { s->has_outputs = s->has_derivatives = 0; }

static void turned(instance* s) {
  changed(s);
  s->block[IS_AHEAD] = s->block[IS_ACROSS] = s->block[LAST_STEP] = 0.0;
  s->block[PASSED] = -INFINITY;
}

/* --- functions of the equations that are not one tape -------------------------------------------------- */

/* Inputs are straight lines in time: levels, slopes, and the time from which these count. */
static int find_levels(const double** arg, double** res, long long int* iw, double* w, int mem) {
  (void)iw; (void)w; (void)mem;
  for (int i = 0; i < N_INPUTS; ++i) res[0][i] = arg[5][i] + arg[5][N_INPUTS + i] * (arg[0][0] - arg[5][2 * N_INPUTS]);
  return 0;
}

/* --- life ---------------------------------------------------------------------------------------------- */

static void reset(instance* s) {
  memset(s->block, 0, sizeof(double) * BLOCK);
  s->block[IDENTITY] = MODEL_IDENTITY;
  s->block[TIME] = s->block[START_TIME] = START_AT;
  s->block[STOP_TIME] = INFINITY;
  s->block[RELTOL] = DEFAULT_RELTOL;
  s->block[IS_UNSETTLED] = 1.0;
  memcpy(s->x, START_X, sizeof(double) * N_X);
  memcpy(s->p, START_P, sizeof(double) * N_PARAMETERS);
  memcpy(s->levels, START_U, sizeof(double) * N_INPUTS);
  if (N_VALIDITY) memset(s->warned, 0, N_VALIDITY);
  turned(s);
}

/* Take the tolerance and the times of an experiment. */
static void set_experiment(instance* s, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
  if (has_tolerance && tolerance > 0.0) s->block[RELTOL] = tolerance;
  s->block[START_TIME] = s->block[TIME] = start;
  s->block[STOP_TIME] = has_stop ? stop : INFINITY;
  s->block[IS_UNSETTLED] = 1.0;
}

static void dismiss(instance* s) {
  if (!s) return;
  mbd_free(s->run);
  free(s->block);
  free(s->times_out);
  free(s->index_out);
  free(s->warned);
  free(s);
}

static instance* create(report_t report, void* host) {
  instance* s = calloc(1, sizeof(instance));
  if (!s) return NULL;
  s->report = report;
  s->host = host;
  const size_t values = 2 * N_COORDINATES + 2 * N_STATES + 2 * N_MULTIPLIERS + 3 * N_OUTPUTS + 8 * N_X + 2 * N_PARAMETERS +
                        2 * N_INPUTS + N_CHECKS + N_VALIDITY + N_FORCES + 3 * N_INDICATORS + LOOKS * LOOK + 2 * WORK_LARGEST + 16;
  s->block = calloc(BLOCK + values, sizeof(double));
  s->times_out = calloc(ROWS_OUT * (1 + (size_t)N_X), sizeof(double));
  s->index_out = calloc(ROWS_OUT, sizeof(integer));
  s->warned = calloc(LENGTH(N_VALIDITY), 1);
  if (!s->block || !s->times_out || !s->index_out || !s->warned) { dismiss(s); return NULL; }
  double* place = s->block + SCALARS;
  s->x = place; place += N_X;
  s->start = place; place += N_X;
  s->finish = place; place += N_X;
  s->dense = place; place += 7 * N_X;
  s->p = place; place += N_PARAMETERS;
  s->levels = place; place += N_LEVELS;
  s->a = place; place += N_COORDINATES;
  s->zdot = place; place += N_STATES;
  s->lam = place; place += N_MULTIPLIERS;
  s->y = place; place += N_OUTPUTS;
  s->xdot = place; place += N_X;
  s->switches = place; place += 3 * N_INDICATORS;
  s->looks = place; place += LOOKS * LOOK;
  s->work = place; place += WORK_LARGEST + 8;
  s->scratch = place;
  s->x_out = s->times_out + ROWS_OUT;
  s->system.coordinates = N_COORDINATES;
  s->system.states = N_STATES;
  s->system.multipliers = N_MULTIPLIERS;
  s->system.inputs = N_INPUTS;
  s->system.switches = N_SWITCHES;
  s->system.input.code = find_levels;
  s->system.dynamics.code = dynamics;
  s->system.dynamics.work = WORK_dynamics;
  s->system.projection.code = projection;
  s->system.projection.work = WORK_projection;
  s->system.switching.code = switching;
  s->system.switching.work = WORK_switching;
  s->run = mbd_new(&s->system);
  if (!s->run) { dismiss(s); return NULL; }
  s->task.p = s->p;
  s->task.levels = s->levels;
  s->task.weights = PROJECTION_WEIGHTS;
  s->task.accuracy = ACCURACY;
  s->task.halt = &s->halt;
  s->task.out_times = s->times_out;
  s->task.out_x = s->x_out;
  s->task.out_index = s->index_out;
  s->task.spacing = INFINITY;
  s->run->task = &s->task;
  reset(s);
  return s;
}

/* --- the start ------------------------------------------------------------------------------------------ */

/* Newton's method: `function(known) -> (unknown, residual)`; 0 if the rows are not met. */
static int newton_steps(code_t function, const double** known, int place, double* unknown, int count, int steps,
                        double* work, double* next) {
  double before = INFINITY, left = INFINITY;
  for (int k = 0; k < steps; ++k) {
    double* res[2] = {next, &left};
    known[place] = unknown;
    function(known, res, NULL, work, 0);
    if (!isfinite(left)) return 0;
    if (left <= MET || (left <= NEARLY_MET && left >= before / 2)) return 1;
    for (int i = 0; i < count; ++i)
      if (!isfinite(next[i])) return 0;
    memcpy(unknown, next, sizeof(double) * (size_t)count);
    before = left;
  }
  return left <= NEARLY_MET;
}

/* The nearest to an estimate of all that meet the rows, from one of them; what meets them is left if this fails. */
static void nearest_steps(code_t function, const double** known, int place, int estimate, const double* wanted,
                          double* unknown, int count, double* work, double* next, double* kept) {
  double before = INFINITY;
  memcpy(kept, unknown, sizeof(double) * (size_t)count);
  for (int k = 0; k < NEAREST_STEPS; ++k) {
    double left = INFINITY, change = 0.0, size = 1.0, *res[2] = {next, &left};
    known[place] = unknown;
    known[estimate] = wanted;
    function(known, res, NULL, work, 0);
    for (int i = 0; i < count; ++i) {
      change = fmax(change, fabs(next[i] - unknown[i]));
      size = fmax(size, fabs(next[i]));
    }
    if (!isfinite(change)) break;
    memcpy(unknown, next, sizeof(double) * (size_t)count);
    if (change <= 1e-13 * size || (change <= 1e-9 * size && change >= before)) {
      known[estimate] = unknown;
      if (newton_steps(function, known, place, unknown, count, NEWTON_STEPS, work, next)) return;
      break;
    }
    before = change;
  }
  memcpy(unknown, kept, sizeof(double) * (size_t)count);
}

/* The consistent state at the start; 0 if there is none. */
static int find_start(instance* s) {
  double *q = s->x, *v = q + N_COORDINATES, *z = v + N_COORDINATES, *t = &s->block[START_TIME];
  double *p = s->scratch, *next = p + N_PARAMETERS, *kept = next + N_X, *work = kept + N_X;
  int moved = *t != START_AT, i, k;
  memcpy(s->x, START_X, sizeof(double) * N_X);
  for (i = 0; i < N_PARAMETERS; ++i) moved |= s->p[i] != START_P[i];
  if (!moved) return 1;
  for (k = 1; k <= PARAMETER_STEPS; ++k) {
    const double part = (double)k / PARAMETER_STEPS;
    for (i = 0; i < N_PARAMETERS; ++i) p[i] = k < PARAMETER_STEPS ? START_P[i] + part * (s->p[i] - START_P[i]) : s->p[i];
    if (N_STATES) {
      const double* known[3] = {t, z, p};
      if (!newton_steps(start_states, known, 1, z, N_STATES, NEWTON_STEPS, work, next)) return 0;
    }
    const double* known[5] = {t, q, z, p, q};
    if (!newton_steps(start_pose, known, 1, q, N_COORDINATES, NEWTON_STEPS, work, next)) return 0;
  }
  if (POSE_IS_NEAREST) {
    const double* known[5] = {t, q, z, p, ESTIMATE};
    nearest_steps(start_pose, known, 1, 4, ESTIMATE, q, N_COORDINATES, work, next, kept);
  }
  const double* known[6] = {t, q, v, z, p, v};
  if (!newton_steps(start_velocity, known, 2, v, N_COORDINATES, NEWTON_STEPS, work, next)) return 0;
  if (VELOCITY_IS_NEAREST)
    nearest_steps(start_velocity, known, 2, 5, ESTIMATE + N_COORDINATES, v, N_COORDINATES, work, next, kept);
  return 1;
}

/* Bring the state onto the constraints after a change of parameters. */
static int settle(instance* s) {
  if (s->block[IS_UNSETTLED] == 0.0) return OK_;
  if (N_CHECKS) {
    const double* arg[1] = {s->p};
    double* res[1] = {s->scratch};
    checks(arg, res, NULL, s->scratch + N_CHECKS, 0);
    for (int i = 0; i < N_CHECKS; ++i)
      if (!(CHECK_IS_STRICT[i] ? s->scratch[i] > 0.0 : s->scratch[i] >= 0.0)) {
        say(s, ERROR_, "%s", CHECK_MESSAGES[i]);
        return ERROR_;
      }
  }
  turned(s);
  const int early = s->block[MODE] <= INITIALIZING;
  if (early ? !find_start(s) : !project(s->run, s->block[TIME], s->x)) {
    say(s, ERROR_, "the mechanism cannot be assembled at t = %.6g s with these values of the parameters", s->block[TIME]);
    return ERROR_;
  }
  if (early) s->block[TIME] = s->block[START_TIME];
  s->block[IS_UNSETTLED] = 0.0;
  return OK_;
}

/* --- values -------------------------------------------------------------------------------------------- */

/* Name the force that has no finite value. */
static void blame(instance* s, int status) {
  const double *q = s->x, *v = q + N_COORDINATES, *z = v + N_COORDINATES;
  memset(s->a, 0, sizeof(double) * N_COORDINATES);
  if (N_FORCES) {
    memset(s->lam, 0, sizeof(double) * N_MULTIPLIERS);
    const double* arg[8] = {&s->block[TIME], q, v, s->a, z, s->lam, s->run->u, s->p};
    double* res[1] = {s->scratch};
    element_forces(arg, res, NULL, s->scratch + N_FORCES, 0);
    for (int i = 0; i < N_FORCES; ++i)
      if (!isfinite(s->scratch[i])) {
        say(s, status, "the force of %s is not finite at t = %.6g s: data evaluated outside their range, a division by zero, or a root "
            "of a negative number", FORCE_OWNERS[i], s->block[TIME]);
        return;
      }
  }
  say(s, status, "accelerations and reactions are not finite at t = %.6g s: the pose is singular, or data are evaluated outside their range",
      s->block[TIME]);
}

static void find_outputs(instance* s) {
  const double *q = s->x, *v = q + N_COORDINATES, *z = v + N_COORDINATES;
  find_accelerations(s->run, s->block[TIME], s->x, s->a, s->zdot, s->lam);
  const double* arg[8] = {&s->block[TIME], q, v, s->a, z, s->lam, s->run->u, s->p};
  double* res[1] = {s->y};
  if (N_OUTPUTS) outputs(arg, res, NULL, s->work, 0);
}

/* Warn of elements outside their range of validity, each once. */
static void check_validity(instance* s) {
  if (!N_VALIDITY) return;
  const double *q = s->x, *v = q + N_COORDINATES, *z = v + N_COORDINATES;
  const double* arg[8] = {&s->block[TIME], q, v, s->a, z, s->lam, s->run->u, s->p};
  double* res[1] = {s->scratch};
  validity(arg, res, NULL, s->scratch + N_VALIDITY, 0);
  for (int i = 0; i < N_VALIDITY; ++i)
    if (!s->warned[i] && s->scratch[i] < -1e-6 * (1.0 + fabs(s->scratch[i]))) {
      s->warned[i] = 1;
      say(s, WARNING_, "%s (first at t = %.6g s)", VALIDITY_MESSAGES[i], s->block[TIME]);
    }
}

static int update_outputs(instance* s) {
  const int status = settle(s);
  if (status != OK_ || s->has_outputs) return status;
  find_outputs(s);
  for (int i = 0; i < N_OUTPUTS; ++i)
    if (!isfinite(s->y[i])) { blame(s, DISCARD_); return DISCARD_; }
  s->has_outputs = 1;
  check_validity(s);
  return OK_;
}

/* (v, a, rate of z), with the drift from the constraints held. */
static int update_derivatives(instance* s) {
  const int status = settle(s);
  if (status != OK_ || s->has_derivatives) return status;
  double *q = s->x, *v = q + N_COORDINATES;
  memcpy(s->xdot, v, sizeof(double) * N_COORDINATES);
  find_accelerations(s->run, s->block[TIME], s->x, s->xdot + N_COORDINATES, s->xdot + 2 * N_COORDINATES, s->lam);
  if (N_MULTIPLIERS) {
    double left, *res[3] = {s->scratch, s->scratch + N_COORDINATES, &left};
    const double* arg[6] = {&s->block[TIME], q, v, v + N_COORDINATES, s->p, PROJECTION_WEIGHTS};
    projection(arg, res, NULL, s->scratch + 2 * N_COORDINATES, 0);
    for (int i = 0; i < 2 * N_COORDINATES; ++i) s->xdot[i] += DRIFT_RATE * (s->scratch[i] - s->x[i]);
  }
  for (int i = 0; i < N_X; ++i)
    if (!isfinite(s->xdot[i])) { blame(s, DISCARD_); return DISCARD_; }
  s->has_derivatives = 1;
  return OK_;
}

static void find_indicators(instance* s, double t, const double* x, double* values) {
  const double* arg[5] = {&t, x, x + N_COORDINATES, x + 2 * N_COORDINATES, s->p};
  double* res[1] = {values};
  if (N_INDICATORS) indicators(arg, res, NULL, s->work, 0);
}

/* Directional derivatives of (rates of x, outputs) along (x, inputs, parameters). */
static int find_tangent(instance* s, const double* dx, const double* du, const double* dp, double* dxdot, double* dy) {
  const int status = settle(s);
  if (status != OK_) return status;
  const double *q = s->x, *v = q + N_COORDINATES, *z = v + N_COORDINATES;
  find_accelerations(s->run, s->block[TIME], s->x, s->a, s->zdot, s->lam);
  const double* arg[13] = {&s->block[TIME], q, v, s->a, z, s->lam, s->run->u, s->p,
                           dx, dx + N_COORDINATES, dx + 2 * N_COORDINATES, du, dp};
  double* res[2] = {dxdot, dy};
  tangent(arg, res, NULL, s->work, 0);
  changed(s);
  return OK_;
}

/* Value references: time, inputs, parameters, outputs, states, their rates, indicators; in this order. */
#define FIRST_INPUT 1
#define FIRST_PARAMETER (FIRST_INPUT + N_SHOWN_INPUTS)
#define FIRST_OUTPUT (FIRST_PARAMETER + N_SHOWN_PARAMETERS)
#define FIRST_STATE (FIRST_OUTPUT + N_OUTPUTS)
#define FIRST_RATE (FIRST_STATE + N_X)
#define FIRST_INDICATOR (FIRST_RATE + N_X)
#define REFERENCES (FIRST_INDICATOR + N_INDICATORS)

static int get_value(instance* s, unsigned reference, double* value) {
  int status = OK_;
  if (reference < FIRST_INPUT) *value = s->block[TIME];
  else if (reference < FIRST_PARAMETER) *value = s->levels[INPUT_PLACES[reference - FIRST_INPUT]];
  else if (reference < FIRST_OUTPUT) *value = s->p[PARAMETER_PLACES[reference - FIRST_PARAMETER]];
  else if (reference < FIRST_STATE) { status = update_outputs(s); *value = s->y[reference - FIRST_OUTPUT]; }
  else if (reference < FIRST_RATE) { status = settle(s); *value = s->x[reference - FIRST_STATE]; }
  else if (reference < FIRST_INDICATOR) { status = update_derivatives(s); *value = s->xdot[reference - FIRST_RATE]; }
  else if (reference < REFERENCES) {
    status = settle(s);
    find_indicators(s, s->block[TIME], s->x, s->switches);
    *value = s->switches[reference - FIRST_INDICATOR];
  } else {
    say(s, ERROR_, "there is no variable with the value reference %u", reference);
    status = ERROR_;
  }
  return status;
}

static int get_values(instance* s, const unsigned* references, size_t count, double* values) {
  int status = OK_;
  for (size_t i = 0; i < count && status == OK_; ++i) status = get_value(s, references[i], &values[i]);
  return status;
}

/* The slopes of all inputs count from one time. */
static void count_slopes_from_now(instance* s) {
  const double since = s->block[TIME] - s->levels[2 * N_INPUTS];
  for (int i = 0; i < N_INPUTS; ++i) s->levels[i] += since * s->levels[N_INPUTS + i];
  s->levels[2 * N_INPUTS] = s->block[TIME];
}

static int set_value(instance* s, unsigned reference, double value) {
  if (reference < FIRST_INPUT || reference >= REFERENCES) {
    say(s, ERROR_, "there is no variable with the value reference %u that can be set", reference);
    return ERROR_;
  }
  if (!isfinite(value)) {
    say(s, ERROR_, "the value of %s must be finite, got %g", NAMES[reference], value);
    return ERROR_;
  }
  if (reference < FIRST_PARAMETER) {
    const int k = INPUT_PLACES[reference - FIRST_INPUT];
    if (s->levels[k] == value && s->levels[N_INPUTS + k] == 0.0) return OK_;
    count_slopes_from_now(s);
    s->levels[k] = value;
    s->levels[N_INPUTS + k] = 0.0;
    turned(s);
    return OK_;
  }
  if (reference < FIRST_OUTPUT) {
    const int k = PARAMETER_PLACES[reference - FIRST_PARAMETER];
    if (s->block[MODE] == CONTINUOUS) {
      say(s, ERROR_, "the parameter %s can be changed only at events", NAMES[reference]);
      return ERROR_;
    }
    if (s->p[k] == value) return OK_;
    s->p[k] = value;
    s->block[IS_UNSETTLED] = 1.0;
    turned(s);
    return OK_;
  }
  if (reference >= FIRST_STATE && reference < FIRST_RATE && s->block[MODE] >= EVENT_MODE) {
    s->x[reference - FIRST_STATE] = value;
    turned(s);
    return OK_;
  }
  say(s, ERROR_, "%s is calculated and cannot be set", NAMES[reference]);
  return ERROR_;
}

static int set_values(instance* s, const unsigned* references, size_t count, const double* values) {
  int status = OK_;
  for (size_t i = 0; i < count && status == OK_; ++i) status = set_value(s, references[i], values[i]);
  return status;
}

/* Seeds by value reference, and the derivatives along them. */
static int derivative_along(instance* s, const unsigned* unknown, size_t unknowns, const unsigned* known, size_t knowns,
                            const double* seed, double* result) {
  double *dx = s->scratch, *du = dx + N_X, *dp = du + N_INPUTS, *dxdot = dp + N_PARAMETERS, *dy = dxdot + N_X;
  memset(dx, 0, sizeof(double) * (2 * N_X + N_INPUTS + N_PARAMETERS + N_OUTPUTS));
  for (size_t i = 0; i < knowns; ++i) {
    const unsigned r = known[i];
    if (r >= FIRST_INPUT && r < FIRST_PARAMETER) du[INPUT_PLACES[r - FIRST_INPUT]] = seed[i];
    else if (r >= FIRST_PARAMETER && r < FIRST_OUTPUT) dp[PARAMETER_PLACES[r - FIRST_PARAMETER]] = seed[i];
    else if (r >= FIRST_STATE && r < FIRST_RATE) dx[r - FIRST_STATE] = seed[i];
    else {
      say(s, ERROR_, "derivatives by %s are not available: take inputs, parameters and states",
          r < REFERENCES ? NAMES[r] : "an unknown variable");
      return ERROR_;
    }
  }
  const int status = find_tangent(s, dx, du, dp, dxdot, dy);
  if (status != OK_) return status;
  for (size_t i = 0; i < unknowns; ++i) {
    const unsigned r = unknown[i];
    if (r >= FIRST_OUTPUT && r < FIRST_STATE) result[i] = dy[r - FIRST_OUTPUT];
    else if (r >= FIRST_RATE && r < FIRST_INDICATOR) result[i] = dxdot[r - FIRST_RATE];
    else {
      say(s, ERROR_, "derivatives of %s are not available: take outputs and rates of states",
          r < REFERENCES ? NAMES[r] : "an unknown variable");
      return ERROR_;
    }
  }
  return OK_;
}
