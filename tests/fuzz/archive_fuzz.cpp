// Any bytes are an archive that unpacks into its own folder, or an Error; nothing is left behind. The readers of ELF and PE
// read the libraries inside and the bytes themselves, or throw.
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "fmu/archive/archive.h"
#include "fmu/check/elf.h"
#include "fmu/check/pe.h"
#include "models/foundation/support/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  namespace fs = std::filesystem;
  using namespace cotwin;
  static const fmu::TemporaryFolder own;
  const fs::path archive = own.path() / "input.fmu";
  std::ofstream(archive, std::ios::binary).write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  fmu::ArchiveLimits limits;
  limits.entries = 100;
  limits.file_bytes = 1 << 20;
  limits.total_bytes = 4 << 20;
  limits.expansion_from = 1 << 16;
  fs::path unpacked;
  try {
    const fmu::TemporaryFolder folder = fmu::unpack_archive(archive, limits);
    unpacked = folder.path();
    for (const auto& entry : fs::recursive_directory_iterator(unpacked)) {
      if (entry.is_symlink() || (!entry.is_directory() && !entry.is_regular_file())) std::abort();
    }
  } catch (const Error&) {
  }
  if (!unpacked.empty() && fs::exists(unpacked)) std::abort();
  try {
    static_cast<void>(fmu::read_elf(archive));
  } catch (const Error&) {
  }
  try {
    static_cast<void>(fmu::read_pe(archive));
  } catch (const Error&) {
  }
  return 0;
}
