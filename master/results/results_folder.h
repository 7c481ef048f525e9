#pragma once
#include <filesystem>
#include <span>
#include <string>

/// The folder for the results of a command. One process at a time writes there, and earlier results are kept.
namespace cotwin::master {

/// A lock that the system releases when its process ends or is killed.
class FileLock {
 public:
  FileLock() = default;
  /// Locks `file`. Throws Error with the process that has the lock; `what` names the locked place: "results/twin". On a file
  /// system without locks nothing is locked.
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
  // Files of a run.
  static constexpr const char* kSignals = "signals.csv";
  static constexpr const char* kView = "view.bin";
  static constexpr const char* kRecord = "run.json";
  static constexpr const char* kSummary = "summary.json";
  static constexpr const char* kCheckpoint = "run.checkpoint";
  static constexpr const char* kHistory = "history.json";
  static constexpr const char* kPage = "report.html";

  /// Creates nothing. Throws Error if another process is writing there. `shown`: the folder as messages name it.
  explicit ResultsFolder(const std::filesystem::path& folder) : ResultsFolder(folder, folder) {}
  ResultsFolder(std::filesystem::path folder, const std::filesystem::path& shown);
  /// Creates the folder and locks it until the destructor. Throws Error.
  void open();
  /// Moves existing files with these names to a new subfolder "earlier-N". Returns that folder, or an empty path if there were
  /// no files. Files in `inputs` are copied instead, because they are read later.
  std::filesystem::path keep_earlier(std::span<const std::string> names,
                                     std::span<const std::filesystem::path> inputs = {}) const;
  /// The same for all files of a run.
  std::filesystem::path keep_earlier_run() const;

  const std::filesystem::path& path() const { return folder_; }

 private:
  std::filesystem::path folder_;
  std::string shown_;
  FileLock lock_;
};

}  // namespace cotwin::master
