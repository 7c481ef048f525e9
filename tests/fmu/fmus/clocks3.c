/* An FMU for Co-Simulation (FMI 3.0) with one clock of each kind. It checks that each clock ticks at the right time:
 *   sample   constant   0.05 s, 0.15 s, …: adds `u` to `sum`
 *   fixed    fixed      0, 0.25 s, 0.5 s, …, set by the importer in initialization mode
 *   tuned    tunable    0, `period`, …; a new `period` starts at the event in which it was set
 *   growing  changing   0.1 s, then 0.2 s, 0.3 s, … later, up to `longest_interval`
 *   alarm    countdown  20 ms after every third sample; otherwise inactive
 *   kick     triggered  adds `push` to `pushed`
 *   full     triggered  output: with every fourth sample; `full_at` is its time
 * `counts`: ticks of sample, fixed, tuned, growing, alarm, kick. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmu/fmi3.h"

enum { kSample = 1, kFixed = 2, kTuned = 3, kGrowing = 4, kAlarm = 5, kKick = 6, kFull = 7 };
enum { kU = 11, kSum = 12, kPush = 13, kFullAt = 14, kPeriod = 15, kPushed = 16, kCounts = 17, kLongest = 18 };
enum { kClocks = 8 };

typedef struct {
  double time, u, sum, push, pushed, full_at, period, longest, interval;
  double due[kClocks]; /* 0: never */
  int32_t counts[kClocks];
  bool active[kClocks], told[kClocks];
  bool in_event_mode, initialising, fixed_is_set, period_is_new, alarm_is_new;
} Memory;

typedef struct {
  Memory m;
  void* environment;
  fmi3LogMessageCallback log;
} Instance;

static fmi3Status refuse(const Instance* i, const char* why) {
  i->log(i->environment, fmi3Error, "logStatusError", why);
  return fmi3Error;
}
static bool same(double a, double b) { return fabs(a - b) < 1e-9; }

