// The C interface of FMI 3.0.2 Co-Simulation of an exported unit: translates calls, types and status for export.cpp.
#include <cstring>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "fmu/export/export.h"
#include "fmu/fmi3.h"
#include "models/foundation/support/error.h"

namespace {

using cotwin::Error;
using namespace cotwin::fmu;

fmi3Status to_fmi(Status status) { return static_cast<fmi3Status>(status); }

template <class Body>
fmi3Status call(fmi3Instance instance, const char* function, unsigned allowed, Body body) {
  auto* exported = static_cast<Exported*>(instance);
  return to_fmi(guarded(exported, function, allowed, [&](Exported& e) {
    if constexpr (std::is_void_v<decltype(body(e))>) {
      body(e);
      return Status::kOk;
    } else {
      return body(e);
    }
  }));
}

/// Reports a call of a function that this FMU does not support.
fmi3Status unsupported(fmi3Instance instance, const char* function, const char* why) {
  return call(instance, function, kAnyState, [&](Exported&) { throw Error(why); });
}
constexpr const char* kNoModelExchange = "belongs to Model Exchange, which this FMU does not support";
constexpr const char* kNoEvents = "there is no Event Mode (hasEventMode=false)";
constexpr const char* kNoDependencies = "not supported (providesPerElementDependencies=false)";
constexpr const char* kNoConfiguration = "there are no structural parameters";

/// Returns an array argument as a span. NULL is valid if it is empty.
template <class T>
std::span<T> array(T* values, size_t n) {
  if (values == nullptr && n != 0) throw Error("NULL, expected an array of " + std::to_string(n));
  return {values, n};
}

template <class Element, class Host>
fmi3Status get(fmi3Instance instance, const char* function, const fmi3ValueReference vr[], size_t n, Host values[],
               size_t nValues) {
  return call(instance, function, kAnyState, [&](Exported& e) { e.get<Element, Host>(array(vr, n), array(values, nValues)); });
}
template <class Element, class Host>
fmi3Status set(fmi3Instance instance, const char* function, const fmi3ValueReference vr[], size_t n, const Host values[],
               size_t nValues) {
  return call(instance, function, kInstantiated | kInitialising | kStepping,
              [&](Exported& e) { e.set<Element, Host>(array(vr, n), array(values, nValues)); });
}

/// Access to variables of a type that no unit has: succeeds only for an empty list.
fmi3Status no_such_type(fmi3Instance instance, const char* function, size_t n) {
  return call(instance, function, kAnyState, [&](Exported&) {
    if (n != 0) throw Error("the FMU has no variable of this type, expected Float64, Int32, Boolean or String");
  });
}

/// Computes directional or adjoint derivatives.
fmi3Status derivative(fmi3Instance instance, const char* function, const fmi3ValueReference unknowns[], size_t nUnknowns,
                      const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                      fmi3Float64 sensitivity[], size_t nSensitivity, bool adjoint) {
  return call(instance, function, kInitialising | kStepping | kTerminated, [&](Exported& e) {
    if (!e.has_partials()) {
      throw Error("the unit has no analytic Jacobian (providesDirectionalDerivatives, providesAdjointDerivatives=false)");
    }
    e.directional(array(unknowns, nUnknowns), array(knowns, nKnowns), array(seed, nSeed), array(sensitivity, nSensitivity),
                  adjoint);
  });
}

fmi3Instance no_such_interface(const char* function, fmi3Boolean loggingOn, fmi3InstanceEnvironment environment,
                               fmi3LogMessageCallback log) {
  if (loggingOn && log != nullptr) {
    const std::string message = std::string(function) + ": not supported, expected fmi3InstantiateCoSimulation";
    log(environment, fmi3Error, "logStatusError", message.c_str());
  }
  return nullptr;
}

}  // namespace

