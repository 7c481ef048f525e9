#include "fmu/pack.h"

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <memory>
#include <set>
#include <sstream>
#include <system_error>
#include <utility>

#include "fmu/archive.h"
#include "fmu/bytes.h"
#include "fmu/describe.h"
#include "fmu/document.h"
#include "fmu/package.h"
#include "models/text/error.h"
#include "models/text/text.h"

namespace cotwin::fmu {

namespace {

namespace fs = std::filesystem;

/// The name of a platform's folder in binaries/: FMI 3 has tuples, FMI 2 its own words for some of them.
std::string binaries_folder(const std::string& platform, Version version) {
  static const std::map<std::string, std::string> kFmi2 = {{"x86_64-linux", "linux64"},
                                                           {"x86-linux", "linux32"},
                                                           {"x86_64-windows", "win64"},
                                                           {"x86-windows", "win32"},
                                                           {"x86_64-darwin", "darwin64"}};
  const auto found = kFmi2.find(platform);
  return version == Version::k2 && found != kFmi2.end() ? found->second : platform;
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

/// Now, or SOURCE_DATE_EPOCH, as XML Schema's dateTime in UTC.
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

/// 128 bits of hash in the shape of a GUID.
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

void add_libraries(const PackRequest& request, const std::string& unit, std::vector<ArchiveFile>& files) {
  const fs::path folder = request.libraries.empty() ? library_folder() : request.libraries;
  const std::vector<std::string> platforms = request.platforms.empty() ? std::vector{own_platform()} : request.platforms;
  for (const std::string& platform : platforms) {
    const std::string name = unit + library_ending(platform);
    const fs::path library = folder / platform / name;
    if (!fs::is_regular_file(library))
      throw Error(library.string(), "no such library, expected it from the build of the units");
    files.push_back({"binaries/" + binaries_folder(platform, request.version) + "/" + name, library});
  }
  if (!fs::is_directory(folder / "licenses")) return;
  std::set<fs::path> licenses;
  for (const auto& entry : fs::directory_iterator(folder / "licenses")) licenses.insert(entry.path());
  for (const fs::path& license : licenses) files.push_back({"documentation/licenses/" + license.filename().string(), license});
}

}  // namespace

std::vector<ArchiveFile> take_files(const Settings& settings, const Variables& variables, std::set<std::string>& names) {
  std::vector<ArchiveFile> files;
  for (const cotwin::Variable& v : variables) {
    if (v.kind() != Kind::kString || (v.role != Role::kParameter && v.role != Role::kTunable)) continue;
    for (std::string& value : v.strings()) {
      if (!fs::path(value).has_extension()) continue;
      fs::path file;
      try {
        file = settings.file(value);
      } catch (const Error&) {
        continue;  // names no file, or one that only the host will have
      }
      if (!fs::is_regular_file(file)) continue;
      std::string name = file.filename().string();
      for (int i = 2; !names.insert(name).second; ++i) name = std::to_string(i) + "_" + file.filename().string();
      files.push_back({"resources/" + name, read(file)});
      value = name;
    }
  }
  return files;
}

std::string packed_query(const Settings& settings) {
  const std::string all = settings.query();
  if (settings.robot_used() == nullptr) return all;
  std::string query;
  for (const std::string_view pair : text::split(all, '&')) {
    const bool robot = pair.starts_with("robot=") && pair.find('/') != std::string_view::npos;
    query += (query.empty() ? "" : "&") + (robot ? "robot=" + settings.robot_used()->name : std::string(pair));
  }
  return query;
}

std::vector<std::string> pack_unit(const PackRequest& request, const fs::path& out) {
  const UnitSource source = parse_unit_source(request.source);
  Settings settings(source.unit, source.query, request.defaults, request.folders);
  Instance instance = make_unit(settings, request.types);
  for (const ParameterSet& values : request.values) apply(values, instance.variables);
  const UnitType& type =
      *std::find_if(request.types.begin(), request.types.end(), [&](const UnitType& t) { return t.name == source.unit; });

  std::set<std::string> names = {kPackageFile};
  std::vector<ArchiveFile> resources = take_files(settings, instance.variables, names);
  pack({type, *instance.unit, instance.variables, packed_query(settings), settings.robot_used(), std::move(resources)}, request,
       out);
  return instance.warnings;
}

void pack(const PackContent& content, const PackRequest& request, const fs::path& out) {
  ModelDescription description = describe(content.type, content.unit, content.variables, request.version);
  if (!request.name.empty()) description.model_name = request.name;
  if (request.experiment) description.default_experiment = request.experiment;

  Package package;
  package.unit = content.type.name;
  package.query = content.query;
  package.robot = content.robot;
  package.start.take(content.variables);
  std::string hashed = to_xml(description) + serialise(package);
  for (const ArchiveFile& file : content.resources) hashed += file.name + std::get<std::string>(file.content);
  description.token = package.token = token_of(hashed);
  description.generation_date = generation_date();

  std::vector<ArchiveFile> files;
  files.push_back({"modelDescription.xml", to_xml(description)});
  files.push_back({"documentation/index.html", document(description, package.query)});
  add_libraries(request, package.unit, files);
  files.push_back({"resources/" + std::string(kPackageFile), serialise(package)});
  files.insert(files.end(), content.resources.begin(), content.resources.end());
  write_archive(out, files);
}

fs::path library_folder() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (error) throw Error("/proc/self/exe", "cannot be read: where is the running program?");
  return (program.parent_path().parent_path() / "lib/cotwin/fmu").lexically_normal();
}

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
