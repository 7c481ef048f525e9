#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace cotwin::fmu {

/// What a shared library for Linux shows and needs, read from its bytes; nothing is loaded.
struct ElfLibrary {
  std::string machine;                // "x86_64", "x86", "aarch64", else the number
  std::vector<std::string> needed;    // libraries, as in DT_NEEDED
  std::vector<std::string> run_path;  // DT_RUNPATH or DT_RPATH
  std::vector<std::string> exported;  // names of functions and data that others see
  std::string oldest_glibc;           // "2.34": the oldest glibc that has all that it needs; "" if it needs none of glibc
  /// Of libraries other than glibc's the greatest version of each name: "libstdc++.so.6" needs "CXXABI_1.3.9",
  /// "GLIBCXX_3.4.30".
  std::map<std::string, std::vector<std::string>> other_versions;
  bool unique_symbols = false;  // STB_GNU_UNIQUE: such a library is never unloaded
};

/// Whether version a is older than b: "2.4" than "2.34".
bool older_version(const std::string& a, const std::string& b);

/// Throws Error for a file that is no 64- or 32-bit little-endian ELF shared library, or is damaged.
ElfLibrary read_elf(const std::filesystem::path& file);
/// The same from the bytes of a file; `place` stands in messages where its name would.
ElfLibrary parse_elf(const std::string& bytes, const std::string& place);

}  // namespace cotwin::fmu
