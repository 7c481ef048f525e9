// The C interface of FMI 2.0.4 Co-Simulation of an exported unit: translates calls, types and status for export.cpp.
#include <cstring>
#include <memory>
#include <new>
#include <optional>
#include <span>
#include <string>

#include "fmu/archive/uri.h"
#include "fmu/export/export.h"
#include "fmu/fmi2.h"
#include "models/foundation/support/error.h"

namespace {

using cotwin::Error;
using namespace cotwin::fmu;

/// An instance with the data that only FMI 2 needs.
struct Slave : Exported {
  using Exported::Exported;
  fmi2Status last_step = fmi2OK;
};

fmi2Status to_fmi(Status status) { return static_cast<fmi2Status>(status); }

template <class Body>
fmi2Status call(fmi2Component c, const char* function, unsigned allowed, Body body) {
  auto* slave = static_cast<Slave*>(c);
  return to_fmi(guarded(slave, function, allowed, [&](Exported&) {
    if constexpr (std::is_void_v<decltype(body(*slave))>) {
      body(*slave);
      return Status::kOk;
    } else {
      return body(*slave);
    }
  }));
}

/// Reports a call of a function that this FMU does not support.
fmi2Status unsupported(fmi2Component c, const char* function, const char* why) {
  return call(c, function, kAnyState, [&](Slave&) { throw Error(why); });
}
constexpr const char* kNoModelExchange = "belongs to Model Exchange, which this FMU does not support";
constexpr const char* kNoAsynchrony = "steps are synchronous (canRunAsynchronuously=false)";

/// Returns an array argument as a span. NULL is valid if it is empty.
template <class T>
std::span<T> array(T* values, size_t n) {
  if (values == nullptr && n != 0) throw Error("NULL, expected an array of " + std::to_string(n));
  return {values, n};
}

template <class Element, class Host>
fmi2Status get(fmi2Component c, const char* function, const fmi2ValueReference vr[], size_t n, Host values[]) {
  return call(c, function, kAnyState, [&](Slave& s) { s.get<Element, Host>(array(vr, n), array(values, n)); });
}
template <class Element, class Host>
fmi2Status set(fmi2Component c, const char* function, const fmi2ValueReference vr[], size_t n, const Host values[]) {
  return call(c, function, kInstantiated | kInitialising | kStepping,
              [&](Slave& s) { s.set<Element, Host>(array(vr, n), array(values, n)); });
}

void log_to(const fmi2CallbackFunctions& to, const std::string& name, Status status, const char* category,
            const std::string& message) {
  if (to.logger != nullptr) to.logger(to.componentEnvironment, name.c_str(), to_fmi(status), category, "%s", message.c_str());
}

}  // namespace

extern "C" {

const char* fmi2GetTypesPlatform() { return "default"; }
const char* fmi2GetVersion() { return "2.0"; }

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type type, fmi2String guid, fmi2String resourceLocation,
                              const fmi2CallbackFunctions* functions, fmi2Boolean, fmi2Boolean loggingOn) {
  try {
    const fmi2CallbackFunctions host = functions != nullptr ? *functions : fmi2CallbackFunctions{};
    const std::string name = instanceName != nullptr ? instanceName : "";
    const auto log = [host, name](Status status, const char* category, const std::string& message) {
      log_to(host, name, status, category, message);
    };
    try {
      if (type != fmi2CoSimulation) throw Error("Model Exchange is not supported, expected Co-Simulation");
      if (guid == nullptr) throw Error("no GUID, expected that of modelDescription.xml");
      std::optional<std::filesystem::path> resources;
      if (resourceLocation != nullptr && *resourceLocation != '\0') resources = path_from_uri(resourceLocation);
      auto slave = std::make_unique<Slave>(References::kElements, guid, resources);
      slave->log = log;
      slave->logging = loggingOn != fmi2False;
      for (const std::string& warning : slave->warnings()) slave->report(Status::kWarning, warning);
      return slave.release();
    } catch (const std::exception& error) {
      if (loggingOn != fmi2False) log(Status::kError, "logStatusError", std::string("fmi2Instantiate: ") + error.what());
    }
  } catch (...) {
    return nullptr;  // out of memory for the message
  }
  return nullptr;
}

