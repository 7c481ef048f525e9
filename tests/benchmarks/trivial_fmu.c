/* An FMU for Co-Simulation (FMI 2.0) with the least possible work: y += 1e-3 + 1e-6 u in every step. u is 1, y is 2. */
#include <stdlib.h>

#include "fmu/fmi2.h"

typedef struct {
  fmi2Real u, y;
} Instance;

const char* fmi2GetTypesPlatform(void) { return "default"; }
const char* fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return fmi2OK;
}
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions* callbacks, fmi2Boolean visible, fmi2Boolean logging) {
  (void)name, (void)type, (void)guid, (void)resources, (void)callbacks, (void)visible, (void)logging;
  return calloc(1, sizeof(Instance));
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start, fmi2Boolean s,
                               fmi2Real stop) {
  (void)c, (void)t, (void)tolerance, (void)start, (void)s, (void)stop;
  return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2Reset(fmi2Component c) {
  *(Instance*)c = (Instance){0, 0};
  return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[]) {
  const Instance* i = c;
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != 1 && r[k] != 2) return fmi2Error;
    v[k] = r[k] == 1 ? i->u : i->y;
  }
  return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[]) {
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != 1) return fmi2Error;
    ((Instance*)c)->u = v[k];
  }
  return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real h, fmi2Boolean keep) {
  Instance* i = c;
  (void)now, (void)h, (void)keep;
  i->y += 1e-3 + 1e-6 * i->u;
  return fmi2OK;
}

/* There are no variables of other types. */
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer v[]) {
  (void)c, (void)r, (void)v;
  return n == 0 ? fmi2OK : fmi2Error;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean v[]) {
  (void)c, (void)r, (void)v;
  return n == 0 ? fmi2OK : fmi2Error;
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String v[]) {
  (void)c, (void)r, (void)v;
  return n == 0 ? fmi2OK : fmi2Error;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer v[]) {
  (void)c, (void)r, (void)v;
  return n == 0 ? fmi2OK : fmi2Error;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean v[]) {
  (void)c, (void)r, (void)v;
  return n == 0 ? fmi2OK : fmi2Error;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String v[]) {
  (void)c, (void)r, (void)v;
  return n == 0 ? fmi2OK : fmi2Error;
}

/* FMI 2 requires these functions of every FMU for Co-Simulation, and some masters load none without them. */
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* state) {
  (void)c, (void)state;
  return fmi2Error;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  (void)c, (void)state;
  return fmi2Error;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* state) {
  (void)c, (void)state;
  return fmi2Error;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t* size) {
  (void)c, (void)state, (void)size;
  return fmi2Error;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  (void)c, (void)state, (void)bytes, (void)size;
  return fmi2Error;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate* state) {
  (void)c, (void)bytes, (void)size, (void)state;
  return fmi2Error;
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n,
                                        const fmi2ValueReference knowns[], size_t m, const fmi2Real seed[], fmi2Real values[]) {
  (void)c, (void)unknowns, (void)n, (void)knowns, (void)m, (void)seed, (void)values;
  return fmi2Error;
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                       const fmi2Real v[]) {
  (void)c, (void)r, (void)n, (void)order, (void)v;
  return fmi2Error;
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                        fmi2Real v[]) {
  (void)c, (void)r, (void)n, (void)order, (void)v;
  return fmi2Error;
}
fmi2Status fmi2CancelStep(fmi2Component c) {
  (void)c;
  return fmi2Error;
}
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status* value) {
  (void)c, (void)kind, (void)value;
  return fmi2Error;
}
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real* value) {
  (void)c, (void)kind, (void)value;
  return fmi2Error;
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer* value) {
  (void)c, (void)kind, (void)value;
  return fmi2Error;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean* value) {
  (void)c, (void)kind, (void)value;
  return fmi2Error;
}
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String* value) {
  (void)c, (void)kind, (void)value;
  return fmi2Error;
}
