#include "fmu/archive/archive.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zip.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <system_error>
#include <utility>

#include "fmu/archive/file_kind.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"

namespace cotwin::fmu {

namespace {

namespace fs = std::filesystem;

constexpr std::string_view kFolderPrefix = "cotwin-";  // of temporary folders
constexpr time_t kSweepAge = 60;                       // s
constexpr zip_uint16_t kDosDate = (1 << 5) | 1;        // 1980-01-01, the first day of DOS time

struct Discard {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
using Archive = std::unique_ptr<zip_t, Discard>;

struct CloseFile {
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};
using File = std::unique_ptr<zip_file_t, CloseFile>;

Archive create(const fs::path& path) {
  int code = 0;
  Archive archive(zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code));
  if (archive) return archive;
  zip_error_t error;
  zip_error_init_with_code(&error, code);
  const std::string message = zip_error_strerror(&error);
  zip_error_fini(&error);
  throw Error(path.string(), message + ", expected a writable file name for an archive");
}

Archive open(const fs::path& path) {
  text::File file = text::open_file(path, "a zip archive");
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* const source = zip_source_filep_create(file.get(), 0, -1, &error);
  if (source != nullptr) static_cast<void>(file.release());  // the source closes it
  Archive archive(source == nullptr ? nullptr : zip_open_from_source(source, ZIP_RDONLY, &error));
  const std::string message = archive ? "" : zip_error_strerror(&error);
  if (!archive && source != nullptr) zip_source_free(source);
  zip_error_fini(&error);
  if (!archive) throw Error(path.string(), message + ", expected a zip archive");
  return archive;
}

[[noreturn]] void reject(const fs::path& archive, const std::string& entry, const std::string& what) {
  throw Error(archive.string() + ": '" + entry + "'", what);
}

/// Returns the name with '/' between folders. Throws Error if the name could lead outside the folder it is unpacked to.
std::string checked_name(const fs::path& archive, const std::string& raw, const ArchiveLimits& limits) {
  std::string name = raw.substr(0, limits.name_bytes + 1);
  std::replace(name.begin(), name.end(), '\\', '/');
  if (name.empty() || name.size() > limits.name_bytes)
    reject(archive, raw.substr(0, 60), "is not a file name, expected 1 to " + std::to_string(limits.name_bytes) + " bytes");
  if (name.front() == '/' || name.find(':') != std::string::npos) reject(archive, raw, "is absolute, expected a relative name");
  if (static_cast<std::uint64_t>(std::count(name.begin(), name.end(), '/')) > limits.depth)
    reject(archive, raw, "lies in more than " + std::to_string(limits.depth) + " folders");
  for (std::size_t begin = 0; begin < name.size();) {
    const std::size_t end = std::min(name.find('/', begin), name.size());
    const std::string part = name.substr(begin, end - begin);
    if (part == "..") reject(archive, raw, "leads outside the archive's folder");
    if (part.empty() || part == "." || part.size() > 255)
      reject(archive, raw, "has a part that is empty, '.' or longer than 255 bytes");
    for (const char c : part) {
      if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) reject(archive, raw, "has a control character");
    }
    begin = end + 1;
  }
  return name;
}

struct Entry {
  ArchiveEntry declared;
  zip_uint64_t index = 0;
  bool executable = false;
};

/// Returns whether the entry is a file or a folder by its Unix mode bits, or has no such bits.
bool is_file_or_folder(zip_uint8_t system, zip_uint32_t attributes) {
  if (system != ZIP_OPSYS_UNIX && system != ZIP_OPSYS_OS_X) return true;
  const auto format = (attributes >> 16) & S_IFMT;
  return format == 0 || format == S_IFREG || format == S_IFDIR;
}

/// Returns whether files with this ending are read as a whole.
bool is_text(const std::string& name) {
  for (const char* ending : {".xml", ".ssd", ".ssv", ".ssm", ".ssb"}) {
    if (has_ending(name, ending)) return true;
  }
  return false;
}

/// Checks the unpacked size of all entries against the limit and against the size of the archive file. Both are needed because
/// entries can share their compressed bytes.
void check_total(const fs::path& archive, std::uint64_t total, const ArchiveLimits& limits) {
  if (total > limits.total_bytes) {
    throw Error(archive.string(),
                "unpacks to " + std::to_string(total) + " bytes, expected at most " + std::to_string(limits.total_bytes));
  }
  std::error_code none;
  const std::uintmax_t size = fs::file_size(archive, none);
  if (!none && total > limits.expansion_from && total / limits.expansion > size) {
    throw Error(archive.string(), std::to_string(size) + " bytes unpack to " + std::to_string(total) + ", expected at most " +
                                      std::to_string(limits.expansion) + " times as many");
  }
}

std::vector<Entry> checked_entries(zip_t* zip, const fs::path& archive, const ArchiveLimits& limits) {
  const zip_int64_t n = zip_get_num_entries(zip, 0);
  if (n < 0 || static_cast<std::uint64_t>(n) > limits.entries) {
    throw Error(archive.string(), std::to_string(n) + " entries, expected at most " + std::to_string(limits.entries));
  }
  std::vector<Entry> entries;
  std::map<std::string, std::pair<zip_uint64_t, zip_uint32_t>> files;  // with their sizes and check sums
  std::set<std::string> folders;
  std::uint64_t total = 0;
  for (zip_uint64_t i = 0; i < static_cast<zip_uint64_t>(n); ++i) {
    zip_stat_t stat;
    if (zip_stat_index(zip, i, 0, &stat) != 0 || (stat.valid & ZIP_STAT_NAME) == 0 || (stat.valid & ZIP_STAT_SIZE) == 0) {
      throw Error(archive.string(), "entry " + std::to_string(i) + " is damaged: " + zip_strerror(zip));
    }
    Entry entry;
    entry.index = i;
    entry.declared.name = checked_name(archive, stat.name, limits);
    entry.declared.size = stat.size;
    entry.declared.packed = stat.comp_size;
    const std::string& name = entry.declared.name;
    if ((stat.valid & ZIP_STAT_ENCRYPTION_METHOD) != 0 && stat.encryption_method != ZIP_EM_NONE) {
      reject(archive, name, "is encrypted");
    }
    if ((stat.valid & ZIP_STAT_COMP_METHOD) != 0 && stat.comp_method != ZIP_CM_STORE && stat.comp_method != ZIP_CM_DEFLATE)
      reject(archive, name,
             "is compressed by method " + std::to_string(stat.comp_method) + ", expected 8 (deflate) or 0 (stored)");
    zip_uint8_t system = 0;
    zip_uint32_t attributes = 0;
    if (zip_file_get_external_attributes(zip, i, 0, &system, &attributes) == 0) {
      if (!is_file_or_folder(system, attributes)) reject(archive, name, "is a link or a device, expected a file");
      entry.executable = system == ZIP_OPSYS_UNIX && ((attributes >> 16) & S_IXUSR) != 0;
    }
    const std::uint64_t most = is_text(name) ? std::min(limits.text_bytes, limits.file_bytes) : limits.file_bytes;
    if (stat.size > most)
      reject(archive, name, "unpacks to " + std::to_string(stat.size) + " bytes, expected at most " + std::to_string(most));
    if (stat.size > limits.expansion_from && stat.size / limits.expansion > stat.comp_size) {
      reject(archive, name,
             "unpacks " + std::to_string(stat.comp_size) + " bytes to " + std::to_string(stat.size) + ", expected at most " +
                 std::to_string(limits.expansion) + " times as many");
    }
    total += std::min(stat.size, limits.total_bytes + 1);  // so that the sum of 20 000 sizes does not overflow
    const bool folder = name.back() == '/';
    const std::string bare = folder ? name.substr(0, name.size() - 1) : name;
    if (!folder) {
      const auto [earlier, fresh] = files.emplace(bare, std::pair(stat.size, stat.crc));
      if (!fresh && ((stat.valid & ZIP_STAT_CRC) == 0 || earlier->second != std::pair(stat.size, stat.crc)))
        reject(archive, name, "appears twice with different contents");
      if (!fresh) continue;  // the same file packed twice
    }
    if (folder) folders.insert(bare);
    for (std::size_t slash = bare.find('/'); slash != std::string::npos; slash = bare.find('/', slash + 1)) {
      folders.insert(bare.substr(0, slash));
    }
    entries.push_back(std::move(entry));
  }
  check_total(archive, total, limits);
  if (folders.size() + files.size() > limits.entries) {
    throw Error(archive.string(), std::to_string(folders.size() + files.size()) + " files and folders, expected at most " +
                                      std::to_string(limits.entries));
  }
  for (const auto& [file, sum] : files) {
    if (folders.count(file) != 0) reject(archive, file, "is both a file and a folder");
  }
  return entries;
}

/// Passes the entry's bytes to `take` block by block. Throws Error if their number differs from the declared size.
void inflate(zip_t* zip, const fs::path& archive, const Entry& entry,
             const std::function<void(const char*, std::size_t)>& take) {
  File file(zip_fopen_index(zip, entry.index, 0));
  if (!file) reject(archive, entry.declared.name, std::string("cannot be unpacked: ") + zip_strerror(zip));
  std::vector<char> buffer(1u << 16);
  std::uint64_t got = 0;
  while (true) {
    const zip_int64_t n = zip_fread(file.get(), buffer.data(), buffer.size());
    if (n < 0) reject(archive, entry.declared.name, std::string("is damaged: ") + zip_file_strerror(file.get()));
    if (n == 0) break;
    got += static_cast<std::uint64_t>(n);
    if (got > entry.declared.size) break;
    take(buffer.data(), static_cast<std::size_t>(n));
  }
  if (got != entry.declared.size) reject(archive, entry.declared.name, "does not have the size that the archive declares");
}

void check_disk_space(const fs::path& archive, const fs::path& folder, const std::vector<Entry>& entries) {
  std::uint64_t total = 0;
  for (const Entry& entry : entries) total += entry.declared.size;
  std::error_code unknown;
  const fs::space_info space = fs::space(folder, unknown);
  if (unknown || total <= space.available) return;
  throw Error(archive.string(), "unpacks to " + std::to_string(total) + " bytes, but " + folder.parent_path().string() +
                                    " has " + std::to_string(space.available) + " bytes free");
}

void add(zip_t* zip, const fs::path& archive, const ArchiveFile& file) {
  const std::string name = checked_name(archive, file.name, {});
  zip_source_t* source = nullptr;
  if (const auto* bytes = std::get_if<std::string>(&file.content)) {
    source = zip_source_buffer(zip, bytes->data(), bytes->size(), 0);
  } else {
    const fs::path& from = std::get<fs::path>(file.content);
    if (!fs::is_regular_file(from)) throw Error(from.string(), "no such file, needed for " + file.name);
    source = zip_source_file(zip, from.c_str(), 0, -1);
  }
  const zip_int64_t index = source == nullptr ? -1 : zip_file_add(zip, name.c_str(), source, ZIP_FL_ENC_UTF_8);
  if (index < 0) {
    zip_source_free(source);
    reject(archive, file.name, std::string("cannot be added: ") + zip_strerror(zip));
  }
  const auto i = static_cast<zip_uint64_t>(index);
  if (zip_file_set_dostime(zip, i, 0, kDosDate, 0) != 0 || zip_set_file_compression(zip, i, ZIP_CM_DEFLATE, 6) != 0 ||
      zip_file_set_external_attributes(zip, i, 0, ZIP_OPSYS_UNIX, static_cast<zip_uint32_t>(S_IFREG | 0644) << 16) != 0) {
    reject(archive, file.name, std::string("cannot be added: ") + zip_strerror(zip));
  }
}

}  // namespace

