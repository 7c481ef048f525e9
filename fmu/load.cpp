#include "fmu/load.h"

#include <cmath>

#include "fmu/archive.h"
#include "fmu/foreign.h"
#include "fmu/model_description_read.h"
#include "fmu/model_exchange.h"
#include "fmu/process.h"
#include "models/text/error.h"
#include "models/text/text.h"

namespace cotwin::fmu {

namespace {

namespace fs = std::filesystem;

InterfaceKind chosen(const ModelDescription& description, const std::string& kind) {
  if (kind == "cs") return InterfaceKind::kCoSimulation;
  if (kind == "me") return InterfaceKind::kModelExchange;
  if (kind != "any") throw Error("kind '" + kind + "', expected any, cs or me");
  return description.model_exchange && !description.co_simulation ? InterfaceKind::kModelExchange
                                                                  : InterfaceKind::kCoSimulation;
}

/// The errors of a unit, with the FMU's name in front.
class Named final : public cotwin::Unit {
  template <class Call>
  auto named(Call call) {
    try {
      return call();
    } catch (const Error& error) {
      throw Error(name_, error.what());
    }
  }

 public:
  Named(std::string name, std::unique_ptr<cotwin::Unit> unit) : name_(std::move(name)), unit_(std::move(unit)) {}

  void declare(Variables& v) override { unit_->declare(v); }
  void initialise(Time start) override {
    named([&] { unit_->initialise(start); });
  }
  StepResult step(Time now, Duration h) override {
    return named([&] { return unit_->step(now, h); });
  }
  void restored() override { unit_->restored(); }
  void save_memory(std::string& bytes) override {
    named([&] { unit_->save_memory(bytes); });
  }
  void restore_memory(const std::string& bytes) override {
    named([&] { unit_->restore_memory(bytes); });
  }
  bool restorable() const override { return unit_->restorable(); }

 private:
  std::string name_;
  std::unique_ptr<cotwin::Unit> unit_;
};

std::unique_ptr<cotwin::Unit> make(std::shared_ptr<const ForeignFmu> fmu, const LoadOptions& options,
                                   std::vector<std::string>& warnings) {
  const InterfaceKind kind = chosen(fmu->description, options.kind);
  const Interface& interface = interface_of(fmu->description, kind);
  if (interface.needs_execution_tool) warnings.push_back("the FMU needs its tool to be installed");
  const UnitOptions unit_options{options.instance_name, options.locals,    options.structural,
                                 options.stop,          options.tolerance, options.si};
  const auto in_process = [fmu, kind, unit_options]() -> std::unique_ptr<ForeignUnit> {
    if (kind == InterfaceKind::kCoSimulation) return std::make_unique<FmuUnit>(fmu, unit_options);
    return std::make_unique<ModelExchangeUnit>(fmu, unit_options);
  };
  if (options.process == "own") {
    ForeignVariablesOptions variables{options.locals, options.structural, ramps_of(fmu->description, kind), options.si};
    auto unit = std::make_unique<ProcessUnit>(in_process, fmu, variables, interface.can_get_and_set_state, options.timeout);
    warnings.insert(warnings.end(), unit->warnings().begin(), unit->warnings().end());
    return unit;
  }
  if (options.process != "shared") throw Error("process '" + options.process + "', expected shared or own");
  auto unit = in_process();
  warnings.insert(warnings.end(), unit->warnings().begin(), unit->warnings().end());
  return unit;
}

}  // namespace

Instance load(const fs::path& path, const LoadOptions& options) {
  const std::string name = path.filename().empty() ? path.parent_path().filename().string() : path.filename().string();
  try {
    auto fmu = std::make_shared<ForeignFmu>();
    fmu->name = name;
    if (fs::is_directory(path)) {
      fmu->folder = fs::absolute(path).lexically_normal();
    } else {
      if (!fs::exists(path)) throw Error("no such file, expected an FMU");
      sweep_temporary_folders();
      fmu->unpacked.emplace(unpack_archive(path));
      fmu->folder = fmu->unpacked->path();
    }
    fmu->description = load_model_description(fmu->folder / "modelDescription.xml");
    Instance instance;
    std::unique_ptr<cotwin::Unit> unit = make(std::move(fmu), options, instance.warnings);
    for (std::string& warning : instance.warnings) warning = name + ": " + warning;
    instance.unit = std::make_unique<Named>(name, std::move(unit));
    instance.unit->declare(instance.variables);
    return instance;
  } catch (const Error& error) {
    const std::string what = error.what();
    if (what.rfind(path.string(), 0) == 0) throw;
    throw Error(name, what);
  } catch (const fs::filesystem_error& error) {
    throw Error(name, error.what());
  }
}

LoadOptions read_query(std::string_view query, LoadOptions options) {
  constexpr std::string_view kStructural = "structural.";
  for (const std::string_view setting : text::split(query, '&')) {
    if (setting.empty()) continue;
    const std::size_t equals = setting.find('=');
    const std::string key(setting.substr(0, equals)), value(equals == std::string_view::npos ? "" : setting.substr(equals + 1));
    const auto number = [&] {
      const std::optional<double> read = text::parse_real(value);
      if (!read || !std::isfinite(*read) || *read <= 0) throw Error(std::string(setting), "expected a number greater than 0");
      return *read;
    };
    if (key == "kind") {
      options.kind = value;
    } else if (key == "process") {
      options.process = value;
    } else if (key == "timeout") {
      options.timeout = number();
    } else if (key == "tolerance") {
      options.tolerance = number();
    } else if (key == "stop") {
      options.stop = number();
    } else if (key == "locals" || key == "si") {
      const std::optional<bool> read = text::parse_boolean(value);
      if (!read) throw Error(std::string(setting), "expected true or false");
      (key == "si" ? options.si : options.locals) = *read;
    } else if (key.rfind(kStructural, 0) == 0) {
      const auto read = text::parse_integer(value);
      if (!read || *read < 0) throw Error(std::string(setting), "expected an integer that is not negative");
      options.structural[key.substr(kStructural.size())] = static_cast<std::uint64_t>(*read);
    } else {
      throw Error("'" + key + "'",
                  "no setting of an FMU, expected kind, process, timeout, tolerance, stop, locals, si or structural.<name>");
    }
  }
  return options;
}

}  // namespace cotwin::fmu