extern "C" {

const char* fmi3GetVersion() { return "3.0"; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean,
                                         fmi3Boolean loggingOn, fmi3Boolean eventModeUsed, fmi3Boolean,
                                         const fmi3ValueReference[], size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback) {
  try {
    const auto log = [environment, logMessage](Status status, const char* category, const std::string& message) {
      if (logMessage != nullptr) logMessage(environment, to_fmi(status), category, message.c_str());
    };
    try {
      if (instantiationToken == nullptr) throw Error("no instantiation token, expected that of modelDescription.xml");
      if (eventModeUsed) throw Error(std::string("eventModeUsed, but ") + kNoEvents);
      if (nRequiredIntermediateVariables != 0) {
        throw Error("intermediate updates are not supported (providesIntermediateUpdate=false)");
      }
      std::optional<std::filesystem::path> resources;
      if (resourcePath != nullptr && *resourcePath != '\0') resources = std::filesystem::path(resourcePath);
      auto exported = std::make_unique<Exported>(References::kVariables, instantiationToken, resources);
      exported->log = log;
      exported->logging = loggingOn;
      for (const std::string& warning : exported->warnings()) exported->report(Status::kWarning, warning);
      return exported.release();
    } catch (const std::exception& error) {
      if (loggingOn) log(Status::kError, "logStatusError", std::string("fmi3InstantiateCoSimulation: ") + error.what());
    }
  } catch (...) {
    return nullptr;  // out of memory for the message
  }
  return nullptr;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage) {
  return no_such_interface("fmi3InstantiateModelExchange", loggingOn, environment, logMessage);
}
fmi3Instance fmi3InstantiateScheduledExecution(fmi3String, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage,
                                               fmi3ClockUpdateCallback, fmi3LockPreemptionCallback,
                                               fmi3UnlockPreemptionCallback) {
  return no_such_interface("fmi3InstantiateScheduledExecution", loggingOn, environment, logMessage);
}

void fmi3FreeInstance(fmi3Instance instance) { delete static_cast<Exported*>(instance); }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t n, const fmi3String categories[]) {
  return call(instance, __func__, kAnyState, [&](Exported& e) { e.choose_categories(loggingOn, array(categories, n)); });
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean, fmi3Float64, fmi3Float64 startTime,
                                       fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
  return call(instance, __func__, kInstantiated, [&](Exported& e) {
    e.setup(startTime, stopTimeDefined ? std::optional(stopTime) : std::nullopt);
    e.enter_initialisation();
  });
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
  return call(instance, __func__, kInitialising, [](Exported& e) { e.exit_initialisation(); });
}
fmi3Status fmi3Terminate(fmi3Instance instance) {
  return call(instance, __func__, kStepping | kStepDiscarded, [](Exported& e) { e.terminate(); });
}
fmi3Status fmi3Reset(fmi3Instance instance) {
  return call(instance, __func__, kAnyState, [](Exported& e) { e.reset(); });
}

fmi3Status fmi3GetFloat64(fmi3Instance i, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[], size_t nValues) {
  return get<double>(i, __func__, vr, n, values, nValues);
}
fmi3Status fmi3GetInt32(fmi3Instance i, const fmi3ValueReference vr[], size_t n, fmi3Int32 values[], size_t nValues) {
  return get<std::int32_t>(i, __func__, vr, n, values, nValues);
}
fmi3Status fmi3GetBoolean(fmi3Instance i, const fmi3ValueReference vr[], size_t n, fmi3Boolean values[], size_t nValues) {
  return get<bool>(i, __func__, vr, n, values, nValues);
}
fmi3Status fmi3GetString(fmi3Instance i, const fmi3ValueReference vr[], size_t n, fmi3String values[], size_t nValues) {
  return get<std::string>(i, __func__, vr, n, values, nValues);
}
fmi3Status fmi3SetFloat64(fmi3Instance i, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[], size_t nValues) {
  return set<double>(i, __func__, vr, n, values, nValues);
}
fmi3Status fmi3SetInt32(fmi3Instance i, const fmi3ValueReference vr[], size_t n, const fmi3Int32 values[], size_t nValues) {
  return set<std::int32_t>(i, __func__, vr, n, values, nValues);
}
fmi3Status fmi3SetBoolean(fmi3Instance i, const fmi3ValueReference vr[], size_t n, const fmi3Boolean values[], size_t nValues) {
  return set<bool>(i, __func__, vr, n, values, nValues);
}
fmi3Status fmi3SetString(fmi3Instance i, const fmi3ValueReference vr[], size_t n, const fmi3String values[], size_t nValues) {
  return set<std::string>(i, __func__, vr, n, values, nValues);
}

