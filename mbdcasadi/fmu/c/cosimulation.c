/* Co-simulation: the integrator takes steps of its own size, also beyond the communication point. As long as inputs
   and parameters stay as they are, later points are read from the dense output of the step that passed them, and
   brought onto the constraints. */

/* Steps within one communication step after which the motion counts as too stiff. */
#define TOO_MANY 500000
/* Samples of the functions that switch in time, and steps over which they are looked ahead. */
#define TIME_SAMPLES 32
#define TIME_WINDOW 20.0
/* Part of a step before a contact below which it is not cut off, and contacts looked for in one step. */
#define NEAR_CONTACT 1e-6
#define CONTACTS_IN_STEP 8

static int differ(const double* a, const double* b, int count) {
  for (int i = 0; i < count; ++i)
    if ((a[i] < 0.0) != (b[i] < 0.0)) return 1;
  return 0;
}

/* First time after t, up to a limit, at which something switches in time: the last time before it; else the limit. */
static double next_switch(instance* s, double t, double limit) {
  if (!N_TIMED) return limit;
  double *before = s->switches, *after = before + N_INDICATORS, low = t + resolution_at(t);
  find_indicators(s, low, s->x, before);
  for (int k = 1; k <= TIME_SAMPLES; ++k) {
    double high = t + (limit - t) * (double)k / TIME_SAMPLES;
    find_indicators(s, high, s->x, after);
    if (differ(before, after, N_TIMED)) {
      while (high - low > resolution_at(high)) {
        const double middle = low + (high - low) / 2;
        find_indicators(s, middle, s->x, after);
        if (differ(before, after, N_TIMED)) high = middle;
        else low = middle;
      }
      return low;
    }
    low = high;
    memcpy(before, after, sizeof(double) * N_TIMED);
  }
  return limit;
}

/* A time just beyond what switches at t, or t. */
static double beyond_switch(instance* s, double t) {
  if (!N_TIMED) return t;
  double *before = s->switches, *after = before + N_INDICATORS;
  find_indicators(s, t - resolution_at(t), s->x, before);
  find_indicators(s, t + 2.0 * resolution_at(t), s->x, after);
  return differ(before, after, N_TIMED) ? t + 2.0 * resolution_at(t) : t;
}

/* State at a time of the step that is ahead. */
static int state_at(instance* s, double t, double* x) {
  const double begin = s->block[AHEAD_BEGIN], end = s->block[AHEAD_END], h = end - begin;
  if (t >= end) { memcpy(x, s->finish, sizeof(double) * N_X); return 1; }
  dense_output(s->start, s->dense, N_X, fmax(0.0, (t - begin) / h), x);
  return project(s->run, t, x);
}

/* 1 if steps that begin at a time follow the force of a contact. */
static int is_short(const instance* s, double t) { return t >= s->block[SHORT_FROM] && t < s->block[SHORT_UNTIL]; }

/* One step of the integrator, which ends at a limit at the latest; the status of the engine. */
static int take_step(instance* s, double wanted, double limit) {
  double times[2];
  int stops[2];
  stretch_t* task = &s->task;
  const double end = s->block[AHEAD_END], begin = beyond_switch(s, end);
  const int whole = wanted < limit;
  times[0] = fmax(wanted, begin + resolution_at(begin));
  stops[0] = !whole;
  times[1] = limit;
  stops[1] = 1;
  if (times[0] >= limit) { times[0] = limit; stops[0] = 1; }
  task->start = begin;
  task->x = s->finish;
  task->count = times[0] < limit ? 2 : 1;
  task->times = times;
  task->stops = stops;
  task->reltol = s->block[RELTOL];
  task->abstol = fmin(s->block[RELTOL] * DEFAULT_ABSTOL / DEFAULT_RELTOL, LARGEST_ABSTOL);
  task->most_steps = 1;
  task->every_step = 1;
  task->samples = task->keep_samples = N_GAPS > 0;
  task->capacity = ROWS_OUT;
  task->step = s->block[STEP];
  task->last_step = s->block[LAST_STEP];
  task->last_gain = s->block[LAST_GAIN];
  task->across = s->block[IS_ACROSS] != 0.0;
  task->passed = s->block[PASSED];
  task->eigenvalue = s->block[EIGENVALUE];
  memcpy(s->start, s->finish, sizeof(double) * N_X);
  task->max_step = is_short(s, begin) ? s->block[SHORT_STEP] : INFINITY;
  const int status = mbd_advance(s->run, task);
  if (!task->steps || !task->recorded) return status == DONE ? TOO_SMALL : status;
  s->block[STEP] = task->step;
  s->block[LAST_STEP] = task->last_step;
  s->block[LAST_GAIN] = task->last_gain;
  s->block[IS_ACROSS] = (double)task->across;
  s->block[PASSED] = task->passed;
  s->block[EIGENVALUE] = task->eigenvalue;
  s->block[AHEAD_BEGIN] = begin;
  s->block[AHEAD_END] = task->out_times[task->recorded - 1];
  memcpy(s->finish, task->out_x + (task->recorded - 1) * N_X, sizeof(double) * N_X);
  memcpy(s->dense, s->run->dense, sizeof(double) * 7 * N_X);
  return DONE;
}

