/* The model of ball.h for Model Exchange in FMI 2.0. */
#include <stdlib.h>

#include "fmu/fmi2.h"
#include "tests/fmu/fmus/ball.h"

typedef struct {
  Model m;
  const fmi2CallbackFunctions* callbacks;
} Instance;

static fmi2Status status(bool good) { return good ? fmi2OK : fmi2Error; }

const char* fmi2GetTypesPlatform(void) { return "default"; }
const char* fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  (void)c, (void)on, (void)n, (void)categories;
  return fmi2OK;
}
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions* callbacks, fmi2Boolean visible, fmi2Boolean logging) {
  (void)name, (void)guid, (void)resources, (void)visible, (void)logging;
  if (type != fmi2ModelExchange) return NULL;
  Instance* i = calloc(1, sizeof *i);
  i->callbacks = callbacks;
  model_begin(&i->m);
  return i;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start, fmi2Boolean s,
                               fmi2Real stop) {
  (void)t, (void)tolerance, (void)s, (void)stop;
  ((Instance*)c)->m.t = start;
  return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return status(c != NULL); }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return status(c != NULL); }
fmi2Status fmi2Terminate(fmi2Component c) { return status(c != NULL); }
fmi2Status fmi2Reset(fmi2Component c) {
  model_begin(&((Instance*)c)->m);
  return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[]) {
  bool good = true;
  for (size_t k = 0; k < n; ++k) good = model_get_real(&((Instance*)c)->m, r[k], &v[k]) && good;
  return status(good);
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer v[]) {
  bool good = true;
  for (size_t k = 0; k < n; ++k) good = model_get_integer(&((Instance*)c)->m, r[k], &v[k]) && good;
  return status(good);
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean v[]) {
  (void)c, (void)r, (void)v;
  return status(n == 0);
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String v[]) {
  (void)c, (void)r, (void)v;
  return status(n == 0);
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[]) {
  for (size_t k = 0; k < n; ++k) {
    double* p = model_real(&((Instance*)c)->m, r[k]);
    if (p == NULL) return fmi2Error;
    *p = v[k];
  }
  return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer v[]) {
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kMode) return fmi2Error;
    ((Instance*)c)->m.mode = v[k];
  }
  return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean v[]) {
  (void)c, (void)r, (void)v;
  return status(n == 0);
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String v[]) {
  (void)c, (void)r, (void)v;
  return status(n == 0);
}
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* s) {
  if (*s == NULL) *s = malloc(sizeof(Model));
  memcpy(*s, &((Instance*)c)->m, sizeof(Model));
  return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) {
  memcpy(&((Instance*)c)->m, s, sizeof(Model));
  return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* s) {
  (void)c;
  free(*s);
  *s = NULL;
  return fmi2OK;
}
fmi2Status fmi2EnterEventMode(fmi2Component c) { return status(c != NULL); }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo* info) {
  Model* m = &((Instance*)c)->m;
  memset(info, 0, sizeof *info);
  info->valuesOfContinuousStatesChanged = model_event(m);
  info->newDiscreteStatesNeeded = m->mode == kEndlessEvents;
  info->nextEventTimeDefined = fmi2True;
  info->nextEventTime = model_next_event(m);
  return fmi2OK;
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return status(c != NULL); }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set_back, fmi2Boolean* event, fmi2Boolean* terminate) {
  (void)no_set_back;
  *event = model_asks_for_event(&((Instance*)c)->m);
  *terminate = fmi2False;
  return fmi2OK;
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t) {
  ((Instance*)c)->m.t = t;
  return fmi2OK;
}
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
  memcpy(((Instance*)c)->m.x, x, n * sizeof *x);
  return status(n == kStates);
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n) {
  (void)n;
  return status(model_derivatives(&((Instance*)c)->m, dx));
}
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n) {
  z[0] = model_indicator(&((Instance*)c)->m);
  return status(n == 1);
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
  memcpy(x, ((Instance*)c)->m.x, n * sizeof *x);
  return status(n == kStates);
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n) {
  (void)c;
  for (size_t k = 0; k < n; ++k) nominals[k] = k == 2 ? 1e3 : 1;
  return fmi2OK;
}
