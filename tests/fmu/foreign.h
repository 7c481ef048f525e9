#pragma once
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "components/unit/snapshot.h"
#include "fmu/archive/archive.h"
#include "fmu/import/load.h"
#include "tests/support/places.h"

/// Archives of the FMUs in fmus/, unchanged or with defects.
namespace cotwin::fmu::testing {

inline std::string read_text(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error("no " + file.string());
  std::ostringstream text;
  text << in.rdbuf();
  return std::move(text).str();
}

inline std::string description_of(const std::string& name) {
  return read_text(std::filesystem::path(places::source()) / "tests/fmu/fmus" / (name + ".xml"));
}

/// `text` with the first `from` replaced.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  if (at == std::string::npos) throw std::runtime_error("no '" + from + "'");
  return text.replace(at, from.size(), to);
}

using Edits = std::vector<std::pair<std::string, std::string>>;

/// Writes <folder>/rogue2.fmu for "rogue2", with `edits` made to its description.
inline std::filesystem::path make_fmu(const std::string& name, const std::filesystem::path& folder, const Edits& edits = {}) {
  std::string xml = description_of(name);
  for (const auto& [from, to] : edits) xml = replaced(xml, from, to);
  const std::string platform = name.back() == '2' ? "linux64" : "x86_64-linux", identifier = name.substr(0, name.size() - 1);
  const std::vector<ArchiveFile> files = {
      {"modelDescription.xml", xml},
      {"binaries/" + platform + "/" + identifier + ".so", std::filesystem::path(places::foreign_libraries()) / (name + ".so")}};
  const std::filesystem::path archive = folder / (name + ".fmu");
  write_archive(archive, files);
  return archive;
}

/// A folder for temporary folders that other programs do not use at the same time.
class PrivateTemporaries {
 public:
  PrivateTemporaries() { setenv("TMPDIR", folder_.path().c_str(), 1); }
  const std::filesystem::path& path() const { return folder_.path(); }

 private:
  TemporaryFolder folder_;
};
inline const PrivateTemporaries private_temporaries;

/// The number of temporary folders.
inline std::size_t temporary_folders() {
  std::size_t n = 0;
  for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::temp_directory_path())) {
    if (entry.path().filename().string().rfind("cotwin-", 0) == 0) ++n;
  }
  return n;
}

/// The number of different files of that name that are loaded as libraries.
inline std::size_t mapped_libraries(const std::string& name) {
  std::ifstream maps("/proc/self/maps");
  std::set<std::string> files;
  for (std::string line; std::getline(maps, line);) {
    const std::size_t begin = line.find('/');
    if (begin != std::string::npos && line.find("/" + name) != std::string::npos) files.insert(line.substr(begin));
  }
  return files.size();
}

inline double& real(Instance& instance, const char* name, std::size_t element = 0) {
  return instance.variables.at(name).reals()[element];
}
inline std::int32_t& integer(Instance& instance, const char* name) { return instance.variables.at(name).integers()[0]; }

inline StepResult step(Instance& instance, double from, double h) {
  return instance.unit->step(Time::from_seconds(from), Time::from_seconds(from + h) - Time::from_seconds(from));
}

/// Steps of `h` from `from` to `to`, at n · h.
inline StepResult run(Instance& instance, double from, double to, double h) {
  const int n = static_cast<int>((to - from) / h + 0.5);
  StepResult result = StepResult::kDone;
  for (int i = 0; i < n && result == StepResult::kDone; ++i) result = step(instance, from + i * h, h);
  return result;
}

}  // namespace cotwin::fmu::testing
