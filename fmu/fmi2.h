/* The C interface of FMI 2.0.4, Co-Simulation and Model Exchange, as an FMU offers it. An exporter defines these functions; an
 * importer finds them by name in a shared library and calls them as decltype(&fmi2DoStep). */
#pragma once
#include <stddef.h>

#if defined(_WIN32) && defined(COTWIN_FMI_EXPORTS)
#define COTWIN_FMI __declspec(dllexport)
#elif defined(COTWIN_FMI_EXPORTS)
#define COTWIN_FMI __attribute__((visibility("default")))
#else
#define COTWIN_FMI
#endif

/* Platform-dependent types (2.1.2): the platform is "default". */
typedef void* fmi2Component;
typedef void* fmi2ComponentEnvironment;
typedef void* fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char* fmi2String;
typedef char fmi2Byte;

enum { fmi2False = 0, fmi2True = 1 };

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;

typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment, fmi2String instanceName, fmi2Status, fmi2String category,
                                   fmi2String message, ...);
typedef void* (*fmi2CallbackAllocateMemory)(size_t count, size_t size);
typedef void (*fmi2CallbackFreeMemory)(void*);
typedef void (*fmi2StepFinished)(fmi2ComponentEnvironment, fmi2Status);

typedef struct {
  fmi2CallbackLogger logger;
  fmi2CallbackAllocateMemory allocateMemory;
  fmi2CallbackFreeMemory freeMemory;
  fmi2StepFinished stepFinished;
  fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
  fmi2Boolean newDiscreteStatesNeeded;
  fmi2Boolean terminateSimulation;
  fmi2Boolean nominalsOfContinuousStatesChanged;
  fmi2Boolean valuesOfContinuousStatesChanged;
  fmi2Boolean nextEventTimeDefined;
  fmi2Real nextEventTime;
} fmi2EventInfo;

#ifdef __cplusplus
extern "C" {
#endif

/* Version and logging (2.1.4, 2.1.5) */
COTWIN_FMI const char* fmi2GetTypesPlatform(void);
COTWIN_FMI const char* fmi2GetVersion(void);
COTWIN_FMI fmi2Status fmi2SetDebugLogging(fmi2Component, fmi2Boolean loggingOn, size_t n, const fmi2String categories[]);

/* Creation, initialisation, end (2.1.5, 2.1.6) */
COTWIN_FMI fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type, fmi2String guid, fmi2String resourceLocation,
                                         const fmi2CallbackFunctions*, fmi2Boolean visible, fmi2Boolean loggingOn);
COTWIN_FMI void fmi2FreeInstance(fmi2Component);
COTWIN_FMI fmi2Status fmi2SetupExperiment(fmi2Component, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                                          fmi2Boolean stopTimeDefined, fmi2Real stopTime);
COTWIN_FMI fmi2Status fmi2EnterInitializationMode(fmi2Component);
COTWIN_FMI fmi2Status fmi2ExitInitializationMode(fmi2Component);
COTWIN_FMI fmi2Status fmi2Terminate(fmi2Component);
COTWIN_FMI fmi2Status fmi2Reset(fmi2Component);

/* Values (2.1.7) */
COTWIN_FMI fmi2Status fmi2GetReal(fmi2Component, const fmi2ValueReference[], size_t n, fmi2Real[]);
COTWIN_FMI fmi2Status fmi2GetInteger(fmi2Component, const fmi2ValueReference[], size_t n, fmi2Integer[]);
COTWIN_FMI fmi2Status fmi2GetBoolean(fmi2Component, const fmi2ValueReference[], size_t n, fmi2Boolean[]);
COTWIN_FMI fmi2Status fmi2GetString(fmi2Component, const fmi2ValueReference[], size_t n, fmi2String[]);
COTWIN_FMI fmi2Status fmi2SetReal(fmi2Component, const fmi2ValueReference[], size_t n, const fmi2Real[]);
COTWIN_FMI fmi2Status fmi2SetInteger(fmi2Component, const fmi2ValueReference[], size_t n, const fmi2Integer[]);
COTWIN_FMI fmi2Status fmi2SetBoolean(fmi2Component, const fmi2ValueReference[], size_t n, const fmi2Boolean[]);
COTWIN_FMI fmi2Status fmi2SetString(fmi2Component, const fmi2ValueReference[], size_t n, const fmi2String[]);