void fmi2FreeInstance(fmi2Component c) { delete static_cast<Slave*>(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t n, const fmi2String categories[]) {
  return call(c, __func__, kAnyState, [&](Slave& s) { s.choose_categories(loggingOn != fmi2False, array(categories, n)); });
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean, fmi2Real, fmi2Real startTime, fmi2Boolean stopTimeDefined,
                               fmi2Real stopTime) {
  return call(c, __func__, kInstantiated,
              [&](Slave& s) { s.setup(startTime, stopTimeDefined != fmi2False ? std::optional(stopTime) : std::nullopt); });
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  return call(c, __func__, kInstantiated, [](Slave& s) { s.enter_initialisation(); });
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  return call(c, __func__, kInitialising, [](Slave& s) { s.exit_initialisation(); });
}
fmi2Status fmi2Terminate(fmi2Component c) {
  return call(c, __func__, kStepping | kStepDiscarded, [](Slave& s) { s.terminate(); });
}
fmi2Status fmi2Reset(fmi2Component c) {
  return call(c, __func__, kAnyState, [](Slave& s) {
    s.reset();
    s.last_step = fmi2OK;
  });
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real values[]) {
  return get<double>(c, __func__, vr, n, values);
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer values[]) {
  return get<std::int32_t>(c, __func__, vr, n, values);
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean values[]) {
  return get<bool>(c, __func__, vr, n, values);
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String values[]) {
  return get<std::string>(c, __func__, vr, n, values);
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real values[]) {
  return set<double>(c, __func__, vr, n, values);
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer values[]) {
  return set<std::int32_t>(c, __func__, vr, n, values);
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean values[]) {
  return set<bool>(c, __func__, vr, n, values);
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String values[]) {
  return set<std::string>(c, __func__, vr, n, values);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* state) {
  return call(c, __func__, kAnyState, [&](Slave& s) { array(state, 1)[0] = s.save(*array(state, 1).data()); });
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  return call(c, __func__, kAnyState, [&](Slave& s) { s.restore(state); });
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* state) {
  return call(c, __func__, kAnyState, [&](Slave& s) { s.free(state); });
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t* size) {
  return call(c, __func__, kAnyState, [&](Slave& s) { array(size, 1)[0] = s.serialise(state).size(); });
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  return call(c, __func__, kAnyState, [&](Slave& s) {
    const std::string serialised = s.serialise(state);
    if (size < serialised.size()) {
      throw Error("a buffer of " + std::to_string(size) + " bytes, expected " + std::to_string(serialised.size()));
    }
    std::memcpy(array(bytes, size).data(), serialised.data(), serialised.size());
  });
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate* state) {
  return call(c, __func__, kAnyState, [&](Slave& s) { array(state, 1)[0] = s.deserialise(std::as_bytes(array(bytes, size))); });
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                       const fmi2Real values[]) {
  return call(c, __func__, kInstantiated | kInitialising | kStepping,
              [&](Slave& s) { return s.set_rates(array(vr, n), array(order, n), array(values, n)); });
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize, fmi2Boolean) {
  return call(c, __func__, kStepping, [&](Slave& s) {
    Status status = s.step(currentCommunicationPoint, communicationStepSize);
    if (status == Status::kDiscard) s.report(status, "fmi2DoStep: the unit cannot make this step; try a shorter one");
    if (s.finished()) {  // FMI 2 reports a requested end as a discarded step with fmi2Terminated
      status = Status::kDiscard;
      s.report(status, "fmi2DoStep: the unit requests the end of the run");
    }
    s.last_step = to_fmi(status);
    return status;
  });
}

fmi2Status fmi2GetStatus(fmi2Component c, fmi2StatusKind kind, fmi2Status* value) {
  return call(c, __func__, kAnyState, [&](Slave& s) {
    if (kind != fmi2DoStepStatus) throw Error("invalid status kind " + std::to_string(kind) + ", expected fmi2DoStepStatus");
    array(value, 1)[0] = s.last_step;
  });
}
fmi2Status fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real* value) {
  return call(c, __func__, kAnyState, [&](Slave& s) {
    if (kind != fmi2LastSuccessfulTime)
      throw Error("invalid status kind " + std::to_string(kind) + ", expected fmi2LastSuccessfulTime");
    array(value, 1)[0] = s.time();
  });
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, fmi2StatusKind kind, fmi2Boolean* value) {
  return call(c, __func__, kAnyState, [&](Slave& s) {
    if (kind != fmi2Terminated) throw Error("invalid status kind " + std::to_string(kind) + ", expected fmi2Terminated");
    array(value, 1)[0] = s.finished() ? fmi2True : fmi2False;
  });
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, fmi2StatusKind, fmi2Integer*) {
  return unsupported(c, __func__, "there is no integer status");
}
fmi2Status fmi2GetStringStatus(fmi2Component c, fmi2StatusKind, fmi2String*) { return unsupported(c, __func__, kNoAsynchrony); }
fmi2Status fmi2CancelStep(fmi2Component c) { return unsupported(c, __func__, kNoAsynchrony); }

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                        fmi2Real values[]) {
  return call(c, __func__, kStepping | kStepDiscarded | kTerminated,
              [&](Slave& s) { s.output_derivatives(array(vr, n), array(order, n), array(values, n)); });
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t nUnknowns,
                                        const fmi2ValueReference knowns[], size_t nKnowns, const fmi2Real dKnowns[],
                                        fmi2Real dUnknowns[]) {
  return call(c, __func__, kInitialising | kStepping | kTerminated, [&](Slave& s) {
    if (!s.has_partials()) throw Error("the unit has no analytic Jacobian (providesDirectionalDerivative=false)");
    s.directional(array(unknowns, nUnknowns), array(knowns, nKnowns), array(dKnowns, nKnowns), array(dUnknowns, nUnknowns),
                  false);
  });
}

fmi2Status fmi2EnterEventMode(fmi2Component c) { return unsupported(c, __func__, kNoModelExchange); }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo*) { return unsupported(c, __func__, kNoModelExchange); }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return unsupported(c, __func__, kNoModelExchange); }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean, fmi2Boolean*, fmi2Boolean*) {
  return unsupported(c, __func__, kNoModelExchange);
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real) { return unsupported(c, __func__, kNoModelExchange); }
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real[], size_t) {
  return unsupported(c, __func__, kNoModelExchange);
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real[], size_t) { return unsupported(c, __func__, kNoModelExchange); }
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real[], size_t) { return unsupported(c, __func__, kNoModelExchange); }
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real[], size_t) { return unsupported(c, __func__, kNoModelExchange); }
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real[], size_t) {
  return unsupported(c, __func__, kNoModelExchange);
}

}  // extern "C"
