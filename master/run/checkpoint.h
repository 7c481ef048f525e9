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

/// What a run leaves on the disk now and then, so that `cotwin run --resume` goes on from there to the same bits.
namespace cotwin::master {

struct RunCheckpoint {
  Build build;
  std::uint64_t scenario = 0;  // hash_of(Scenario)
  std::string command;         // the options of the run, as JSON
  std::string folder;          // the working directory, from which its relative paths start
  RunState state;
};

/// Bytes with a hash over all of them.
std::string to_bytes(const RunCheckpoint& checkpoint);
/// Throws Error `place: …` for bytes that are no checkpoint, damaged, or cut short.
RunCheckpoint parse_checkpoint(std::string_view bytes, const std::string& place);
/// Throws Error also where there is none.
RunCheckpoint load_checkpoint(const std::filesystem::path& file);

/// Writes checkpoints on a thread of its own, each to a temporary name, then renamed.
class CheckpointWriter {
 public:
  struct Options {
    std::filesystem::path file;
    std::chrono::duration<double> every{10};
    RunCheckpoint head;                                            // all but the state
    std::function<std::optional<std::uint64_t>()> sync_recording;  // Master::sync_recording
    std::function<void()> due;                                     // called on the thread when a checkpoint should be taken
  };
  explicit CheckpointWriter(Options options);
  ~CheckpointWriter();
  CheckpointWriter(const CheckpointWriter&) = delete;
  CheckpointWriter& operator=(const CheckpointWriter&) = delete;

  /// Hands a state over; not again before it was written. Never blocks for longer than the thread needs to take it.
  void write(RunState state);
  void wait_until_idle();
  /// Waits until what was handed over is written; no further one will be due.
  void end();
  /// Why the last one could not be written; empty if it could.
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
