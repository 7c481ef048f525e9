/* The model of ball.h for Model Exchange in FMI 3.0. */
#include <stdlib.h>

#include "fmu/fmi3.h"
#include "tests/fmu/fmus/ball.h"

static fmi3Status status(bool good) { return good ? fmi3OK : fmi3Error; }

const char* fmi3GetVersion(void) { return "3.0"; }
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging,
                                          void* environment, fmi3LogMessageCallback log) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)log;
  Model* m = calloc(1, sizeof *m);
  model_begin(m);
  return m;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, bool t, double tolerance, double start, bool s, double stop) {
  (void)t, (void)tolerance, (void)s, (void)stop;
  ((Model*)c)->t = start;
  return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return status(c != NULL); }
fmi3Status fmi3EnterEventMode(fmi3Instance c) { return status(c != NULL); }
fmi3Status fmi3Terminate(fmi3Instance c) { return status(c != NULL); }
fmi3Status fmi3Reset(fmi3Instance c) {
  model_begin(c);
  return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, double v[], size_t nv) {
  bool good = n == nv;
  for (size_t k = 0; k < n; ++k) good = model_get_real(c, r[k], &v[k]) && good;
  return status(good);
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const double v[], size_t nv) {
  (void)nv;
  for (size_t k = 0; k < n; ++k) {
    double* p = model_real(c, r[k]);
    if (p == NULL) return fmi3Error;
    *p = v[k];
  }
  return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, int32_t v[], size_t nv) {
  bool good = n == nv;
  for (size_t k = 0; k < n; ++k) good = model_get_integer(c, r[k], &v[k]) && good;
  return status(good);
}
fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const int32_t v[], size_t nv) {
  (void)nv;
  for (size_t k = 0; k < n; ++k) {
    if (r[k] != kMode) return fmi3Error;
    ((Model*)c)->mode = v[k];
  }
  return fmi3OK;
}
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState* s) {
  if (*s == NULL) *s = malloc(sizeof(Model));
  memcpy(*s, c, sizeof(Model));
  return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) {
  memcpy(c, s, sizeof(Model));
  return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState* s) {
  (void)c;
  free(*s);
  *s = NULL;
  return fmi3OK;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, bool* again, bool* terminate, bool* nominals, bool* states, bool* defined,
                                    double* next) {
  Model* m = c;
  *states = model_event(m);
  *again = m->mode == kEndlessEvents;
  *terminate = *nominals = false;
  *defined = true;
  *next = model_next_event(m);
  return fmi3OK;
}
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { return status(c != NULL); }
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, bool no_set_back, bool* event, bool* terminate) {
  (void)no_set_back;
  *event = model_asks_for_event(c);
  *terminate = false;
  return fmi3OK;
}
fmi3Status fmi3SetTime(fmi3Instance c, double t) {
  ((Model*)c)->t = t;
  return fmi3OK;
}
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const double x[], size_t n) {
  memcpy(((Model*)c)->x, x, n * sizeof *x);
  return status(n == kStates);
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, double dx[], size_t n) {
  (void)n;
  return status(model_derivatives(c, dx));
}
fmi3Status fmi3GetEventIndicators(fmi3Instance c, double z[], size_t n) {
  z[0] = model_indicator(c);
  return status(n == 1);
}
fmi3Status fmi3GetContinuousStates(fmi3Instance c, double x[], size_t n) {
  memcpy(x, ((Model*)c)->x, n * sizeof *x);
  return status(n == kStates);
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, double nominals[], size_t n) {
  (void)c;
  for (size_t k = 0; k < n; ++k) nominals[k] = k == 2 ? 1e3 : 1;
  return fmi3OK;
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t* n) {
  *n = 1;
  return status(c != NULL);
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t* n) {
  *n = ((Model*)c)->mode == kManyStates ? (size_t)1 << 40 : kStates;
  return fmi3OK;
}
