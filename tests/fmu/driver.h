#pragma once
#include <dlfcn.h>

#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "components/unit/variables.h"
#include "fmu/archive/archive.h"
#include "fmu/archive/uri.h"
#include "fmu/description/model_description.h"
#include "fmu/fmi2.h"
#include "fmu/fmi3.h"

/// A minimal host for FMUs: it unpacks, loads and calls, and shares no code with the export.
namespace cotwin::fmu::testing {

/// An unpacked FMU with its library loaded.
class LoadedFmu {
 public:
  LoadedFmu(const std::filesystem::path& archive, Version version)
      : archive_(archive), folder_(unpack_archive(archive)), version_(version) {
    const char* platform = version == Version::k2 ? "linux64" : "x86_64-linux";
    const std::string xml = read_archive_file(archive, "modelDescription.xml");
    const auto attribute = [&](const std::string& key) {
      const std::size_t begin = xml.find(key) + key.size();
      return xml.substr(begin, xml.find('"', begin) - begin);
    };
    library_ = folder_.path() / "binaries" / platform / (attribute("modelIdentifier=\"") + ".so");
    token_ = attribute(version == Version::k2 ? "guid=\"" : "instantiationToken=\"");
    handle_ = dlopen(library_.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (handle_ == nullptr) throw std::runtime_error(dlerror());
  }
  LoadedFmu(const LoadedFmu&) = delete;
  ~LoadedFmu() { dlclose(handle_); }

  template <class Function>
  Function function(const char* name) const {
    void* address = dlsym(handle_, name);
    if (address == nullptr) throw std::runtime_error(std::string("no ") + name);
    return reinterpret_cast<Function>(address);
  }
  Version version() const { return version_; }
  const std::string& token() const { return token_; }
  const std::filesystem::path& folder() const { return folder_.path(); }
  const std::filesystem::path& library() const { return library_; }
  const std::filesystem::path& archive() const { return archive_; }
  /// The resource folder as this version of FMI passes it.
  std::string resources() const {
    const std::filesystem::path path = folder_.path() / "resources";
    return version_ == Version::k2 ? uri_from_path(path) : path.string() + "/";
  }

 private:
  std::filesystem::path archive_;
  TemporaryFolder folder_;
  Version version_;
  std::filesystem::path library_;
  void* handle_ = nullptr;
  std::string token_;
};

struct Message {
  int status;
  std::string category, text;
};

/// An instance of either version, with one set of calls. Status is 0 ok, 1 warning, 2 discard, 3 error.
class Driver {
 public:
  struct Options {
    std::optional<std::string> token;      // none: the right token
    std::optional<std::string> resources;  // none: the right resources
    bool null_resources = false;
    bool logging = true;
  };

  explicit Driver(const LoadedFmu& fmu) : Driver(fmu, Options{}) {}
  Driver(const LoadedFmu& fmu, const Options& options) : fmu_(fmu), log_(std::make_unique<std::vector<Message>>()) {
    const std::string token = options.token.value_or(fmu.token());
    const std::string resources = options.resources.value_or(fmu.resources());
    const char* place = options.null_resources ? nullptr : resources.c_str();
    if (two()) {
      callbacks_ = std::make_unique<fmi2CallbackFunctions>();
      callbacks_->logger = log2;
      callbacks_->componentEnvironment = log_.get();
      instance_ = fmu.function<decltype(&fmi2Instantiate)>("fmi2Instantiate")("driven", fmi2CoSimulation, token.c_str(), place,
                                                                              callbacks_.get(), fmi2False, options.logging);
    } else {
      instance_ = fmu.function<decltype(&fmi3InstantiateCoSimulation)>("fmi3InstantiateCoSimulation")(
          "driven", token.c_str(), place, false, options.logging, false, false, nullptr, 0, log_.get(), log3, nullptr);
    }
  }
  Driver(const Driver&) = delete;
  ~Driver() {
    if (two()) {
      fmu_.function<decltype(&fmi2FreeInstance)>("fmi2FreeInstance")(instance_);
    } else {
      fmu_.function<decltype(&fmi3FreeInstance)>("fmi3FreeInstance")(instance_);
    }
  }

