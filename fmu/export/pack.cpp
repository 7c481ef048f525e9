#include "fmu/export/pack.h"

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <map>
#include <memory>
#include <set>
#include <sstream>
#include <system_error>
#include <utility>

#include "fmu/archive/archive.h"
#include "fmu/description/describe.h"
#include "fmu/description/document.h"
#include "fmu/export/package.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/installation.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

namespace fs = std::filesystem;

/// Names of platforms in FMI 2 and in FMI 3. For other platforms FMI 2 uses the names of FMI 3 (2.0.4, clause 2.3).
const std::map<std::string, std::string> kFmi2Platforms = {{"linux64", "x86_64-linux"},
                                                           {"linux32", "x86-linux"},
                                                           {"win64", "x86_64-windows"},
                                                           {"win32", "x86-windows"},
                                                           {"darwin64", "x86_64-darwin"}};

std::string platform_tuple(const std::string& platform) {
  const auto found = kFmi2Platforms.find(platform);
  return found != kFmi2Platforms.end() ? found->second : platform;
}

std::string binaries_folder(const std::string& tuple, Version version) {
  for (const auto& [fmi2, fmi3] : kFmi2Platforms) {
    if (version == Version::k2 && fmi3 == tuple) return fmi2;
  }
  return tuple;
}

std::string library_ending(const std::string& platform) {
  if (platform.ends_with("-windows")) return ".dll";
  return platform.ends_with("-darwin") ? ".dylib" : ".so";
}

std::string read(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream content;
  content << in.rdbuf();
  if (!in) throw Error(path.string(), "cannot be read");
  return content.str();
}

/// Returns the current time, or SOURCE_DATE_EPOCH, as a dateTime of XML Schema in UTC.
std::string generation_date() {
  std::time_t now = std::time(nullptr);
  if (const char* fixed = std::getenv("SOURCE_DATE_EPOCH")) {
    const auto seconds = text::parse_integer(fixed);
    if (!seconds || *seconds < 0) throw Error("SOURCE_DATE_EPOCH", "'" + std::string(fixed) + "', expected seconds since 1970");
    now = static_cast<std::time_t>(*seconds);
  }
  std::tm utc{};
  gmtime_r(&now, &utc);
  char buffer[32];
  std::strftime(buffer, sizeof buffer, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return buffer;
}

/// Returns a 128-bit hash in the format of a GUID.
std::string token_of(const std::string& content) {
  static constexpr char kDigits[] = "0123456789abcdef";
  const std::uint64_t halves[] = {hash_of(content), hash_of(content, hash_of("another"))};
  std::string token = "{";
  for (std::size_t i = 0; i < 32; ++i) {
    if (i == 8 || i == 12 || i == 16 || i == 20) token += '-';
    token += kDigits[(halves[i / 16] >> (60 - 4 * (i % 16))) & 15];
  }
  return token + "}";
}

std::string to_xml(const ModelDescription& description) {
  std::ostringstream out;
  write(out, description);
  return out.str();
}

/// Throws Error if the build for `tuple` left the unit out. The build then wrote the reason to <unit>.txt.
void check_left_out(const fs::path& folder, const std::string& tuple, const std::string& unit) {
  std::ifstream note(folder / (unit + ".txt"));
  if (std::string why; std::getline(note, why)) throw Error("platform " + tuple, why);
}

/// Returns the folder that contains the unit's library. Throws Error with the command that builds it.
fs::path find_library(const PackRequest& request, const std::string& tuple, const std::string& unit) {
  const std::string name = unit + library_ending(tuple);
  std::vector<fs::path> folders = {library_folder() / tuple, cross_folder() / tuple};
  for (const fs::path& folder : request.libraries_of_modules) folders.push_back(folder / tuple);
  if (!request.libraries.empty()) folders.insert(folders.begin(), request.libraries / tuple);
  std::string searched;
  for (const fs::path& folder : folders) {
    if (fs::is_regular_file(folder / name)) return folder;
    check_left_out(folder, tuple, unit);
    searched += "\n  " + (folder / name).string();
  }
  const std::string fmi2 = binaries_folder(tuple, Version::k2);
  const std::string how = tuple == own_platform()                      ? "expected it from the build of the units"
                          : fmi2 == "win64" || fmi2 == "aarch64-linux" ? "expected it from scripts/cross.sh " + fmi2
                                                                       : "expected it from a build for that platform";
  throw Error("platform " + tuple, "no library of " + unit + ", " + how + "; looked for" + searched);
}

void add_libraries(const PackContent& content, const PackRequest& request, const std::string& identifier,
                   std::vector<ArchiveFile>& files) {
  std::map<std::string, fs::path> licenses;  // file name → path; each once, even if several platforms have it
  for (const std::string& tuple : platforms_of(request.platforms)) {
    const std::string unit = content.type.name;
    const fs::path folder = find_library(request, tuple, unit);
    for (const std::string& part : content.parts) check_left_out(folder, tuple, part);
    files.push_back({library_name(tuple, request.version, identifier), folder / (unit + library_ending(tuple))});
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(folder / "licenses", none))
      licenses.emplace(entry.path().filename().string(), entry.path());
  }
  for (const auto& [name, file] : licenses) files.push_back({"documentation/licenses/" + name, file});
}

}  // namespace