void write_archive(const fs::path& archive, std::span<const ArchiveFile> files) {
  Archive zip = create(archive);
  for (const ArchiveFile& file : files) add(zip.get(), archive, file);
  if (zip_close(zip.get()) != 0) {
    zip_error_t* const error = zip_get_error(zip.get());
    if (zip_error_system_type(error) == ZIP_ET_SYS) fail_to_write(archive.string(), zip_error_code_system(error));
    throw Error(archive.string(), std::string("cannot be written: ") + zip_strerror(zip.get()));
  }
  static_cast<void>(zip.release());  // zip_close has freed it
}

std::vector<ArchiveEntry> list_archive(const fs::path& archive, const ArchiveLimits& limits) {
  const Archive zip = open(archive);
  std::vector<ArchiveEntry> list;
  for (Entry& entry : checked_entries(zip.get(), archive, limits)) list.push_back(std::move(entry.declared));
  return list;
}

std::string read_archive_file(const fs::path& archive, const std::string& name, const ArchiveLimits& limits) {
  const Archive zip = open(archive);
  for (const Entry& entry : checked_entries(zip.get(), archive, limits)) {
    if (entry.declared.name != name) continue;
    std::string content;
    inflate(zip.get(), archive, entry, [&](const char* bytes, std::size_t n) { content.append(bytes, n); });
    return content;
  }
  throw Error(archive.string(), "has no " + name);
}

