#include "fmu/import/library.h"

#include <dlfcn.h>
#include <link.h>
#include <sys/utsname.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <fstream>
#include <mutex>
#include <system_error>
#include <thread>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace fs = std::filesystem;

namespace {

#if defined(__x86_64__)
constexpr unsigned kOwnMachine = EM_X86_64;
#elif defined(__aarch64__)
constexpr unsigned kOwnMachine = EM_AARCH64;
#else
constexpr unsigned kOwnMachine = EM_NONE;
#endif

/// Checks what dlopen() does not: access to a segment beyond the end of a truncated file would end the program with SIGBUS, and
/// for a library of another machine dlopen() reports a missing file.
void check_loadable(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  ElfW(Ehdr) header{};
  in.read(reinterpret_cast<char*>(&header), sizeof header);
  constexpr unsigned char kOwnClass = sizeof(void*) == 8 ? ELFCLASS64 : ELFCLASS32;
  const bool ours = in && std::memcmp(header.e_ident, ELFMAG, SELFMAG) == 0 && header.e_ident[EI_CLASS] == kOwnClass;
  if (!ours) return;  // dlopen() reports the reason
  const std::string name = file.filename().string();
  if (kOwnMachine != EM_NONE && header.e_machine != kOwnMachine)
    throw Error(name, "is for another machine, expected " + platform_folders(Version::k3).front());
  const std::uintmax_t size = fs::file_size(file);
  for (unsigned i = 0; i < header.e_phnum; ++i) {
    ElfW(Phdr) segment{};
    in.seekg(static_cast<std::streamoff>(header.e_phoff + std::uint64_t{i} * header.e_phentsize));
    in.read(reinterpret_cast<char*>(&segment), sizeof segment);
    const bool there = segment.p_filesz <= size && segment.p_offset <= size - segment.p_filesz;
    if (!in || (segment.p_type == PT_LOAD && !there))
      throw Error(name, "is truncated: it has " + std::to_string(size) + " bytes, expected more");
  }
}

std::atomic<int> abandoned{0};

/// The loader's own lock orders this for threads, too, but a thread sanitizer does not see it: an FMU that asks for its library's name
/// reads what dlopen() stored for another instance.
std::mutex loading;

/// Empty if the system does not tell them, also after an error: a destructor asks.
std::vector<int> threads_of_process() noexcept try {
  std::vector<int> threads;
  for (const auto& entry : fs::directory_iterator("/proc/self/task")) threads.push_back(std::stoi(entry.path().filename()));
  return threads;
} catch (const std::exception&) {
  return {};
}

/// Whether this process has other threads than these. A thread that was joined may be listed for some µs.
bool others_run(const std::vector<int>& threads) {
  for (int attempt = 0; attempt < 5; ++attempt) {
    const std::vector<int> now = threads_of_process();
    if (std::ranges::all_of(now, [&](int thread) { return std::ranges::find(threads, thread) != threads.end(); })) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

}  // namespace

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
  // FMI 2 names only x86 platforms; for others, tools use the names of FMI 3.
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
  const std::string list = text::joined(there);
  const bool sources = fs::is_directory(folder / "sources");
  throw Error("no library for this platform, expected binaries/" + platform_folders(version).front() + "/" + identifier +
              ".so; the FMU has binaries for " + (list.empty() ? "no platform" : list) + (sources ? ", and sources" : ""));
}

Library::Library(const fs::path& file) : file_(fs::absolute(file)), threads_(threads_of_process()) {
  check_loadable(file_);
  const CallUnderWay call(known_function("the loading of its library"));
  const std::lock_guard one(loading);
  handle_ = dlopen(file_.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (handle_ == nullptr) {
    const char* why = dlerror();
    throw Error(file_.filename().string(), std::string("cannot be loaded: ") + (why != nullptr ? why : "unknown reason"));
  }
}

Library::~Library() {
  const CallUnderWay call(known_function("the unloading of its library"));
  if (handle_ == nullptr) return;
  if (others_run(threads_)) {
    abandon();
  } else {
    dlclose(handle_);
  }
}

void Library::abandon() {
  handle_ = nullptr;
  ++abandoned;
}

int abandoned_libraries() noexcept { return abandoned; }

void* Library::address(const char* name, bool required) {
  void* found = dlsym(handle_, name);
  if (found == nullptr && required) missing_.emplace_back(name);
  return found;
}

void Library::check() const {
  if (missing_.empty()) return;
  const std::string list = text::joined(missing_);
  throw Error(file_.filename().string(), "lacks the functions " + list);
}

}  // namespace cotwin::fmu
