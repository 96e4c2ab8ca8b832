/* --- the controller: its plan, and a step ---------------------------------------------------------------------- */

/* Change of the plan, relative to 1 and its size, at which iterations have converged. */
#define CONVERGED 1e-9
/* The change above which iterations that end without have not. */
#define NOT_CONVERGED 1e-6
/* Share of the descent that its slope promises which a step has to bring, and what is rounding of cost and misses. */
#define DESCENT 1e-4
#define ROUNDING 1e-9
/* Share of a step that is taken in any case. */
#define SHORTEST_STEP 0.01

void controller_reset(controller* m) {
  m->status = CONTROLLER_SOLVED;
  m->is_planned = m->is_prepared = 0;
  m->samples = 0;
  m->iterations = m->quadratic_steps = 0;
  m->cost = m->time = 0.0;
  set_zero(m->p, NP);
  for (int k = 0; k < N; ++k) copy_to(m->held + k * NU, controller_start_inputs, NU);
}

/* A plan that stays in a state, under the inputs of the start; 0 if no pose has that state. */
static int begin_plan(controller* m, const double* x) {
  copy_to(m->q, controller_start_pose, NQ);
  if (!follow_loops(m->time, x, m->p, m->q, m->w)) return 0;
  for (int k = 0; k <= N; ++k) {
    copy_to(m->x + k * NX, x, NX);
    if (k < N) copy_to(m->u + k * NU, controller_start_inputs, NU);
  }
  m->is_planned = 1;
  m->is_prepared = 0;
  return 1;
}

/* True if the loops close in a state, from where they are at the start of the plan. */
static int closes(controller* m, const double* x) {
  double q[CONTROLLER_SIZE(NQ)];
  copy_to(q, m->q, NQ);
  return follow_loops(m->time, x, m->p, q, m->w);
}

/* Add a share of the change to the plan; returns its largest part, relative to 1 and the size of what changes. */
static double change_plan(controller* m, double share) {
  double largest = 0.0;
  for (int k = 0; k <= N; ++k) {
    for (int j = 0; j < NX; ++j) {
      const double step = share * m->change[k * ND + j];
      largest = fmax(largest, fabs(step) / (1.0 + fabs(m->x[k * NX + j])));
      m->x[k * NX + j] += step;
    }
    for (int j = 0; k < N && j < NU; ++j) {
      const double step = share * m->change[k * ND + NX + j];
      largest = fmax(largest, fabs(step) / (1.0 + fabs(m->u[k * NU + j])));
      m->u[k * NU + j] += step;
    }
  }
  m->is_prepared = 0;
  return largest;
}

/* By how much the plan misses the measured state, the equations, limits and conditions of the end together. */
static double missed(const controller* m, const double* x) {
  double sum = 0.0;
  for (int i = 0; i < NX; ++i) sum += fabs(x[i] - m->x[i]);
  for (int i = 0; i < N * NX; ++i) sum += fabs(m->miss[i]);
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      const double row = m->row[k * NC + i];
      if (kind_of(k, i)) sum += kind_of(k, i) == 2 ? fabs(row) : fmax(row, 0.0);
    }
  return sum;
}

/* Slope of cost and price times what is missed along the change, at a price that makes it a descent by half of that. */
static double descent(controller* m, double miss, double* price) {
  const double model = slope_of_cost(m, m->change, m->slope);
  double slope = 0.0;
  for (int i = 0; i < (N + 1) * ND; ++i) slope += m->gradient[i] * m->change[i];
  if (miss > 0.0) *price = fmax(*price, 2.0 * model / miss);
  return slope - *price * miss;
}

/* Steps of the program from a plan; the status. A step after which cost and misses together have not become less is
   halved (the line search of Han). */
