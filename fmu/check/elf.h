#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace cotwin::fmu {

/// The exported symbols and dependencies of a shared library for Linux, read from its bytes without loading it.
struct ElfLibrary {
  std::string machine;                // "x86_64", "x86", "aarch64", else the number
  std::vector<std::string> needed;    // libraries, as in DT_NEEDED
  std::vector<std::string> run_path;  // DT_RUNPATH or DT_RPATH
  std::vector<std::string> exported;  // names of exported functions and data, sorted
  std::string oldest_glibc;           // "2.34": the oldest glibc that suffices; "" if no versioned symbol of glibc is needed
  /// Required symbol versions of other libraries, the greatest of each name: "libstdc++.so.6" → "CXXABI_1.3.9",
  /// "GLIBCXX_3.4.30".
  std::map<std::string, std::vector<std::string>> other_versions;
  bool unique_symbols = false;  // STB_GNU_UNIQUE: such a library is never unloaded
};

/// Returns whether version a is older than b: "2.4" is older than "2.34".
bool older_version(const std::string& a, const std::string& b);

/// Throws Error if the file is not a 64- or 32-bit little-endian ELF shared library, or is damaged.
ElfLibrary read_elf(const std::filesystem::path& file);
/// The same from the bytes of a file. Messages begin with `place` instead of the file name.
ElfLibrary parse_elf(const std::string& bytes, const std::string& place);

}  // namespace cotwin::fmu
