/* The interface of FMI 3.0, for co-simulation and model exchange.

   Functional Mock-up Interface Specification, version 3.0.1, Modelica Association 2023. */

#include "model.h"
#include "engine.c"
#include "instance.c"

#include <stdbool.h>
#include <stdint.h>

typedef void* fmi3Instance;
typedef void* fmi3InstanceEnvironment;
typedef void* fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef const char* fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte* fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String category, fmi3String message);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean*, fmi3Float64*);
typedef void (*fmi3Callback)(void);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);

#if defined(_WIN32)
#define SHOWN __declspec(dllexport)
#elif defined(__GNUC__)
#define SHOWN __attribute__((visibility("default")))
#else
#define SHOWN
#endif
#define PASTE(a, b) a##b
#define PASTED(a, b) PASTE(a, b)
#ifdef FMI3_FUNCTION_PREFIX
#define NAMED(name) PASTED(FMI3_FUNCTION_PREFIX, name)
#else
#define NAMED(name) name
#endif
#define STATUS SHOWN fmi3Status

typedef struct {
  instance* s;
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log;
  bool has_event_mode;
} unit;

static const fmi3Status STATUSES[] = {fmi3OK, fmi3Warning, fmi3Discard, fmi3Error};
static const char* const CATEGORIES[] = {"logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError"};

static void report(void* host, int status, const char* message) {
  unit* c = host;
  if (c->log) c->log(c->environment, STATUSES[status], CATEGORIES[status], message);
}

static instance* of(fmi3Instance c) { return ((unit*)c)->s; }

static fmi3Status refuse(fmi3Instance c, const char* message) {
  say(of(c), ERROR_, "%s", message);
  return fmi3Error;
}

SHOWN const char* NAMED(fmi3GetVersion)(void) { return "3.0"; }

STATUS NAMED(fmi3SetDebugLogging)(fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String categories[]) {
  (void)c; (void)on; (void)count; (void)categories;
  return fmi3OK;
}

static fmi3Instance instantiate(fmi3String token, int is_there, const char* refusal,
                                fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
  unit* c = calloc(1, sizeof(unit));
  if (!c) return NULL;
  c->environment = environment;
  c->log = log;
  if (!token || strcmp(token, MODEL_TOKEN)) report(c, ERROR_, "the token is that of another model description");
  else if (!is_there) report(c, ERROR_, refusal);
  else if ((c->s = create(report, c)) != NULL) return c;
  free(c);
  return NULL;
}

SHOWN fmi3Instance NAMED(fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
                                                       fmi3Boolean visible, fmi3Boolean logging,
                                                       fmi3InstanceEnvironment environment,
                                                       fmi3LogMessageCallback log) {
  (void)name; (void)resources; (void)visible; (void)logging;
  return instantiate(token, HAS_MODEL_EXCHANGE, "this unit was exported for co-simulation alone", environment, log);
}

SHOWN fmi3Instance NAMED(fmi3InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
  (void)name; (void)resources; (void)visible; (void)logging; (void)early_return; (void)intermediate; (void)count;
  (void)update;
  unit* c = instantiate(token, HAS_CO_SIMULATION, "this unit was exported for model exchange alone", environment, log);
  if (c) c->has_event_mode = event_mode;
  return c;
}

SHOWN fmi3Instance NAMED(fmi3InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback clock, fmi3Callback lock,
    fmi3Callback unlock) {
  (void)name; (void)resources; (void)visible; (void)logging; (void)clock; (void)lock; (void)unlock;
  return instantiate(token, 0, "this unit is for co-simulation and model exchange", environment, log);
}

SHOWN void NAMED(fmi3FreeInstance)(fmi3Instance component) {
  unit* c = component;
  if (!c) return;
  dismiss(c->s);
  free(c);
}

STATUS NAMED(fmi3EnterInitializationMode)(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                          fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop) {
  instance* s = of(c);
  if (has_tolerance && tolerance > 0.0) s->block[RELTOL] = tolerance;
  s->block[START_TIME] = s->block[TIME] = start;
  s->block[STOP_TIME] = has_stop ? stop : INFINITY;
  s->block[IS_UNSETTLED] = 1.0;
  s->block[MODE] = INITIALIZING;
  return fmi3OK;
}

STATUS NAMED(fmi3ExitInitializationMode)(fmi3Instance c) {
  instance* s = of(c);
  const int status = settle(s);
  if (status == OK_) s->block[MODE] = EVENT_MODE;
  return STATUSES[status];
}

STATUS NAMED(fmi3EnterEventMode)(fmi3Instance c) {
  of(c)->block[MODE] = EVENT_MODE;
  return fmi3OK;
}