fmi3Status fmi3GetFloat32(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3Float32[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetFloat32(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3Float32[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetInt8(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3Int8[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetInt8(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3Int8[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetUInt8(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3UInt8[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetUInt8(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3UInt8[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetInt16(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3Int16[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetInt16(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3Int16[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetUInt16(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3UInt16[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetUInt16(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3UInt16[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetUInt32(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3UInt32[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetUInt32(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3UInt32[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetInt64(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3Int64[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetInt64(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3Int64[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetUInt64(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3UInt64[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetUInt64(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3UInt64[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetBinary(fmi3Instance i, const fmi3ValueReference[], size_t n, size_t[], fmi3Binary[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetBinary(fmi3Instance i, const fmi3ValueReference[], size_t n, const size_t[], const fmi3Binary[], size_t) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetClock(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3Clock[]) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetClock(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3Clock[]) {
  return no_such_type(i, __func__, n);
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState* state) {
  return call(instance, __func__, kAnyState, [&](Exported& e) { array(state, 1)[0] = e.save(*array(state, 1).data()); });
}
fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
  return call(instance, __func__, kAnyState, [&](Exported& e) { e.restore(state); });
}
fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState* state) {
  return call(instance, __func__, kAnyState, [&](Exported& e) { e.free(state); });
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t* size) {
  return call(instance, __func__, kAnyState, [&](Exported& e) { array(size, 1)[0] = e.serialise(state).size(); });
}
fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
  return call(instance, __func__, kAnyState, [&](Exported& e) {
    const std::string serialised = e.serialise(state);
    if (size < serialised.size()) {
      throw Error("a buffer of " + std::to_string(size) + " bytes, expected " + std::to_string(serialised.size()));
    }
    std::memcpy(array(bytes, size).data(), serialised.data(), serialised.size());
  });
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState* state) {
  return call(instance, __func__, kAnyState,
              [&](Exported& e) { array(state, 1)[0] = e.deserialise(std::as_bytes(array(bytes, size))); });
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean, fmi3Boolean* eventHandlingNeeded, fmi3Boolean* terminateSimulation, fmi3Boolean* earlyReturn,
                      fmi3Float64* lastSuccessfulTime) {
  for (fmi3Boolean* flag : {eventHandlingNeeded, terminateSimulation, earlyReturn}) {
    if (flag != nullptr) *flag = false;
  }
  return call(instance, __func__, kStepping, [&](Exported& e) {
    const Status status = e.step(currentCommunicationPoint, communicationStepSize);
    if (status == Status::kDiscard) e.report(status, "fmi3DoStep: the unit cannot make this step; try a shorter one");
    if (lastSuccessfulTime != nullptr) *lastSuccessfulTime = e.time();
    if (terminateSimulation != nullptr) *terminateSimulation = e.finished();
    return status;
  });
}

fmi3Status fmi3EnterStepMode(fmi3Instance i) { return unsupported(i, __func__, kNoEvents); }
fmi3Status fmi3EnterEventMode(fmi3Instance i) { return unsupported(i, __func__, kNoEvents); }
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance i) { return unsupported(i, __func__, kNoEvents); }
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance i, fmi3Boolean*, fmi3Boolean*, fmi3Boolean*, fmi3Boolean*, fmi3Boolean*,
                                    fmi3Float64*) {
  return unsupported(i, __func__, kNoEvents);
}
fmi3Status fmi3GetOutputDerivatives(fmi3Instance i, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t nValues) {
  return call(i, __func__, kStepping | kTerminated,
              [&](Exported& e) { e.output_derivatives(array(vr, n), array(orders, n), array(values, nValues)); });
}
fmi3Status fmi3GetDirectionalDerivative(fmi3Instance i, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                        size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity) {
  return derivative(i, __func__, unknowns, nUnknowns, knowns, nKnowns, seed, nSeed, sensitivity, nSensitivity, false);
}
fmi3Status fmi3GetAdjointDerivative(fmi3Instance i, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                                    fmi3Float64 sensitivity[], size_t nSensitivity) {
  return derivative(i, __func__, unknowns, nUnknowns, knowns, nKnowns, seed, nSeed, sensitivity, nSensitivity, true);
}
fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance i, fmi3ValueReference, size_t*) {
  return unsupported(i, __func__, kNoDependencies);
}
fmi3Status fmi3GetVariableDependencies(fmi3Instance i, fmi3ValueReference, size_t[], fmi3ValueReference[], size_t[],
                                       fmi3DependencyKind[], size_t) {
  return unsupported(i, __func__, kNoDependencies);
}
fmi3Status fmi3EnterConfigurationMode(fmi3Instance i) { return unsupported(i, __func__, kNoConfiguration); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance i) { return unsupported(i, __func__, kNoConfiguration); }

fmi3Status fmi3GetIntervalDecimal(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3Float64[],
                                  fmi3IntervalQualifier[]) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetIntervalFraction(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3UInt64[], fmi3UInt64[],
                                   fmi3IntervalQualifier[]) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3Float64[]) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3GetShiftFraction(fmi3Instance i, const fmi3ValueReference[], size_t n, fmi3UInt64[], fmi3UInt64[]) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetIntervalDecimal(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3Float64[]) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetIntervalFraction(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3UInt64[],
                                   const fmi3UInt64[]) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetShiftDecimal(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3Float64[]) {
  return no_such_type(i, __func__, n);
}
fmi3Status fmi3SetShiftFraction(fmi3Instance i, const fmi3ValueReference[], size_t n, const fmi3UInt64[], const fmi3UInt64[]) {
  return no_such_type(i, __func__, n);
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance i) { return unsupported(i, __func__, kNoModelExchange); }
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance i, fmi3Boolean, fmi3Boolean*, fmi3Boolean*) {
  return unsupported(i, __func__, kNoModelExchange);
}
fmi3Status fmi3SetTime(fmi3Instance i, fmi3Float64) { return unsupported(i, __func__, kNoModelExchange); }
fmi3Status fmi3SetContinuousStates(fmi3Instance i, const fmi3Float64[], size_t) {
  return unsupported(i, __func__, kNoModelExchange);
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance i, fmi3Float64[], size_t) {
  return unsupported(i, __func__, kNoModelExchange);
}
fmi3Status fmi3GetEventIndicators(fmi3Instance i, fmi3Float64[], size_t) { return unsupported(i, __func__, kNoModelExchange); }
fmi3Status fmi3GetContinuousStates(fmi3Instance i, fmi3Float64[], size_t) { return unsupported(i, __func__, kNoModelExchange); }
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance i, fmi3Float64[], size_t) {
  return unsupported(i, __func__, kNoModelExchange);
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance i, size_t*) { return unsupported(i, __func__, kNoModelExchange); }
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance i, size_t*) { return unsupported(i, __func__, kNoModelExchange); }

fmi3Status fmi3ActivateModelPartition(fmi3Instance i, fmi3ValueReference, fmi3Float64) {
  return unsupported(i, __func__, "belongs to Scheduled Execution, which this FMU does not support");
}

}  // extern "C"
