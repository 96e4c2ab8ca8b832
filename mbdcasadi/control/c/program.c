/* The program of the controller about its plan: linearisation by intervals, and the quadratic program.

   Matrices are stored by columns. All coordinates of a tree of joints, their rates and first-order states
   s = (q, v, z) follow from the state x of the controller, which holds as many numbers as are independent. */

#define NQ CONTROLLER_COORDINATES
#define NW CONTROLLER_POSITIONS
#define NB CONTROLLER_RATES
#define NZ CONTROLLER_FIRST_ORDER
#define NX CONTROLLER_STATES
#define NU CONTROLLER_UNKNOWN_INPUTS
#define NP CONTROLLER_PARAMETERS
#define NR CONTROLLER_ROWS
#define NI CONTROLLER_ROWS_AT_ENDS
#define NK (NR + NI) /* limits of an interval: at its start, and at its end under the same inputs */
#define NE CONTROLLER_END_ROWS
#define NC CONTROLLER_MOST_ROWS
#define N CONTROLLER_INTERVALS
#define NS (2 * NQ + NZ) /* s */
#define NY (NS + NU)     /* (s, u) */
#define NT CONTROLLER_END_INPUTS
#define ND CONTROLLER_BOTH /* (x, u), or at the end (x, what soft limits are passed by) */
#define NV (ND - NX)
#define NF (NQ + NZ + 1) /* accelerations, rates of first-order states, running cost */

/* Newton's steps to a pose, and the change below which the next one would be rounding (m or rad). */
#define POSE_STEPS 20
#define POSE_CHANGE 1e-7
/* Way of a position, or of a driver that follows states (m or rad), at once, so that loops stay on their branch, and
   the most such ways. */
#define POSE_WAY 0.2
#define POSE_WAYS 500
/* Steps of the interior point method, and the gap between program and dual, relative to the cost, at which it ends. */
#define POINT_STEPS 60
#define GAP 1e-13
/* The gap at which a program that gets no further has been solved. */
#define LARGEST_GAP 1e-7
/* Share of the way to the nearest limit that a step goes. */
#define SHORT_OF_LIMIT 0.995
/* Miss of an equality at the end, and a limit, in their units. */
#define ROW_MISS 1e-9
/* Price of the square of what a limit is passed by, relative to the cost and to that of unit changes, if the limits
   cannot be met. */
#define PASSING_PRICE 1e6
/* Weight by which an equality at the end is approached, relative to the largest entry of the Hessian there. */
#define EQUALITY_WEIGHT 1e6

static void set_zero(double* x, int n) {
  for (int i = 0; i < n; ++i) x[i] = 0.0;
}

static void copy_to(double* to, const double* from, int n) {
  for (int i = 0; i < n; ++i) to[i] = from[i];
}

static int all_finite(const double* x, int n) {
  for (int i = 0; i < n; ++i)
    if (!(fabs(x[i]) <= 1e150)) return 0;
  return 1;
}

/* c += a b, with a (n, k) and b (k, m) whose columns are `stride` apart; zeros of b are passed over. */
static void add_product(double* c, const double* a, const double* b, int n, int k, int m, int stride) {
  for (int j = 0; j < m; ++j)
    for (int l = 0; l < k; ++l) {
      const double factor = b[l + j * stride];
      if (factor != 0.0)
        for (int i = 0; i < n; ++i) c[i + j * n] += a[i + l * n] * factor;
    }
}

/* Factors of a square matrix by Gauss elimination with pivots; 0 if it is singular. */
static int factorise(double* a, int* pivot, int n) {
  for (int j = 0; j < n; ++j) {
    int best = j;
    for (int i = j + 1; i < n; ++i)
      if (fabs(a[i + j * n]) > fabs(a[best + j * n])) best = i;
    pivot[j] = best;
    if (!(fabs(a[best + j * n]) > 1e-300)) return 0;
    if (best != j)
      for (int l = 0; l < n; ++l) {
        const double other = a[j + l * n];
        a[j + l * n] = a[best + l * n];
        a[best + l * n] = other;
      }
    for (int i = j + 1; i < n; ++i) {
      const double share = a[i + j * n] /= a[j + j * n];
      if (share != 0.0)
        for (int l = j + 1; l < n; ++l) a[i + l * n] -= share * a[j + l * n];
    }
  }
  return 1;
}

