#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace cotwin::fmu {

/// What a shared library for Windows (DLL) shows and needs, read from its bytes; nothing is loaded.
struct PeLibrary {
  std::string machine;                // "x86_64", "x86", "aarch64", else the number
  std::vector<std::string> needed;    // libraries of the import table and of the delayed one, as written there
  std::vector<std::string> exported;  // names that others see, sorted
};

/// Throws Error for a file that is no PE shared library for 32 or 64 bits, or is damaged.
PeLibrary read_pe(const std::filesystem::path& file);
/// The same from the bytes of a file; `place` stands in messages where its name would.
PeLibrary parse_pe(const std::string& bytes, const std::string& place);

/// Whether a library of that name comes with every Windows (10 and later): then an FMU may need it without bringing it along.
/// The run-time libraries of compilers (VCRUNTIME140.dll, libstdc++-6.dll) do not.
bool is_part_of_windows(const std::string& library);

}  // namespace cotwin::fmu
