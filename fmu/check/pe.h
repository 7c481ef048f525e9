#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace cotwin::fmu {

/// The exported symbols and dependencies of a shared library for Windows (DLL), read from its bytes without loading it.
struct PeLibrary {
  std::string machine;                // "x86_64", "x86", "aarch64", else the number
  std::vector<std::string> needed;    // libraries of the import table and the delay-load table, as written there
  std::vector<std::string> exported;  // exported names, sorted
};

/// Throws Error if the file is not a 32- or 64-bit PE shared library, or is damaged.
PeLibrary read_pe(const std::filesystem::path& file);
/// The same from the bytes of a file. Messages begin with `place` instead of the file name.
PeLibrary parse_pe(const std::string& bytes, const std::string& place);

/// Returns whether a library is part of every Windows 10 and later; an FMU need not contain such a library. The run-time
/// libraries of compilers (VCRUNTIME140.dll, libstdc++-6.dll) are not part of Windows.
bool is_part_of_windows(const std::string& library);

}  // namespace cotwin::fmu