STATUS NAMED(fmi3Terminate)(fmi3Instance c) {
  of(c)->block[MODE] = TERMINATED;
  return fmi3OK;
}

STATUS NAMED(fmi3Reset)(fmi3Instance c) {
  reset(of(c));
  return fmi3OK;
}

STATUS NAMED(fmi3GetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, fmi3Float64 value[],
                             size_t values) {
  int status = OK_;
  if (values != count) return refuse(c, "every variable of this unit is one number");
  for (size_t i = 0; i < count && status == OK_; ++i) status = get_value(of(c), vr[i], &value[i]);
  return STATUSES[status];
}

STATUS NAMED(fmi3SetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, const fmi3Float64 value[],
                             size_t values) {
  int status = OK_;
  if (values != count) return refuse(c, "every variable of this unit is one number");
  for (size_t i = 0; i < count && status == OK_; ++i) status = set_value(of(c), vr[i], value[i]);
  return STATUSES[status];
}

static fmi3Status no_such(fmi3Instance c, size_t count) {
  return count ? refuse(c, "all variables of this unit are of type Float64") : fmi3OK;
}

#define ABSENT(type, kind)                                                                                           \
  STATUS NAMED(fmi3Get##type)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, kind value[],             \
                              size_t values) {                                                                       \
    (void)vr; (void)value; (void)values;                                                                             \
    return no_such(c, count);                                                                                        \
  }                                                                                                                  \
  STATUS NAMED(fmi3Set##type)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, const kind value[],       \
                              size_t values) {                                                                       \
    (void)vr; (void)value; (void)values;                                                                             \
    return no_such(c, count);                                                                                        \
  }
ABSENT(Float32, float)
ABSENT(Int8, int8_t)
ABSENT(UInt8, uint8_t)
ABSENT(Int16, int16_t)
ABSENT(UInt16, uint16_t)
ABSENT(Int32, int32_t)
ABSENT(UInt32, uint32_t)
ABSENT(Int64, int64_t)
ABSENT(UInt64, uint64_t)
ABSENT(Boolean, fmi3Boolean)
ABSENT(String, fmi3String)

STATUS NAMED(fmi3GetBinary)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, size_t sizes[],
                            fmi3Binary value[], size_t values) {
  (void)vr; (void)sizes; (void)value; (void)values;
  return no_such(c, count);
}

STATUS NAMED(fmi3SetBinary)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, const size_t sizes[],
                            const fmi3Binary value[], size_t values) {
  (void)vr; (void)sizes; (void)value; (void)values;
  return no_such(c, count);
}

STATUS NAMED(fmi3GetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, fmi3Boolean value[]) {
  (void)vr; (void)value;
  return no_such(c, count);
}

STATUS NAMED(fmi3SetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, const fmi3Boolean value[]) {
  (void)vr; (void)value;
  return no_such(c, count);
}

STATUS NAMED(fmi3GetNumberOfVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t* count) {
  (void)vr; (void)count;
  return refuse(c, "the dependencies are those of the model description");
}

STATUS NAMED(fmi3GetVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t elements[],
                                          fmi3ValueReference independents[], size_t others[],
                                          fmi3DependencyKind kinds[], size_t count) {
  (void)vr; (void)elements; (void)independents; (void)others; (void)kinds; (void)count;
  return refuse(c, "the dependencies are those of the model description");
}

STATUS NAMED(fmi3GetFMUState)(fmi3Instance c, fmi3FMUState* state) {
  if (!*state) return (*state = save(of(c))) != NULL ? fmi3OK : fmi3Error;
  memcpy(*state, of(c)->block, SAVED_BYTES);
  return fmi3OK;
}

STATUS NAMED(fmi3SetFMUState)(fmi3Instance c, fmi3FMUState state) { return STATUSES[restore(of(c), state)]; }

STATUS NAMED(fmi3FreeFMUState)(fmi3Instance c, fmi3FMUState* state) {
  (void)c;
  if (state) { free(*state); *state = NULL; }
  return fmi3OK;
}

STATUS NAMED(fmi3SerializedFMUStateSize)(fmi3Instance c, fmi3FMUState state, size_t* size) {
  (void)c; (void)state;
  *size = SAVED_BYTES;
  return fmi3OK;
}

STATUS NAMED(fmi3SerializeFMUState)(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
  if (size < SAVED_BYTES || !state) return refuse(c, "the space is too small for a saved state");
  memcpy(bytes, state, SAVED_BYTES);
  return fmi3OK;
}