  bool alive() const { return instance_ != nullptr; }
  void* instance() const { return instance_; }
  const std::vector<Message>& log() const { return *log_; }
  std::string last_message() const { return log_->empty() ? "" : log_->back().text; }

  int enter_initialisation(double start = 0, std::optional<double> stop = std::nullopt) {
    if (!two()) {
      return fmu_.function<decltype(&fmi3EnterInitializationMode)>("fmi3EnterInitializationMode")(
          instance_, false, 0, start, stop.has_value(), stop.value_or(0));
    }
    const int status = fmu_.function<decltype(&fmi2SetupExperiment)>("fmi2SetupExperiment")(instance_, fmi2False, 0, start,
                                                                                            stop.has_value(), stop.value_or(0));
    return status != 0 ? status : plain("fmi2EnterInitializationMode", "");
  }
  int exit_initialisation() { return plain("fmi2ExitInitializationMode", "fmi3ExitInitializationMode"); }
  int terminate() { return plain("fmi2Terminate", "fmi3Terminate"); }
  int reset() { return plain("fmi2Reset", "fmi3Reset"); }
  void initialise(double start = 0) {
    if (enter_initialisation(start) != 0 || exit_initialisation() != 0) throw std::runtime_error(last_message());
  }

  int step(double now, double h) {
    if (two()) return fmu_.function<decltype(&fmi2DoStep)>("fmi2DoStep")(instance_, now, h, fmi2True);
    bool event = true, early = true;
    terminated_ = true;
    const int status =
        fmu_.function<decltype(&fmi3DoStep)>("fmi3DoStep")(instance_, now, h, true, &event, &terminated_, &early, &reached_);
    return status + (event || early ? 100 : 0);  // neither is requested
  }
  /// The last successful time that the FMU reports.
  double reached() {
    if (!two()) return reached_;
    double value = -1;
    fmu_.function<decltype(&fmi2GetRealStatus)>("fmi2GetRealStatus")(instance_, fmi2LastSuccessfulTime, &value);
    return value;
  }

  bool terminated() {
    if (!two()) return terminated_;
    fmi2Boolean value = 99;
    fmu_.function<decltype(&fmi2GetBooleanStatus)>("fmi2GetBooleanStatus")(instance_, fmi2Terminated, &value);
    return value != fmi2False;
  }

  int get(std::span<const unsigned> references, std::span<double> values) {
    if (!two()) return get3<decltype(&fmi3GetFloat64)>("fmi3GetFloat64", references, values);
    return fmu_.function<decltype(&fmi2GetReal)>("fmi2GetReal")(instance_, references.data(), references.size(), values.data());
  }
  int get(std::span<const unsigned> references, std::span<std::int32_t> values) {
    if (!two()) return get3<decltype(&fmi3GetInt32)>("fmi3GetInt32", references, values);
    return fmu_.function<decltype(&fmi2GetInteger)>("fmi2GetInteger")(instance_, references.data(), references.size(),
                                                                      values.data());
  }
  int get(std::span<const unsigned> references, std::span<bool> values) {
    if (!two()) return get3<decltype(&fmi3GetBoolean)>("fmi3GetBoolean", references, values);
    std::vector<int> numbers(values.size());
    const int status = fmu_.function<decltype(&fmi2GetBoolean)>("fmi2GetBoolean")(instance_, references.data(),
                                                                                  references.size(), numbers.data());
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = numbers[i] != 0;
    return status;
  }
  int get(std::span<const unsigned> references, std::span<std::string> values) {
    std::vector<const char*> texts(values.size(), "");
    const int status = two() ? static_cast<int>(fmu_.function<decltype(&fmi2GetString)>("fmi2GetString")(
                                   instance_, references.data(), references.size(), texts.data()))
                             : get3<decltype(&fmi3GetString)>("fmi3GetString", references, std::span(texts));
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = texts[i];
    return status;
  }