/* State (2.1.8) */
COTWIN_FMI fmi2Status fmi2GetFMUstate(fmi2Component, fmi2FMUstate*);
COTWIN_FMI fmi2Status fmi2SetFMUstate(fmi2Component, fmi2FMUstate);
COTWIN_FMI fmi2Status fmi2FreeFMUstate(fmi2Component, fmi2FMUstate*);
COTWIN_FMI fmi2Status fmi2SerializedFMUstateSize(fmi2Component, fmi2FMUstate, size_t* size);
COTWIN_FMI fmi2Status fmi2SerializeFMUstate(fmi2Component, fmi2FMUstate, fmi2Byte[], size_t size);
COTWIN_FMI fmi2Status fmi2DeSerializeFMUstate(fmi2Component, const fmi2Byte[], size_t size, fmi2FMUstate*);

/* Partial derivatives (2.1.9) */
COTWIN_FMI fmi2Status fmi2GetDirectionalDerivative(fmi2Component, const fmi2ValueReference unknowns[], size_t nUnknowns,
                                                   const fmi2ValueReference knowns[], size_t nKnowns, const fmi2Real dKnowns[],
                                                   fmi2Real dUnknowns[]);

/* Model Exchange (3.2) */
COTWIN_FMI fmi2Status fmi2EnterEventMode(fmi2Component);
COTWIN_FMI fmi2Status fmi2NewDiscreteStates(fmi2Component, fmi2EventInfo*);
COTWIN_FMI fmi2Status fmi2EnterContinuousTimeMode(fmi2Component);
COTWIN_FMI fmi2Status fmi2CompletedIntegratorStep(fmi2Component, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                                  fmi2Boolean* enterEventMode, fmi2Boolean* terminateSimulation);
COTWIN_FMI fmi2Status fmi2SetTime(fmi2Component, fmi2Real time);
COTWIN_FMI fmi2Status fmi2SetContinuousStates(fmi2Component, const fmi2Real x[], size_t n);
COTWIN_FMI fmi2Status fmi2GetDerivatives(fmi2Component, fmi2Real dx[], size_t n);
COTWIN_FMI fmi2Status fmi2GetEventIndicators(fmi2Component, fmi2Real z[], size_t n);
COTWIN_FMI fmi2Status fmi2GetContinuousStates(fmi2Component, fmi2Real x[], size_t n);
COTWIN_FMI fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component, fmi2Real nominals[], size_t n);

/* Co-Simulation (4.2) */
COTWIN_FMI fmi2Status fmi2SetRealInputDerivatives(fmi2Component, const fmi2ValueReference[], size_t n,
                                                  const fmi2Integer order[], const fmi2Real[]);
COTWIN_FMI fmi2Status fmi2GetRealOutputDerivatives(fmi2Component, const fmi2ValueReference[], size_t n,
                                                   const fmi2Integer order[], fmi2Real[]);
COTWIN_FMI fmi2Status fmi2DoStep(fmi2Component, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                                 fmi2Boolean noSetFMUStatePriorToCurrentPoint);
COTWIN_FMI fmi2Status fmi2CancelStep(fmi2Component);
COTWIN_FMI fmi2Status fmi2GetStatus(fmi2Component, fmi2StatusKind, fmi2Status*);
COTWIN_FMI fmi2Status fmi2GetRealStatus(fmi2Component, fmi2StatusKind, fmi2Real*);
COTWIN_FMI fmi2Status fmi2GetIntegerStatus(fmi2Component, fmi2StatusKind, fmi2Integer*);
COTWIN_FMI fmi2Status fmi2GetBooleanStatus(fmi2Component, fmi2StatusKind, fmi2Boolean*);
COTWIN_FMI fmi2Status fmi2GetStringStatus(fmi2Component, fmi2StatusKind, fmi2String*);

#ifdef __cplusplus
}
#endif
