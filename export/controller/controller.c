/* ---- elementary functions -------------------------------------------------- */

@ELEMENTARY@
/* ---- constants -------------------------------------------------------------- */

@TABLES@
/* ---- functions of the problem ------------------------------------------------ */

@FUNCTIONS@
/* ---- the controller -------------------------------------------------------- */

/* Runs a generated function, and counts its operations. */
#define RUN(name) (name(m), m->operations += OPERATIONS_##name)

static real clipped(real value, real least, real most)
{
  return value > most ? most : value >= least ? value : least;
}

static int is_finite(const real values[], int count)
{
  int i;
  for (i = 0; i < count; ++i) {
    /* The difference of an infinite value, or of NaN, is NaN. */
    if (!(values[i] - values[i] == 0)) {
      return 0;
    }
  }
  return 1;
}

/* Known data of one interval, of all of them, and of both ends. */
static void take_known(memory_t *m, const real parameters[], const real signals[])
{
  (void)m;
  (void)parameters;
  (void)signals;
@KNOWN@}

/* Cost and violation of a plan, and the path that it leads to. */
static trial_t rolled(memory_t *m, const real x[NX], const real plan[N * NU],
                      real path[N * NX])
{
  real here[NX], after[NX], cost, broken;
  trial_t found;
  int k;
  found.cost = 0;
  found.size = 0;
  found.violation = 0;
@BEGIN@  memcpy(here, x, sizeof here);
  for (k = 0; k < N; ++k) {
    f_interval(here, plan + k * NU, m->p, SIGNALS(k), after, &cost, &broken);
    m->operations += OPERATIONS_f_interval;
    found.cost += cost;
    found.size += cost < 0 ? -cost : cost;
    found.violation += broken;
    memcpy(here, after, sizeof here);
    memcpy(path + k * NX, after, sizeof after);
  }
  f_end(here, m->p, SIGNALS(N), &cost, &broken);
  m->operations += OPERATIONS_f_end;
  found.cost += cost;
  found.size += cost < 0 ? -cost : cost;
  found.violation += broken;
  /* Not-a-number compares false. The violation of a state that is none is infinite. */
  if (!(found.size + found.violation < LARGEST)) {
    found.violation = INFINITE;
    found.cost = INFINITE;
    found.size = INFINITE;
  }
  return found;
}

static int is_better(const trial_t *one, const trial_t *other)
{
  const real broken = one->violation > TOLERANCE ? one->violation : 0;
  const real other_broken = other->violation > TOLERANCE ? other->violation : 0;
  if (!(one->cost < LARGEST)) {
    return 0;
  }
  if (!(other->cost < LARGEST)) {
    return 1;
  }
  return broken < other_broken
    || (broken == other_broken && one->cost < other->cost);
}

/* Signals at both ends of a step of the integrator in interval k. */
static void ends_of(const memory_t *m, int k, int step, real a[NS + 1], real b[NS + 1])
{
  const real *first = SIGNALS(k) + step / STEPS * NS;
  const real here = (real)(step % STEPS) / (real)STEPS;
  const real after = (real)(step % STEPS + 1) / (real)STEPS;
  int i;
  (void)k;
  (void)first;
  (void)here;
  (void)after;
  for (i = 0; i < NS; ++i) {
    a[i] = first[i] + here * (first[i + NS] - first[i]);
    b[i] = first[i] + after * (first[i + NS] - first[i]);
  }
}

/* The states after all steps of interval k, in scaled numbers. Returns the cost. */
static real follow(memory_t *m, int k, const real x[NX], const real u[INPUTS])
{
  real a[NS + 1], b[NS + 1], total = 0, cost;
  int j;
  memcpy(m->y, x, NX * sizeof m->y[0]);
  for (j = 0; j < ALL_STEPS; ++j) {
    ends_of(m, k, j, a, b);
    f_step(m->y + j * NX, u, m->p, m->lane.interval_unit, c_interval_shared, a, b,
           m->y + (j + 1) * NX, &cost);
    total += cost;
  }
  m->operations += ALL_STEPS * (OPERATIONS_f_step + 1);
  return total;
}

