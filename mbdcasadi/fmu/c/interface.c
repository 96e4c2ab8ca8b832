/* Functions that all versions of FMI have alike.

   The file of a version includes this one after its types, with status_t, component_t, boolean_t and string_t for
   them, FMI(name) for a name with the prefix of the version, the words that versions spell differently (FMU_STATE,
   DESERIALIZE, RATES, NUMBERS), COUNTED for the parameter that counts values beside references, and a struct `unit`
   whose first member is the instance. */

/* the standard gives many functions more than this unit needs */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#elif defined(_MSC_VER)
#pragma warning(disable : 4100)
#endif

#if defined(_WIN32)
#define SHOWN __declspec(dllexport)
#elif defined(__GNUC__)
#define SHOWN __attribute__((visibility("default")))
#else
#define SHOWN
#endif
#ifdef FUNCTION_PREFIX
#define NAMED(name) PASTED(FUNCTION_PREFIX, name)
#else
#define NAMED(name) name
#endif
#define STATUS SHOWN status_t
#define QUOTED(x) #x
#define TEXT(x) QUOTED(x)

static const status_t STATUSES[] = {FMI(OK), FMI(Warning), FMI(Discard), FMI(Error)};
static const char* const CATEGORIES[] = {"logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError"};

static instance* of(component_t c) { return ((unit*)c)->s; }

static void say(instance* s, int status, const char* format, ...) {
  char text[1024];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  if (s->report) s->report(s->host, status, text);
}

static status_t refuse(component_t c, const char* message) {
  say(of(c), ERROR_, "%s", message);
  return FMI(Error);
}

static status_t enter(component_t c, enum mode mode) {
  of(c)->block[MODE] = mode;
  return FMI(OK);
}

STATUS NAMED(FMI(SetDebugLogging))(component_t c, boolean_t on, size_t count, const string_t categories[]) {
  return FMI(OK);
}

STATUS NAMED(FMI(ExitInitializationMode))(component_t c) {
  const int status = settle(of(c));
  /* co-simulation and model exchange may go on from here in different modes, and no call distinguishes them here */
  if (status == OK_) enter(c, EVENT_MODE);
  return STATUSES[status];
}

STATUS NAMED(FMI(EnterEventMode))(component_t c) { return enter(c, EVENT_MODE); }

STATUS NAMED(FMI(Terminate))(component_t c) { return enter(c, TERMINATED); }

STATUS NAMED(FMI(Reset))(component_t c) {
  reset(of(c));
  return FMI(OK);
}

/* --- variables of other types ------------------------------------------------------------------------------ */

static status_t no_such(component_t c, size_t count) {
  return count ? refuse(c, "all variables of this unit are of type " TEXT(NUMBERS)) : FMI(OK);
}

#define ABSENT(type, kind)                                                                                        \
  STATUS NAMED(PASTED(FMI(Get), type))(component_t c, const unsigned vr[], size_t count, kind value[] COUNTED) {  \
    return no_such(c, count);                                                                                     \
  }                                                                                                               \
  STATUS NAMED(PASTED(FMI(Set), type))(component_t c, const unsigned vr[], size_t count,                          \
                                       const kind value[] COUNTED) {                                              \
    return no_such(c, count);                                                                                     \
  }

/* --- saved states ----------------------------------------------------------------------------------------- */

#define SAVED_BYTES (sizeof(double) * BLOCK)

STATUS NAMED(PASTED(FMI(Get), FMU_STATE))(component_t c, void** state) {
  if (!*state && !(*state = malloc(SAVED_BYTES))) return FMI(Error);
  memcpy(*state, of(c)->block, SAVED_BYTES);
  return FMI(OK);
}

STATUS NAMED(PASTED(FMI(Set), FMU_STATE))(component_t c, void* state) {
  if (!state || *(const double*)state != MODEL_IDENTITY) return refuse(c, "the saved state belongs to another model");
  memcpy(of(c)->block, state, SAVED_BYTES);
  changed(of(c));
  return FMI(OK);
}

STATUS NAMED(PASTED(FMI(Free), FMU_STATE))(component_t c, void** state) {
  if (state) { free(*state); *state = NULL; }
  return FMI(OK);
}

