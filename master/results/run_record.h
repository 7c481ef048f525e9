#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "master/results/summary.h"
#include "master/run/crash.h"
#include "master/run/identity.h"

/// run.json: the origin of the results, and whether they are complete.
namespace cotwin::master {

class RunRecord {
 public:
  struct Given {
    std::filesystem::path file;  // run.json
    Build build;
    std::uint64_t scenario = 0;                  // hash_of(Scenario)
    std::uint64_t files = 0;                     // the same of the scenario as its file has it, without options of the command
    std::vector<std::string> set;                // --set
    std::vector<std::string> events, waypoints;  // --event, --waypoints
    std::vector<std::string> attach, detach;     // --attach, --detach
    std::filesystem::path results;               // signals.csv; empty if nothing is recorded
    bool joint_names = false;                    // in the heading of signals.csv
    std::optional<double> resumed_at;            // s
  };
  /// Writes the file for the initialised master, with the state "running". Throws Error if it cannot be written.
  RunRecord(Given given, const Master& master);
  ~RunRecord();
  RunRecord(const RunRecord&) = delete;
  RunRecord& operator=(const RunRecord&) = delete;

  /// Writes the final state "complete", "stopped" or "failed" with reason, time and figures. On a full disk the earlier text is
  /// overwritten, in space that was reserved for this. Throws Error if that fails too.
  void close(const Summary& summary, const Outcome& outcome);

 private:
  struct Content;
  static void save(void* self) noexcept;

  std::filesystem::path file_;
  std::unique_ptr<Content> content_;
  std::string crashed_;  // the text to write if the program crashes
  std::optional<SavedOnCrash> saved_;
};

}  // namespace cotwin::master
