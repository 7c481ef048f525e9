#include "fmu/library.h"

#include <dlfcn.h>
#include <sys/utsname.h>

#include <algorithm>

#include "models/text/error.h"

namespace cotwin::fmu {

namespace fs = std::filesystem;

std::vector<std::string> platform_folders(Version version) {
#if defined(__x86_64__)
  const std::string architecture = "x86_64", fmi2 = "linux64";
#elif defined(__i386__)
  const std::string architecture = "x86", fmi2 = "linux32";
#elif defined(__aarch64__)
  const std::string architecture = "aarch64", fmi2 = "";
#else
  utsname machine{};
  uname(&machine);
  const std::string architecture = machine.machine, fmi2 = "";
#endif
  // FMI 2 has no word for machines but those of Intel's kind; what tools use instead is that of FMI 3.
  if (version == Version::k2 && !fmi2.empty()) return {fmi2};
  return {architecture + "-linux"};
}

fs::path library_file(const fs::path& folder, Version version, const std::string& identifier) {
  const fs::path binaries = folder / "binaries";
  for (const std::string& platform : platform_folders(version)) {
    const fs::path file = binaries / platform / (identifier + ".so");
    if (fs::is_regular_file(file)) return file;
  }
  std::vector<std::string> there;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(binaries, none)) there.push_back(entry.path().filename().string());
  std::sort(there.begin(), there.end());
  std::string list;
  for (const std::string& platform : there) list += (list.empty() ? "" : ", ") + platform;
  const bool sources = fs::is_directory(folder / "sources");
  throw Error("no library for this platform, expected binaries/" + platform_folders(version).front() + "/" + identifier +
              ".so; the FMU has binaries for " + (list.empty() ? "no platform" : list) + (sources ? ", and sources" : ""));
}

Library::Library(const fs::path& file) : file_(fs::absolute(file)) {
  handle_ = dlopen(file_.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (handle_ == nullptr) {
    const char* why = dlerror();
    throw Error(file_.filename().string(), std::string("cannot be loaded: ") + (why != nullptr ? why : "for no reason told"));
  }
}

Library::~Library() {
  if (handle_ != nullptr) dlclose(handle_);
}

void* Library::address(const char* name, bool required) {
  void* found = dlsym(handle_, name);
  if (found == nullptr && required) missing_.emplace_back(name);
  return found;
}

void Library::check() const {
  if (missing_.empty()) return;
  std::string list;
  for (const std::string& name : missing_) list += (list.empty() ? "" : ", ") + name;
  throw Error(file_.filename().string(), "does not have " + list);
}

}  // namespace cotwin::fmu
