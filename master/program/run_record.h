#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "master/program/report.h"
#include "master/run/crash.h"
#include "master/run/identity.h"

/// run.json: what results came from, and whether they are complete.
namespace cotwin::master {

class RunRecord {
 public:
  struct Given {
    std::filesystem::path file;  // run.json
    Build build;
    std::uint64_t scenario = 0;        // hash_of(Scenario)
    std::vector<std::string> set;      // --set
    std::filesystem::path results;     // signals.csv; empty if nothing is recorded
    std::optional<double> resumed_at;  // s
  };
  /// Takes what is told from the initialised master and writes the file, with the state "running". Throws Error.
  RunRecord(Given given, const Master& master);
  ~RunRecord();
  RunRecord(const RunRecord&) = delete;
  RunRecord& operator=(const RunRecord&) = delete;

  /// The end: state "complete", "stopped" or "failed", reason, time, figures. On a full disk it is written over the earlier
  /// text, into room that was reserved with it. Throws Error.
  void close(const Summary& summary, const Outcome& outcome);

 private:
  struct Content;
  static void save(void* self) noexcept;

  std::filesystem::path file_;
  std::unique_ptr<Content> content_;
  std::string crashed_;  // the text where the program crashes
  std::optional<SavedOnCrash> saved_;
};

}  // namespace cotwin::master
