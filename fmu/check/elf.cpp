#include "fmu/check/elf.h"

#include <elf.h>

#include <algorithm>
#include <cstring>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

struct Elf64 {
  using Header = Elf64_Ehdr;
  using Section = Elf64_Shdr;
  using Symbol = Elf64_Sym;
  using Dynamic = Elf64_Dyn;
  using Need = Elf64_Verneed;
  using NeedEntry = Elf64_Vernaux;
};
struct Elf32 {
  using Header = Elf32_Ehdr;
  using Section = Elf32_Shdr;
  using Symbol = Elf32_Sym;
  using Dynamic = Elf32_Dyn;
  using Need = Elf32_Verneed;
  using NeedEntry = Elf32_Vernaux;
};

constexpr std::uint64_t kMostLibraryBytes = std::uint64_t{512} << 20;
constexpr std::string_view kGlibc = "GLIBC_";

/// Returns the first glibc with this symbol version: "2.4" for GLIBC_2.4. GLIBC_ABI_… names features of the dynamic loader.
std::string glibc_of(const std::string& version) {
  const std::string rest = version.substr(kGlibc.size());
  return rest == "ABI_DT_RELR" ? "2.36" : rest;
}

template <class Elf>
class ElfReader {
 public:
  ElfReader(const std::string& bytes, const std::string& place) : bytes_(bytes), place_(place) {}

  ElfLibrary read() {
    const auto header = at<typename Elf::Header>(0);
    if (header.e_type != ET_DYN) fail("is not a shared library");
    ElfLibrary out;
    out.machine = header.e_machine == EM_X86_64    ? "x86_64"
                  : header.e_machine == EM_386     ? "x86"
                  : header.e_machine == EM_AARCH64 ? "aarch64"
                                                   : "machine " + std::to_string(header.e_machine);
    std::vector<typename Elf::Section> sections;
    for (std::size_t i = 0; i < header.e_shnum; ++i)
      sections.push_back(at<typename Elf::Section>(header.e_shoff + i * header.e_shentsize));
    const auto strings_of = [&](const typename Elf::Section& s) -> typename Elf::Section {
      if (s.sh_link >= sections.size()) fail("has a section without its string table");
      return sections[s.sh_link];
    };
    for (const auto& s : sections) {
      if (s.sh_type == SHT_DYNAMIC) dynamic(s, strings_of(s), out);
      if (s.sh_type == SHT_DYNSYM) symbols(s, strings_of(s), out);
      if (s.sh_type == SHT_GNU_verneed) versions(s, strings_of(s), out);
    }
    std::sort(out.exported.begin(), out.exported.end());
    for (auto& [library, list] : out.other_versions) std::sort(list.begin(), list.end());
    return out;
  }

 private:
  using Section = typename Elf::Section;

  void dynamic(const Section& s, const Section& strings, ElfLibrary& out) {
    for (std::size_t i = 0; i < s.sh_size / sizeof(typename Elf::Dynamic); ++i) {
      const auto entry = at<typename Elf::Dynamic>(s.sh_offset + i * sizeof(typename Elf::Dynamic));
      if (entry.d_tag == DT_NEEDED) out.needed.push_back(text(strings, entry.d_un.d_val));
      if (entry.d_tag == DT_RUNPATH || entry.d_tag == DT_RPATH) out.run_path.push_back(text(strings, entry.d_un.d_val));
    }
  }
  void symbols(const Section& s, const Section& strings, ElfLibrary& out) {
    for (std::size_t i = 0; i < s.sh_size / sizeof(typename Elf::Symbol); ++i) {
      const auto symbol = at<typename Elf::Symbol>(s.sh_offset + i * sizeof(typename Elf::Symbol));
      const unsigned char binding = symbol.st_info >> 4, visibility = symbol.st_other & 3;
      if (symbol.st_shndx == SHN_UNDEF || binding == STB_LOCAL || visibility == STV_HIDDEN || visibility == STV_INTERNAL)
        continue;
      if (binding == STB_GNU_UNIQUE) out.unique_symbols = true;
      out.exported.push_back(text(strings, symbol.st_name));
    }
  }
  void versions(const Section& s, const Section& strings, ElfLibrary& out) {
    std::size_t offset = s.sh_offset;
    for (std::size_t i = 0; i < s.sh_info; ++i) {
      const auto need = at<typename Elf::Need>(offset);
      std::size_t entry_offset = offset + need.vn_aux;
      for (std::size_t k = 0; k < need.vn_cnt; ++k) {
        const auto entry = at<typename Elf::NeedEntry>(entry_offset);
        const std::string version = text(strings, entry.vna_name);
        if (version.rfind(kGlibc, 0) == 0) {
          const std::string glibc = glibc_of(version);
          if (out.oldest_glibc.empty() || older_version(out.oldest_glibc, glibc)) out.oldest_glibc = glibc;
        } else {
          add_version(version, out.other_versions[text(strings, need.vn_file)]);
        }
        if (entry.vna_next == 0) break;
        entry_offset += entry.vna_next;
      }
      if (need.vn_next == 0) break;
      offset += need.vn_next;
    }
  }

