#pragma once
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>
#include <string>

#include "fmu/check/elf.h"

namespace cotwin::fmu::testing {

/// Checks that a library which `cotwin pack` puts into an FMU loads with glibc 2.28 or newer and needs no other library.
/// `symbols`: output of `objdump -T`, as a second reader.
inline void expect_loads_with_old_glibc(const std::filesystem::path& library, const std::string& symbols) {
  constexpr const char* kOldest = "2.28";
  const ElfLibrary elf = read_elf(library);
  EXPECT_FALSE(older_version(kOldest, elf.oldest_glibc)) << library << " needs glibc " << elf.oldest_glibc;
  EXPECT_TRUE(elf.other_versions.empty()) << library << " needs " << ::testing::PrintToString(elf.other_versions);
  const std::string loader = elf.machine == "aarch64" ? "ld-linux-aarch64.so.1" : "ld-linux-x86-64.so.2";
  for (const std::string& needed : elf.needed)
    EXPECT_THAT(needed, ::testing::AnyOf("libc.so.6", "libm.so.6", "libpthread.so.0", "libdl.so.2", loader));

  std::string greatest = "0";
  std::istringstream words(symbols);
  for (std::string word; words >> word;) {
    const std::string name = "GLIBC_";
    const std::size_t at = word.find(name);
    if (at > 1) continue;  // "GLIBC_2.4" or, for another library, "(GLIBC_2.4)"
    const std::string version = word.substr(at + name.size(), word.find(')') - at - name.size());
    if (older_version(greatest, version)) greatest = version;
  }
  EXPECT_EQ(greatest, elf.oldest_glibc) << "by objdump and by the reader of this project";
}

}  // namespace cotwin::fmu::testing