/* The integral, the state after each interval and their gradient, at a trial point. */
static void derive_trial(memory_t *m)
{
  real x[NX], u[INPUTS], p[NX], g[NZ], a[NS + 1], b[NS + 1];
  const real alpha = m->lane.alpha[0];
  int k, i, j;
  for (k = 0; k < N; ++k) {
    for (i = 0; i < NX; ++i) {
      x[i] = k == 0 ? m->lane.x0_new[i]
        : m->lane.xa[(k - 1) * NX + i] + alpha * m->lane.d_xa[(k - 1) * NX + i];
      p[i] = m->lane.lam[k * NX + i] + alpha * m->lane.d_lam[k * NX + i];
    }
    for (i = 0; i < INPUTS; ++i) {
      u[i] = m->lane.u[k * INPUTS + i] + alpha * m->lane.d_u[k * INPUTS + i];
      m->lane.G_new[k * NZ + NX + i] = 0;
    }
    m->lane.L_new[k] = follow(m, k, x, u);
    memcpy(m->lane.F_new + k * NX, m->y + ALL_STEPS * NX, NX * sizeof x[0]);
@PULL_NEW@    for (j = ALL_STEPS - 1; j >= 0; --j) {
      ends_of(m, k, j, a, b);
      f_adjoint(m->y + j * NX, u, p, m->p, m->lane.interval_unit, c_interval_shared, a,
                b, g);
      memcpy(p, g, sizeof p);
      for (i = 0; i < INPUTS; ++i) {
        m->lane.G_new[k * NZ + NX + i] += g[NX + i];
      }
    }
    memcpy(m->lane.G_new + k * NZ, p, sizeof p);
    m->operations += ALL_STEPS * (OPERATIONS_f_adjoint + INPUTS) + 4 * NZ;
  }
}

/* State behind the steps of each interval, its Jacobian, the gradient of the integral,
   and the second derivatives of the Lagrangian. */
static void derive(memory_t *m)
{
  real a[NS + 1], b[NS + 1], p[NX], g[NZ], W[NX * NZ], V[NZ * (NZ + 1) / 2];
  int k, i, j;
  for (k = 0; k < N; ++k) {
    const real *u = m->lane.u + k * INPUTS;
    real *J = m->lane.J + k * NX * NZ, *Gc = m->lane.Gc + k * NZ;
    real *H = m->lane.H + k * (NZ * (NZ + 1) / 2);
    (void)follow(m, k, m->lane.x + k * NX, u);
    memcpy(m->lane.F + k * NX, m->y + ALL_STEPS * NX, NX * sizeof p[0]);
    for (i = 0; i < NX; ++i) {
      p[i] = m->lane.lam[k * NX + i];
    }
@PULL@    memset(Gc, 0, sizeof g);
    memset(J, 0, sizeof W);
    memset(H, 0, sizeof V);
    for (i = 0; i < NX; ++i) {
      J[i * NX + i] = 1;
    }
    for (j = ALL_STEPS - 1; j >= 0; --j) {
      real q[NX];
      ends_of(m, k, j, a, b);
      f_before(m->y + j * NX, u, p, Gc, J, H, m->p, m->lane.interval_unit,
               c_interval_shared, a, b, q, g, W, V);
      memcpy(p, q, sizeof p);
      memcpy(Gc, g, sizeof g);
      memcpy(J, W, sizeof W);
      memcpy(H, V, sizeof V);
    }
  }
  m->operations += OPERATIONS_DERIVE;
}

/* The state after an interval in scaled numbers; 0 if it is not a tame one. */
static int led(memory_t *m, const real x[NX], int k, real after[NX])
{
  real here[NX], next[NX], cost, broken;
  int i, tame = 1;
  for (i = 0; i < NX; ++i) {
    here[i] = x[i] * size_x[i];
  }
  f_interval(here, m->start_plan + k * NU, m->p, SIGNALS(k), next, &cost, &broken);
  m->operations += OPERATIONS_f_interval + NX;
  for (i = 0; i < NX; ++i) {
    after[i] = next[i] / size_x[i];
    tame = tame && after[i] > -WILD && after[i] < WILD;
  }
  return tame;
}