std::vector<ArchiveFile> collect_files(Settings& settings, const Variables& variables, std::set<std::string>& names) {
  std::vector<ArchiveFile> files;
  const auto take = [&](const fs::path& file) {
    if (csv::is_bag(file))
      throw Error(file.string(), "is a ROS bag, which an exported unit cannot read, expected a table: cotwin info " +
                                     text::for_a_shell(file.string()) + " --csv FILE writes one");
    std::string name = file.filename().string();
    for (int i = 2; !names.insert(name).second; ++i) name = std::to_string(i) + "_" + file.filename().string();
    files.push_back({"resources/" + name, read(file)});
    return name;
  };
  std::map<std::string, std::string> renamed;  // before any of them is renamed, so that a new name is not taken for an old one
  for (const Settings::DataFile& data : settings.data_files()) {
    if (!renamed.contains(data.name)) renamed[data.name] = take(data.path);
  }
  settings.rename_data_files(renamed);
  for (const Variable& v : variables) {
    if (v.kind() != Kind::kString || (v.role != Role::kParameter && v.role != Role::kTunable)) continue;
    for (std::string& value : v.strings()) {
      if (value.empty()) continue;
      fs::path file;
      try {
        file = settings.file(value);
      } catch (const Error&) {
        continue;  // not a file, or one that exists only on the host's machine
      }
      if (!csv::is_bag(file) && (!fs::path(value).has_extension() || !fs::is_regular_file(file))) continue;
      value = take(file);
    }
  }
  return files;
}

std::string packed_query(const Settings& settings) {
  const std::string all = settings.query();
  const auto named = [&](std::string_view key) -> std::string {
    const auto& robot = settings.robot_used();
    const auto& cell = settings.cell_used();
    if (key == "robot" && robot != nullptr) return robot->name;
    if (cell == nullptr) return "";
    if (key == "scene") return cell->scene.name;
    if (key == "robot" && cell->robots.size() == 1) return cell->robots.front().model.name;
    if (key != "robots") return "";
    std::string names;
    for (const scene::PlacedRobot& r : cell->robots) names += (names.empty() ? "" : ",") + r.name + ":" + r.model.name;
    return names;
  };
  std::string query;
  for (const std::string_view pair : text::split(all, '&')) {
    const std::string_view key = pair.substr(0, pair.find('='));
    const bool is_path = pair.find('/') != std::string_view::npos;
    const bool packed = key == "robot" || key == "robots" || key == "scene";
    const std::string name = is_path && packed ? named(key) : "";
    query += (query.empty() ? "" : "&");
    query += is_path && packed ? std::string(key) + "=" + escape_setting(name.empty() ? "packed" : name) : std::string(pair);
  }
  return query;
}

/// Throws Error if the unit cannot be initialised with the packed start values. Uses a separate instance.
void try_initialisation(const PackRequest& request) {
  Instance trial = make_unit(request.source, request.defaults, request.folders, request.types);
  for (const ParameterSet& values : request.values) apply(values, trial.variables);
  // A robot or bus is not operated for a trial, and is at the host's machine, not here.
  if (!trial.unit->restorable()) return;
  try {
    trial.unit->initialise({});
  } catch (const Error& error) {
    throw Error(request.source,
                std::string("cannot be initialised as an FMU: ") + error.what() + "; --set NAME=VALUE gives a start value");
  }
}