STATUS NAMED(fmi3DeserializeFMUState)(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState* state) {
  double identity = 0.0;
  if (size >= SAVED_BYTES) memcpy(&identity, bytes, sizeof identity);
  if (identity != MODEL_IDENTITY) return refuse(c, "the serialized state belongs to another model");
  if (!*state && !(*state = malloc(SAVED_BYTES))) return fmi3Error;
  memcpy(*state, bytes, SAVED_BYTES);
  return fmi3OK;
}

STATUS NAMED(fmi3GetDirectionalDerivative)(fmi3Instance c, const fmi3ValueReference unknown[], size_t unknowns,
                                           const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[],
                                           size_t seeds, fmi3Float64 result[], size_t results) {
  if (seeds != knowns || results != unknowns) return refuse(c, "every variable of this unit is one number");
  return STATUSES[derivative_along(of(c), unknown, unknowns, known, knowns, seed, result)];
}

STATUS NAMED(fmi3GetAdjointDerivative)(fmi3Instance c, const fmi3ValueReference unknown[], size_t unknowns,
                                       const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[],
                                       size_t seeds, fmi3Float64 result[], size_t results) {
  (void)unknown; (void)unknowns; (void)known; (void)knowns; (void)seed; (void)seeds; (void)result; (void)results;
  return refuse(c, "adjoint derivatives are not available");
}

STATUS NAMED(fmi3EnterConfigurationMode)(fmi3Instance c) { return refuse(c, "there are no structural parameters"); }

STATUS NAMED(fmi3ExitConfigurationMode)(fmi3Instance c) { return refuse(c, "there are no structural parameters"); }

/* Functions of clocks, by the types of what they take beyond the instance. */
#define NO_CLOCKS_2(name, A, B) \
  STATUS NAMED(name)(fmi3Instance c, A a, B b) { (void)a; (void)b; return refuse(c, "there are no clocks"); }
#define NO_CLOCKS_3(name, A, B, C) \
  STATUS NAMED(name)(fmi3Instance c, A a, B b, C d) { \
    (void)a; (void)b; (void)d; \
    return refuse(c, "there are no clocks"); \
  }
#define NO_CLOCKS_4(name, A, B, C, D) \
  STATUS NAMED(name)(fmi3Instance c, A a, B b, C d, D e) { \
    (void)a; (void)b; (void)d; (void)e; \
    return refuse(c, "there are no clocks"); \
  }
#define NO_CLOCKS_5(name, A, B, C, D, E) \
  STATUS NAMED(name)(fmi3Instance c, A a, B b, C d, D e, E f) { \
    (void)a; (void)b; (void)d; (void)e; (void)f; \
    return refuse(c, "there are no clocks"); \
  }
NO_CLOCKS_4(fmi3GetIntervalDecimal, const fmi3ValueReference*, size_t, fmi3Float64*, fmi3IntervalQualifier*)
NO_CLOCKS_5(fmi3GetIntervalFraction, const fmi3ValueReference*, size_t, uint64_t*, uint64_t*, fmi3IntervalQualifier*)
NO_CLOCKS_3(fmi3GetShiftDecimal, const fmi3ValueReference*, size_t, fmi3Float64*)
NO_CLOCKS_4(fmi3GetShiftFraction, const fmi3ValueReference*, size_t, uint64_t*, uint64_t*)
NO_CLOCKS_3(fmi3SetIntervalDecimal, const fmi3ValueReference*, size_t, const fmi3Float64*)
NO_CLOCKS_4(fmi3SetIntervalFraction, const fmi3ValueReference*, size_t, const uint64_t*, const uint64_t*)
NO_CLOCKS_3(fmi3SetShiftDecimal, const fmi3ValueReference*, size_t, const fmi3Float64*)
NO_CLOCKS_4(fmi3SetShiftFraction, const fmi3ValueReference*, size_t, const uint64_t*, const uint64_t*)
NO_CLOCKS_2(fmi3ActivateModelPartition, fmi3ValueReference, fmi3Float64)

STATUS NAMED(fmi3EvaluateDiscreteStates)(fmi3Instance c) { return STATUSES[settle(of(c))]; }

STATUS NAMED(fmi3UpdateDiscreteStates)(fmi3Instance c, fmi3Boolean* again, fmi3Boolean* terminate,
                                       fmi3Boolean* nominals_changed, fmi3Boolean* states_changed,
                                       fmi3Boolean* has_next, fmi3Float64* next) {
  instance* s = of(c);
  const int moves = s->block[IS_UNSETTLED] != 0.0, status = settle(s);
  if (again) *again = false;
  if (terminate) *terminate = false;
  if (nominals_changed) *nominals_changed = false;
  if (states_changed) *states_changed = moves;
  if (has_next) *has_next = false;
  if (next) *next = 0.0;
  return STATUSES[status];
}

