/* The model of strict.h for Co-Simulation in FMI 2.0. */
#include "tests/fmu/fmus/strict.h"

#include "fmu/fmi2.h"

const char* fmi2GetTypesPlatform(void) { return "default"; }
const char* fmi2GetVersion(void) { return "2.0"; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions* callbacks, fmi2Boolean visible, fmi2Boolean logging) {
  (void)name, (void)type, (void)guid, (void)resources, (void)callbacks, (void)visible, (void)logging;
  Strict* s = calloc(1, sizeof *s);
  strict_begin(s);
  return s;
}
void fmi2FreeInstance(fmi2Component c) {
  strict_end(c);
  free(c);
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start, fmi2Boolean s,
                               fmi2Real stop) {
  (void)t, (void)tolerance, (void)s, (void)stop;
  strict_start(c, start);
  return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  (void)c;
  strict_call("enter");
  return fmi2OK;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  strict_exit(c);
  return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) {
  (void)c;
  return fmi2OK;
}
fmi2Status fmi2Reset(fmi2Component c) {
  strict_reset(c);
  return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[]) {
  for (size_t k = 0; k < n; ++k) {
    if (!strict_get(c, r[k], &v[k])) return fmi2Error;
  }
  return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[]) {
  for (size_t k = 0; k < n; ++k) {
    if (!strict_set(c, r[k], v[k])) return fmi2Error;
  }
  return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer v[]) {
  (void)c, (void)r, (void)n, (void)v;
  return fmi2Error;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer v[]) {
  Strict* s = c;
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kMode || s->m == NULL) return fmi2Error;
    s->m->mode = v[k];
  }
  return fmi2OK;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean v[]) {
  (void)c, (void)r, (void)n, (void)v;
  return fmi2Error;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean v[]) {
  (void)c, (void)r, (void)n, (void)v;
  return fmi2Error;
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String v[]) {
  (void)c, (void)r, (void)n, (void)v;
  return fmi2Error;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String v[]) {
  (void)c, (void)r, (void)n, (void)v;
  return fmi2Error;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* state) {
  if (*state == NULL) *state = malloc(sizeof(Memory));
  memcpy(*state, ((Strict*)c)->m, sizeof(Memory));
  return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  Strict* s = c;
  if (!strict_may_be_set(s, state)) return fmi2Error;
  memcpy(s->m, state, sizeof(Memory));
  return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* state) {
  (void)c;
  free(*state);
  *state = NULL;
  return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t* size) {
  (void)c, (void)state;
  *size = sizeof(Memory);
  return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte b[], size_t size) {
  (void)c;
  memcpy(b, state, size);
  return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t size, fmi2FMUstate* state) {
  (void)c;
  *state = malloc(size);
  memcpy(*state, b, size);
  return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real h, fmi2Boolean stays) {
  return strict_step(c, now, h, stays != fmi2False) ? fmi2OK : fmi2Discard;
}