const char* fmi3GetVersion(void) { return "3.0"; }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, bool on, size_t n, const fmi3String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return fmi3OK;
}
static void begin(Memory* m) {
  memset(m, 0, sizeof *m);
  m->period = 0.2;
  m->longest = 1;
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging,
                                         bool event_mode, bool early, const fmi3ValueReference required[], size_t n,
                                         void* environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)early, (void)required, (void)n, (void)update;
  (void)event_mode;
  Instance* i = calloc(1, sizeof *i);
  begin(&i->m);
  i->environment = environment;
  i->log = log;
  return i;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, bool t, double tolerance, double start, bool s, double stop) {
  (void)t, (void)tolerance, (void)s, (void)stop;
  Memory* m = &((Instance*)c)->m;
  m->time = start;
  m->initialising = true;
  m->due[kSample] = start + 0.05;
  m->due[kFixed] = m->due[kTuned] = start;
  m->interval = 0.1;
  m->due[kGrowing] = start + m->interval;
  m->due[kAlarm] = INFINITY;
  return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
  Instance* i = c;
  if (!i->m.fixed_is_set) return refuse(i, "nobody said at what interval `fixed` ticks");
  if (!i->m.told[kTuned] || !i->m.told[kGrowing] || !i->m.told[kAlarm]) return refuse(i, "nobody asked for the intervals");
  i->m.initialising = false;
  i->m.in_event_mode = true;
  return fmi3OK;
}
fmi3Status fmi3EnterEventMode(fmi3Instance c) {
  Instance* i = c;
  if (i->m.in_event_mode) return refuse(i, "event mode is not to be entered now");
  i->m.in_event_mode = true;
  return fmi3OK;
}
fmi3Status fmi3EnterStepMode(fmi3Instance c) {
  Instance* i = c;
  Memory* m = &i->m;
  if (!m->in_event_mode) return refuse(i, "step mode is not to be entered now");
  for (int k = 1; k < kClocks; ++k) {
    if (m->active[k]) return refuse(i, "a clock is active and no update was made");
    if (k <= kAlarm && m->due[k] < m->time + 1e-9) return refuse(i, "a clock that is due did not tick");
  }
  if (m->period_is_new || m->alarm_is_new) return refuse(i, "nobody asked for a new interval");
  m->in_event_mode = false;
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

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Clock v[]) {
  Instance* i = c;
  Memory* m = &i->m;
  if (!m->in_event_mode) return refuse(i, "clocks tick in event mode");
  for (size_t k = 0; k < n; ++k) {
    if (r[k] < kSample || r[k] > kKick || !v[k]) return refuse(i, "this clock is not to be set so");
    if (r[k] != kKick && !same(m->due[r[k]], m->time)) return refuse(i, "a clock ticks at the wrong time");
    m->active[r[k]] = true;
    if (r[k] == kSample && (m->counts[kSample] + 1) % 4 == 0) m->active[kFull] = true;
  }
  return fmi3OK;
}
fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Clock v[]) {
  Instance* i = c;
  if (!i->m.in_event_mode) return refuse(i, "clocks are asked for in event mode");
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kFull) return refuse(i, "only an output clock is to be asked for");
    v[k] = i->m.active[kFull];
  }
  return fmi3OK;
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, double intervals[],
                                  fmi3IntervalQualifier qualifiers[]) {
  Instance* i = c;
  Memory* m = &i->m;
  if (!m->in_event_mode && !m->initialising) return refuse(i, "no interval is to be asked for now");
  for (size_t k = 0; k < n; ++k) {
    const bool first = !m->told[r[k]];
    m->told[r[k]] = true;
    intervals[k] = 0;
    qualifiers[k] = first ? fmi3IntervalChanged : fmi3IntervalUnchanged;
    if (r[k] == kTuned) {
      intervals[k] = m->period;
      if (m->period_is_new) qualifiers[k] = fmi3IntervalChanged;
      m->period_is_new = false;
    } else if (r[k] == kGrowing) {
      intervals[k] = m->interval;
      if (m->in_event_mode) qualifiers[k] = fmi3IntervalChanged;
    } else if (r[k] == kAlarm) {
      intervals[k] = 0.02;
      if (isinf(m->due[kAlarm])) qualifiers[k] = fmi3IntervalNotYetKnown;
      if (m->alarm_is_new) qualifiers[k] = fmi3IntervalChanged;
      m->alarm_is_new = false;
    } else {
      return refuse(i, "the interval of this clock is known");
    }
  }
  return fmi3OK;
}
fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, const double intervals[]) {
  Instance* i = c;
  if (!i->m.initialising || n != 1 || r[0] != kFixed || intervals[0] != 0.25)
    return refuse(i, "this interval is not to be set");
  i->m.fixed_is_set = true;
  return fmi3OK;
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, double shifts[]) {
  Instance* i = c;
  if (!i->m.initialising || n != 1 || r[0] != kTuned) return refuse(i, "this shift is not to be asked for");
  shifts[0] = 0;
  return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, bool* again, bool* terminate, bool* nominals, bool* states, bool* defined,
                                    double* next) {
  Instance* i = c;
  Memory* m = &i->m;
  if (!m->in_event_mode) return refuse(i, "there is no event");
  *again = *terminate = *nominals = *states = *defined = false;
  *next = 0;
  for (int k = 1; k < kClocks; ++k) {
    if (!m->active[k]) continue;
    ++m->counts[k];
    m->active[k] = false;
    switch (k) {
      case kSample:
        m->due[k] = 0.05 + 0.1 * m->counts[k];
        if (m->counts[k] % 3 == 0) {
          m->due[kAlarm] = m->time + 0.02;
          m->alarm_is_new = true;
        }
        break;
      case kFixed:
        m->due[k] = 0.25 * m->counts[k];
        break;
      case kTuned:
        m->due[k] = m->time + m->period;
        break;
      case kGrowing:
        m->interval += 0.1;
        if (m->interval > m->longest + 1e-9) m->interval = -1;
        m->due[k] = m->time + m->interval;
        break;
      case kAlarm:
        m->due[k] = INFINITY;
        break;
      case kKick:
        m->pushed += m->push;
        break;
    }
  }
  if (m->period_is_new) m->due[kTuned] = m->time + m->period;
  return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, double v[], size_t nv) {
  Instance* i = c;
  Memory* m = &i->m;
  (void)nv;
  for (size_t k = 0; k < n; ++k) {
    switch (r[k]) {
      case kSum:
        if (!m->in_event_mode || !m->active[kSample]) return refuse(i, "`sum` is there when `sample` ticks");
        v[k] = m->sum + m->u;
        m->sum = v[k];
        break;
      case kFullAt:
        if (!m->in_event_mode || !m->active[kFull]) return refuse(i, "`full_at` is there when `full` ticks");
        v[k] = m->time;
        break;
      case kPushed:
        v[k] = m->pushed;
        break;
      case kPeriod:
        v[k] = m->period;
        break;
      case kLongest:
        v[k] = m->longest;
        break;
      default:
        return refuse(i, "no such Float64");
    }
  }
  return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const double v[], size_t nv) {
  Instance* i = c;
  Memory* m = &i->m;
  const bool before = !m->in_event_mode && (m->initialising || !m->fixed_is_set);
  (void)nv;
  for (size_t k = 0; k < n; ++k) {
    switch (r[k]) {
      case kU:
        if (!before && !m->active[kSample]) return refuse(i, "`u` is set when `sample` ticks");
        m->u = v[k];
        break;
      case kPush:
        if (!before && !m->active[kKick]) return refuse(i, "`push` is set when `kick` ticks");
        m->push = v[k];
        break;
      case kPeriod:
        if (!before && !m->in_event_mode) return refuse(i, "`period` is set in event mode");
        if (!before) m->period_is_new = true;
        m->period = v[k];
        break;
      case kLongest:
        if (!before) return refuse(i, "`longest_interval` is fixed");
        m->longest = v[k];
        break;
      default:
        return refuse(i, "no such Float64");
    }
  }
  return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, int32_t v[], size_t nv) {
  Instance* i = c;
  if (n != 1 || r[0] != kCounts || nv != 6) return refuse(i, "no such Int32");
  memcpy(v, i->m.counts + kSample, nv * sizeof *v);
  return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const int32_t v[], size_t nv) {
  (void)r, (void)n, (void)v, (void)nv;
  return refuse(c, "no Int32 can be set");
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
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState s, size_t* size) {
  (void)c, (void)s;
  *size = sizeof(Memory);
  return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState s, fmi3Byte bytes[], size_t size) {
  (void)c;
  memcpy(bytes, s, size);
  return fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState* s) {
  if (size != sizeof(Memory)) return refuse(c, "no state");
  *s = malloc(size);
  memcpy(*s, bytes, size);
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
  if (!same(now, m->time)) return refuse(i, "this step does not begin where the last one ended");
  for (int k = kSample; k <= kAlarm; ++k) {
    if (m->due[k] < now + h - 1e-9) return refuse(i, "this step goes past the tick of a clock");
  }
  m->time = now + h;
  return fmi3OK;
}
