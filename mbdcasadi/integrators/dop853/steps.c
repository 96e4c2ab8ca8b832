/* A whole run of an explicit Runge-Kutta method of order 8(5,3), on native/run.c, which stands above.

   Above this file stand too, written by coefficients.py: the coefficients (NODES, combine_1 ... combine_11,
   combine_step, combine_fifth, combine_third, combine_13 ... combine_15, combine_dense_3 ... combine_dense_6), and the
   constants of constants.py. Every accepted step is projected onto the constraints at position and velocity level.

   E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., Springer 1993,
   sections II.5, II.6 and (test for stiffness) IV.2 of the second volume. */

/* --- what is looked at ------------------------------------------------------------------------------- */

static void find_events(run_t* run, double t, const double* x, double* values) {
  const system_t* s = run->system;
  if (s->event_needs_dynamics) find_accelerations(run, t, x, run->accelerations, run->moved, run->lam);
  const double* arg[8] = {&t, x, x + run->n, run->accelerations, x + 2 * run->n, run->lam, run->u, run->task->p};
  double* res[1] = {values};
  evaluate(&s->event, arg, res, run->work);
}

static void find_switches(run_t* run, double t, const double* x, double* values) {
  const double* arg[5] = {&t, x, x + run->n, x + 2 * run->n, run->task->p};
  double* res[1] = {values};
  evaluate(&run->system->switching, arg, res, run->work);
}

/* --- one step ---------------------------------------------------------------------------------------- */

/* Error of stages that no estimate contains: 2 to 5, and those of the dense output once there are `stages` in all. A
   contact that closes as a long step begins may throw all later stages out of it, and these agree. Above 1 if the rates
   there depart from that at the start OUTLIERS times further than those of the others do. */
static double error_of_outliers(const run_t* run, double h, integer stages) {
  const integer n = run->n_y;
  const double* k = run->k;
  double early = 0.0, late = 0.0;
  for (integer s = 1; s < stages; ++s) {
    double sum = 0.0;
    for (integer i = 0; i < run->n_x; ++i) {
      const double change = (k[s * n + i] - k[i]) / run->scale[i];
      sum += change * change;
    }
    if (s < 5 || s > 12) early = fmax(early, sum); else late = fmax(late, sum);
  }
  const double part = h / sqrt((double)largest(run->n_x, 1));
  return part * sqrt(early) / (1.0 + OUTLIERS * part * sqrt(late));
}

/* The stages of a step from run->y to run->next, not projected; its error relative to the tolerances. */
static double attempt(run_t* run, const stretch_t* task, double t, double h) {
  const integer n = run->n_y;
  double* k = run->k;
#define STAGE(s) combine_##s(n, h, run->y, k, run->stage); find_rate(run, t + NODES[s] * h, run->stage, k + s * n);
  STAGE(1) STAGE(2) STAGE(3) STAGE(4) STAGE(5) STAGE(6) STAGE(7) STAGE(8) STAGE(9) STAGE(10) STAGE(11)
#undef STAGE
  combine_step(n, h, run->y, k, run->next);
  for (integer i = 0; i < run->n_x; ++i)
    run->scale[i] = task->abstol + larger(fabs(run->next[i]), fabs(run->y[i])) * task->reltol;
  combine_fifth(run->n_x, n, k, run->trial);
  double fifth = norm(run, run->trial);
  combine_third(run->n_x, n, k, run->trial);
  double third = norm(run, run->trial);
  fifth *= fifth;
  third *= third;
  const double early = run->system->switches ? error_of_outliers(run, h, 12) : 0.0, least = early > 1.0 ? early : 0.0;
  if (fifth == 0.0 && third == 0.0) return least;
  return larger(fabs(h) * fifth / sqrt(fifth + 0.01 * third), least);
}

/* The end of a step on the constraints, and the rate there; 0 if it must be repeated. */
static int arrive(run_t* run, double t) {
  memcpy(run->trial, run->next, (size_t)run->n_y * sizeof(double));
  if (run->system->multipliers) {
    if (!project(run, t, run->next)) return 0;
    for (integer i = 0; i < run->n_x; ++i) {
      const double moved = fabs(run->next[i] - run->trial[i]);
      run->point[i] = moved > SLIGHT * (1.0 + fabs(run->next[i])) ? moved : 0.0;
    }
    if (!(norm(run, run->point) <= DRIFT)) return 0;
  }
  double* rate = run->k + 12 * run->n_y;
  find_rate(run, t, run->next, rate);
  for (integer i = 0; i < run->n_x; ++i)
    if (!isfinite(rate[i])) return 0;
  return 1;
}

