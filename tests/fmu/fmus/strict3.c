/* The model of strict.h for Co-Simulation in FMI 3.0, without event mode. */
#include "tests/fmu/fmus/strict.h"

#include "fmu/fmi3.h"

const char* fmi3GetVersion(void) { return "3.0"; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging,
                                         bool event_mode, bool early, const fmi3ValueReference required[], size_t n,
                                         void* environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)early, (void)required, (void)n, (void)update;
  if (event_mode) {
    log(environment, fmi3Error, "logStatusError", "Event Mode is not supported.");
    return NULL;
  }
  Strict* s = calloc(1, sizeof *s);
  strict_begin(s);
  return s;
}
void fmi3FreeInstance(fmi3Instance c) {
  strict_end(c);
  free(c);
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, bool t, double tolerance, double start, bool s, double stop) {
  (void)t, (void)tolerance, (void)s, (void)stop;
  strict_call("enter");
  strict_start(c, start);
  return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
  strict_exit(c);
  return fmi3OK;
}
fmi3Status fmi3EnterEventMode(fmi3Instance c) {
  (void)c;
  return fmi3Error;
}
fmi3Status fmi3EnterStepMode(fmi3Instance c) {
  (void)c;
  return fmi3Error;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, bool* again, bool* terminate, bool* nominals, bool* states, bool* defined,
                                    double* next) {
  (void)c, (void)again, (void)terminate, (void)nominals, (void)states, (void)defined, (void)next;
  return fmi3Error;
}
fmi3Status fmi3Terminate(fmi3Instance c) {
  (void)c;
  return fmi3OK;
}
fmi3Status fmi3Reset(fmi3Instance c) {
  strict_reset(c);
  return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, double v[], size_t nv) {
  (void)nv;
  for (size_t k = 0; k < n; ++k) {
    if (!strict_get(c, r[k], &v[k])) return fmi3Error;
  }
  return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const double v[], size_t nv) {
  (void)nv;
  for (size_t k = 0; k < n; ++k) {
    if (!strict_set(c, r[k], v[k])) return fmi3Error;
  }
  return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, int32_t v[], size_t nv) {
  (void)c, (void)r, (void)n, (void)v, (void)nv;
  return fmi3Error;
}
fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const int32_t v[], size_t nv) {
  Strict* s = c;
  (void)nv;
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kMode || s->m == NULL) return fmi3Error;
    s->m->mode = v[k];
  }
  return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState* state) {
  if (*state == NULL) *state = malloc(sizeof(Memory));
  memcpy(*state, ((Strict*)c)->m, sizeof(Memory));
  return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
  Strict* s = c;
  if (!strict_may_be_set(s, state)) return fmi3Error;
  memcpy(s->m, state, sizeof(Memory));
  return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState* state) {
  (void)c;
  free(*state);
  *state = NULL;
  return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t* size) {
  (void)c, (void)state;
  *size = sizeof(Memory);
  return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte b[], size_t size) {
  (void)c;
  memcpy(b, state, size);
  return fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte b[], size_t size, fmi3FMUState* state) {
  (void)c;
  *state = malloc(size);
  memcpy(*state, b, size);
  return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, double now, double h, bool stays, bool* event, bool* terminate, bool* early,
                      double* reached) {
  const bool made = strict_step(c, now, h, stays);
  *event = *terminate = *early = false;
  *reached = made ? now + h : now;
  return made ? fmi3OK : fmi3Discard;
}