std::vector<std::string> pack_unit(const PackRequest& request, const fs::path& out) {
  if (request.alone) try_initialisation(request);
  const UnitSource source = parse_unit_source(request.source);
  Settings settings(source.unit, source.query, request.defaults, request.folders);
  Instance instance = make_unit(settings, request.types);
  for (const ParameterSet& values : request.values) apply(values, instance.variables);
  const UnitType& type = find_type(source.unit, request.types);

  std::set<std::string> names = {kPackageFile};
  std::vector<ArchiveFile> resources = collect_files(settings, instance.variables, names);
  pack({type, *instance.unit, instance.variables, packed_query(settings), settings.robot_used(), settings.cell_used(),
        std::move(resources)},
       request, out);
  return instance.warnings;
}

void pack(const PackContent& content, const PackRequest& request, const fs::path& out) {
  ModelDescription description = describe(content.type, content.unit, content.variables, request.version);
  if (!request.name.empty()) description.model_name = request.name;
  if (request.experiment) description.default_experiment = request.experiment;
  if (!content.identifier.empty()) description.co_simulation->model_identifier = content.identifier;
  description.co_simulation->only_once_per_process = content.only_once;
  description.co_simulation->needs_execution_tool = content.needs_tool;

  Package package;
  package.unit = content.type.name;
  package.query = content.query;
  package.robot = content.robot;
  package.cell = content.cell;
  package.start.take(content.variables);
  std::string hashed = to_xml(description) + serialise(package);
  for (const ArchiveFile& file : content.resources) hashed += file.name + std::get<std::string>(file.content);
  std::vector<ArchiveFile> libraries;
  add_libraries(content, request, description.co_simulation->model_identifier, libraries);
  for (const ArchiveFile& file : libraries) {  // some hosts keep unpacked FMUs by their token; states of other code do not fit
    if (file.name.starts_with("binaries/")) hashed += std::to_string(hash_of(read(std::get<fs::path>(file.content))));
  }
  description.token = package.token = token_of(hashed);
  description.generation_date = generation_date();

  std::vector<ArchiveFile> files;
  files.push_back({"modelDescription.xml", to_xml(description)});
  files.push_back({"documentation/index.html", document(description, package.query)});
  files.insert(files.end(), libraries.begin(), libraries.end());
  files.push_back({"resources/" + std::string(kPackageFile), serialise(package)});
  files.insert(files.end(), content.resources.begin(), content.resources.end());
  write_archive(out, files);
}

std::vector<std::string> platforms_of(const std::vector<std::string>& wanted) {
  std::vector<std::string> tuples;
  for (const std::string& platform : wanted.empty() ? std::vector{own_platform()} : wanted) {
    const std::string tuple = platform_tuple(platform);
    if (std::find(tuples.begin(), tuples.end(), tuple) == tuples.end()) tuples.push_back(tuple);
  }
  return tuples;
}

std::string library_name(const std::string& platform, Version version, const std::string& identifier) {
  return "binaries/" + binaries_folder(platform, version) + "/" + identifier + library_ending(platform);
}

fs::path library_folder() {
  const fs::path prefix = installation();
  if (prefix.empty()) throw Error("/proc/self/exe", "cannot be read, expected the path of the running program");
  return prefix / "lib/cotwin/fmu";
}

fs::path cross_folder() { return (library_folder() / "../../../../cross/fmu").lexically_normal(); }

std::string own_platform() {
#if defined(__x86_64__)
  const std::string machine = "x86_64";
#elif defined(__aarch64__)
  const std::string machine = "aarch64";
#else
#error "name this machine as FMI 3.0.2, clause 2.5.1.4.1, does"
#endif
#if defined(_WIN32)
  return machine + "-windows";
#elif defined(__linux__)
  return machine + "-linux";
#else
#error "name this system as FMI 3.0.2, clause 2.5.1.4.1, does"
#endif
}

}  // namespace cotwin::fmu