/* The states that the controls lead to; the first state instead of wild ones. */
static void lead(memory_t *m)
{
  const real *here = m->lane.fixed;
  int k;
  for (k = 0; k < N; ++k) {
    real *after = m->lane.xa + k * NX;
    if (!led(m, here, k, after)) {
      if (k > 0) {
        memcpy(m->lane.xa + (k - 1) * NX, m->lane.fixed, NX * sizeof after[0]);
      }
      if (!led(m, m->lane.fixed, k, after)) {
        memcpy(after, m->lane.fixed, NX * sizeof after[0]);
      }
    }
    here = after;
  }
}

/* A unit of the cost from the size of a start's cost. */
static void take_unit(memory_t *m)
{
  real unit;
  int i;
  /* Without prices and forces of the walls, the residual is the slope of the cost. */
  @NO_DUALS@
  m->lane.rho[0] = 0;
  RUN(k_trial);
  m->lane.rho[0] = FIRST_RHO;
  m->lane.spent[0] = m->lane.sums_new[0];
  m->lane.steep[0] = m->lane.tops_new[0];
  for (i = 0; i < NX; ++i) {
    const real slope = m->lane.force_start[i];
    m->lane.steep[0] = larger(m->lane.steep[0], slope < 0 ? -slope : slope);
  }
  RUN(k_finish);
  unit = m->lane.size[0];
  if (unit != unit || unit < LEAST_SIZE || unit <= 0) {
    unit = 1;
  }
  unit = clipped(unit, LEAST_UNIT, 1);
@UNIT@}

static void begin_lane(memory_t *m, const real x[NX], const real plan[N * NU],
                       const real *guess, real mu)
{
  int k, i;
  memset(&m->lane, 0, sizeof m->lane);
@BLANK@  for (i = 0; i < NX; ++i) {
    m->lane.fixed[i] = x[i] / size_x[i];
  }
  for (k = 0; k < N; ++k) {
    for (i = 0; i < NU; ++i) {
      m->start_plan[k * NU + i] = clipped(plan[k * NU + i], u_lower[i], u_upper[i]);
      m->lane.u[k * INPUTS + i] = m->start_plan[k * NU + i] / size_u[i];
    }
  }
  m->lane.mu[0] = mu;
  m->lane.rho[0] = FIRST_RHO;
@UNITS@  RUN(k_first);
  if (guess) {
    for (k = 0; k < N; ++k) {
      for (i = 0; i < NX; ++i) {
        m->lane.xa[k * NX + i] = guess[k * NX + i] / size_x[i];
      }
    }
  } else {
    lead(m);
  }
  RUN(k_settle);
  RUN(k_move);
  derive_trial(m);
  take_unit(m);
  /* By the rows at the states that follow. */
  RUN(k_settle);
}

/* An interior-point method from a plan. Returns 1 if it has found a local optimum,
   whose controls are in m->found. */
static int solved(memory_t *m, const real x[NX], const real plan[N * NU],
                  const real *guess, real mu)
{
  int turn, k, i, met = 0;
  begin_lane(m, x, plan, guess, mu);
  for (turn = 0; turn < TURNS; ++turn) {
    if (m->lane.tries[0] != 0) {
      RUN(k_move);
      derive_trial(m);
      RUN(k_trial);
      RUN(k_verdict);
@TAKE_OVER@      RUN(k_keep);
      if (m->lane.done[0] != 0) {
        met = m->lane.met[0] > 0;
        break;
      }
    }
    if (m->lane.tries[0] == 0) {
      derive(m);
      RUN(k_last);
      RUN(k_backward);
      RUN(k_start);
      RUN(k_along);
      RUN(k_aim);
@AIM@    }
  }
  m->iterations += (unsigned long)turn;
  for (k = 0; k < N; ++k) {
    for (i = 0; i < NU; ++i) {
      m->found[k * NU + i]
        = clipped(m->lane.u[k * INPUTS + i] * size_u[i], u_lower[i], u_upper[i]);
    }
  }
  m->operations += OPERATIONS_START;
  return met && is_finite(m->found, N * NU);
}