/* |lambda| in the last step, by the two last stages, which are at the same time; 0 if they hardly differ. */
static double eigenvalue(const run_t* run) {
  const double *late = run->k + 12 * run->n_y, *early = run->k + 11 * run->n_y;
  double change = 0.0, distance = 0.0;
  for (integer i = 0; i < run->n_x; ++i) {
    const double a = (late[i] - early[i]) / run->scale[i], b = (run->next[i] - run->stage[i]) / run->scale[i];
    change += a * a;
    distance += b * b;
  }
  return distance > QUIET * QUIET * (double)run->n_x ? sqrt(change / distance) : 0.0;
}

/* Coefficients of the dense output of the last step. */
static void prepare_dense(run_t* run, double t, double h) {
  const integer n = run->n_y;
  double *k = run->k, *f = run->dense;
  combine_13(n, h, run->y, k, run->stage); find_rate(run, t + NODES[13] * h, run->stage, k + 13 * n);
  combine_14(n, h, run->y, k, run->stage); find_rate(run, t + NODES[14] * h, run->stage, k + 14 * n);
  combine_15(n, h, run->y, k, run->stage); find_rate(run, t + NODES[15] * h, run->stage, k + 15 * n);
  for (integer i = 0; i < n; ++i) {
    const double change = run->next[i] - run->y[i], begin = h * k[i], end = h * k[12 * n + i];
    f[i] = change;
    f[n + i] = begin - change;
    f[2 * n + i] = 2.0 * change - (end + begin);
  }
  combine_dense_3(n, h, k, f + 3 * n);
  combine_dense_4(n, h, k, f + 4 * n);
  combine_dense_5(n, h, k, f + 5 * n);
  combine_dense_6(n, h, k, f + 6 * n);
}

static void dense_output(const double* begin, const double* f, integer n, double s, double* y) {
  const double r = 1.0 - s;
  for (integer i = 0; i < n; ++i)
    y[i] = begin[i] +
           s * (f[i] +
                r * (f[n + i] +
                     s * (f[2 * n + i] +
                          r * (f[3 * n + i] + s * (f[4 * n + i] + r * (f[5 * n + i] + s * f[6 * n + i]))))));
}

/* --- switches ---------------------------------------------------------------------------------------- */

/* Across a zero of these quantities the equations, or their derivatives, jump, which the estimate of the error does
   not show. A step that passes one and is not exact there is shortened until it ends just before the zero, and a tiny
   one goes across. */

typedef struct {
  double low, high;            /* lengths of a step that ends before the first zero, and of one that passes it; or 0 */
  double left;                 /* from where it ends to the zero, if that is near; else 0 */
  int trials;
} bracket_t;

/* Part of the way between two ends at which the first quantity is zero that changes its sign; infinite if none does. */
static double first_zero(const run_t* run, const double* from, const double* to) {
  double size = 1.0, first = INFINITY;
  for (integer i = 0; i < run->n_x; ++i) size = larger(fabs(run->y[i]), size);
  for (integer i = 0; i < run->system->switches; ++i) {
    if (!(fmin(fabs(from[i]), fabs(to[i])) > SAME_SIDE * size) || (from[i] > 0.0) == (to[i] > 0.0)) continue;
    first = fmin(first, from[i] / (from[i] - to[i]));
  }
  return first;
}