static void solve_factored(const double* a, const int* pivot, double* b, int n) {
  for (int j = 0; j < n; ++j) {
    const double other = b[pivot[j]];
    b[pivot[j]] = b[j];
    b[j] = other;
  }
  for (int j = 0; j < n; ++j)
    for (int i = j + 1; i < n; ++i) b[i] -= a[i + j * n] * b[j];
  for (int j = n - 1; j >= 0; --j) {
    b[j] /= a[j + j * n];
    for (int i = 0; i < j; ++i) b[i] -= a[i + j * n] * b[j];
  }
}

/* --- a pose and its velocities from a state ---------------------------------------------------------------- */

/* Move the coordinates q to those of a state but for a share of what the rows missed; 0 if the loops do not close. */
static int close_loops(double t, const double* x, const double* p, double share, const double* missed, double* q,
                       double* w) {
  double rows[CONTROLLER_SIZE(NQ)], slopes[CONTROLLER_SIZE(NQ * NQ)], still[CONTROLLER_SIZE(NQ)];
  int pivot[CONTROLLER_SIZE(NQ)];
  set_zero(still, NQ);
  for (int step = 0; step < POSE_STEPS; ++step) {
    const double* arg[5] = {&t, q, still, x + NW + NB, p};
    double* res[7] = {rows, 0, slopes, 0, 0, 0, 0};
    controller_pose(arg, res, w);
    for (int i = 0; i < NW; ++i) rows[NQ - NW + i] -= x[i];
    for (int i = 0; i < NQ; ++i) rows[i] -= share * missed[i];
    if (!factorise(slopes, pivot, NQ)) return 0;
    solve_factored(slopes, pivot, rows, NQ);
    if (!all_finite(rows, NQ)) return 0;
    double change = 0.0;
    for (int i = 0; i < NQ; ++i) {
      q[i] -= rows[i];
      change = fmax(change, fabs(rows[i]));
    }
    if (change <= POSE_CHANGE) return 1;
  }
  return 0;
}

/* The same over a way of any length, from positions that q has. */
static int follow_loops(double t, const double* x, const double* p, double* q, double* w) {
  double missed[CONTROLLER_SIZE(NQ)], still[CONTROLLER_SIZE(NQ)], way = 0.0;
  const double* arg[5] = {&t, q, still, x + NW + NB, p};
  double* res[7] = {missed, 0, 0, 0, 0, 0, 0};
  set_zero(still, NQ);
  controller_pose(arg, res, w);
  for (int i = 0; i < NW; ++i) missed[NQ - NW + i] -= x[i];
  for (int i = 0; i < NQ; ++i) way = fmax(way, fabs(missed[i]));
  if (!(way <= POSE_WAY * POSE_WAYS)) return 0;
  const int ways = 1 + (int)(way / POSE_WAY);
  for (int j = 1; j <= ways; ++j)
    if (!close_loops(t, x, p, 1.0 - (double)j / ways, missed, q, w)) return 0;
  return 1;
}

/* s = (q, v, z) of a state, and its slopes by (x, u) in the first rows of (s, u) by (x, u); q is where it begins. */
static int tree_state(double t, const double* x, const double* p, double* q, double* s, double* slopes, double* w) {
  double rows[CONTROLLER_SIZE(NQ)], by_q[CONTROLLER_SIZE(NQ * NQ)], by_v[CONTROLLER_SIZE(NQ * NQ)];
  double bend[CONTROLLER_SIZE(NQ * NQ)], column[CONTROLLER_SIZE(NQ)];
  double rows_by_z[CONTROLLER_SIZE(NQ * NZ)], speeds_by_z[CONTROLLER_SIZE(NQ * NZ)];
  int pivot_q[CONTROLLER_SIZE(NQ)], pivot_v[CONTROLLER_SIZE(NQ)];
  if (!follow_loops(t, x, p, q, w)) return 0;
  double* v = s + NQ;
  copy_to(s, q, NQ);
  set_zero(v, NQ);
  const double* arg[5] = {&t, q, v, x + NW + NB, p};
  double* at_rest[7] = {0, rows, by_q, by_v, 0, rows_by_z, 0};
  controller_pose(arg, at_rest, w);
  if (!factorise(by_q, pivot_q, NQ) || !factorise(by_v, pivot_v, NQ)) return 0;
  for (int i = 0; i < NB; ++i) rows[NQ - NB + i] -= x[NW + i];
  solve_factored(by_v, pivot_v, rows, NQ);
  for (int i = 0; i < NQ; ++i) v[i] = -rows[i];
  copy_to(s + 2 * NQ, x + NW + NB, NZ);
  if (!slopes) return all_finite(s, NS);
  double* moving[7] = {0, 0, 0, 0, bend, 0, speeds_by_z};
  controller_pose(arg, moving, w);
  set_zero(slopes, NY * ND);
  for (int j = 0; j < NW; ++j) {
    double* of_q = slopes + j * NY;
    of_q[NQ - NW + j] = 1.0;
    solve_factored(by_q, pivot_q, of_q, NQ);
    set_zero(column, NQ);
    add_product(column, bend, of_q, NQ, NQ, 1, NQ);
    solve_factored(by_v, pivot_v, column, NQ);
    for (int i = 0; i < NQ; ++i) of_q[NQ + i] = -column[i];
  }
  for (int j = 0; j < NB; ++j) {
    double* of_v = slopes + (NW + j) * NY + NQ;
    of_v[NQ - NB + j] = 1.0;
    solve_factored(by_v, pivot_v, of_v, NQ);
  }
  for (int j = 0; j < NZ; ++j) {
    double* of_z = slopes + (NW + NB + j) * NY;
    for (int i = 0; i < NQ; ++i) of_z[i] = -rows_by_z[i + j * NQ];
    solve_factored(by_q, pivot_q, of_z, NQ);
    copy_to(column, speeds_by_z + j * NQ, NQ);
    add_product(column, bend, of_z, NQ, NQ, 1, NQ);
    solve_factored(by_v, pivot_v, column, NQ);
    for (int i = 0; i < NQ; ++i) of_z[NQ + i] = -column[i];
    of_z[2 * NQ + j] = 1.0;
  }
  for (int j = 0; j < NU; ++j) slopes[(NX + j) * NY + NS + j] = 1.0;
  return all_finite(s, NS);
}