static const char* reason(int status) {
  switch (status) {
    case TOO_SMALL: return "the error test failed repeatedly at the smallest step";
    case APART: return "the constraints can no longer be met together";
    case SINGULAR: return "the pose is singular";
    default: return "the equations gave values that are not finite";
  }
}

/* How far the integrator is, and what it goes on with. */
#define KEPT (EIGENVALUE + 1 - AHEAD_BEGIN)

static void keep(const instance* s, double* kept) {
  memcpy(kept, s->block + AHEAD_BEGIN, sizeof(double) * KEPT);
  memcpy(kept + KEPT, s->finish, sizeof(double) * N_X);
}

/* Forget the step that is ahead, up to its begin. */
static void step_back(instance* s, const double* kept) {
  memcpy(s->block + AHEAD_BEGIN, kept, sizeof(double) * KEPT);
  memcpy(s->finish, kept + KEPT, sizeof(double) * N_X);
}

/* Repeat the step that is ahead up to a gap that closes and opens again in it, so that the force that arises is
   followed. At those that stay closed the integrator ends its steps, and goes across them. */
static int stop_at_contacts(instance* s, double wanted, double limit, const double* kept) {
  double* block = s->block;
  const double end = kept[AHEAD_END - AHEAD_BEGIN];
  int status = DONE, gap = 0;
  if (kept[IS_ACROSS - AHEAD_BEGIN] != 0.0) return DONE;
  for (int k = 0; k < CONTACTS_IN_STEP && status == DONE; ++k) {
    const double closing = first_closing(s, &gap), taken = block[AHEAD_END] - end;
    const int at_once = closing - end <= NEAR_CONTACT * taken;
    if (isinf(closing) || (at_once && is_short(s, end) && taken <= 1.01 * block[SHORT_STEP])) return DONE;
    follow_contact(s, at_once ? end : closing, closing, gap);
    if (!at_once) limit = closing;
    step_back(s, kept);
    block[STEP] = at_once ? 0.0 : closing - end;
    status = take_step(s, fmin(wanted, limit), limit);
    if (status == DONE && block[AHEAD_END] >= closing) block[STEP] = 0.0;
  }
  return status;
}

/* A step up to a limit, repeated with its end at the communication point if it fails, and at a contact. */
static int go_on(instance* s, double wanted) {
  double* block = s->block;
  const double end = block[AHEAD_END], step = block[STEP];
  double limit = block[STOP_TIME];
  if (!(limit > end)) limit = INFINITY;
  if (limit < wanted) limit = wanted;
  if (N_TIMED) limit = next_switch(s, end, fmin(limit, end + fmax(2.0 * (wanted - end), TIME_WINDOW * step)));
  double* kept = s->scratch + 2 * N_X;
  keep(s, kept);
  int status = take_step(s, wanted, limit);
  if (status != DONE && limit > wanted) {
    step_back(s, kept);
    block[STEP] = 0.0;
    limit = wanted;
    status = take_step(s, wanted, limit);
  }
  if (status == DONE) status = stop_at_contacts(s, wanted, limit, kept);
  if (status != DONE) step_back(s, kept);
  return status;
}

/* Go on to a time; what was reached is the state if this fails. */
static int step_to(instance* s, double end) {
  double* block = s->block;
  int status = settle(s);
  if (status != OK_) return status;
  const double begin = block[TIME];
  if (!(end > begin)) return OK_;
  if (block[IS_AHEAD] == 0.0) {
    memcpy(s->finish, s->x, sizeof(double) * N_X);
    block[AHEAD_BEGIN] = block[AHEAD_END] = begin;
    block[IS_AHEAD] = 1.0;
  }
  changed(s);
  for (long steps = 0; block[AHEAD_END] < end; ++steps) {
    status = steps < TOO_MANY ? go_on(s, end) : STIFF;
    if (status != DONE) {
      block[TIME] = block[AHEAD_END];
      memcpy(s->x, s->finish, sizeof(double) * N_X);
      turned(s);
      if (status == STIFF)
        say(s, DISCARD_, "the motion is too stiff for the solver in this unit: %d steps led from t = %.6g s to %.6g s; "
            "take model exchange with a solver for stiff equations", TOO_MANY, begin, block[TIME]);
      else {
        find_outputs(s);
        for (int i = 0; i < N_COORDINATES; ++i)
          if (!isfinite(s->a[i])) { blame(s, DISCARD_); return DISCARD_; }
        say(s, DISCARD_, "the solver stopped at t = %.6g s: %s", block[TIME], reason(status));
      }
      return DISCARD_;
    }
  }
  block[TIME] = end;
  if (!state_at(s, end, s->x)) {
    say(s, DISCARD_, "the constraints cannot be met together at t = %.6g s", end);
    turned(s);
    return DISCARD_;
  }
  if (N_VALIDITY) update_outputs(s);
  return OK_;
}