TemporaryFolder::TemporaryFolder() {
  const std::string name = std::string(kFolderPrefix) + std::to_string(getpid()) + "-XXXXXX";
  std::string pattern = (fs::temp_directory_path() / name).string();
  if (mkdtemp(pattern.data()) == nullptr) {
    throw Error(pattern, "cannot be created: " + std::error_code(errno, std::generic_category()).message());
  }
  path_ = pattern;
  lock_ = ::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (lock_ >= 0) flock(lock_, LOCK_EX | LOCK_NB);
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
  if (lock_ >= 0) close(lock_);
}

TemporaryFolder::TemporaryFolder(TemporaryFolder&& other) noexcept
    : path_(std::exchange(other.path_, {})), lock_(std::exchange(other.lock_, -1)) {}

TemporaryFolder& TemporaryFolder::operator=(TemporaryFolder&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(lock_, other.lock_);
  return *this;
}

namespace {

/// "cotwin-4711-AbCdEf"
bool is_temporary_folder(std::string_view name) {
  if (!name.starts_with(kFolderPrefix)) return false;
  const std::size_t end = std::min(name.find_first_not_of("0123456789", kFolderPrefix.size()), name.size());
  return end > kFolderPrefix.size() && name.size() == end + 7 && name[end] == '-';
}

/// Removes the temporary folders of this user that no process has locked, last changed before `before`, and whose names begin as
/// given.
void remove_unlocked(const std::string& prefix, time_t before) {
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(fs::temp_directory_path(none), none)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(prefix)) continue;
    if (!is_temporary_folder(name)) continue;
    const int folder = ::open(entry.path().c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (folder < 0) continue;
    struct stat status {};
    const bool ours = fstat(folder, &status) == 0 && status.st_uid == geteuid() && status.st_mtime < before;
    if (ours && flock(folder, LOCK_EX | LOCK_NB) == 0) fs::remove_all(entry.path(), none);
    close(folder);
  }
}

}  // namespace