  int set(std::span<const unsigned> references, std::span<const double> values) {
    if (!two()) return get3<decltype(&fmi3SetFloat64)>("fmi3SetFloat64", references, values);
    return fmu_.function<decltype(&fmi2SetReal)>("fmi2SetReal")(instance_, references.data(), references.size(), values.data());
  }
  int set(std::span<const unsigned> references, std::span<const std::int32_t> values) {
    if (!two()) return get3<decltype(&fmi3SetInt32)>("fmi3SetInt32", references, values);
    return fmu_.function<decltype(&fmi2SetInteger)>("fmi2SetInteger")(instance_, references.data(), references.size(),
                                                                      values.data());
  }
  int set(std::span<const unsigned> references, std::span<const bool> values) {
    if (!two()) return get3<decltype(&fmi3SetBoolean)>("fmi3SetBoolean", references, values);
    const std::vector<int> numbers(values.begin(), values.end());
    return fmu_.function<decltype(&fmi2SetBoolean)>("fmi2SetBoolean")(instance_, references.data(), references.size(),
                                                                      numbers.data());
  }
  int set(std::span<const unsigned> references, std::span<const std::string> values) {
    std::vector<const char*> texts;
    for (const std::string& value : values) texts.push_back(value.c_str());
    if (!two()) return get3<decltype(&fmi3SetString)>("fmi3SetString", references, std::span<const char* const>(texts));
    return fmu_.function<decltype(&fmi2SetString)>("fmi2SetString")(instance_, references.data(), references.size(),
                                                                    texts.data());
  }
  int set_rates(std::span<const unsigned> references, std::span<const int> orders, std::span<const double> values) {
    return fmu_.function<decltype(&fmi2SetRealInputDerivatives)>("fmi2SetRealInputDerivatives")(
        instance_, references.data(), references.size(), orders.data(), values.data());
  }

  int output_derivatives(std::span<const unsigned> references, std::span<const int> orders, std::span<double> values) {
    if (two()) {
      return fmu_.function<decltype(&fmi2GetRealOutputDerivatives)>("fmi2GetRealOutputDerivatives")(
          instance_, references.data(), references.size(), orders.data(), values.data());
    }
    return fmu_.function<decltype(&fmi3GetOutputDerivatives)>("fmi3GetOutputDerivatives")(
        instance_, references.data(), references.size(), orders.data(), values.data(), values.size());
  }
  int directional(std::span<const unsigned> unknowns, std::span<const unsigned> knowns, std::span<const double> seed,
                  std::span<double> sensitivity) {
    if (two()) {
      return fmu_.function<decltype(&fmi2GetDirectionalDerivative)>("fmi2GetDirectionalDerivative")(
          instance_, unknowns.data(), unknowns.size(), knowns.data(), knowns.size(), seed.data(), sensitivity.data());
    }
    return fmu_.function<decltype(&fmi3GetDirectionalDerivative)>("fmi3GetDirectionalDerivative")(
        instance_, unknowns.data(), unknowns.size(), knowns.data(), knowns.size(), seed.data(), seed.size(), sensitivity.data(),
        sensitivity.size());
  }
  int adjoint(std::span<const unsigned> unknowns, std::span<const unsigned> knowns, std::span<const double> seed,
              std::span<double> sensitivity) {
    return fmu_.function<decltype(&fmi3GetAdjointDerivative)>("fmi3GetAdjointDerivative")(
        instance_, unknowns.data(), unknowns.size(), knowns.data(), knowns.size(), seed.data(), seed.size(), sensitivity.data(),
        sensitivity.size());
  }

