/* An FMU with nothing but its model, for Co-Simulation in FMI 2.0.4, which conveyor.c and cell.c include: the value reference of a variable is
 * its index in the array of its type. The model defines the three functions below. */
#include <stdlib.h>
#include <string.h>

enum { kReals = 32, kIntegers = 4, kBooleans = 4 };

typedef struct {
  double time;  // s, of the last communication point
  double real[kReals];
  int integer[kIntegers];
  int boolean[kBooleans];
} Model;

static void begin(Model* m);              // start values
static void initialise(Model* m);         // outputs at the start, from parameters and inputs
static void advance(Model* m, double h);  // outputs at m->time + h

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error } fmi2Status;

#define FMI __attribute__((visibility("default")))
#define UNUSED(x) (void)(x)

FMI const char* fmi2GetTypesPlatform(void) { return "default"; }
FMI const char* fmi2GetVersion(void) { return "2.0"; }

FMI void* fmi2Instantiate(const char* name, int type, const char* guid, const char* resources, const void* callbacks,
                          int visible, int logging) {
  UNUSED(name), UNUSED(guid), UNUSED(resources), UNUSED(callbacks), UNUSED(visible), UNUSED(logging);
  Model* m = type == 1 ? calloc(1, sizeof *m) : NULL;  // 1: Co-Simulation
  if (m != NULL) begin(m);
  return m;
}
FMI void fmi2FreeInstance(void* c) { free(c); }
FMI fmi2Status fmi2Reset(void* c) { return begin(c), fmi2OK; }
FMI fmi2Status fmi2SetDebugLogging(void* c, int on, size_t n, const char* const categories[]) {
  return UNUSED(c), UNUSED(on), UNUSED(n), UNUSED(categories), fmi2OK;
}

FMI fmi2Status fmi2SetupExperiment(void* c, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
  UNUSED(has_tolerance), UNUSED(tolerance), UNUSED(has_stop), UNUSED(stop);
  ((Model*)c)->time = start;
  return fmi2OK;
}
FMI fmi2Status fmi2EnterInitializationMode(void* c) { return initialise(c), fmi2OK; }
FMI fmi2Status fmi2ExitInitializationMode(void* c) { return initialise(c), fmi2OK; }
FMI fmi2Status fmi2Terminate(void* c) { return UNUSED(c), fmi2OK; }

FMI fmi2Status fmi2DoStep(void* c, double now, double h, int no_state_before) {
  UNUSED(now), UNUSED(no_state_before);
  advance(c, h);
  ((Model*)c)->time += h;
  return fmi2OK;
}
FMI fmi2Status fmi2CancelStep(void* c) { return UNUSED(c), fmi2Error; }

#define ACCESS(Name, type, array, size)                                                             \
  FMI fmi2Status fmi2Get##Name(void* c, const unsigned reference[], size_t n, type value[]) {       \
    for (size_t i = 0; i < n; ++i) {                                                                \
      if (reference[i] >= (size)) return fmi2Error;                                                 \
      value[i] = ((Model*)c)->array[reference[i]];                                                  \
    }                                                                                               \
    return fmi2OK;                                                                                  \
  }                                                                                                 \
  FMI fmi2Status fmi2Set##Name(void* c, const unsigned reference[], size_t n, const type value[]) { \
    for (size_t i = 0; i < n; ++i) {                                                                \
      if (reference[i] >= (size)) return fmi2Error;                                                 \
      ((Model*)c)->array[reference[i]] = value[i];                                                  \
    }                                                                                               \
    return fmi2OK;                                                                                  \
  }
ACCESS(Real, double, real, kReals)
ACCESS(Integer, int, integer, kIntegers)
ACCESS(Boolean, int, boolean, kBooleans)
FMI fmi2Status fmi2GetString(void* c, const unsigned reference[], size_t n, const char* value[]) {
  return UNUSED(c), UNUSED(reference), UNUSED(value), n == 0 ? fmi2OK : fmi2Error;
}
FMI fmi2Status fmi2SetString(void* c, const unsigned reference[], size_t n, const char* const value[]) {
  return UNUSED(c), UNUSED(reference), UNUSED(value), n == 0 ? fmi2OK : fmi2Error;
}

/* A state is a copy of the model. */
FMI fmi2Status fmi2GetFMUstate(void* c, void** state) {
  if (*state == NULL) *state = malloc(sizeof(Model));
  if (*state == NULL) return fmi2Error;
  memcpy(*state, c, sizeof(Model));
  return fmi2OK;
}
FMI fmi2Status fmi2SetFMUstate(void* c, void* state) { return memcpy(c, state, sizeof(Model)), fmi2OK; }
FMI fmi2Status fmi2FreeFMUstate(void* c, void** state) {
  UNUSED(c);
  free(*state);
  *state = NULL;
  return fmi2OK;
}
FMI fmi2Status fmi2SerializedFMUstateSize(void* c, void* state, size_t* size) {
  return UNUSED(c), UNUSED(state), *size = sizeof(Model), fmi2OK;
}
FMI fmi2Status fmi2SerializeFMUstate(void* c, void* state, char bytes[], size_t size) {
  return UNUSED(c), size < sizeof(Model) ? fmi2Error : (memcpy(bytes, state, sizeof(Model)), fmi2OK);
}
FMI fmi2Status fmi2DeSerializeFMUstate(void* c, const char bytes[], size_t size, void** state) {
  if (size != sizeof(Model) || fmi2GetFMUstate(c, state) != fmi2OK) return fmi2Error;
  memcpy(*state, bytes, size);
  return fmi2OK;
}

/* The standard wants these also of an FMU that has no derivatives and no step that goes on by itself. */
FMI fmi2Status fmi2GetDirectionalDerivative(void* c, const unsigned unknown[], size_t unknowns, const unsigned known[],
                                            size_t knowns, const double seed[], double result[]) {
  UNUSED(c), UNUSED(unknown), UNUSED(unknowns), UNUSED(known), UNUSED(knowns), UNUSED(seed), UNUSED(result);
  return fmi2Error;
}
FMI fmi2Status fmi2SetRealInputDerivatives(void* c, const unsigned reference[], size_t n, const int order[],
                                           const double value[]) {
  return UNUSED(c), UNUSED(reference), UNUSED(n), UNUSED(order), UNUSED(value), fmi2Error;
}
FMI fmi2Status fmi2GetRealOutputDerivatives(void* c, const unsigned reference[], size_t n, const int order[], double value[]) {
  return UNUSED(c), UNUSED(reference), UNUSED(n), UNUSED(order), UNUSED(value), fmi2Error;
}
#define STATUS(Kind, type) \
  FMI fmi2Status fmi2Get##Kind(void* c, int kind, type* value) { return UNUSED(c), UNUSED(kind), UNUSED(value), fmi2Discard; }
STATUS(Status, fmi2Status)
STATUS(RealStatus, double)
STATUS(IntegerStatus, int)
STATUS(BooleanStatus, int)
STATUS(StringStatus, const char*)