STATUS NAMED(PASTED(PASTED(FMI(Serialized), FMU_STATE), Size))(component_t c, void* state, size_t* size) {
  *size = SAVED_BYTES;
  return FMI(OK);
}

STATUS NAMED(PASTED(FMI(Serialize), FMU_STATE))(component_t c, void* state, byte_t bytes[], size_t size) {
  if (size < SAVED_BYTES || !state) return refuse(c, "the space is too small for a saved state");
  memcpy(bytes, state, SAVED_BYTES);
  return FMI(OK);
}

STATUS NAMED(PASTED(FMI(DESERIALIZE), FMU_STATE))(component_t c, const byte_t bytes[], size_t size, void** state) {
  double identity = 0.0;
  if (size >= SAVED_BYTES) memcpy(&identity, bytes, sizeof identity);
  if (identity != MODEL_IDENTITY) return refuse(c, "the serialized state belongs to another model");
  if (!*state && !(*state = malloc(SAVED_BYTES))) return FMI(Error);
  memcpy(*state, bytes, SAVED_BYTES);
  return FMI(OK);
}

/* --- model exchange ------------------------------------------------------------------------------------- */

STATUS NAMED(FMI(EnterContinuousTimeMode))(component_t c) { return enter(c, CONTINUOUS); }

STATUS NAMED(FMI(CompletedIntegratorStep))(component_t c, boolean_t no_return, boolean_t* enter_event_mode,
                                           boolean_t* terminate) {
  *enter_event_mode = *terminate = 0;
  return FMI(OK);
}

STATUS NAMED(FMI(SetTime))(component_t c, double time) {
  of(c)->block[TIME] = time;
  changed(of(c));
  return FMI(OK);
}

static int is_wrong(component_t c, size_t count) {
  if (count == N_X) return 0;
  refuse(c, "the number of continuous states is wrong");
  return 1;
}

STATUS NAMED(FMI(SetContinuousStates))(component_t c, const double x[], size_t count) {
  if (is_wrong(c, count)) return FMI(Error);
  memcpy(of(c)->x, x, sizeof(double) * N_X);
  changed(of(c));
  return FMI(OK);
}

STATUS NAMED(PASTED(FMI(Get), RATES))(component_t c, double rates[], size_t count) {
  if (is_wrong(c, count)) return FMI(Error);
  const int status = update_derivatives(of(c));
  memcpy(rates, of(c)->xdot, sizeof(double) * N_X);
  return STATUSES[status];
}

STATUS NAMED(FMI(GetContinuousStates))(component_t c, double x[], size_t count) {
  if (is_wrong(c, count)) return FMI(Error);
  const int status = settle(of(c));
  memcpy(x, of(c)->x, sizeof(double) * N_X);
  return STATUSES[status];
}

STATUS NAMED(FMI(GetNominalsOfContinuousStates))(component_t c, double nominals[], size_t count) {
  if (is_wrong(c, count)) return FMI(Error);
  memcpy(nominals, NOMINALS, sizeof(double) * N_X);
  return FMI(OK);
}

STATUS NAMED(FMI(GetEventIndicators))(component_t c, double values[], size_t count) {
  instance* s = of(c);
  if (count != N_INDICATORS) return refuse(c, "the number of event indicators is wrong");
  const int status = settle(s);
  find_indicators(s, s->block[TIME], s->x, values);
  return STATUSES[status];
}

/* --- co-simulation -------------------------------------------------------------------------------------- */

/* 0 if a step cannot begin at a time. */
static int may_step(instance* s, double time, double step) {
  if (s->block[MODE] == TERMINATED || s->block[MODE] < EVENT_MODE) {
    say(s, ERROR_, "a step is possible only between initialization and termination");
    return 0;
  }
  if (!(fabs(time - s->block[TIME]) <= 1e-9 * (fabs(time) + fabs(step)))) {
    say(s, ERROR_, "the step is to begin at t = %.12g s, and the unit is at t = %.12g s", time, s->block[TIME]);
    return 0;
  }
  return 1;
}
