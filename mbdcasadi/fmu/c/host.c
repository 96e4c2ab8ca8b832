/* What instances of all kinds have in common: statuses, modes, and the host to which they report. */

#include <stdarg.h>
#include <stdio.h>

enum { OK_, WARNING_, DISCARD_, ERROR_ };

enum mode { INSTANTIATED, INITIALIZING, EVENT_MODE, CONTINUOUS, STEPPING, TERMINATED };

typedef void (*report_t)(void* host, int status, const char* message);

/* It has `block`, doubles of which a copy is a saved state, and `report` and `host`. */
typedef struct instance instance;

static void say(instance* s, int status, const char* format, ...);
