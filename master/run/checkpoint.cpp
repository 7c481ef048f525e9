#include "master/run/checkpoint.h"

#include <algorithm>

#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/fields.h"
#include "models/foundation/support/file.h"

namespace cotwin::master {

namespace {

constexpr std::uint64_t kMagic = 0x0a334e5552575443u;  // the bytes "CTWRUN3\n": the format and its version

}  // namespace

std::string to_bytes(const RunCheckpoint& checkpoint) {
  ByteWriter out;
  Putter(out).put(checkpoint);
  return sealed(kMagic, out.take());
}

RunCheckpoint parse_checkpoint(std::string_view bytes, const std::string& place) {
  ByteReader in = opened(kMagic, bytes, place, "is not a checkpoint of a run, or one of another version of the program");
  RunCheckpoint checkpoint;
  Getter(in).get(checkpoint);
  in.expect_end();
  return checkpoint;
}

RunCheckpoint load_checkpoint(const std::filesystem::path& file) {
  constexpr std::uint64_t kNoLimit = ~std::uint64_t{0};
  return parse_checkpoint(text::read_file(file, "the checkpoint of an interrupted run", kNoLimit), file.string());
}

CheckpointWriter::CheckpointWriter(Options options) : options_(std::move(options)), thread_([this] { run(); }) {}

CheckpointWriter::~CheckpointWriter() { end(); }

void CheckpointWriter::write(RunState state) {
  {
    const std::lock_guard lock(mutex_);
    waiting_ = std::move(state);
  }
  changed_.notify_all();
}

void CheckpointWriter::wait_until_idle() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return !waiting_ && !busy_; });
}

void CheckpointWriter::end() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

std::string CheckpointWriter::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

void CheckpointWriter::run() {
  std::unique_lock lock(mutex_);
  std::chrono::duration<double> wait = std::min(options_.every, kFirst);
  for (;;) {
    const bool early = changed_.wait_for(lock, wait, [this] { return waiting_.has_value() || ending_; });
    if (!early) {
      wait = std::min(options_.every, 2 * wait);
      options_.due();
      changed_.wait(lock, [this] { return waiting_.has_value() || ending_; });
    }
    if (waiting_) {
      RunState state = std::move(*waiting_);
      waiting_.reset();
      busy_ = true;
      lock.unlock();
      std::string failure;
      try {
        write_now(std::move(state));
      } catch (const Error& error) {
        failure = error.what();
      }
      lock.lock();
      busy_ = false;
      failure_ = std::move(failure);
      changed_.notify_all();
    } else {
      return;
    }
  }
}

void CheckpointWriter::write_now(RunState state) {
  if ((state.recording || state.view) && !options_.sync_recording(state))
    return;  // the recording failed and reports that itself
  RunCheckpoint checkpoint = options_.head;
  checkpoint.state = std::move(state);
  write_file(options_.file, to_bytes(checkpoint));
  ++written_;
}

}  // namespace cotwin::master
