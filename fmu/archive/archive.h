#pragma once
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <variant>
#include <vector>

/// Zip archives (.fmu, .ssp): writing them the same way every time, and reading those that nobody vouches for.
namespace cotwin::fmu {

/// One file of an archive that is to be written.
struct ArchiveFile {
  std::string name;                                          // "binaries/linux64/x.so": UTF-8, '/' between folders
  std::variant<std::string, std::filesystem::path> content;  // the bytes themselves, or a file that has them
};

/// Writes the files in the given order. Equal contents give equal archives, byte by byte: times are 1980-01-01, modes 0644. The
/// archive appears under its name when it is complete. Throws Error for what cannot be read or written and for a name that
/// read access below would refuse.
void write_archive(const std::filesystem::path& archive, std::span<const ArchiveFile> files);

/// What an archive may ask for. Everything is held against what the archive declares before anything is unpacked, and the sizes
/// again while it is unpacked.
struct ArchiveLimits {
  std::uint64_t entries = 20'000;            // files, and folders whether they are listed or not
  std::uint64_t name_bytes = 1'000;          // of a name with its folders; 255 of each part
  std::uint64_t depth = 32;                  // folders inside each other
  std::uint64_t file_bytes = 2ull << 30;     // of one file, unpacked
  std::uint64_t text_bytes = 256ull << 20;   // of one that is read as a whole: .xml, .ssd, .ssv, .ssm, .ssb
  std::uint64_t total_bytes = 4ull << 30;    // of all files; no more than the disk has room for either
  std::uint64_t expansion = 200;             // unpacked : packed, of a file and of the archive,
  std::uint64_t expansion_from = 64u << 20;  // beyond so many bytes unpacked
};

struct ArchiveEntry {
  std::string name;        // normalised: relative, '/' between folders, a folder ends with '/'
  std::uint64_t size = 0;  // as the archive tells
  std::uint64_t packed = 0;
};

/// The entries in the order of the archive. Throws Error for a file that is no zip archive and for every entry that must not be
/// unpacked: a name that is absolute, leaves the folder ("..", "C:"), stands for different contents, or is both file and
/// folder; a link or a device; encrypted; beyond the limits.
std::vector<ArchiveEntry> list_archive(const std::filesystem::path& archive, const ArchiveLimits& limits = {});

/// The contents of one file of the archive. Throws Error as list_archive, and if there is none of that name.
std::string read_archive_file(const std::filesystem::path& archive, const std::string& name, const ArchiveLimits& limits = {});

/// A new, empty folder of this process in the system's folder for temporary files, removed with everything in it by the
/// destructor. As long as it lives it is locked, so that another process can tell it from one whose owner is dead.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(TemporaryFolder&& other) noexcept;
  TemporaryFolder& operator=(TemporaryFolder&& other) noexcept;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
  int lock_ = -1;  // the folder itself, opened
};

/// Removes the temporary folders that programs of this user left behind when they were killed.
void sweep_temporary_folders();

/// Unpacks the archive into a folder of its own. Throws Error as list_archive, and for damaged data; then nothing is left on
/// the disk.
TemporaryFolder unpack_archive(const std::filesystem::path& archive, const ArchiveLimits& limits = {});

}  // namespace cotwin::fmu
