/* A controller that plans again at every sample. C99 with libm; it allocates nothing and keeps nothing outside its
   struct, so that any number of them may run side by side.

   State, by place:
@states@
   Inputs:
@inputs@
   Parameters:
@parameters@
*/
#ifndef CONTROLLER_H
#define CONTROLLER_H

@sizes@
/* time between two steps, and length of an interval of the plan */
@times@
/* what a step returns */
@statuses@

#define CONTROLLER_SIZE(n) ((n) > 0 ? (n) : 1)

/* The plan, and what has been computed about it. Nothing in it needs to be set but by controller_reset. */
typedef struct {
  int status, is_planned, is_prepared, samples, iterations, quadratic_steps;
  double time, cost; /* of the start of the plan, s; of the plan */
  double p[CONTROLLER_SIZE(CONTROLLER_PARAMETERS)];
  /* states (n + 1 of them), inputs (n), poses, and the inputs of the last plan that could be made */
  double x[(CONTROLLER_INTERVALS + 1) * CONTROLLER_STATES];
  double u[CONTROLLER_INTERVALS * CONTROLLER_UNKNOWN_INPUTS];
  double q[(CONTROLLER_INTERVALS + 1) * CONTROLLER_COORDINATES];
  double held[CONTROLLER_INTERVALS * CONTROLLER_UNKNOWN_INPUTS];
  double near[(CONTROLLER_INTERVALS + 1) * CONTROLLER_COORDINATES]; /* poses before a step that may be halved */
#define CONTROLLER_OTHERS \
  (CONTROLLER_UNKNOWN_INPUTS > CONTROLLER_END_INPUTS ? CONTROLLER_UNKNOWN_INPUTS : CONTROLLER_END_INPUTS)
#define CONTROLLER_BOTH (CONTROLLER_STATES + CONTROLLER_OTHERS)
#define CONTROLLER_ALL (CONTROLLER_INTERVALS + 1)
#define CONTROLLER_LIMITS CONTROLLER_SIZE(CONTROLLER_ALL * CONTROLLER_MOST_ROWS)
  /* linearisation */
  double map[CONTROLLER_INTERVALS * CONTROLLER_STATES * CONTROLLER_BOTH], miss[CONTROLLER_INTERVALS * CONTROLLER_STATES];
  double hessian[CONTROLLER_ALL * CONTROLLER_BOTH * CONTROLLER_BOTH], gradient[CONTROLLER_ALL * CONTROLLER_BOTH];
  double row[CONTROLLER_LIMITS], row_slopes[CONTROLLER_LIMITS * CONTROLLER_BOTH];
  /* quadratic program */
  double factors[CONTROLLER_ALL * CONTROLLER_BOTH * CONTROLLER_BOTH];
  double cost_to_go[CONTROLLER_ALL * CONTROLLER_STATES * CONTROLLER_STATES];
  double change[CONTROLLER_ALL * CONTROLLER_BOTH], direction[CONTROLLER_ALL * CONTROLLER_BOTH];
  double slope[CONTROLLER_ALL * CONTROLLER_BOTH], linear[CONTROLLER_ALL * CONTROLLER_BOTH];
  double slack[CONTROLLER_LIMITS], slack_step[CONTROLLER_LIMITS], multiplier[CONTROLLER_LIMITS];
  double multiplier_step[CONTROLLER_LIMITS], weight[CONTROLLER_LIMITS], left[CONTROLLER_LIMITS];
  double target[CONTROLLER_LIMITS], give[CONTROLLER_LIMITS];
  double w[CONTROLLER_SIZE(CONTROLLER_WORK)];
} controller;

/* Begin anew, without a plan; before the first step. */
void controller_reset(controller* m);

/* One sample: inputs, held until the next one, from time (s), state and parameters; returns the status. */
int controller_step(controller* m, double time, const double* state, const double* parameters, double* inputs);

/* The same in two parts: the inputs, as soon as there is a state, and then what can be computed before the next. */
int controller_feedback(controller* m, double time, const double* state, const double* parameters, double* inputs);
void controller_prepare(controller* m);

/* State and parameters of the assembled mechanism, for a trial. */
void controller_example(double* state, double* parameters);

#endif
