/* Contacts and stops that close inside a step of the integrator, however short.

   The gaps are followed on the path of the step, which is halved until one is seen to close or none can: in long
   intervals, or in which bodies turn far, its rate is bounded, in others the gap of convex outlines stays above its
   tangents. `simulate`
   looks in the same way, and its constants are in model.h. */

/* Looks on the path after a closing, and halvings of it, by which it is found how fast the force grows. */
#define PATH_LOOKS 64
#define GROWTH_HALVINGS 23

static double resolution_at(double t) { return 16.0 * (nextafter(fabs(t), INFINITY) - fabs(t)) + 1e-300; }

/* State at a time of the step that is ahead, by the positions and velocities at its ends and the accelerations at its
   begin: a contact that the method passed over may have hit the end, and stages from which the dense output is made. */
static void path_at(instance* s, double t, double* x) {
  const double begin = s->block[AHEAD_BEGIN], h = s->block[AHEAD_END] - begin, r = fmin(1.0, fmax(0.0, (t - begin) / h));
  const double *change = s->dense, *first = change + N_X;
  const int n = N_COORDINATES;
  for (int i = 0; i < n; ++i) {
    const double v0 = h * s->start[n + i], a0 = h * (first[n + i] + change[n + i]);
    const double left = change[i] - v0 - 0.5 * a0, faster = h * s->finish[n + i] - v0 - a0;
    const double c3 = 4.0 * left - faster, c4 = faster - 3.0 * left;
    x[i] = s->start[i] + r * (v0 + r * (0.5 * a0 + r * (c3 + r * c4)));
    x[n + i] = (v0 + r * (a0 + r * (3.0 * c3 + r * 4.0 * c4))) / h;
  }
  for (int i = 2 * n; i < N_X; ++i) x[i] = s->start[i] + r * change[i];
}

static void evaluate_at(instance* s, code_t function, double t, const double* x, double* values) {
  const double* arg[8] = {&t, x, x + N_COORDINATES, s->a, x + 2 * N_COORDINATES, s->lam, s->run->u, s->p};
  double* res[1] = {values};
  function(arg, res, NULL, s->work, 0);
}

/* Gaps, their rates, bounds of these, and whether each was open at this look or at the one before. */
static void look_at_gaps(instance* s, double t, const double* before, double* look) {
  path_at(s, t, s->scratch);
  evaluate_at(s, gap_rates, t, s->scratch, look);
  for (int i = 0; i < N_GAPS; ++i) look[3 * N_GAPS + i] = look[i] > SHALLOW || (before && before[3 * N_GAPS + i] != 0.0);
}

/* The gap that is open at one look and closed at the next, or -1. */
static int closed_between(const double* a, const double* b) {
  for (int i = 0; i < N_GAPS; ++i)
    if (a[3 * N_GAPS + i] != 0.0 && b[i] < 0.0) return i;
  return -1;
}

/* Largest turn of a body in the step that is ahead, rad. */
static double turn_ahead(const instance* s) {
  double speed = 0.0;
  for (int i = N_COORDINATES + 2; i < N_COORDINATES + 3 * N_BODIES; i += 3)
    speed = fmax(speed, fmax(fabs(s->start[i]), fabs(s->finish[i])));
  return speed * (s->block[AHEAD_END] - s->block[AHEAD_BEGIN]);
}

/* 1 if a gap may close between two looks, in a step in which bodies turn by an angle. */
static int may_close(const double* a, const double* b, double length, int halvings, double turn) {
  if (closed_between(a, b) >= 0) return 1;
  for (int i = 0; i < N_GAPS; ++i) {
    const double bound = GAP_SAFETY * fmax(a[2 * N_GAPS + i], b[2 * N_GAPS + i]) * length;
    const double down = GAP_SAFETY * fmax(-a[N_GAPS + i], 0.0), up = GAP_SAFETY * fmax(b[N_GAPS + i], 0.0);
    if (a[3 * N_GAPS + i] == 0.0 || a[i] + b[i] >= bound) continue;
    if (halvings < COARSE_HALVINGS || ldexp(turn, -halvings) > TURN) return 1;
    if (bound > SHALLOW && down > 0.0 && up > 0.0 && a[i] * up + b[i] * down - down * up * length < -SHALLOW * (down + up))
      return 1;
  }
  return 0;
}

/* Time just before the first closing between two looks, and its gap; infinity if there is none. */
static double closing_between(instance* s, double low, const double* a, double high, const double* b, int halvings,
                              double turn, int* gap) {
  if (!may_close(a, b, high - low, halvings, turn)) return INFINITY;
  if (high - low <= resolution_at(high) || halvings == HALVINGS) {
    *gap = closed_between(a, b);
    return *gap >= 0 ? low : INFINITY;
  }
  const double middle = low + (high - low) / 2;
  double* between = s->looks + (2 + halvings) * LOOK;
  look_at_gaps(s, middle, a, between);
  const double first = closing_between(s, low, a, middle, between, halvings + 1, turn, gap);
  return isinf(first) ? closing_between(s, middle, between, high, b, halvings + 1, turn, gap) : first;
}

/* Time just before the first closing in the step that is ahead, and its gap; infinity if there is none. */
static double first_closing(instance* s, int* gap) {
  if (!N_GAPS) return INFINITY;
  const double begin = s->block[AHEAD_BEGIN], end = s->block[AHEAD_END];
  double *first = s->looks, *last = first + LOOK;
  look_at_gaps(s, begin, NULL, first);
  look_at_gaps(s, end, first, last);
  return closing_between(s, begin, first, end, last, 0, turn_ahead(s), gap);
}

/* Time in which the force that arises after a closing stops the outlines; at most that for which the gap stays closed
   on the path. */
static double stopping_time(instance* s, double closing, int gap) {
  double *look = s->looks, spell = s->block[AHEAD_END] - closing;
  look_at_gaps(s, closing, NULL, look);
  const double speed = fabs(look[N_GAPS + gap]), length = spell;
  for (int k = 1; k < PATH_LOOKS; ++k) {
    look_at_gaps(s, closing + length * k / PATH_LOOKS, NULL, look);
    if (look[gap] >= 0.0) { spell = length * k / PATH_LOOKS; break; }
  }
  double stopping = ldexp(spell, -GROWTH_HALVINGS);
  for (int k = GROWTH_HALVINGS; k >= 0; --k) {
    const double since = ldexp(spell, -k), time = closing + since;
    path_at(s, time, s->scratch);
    find_accelerations(s->run, time, s->scratch, s->a, s->zdot, s->lam);
    evaluate_at(s, gap_pulls, time, s->scratch, look);
    if (fabs(look[gap]) * since > speed) break;
    stopping = since;
  }
  return stopping;
}

/* Limit the steps from a time on so that they follow the force that arises after a closing. */
static void follow_contact(instance* s, double from, double closing, int gap) {
  const double step = fmax(stopping_time(s, closing, gap) / STOPS_IN_STOPPING, 16.0 * resolution_at(closing));
  s->block[SHORT_FROM] = from;
  s->block[SHORT_STEP] = step;
  s->block[SHORT_UNTIL] = closing + STOPS_IN_STOPPING * STOPPING_TIMES * step;
}