/* --- linearisation about the plan --------------------------------------------------------------------------- */

/* h += weight T' a T and symmetric, with a (n, n) and T (n, m) whose columns are NY apart, and h (ND, ND). */
static void add_curvature(double* h, double weight, const double* a, const double* slopes, int n, int m) {
  double product[CONTROLLER_SIZE(NY * ND)];
  set_zero(product, n * m);
  add_product(product, a, slopes, n, n, m, NY);
  for (int j = 0; j < m; ++j)
    for (int i = 0; i <= j; ++i) {
      double sum = 0.0;
      for (int l = 0; l < n; ++l) sum += slopes[l + i * NY] * product[l + j * n];
      h[i + j * ND] += weight * sum;
      if (i != j) h[j + i * ND] += weight * sum;
    }
}

/* Limits at the start of an interval, or those on which inputs and state decide at its end. */
static void linearise_rows(controller* m, int k, double t, const double* s, const double* slopes, int at_end) {
  double value[CONTROLLER_SIZE(NR)], by[CONTROLLER_SIZE(NR * NY)], product[CONTROLLER_SIZE(NR * ND)];
  const double* arg[6] = {&t, s, s + NQ, s + 2 * NQ, m->u + k * NU, m->p};
  double* res[2] = {value, by};
  controller_rows(arg, res, m->w);
  set_zero(product, NR * ND);
  add_product(product, by, slopes, NR, NY, ND, NY);
  for (int i = 0; i < (at_end ? NI : NR); ++i) {
    const int row = at_end ? controller_rows_at_ends[i] : i, place = at_end ? NR + i : i;
    m->row[k * NC + place] = value[row];
    for (int c = 0; c < ND; ++c) m->row_slopes[k * NC * ND + place + c * NK] = product[row + c * NR];
  }
}

/* Butcher's method of order 5, whose weights are those of Boole's rule: times, factors of earlier stages, weights. */
#define STAGES 6
static const double stage_times[STAGES] = {0.0, 0.25, 0.25, 0.5, 0.75, 1.0};
static const double stage_factors[STAGES][STAGES - 1] = {
    {0.0, 0.0, 0.0, 0.0, 0.0},
    {0.25, 0.0, 0.0, 0.0, 0.0},
    {0.125, 0.125, 0.0, 0.0, 0.0},
    {0.0, -0.5, 1.0, 0.0, 0.0},
    {0.1875, 0.0, 0.0, 0.5625, 0.0},
    {-3.0 / 7, 2.0 / 7, 12.0 / 7, -12.0 / 7, 8.0 / 7},
};
static const double stage_weights[STAGES] = {7.0 / 90, 0.0, 32.0 / 90, 12.0 / 90, 32.0 / 90, 7.0 / 90};

