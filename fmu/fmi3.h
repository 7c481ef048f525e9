/* The C interface of FMI 3.0.2, Co-Simulation, Model Exchange and Scheduled Execution, as an FMU offers it. An exporter defines
 * these functions; an importer finds them by name in a shared library and calls them as decltype(&fmi3DoStep). */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "fmu/fmi2.h" /* COTWIN_FMI */

/* Types (2.2.2) */
typedef void* fmi3Instance;
typedef void* fmi3InstanceEnvironment;
typedef void* fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef char fmi3Char;
typedef const fmi3Char* fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte* fmi3Binary;
typedef bool fmi3Clock;

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;

typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String category, fmi3String message);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64 intermediateUpdateTime,
                                               fmi3Boolean intermediateVariableSetRequested,
                                               fmi3Boolean intermediateVariableGetAllowed, fmi3Boolean intermediateStepFinished,
                                               fmi3Boolean canReturnEarly, fmi3Boolean* earlyReturnRequested,
                                               fmi3Float64* earlyReturnTime);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);

#ifdef __cplusplus
extern "C" {
#endif

/* Version and logging (2.3.1) */
COTWIN_FMI const char* fmi3GetVersion(void);
COTWIN_FMI fmi3Status fmi3SetDebugLogging(fmi3Instance, fmi3Boolean loggingOn, size_t n, const fmi3String categories[]);

/* Creation, initialisation, end (2.3.2, 2.3.3, 2.3.4) */
COTWIN_FMI fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                                     fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                                     fmi3InstanceEnvironment, fmi3LogMessageCallback);
COTWIN_FMI fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                                    fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                                    fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                                    const fmi3ValueReference requiredIntermediateVariables[],
                                                    size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment,
                                                    fmi3LogMessageCallback, fmi3IntermediateUpdateCallback);
COTWIN_FMI fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken,
                                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                                          fmi3InstanceEnvironment, fmi3LogMessageCallback,
                                                          fmi3ClockUpdateCallback, fmi3LockPreemptionCallback,
                                                          fmi3UnlockPreemptionCallback);
COTWIN_FMI void fmi3FreeInstance(fmi3Instance);
COTWIN_FMI fmi3Status fmi3EnterInitializationMode(fmi3Instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                                  fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime);
COTWIN_FMI fmi3Status fmi3ExitInitializationMode(fmi3Instance);
COTWIN_FMI fmi3Status fmi3EnterEventMode(fmi3Instance);
COTWIN_FMI fmi3Status fmi3Terminate(fmi3Instance);
COTWIN_FMI fmi3Status fmi3Reset(fmi3Instance);