enum { BETTER = 1, OPTIMAL = 2 };

/* Solves from a plan, and keeps the answer if it is better than the best so far, or a
   feasible optimum that is dearer by less than `close`. */
static int tried(memory_t *m, const real x[NX], const real plan[N * NU],
                 const real *guess, real mu, real close, trial_t *best)
{
  const int met = solved(m, x, plan, guess, mu);
  int found = 0;
  if (is_finite(m->found, N * NU)) {
    const trial_t trial = rolled(m, x, m->found, m->found_path);
    const int optimal = met && trial.violation <= TOLERANCE;
    found = optimal ? OPTIMAL : 0;
    if (is_better(&trial, best)
        || (optimal && trial.cost - best->cost <= close * best->size)) {
      *best = trial;
      memcpy(m->plan, m->found, sizeof m->plan);
      memcpy(m->path, m->found_path, sizeof m->path);
      found |= BETTER;
    }
  }
  return found;
}

/* The plan one interval later. Its path continues with the appended controls. */
static void shift(memory_t *m)
{
  real last[NX], cost, broken;
  int i;
  memcpy(last, m->path + (N - 1) * NX, sizeof last);
  memmove(m->path, m->path + NX, sizeof m->path - NX * sizeof m->path[0]);
  memmove(m->plan, m->plan + NU, sizeof m->plan - NU * sizeof m->plan[0]);
  for (i = 0; i < NU; ++i) {
@APPEND@  }
  f_interval(last, m->plan + (N - 1) * NU, m->p, SIGNALS(N - 1), m->path + (N - 1) * NX,
             &cost, &broken);
  m->operations += OPERATIONS_f_interval;
  if (!is_finite(m->path, N * NX)) {
    for (i = 0; i < N * NX; ++i) {
      m->path[i] = last[i % NX];
    }
  }
}
@STARTS@@SET@
void NAME_reset(memory_t *m)
{
  memset(m, 0, sizeof *m);
  memcpy(m->plan, first_plan, sizeof m->plan);
@REMEMBERED_RESET@}

void NAME_model(const real x[NAME_NX], const real u[NAME_NU]@MODEL_GIVEN@, real after[NAME_NX])
{
@MODEL@}

int NAME_step(memory_t *m, const real x[NAME_NX]@GIVEN@, real u[NAME_NU])
{
  real here[NX];
  trial_t best;
  int i, warm, status = NAME_SHIFTED;
  m->operations = 0;
  m->iterations = 0;
  if (m->is_begun) {
    shift(m);
  }
  if (!is_finite(x, STATED)@GIVEN_FINITE@) {
@KEEP_INVALID@    memcpy(u, m->plan, NU * sizeof u[0]);
    m->status = NAME_INVALID;
    return NAME_INVALID;
  }
  take_known(m, @PASSED@);
  for (i = 0; i < STATED; ++i) {
    here[i] = x[i];
  }
@REMEMBERED@@LINEAR@  memcpy(m->guess, m->path, sizeof m->path);
  best = rolled(m, here, m->plan, m->path);
  /* The shifted plan stays in m->plan unless a better one is found. */
  memcpy(m->shifted, m->plan, sizeof m->plan);
  if (m->is_begun && best.size <= LITTLE * NOISE && best.violation <= TOLERANCE) {
    warm = OPTIMAL; /* There is nothing to gain. */
  } else if (m->is_begun) {
    warm = tried(m, here, m->shifted, m->guess, WARM_MU, CLOSE, &best);
  } else {
    warm = tried(m, here, m->shifted, 0, FIRST_MU, CLOSE, &best);
  }
  if (warm & BETTER) {
    status = NAME_PLANNED;
  }
@RESCUE@  m->is_begun = 1;
  m->cost = best.cost;
  m->size = best.size;
  m->violation = best.violation;
@KEEP@  memcpy(u, m->plan, NU * sizeof u[0]);
  m->status = status;
  return status;
}