/* Length with which a step is to be tried again, as it passes a zero, or ends far before it; 0 if it may stay. */
static double length_to_switch(run_t* run, double t, double h, double* error, bracket_t* at) {
  const size_t bytes = (size_t)run->system->switches * sizeof(double);
  if (!bytes || !isfinite(*error)) return 0.0;
  find_switches(run, t + h, run->next, run->now);
  const int passes = first_zero(run, run->from, run->now) <= 1.0;
  if (passes || t - run->passed < h) *error *= DOUBT;
  if (passes ? run->across && *error < 1.0 : at->high == 0.0) return 0.0;
  if (!passes && *error >= 1.0) {   /* not the switch limits the step */
    at->low = at->high = 0.0;
    memcpy(run->before, run->from, bytes);
    return 0.0;
  }
  if (++at->trials > SEARCHES) return 0.0;
  memcpy(passes ? run->beyond : run->before, run->now, bytes);
  if (passes) at->high = h; else at->low = h;
  const double between = at->high - at->low, left = first_zero(run, run->before, run->beyond) * between;
  if (!passes && (left <= NEARLY * h || left > between)) {   /* near to the zero, or there by rounding */
    at->left = 2.0 * fmin(left, NEARLY * h);
    return 0.0;
  }
  if (left > between) return at->low;   /* a step of this length ends at the zero, up to rounding */
  return at->low + (at->trials % 3 ? left * (1.0 - BEFORE) : between / 2.0);
}

static int sign_of(double x) { return x > 0.0 ? 1 : x < 0.0 ? -1 : 0; }

/* True if a parabola through three values of one sign comes near to zero between them. */
static int may_touch(double t0, double f0, double t1, double f1, double t2, double f2) {
  if (f0 == 0.0 || sign_of(f0) != sign_of(f1) || sign_of(f1) != sign_of(f2)) return 0;
  const double h0 = t1 - t0, h1 = t2 - t1, bend = ((f2 - f1) / h1 - (f1 - f0) / h0) / (h1 + h0);
  for (int second = 0; second < 2; ++second) {
    const double g0 = second ? f1 : f0, g1 = second ? f2 : f1, length = second ? h1 : h0;
    const double rise = (g1 - g0) / length - bend * length, place = -rise / (2.0 * bend);
    if (!(place > 0.0 && place < length)) continue;
    const double extreme = g0 + rise * place / 2.0;
    if (extreme * sign_of(g0) < TOUCHES * (fabs(g1 - g0) + fabs(bend) * length * length)) return 1;
  }
  return 0;
}

/* Look at new values of the events: 1 where one may take place between the last two, 2 where it decides. */
static int look(run_t* run, const stretch_t* task, double t, integer known) {
  const integer n = run->system->events;
  double *oldest = run->events, *last = oldest + n, *values = last + n, *times = values + n;
  int found = 0;
  times[2] = t;
  for (integer i = 0; i < n; ++i) {
    const double value = values[i] - task->offset[i];
    if (isnan(value)) continue;
    const int now = task->band[i] > 0.0 && fabs(value) <= task->band[i] ? (int)run->sign[i] : sign_of(value);
    const int crossed = now != (int)run->sign[i] && run->sign[i] != 0.0;
    const int rising = run->sign[i] < 0.0;
    int candidate = crossed && (task->direction[i] == 0 || (task->direction[i] > 0) == rising);
    if (!candidate && known > 1)
      candidate = may_touch(times[0], oldest[i] - task->offset[i], times[1], last[i] - task->offset[i], t, value);
    if (candidate) found |= task->decides[i] ? 3 : 1;
    if (now) run->sign[i] = now;
  }
  memmove(oldest, last, (size_t)n * sizeof(double));
  memcpy(last, values, (size_t)n * sizeof(double));
  times[0] = times[1];
  times[1] = t;
  return found;
}

/* --- a stretch --------------------------------------------------------------------------------------- */

/* Outputs inside the last step, in order of time; 0 where one cannot be brought onto the constraints. */
static int record_step(run_t* run, stretch_t* task, double t, double h, double end, integer samples) {
  integer sample = 1;
  double last = t;
  for (;;) {
    const double due = task->reached < task->count ? task->times[task->reached] : INFINITY;
    const double between = sample <= samples ? t + h * (double)sample / (double)(samples + 1) : INFINITY;
    if (fmin(due, between) >= end) break;
    const int wanted = due <= between;
    const double time = wanted ? due : between;
    if (wanted || (time > last && time < due)) {
      dense_output(run->y, run->dense, run->n_y, (time - t) / h, run->point);
      if (!project(run, time, run->point)) return 0;
      record(run, task, time, run->point, wanted ? task->reached : -1);
      last = time;
    }
    if (wanted) ++task->reached;
    if (between <= time) ++sample;
  }
  return 1;
}

