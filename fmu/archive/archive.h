#pragma once
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <variant>
#include <vector>

/// Zip archives (.fmu, .ssp): reproducible writing, and safe reading of untrusted archives.
namespace cotwin::fmu {

/// One file to write into an archive.
struct ArchiveFile {
  std::string name;                                          // "binaries/linux64/x.so": UTF-8, '/' between folders
  std::variant<std::string, std::filesystem::path> content;  // the bytes, or the file to read them from
};

/// Writes the files in the given order. Equal contents give byte-identical archives: all times are 1980-01-01, all modes 0644.
/// The archive gets its name only when it is complete. Throws Error for files that cannot be read or written and for names that
/// the readers below would reject.
void write_archive(const std::filesystem::path& archive, std::span<const ArchiveFile> files);

/// Upper limits for reading an archive. The sizes that the archive declares are checked before anything is unpacked; the actual
/// sizes are checked while unpacking.
struct ArchiveLimits {
  std::uint64_t entries = 20'000;            // files and folders, including folders without an entry of their own
  std::uint64_t name_bytes = 1'000;          // of a whole path; each part of it: 255
  std::uint64_t depth = 32;                  // nested folders
  std::uint64_t file_bytes = 2ull << 30;     // of one file, unpacked
  std::uint64_t text_bytes = 256ull << 20;   // of one file that is read as a whole: .xml, .ssd, .ssv, .ssm, .ssb
  std::uint64_t total_bytes = 4ull << 30;    // of all files; free disk space is a limit too
  std::uint64_t expansion = 200;             // ratio unpacked : packed, of a file and of the archive;
  std::uint64_t expansion_from = 64u << 20;  // checked only above this number of unpacked bytes
};

struct ArchiveEntry {
  std::string name;          // normalised: relative, '/' between folders, a folder ends with '/'
  std::uint64_t size = 0;    // unpacked bytes, as the archive declares
  std::uint64_t packed = 0;  // compressed bytes
};

/// Returns the entries in the order of the archive. Throws Error if the file is not a zip archive or if an entry is unsafe: an
/// absolute name; a name outside the folder ("..", "C:"); a name used twice with different contents, or for a file and a
/// folder; a link or a device; encrypted data; a limit exceeded.
std::vector<ArchiveEntry> list_archive(const std::filesystem::path& archive, const ArchiveLimits& limits = {});

/// Returns the contents of one file of the archive. Throws Error like list_archive, and if no file has that name.
std::string read_archive_file(const std::filesystem::path& archive, const std::string& name, const ArchiveLimits& limits = {});

/// A new, empty folder in the system's folder for temporary files. The destructor removes it with its contents. The folder is
/// locked while this object exists, so that sweep_temporary_folders() of another process leaves it alone.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(TemporaryFolder&& other) noexcept;
  TemporaryFolder& operator=(TemporaryFolder&& other) noexcept;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
  int lock_ = -1;  // descriptor of the folder; holds the lock
};

/// Removes the temporary folders that killed programs of this user left behind.
void sweep_temporary_folders();
/// Removes those of one process that has ended.
void remove_temporary_folders(int process);

/// Unpacks the archive into a new temporary folder. Throws Error like list_archive, and for damaged data; the folder is then
/// removed.
TemporaryFolder unpack_archive(const std::filesystem::path& archive, const ArchiveLimits& limits = {});

}  // namespace cotwin::fmu
