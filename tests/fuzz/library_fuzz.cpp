// Any bytes are a shared library for Linux or Windows whose names can be read, or an Error. Random bytes pass only the check of
// the magic number, so the input is also taken as edits of a valid library.
#include <elf.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "fmu/check/elf.h"
#include "fmu/check/pe.h"
#include "models/foundation/support/error.h"
#include "tests/fuzz/edits.h"

namespace {

template <class T>
void append(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// A library with two symbols, one needed library, a run path and a version of glibc: header, tables, sections.
std::string good_elf() {
  constexpr char kNames[] = "\0fmi2DoStep\0helper\0libm.so.6\0$ORIGIN\0GLIBC_2.28\0libc.so.6";
  const std::string names(kNames, sizeof kNames);
  const auto name = [&](const char* text) { return static_cast<std::uint32_t>(names.find(text)); };
  std::string symbols, dynamic, versions;
  for (const char* text : {"fmi2DoStep", "helper"}) {
    Elf64_Sym symbol{};
    symbol.st_name = name(text);
    symbol.st_info = ELF64_ST_INFO(STB_GLOBAL, STT_FUNC);
    symbol.st_shndx = 1;
    append(symbols, symbol);
  }
  for (const auto& [tag, text] : {std::pair{DT_NEEDED, "libm.so.6"}, std::pair{DT_RUNPATH, "$ORIGIN"}}) {
    Elf64_Dyn entry{};
    entry.d_tag = tag;
    entry.d_un.d_val = name(text);
    append(dynamic, entry);
  }
  Elf64_Verneed need{1, 1, name("libc.so.6"), sizeof(Elf64_Verneed), 0};
  Elf64_Vernaux version{0, 0, 2, name("GLIBC_2.28"), 0};
  append(versions, need);
  append(versions, version);

  std::string bytes(sizeof(Elf64_Ehdr), '\0');
  std::vector<Elf64_Shdr> sections(1);
  const auto add = [&](std::uint32_t type, const std::string& content, std::uint32_t info) {
    Elf64_Shdr s{};
    s.sh_type = type;
    s.sh_offset = bytes.size();
    s.sh_size = content.size();
    s.sh_link = 1;
    s.sh_info = info;
    bytes += content;
    sections.push_back(s);
  };
  add(SHT_STRTAB, names, 0);
  add(SHT_DYNSYM, symbols, 0);
  add(SHT_DYNAMIC, dynamic, 0);
  add(SHT_GNU_verneed, versions, 1);
  Elf64_Ehdr header{};
  std::memcpy(header.e_ident, ELFMAG, SELFMAG);
  header.e_ident[EI_CLASS] = ELFCLASS64;
  header.e_ident[EI_DATA] = ELFDATA2LSB;
  header.e_type = ET_DYN;
  header.e_machine = EM_X86_64;
  header.e_shoff = bytes.size();
  header.e_shentsize = sizeof(Elf64_Shdr);
  header.e_shnum = static_cast<std::uint16_t>(sections.size());
  std::memcpy(bytes.data(), &header, sizeof header);
  for (const Elf64_Shdr& s : sections) append(bytes, s);
  return bytes;
}

void read(const std::string& bytes) {
  using namespace cotwin;
  try {
    static_cast<void>(fmu::parse_elf(bytes, "library"));
  } catch (const Error& error) {
    if (!std::string_view(error.what()).starts_with("library")) std::abort();
  }
  try {
    static_cast<void>(fmu::parse_pe(bytes, "library"));
  } catch (const Error& error) {
    if (!std::string_view(error.what()).starts_with("library")) std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string good = good_elf();
  static const bool right = [] {
    const cotwin::fmu::ElfLibrary elf = cotwin::fmu::parse_elf(good, "good");
    return elf.exported.size() == 2 && elf.needed.size() == 1 && elf.oldest_glibc == "2.28";
  }();
  if (!right) std::abort();
  read(std::string(reinterpret_cast<const char*>(data), size));
  read(cotwin::fuzz::edited(good, data, size));
  return 0;
}