/* --- model exchange ------------------------------------------------------------------------------------- */

STATUS NAMED(fmi3EnterContinuousTimeMode)(fmi3Instance c) {
  of(c)->block[MODE] = CONTINUOUS;
  return fmi3OK;
}

STATUS NAMED(fmi3CompletedIntegratorStep)(fmi3Instance c, fmi3Boolean no_return, fmi3Boolean* enter_event_mode,
                                          fmi3Boolean* terminate) {
  (void)c; (void)no_return;
  *enter_event_mode = *terminate = false;
  return fmi3OK;
}

STATUS NAMED(fmi3SetTime)(fmi3Instance c, fmi3Float64 time) {
  of(c)->block[TIME] = time;
  changed(of(c));
  return fmi3OK;
}

STATUS NAMED(fmi3SetContinuousStates)(fmi3Instance c, const fmi3Float64 x[], size_t count) {
  if (count != N_X) return refuse(c, "the number of continuous states is wrong");
  memcpy(of(c)->x, x, sizeof(double) * N_X);
  changed(of(c));
  return fmi3OK;
}

STATUS NAMED(fmi3GetContinuousStateDerivatives)(fmi3Instance c, fmi3Float64 rates[], size_t count) {
  if (count != N_X) return refuse(c, "the number of continuous states is wrong");
  const int status = update_derivatives(of(c));
  memcpy(rates, of(c)->xdot, sizeof(double) * N_X);
  return STATUSES[status];
}

STATUS NAMED(fmi3GetEventIndicators)(fmi3Instance c, fmi3Float64 values[], size_t count) {
  instance* s = of(c);
  if (count != N_INDICATORS) return refuse(c, "the number of event indicators is wrong");
  const int status = settle(s);
  find_indicators(s, s->block[TIME], s->x, values);
  return STATUSES[status];
}

STATUS NAMED(fmi3GetContinuousStates)(fmi3Instance c, fmi3Float64 x[], size_t count) {
  if (count != N_X) return refuse(c, "the number of continuous states is wrong");
  const int status = settle(of(c));
  memcpy(x, of(c)->x, sizeof(double) * N_X);
  return STATUSES[status];
}

STATUS NAMED(fmi3GetNominalsOfContinuousStates)(fmi3Instance c, fmi3Float64 nominals[], size_t count) {
  if (count != N_X) return refuse(c, "the number of continuous states is wrong");
  memcpy(nominals, NOMINALS, sizeof(double) * N_X);
  return fmi3OK;
}

STATUS NAMED(fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t* count) {
  (void)c;
  *count = N_INDICATORS;
  return fmi3OK;
}

STATUS NAMED(fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t* count) {
  (void)c;
  *count = N_X;
  return fmi3OK;
}

/* --- co-simulation -------------------------------------------------------------------------------------- */

STATUS NAMED(fmi3EnterStepMode)(fmi3Instance c) {
  const int status = settle(of(c));
  of(c)->block[MODE] = STEPPING;
  return STATUSES[status];
}

STATUS NAMED(fmi3GetOutputDerivatives)(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                       const int32_t orders[], fmi3Float64 value[], size_t values) {
  (void)vr; (void)orders; (void)value; (void)values;
  return count ? refuse(c, "derivatives of outputs in time are not available") : fmi3OK;
}

STATUS NAMED(fmi3DoStep)(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_return,
                         fmi3Boolean* needs_event_handling, fmi3Boolean* terminate, fmi3Boolean* early_return,
                         fmi3Float64* last_time) {
  instance* s = of(c);
  (void)no_return;
  if (needs_event_handling) *needs_event_handling = false;
  if (terminate) *terminate = false;
  if (early_return) *early_return = false;
  if (last_time) *last_time = s->block[TIME];
  if (s->block[MODE] == TERMINATED || s->block[MODE] < EVENT_MODE)
    return refuse(c, "a step is possible only between initialization and termination");
  if (!(fabs(time - s->block[TIME]) <= 1e-9 * (fabs(time) + fabs(step)))) {
    say(s, ERROR_, "the step is to begin at t = %.12g s, and the unit is at t = %.12g s", time, s->block[TIME]);
    return fmi3Error;
  }
  if (!(step > 0.0)) {
    say(s, ERROR_, "the communication step must be positive, got %g s", step);
    return fmi3Error;
  }
  s->block[MODE] = STEPPING;
  const int status = step_to(s, time + step);
  if (last_time) *last_time = s->block[TIME];
  return STATUSES[status];
}
