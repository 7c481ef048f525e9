/* An FMU for Co-Simulation (FMI 2.0) with unusual behaviour, chosen by its parameter `mode`.
 *   x' = u (ramped by its input derivative), y = x, and z = 2 x, if the description has it.
 * It gives only the derivative of y; a request for another one makes the next step fail. A second instance called "only one"
 * in a process is refused. The logger gets the environment that COTWIN_STRAY names ("null", "1", "2"), otherwise the right one;
 * with "thread" another thread calls it with the environment 2. */
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu/fmi2.h"

enum { kU = 1, kY = 2, kLongestStep = 3, kZ = 4, kMode = 10, kOn = 20, kOff = 21, kIn = 30, kOut = 31 };
enum { kPolite, kError, kCrash, kHang, kFlood, kNoInitialisation, kTerminate, kFatal, kPending, kHugeState };

typedef struct {
  double x, u, du, longest_step, time, reached;
  int mode, on, calls_pending, initialised, broken;
  char text[64];
} Memory;

typedef struct {
  Memory m;
  const fmi2CallbackFunctions* callbacks;
  char name[64];
  char reversed[64];
} Instance;

static int only_ones; /* alive */
static int is_only_one(const char* name) { return strcmp(name, "only one") == 0; }

typedef struct {
  const Instance* i;
  void* environment;
  fmi2Status status;
  const char *category, *text;
} Message;
static void* log_it(void* argument) {
  const Message* m = argument;
  m->i->callbacks->logger(m->environment, m->i->name, m->status, m->category, "%s", m->text);
  return NULL;
}
static void say(const Instance* i, fmi2Status status, const char* category, const char* text) {
  const char* stray = getenv("COTWIN_STRAY");
  Message m = {i, i->callbacks->componentEnvironment, status, category, text};
  if (stray != NULL) m.environment = strcmp(stray, "null") == 0 ? NULL : strcmp(stray, "1") == 0 ? (void*)1 : (void*)2;
  if (stray == NULL || strcmp(stray, "thread") != 0) {
    log_it(&m);
    return;
  }
  pthread_t thread;
  pthread_create(&thread, NULL, log_it, &m);
  pthread_join(thread, NULL);
}

