#pragma once
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "master/run/identity.h"
#include "master/run/master.h"

/// Checkpoint files of a run, from which `cotwin run --resume` continues to the same bits.
namespace cotwin::master {

struct RunCheckpoint {
  Build build;
  std::uint64_t scenario = 0;  // hash_of(Scenario)
  std::string command;         // the options of the run, as JSON
  std::string folder;          // the working directory, base of its relative paths
  RunState state;
  std::uint64_t models = 0;  // hash_of(FileStore)

  static auto fields(auto& c, auto each) { return each(c.build, c.scenario, c.command, c.folder, c.state, c.models); }
};

/// Serialises, with a hash of all bytes.
std::string to_bytes(const RunCheckpoint& checkpoint);
/// Throws Error `place: …` for bytes that are not a checkpoint, are damaged, or are cut short.
RunCheckpoint parse_checkpoint(std::string_view bytes, const std::string& place);
/// Throws Error also if the file cannot be read.
RunCheckpoint load_checkpoint(const std::filesystem::path& file);

/// Writes checkpoints on its own thread. Each file gets a temporary name first and is then renamed.
class CheckpointWriter {
 public:
  /// Until the first checkpoint is due, at most: little is lost of a run that ends early. The next waits are 2, 4, 8 … times as long, up to
  /// Options::every.
  static constexpr std::chrono::duration<double> kFirst{1};
  struct Options {
    std::filesystem::path file;
    std::chrono::duration<double> every{10};
    RunCheckpoint head;                             // all but the state
    std::function<bool(RunState&)> sync_recording;  // Master::sync_recording
    std::function<void()> due;                      // called on this thread when a checkpoint is due
  };
  explicit CheckpointWriter(Options options);
  ~CheckpointWriter();
  CheckpointWriter(const CheckpointWriter&) = delete;
  CheckpointWriter& operator=(const CheckpointWriter&) = delete;

  /// Passes a state to the thread. Call again only after it was written. Blocks at most while the thread takes it.
  void write(RunState state);
  void wait_until_idle();
  /// Waits until the state passed last is written; afterwards no checkpoint becomes due.
  void end();
  /// Why the last checkpoint could not be written; empty if it was.
  std::string failure() const;
  int written() const { return written_; }

 private:
  void run();
  void write_now(RunState state);

  Options options_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<RunState> waiting_;
  bool busy_ = false, ending_ = false;
  std::string failure_;
  std::atomic<int> written_{0};
  std::thread thread_;
};

}  // namespace cotwin::master