/* A Runge-Kutta step of s and its slopes, with the cost, its slope and its curvature. */
static void advance(controller* m, int k, double begin, double* s, double* slopes) {
  const double step = CONTROLLER_INTERVAL / CONTROLLER_STEPS;
  double rates[STAGES][CONTROLLER_SIZE(NS)], rate_slopes[STAGES][CONTROLLER_SIZE(NS * ND)];
  double at[CONTROLLER_SIZE(NS)], at_slopes[CONTROLLER_SIZE(NY * ND)], change[CONTROLLER_SIZE(NF * ND)];
  double value[CONTROLLER_SIZE(NF)], by_y[CONTROLLER_SIZE(NF * NY)], bend[CONTROLLER_SIZE(NY * NY)];
  double* g = m->gradient + k * ND;
  copy_to(at_slopes, slopes, NY * ND);
  for (int i = 0; i <= STAGES; ++i) {
    copy_to(at, s, NS);
    for (int c = 0; c < ND; ++c) copy_to(at_slopes + c * NY, slopes + c * NY, NS);
    for (int l = 0; l < i; ++l) {
      const double share = step * (i < STAGES ? stage_factors[i][l] : stage_weights[l]);
      if (share == 0.0) continue;
      for (int j = 0; j < NS; ++j) at[j] += share * rates[l][j];
      for (int c = 0; c < ND; ++c)
        for (int j = 0; j < NS; ++j) at_slopes[j + c * NY] += share * rate_slopes[l][j + c * NS];
    }
    if (i == STAGES) break;
    const double t = begin + stage_times[i] * step, weight = stage_weights[i] * step;
    const double* arg[6] = {&t, at, at + NQ, at + 2 * NQ, m->u + k * NU, m->p};
    double* res[3] = {value, by_y, weight != 0.0 ? bend : 0};
    controller_point(arg, res, m->w);
    set_zero(change, NF * ND);
    add_product(change, by_y, at_slopes, NF, NY, ND, NY);
    copy_to(rates[i], at + NQ, NQ);
    copy_to(rates[i] + NQ, value, NQ + NZ);
    for (int c = 0; c < ND; ++c) {
      copy_to(rate_slopes[i] + c * NS, at_slopes + c * NY + NQ, NQ);
      copy_to(rate_slopes[i] + c * NS + NQ, change + c * NF, NQ + NZ);
      g[c] += weight * change[NF - 1 + c * NF];
    }
    if (weight == 0.0) continue;
    m->cost += weight * value[NF - 1];
    add_curvature(m->hessian + k * ND * ND, weight, bend, at_slopes, NY, ND);
  }
  copy_to(s, at, NS);
  copy_to(slopes, at_slopes, NY * ND);
}

static int linearise_interval(controller* m, int k) {
  const double t0 = m->time + k * CONTROLLER_INTERVAL;
  double s[CONTROLLER_SIZE(NS)], slopes[CONTROLLER_SIZE(NY * ND)];
  double *h = m->hessian + k * ND * ND, *g = m->gradient + k * ND;
  if (!tree_state(t0, m->x + k * NX, m->p, m->q + k * NQ, s, slopes, m->w)) return 0;
  linearise_rows(m, k, t0, s, slopes, 0);
  set_zero(h, ND * ND);
  set_zero(g, ND);
  for (int r = 0; r < CONTROLLER_STEPS; ++r)
    advance(m, k, t0 + r * (CONTROLLER_INTERVAL / CONTROLLER_STEPS), s, slopes);
  double rows[CONTROLLER_SIZE(NQ)], by_q[CONTROLLER_SIZE(NQ * NQ)], speeds[CONTROLLER_SIZE(NQ)];
  double by_v[CONTROLLER_SIZE(NQ * NQ)], turn[CONTROLLER_SIZE(NQ * NQ)];
  const double end = t0 + CONTROLLER_INTERVAL;
  if (NI > 0) linearise_rows(m, k, end, s, slopes, 1);
  const double* arg[5] = {&end, s, s + NQ, s + 2 * NQ, m->p};
  double* res[7] = {rows, speeds, by_q, by_v, turn, 0, 0};
  controller_pose(arg, res, m->w);
  for (int i = NX + NU; i < ND; ++i) h[i + i * ND] = 1.0; /* places of the end alone */
  double *map = m->map + k * NX * ND, *miss = m->miss + k * NX;
  const double* x = m->x + (k + 1) * NX;
  copy_to(m->q + (k + 1) * NQ, s, NQ); /* the loops of the next state stay on the branch of the motion */
  for (int i = 0; i < NW; ++i) miss[i] = rows[NQ - NW + i] - x[i];
  for (int i = 0; i < NB; ++i) miss[NW + i] = speeds[NQ - NB + i] - x[NW + i];
  for (int i = 0; i < NZ; ++i) miss[NW + NB + i] = s[2 * NQ + i] - x[NW + NB + i];
  for (int c = 0; c < ND; ++c) {
    const double* by = slopes + c * NY;
    double* to = map + c * NX;
    set_zero(to, NX);
    for (int j = 0; j < NQ; ++j) {
      for (int i = 0; i < NW; ++i) to[i] += by_q[NQ - NW + i + j * NQ] * by[j];
      for (int i = 0; i < NB; ++i)
        to[NW + i] += turn[NQ - NB + i + j * NQ] * by[j] + by_v[NQ - NB + i + j * NQ] * by[NQ + j];
    }
    for (int i = 0; i < NZ; ++i) to[NW + NB + i] = by[2 * NQ + i];
  }
  return all_finite(map, NX * ND) && all_finite(miss, NX) && all_finite(g, ND) && all_finite(h, ND * ND) &&
         all_finite(m->row + k * NC, NK) && all_finite(m->row_slopes + k * NC * ND, NK * ND);
}

