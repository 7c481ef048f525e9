#include "master/run/checkpoint.h"

#include <algorithm>

#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"

namespace cotwin::master {

namespace {

constexpr std::string_view kMagic = "CTWRUN2\n";

void write(ByteWriter& out, const std::optional<Recorder::Kept>& given) {
  const Recorder::Kept kept = given.value_or(Recorder::Kept{});
  out.value(static_cast<std::uint8_t>(given.has_value()));
  out.value(kept.bytes);
  out.value(kept.rows);
  out.value(kept.dropped);
  out.value(kept.hash);
}

std::optional<Recorder::Kept> read_kept(ByteReader& in) {
  const auto given = in.value<std::uint8_t>();
  if (given > 1) in.fail("is damaged");
  Recorder::Kept kept;
  kept.bytes = in.value<std::uint64_t>();
  kept.rows = in.value<std::int64_t>();
  kept.dropped = in.value<std::int64_t>();
  kept.hash = in.value<std::uint64_t>();
  return given == 1 ? std::optional(kept) : std::nullopt;
}

}  // namespace

std::string to_bytes(const RunCheckpoint& c) {
  ByteWriter out;
  out.text(c.build.version);
  out.value(c.build.file);
  out.text(c.build.cpu);
  out.value(c.scenario);
  out.text(c.command);
  out.text(c.folder);
  out.value(c.state.beginning);
  write(out, c.state.recording);
  write(out, c.state.view);
  out.value(c.state.wall_seconds);
  out.text(c.state.bytes);
  ByteWriter head;
  head.value(cotwin::hash_of(out.bytes()));
  return std::string(kMagic) + head.bytes() + out.bytes();
}

RunCheckpoint parse_checkpoint(std::string_view bytes, const std::string& place) {
  if (!bytes.starts_with(kMagic)) throw Error(place, "is not a checkpoint of a run, or one of another version of the program");
  bytes.remove_prefix(kMagic.size());
  ByteReader in(as_bytes(bytes), place);
  const auto hash = in.value<std::uint64_t>();
  if (cotwin::hash_of(bytes.substr(sizeof hash)) != hash) in.fail("is damaged or cut short");
  RunCheckpoint c;
  c.build.version = in.text();
  c.build.file = in.value<std::uint64_t>();
  c.build.cpu = in.text();
  c.scenario = in.value<std::uint64_t>();
  c.command = in.text();
  c.folder = in.text();
  c.state.beginning = in.value<std::uint64_t>();
  c.state.recording = read_kept(in);
  c.state.view = read_kept(in);
  c.state.wall_seconds = in.value<double>();
  c.state.bytes = in.text();
  in.expect_end();
  return c;
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
