/* An FMU for Co-Simulation (FMI 3.0) with arrays, binaries, event mode, early return and intermediate update.
 *   x' = u for n elements, integrated by the midpoint rule with `u` from the intermediate update; y = x, or -x if `mirrored`
 * Every 0.3 s there is an event, which `events` counts; `d` may change only in event mode; `echo` returns `bytes` and their
 * number. The callbacks get the environment that COTWIN_STRAY names ("null", "1", "2"), otherwise the right one.
 * After the start `big_out` is the number in COTWIN_BIG, if there is one, otherwise `big`. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmu/fmi3.h"

enum {
  kN = 1,
  kU = 2,
  kY = 3,
  kD = 4,
  kEvents = 5,
  kBytes = 6,
  kEcho = 7,
  kBig = 8,
  kBigOut = 9,
  kMode = 10,
  kFlags = 11,
  kSmall = 12,
  kSmallOut = 13,
  kMirrored = 14,
  kTiny = 15,
  kTinyOut = 16,
  kLargest = 17
};
enum { kPolite, kStandsStill, kReturnsFromTheFuture, kEndlessEvents, kTerminates, kDiscards, kRefusesUpdates, kNeedsCallback };
enum { kMost = 8 };
#define kPeriod 0.3

typedef struct {
  double x[kMost], u[kMost], time, next;
  uint64_t n;
  int64_t big;
  int32_t d, events, mode;
  float small;
  int8_t tiny;
  size_t size;
  uint8_t bytes[64];
  bool flags[2], mirrored, configuring, in_event_mode, initialised;
} Memory;

typedef struct {
  Memory m;
  bool event_mode, early, in_update;
  void* environment;
  fmi3LogMessageCallback log;
  fmi3IntermediateUpdateCallback update;
} Instance;

static fmi3Status refuse(const Instance* i, const char* why) {
  i->log(i->environment, fmi3Error, "logStatusError", why);
  return fmi3Error;
}

const char* fmi3GetVersion(void) { return "3.0"; }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, bool on, size_t n, const fmi3String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return fmi3OK;
}
static void begin(Memory* m) {
  memset(m, 0, sizeof *m);
  m->n = 3;
  m->next = kPeriod;
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging,
                                         bool event_mode, bool early, const fmi3ValueReference required[], size_t n,
                                         void* environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
  (void)name, (void)resources, (void)visible, (void)logging, (void)required, (void)n;
  if (strcmp(token, "{rogue}") != 0) return NULL;
  Instance* i = calloc(1, sizeof *i);
  begin(&i->m);
  i->event_mode = event_mode;
  i->early = early;
  const char* stray = getenv("COTWIN_STRAY");
  i->environment = stray == NULL                ? environment
                   : strcmp(stray, "null") == 0 ? NULL
                   : strcmp(stray, "1") == 0    ? (void*)1
                                                : (void*)2;
  i->log = log;
  i->update = update;
  return i;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) {
  ((Instance*)c)->m.configuring = true;
  return fmi3OK;
}
fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) {
  ((Instance*)c)->m.configuring = false;
  return fmi3OK;
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, bool t, double tolerance, double start, bool s, double stop) {
  (void)t, (void)tolerance, (void)s, (void)stop;
  ((Instance*)c)->m.time = start;
  return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
  Instance* i = c;
  i->m.initialised = true;
  i->m.in_event_mode = i->event_mode;
  return fmi3OK;
}
fmi3Status fmi3EnterEventMode(fmi3Instance c) {
  Instance* i = c;
  if (!i->event_mode || i->m.in_event_mode) return refuse(i, "event mode is not to be entered now");
  i->m.in_event_mode = true;
  return fmi3OK;
}
fmi3Status fmi3EnterStepMode(fmi3Instance c) {
  Instance* i = c;
  if (!i->m.in_event_mode) return refuse(i, "step mode is not to be entered now");
  i->m.in_event_mode = false;
  return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) {
  (void)c;
  return fmi3OK;
}
fmi3Status fmi3Reset(fmi3Instance c) {
  begin(&((Instance*)c)->m);
  return fmi3OK;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, bool* again, bool* terminate, bool* nominals, bool* states, bool* defined,
                                    double* next) {
  Instance* i = c;
  if (!i->m.in_event_mode) return refuse(i, "there is no event");
  *again = i->m.mode == kEndlessEvents;
  *terminate = *nominals = *states = false;
  if (i->m.time >= i->m.next - 1e-9) {
    ++i->m.events;
    i->m.next = kPeriod * (i->m.events + 1);
  }
  *defined = true;
  *next = i->m.next;
  return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, double v[], size_t nv) {
  const Instance* i = c;
  size_t at = 0;
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kU && r[k] != kY) return refuse(i, "no such Float64");
    for (uint64_t e = 0; e < i->m.n && at < nv; ++e) v[at++] = r[k] == kU ? i->m.u[e] : i->m.mirrored ? -i->m.x[e] : i->m.x[e];
  }
  return at == nv ? fmi3OK : refuse(i, "another number of values");
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const double v[], size_t nv) {
  Instance* i = c;
  if (n != 1 || r[0] != kU || nv != i->m.n) return refuse(i, "only u can be set");
  if (i->in_update && i->m.mode == kRefusesUpdates) return refuse(i, "u is not to my liking");
  memcpy(i->m.u, v, nv * sizeof *v);
  return fmi3OK;
}
fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 v[], size_t nv) {
  const Instance* i = c;
  if (n != 1 || r[0] != kY || orders[0] != 1 || nv != i->m.n) return refuse(i, "only the slope of y is known");
  memcpy(v, i->m.u, nv * sizeof *v); /* x' = u */
  return fmi3OK;
}
fmi3Status fmi3GetFloat32(fmi3Instance c, const fmi3ValueReference r[], size_t n, float v[], size_t nv) {
  (void)nv;
  for (size_t k = 0; k < n; ++k) v[k] = r[k] == kSmall ? ((Instance*)c)->m.small : 2 * ((Instance*)c)->m.small;
  return fmi3OK;
}
fmi3Status fmi3SetFloat32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const float v[], size_t nv) {
  if (n != 1 || nv != 1 || r[0] != kSmall) return fmi3Error;
  ((Instance*)c)->m.small = v[0];
  return fmi3OK;
}
fmi3Status fmi3GetInt8(fmi3Instance c, const fmi3ValueReference r[], size_t n, int8_t v[], size_t nv) {
  (void)r, (void)nv;
  for (size_t k = 0; k < n; ++k) v[k] = ((Instance*)c)->m.tiny;
  return fmi3OK;
}
fmi3Status fmi3SetInt8(fmi3Instance c, const fmi3ValueReference r[], size_t n, const int8_t v[], size_t nv) {
  if (n != 1 || nv != 1 || r[0] != kTiny) return fmi3Error;
  ((Instance*)c)->m.tiny = v[0];
  return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, int32_t v[], size_t nv) {
  const Instance* i = c;
  (void)nv;
  for (size_t k = 0; k < n; ++k) v[k] = r[k] == kD ? i->m.d : r[k] == kEvents ? i->m.events : i->m.mode;
  return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const int32_t v[], size_t nv) {
  Instance* i = c;
  (void)nv;
  for (size_t k = 0; k < n; ++k) {
    if (r[k] == kMode && !i->m.initialised)
      i->m.mode = v[k];
    else if (r[k] == kD && (!i->m.initialised || i->m.in_event_mode))
      i->m.d = v[k];
    else
      return refuse(i, "this Int32 is not to be set now");
  }
  return fmi3OK;
}
fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference r[], size_t n, int64_t v[], size_t nv) {
  (void)r, (void)nv;
  const char* big = ((Instance*)c)->m.time > 0 ? getenv("COTWIN_BIG") : NULL;
  for (size_t k = 0; k < n; ++k) v[k] = big != NULL ? strtoll(big, NULL, 10) : ((Instance*)c)->m.big;
  return fmi3OK;
}
fmi3Status fmi3SetInt64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const int64_t v[], size_t nv) {
  if (n != 1 || nv != 1 || r[0] != kBig) return fmi3Error;
  ((Instance*)c)->m.big = v[0];
  return fmi3OK;
}
fmi3Status fmi3GetUInt64(fmi3Instance c, const fmi3ValueReference r[], size_t n, uint64_t v[], size_t nv) {
  (void)r, (void)nv;
  for (size_t k = 0; k < n; ++k) v[k] = ((Instance*)c)->m.n;
  return fmi3OK;
}
fmi3Status fmi3SetUInt64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const uint64_t v[], size_t nv) {
  if (n == 1 && r[0] == kLargest) return v[0] == UINT64_MAX ? fmi3OK : fmi3Error;
  if (n != 1 || nv != 1 || r[0] != kN || v[0] > kMost || !((Instance*)c)->m.configuring) return fmi3Error;
  ((Instance*)c)->m.n = v[0];
  return fmi3OK;
}
fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference r[], size_t n, bool v[], size_t nv) {
  const Instance* i = c;
  size_t at = 0;
  for (size_t k = 0; k < n; ++k) {
    if (r[k] == kMirrored && at < nv) v[at++] = i->m.mirrored;
    for (size_t e = 0; r[k] == kFlags && e < 2 && at < nv; ++e) v[at++] = i->m.flags[e];
  }
  return fmi3OK;
}
fmi3Status fmi3SetBoolean(fmi3Instance c, const fmi3ValueReference r[], size_t n, const bool v[], size_t nv) {
  if (n == 1 && r[0] == kMirrored && nv == 1 && ((Instance*)c)->m.configuring) {
    ((Instance*)c)->m.mirrored = v[0];
    return fmi3OK;
  }
  if (n != 1 || r[0] != kFlags || nv != 2) return fmi3Error;
  memcpy(((Instance*)c)->m.flags, v, 2);
  return fmi3OK;
}
fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference r[], size_t n, size_t sizes[], fmi3Binary v[], size_t nv) {
  (void)r, (void)nv;
  for (size_t k = 0; k < n; ++k) {
    v[k] = ((Instance*)c)->m.bytes;
    sizes[k] = ((Instance*)c)->m.size;
  }
  return fmi3OK;
}
fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference r[], size_t n, const size_t sizes[], const fmi3Binary v[],
                         size_t nv) {
  Instance* i = c;
  if (n != 1 || nv != 1 || r[0] != kBytes || sizes[0] > sizeof i->m.bytes) return refuse(i, "binary too long");
  memcpy(i->m.bytes, v[0], sizes[0]);
  i->m.size = sizes[0];
  return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState* s) {
  if (*s == NULL) *s = malloc(sizeof(Memory));
  memcpy(*s, &((Instance*)c)->m, sizeof(Memory));
  return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) {
  memcpy(&((Instance*)c)->m, s, sizeof(Memory));
  return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState* s) {
  (void)c;
  free(*s);
  *s = NULL;
  return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, double now, double h, bool no_set_back, bool* event, bool* terminate, bool* early,
                      double* reached) {
  (void)no_set_back;
  Instance* i = c;
  Memory* m = &i->m;
  *event = *terminate = *early = false;
  *reached = now + h;
  if (m->in_event_mode) return refuse(i, "no step in event mode");
  if (fabs(now - m->time) > 1e-9) return refuse(i, "this step does not begin where the last one ended");
  if (m->mode == kDiscards && h > 0.011) return fmi3Discard;
  if (m->mode == kStandsStill) {
    *early = true;
    *reached = now;
    return fmi3OK;
  }
  if (m->mode == kNeedsCallback && i->update == NULL) return refuse(i, "there is no callback for intermediate updates");
  double end = now + h;
  if (i->early && h > 0.006) end = now + 0.5 * h; /* as if there were an event */
  if (i->event_mode && end > m->next) end = m->next;
  if (i->update != NULL) {
    bool early_requested = false;
    double early_time = 0;
    i->in_update = true;
    i->update(i->environment, 0.5 * (now + end), true, true, false, true, &early_requested, &early_time);
    i->in_update = false;
    if (early_requested) {
      end = early_time;
      refuse(i, "returns early as it was asked to");
    }
  }
  for (uint64_t e = 0; e < m->n; ++e) m->x[e] += m->u[e] * (end - now);
  m->time = end;
  *early = end < now + h - 1e-12;
  *reached = m->mode == kReturnsFromTheFuture ? now + 2 * h : end;
  if (m->mode == kReturnsFromTheFuture) *early = true;
  *event = i->event_mode && end >= m->next - 1e-9;
  if (m->mode == kTerminates && end >= 1 - 1e-9) *terminate = true;
  return fmi3OK;
}