static int linearise_end(controller* m) {
  const double t = m->time + N * CONTROLLER_INTERVAL;
  double s[CONTROLLER_SIZE(NS)], slopes[CONTROLLER_SIZE(NY * ND)], value, by[CONTROLLER_SIZE(NS)];
  double bend[CONTROLLER_SIZE(NS * NS)], rows[CONTROLLER_SIZE(NE * NS)];
  double price[CONTROLLER_SIZE(NT)], by_amount[CONTROLLER_SIZE(NE * NT)];
  double *h = m->hessian + N * ND * ND, *g = m->gradient + N * ND;
  if (!tree_state(t, m->x + N * NX, m->p, m->q + N * NQ, s, slopes, m->w)) return 0;
  const double* arg[5] = {&t, s, s + NQ, s + 2 * NQ, m->p};
  double* res[7] = {&value, by, bend, m->row + N * NC, rows, price, by_amount};
  controller_end(arg, res, m->w);
  m->cost += value;
  set_zero(h, ND * ND);
  set_zero(g, ND);
  set_zero(m->row_slopes + N * NC * ND, NC * ND);
  add_curvature(h, 1.0, bend, slopes, NS, NX);
  for (int c = 0; c < NX; ++c)
    for (int i = 0; i < NS; ++i) g[c] += by[i] * slopes[i + c * NY];
  if (NE > 0) add_product(m->row_slopes + N * NC * ND, rows, slopes, NE, NS, NX, NY);
  for (int j = 0; j < NT; ++j) { /* soft limits are passed by as much as they have to be */
    const double* by_this = by_amount + j * NE;
    double amount = -1e300;
    for (int i = 0; i < NE; ++i)
      if (by_this[i] < 0.0) amount = fmax(amount, -m->row[N * NC + i] / by_this[i]);
    for (int i = 0; i < NE; ++i) m->row[N * NC + i] += by_this[i] * amount;
    copy_to(m->row_slopes + N * NC * ND + (NX + j) * NE, by_this, NE);
    g[NX + j] = price[j];
    m->cost += price[j] * amount;
  }
  for (int i = NX + NT; i < ND; ++i) h[i + i * ND] = 1.0;
  return all_finite(g, ND) && all_finite(h, ND * ND) && all_finite(m->row + N * NC, NE) &&
         all_finite(m->row_slopes + N * NC * ND, NC * ND);
}

/* Linearise equations, cost and limits about the plan; 0 if something has no value there. */
static int linearise(controller* m) {
  m->cost = 0.0;
  for (int k = 0; k < N; ++k)
    if (!linearise_interval(m, k)) return 0;
  return linearise_end(m);
}

/* --- the quadratic program: an interior point method, whose steps are a Riccati recursion --------------------- */

static int rows_at(int k) { return k < N ? NK : NE; }

/* 0: the row does not count, 1: a limit, 2: an equality. */
static int kind_of(int k, int i) {
  if (k == N) return controller_end_kinds[i];
  return k > 0 || i >= NR || controller_row_has_input[i]; /* the first state is given */
}