static int improve(controller* m, const double* x) {
  double first[CONTROLLER_SIZE(NX)];
  double change = 0.0, merit = 0.0, slope = 0.0, price = 0.0, length = 0.0;
  int is_met = 1;
  for (m->iterations = 0; m->iterations < CONTROLLER_ITERATIONS; ++m->iterations) {
    const int has_value = m->is_prepared || linearise(m);
    if (length > SHORTEST_STEP && !(has_value && m->cost + price * missed(m, x) <= merit + DESCENT * length * slope)) {
      copy_to(m->q, m->near, (N + 1) * NQ);
      change_plan(m, -length / 2.0);
      length /= 2.0;
      continue;
    }
    if (!has_value) return CONTROLLER_NO_VALUE;
    for (int i = 0; i < NX; ++i) first[i] = x[i] - m->x[i];
    is_met = solve_quadratic(m, first, 0);
    if (!is_met && !solve_quadratic(m, first, 1)) return CONTROLLER_NO_VALUE;
    length = 0.0;
    if (CONTROLLER_ITERATIONS > 1 && is_met) {
      const double miss = missed(m, x);
      slope = descent(m, miss, &price);
      merit = m->cost + price * miss;
      merit += ROUNDING * (fabs(m->cost) + price * miss);
      copy_to(m->near, m->q, (N + 1) * NQ);
      length = 1.0;
    }
    change = change_plan(m, 1.0);
    if (!(change <= 1e150)) return CONTROLLER_NO_VALUE;
    if (change <= CONVERGED) break;
  }
  if (!is_met) return CONTROLLER_NOT_MET;
  return CONTROLLER_ITERATIONS > 1 && change > NOT_CONVERGED ? CONTROLLER_NOT_CONVERGED : CONTROLLER_SOLVED;
}

int controller_feedback(controller* m, double time, const double* state, const double* parameters, double* inputs) {
  int status = CONTROLLER_NOT_FINITE;
  if (all_finite(&time, 1) && all_finite(state, NX) && all_finite(parameters, NP)) {
    const int is_new = !m->is_planned;
    int same = fabs(m->time - time) <= 1e-9 * CONTROLLER_SAMPLE || !CONTROLLER_IS_TIMED;
    for (int i = 0; i < NP; ++i) same = same && m->p[i] == parameters[i];
    m->time = time;
    copy_to(m->p, parameters, NP);
    if (!same) m->is_prepared = 0;
    status = is_new || !closes(m, state) ? CONTROLLER_NO_VALUE : improve(m, state);
    if (status == CONTROLLER_NO_VALUE && begin_plan(m, state)) status = improve(m, state);
    if (status == CONTROLLER_NO_VALUE) m->is_planned = 0;
  }
  m->status = status;
  if (status != CONTROLLER_NOT_FINITE && status != CONTROLLER_NO_VALUE) {
    copy_to(m->held, m->u, N * NU);
    m->samples = 0;
  }
  /* the input of the last plan that could be made, at this time of it */
  const int at = (int)(m->samples * (CONTROLLER_SAMPLE / CONTROLLER_INTERVAL) + 1e-9);
  copy_to(inputs, m->held + (at < N ? at : N - 1) * NU, CONTROLLER_INPUTS);
  ++m->samples;
  return status;
}

void controller_prepare(controller* m) {
  const double share = CONTROLLER_SAMPLE / CONTROLLER_INTERVAL;
  m->time += CONTROLLER_SAMPLE;
  m->is_prepared = 0;
  if (!m->is_planned) return;
  copy_to(m->q, m->q + (share < 1.0 - 1e-9 ? 0 : (int)(share + 1e-9) < N ? (int)(share + 1e-9) : N) * NQ, NQ);
  for (int k = 0; k <= N; ++k) { /* what lies later is still that of before */
    const int j = (int)(k + share + 1e-9);
    const double part = k + share - j > 1e-9 ? k + share - j : 0.0;
    const int from = j < N ? j : N, to = j + 1 < N ? j + 1 : N;
    for (int i = 0; i < NX; ++i)
      m->x[k * NX + i] = (1.0 - part) * m->x[from * NX + i] + part * m->x[to * NX + i];
    if (k < N) copy_to(m->u + k * NU, m->u + (j < N ? j : N - 1) * NU, NU);
  }
  m->is_prepared = linearise(m);
}

int controller_step(controller* m, double time, const double* state, const double* parameters, double* inputs) {
  const int status = controller_feedback(m, time, state, parameters, inputs);
  controller_prepare(m);
  return status;
}

void controller_example(double* state, double* parameters) {
  copy_to(state, controller_start_state, NX);
  copy_to(parameters, controller_start_parameters, NP);
}