  int save(void** state) { return with_state<void**>("fmi2GetFMUstate", "fmi3GetFMUState", state); }
  int restore(void* state) { return with_state<void*>("fmi2SetFMUstate", "fmi3SetFMUState", state); }
  int free_state(void** state) { return with_state<void**>("fmi2FreeFMUstate", "fmi3FreeFMUState", state); }
  std::vector<char> serialise(void* state) {
    std::size_t size = 0;
    using Size = int (*)(void*, void*, std::size_t*);
    using Serialise = int (*)(void*, void*, char*, std::size_t);
    if (fmu_.function<Size>(two() ? "fmi2SerializedFMUstateSize" : "fmi3SerializedFMUStateSize")(instance_, state, &size) !=
        0) {
      return {};
    }
    std::vector<char> bytes(size);
    if (fmu_.function<Serialise>(two() ? "fmi2SerializeFMUstate" : "fmi3SerializeFMUState")(instance_, state, bytes.data(),
                                                                                            size) != 0) {
      return {};
    }
    return bytes;
  }
  int deserialise(std::span<const char> bytes, void** state) {
    using Deserialise = int (*)(void*, const char*, std::size_t, void**);
    return fmu_.function<Deserialise>(two() ? "fmi2DeSerializeFMUstate" : "fmi3DeserializeFMUState")(instance_, bytes.data(),
                                                                                                     bytes.size(), state);
  }
  int choose_logging(bool on, std::vector<const char*> categories) {
    if (two()) {
      return fmu_.function<decltype(&fmi2SetDebugLogging)>("fmi2SetDebugLogging")(instance_, on, categories.size(),
                                                                                  categories.data());
    }
    return fmu_.function<decltype(&fmi3SetDebugLogging)>("fmi3SetDebugLogging")(instance_, on, categories.size(),
                                                                                categories.data());
  }

 private:
  bool two() const { return fmu_.version() == Version::k2; }
  int plain(const char* in2, const char* in3) { return fmu_.function<int (*)(void*)>(two() ? in2 : in3)(instance_); }
  template <class Function, class Values>
  int get3(const char* name, std::span<const unsigned> references, Values values) {
    return fmu_.function<Function>(name)(instance_, references.data(), references.size(), values.data(), values.size());
  }
  template <class State>
  int with_state(const char* in2, const char* in3, State state) {
    return fmu_.function<int (*)(void*, State)>(two() ? in2 : in3)(instance_, state);
  }

  // The message is a printf format in FMI 2; Cotwin passes "%s" and the text.
  static void log2(void* environment, fmi2String, fmi2Status status, fmi2String category, fmi2String format, ...) {
    va_list arguments;
    va_start(arguments, format);
    char text[2000];
    std::vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    static_cast<std::vector<Message>*>(environment)->push_back({status, category, text});
  }
  static void log3(void* environment, fmi3Status status, fmi3String category, fmi3String message) {
    static_cast<std::vector<Message>*>(environment)->push_back({status, category, message});
  }

  const LoadedFmu& fmu_;
  std::unique_ptr<std::vector<Message>> log_;
  std::unique_ptr<fmi2CallbackFunctions> callbacks_;
  void* instance_ = nullptr;
  double reached_ = -1;
  bool terminated_ = false;
};

/// The value references of an exported unit's variable: one per element (FMI 2, and where elements differ), or one (FMI 3).
inline std::vector<unsigned> references(const Variables& variables, std::string_view name, Version version) {
  unsigned next = 1;  // 0 is time
  for (const Variable& v : variables) {
    const auto count = static_cast<unsigned>(version == Version::k2 || v.mixed() ? v.size() : 1);
    if (v.name == name) {
      std::vector<unsigned> all;
      for (unsigned i = 0; i < count; ++i) all.push_back(next + i);
      return all;
    }
    next += count;
  }
  throw std::runtime_error("no variable " + std::string(name));
}

}  // namespace cotwin::fmu::testing