/* Values (2.2.6) */
COTWIN_FMI fmi3Status fmi3GetFloat32(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Float32 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetFloat64(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Float64 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetInt8(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Int8 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetUInt8(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3UInt8 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetInt16(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Int16 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetUInt16(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3UInt16 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetInt32(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Int32 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetUInt32(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3UInt32 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetInt64(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Int64 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetUInt64(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3UInt64 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetBoolean(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Boolean values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetString(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3String values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3GetBinary(fmi3Instance, const fmi3ValueReference[], size_t n, size_t sizes[], fmi3Binary values[],
                                    size_t nValues);
COTWIN_FMI fmi3Status fmi3GetClock(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Clock values[]);
COTWIN_FMI fmi3Status fmi3SetFloat32(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Float32 values[],
                                     size_t nValues);
COTWIN_FMI fmi3Status fmi3SetFloat64(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Float64 values[],
                                     size_t nValues);
COTWIN_FMI fmi3Status fmi3SetInt8(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Int8 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3SetUInt8(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3UInt8 values[],
                                   size_t nValues);
COTWIN_FMI fmi3Status fmi3SetInt16(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Int16 values[],
                                   size_t nValues);
COTWIN_FMI fmi3Status fmi3SetUInt16(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3UInt16 values[],
                                    size_t nValues);
COTWIN_FMI fmi3Status fmi3SetInt32(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Int32 values[],
                                   size_t nValues);
COTWIN_FMI fmi3Status fmi3SetUInt32(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3UInt32 values[],
                                    size_t nValues);
COTWIN_FMI fmi3Status fmi3SetInt64(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Int64 values[],
                                   size_t nValues);
COTWIN_FMI fmi3Status fmi3SetUInt64(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3UInt64 values[],
                                    size_t nValues);
COTWIN_FMI fmi3Status fmi3SetBoolean(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Boolean values[],
                                     size_t nValues);
COTWIN_FMI fmi3Status fmi3SetString(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3String values[],
                                    size_t nValues);
COTWIN_FMI fmi3Status fmi3SetBinary(fmi3Instance, const fmi3ValueReference[], size_t n, const size_t sizes[],
                                    const fmi3Binary values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3SetClock(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Clock values[]);

/* Dependencies (2.2.10) */
COTWIN_FMI fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance, fmi3ValueReference, size_t* nDependencies);
COTWIN_FMI fmi3Status fmi3GetVariableDependencies(fmi3Instance, fmi3ValueReference dependent, size_t elementsOfDependent[],
                                                  fmi3ValueReference independents[], size_t elementsOfIndependents[],
                                                  fmi3DependencyKind kinds[], size_t nDependencies);

/* State (2.2.11) */
COTWIN_FMI fmi3Status fmi3GetFMUState(fmi3Instance, fmi3FMUState*);
COTWIN_FMI fmi3Status fmi3SetFMUState(fmi3Instance, fmi3FMUState);
COTWIN_FMI fmi3Status fmi3FreeFMUState(fmi3Instance, fmi3FMUState*);
COTWIN_FMI fmi3Status fmi3SerializedFMUStateSize(fmi3Instance, fmi3FMUState, size_t* size);
COTWIN_FMI fmi3Status fmi3SerializeFMUState(fmi3Instance, fmi3FMUState, fmi3Byte[], size_t size);
COTWIN_FMI fmi3Status fmi3DeserializeFMUState(fmi3Instance, const fmi3Byte[], size_t size, fmi3FMUState*);

/* Partial derivatives (2.2.12) */
COTWIN_FMI fmi3Status fmi3GetDirectionalDerivative(fmi3Instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                                   const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                                   size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity);
COTWIN_FMI fmi3Status fmi3GetAdjointDerivative(fmi3Instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                               const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                               size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity);

/* Configuration (2.3.2) */
COTWIN_FMI fmi3Status fmi3EnterConfigurationMode(fmi3Instance);
COTWIN_FMI fmi3Status fmi3ExitConfigurationMode(fmi3Instance);

/* Clocks (2.2.9) and discrete states (2.3.5) */
COTWIN_FMI fmi3Status fmi3GetIntervalDecimal(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Float64 intervals[],
                                             fmi3IntervalQualifier[]);
COTWIN_FMI fmi3Status fmi3GetIntervalFraction(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3UInt64 counters[],
                                              fmi3UInt64 resolutions[], fmi3IntervalQualifier[]);
COTWIN_FMI fmi3Status fmi3GetShiftDecimal(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3Float64 shifts[]);
COTWIN_FMI fmi3Status fmi3GetShiftFraction(fmi3Instance, const fmi3ValueReference[], size_t n, fmi3UInt64 counters[],
                                           fmi3UInt64 resolutions[]);
COTWIN_FMI fmi3Status fmi3SetIntervalDecimal(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Float64 intervals[]);
COTWIN_FMI fmi3Status fmi3SetIntervalFraction(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3UInt64 counters[],
                                              const fmi3UInt64 resolutions[]);
COTWIN_FMI fmi3Status fmi3SetShiftDecimal(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Float64 shifts[]);
COTWIN_FMI fmi3Status fmi3SetShiftFraction(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3UInt64 counters[],
                                           const fmi3UInt64 resolutions[]);
COTWIN_FMI fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance);
COTWIN_FMI fmi3Status fmi3UpdateDiscreteStates(fmi3Instance, fmi3Boolean* discreteStatesNeedUpdate,
                                               fmi3Boolean* terminateSimulation, fmi3Boolean* nominalsOfContinuousStatesChanged,
                                               fmi3Boolean* valuesOfContinuousStatesChanged, fmi3Boolean* nextEventTimeDefined,
                                               fmi3Float64* nextEventTime);

/* Model Exchange (3.2) */
COTWIN_FMI fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance);
COTWIN_FMI fmi3Status fmi3CompletedIntegratorStep(fmi3Instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                                  fmi3Boolean* enterEventMode, fmi3Boolean* terminateSimulation);
COTWIN_FMI fmi3Status fmi3SetTime(fmi3Instance, fmi3Float64 time);
COTWIN_FMI fmi3Status fmi3SetContinuousStates(fmi3Instance, const fmi3Float64 x[], size_t n);
COTWIN_FMI fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance, fmi3Float64 dx[], size_t n);
COTWIN_FMI fmi3Status fmi3GetEventIndicators(fmi3Instance, fmi3Float64 z[], size_t n);
COTWIN_FMI fmi3Status fmi3GetContinuousStates(fmi3Instance, fmi3Float64 x[], size_t n);
COTWIN_FMI fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance, fmi3Float64 nominals[], size_t n);
COTWIN_FMI fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance, size_t* n);
COTWIN_FMI fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance, size_t* n);

/* Co-Simulation (4.2) */
COTWIN_FMI fmi3Status fmi3EnterStepMode(fmi3Instance);
COTWIN_FMI fmi3Status fmi3GetOutputDerivatives(fmi3Instance, const fmi3ValueReference[], size_t n, const fmi3Int32 orders[],
                                               fmi3Float64 values[], size_t nValues);
COTWIN_FMI fmi3Status fmi3DoStep(fmi3Instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                                 fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean* eventHandlingNeeded,
                                 fmi3Boolean* terminateSimulation, fmi3Boolean* earlyReturn, fmi3Float64* lastSuccessfulTime);

/* Scheduled Execution (5.2) */
COTWIN_FMI fmi3Status fmi3ActivateModelPartition(fmi3Instance, fmi3ValueReference clock, fmi3Float64 activationTime);

#ifdef __cplusplus
}
#endif