/* Factors of the recursion, under weights of the rows; 0 if the program is not convex along the motion. */
static int factor_program(controller* m, int with_rows) {
  for (int k = N; k >= 0; --k) {
    double* f = m->factors + k * ND * ND;
    double* cost_to_go = m->cost_to_go + k * NX * NX;
    copy_to(f, m->hessian + k * ND * ND, ND * ND);
    if (with_rows)
      for (int i = 0; i < rows_at(k); ++i) {
        const double* c = m->row_slopes + k * NC * ND + i;
        const int count = rows_at(k);
        if (!kind_of(k, i)) continue;
        for (int j = 0; j < ND; ++j)
          if (c[j * count] != 0.0)
            for (int l = 0; l < ND; ++l) f[l + j * ND] += m->weight[k * NC + i] * c[j * count] * c[l * count];
      }
    if (k < N) {
      const double* map = m->map + k * NX * ND;
      double product[CONTROLLER_SIZE(NX * ND)];
      set_zero(product, NX * ND);
      add_product(product, m->cost_to_go + (k + 1) * NX * NX, map, NX, NX, ND, NX);
      for (int j = 0; j < ND; ++j)
        for (int i = 0; i <= j; ++i) {
          double sum = 0.0;
          for (int l = 0; l < NX; ++l) sum += map[l + i * NX] * product[l + j * NX];
          f[i + j * ND] += sum;
          if (i != j) f[j + i * ND] += sum;
        }
    }
    /* Cholesky factors of the part of the inputs, lower, and the gains in the rows of the inputs */
    for (int j = NX; j < ND; ++j) {
      double d = f[j + j * ND];
      for (int l = NX; l < j; ++l) d -= f[j + l * ND] * f[j + l * ND];
      if (!(d > 1e-13 * fabs(f[j + j * ND]) && d > 1e-200)) return 0;
      d = f[j + j * ND] = sqrt(d);
      for (int i = j + 1; i < ND; ++i) {
        double sum = f[i + j * ND];
        for (int l = NX; l < j; ++l) sum -= f[i + l * ND] * f[j + l * ND];
        f[i + j * ND] = sum / d;
      }
    }
    for (int c = 0; c < NX; ++c) /* L^-1 M_ux */
      for (int j = NX; j < ND; ++j) {
        double sum = f[j + c * ND];
        for (int l = NX; l < j; ++l) sum -= f[j + l * ND] * f[l + c * ND];
        f[j + c * ND] = sum / f[j + j * ND];
      }
    for (int j = 0; j < NX; ++j)
      for (int i = 0; i <= j; ++i) {
        double sum = f[i + j * ND];
        for (int l = NX; l < ND; ++l) sum -= f[l + i * ND] * f[l + j * ND];
        cost_to_go[i + j * NX] = cost_to_go[j + i * NX] = sum;
      }
  }
  return 1;
}

/* Minimise by the factors: `linear` (ND each) is the slope of the cost; `first` the change of the first state, with
   which the misses of the plan count, or null for a direction along which the equations stay met. */
static void solve_program(controller* m, const double* linear, const double* first, double* d) {
  double p[CONTROLLER_SIZE(NX)], sum[CONTROLLER_SIZE(NX)];
  set_zero(p, NX);
  for (int k = N; k >= 0; --k) {
    const double *f = m->factors + k * ND * ND, *map = m->map + k * NX * ND;
    double* y = d + k * ND; /* L^-1 m_u in the place of the inputs */
    copy_to(y, linear + k * ND, ND);
    if (k < N) {
      copy_to(sum, p, NX);
      if (first) add_product(sum, m->cost_to_go + (k + 1) * NX * NX, m->miss + k * NX, NX, NX, 1, NX);
      for (int j = 0; j < ND; ++j)
        for (int l = 0; l < NX; ++l) y[j] += map[l + j * NX] * sum[l];
    }
    for (int j = NX; j < ND; ++j) {
      for (int l = NX; l < j; ++l) y[j] -= f[j + l * ND] * y[l];
      y[j] /= f[j + j * ND];
    }
    for (int j = 0; j < NX; ++j) {
      p[j] = y[j];
      for (int l = NX; l < ND; ++l) p[j] -= f[l + j * ND] * y[l];
    }
  }
  if (first)
    copy_to(d, first, NX);
  else
    set_zero(d, NX);
  for (int k = 0; k <= N; ++k) {
    const double* f = m->factors + k * ND * ND;
    double *x = d + k * ND, *u = x + NX, *next = d + (k + 1) * ND;
    for (int j = 0; j < NV; ++j) {
      for (int l = 0; l < NX; ++l) u[j] += f[NX + j + l * ND] * x[l];
      u[j] = -u[j];
    }
    for (int j = NV - 1; j >= 0; --j) { /* L^-T */
      for (int l = j + 1; l < NV; ++l) u[j] -= f[NX + l + (NX + j) * ND] * u[l];
      u[j] /= f[NX + j + (NX + j) * ND];
    }
    if (k == N) break;
    if (first)
      copy_to(next, m->miss + k * NX, NX);
    else
      set_zero(next, NX);
    add_product(next, m->map + k * NX * ND, x, NX, ND, 1, ND);
  }
}