void sweep_temporary_folders() {
  // A new folder may not be locked yet, so only folders older than kSweepAge are removed.
  remove_unlocked(std::string(kFolderPrefix), time(nullptr) - kSweepAge);
}

void remove_temporary_folders(int process) {
  remove_unlocked(std::string(kFolderPrefix) + std::to_string(process) + "-", std::numeric_limits<time_t>::max());
}

TemporaryFolder unpack_archive(const fs::path& archive, const ArchiveLimits& limits) {
  const Archive zip = open(archive);
  const std::vector<Entry> entries = checked_entries(zip.get(), archive, limits);
  TemporaryFolder folder;
  check_disk_space(archive, folder.path(), entries);
  for (const Entry& entry : entries) {
    const fs::path path = folder.path() / entry.declared.name;
    if (entry.declared.name.back() == '/') {
      fs::create_directories(path);
      continue;
    }
    fs::create_directories(path.parent_path());
    std::ofstream out(path, std::ios::binary);
    inflate(zip.get(), archive, entry,
            [&](const char* bytes, std::size_t n) { out.write(bytes, static_cast<std::streamsize>(n)); });
    out.close();
    if (!out) throw CutOutput(path.string(), "cannot be written: is the disk full?");
    if (entry.executable) fs::permissions(path, fs::perms::owner_exec, fs::perm_options::add);
  }
  return folder;
}

}  // namespace cotwin::fmu