  /// Adds a version to the list, which keeps only the greatest number of each name.
  static void add_version(const std::string& version, std::vector<std::string>& list) {
    const std::size_t number = version.rfind('_') + 1;
    for (std::string& known : list) {
      if (known.rfind('_') + 1 != number || known.compare(0, number, version, 0, number) != 0) continue;
      if (older_version(known.substr(number), version.substr(number))) known = version;
      return;
    }
    list.push_back(version);
  }

  template <class T>
  T at(std::size_t offset) const {
    if (offset > bytes_.size() || sizeof(T) > bytes_.size() - offset) fail("is truncated");
    T value;
    std::memcpy(&value, bytes_.data() + offset, sizeof value);
    return value;
  }
  std::string text(const Section& strings, std::size_t offset) const {
    const std::size_t begin = strings.sh_offset + offset;
    if (offset >= strings.sh_size || begin >= bytes_.size()) fail("has a name outside its string table");
    const std::size_t end = bytes_.find('\0', begin);
    if (end == std::string::npos) fail("has a name without a terminating zero");
    if ((names_ += end - begin) > 16 * bytes_.size()) fail("has names that are longer than its string table allows");
    return bytes_.substr(begin, end - begin);
  }
  [[noreturn]] void fail(const std::string& what) const { throw Error(place_, what); }

  const std::string& bytes_;
  std::string place_;
  mutable std::size_t names_ = 0;  // bytes of all names so far; limited because a damaged file can list one name many times
};

}  // namespace

bool older_version(const std::string& a, const std::string& b) {
  const auto x = text::split(a, '.'), y = text::split(b, '.');
  for (std::size_t i = 0; i < std::max(x.size(), y.size()); ++i) {
    const long long m = i < x.size() ? text::parse_integer(x[i]).value_or(0) : 0;
    const long long n = i < y.size() ? text::parse_integer(y[i]).value_or(0) : 0;
    if (m != n) return m < n;
  }
  return false;
}

ElfLibrary read_elf(const std::filesystem::path& file) {
  return parse_elf(text::read_file(file, "a shared library", kMostLibraryBytes), file.filename().string());
}

ElfLibrary parse_elf(const std::string& bytes, const std::string& place) {
  if (bytes.size() < EI_NIDENT || bytes.compare(0, SELFMAG, ELFMAG) != 0) throw Error(place, "is not an ELF file");
  if (bytes[EI_DATA] != ELFDATA2LSB) throw Error(place, "is not for a little-endian machine");
  if (bytes[EI_CLASS] == ELFCLASS64) return ElfReader<Elf64>(bytes, place).read();
  if (bytes[EI_CLASS] == ELFCLASS32) return ElfReader<Elf32>(bytes, place).read();
  throw Error(place, "is an ELF file of an unknown class");
}

}  // namespace cotwin::fmu