const char* fmi2GetTypesPlatform(void) { return "default"; }
const char* fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions* callbacks, fmi2Boolean visible, fmi2Boolean logging) {
  (void)resources, (void)visible, (void)logging;
  Instance* i = callbacks->allocateMemory(1, sizeof *i);
  i->callbacks = callbacks;
  snprintf(i->name, sizeof i->name, "%s", name);
  i->m.longest_step = 1e9;
  if (strcmp(name, "refused") == 0 || strcmp(guid, "{rogue}") != 0 || type != fmi2CoSimulation) {
    say(i, fmi2Error, "logStatusError", "this instance is not wanted, 100% sure");
    callbacks->freeMemory(i);
    return NULL;
  }
  if (is_only_one(name) && ++only_ones > 1) {
    --only_ones;
    say(i, fmi2Error, "logStatusError", "there is an instance already");
    callbacks->freeMemory(i);
    return NULL;
  }
  return i;
}
void fmi2FreeInstance(fmi2Component c) {
  Instance* i = c;
  if (i->m.mode == kFatal && i->m.time >= 1) abort(); /* must not be called after a fatal error */
  if (is_only_one(i->name)) --only_ones;
  i->callbacks->freeMemory(i);
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start, fmi2Boolean s,
                               fmi2Real stop) {
  (void)t, (void)tolerance, (void)s, (void)stop;
  ((Instance*)c)->m.time = start;
  return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  (void)c;
  return fmi2OK;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  Instance* i = c;
  if (i->m.mode == kNoInitialisation) {
    say(i, fmi2Error, "logStatusError", "no initial values can be found");
    return fmi2Error;
  }
  i->m.initialised = 1;
  return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) {
  (void)c;
  return fmi2OK;
}
fmi2Status fmi2Reset(fmi2Component c) {
  Instance* i = c;
  if (strcmp(i->name, "no reset") == 0) return fmi2Error;
  memset(&i->m, 0, sizeof i->m);
  i->m.longest_step = 1e9;
  return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[]) {
  const Instance* i = c;
  for (size_t k = 0; k < n; ++k) v[k] = r[k] == kU ? i->m.u : r[k] == kY ? i->m.x : r[k] == kZ ? 2 * i->m.x : i->m.longest_step;
  return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer v[]) {
  (void)r;
  for (size_t k = 0; k < n; ++k) v[k] = ((Instance*)c)->m.mode;
  return fmi2OK;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean v[]) {
  for (size_t k = 0; k < n; ++k) v[k] = r[k] == kOn ? ((Instance*)c)->m.on : !((Instance*)c)->m.on;
  return fmi2OK;
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String v[]) {
  Instance* i = c;
  const size_t length = strlen(i->m.text);
  for (size_t k = 0; k < length; ++k) i->reversed[k] = i->m.text[length - 1 - k];
  i->reversed[length] = 0;
  for (size_t k = 0; k < n; ++k) v[k] = r[k] == kIn ? i->m.text : i->reversed;
  return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[]) {
  Instance* i = c;
  for (size_t k = 0; k < n; ++k) {
    if (r[k] == kU)
      i->m.u = v[k];
    else if (r[k] == kLongestStep && !i->m.initialised)
      i->m.longest_step = v[k];
    else
      return fmi2Error;
  }
  return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer v[]) {
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kMode || ((Instance*)c)->m.initialised) return fmi2Error;
    ((Instance*)c)->m.mode = v[k];
  }
  return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean v[]) {
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kOn) return fmi2Error;
    ((Instance*)c)->m.on = v[k];
  }
  return fmi2OK;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String v[]) {
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kIn) return fmi2Error;
    snprintf(((Instance*)c)->m.text, sizeof((Instance*)c)->m.text, "%s", v[k]);
  }
  return fmi2OK;
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                       const fmi2Real v[]) {
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kU || order[k] != 1) return fmi2Error;
    ((Instance*)c)->m.du = v[k];
  }
  return fmi2OK;
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                        fmi2Real v[]) {
  for (size_t k = 0; k < n; ++k) { /* y' = u */
    if (r[k] != kY || order[k] != 1) {
      ((Instance*)c)->m.broken = 1;
      return fmi2Error;
    }
    v[k] = ((Instance*)c)->m.u;
  }
  return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* s) {
  if (*s == NULL) *s = malloc(sizeof(Memory));
  memcpy(*s, &((Instance*)c)->m, sizeof(Memory));
  return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) {
  memcpy(&((Instance*)c)->m, s, sizeof(Memory));
  return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* s) {
  (void)c;
  free(*s);
  *s = NULL;
  return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t* size) {
  (void)s;
  *size = ((Instance*)c)->m.mode == kHugeState ? (size_t)1 << 60 : sizeof(Memory);
  return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t size) {
  (void)c;
  if (size != sizeof(Memory)) return fmi2Error;
  memcpy(b, s, size);
  return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t size, fmi2FMUstate* s) {
  (void)c;
  if (size != sizeof(Memory)) return fmi2Error;
  *s = malloc(size);
  memcpy(*s, b, size);
  return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real h, fmi2Boolean no_set_back) {
  (void)no_set_back;
  Instance* i = c;
  Memory* m = &i->m;
  if (fabs(now - m->time) > 1e-9) {
    say(i, fmi2Error, "logStatusError", "this step does not begin where the last one ended");
    return fmi2Error;
  }
  m->reached = now;
  if (m->broken) return fmi2Error;
  if (h > m->longest_step * (1 + 1e-9)) return fmi2Discard;
  const int late = now + h >= 1 - 1e-9;
  if (m->mode == kFlood) {
    char line[3000];
    memset(line, 'x', sizeof line - 1);
    line[sizeof line - 1] = 0;
    for (int k = 0; k < 1000; ++k) {
      snprintf(line, 20, "%d drops", k);
      line[strlen(line)] = ' ';
      say(i, fmi2Warning, "logAll", line);
    }
  }
  if (late && m->mode == kError) {
    say(i, fmi2Error, "logStatusError", "the sum does not converge");
    return fmi2Error;
  }
  if (late && m->mode == kCrash) raise(SIGSEGV);
  if (late && m->mode == kHang) {
    for (volatile int k = 0;; k = !k) {
    }
  }
  if (late && m->mode == kFatal) {
    m->time = now + h;
    say(i, fmi2Fatal, "logStatusFatal", "everything is lost");
    return fmi2Fatal;
  }
  m->x += m->u * h + 0.5 * m->du * h * h;
  m->u += m->du * h;
  m->time = m->reached = now + h;
  if (late && m->mode == kTerminate) return fmi2Discard;
  if (m->mode == kPending) {
    m->calls_pending = 3;
    return fmi2Pending;
  }
  return m->mode == kFlood ? fmi2Warning : fmi2OK;
}
fmi2Status fmi2CancelStep(fmi2Component c) {
  (void)c;
  return fmi2Error;
}
fmi2Status fmi2GetStatus(fmi2Component c, fmi2StatusKind kind, fmi2Status* s) {
  if (kind != fmi2DoStepStatus) return fmi2Error;
  *s = --((Instance*)c)->m.calls_pending > 0 ? fmi2Pending : fmi2OK;
  return fmi2OK;
}
fmi2Status fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real* v) {
  if (kind != fmi2LastSuccessfulTime) return fmi2Error;
  *v = ((Instance*)c)->m.reached;
  return fmi2OK;
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, fmi2StatusKind kind, fmi2Integer* v) {
  (void)c, (void)kind, (void)v;
  return fmi2Error;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, fmi2StatusKind kind, fmi2Boolean* v) {
  if (kind != fmi2Terminated) return fmi2Error;
  *v = ((Instance*)c)->m.mode == kTerminate && ((Instance*)c)->m.reached >= 1 - 1e-9;
  return fmi2OK;
}
fmi2Status fmi2GetStringStatus(fmi2Component c, fmi2StatusKind kind, fmi2String* v) {
  (void)c, (void)kind, (void)v;
  return fmi2Error;
}