/* Factor from a step to the next one, by its error and by the change of that since the last one (Gustafsson). */
static double growth(stretch_t* task, double h, double error) {
  const double gain = error > 0.0 ? pow(error, -1.0 / EXPONENT) : INFINITY;
  double factor = fmin(MOST, SAFETY * gain);
  if (task->last_step > 0.0)
    factor = fmin(factor, fmax(LEAST, SAFETY * gain * gain / task->last_gain * h / task->last_step));
  task->last_step = h;
  task->last_gain = fmin(gain, MOST_GAIN);
  return factor;
}

/* Looks inside a step. */
static integer samples_inside(const run_t* run, const stretch_t* task, double h) {
  if (!run->system->events && !task->keep_samples) return 0;
  return h > task->spacing * (double)(task->samples + 1) ? (integer)fmin(ceil(h / task->spacing), MOST_SAMPLES)
                                                         : task->samples;
}

/* Integrate over a stretch, or up to where something must be decided. */
int mbd_advance(run_t* run, stretch_t* task) {
  const system_t* s = run->system;
  const integer n_y = run->n_y;
  double t = task->start, *y = run->y;
  run->task = task;
  run->evaluations = 0;
  task->recorded = task->reached = task->steps = task->rejected = 0;
  task->time = t;
  task->least_regularity = INFINITY;
  task->status = DONE;
  memcpy(y, task->x, (size_t)run->n_x * sizeof(double));
  memset(y + run->n_x, 0, (size_t)s->integrals * sizeof(double));
  run->channel = task->channels;
  run->hint = INFINITY;
  find_rate(run, t, y, run->k);
  for (integer i = 0; i < run->n_x; ++i)
    if (!isfinite(run->k[i])) { task->status = NOT_FINITE; task->evaluations = run->evaluations; return NOT_FINITE; }
  integer looked = 0;
  if (s->events) {
    double *last = run->events + s->events, *times = run->events + 3 * s->events;
    find_events(run, t, y, last);
    times[1] = t;
    looked = 1;
    for (integer i = 0; i < s->events; ++i)
      run->sign[i] = sign_of(task->side[i] != 0.0 ? task->side[i] : last[i] - task->offset[i]);
  }
  const integer margin = s->events || task->keep_samples || task->fall > 0.0 ? MOST_SAMPLES + 4 : 4;
  double step = task->step;
  integer stop = 0, near_steps = 0;
  run->across = task->across != 0;
  run->passed = task->passed;
  if (s->switches) find_switches(run, t, y, run->now);
  while (task->reached < task->count) {
    while (stop < task->count - 1 && (stop < task->reached || !task->stops[stop])) ++stop;
    const double end = task->times[stop];
    if (step <= 0.0) {
      step = first_step(run, task, t, fmin(end - t, task->max_step), EXPONENT);
      task->last_step = 0.0;
    }
    step = fmin(step, task->max_step);
    const double tried = step;
    int clipped = 0, repeated = 0, inside = 0;
    integer samples = 0;
    bracket_t at = {0.0, 0.0, 0.0, 0};
    memcpy(run->from, run->now, (size_t)s->switches * sizeof(double));
    memcpy(run->before, run->now, (size_t)s->switches * sizeof(double));
    double h = step, arrival = t + h, error, estimate = 0.0;
    if (t + 1.01 * h >= end) { h = end - t; arrival = end; clipped = 1; }
    else if (t + 2.0 * h > end) { h = (end - t) / 2.0; arrival = t + h; clipped = 1; }
    for (;;) {
      run->hint = INFINITY;
      error = attempt(run, task, t, h);
      const double length = length_to_switch(run, t, h, &error, &at);
      if (length == 0.0 && error < 1.0 && arrive(run, arrival)) {
        estimate = eigenvalue(run);
        inside = task->times[task->reached] < arrival;
        samples = samples_inside(run, task, h);
        if (inside || samples) prepare_dense(run, t, h);
        const double outlying = s->switches && (inside || samples) ? error_of_outliers(run, h, 16) : 0.0;
        if (!(outlying > 1.0)) break;
        error = outlying;
        at.low = at.high = at.left = 0.0;
        memcpy(run->before, run->from, (size_t)s->switches * sizeof(double));
      }
      ++task->rejected;
      clipped = 0;
      if (length > 0.0) {
        h = length;
        arrival = t + h;
        continue;
      }
      repeated = 1;
      h *= isfinite(error) && error >= 1.0 ? fmax(LEAST, SAFETY * pow(error, -1.0 / EXPONENT)) : LEAST;
      arrival = t + h;
      if (!(h > least_step(t))) {
        /* what was reached so far counts; who called sees that it goes no further */
        task->status = !isfinite(error) ? NOT_FINITE : error < 1.0 ? APART : TOO_SMALL;
        goto finish;
      }
    }
    ++task->steps;
    const double factor = growth(task, h, error);
    step = h * (repeated ? fmin(factor, 1.0) : factor);
    if (clipped) step = fmax(step, tried);
    task->eigenvalue = fmax(estimate, FADING * task->eigenvalue);
    if (task->eigenvalue > 0.0) step = fmin(step, STABLE / task->eigenvalue);
    if (at.left > 0.0) step = at.left;
    else if (run->across) { run->passed = t; step = 0.0; }
    run->across = at.left > 0.0;
    if (task->stiff_after) {
      if (h * task->eigenvalue > STABILITY) {
        task->not_stiff = 0;
        if (++task->stiff >= task->stiff_after) task->status = STIFF;
      } else if (++task->not_stiff == FORGOTTEN) task->stiff = 0;
    }
    int found = 0;
    if (s->events) {
      for (integer k = 1; k <= samples + 1; ++k) {
        const double *state = run->next, part = (double)k / (double)(samples + 1);
        if (k <= samples) { dense_output(run->y, run->dense, run->n_y, part, run->point); state = run->point; }
        const double time = k <= samples ? t + part * h : arrival;
        find_events(run, time, state, run->events + 2 * s->events);
        found |= look(run, task, time, looked);
        looked = 2;
      }
    }
    if (s->multipliers && task->fall > 0.0) {
      const double hint = run->hint;
      if (hint < task->least_regularity) task->least_regularity = hint;
      if (hint > task->regularity && isfinite(hint)) task->regularity = hint;
      const int near = hint < task->fall * task->regularity;
      if (near) { ++near_steps; found |= 1; }
      if ((near_steps && !near) || near_steps >= NEAR_STEPS) task->status = SINGULAR;
    }
    const integer kept = found || task->keep_samples ? (samples ? samples : found ? task->samples : 0) : 0;
    if (kept && !inside && !samples) prepare_dense(run, t, h);
    if (!record_step(run, task, t, h, arrival, kept)) {
      task->status = APART;
      goto finish;
    }
    const int due = task->reached < task->count && task->times[task->reached] == arrival;
    if (found & 2) task->status = EVENT;
    if (task->status == DONE) {
      if (*task->halt) task->status = HALTED;
      else if (task->capacity - task->recorded < margin + task->count - task->reached) task->status = FULL;
      else if (task->most_steps && task->steps >= task->most_steps) task->status = PAUSED;
    }
    if (due) record(run, task, arrival, run->next, task->reached++);
    else if (task->every_step || task->status != DONE) record(run, task, arrival, run->next, -1);
    t = arrival;
    task->time = t;
    memcpy(y, run->next, (size_t)n_y * sizeof(double));
    if (task->status != DONE) break;
    if (due && task->reached < task->count && task->stops[task->reached - 1]) {
      run->channel = task->channels + task->reached * task->channel;
      find_rate(run, t, y, run->k);
    } else memcpy(run->k, run->k + 12 * n_y, (size_t)n_y * sizeof(double));
  }
finish:
  /* after a failure the last state that was reached is the last one that is recorded */
  if (task->status >= TOO_SMALL && t > task->start && !(task->recorded && task->out_times[task->recorded - 1] >= t))
    record(run, task, t, y, -1);
  if (task->status == HALTED || task->status == PAUSED || task->status == FULL || task->status == STIFF)
    if (task->reached == task->count) task->status = DONE;
  task->step = step;
  task->across = run->across;
  task->passed = run->passed;
  task->evaluations = run->evaluations;
  return task->status;
}
