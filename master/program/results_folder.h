#pragma once
#include <filesystem>
#include <span>
#include <string>

/// Where a command leaves its results: one process at a time writes there, and what was there before is kept.
namespace cotwin::master {

/// A lock that the system releases when its process ends, however it ends.
class FileLock {
 public:
  FileLock() = default;
  /// Throws Error that names the process that has it; `what` is locked: "results/twin". A file system without locks is used
  /// without.
  FileLock(std::filesystem::path file, const std::string& what);
  ~FileLock();
  FileLock(FileLock&& other) noexcept;
  FileLock& operator=(FileLock&& other) noexcept;

 private:
  std::filesystem::path file_;
  int descriptor_ = -1;
};

class ResultsFolder {
 public:
  static constexpr const char* kLock = "cotwin.lock";

  /// Creates nothing yet, but throws Error if another process writes there.
  explicit ResultsFolder(std::filesystem::path folder);
  /// Creates the folder and locks it until the destructor. Throws Error.
  void open();
  /// Moves those of `names` that are there to a new folder "earlier-N" in it and returns that, or nothing where there are none.
  /// Those that are among `inputs` are copied: they are still to be read.
  std::filesystem::path keep_earlier(std::span<const std::string> names,
                                     std::span<const std::filesystem::path> inputs = {}) const;

  const std::filesystem::path& path() const { return folder_; }

 private:
  std::filesystem::path folder_;
  FileLock lock_;
};

}  // namespace cotwin::master
