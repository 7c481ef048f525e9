#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "fmu/description/model_description.h"
#include "fmu/import/under_way.h"

namespace cotwin::fmu {

/// The folders below binaries/ that may hold a library for the machine this program was built for, in the words of that
/// version.
std::vector<std::string> platform_folders(Version version);

/// The shared library of an unpacked FMU. Throws Error that names what the archive has instead where there is none for this
/// platform.
std::filesystem::path library_file(const std::filesystem::path& folder, Version version, const std::string& identifier);

/// A shared library that is loaded as long as this lives: RTLD_NOW, so that what is missing is told here and not in a step, and
/// RTLD_LOCAL, so that two FMUs do not see each other's symbols. Not RTLD_DEEPBIND: it would give an FMU that brings no C++
/// runtime a second view of malloc and of ours, and sanitizers refuse it; this program exports no symbols that could be taken
/// for an FMU's own.
class Library {
 public:
  explicit Library(const std::filesystem::path& file);
  ~Library();
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;

  /// Looks a function up; one that is not there is remembered for check() if it is required, and stays nullptr.
  template <class Signature>
  void bind(Function<Signature>& function, const char* name, bool required = true) {
    function = {reinterpret_cast<typename Function<Signature>::Pointer>(address(name, required)), name};
  }
  /// Throws Error that names every required function that was not there.
  void check() const;
  /// Keeps the library in memory for ever: an FMU that failed fatally must not be called again, not even its destructors.
  void abandon() { handle_ = nullptr; }

 private:
  void* address(const char* name, bool required);

  std::filesystem::path file_;
  void* handle_ = nullptr;
  std::vector<std::string> missing_;
};

}  // namespace cotwin::fmu
