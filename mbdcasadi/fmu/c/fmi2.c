/* The interface of FMI 2.0, for co-simulation and model exchange.

   Functional Mock-up Interface for Model Exchange and Co-Simulation, version 2.0.4, Modelica Association 2022. */

#include "model.h"
#include "engine.c"
#include "host.c"
#include "instance.c"
#include "contacts.c"
#include "cosimulation.c"

typedef void* fmi2Component;
typedef void* fmi2ComponentEnvironment;
typedef void* fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char* fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;

typedef struct {
  void (*logger)(fmi2ComponentEnvironment, fmi2String instanceName, fmi2Status, fmi2String category, fmi2String message,
                 ...);
  void* (*allocateMemory)(size_t count, size_t size);
  void (*freeMemory)(void*);
  void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
  fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
  fmi2Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged,
      valuesOfContinuousStatesChanged, nextEventTimeDefined;
  fmi2Real nextEventTime;
} fmi2EventInfo;

typedef fmi2Status status_t;
typedef fmi2Component component_t;
typedef fmi2Boolean boolean_t;
typedef fmi2String string_t;
typedef fmi2Byte byte_t;
#define PASTE(a, b) a##b
#define PASTED(a, b) PASTE(a, b)
#define FMI(name) PASTE(fmi2, name)
#define FMU_STATE FMUstate
#define DESERIALIZE DeSerialize
#define RATES Derivatives
#define NUMBERS Real
#define COUNTED
#ifdef FMI2_FUNCTION_PREFIX
#define FUNCTION_PREFIX FMI2_FUNCTION_PREFIX
#endif

typedef struct {
  instance* s;
  fmi2CallbackFunctions callbacks;
  char* name;
  fmi2Status last;
} unit;

#include "interface.c"

static void report(void* host, int status, const char* message) {
  unit* c = host;
  if (c->callbacks.logger)
    c->callbacks.logger(c->callbacks.componentEnvironment, c->name, STATUSES[status], CATEGORIES[status], "%s", message);
}

SHOWN const char* NAMED(fmi2GetTypesPlatform)(void) { return "default"; }

SHOWN const char* NAMED(fmi2GetVersion)(void) { return "2.0"; }

SHOWN fmi2Component NAMED(fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                           const fmi2CallbackFunctions* functions, fmi2Boolean visible,
                                           fmi2Boolean logging) {
  unit* c = calloc(1, sizeof(unit));
  if (!c) return NULL;
  if (functions) c->callbacks = *functions;
  c->name = calloc(1, (name ? strlen(name) : 0) + 1);
  if (c->name && name) strcpy(c->name, name);
  if (!guid || strcmp(guid, MODEL_TOKEN)) {
    report(c, ERROR_, "the GUID is that of another model description");
  } else if (type == fmi2ModelExchange ? !HAS_MODEL_EXCHANGE : !HAS_CO_SIMULATION) {
    report(c, ERROR_, type == fmi2ModelExchange ? "this unit was exported for co-simulation alone"
                                                : "this unit was exported for model exchange alone");
  } else if (c->name && (c->s = create(report, c)) != NULL) return c;
  free(c->name);
  free(c);
  return NULL;
}

SHOWN void NAMED(fmi2FreeInstance)(fmi2Component component) {
  unit* c = component;
  if (!c) return;
  dismiss(c->s);
  free(c->name);
  free(c);
}

STATUS NAMED(fmi2SetupExperiment)(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                  fmi2Boolean has_stop, fmi2Real stop) {
  set_experiment(of(c), has_tolerance, tolerance, start, has_stop, stop);
  return fmi2OK;
}

STATUS NAMED(fmi2EnterInitializationMode)(fmi2Component c) { return enter(c, INITIALIZING); }

STATUS NAMED(fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Real value[]) {
  return STATUSES[get_values(of(c), vr, count, value)];
}

STATUS NAMED(fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Real value[]) {
  return STATUSES[set_values(of(c), vr, count, value)];
}

ABSENT(Integer, fmi2Integer)
ABSENT(Boolean, fmi2Boolean)
ABSENT(String, fmi2String)

STATUS NAMED(fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                           const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[],
                                           fmi2Real result[]) {
  return STATUSES[derivative_along(of(c), unknown, unknowns, known, knowns, seed, result)];
}

/* --- model exchange ------------------------------------------------------------------------------------- */

STATUS NAMED(fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo* info) {
  instance* s = of(c);
  const int moves = s->block[IS_UNSETTLED] != 0.0, status = settle(s);
  memset(info, 0, sizeof *info);
  info->valuesOfContinuousStatesChanged = moves;
  return STATUSES[status];
}

/* --- co-simulation -------------------------------------------------------------------------------------- */

static int set_slope(instance* s, unsigned reference, int order, double slope) {
  if (reference < FIRST_INPUT || reference >= FIRST_PARAMETER || order != 1 || !isfinite(slope)) {
    say(s, ERROR_, "only derivatives of inputs can be set, and only of order 1");
    return ERROR_;
  }
  const int k = INPUT_PLACES[reference - FIRST_INPUT];
  if (s->levels[N_INPUTS + k] == slope) return OK_;
  count_slopes_from_now(s);
  s->levels[N_INPUTS + k] = slope;
  turned(s);
  return OK_;
}

STATUS NAMED(fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                          const fmi2Integer order[], const fmi2Real value[]) {
  int status = OK_;
  for (size_t i = 0; i < count && status == OK_; ++i) status = set_slope(of(c), vr[i], order[i], value[i]);
  return STATUSES[status];
}

STATUS NAMED(fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                           const fmi2Integer order[], fmi2Real value[]) {
  return count ? refuse(c, "derivatives of outputs in time are not available") : fmi2OK;
}

STATUS NAMED(fmi2DoStep)(fmi2Component component, fmi2Real time, fmi2Real step, fmi2Boolean no_return) {
  unit* c = component;
  instance* s = c->s;
  if (!may_step(s, time, step)) return c->last = fmi2Error;
  if (!(step >= 0.0)) {
    say(s, ERROR_, "the communication step must not be negative, got %g s", step);
    return c->last = fmi2Error;
  }
  s->block[MODE] = STEPPING;
  return c->last = STATUSES[step_to(s, time + step)];
}

STATUS NAMED(fmi2CancelStep)(fmi2Component c) { return refuse(c, "no step is pending"); }

STATUS NAMED(fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status* value) {
  if (kind != fmi2DoStepStatus) return fmi2Discard;
  *value = ((unit*)c)->last;
  return fmi2OK;
}

STATUS NAMED(fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real* value) {
  if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
  *value = of(c)->block[TIME];
  return fmi2OK;
}

STATUS NAMED(fmi2GetIntegerStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Integer* value) {
  return fmi2Discard;
}

STATUS NAMED(fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean* value) {
  if (kind != fmi2Terminated) return fmi2Discard;
  *value = 0;
  return fmi2OK;
}

STATUS NAMED(fmi2GetStringStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2String* value) {
  return fmi2Discard;
}
