#include "fmu/import/load.h"

#include <cmath>

#include "fmu/archive/archive.h"
#include "fmu/description/read.h"
#include "fmu/import/named.h"
#include "fmu/process/process.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

namespace fs = std::filesystem;

/// Like make_instance, with the FMU in its own process.
Instance make_in_own_process(std::shared_ptr<const ForeignFmu> fmu, const LoadOptions& options) {
  const InterfaceKind kind = chosen_kind(fmu->description, options.kind);
  Instance instance;
  if (interface_of(fmu->description, kind).needs_execution_tool)
    instance.warnings.push_back("the FMU needs the installation of its tool");
  instance.unit = make_named<ProcessUnit>(fmu->name, instance.warnings, fmu, options);
  for (std::string& warning : instance.warnings) warning = fmu->name + ": " + warning;
  instance.unit->declare(instance.variables);
  return instance;
}

std::string name_of(const fs::path& path) {
  return path.filename().empty() ? path.parent_path().filename().string() : path.filename().string();
}

/// Runs `call` and puts the FMU's name in front of the messages of its errors.
template <class Call>
auto named(const fs::path& path, Call call) {
  try {
    return call();
  } catch (const Error& error) {
    const std::string what = error.what();
    if (what.rfind(path.string(), 0) == 0) throw;
    throw Error(name_of(path), what);
  } catch (const fs::filesystem_error& error) {
    throw Error(name_of(path), error.what());
  }
}

std::shared_ptr<const ForeignFmu> unpack_and_read(const fs::path& path) {
  auto fmu = std::make_shared<ForeignFmu>();
  fmu->name = name_of(path);
  std::error_code none;
  if (fs::is_directory(path, none)) {
    fmu->folder = fs::absolute(path).lexically_normal();
  } else {
    if (!fs::exists(path, none)) throw Error("no such file, expected an FMU");
    sweep_temporary_folders();
    const auto unpacked = std::make_shared<const TemporaryFolder>(unpack_archive(path));
    fmu->folder = unpacked->path();
    fmu->unpacked = unpacked;
  }
  const fs::path description = fmu->folder / "modelDescription.xml";
  if (!fs::exists(description, none)) throw Error("has no modelDescription.xml");
  fmu->description = load_model_description(description);
  return fmu;
}

}  // namespace

std::shared_ptr<const ForeignFmu> open_fmu(const fs::path& path) {
  return named(path, [&] { return unpack_and_read(path); });
}

ModelDescription read_fmu_description(const fs::path& path) {
  constexpr const char* kDescription = "modelDescription.xml";
  std::error_code none;
  if (fs::is_directory(path, none)) return load_model_description(path / kDescription);
  if (!fs::exists(path, none)) throw Error(path.string(), "no such file, expected an FMU");
  return parse_model_description(read_archive_file(path, kDescription), path.string() + "/" + kDescription);
}

Instance load(const fs::path& path, const LoadOptions& options) { return load(open_fmu(path), options); }

Instance load(std::shared_ptr<const ForeignFmu> fmu, const LoadOptions& options) {
  const std::string name = fmu->name;
  return named(name, [&] {
    return options.process == ProcessChoice::kOwn ? make_in_own_process(std::move(fmu), options)
                                                  : make_instance(std::move(fmu), options);
  });
}

LoadOptions read_query(std::string_view query, LoadOptions options) {
  constexpr std::string_view kStructural = "structural.";
  for (const std::string_view setting : text::split(query, '&')) {
    if (setting.empty()) continue;
    const std::size_t equals = setting.find('=');
    const std::string key(setting.substr(0, equals)), value(equals == std::string_view::npos ? "" : setting.substr(equals + 1));
    const auto number = [&] {
      const std::optional<double> read = text::parse_real(value);
      if (!read || !std::isfinite(*read)) throw Error(std::string(setting), "expected a number");
      return *read;
    };
    const auto positive = [&] {
      if (number() <= 0) throw Error(std::string(setting), "expected a number greater than 0");
      return number();
    };
    if (key == "kind") {
      options.kind = text::choose("kind", value, kInterfaceWords);
    } else if (key == "process") {
      options.process = text::choose("process", value, kProcessWords);
    } else if (key == "timeout") {
      options.timeout = positive();
    } else if (key == "memory") {
      options.memory = positive();
    } else if (key == "tolerance") {
      options.tolerance = positive();
    } else if (key == "stop") {
      options.stop = number();
    } else if (key == "locals" || key == "si" || key == "slopes" || key == "rollback") {
      const std::optional<bool> read = text::parse_boolean(value);
      if (!read) throw Error(std::string(setting), "expected true or false");
      if (key == "rollback") {
        options.rollback = read;
      } else {
        (key == "si" ? options.si : key == "slopes" ? options.slopes : options.locals) = *read;
      }
    } else if (key.rfind(kStructural, 0) == 0) {
      const auto read = text::parse_integer(value);
      if (!read || *read < 0) throw Error(std::string(setting), "expected a non-negative integer");
      options.structural[key.substr(kStructural.size())] = static_cast<std::uint64_t>(*read);
    } else {
      throw Error(
          "'" + key + "'",
          "not a setting of an FMU, expected kind, process, timeout, memory, tolerance, stop, locals, si, slopes, rollback or "
          "structural.<name>");
    }
  }
  return options;
}

}  // namespace cotwin::fmu
