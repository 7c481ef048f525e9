#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "fmu/description/model_description.h"
#include "fmu/import/under_way.h"

namespace cotwin::fmu {

/// Returns the names of the folders in binaries/ for the platform of this program, as the FMI version defines them.
std::vector<std::string> platform_folders(Version version);

/// Returns the shared library of an unpacked FMU. If there is none for this platform, throws Error with the platforms that the
/// FMU has.
std::filesystem::path library_file(const std::filesystem::path& folder, Version version, const std::string& identifier);

/// Loads a shared library; the destructor unloads it, unless threads that began meanwhile still run: they may be the FMU's, and
/// their code must stay. RTLD_NOW reports missing symbols here and not in a step. RTLD_LOCAL keeps
/// the symbols of FMUs apart. RTLD_DEEPBIND is not used: an FMU without its own C++ runtime could get another malloc than this
/// program, and sanitizers reject it. It is not needed either, for this program exports no symbols that an FMU could bind to.
class Library {
 public:
  explicit Library(const std::filesystem::path& file);
  ~Library();
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;

  /// Looks up a function. A missing one becomes nullptr; check() reports it if it is required.
  template <class Signature>
  void bind(Function<Signature>& function, const char* name, bool required = true) {
    function = {reinterpret_cast<typename Function<Signature>::Pointer>(address(name, required)), name};
  }
  /// Throws Error with the names of all missing required functions.
  void check() const;
  /// Never unloads the library. After a fatal error no code of the FMU may run, not even its static destructors.
  void abandon();

 private:
  void* address(const char* name, bool required);

  std::filesystem::path file_;
  void* handle_ = nullptr;
  std::vector<std::string> missing_;
  std::vector<int> threads_;  // of this process before the library was loaded
};

/// Returns the number of libraries that were not unloaded. Their destructors of static objects would run in exit(), perhaps
/// beside their threads, so a program should then end by _exit().
int abandoned_libraries() noexcept;

}  // namespace cotwin::fmu