/* Slope of the cost of the program at a change d of the plan, without its rows; returns the cost. */
static double slope_of_cost(const controller* m, const double* d, double* slope) {
  double cost = 0.0;
  for (int k = 0; k <= N; ++k) {
    double *to = slope + k * ND, twice = 0.0;
    copy_to(to, m->gradient + k * ND, ND);
    add_product(to, m->hessian + k * ND * ND, d + k * ND, ND, ND, 1, ND);
    for (int i = 0; i < ND; ++i) twice += (to[i] + m->gradient[k * ND + i]) * d[k * ND + i];
    cost += 0.5 * twice;
  }
  return cost;
}

/* Value of a row along a direction. */
static double along(const controller* m, int k, int i, const double* d) {
  const double* c = m->row_slopes + k * NC * ND + i;
  const int count = rows_at(k);
  double sum = 0.0;
  for (int j = 0; j < ND; ++j) sum += c[j * count] * d[k * ND + j];
  return sum;
}

/* By what Newton's method divides the multiplier of a limit: its slack, and what it gives way to its multiplier. */
static double stiffness_of(const controller* m, int at) { return m->slack[at] + m->give[at] * m->multiplier[at]; }

/* Direction of Newton's method for `centring`, with a share of the products of the last direction. */
static void find_direction(controller* m, double centring, double share) {
  double* linear = m->linear;
  copy_to(linear, m->slope, (N + 1) * ND);
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      const int at = k * NC + i, kind = kind_of(k, i), count = rows_at(k);
      const double* c = m->row_slopes + k * NC * ND + i;
      if (!kind) continue;
      double force;
      if (kind == 2)
        force = m->multiplier[at] + m->weight[at] * m->left[at];
      else {
        m->target[at] = centring - m->slack[at] * m->multiplier[at];
        if (share > 0.0) m->target[at] -= share * m->slack_step[at] * m->multiplier_step[at];
        force = m->multiplier[at] + (m->target[at] + m->multiplier[at] * m->left[at]) / stiffness_of(m, at);
      }
      for (int j = 0; j < ND; ++j) linear[k * ND + j] += c[j * count] * force;
    }
  solve_program(m, linear, 0, m->direction);
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      const int at = k * NC + i, kind = kind_of(k, i);
      if (!kind) continue;
      const double change = along(m, k, i, m->direction);
      if (kind == 2) {
        m->multiplier_step[at] = m->weight[at] * (m->left[at] + change);
        continue;
      }
      m->multiplier_step[at] = (m->target[at] + m->multiplier[at] * (m->left[at] + change)) / stiffness_of(m, at);
      m->slack_step[at] = m->give[at] * m->multiplier_step[at] - m->left[at] - change;
    }
}

/* Largest step, at most 1, along which slacks and multipliers stay positive; the gap there. */
static double longest_step(const controller* m, double* gap) {
  double step = 1.0;
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      const int at = k * NC + i;
      if (kind_of(k, i) != 1) continue;
      if (m->slack_step[at] < 0.0) step = fmin(step, -m->slack[at] / m->slack_step[at]);
      if (m->multiplier_step[at] < 0.0) step = fmin(step, -m->multiplier[at] / m->multiplier_step[at]);
    }
  *gap = 0.0;
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      const int at = k * NC + i;
      if (kind_of(k, i) == 1)
        *gap += (m->slack[at] + step * m->slack_step[at]) * (m->multiplier[at] + step * m->multiplier_step[at]);
    }
  return step;
}

/* Values of the rows at the change of the plan, beyond the slacks; returns the largest. */
static double rows_left(controller* m) {
  double largest = 0.0;
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      const int at = k * NC + i, kind = kind_of(k, i);
      if (!kind) continue;
      m->left[at] = m->row[at] + along(m, k, i, m->change) + (kind == 1 ? m->slack[at] - m->give[at] * m->multiplier[at] : 0.0);
      largest = fmax(largest, fabs(m->left[at]));
    }
  return largest;
}

/* The change of the plan from the limits alone, if the cost by itself has no least value. */
static int begin_inside(controller* m, const double* first, double size) {
  copy_to(m->linear, m->gradient, (N + 1) * ND);
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      const int at = k * NC + i, count = rows_at(k);
      const double *c = m->row_slopes + k * NC * ND + i, slack = fmax(fabs(m->row[at]), 1.0);
      m->weight[at] = size / (slack * slack);
      if (kind_of(k, i))
        for (int j = 0; j < ND; ++j) m->linear[k * ND + j] += c[j * count] * size / slack;
    }
  if (!factor_program(m, 1)) return 0;
  solve_program(m, m->linear, first, m->change);
  return 1;
}

