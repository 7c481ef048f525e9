#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace cotwin::fmu {

/// What a shared library for Linux shows and needs, read from its bytes; nothing is loaded.
struct ElfLibrary {
  std::string machine;                // "x86_64", "x86", "aarch64", else the number
  std::vector<std::string> needed;    // libraries, as in DT_NEEDED
  std::vector<std::string> run_path;  // DT_RUNPATH or DT_RPATH
  std::vector<std::string> exported;  // names of functions and data that others see
  std::string oldest_glibc;           // "2.34": the greatest version of GLIBC_ that it needs; "" if it needs none
  bool unique_symbols = false;        // STB_GNU_UNIQUE: such a library is never unloaded
};

/// Throws Error for a file that is no 64- or 32-bit little-endian ELF shared library, or is damaged.
ElfLibrary read_elf(const std::filesystem::path& file);

}  // namespace cotwin::fmu
