/* The interface of FMI 3.0, for co-simulation and model exchange.

   Functional Mock-up Interface Specification, version 3.0.1, Modelica Association 2023. */

#include "model.h"
#include "engine.c"
#include "host.c"
#include "instance.c"
#include "contacts.c"
#include "cosimulation.c"

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

typedef fmi3Status status_t;
typedef fmi3Instance component_t;
typedef fmi3Boolean boolean_t;
typedef fmi3String string_t;
typedef fmi3Byte byte_t;
#define PASTE(a, b) a##b
#define PASTED(a, b) PASTE(a, b)
#define FMI(name) PASTE(fmi3, name)
#define FMU_STATE FMUState
#define DESERIALIZE Deserialize
#define RATES ContinuousStateDerivatives
#define NUMBERS Float64
#define COUNTED , size_t values
#ifdef FMI3_FUNCTION_PREFIX
#define FUNCTION_PREFIX FMI3_FUNCTION_PREFIX
#endif

typedef struct {
  instance* s;
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log;
  bool has_event_mode;
} unit;

#include "interface.c"

static void report(void* host, int status, const char* message) {
  unit* c = host;
  if (c->log) c->log(c->environment, STATUSES[status], CATEGORIES[status], message);
}

SHOWN const char* NAMED(fmi3GetVersion)(void) { return "3.0"; }

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
  return instantiate(token, HAS_MODEL_EXCHANGE, "this unit was exported for co-simulation alone", environment, log);
}

SHOWN fmi3Instance NAMED(fmi3InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
  unit* c = instantiate(token, HAS_CO_SIMULATION, "this unit was exported for model exchange alone", environment, log);
  if (c) c->has_event_mode = event_mode;
  return c;
}

SHOWN fmi3Instance NAMED(fmi3InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback clock, fmi3Callback lock,
    fmi3Callback unlock) {
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
  set_experiment(of(c), has_tolerance, tolerance, start, has_stop, stop);
  return enter(c, INITIALIZING);
}

STATUS NAMED(fmi3GetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, fmi3Float64 value[],
                             size_t values) {
  if (values != count) return refuse(c, "every variable of this unit is one number");
  return STATUSES[get_values(of(c), vr, count, value)];
}

STATUS NAMED(fmi3SetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, const fmi3Float64 value[],
                             size_t values) {
  if (values != count) return refuse(c, "every variable of this unit is one number");
  return STATUSES[set_values(of(c), vr, count, value)];
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
  return no_such(c, count);
}

STATUS NAMED(fmi3SetBinary)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, const size_t sizes[],
                            const fmi3Binary value[], size_t values) {
  return no_such(c, count);
}

STATUS NAMED(fmi3GetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, fmi3Boolean value[]) {
  return no_such(c, count);
}

STATUS NAMED(fmi3SetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t count, const fmi3Boolean value[]) {
  return no_such(c, count);
}

STATUS NAMED(fmi3GetNumberOfVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t* count) {
  return refuse(c, "the dependencies are those of the model description");
}

STATUS NAMED(fmi3GetVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t elements[],
                                          fmi3ValueReference independents[], size_t others[],
                                          fmi3DependencyKind kinds[], size_t count) {
  return refuse(c, "the dependencies are those of the model description");
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
  return refuse(c, "adjoint derivatives are not available");
}

STATUS NAMED(fmi3EnterConfigurationMode)(fmi3Instance c) { return refuse(c, "there are no structural parameters"); }

STATUS NAMED(fmi3ExitConfigurationMode)(fmi3Instance c) { return refuse(c, "there are no structural parameters"); }

#define NO_CLOCKS(name, ...) \
  STATUS NAMED(name)(fmi3Instance c, __VA_ARGS__) { return refuse(c, "there are no clocks"); }
NO_CLOCKS(fmi3GetIntervalDecimal, const fmi3ValueReference vr[], size_t count, fmi3Float64 interval[],
          fmi3IntervalQualifier qualifier[])
NO_CLOCKS(fmi3GetIntervalFraction, const fmi3ValueReference vr[], size_t count, uint64_t counter[],
          uint64_t resolution[], fmi3IntervalQualifier qualifier[])
NO_CLOCKS(fmi3GetShiftDecimal, const fmi3ValueReference vr[], size_t count, fmi3Float64 shift[])
NO_CLOCKS(fmi3GetShiftFraction, const fmi3ValueReference vr[], size_t count, uint64_t counter[], uint64_t resolution[])
NO_CLOCKS(fmi3SetIntervalDecimal, const fmi3ValueReference vr[], size_t count, const fmi3Float64 interval[])
NO_CLOCKS(fmi3SetIntervalFraction, const fmi3ValueReference vr[], size_t count, const uint64_t counter[],
          const uint64_t resolution[])
NO_CLOCKS(fmi3SetShiftDecimal, const fmi3ValueReference vr[], size_t count, const fmi3Float64 shift[])
NO_CLOCKS(fmi3SetShiftFraction, const fmi3ValueReference vr[], size_t count, const uint64_t counter[],
          const uint64_t resolution[])
NO_CLOCKS(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)

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

STATUS NAMED(fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t* count) {
  *count = N_INDICATORS;
  return fmi3OK;
}

STATUS NAMED(fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t* count) {
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
  return count ? refuse(c, "derivatives of outputs in time are not available") : fmi3OK;
}

STATUS NAMED(fmi3DoStep)(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_return,
                         fmi3Boolean* needs_event_handling, fmi3Boolean* terminate, fmi3Boolean* early_return,
                         fmi3Float64* last_time) {
  instance* s = of(c);
  if (needs_event_handling) *needs_event_handling = false;
  if (terminate) *terminate = false;
  if (early_return) *early_return = false;
  if (last_time) *last_time = s->block[TIME];
  if (!may_step(s, time, step)) return fmi3Error;
  if (!(step > 0.0)) {
    say(s, ERROR_, "the communication step must be positive, got %g s", step);
    return fmi3Error;
  }
  s->block[MODE] = STEPPING;
  const int status = step_to(s, time + step);
  if (last_time) *last_time = s->block[TIME];
  return STATUSES[status];
}