/* Solve for the change of the plan under a change of its first state; 0 if the limits cannot be met, -1 if steps go
   round in a cycle with the limits met, as they may with whole products; products that are not whole are slow from far.
   With a price, limits that the state decides on may be passed. */
static int try_quadratic(controller* m, const double* first, int at_price, int whole) {
  int limits = 0, equalities = 0;
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      limits += kind_of(k, i) == 1;
      equalities += kind_of(k, i) == 2;
    }
  m->quadratic_steps = 0;
  if (factor_program(m, 0))
    solve_program(m, m->gradient, first, m->change);
  else if (!begin_inside(m, first, fabs(m->cost) + 1.0))
    return 0;
  else
    limits += !limits; /* what is free has no least cost: the limits decide */
  if (!all_finite(m->change, (N + 1) * ND)) return 0;
  double size = fabs(m->cost) + fabs(slope_of_cost(m, m->change, m->slope)), worst = 0.0;
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      if (!kind_of(k, i)) continue;
      m->slack[k * NC + i] = -m->row[k * NC + i] - along(m, k, i, m->change);
      worst = fmax(worst, -m->slack[k * NC + i]);
    }
  if (limits + equalities == 0 || (equalities == 0 && worst <= 0.0 && factor_program(m, 0))) return 1;
  double largest = 0.0, unit = 0.0;
  for (int i = 0; i < NX; ++i) largest = fmax(largest, fabs(m->hessian[N * ND * ND + i + i * ND]));
  for (int i = 0; i < (N + 1) * ND; ++i) unit = fmax(unit, fabs(m->hessian[i / ND * ND * ND + i % ND * (ND + 1)]));
  size = fmax(size, 1e-12);
  for (int k = 0; k <= N; ++k)
    for (int i = 0; i < rows_at(k); ++i) {
      const int at = k * NC + i, count = rows_at(k);
      m->slack[at] = fmax(m->slack[at], fmax(worst, 1e-6));
      m->give[at] = 0.0;
      for (int j = 0; at_price && j < NX; ++j)
        if (m->row_slopes[k * NC * ND + i + j * count] != 0.0) m->give[at] = 1.0 / (PASSING_PRICE * (size + unit));
      m->multiplier[at] = kind_of(k, i) == 2 ? 0.0 : size / limits / m->slack[at];
    }
  double off = 1.0; /* share of the slope that is left */
  for (int step = 0; step < POINT_STEPS; ++step) {
    const double left = rows_left(m);
    double gap = 0.0, ahead;
    for (int k = 0; k <= N; ++k)
      for (int i = 0; i < rows_at(k); ++i) {
        const int at = k * NC + i, kind = kind_of(k, i);
        if (kind == 1) gap += m->slack[at] * m->multiplier[at];
        m->weight[at] = kind == 2 ? EQUALITY_WEIGHT * (1.0 + largest) : m->multiplier[at] / stiffness_of(m, at);
      }
    const int is_met = left <= ROW_MISS && off <= 1e-9;
    size = fmax(fabs(m->cost) + fabs(slope_of_cost(m, m->change, m->slope)), 1e-12);
    m->quadratic_steps = step;
    if (is_met && gap <= GAP * size) return 1;
    if (!factor_program(m, 1)) return is_met && gap <= LARGEST_GAP * size;
    double centring = 0.0, reach = 0.0;
    if (limits > 0) {
      find_direction(m, 0.0, 0.0);
      reach = longest_step(m, &ahead);
      const double share = ahead / gap;
      centring = share * share * share * gap / limits;
    }
    find_direction(m, centring, whole && limits > 0 ? 1.0 : reach);
    if (!all_finite(m->direction, (N + 1) * ND)) return is_met && gap <= LARGEST_GAP * size;
    double length = longest_step(m, &ahead);
    if (length < 1.0) length *= SHORT_OF_LIMIT;
    off *= 1.0 - length;
    for (int k = 0; k <= N; ++k) {
      for (int j = 0; j < ND; ++j) m->change[k * ND + j] += length * m->direction[k * ND + j];
      for (int i = 0; i < rows_at(k); ++i) {
        const int at = k * NC + i;
        if (kind_of(k, i) == 1) m->slack[at] += length * m->slack_step[at];
        m->multiplier[at] += length * m->multiplier_step[at];
      }
    }
    if (length < 1e-8) return is_met && gap <= LARGEST_GAP * size;
  }
  return off <= 1e-9 ? -1 : 0;
}

static int solve_quadratic(controller* m, const double* first, int at_price) {
  const int found = try_quadratic(m, first, at_price, 1);
  return (found < 0 ? try_quadratic(m, first, at_price, 0) : found) > 0;
}
