/* One instance of a controller in a functional mock-up unit: samples and values; the same for every version of FMI.

   Samples are taken at the start and then at the begin of communication steps in which they fall, from the measured
   states that are set there. All that changes is one block of doubles, so that a saved state is a copy of it. */

/* Places of single numbers in the block. */
enum { IDENTITY, TIME, START_TIME, SAMPLES, STATE_OF_STEP, MODE, IS_UNSETTLED, SLOPE, SCALARS };

#define N_X 0
#define N_INPUTS 0
#define N_INDICATORS 0
#define MEMORY ((sizeof(controller) + sizeof(double) - 1) / sizeof(double))
#define BLOCK (SCALARS + CONTROLLER_STATES + CONTROLLER_PARAMETERS + CONTROLLER_INPUTS + MEMORY)
/* value references: time, measured states, parameters, inputs of the machine, status */
#define FIRST_INPUT 1
#define FIRST_PARAMETER (FIRST_INPUT + CONTROLLER_STATES)
#define FIRST_OUTPUT (FIRST_PARAMETER + CONTROLLER_PARAMETERS)
#define STATUS_OUTPUT (FIRST_OUTPUT + CONTROLLER_INPUTS)

struct instance {
  double *block, *measured, *p, *out, *x, *xdot, *levels;
  controller* memory;
  report_t report;
  void* host;
};

static const int INPUT_PLACES[] = {0};
static const double NOMINALS[] = {0};

static void reset(instance* s) {
  memset(s->block, 0, sizeof(double) * BLOCK);
  s->block[IDENTITY] = MODEL_IDENTITY;
  s->block[IS_UNSETTLED] = 1.0;
  controller_example(s->measured, s->p);
  controller_reset(s->memory);
}

static void dismiss(instance* s) {
  if (!s) return;
  free(s->block);
  free(s);
}

static instance* create(report_t report, void* host) {
  instance* s = calloc(1, sizeof(instance));
  if (!s) return NULL;
  s->report = report;
  s->host = host;
  s->block = calloc(BLOCK, sizeof(double));
  if (!s->block) { dismiss(s); return NULL; }
  s->measured = s->block + SCALARS;
  s->p = s->measured + CONTROLLER_STATES;
  s->out = s->p + CONTROLLER_PARAMETERS;
  s->memory = (controller*)(s->out + CONTROLLER_INPUTS);
  s->x = s->xdot = s->block;
  s->levels = s->block + SLOPE; /* slopes of inputs have no meaning for samples */
  reset(s);
  return s;
}

static void set_experiment(instance* s, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
  (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
  s->block[START_TIME] = s->block[TIME] = start;
  s->block[IS_UNSETTLED] = 1.0;
}

static void sample(instance* s, double time) {
  s->block[STATE_OF_STEP] = controller_step(s->memory, time, s->measured, s->p, s->out);
  s->block[SAMPLES] += 1.0;
}

/* Take the sample of the start. */
static int settle(instance* s) {
  if (s->block[IS_UNSETTLED] == 0.0) return OK_;
  s->block[IS_UNSETTLED] = s->block[SAMPLES] = 0.0;
  controller_reset(s->memory);
  sample(s, s->block[START_TIME]);
  return OK_;
}

static void changed(instance* s) { (void)s; }
static void turned(instance* s) { (void)s; }
static void count_slopes_from_now(instance* s) { (void)s; }
static int update_derivatives(instance* s) { (void)s; return OK_; }
static void find_indicators(instance* s, double t, const double* x, double* values) {
  (void)s; (void)t; (void)x; (void)values;
}

static int derivative_along(instance* s, const unsigned unknown[], size_t unknowns, const unsigned known[],
                            size_t knowns, const double seed[], double result[]) {
  (void)unknown; (void)unknowns; (void)known; (void)knowns; (void)seed; (void)result;
  say(s, ERROR_, "a controller has no directional derivatives");
  return ERROR_;
}

static int get_values(instance* s, const unsigned vr[], size_t count, double value[]) {
  for (size_t i = 0; i < count; ++i) {
    if (vr[i] >= FIRST_OUTPUT) settle(s);
    if (vr[i] == 0) value[i] = s->block[TIME];
    else if (vr[i] < FIRST_OUTPUT) value[i] = s->measured[vr[i] - FIRST_INPUT];
    else if (vr[i] < STATUS_OUTPUT) value[i] = s->out[vr[i] - FIRST_OUTPUT];
    else if (vr[i] == STATUS_OUTPUT) value[i] = s->block[STATE_OF_STEP];
    else { say(s, ERROR_, "there is no variable of the value reference %u", vr[i]); return ERROR_; }
  }
  return OK_;
}

static int set_values(instance* s, const unsigned vr[], size_t count, const double value[]) {
  for (size_t i = 0; i < count; ++i) {
    if (vr[i] < FIRST_INPUT || vr[i] >= FIRST_OUTPUT) {
      say(s, ERROR_, "only measured states and parameters are set, not the value reference %u", vr[i]);
      return ERROR_;
    }
    s->measured[vr[i] - FIRST_INPUT] = value[i];
  }
  if (s->block[MODE] <= INITIALIZING) s->block[IS_UNSETTLED] = 1.0;
  return OK_;
}

/* Samples of a communication step, from the states that are measured at its begin. */
static int step_to(instance* s, double end) {
  settle(s);
  for (;;) {
    const double due = s->block[START_TIME] + s->block[SAMPLES] * CONTROLLER_SAMPLE;
    if (!(due < end - 1e-9 * CONTROLLER_SAMPLE)) break;
    sample(s, due);
  }
  s->block[TIME] = end;
  return OK_;
}
