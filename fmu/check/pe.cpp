#include "fmu/check/pe.h"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <set>
#include <string_view>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"

namespace cotwin::fmu {

namespace {

// Offsets and numbers from Microsoft's "PE Format" (learn.microsoft.com/windows/win32/debug/pe-format).
constexpr std::size_t kNewHeader = 0x3c;    // offset, in the DOS header, of the address of the signature "PE\0\0"
constexpr std::size_t kCoffHeader = 20;     // bytes
constexpr std::size_t kSectionHeader = 40;  // bytes
constexpr std::uint16_t kDllFlag = 0x2000;  // in the characteristics of the COFF header
constexpr std::uint16_t kPlus = 0x20b;      // magic number of the optional header, 64 bits
constexpr std::uint16_t kPlain = 0x10b;     // the same, 32 bits
constexpr std::size_t kMaxLibraries = 10'000;
enum Directory : std::size_t { kExports = 0, kImports = 1, kDelayedImports = 13 };

class PeReader {
 public:
  PeReader(const std::string& bytes, std::string place) : bytes_(bytes), place_(std::move(place)) {}

  PeLibrary read() {
    if (bytes_.size() < 0x40 || bytes_.compare(0, 2, "MZ") != 0) fail("is not a library for Windows");
    const std::size_t signature = at<std::uint32_t>(kNewHeader);
    if (at<std::uint32_t>(signature) != 0x4550) fail("is not a library for Windows");
    const std::size_t coff = signature + 4, optional = coff + kCoffHeader;
    PeLibrary out;
    const auto machine = at<std::uint16_t>(coff);
    out.machine = machine == 0x8664   ? "x86_64"
                  : machine == 0x14c  ? "x86"
                  : machine == 0xaa64 ? "aarch64"
                                      : "machine " + std::to_string(machine);
    if ((at<std::uint16_t>(coff + 18) & kDllFlag) == 0) fail("is not a shared library");
    const auto magic = at<std::uint16_t>(optional);
    if (magic != kPlus && magic != kPlain) fail("has an unknown kind of optional header, expected PE32 or PE32+");
    const std::size_t directories = optional + (magic == kPlus ? 112 : 96);
    const std::size_t count = at<std::uint32_t>(directories - 4);
    const std::size_t first = optional + at<std::uint16_t>(coff + 16);
    for (std::size_t i = 0; i < at<std::uint16_t>(coff + 2); ++i) {
      const std::size_t header = first + i * kSectionHeader;
      sections_.push_back({at<std::uint32_t>(header + 12), at<std::uint32_t>(header + 16), at<std::uint32_t>(header + 20)});
    }
    const auto directory = [&](Directory which) -> std::size_t {  // address relative to the image; 0 if absent
      return which < count ? at<std::uint32_t>(directories + 8 * which) : 0;
    };
    if (const std::size_t table = directory(kImports); table != 0) read_library_names(table, 20, 12, out.needed);
    if (const std::size_t table = directory(kDelayedImports); table != 0) read_library_names(table, 32, 4, out.needed);
    if (const std::size_t table = directory(kExports); table != 0) {
      const std::size_t header = offset(table), names = at<std::uint32_t>(header + 24);
      if (names > bytes_.size() / 4) fail("is truncated");
      const std::size_t list = names > 0 ? offset(at<std::uint32_t>(header + 32)) : 0;
      for (std::size_t i = 0; i < names; ++i) out.exported.push_back(text(at<std::uint32_t>(list + 4 * i)));
    }
    std::sort(out.exported.begin(), out.exported.end());
    return out;
  }

 private:
  struct Section {
    std::size_t address, size, file;  // address in the image; size and offset in the file
  };

  /// Reads a table of records of `size` bytes. Each has the address of a library's name at `name`; a zero address ends the
  /// table.
  void read_library_names(std::size_t table, std::size_t size, std::size_t name, std::vector<std::string>& out) const {
    for (std::size_t record = offset(table); out.size() < kMaxLibraries; record += size) {
      const std::size_t address = at<std::uint32_t>(record + name);
      if (address == 0) return;
      out.push_back(text(address));
    }
    fail("needs more than " + std::to_string(kMaxLibraries) + " libraries");
  }

  /// Returns the offset in the file of an address of the image.
  std::size_t offset(std::size_t address) const {
    for (const Section& s : sections_) {
      if (address >= s.address && address - s.address < s.size) return s.file + (address - s.address);
    }
    fail("has an address outside its sections");
  }
  template <class T>
  T at(std::size_t offset) const {
    if (offset > bytes_.size() || sizeof(T) > bytes_.size() - offset) fail("is truncated");
    T value;
    std::memcpy(&value, bytes_.data() + offset, sizeof value);
    return value;
  }
  std::string text(std::size_t address) const {
    const std::size_t begin = offset(address), end = bytes_.find('\0', begin);
    if (end == std::string::npos) fail("has a name without a terminating zero");
    if ((names_ += end - begin) > 16 * bytes_.size()) fail("has names that are longer in sum than the file allows");
    return bytes_.substr(begin, end - begin);
  }
  [[noreturn]] void fail(const std::string& what) const { throw Error(place_, what); }

  const std::string& bytes_;
  std::string place_;
  std::vector<Section> sections_;
  mutable std::size_t names_ = 0;  // bytes of all names so far; limited because a damaged file can list one name many times
};

}  // namespace

PeLibrary read_pe(const std::filesystem::path& file) {
  constexpr std::uint64_t kMostBytes = std::uint64_t{512} << 20;
  return parse_pe(text::read_file(file, "a shared library", kMostBytes), file.filename().string());
}

PeLibrary parse_pe(const std::string& bytes, const std::string& place) { return PeReader(bytes, place).read(); }

bool is_part_of_windows(const std::string& library) {
  std::string name = library;
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (name.starts_with("api-ms-win-") || name.starts_with("ext-ms-")) return true;
  static const std::set<std::string_view> kLibraries = {
      "advapi32.dll", "bcrypt.dll",   "comctl32.dll", "comdlg32.dll", "crypt32.dll",  "dbghelp.dll",
      "gdi32.dll",    "imm32.dll",    "iphlpapi.dll", "kernel32.dll", "mswsock.dll",  "msvcrt.dll",
      "ntdll.dll",    "ole32.dll",    "oleaut32.dll", "opengl32.dll", "psapi.dll",    "rpcrt4.dll",
      "secur32.dll",  "setupapi.dll", "shell32.dll",  "shlwapi.dll",  "ucrtbase.dll", "user32.dll",
      "userenv.dll",  "version.dll",  "winhttp.dll",  "wininet.dll",  "winmm.dll",    "ws2_32.dll"};
  return kLibraries.count(name) != 0;
}

}  // namespace cotwin::fmu
