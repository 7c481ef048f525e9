#pragma once
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "components/unit/time.h"
#include "master/run/crash.h"
#include "master/run/members.h"

/// Chosen variables over time, as CSV.
namespace cotwin::master {

/// One variable of the recording: all of its elements, or one.
struct Column {
  std::vector<std::string> names;  // one per element
  Signal signal;
};

/// The variables that the scenario wants recorded, in the order of components and declarations; without any wish, every output.
/// Patterns with * or ? take outputs, inputs, states and tunables; exact names take whatever they name. Strings cannot be
/// recorded. Throws Error at its place for a pattern that finds nothing.
std::vector<Column> choose_columns(const Scenario& scenario, std::span<const Member> members);

/// Copies rows into a ring in memory; a thread beside the loop writes them: time first, numbers as the shortest text that reads
/// back to the same bits, whole rows only. They go to <file>.part, which close() renames; a file that is no regular one (a
/// pipe) is written to directly. Whatever was sampled is in the file after close(), and all but the last fifth of a second of
/// it at any time.
class Recorder {
 public:
  /// Where an interrupted recording goes on: the bytes and rows that it keeps.
  struct Kept {
    std::uint64_t bytes = 0;
    std::int64_t rows = 0, dropped = 0;
  };
  struct Options {
    bool may_wait = true;  // with a full ring: wait for the writer, or else drop the row
    std::size_t ring_bytes = std::size_t{16} << 20;
    std::optional<Kept> kept = {};  // cuts the recording that is there and appends to it
  };

  /// Opens the file and writes the heading. Throws Error if that is impossible, and if the recording to go on with is not
  /// there, is shorter than what is kept of it, or has other columns.
  Recorder(std::vector<Column> columns, std::filesystem::path file, Options options);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Allocates nothing. Throws Error after the file could not be written (disk full).
  void sample(Time now);
  /// Writes the rest and closes the file. Throws Error as sample() does. May be called again.
  void close();

  /// Asks for the place in the file where the rows so far end. From the thread that samples, and again only
  /// after sync_to_mark() has returned.
  void mark() {
    marked_bytes_.store(kNoMark, std::memory_order_relaxed);
    mark_.store(head_.load(std::memory_order_relaxed), std::memory_order_release);
  }
  /// From another thread, before close(): waits until the rows up to the last mark() are on the disk and returns the bytes up
  /// to there. Nothing if they cannot be written.
  std::optional<std::uint64_t> sync_to_mark() const;

  const std::filesystem::path& file() const { return file_; }
  std::size_t columns() const { return width_; }
  std::int64_t rows() const { return sampled_; }
  std::int64_t dropped() const { return dropped_; }

 private:
  class Writer;
  static constexpr std::uint64_t kNoMark = ~std::uint64_t{0};

  /// Where a value is and where in the row it goes.
  template <class T>
  struct Source {
    const T* from;
    std::size_t column;
  };

  template <class T>
  void add(std::span<const T> values, std::vector<Source<T>>& sources);
  void copy_row(Time now, double* row) const;
  int open_file(const std::string& heading, const std::optional<Kept>& kept);
  int open_again(const std::string& heading, const Kept& kept);
  [[noreturn]] void tell_failure();
  static void save(void* self) noexcept;

  std::vector<Source<double>> reals_;
  std::vector<Source<std::int32_t>> integers_;
  std::vector<Source<bool>> booleans_;
  std::filesystem::path file_, written_to_;
  bool may_wait_;
  std::size_t width_ = 0;     // values per row, without the time
  std::size_t capacity_ = 0;  // rows in the ring, a power of two
  std::unique_ptr<double[]> ring_;
  std::int64_t sampled_ = 0, dropped_ = 0;

  alignas(64) std::atomic<std::uint64_t> head_{0};  // rows put in
  alignas(64) std::atomic<std::uint64_t> tail_{0};  // rows taken out
  std::atomic<bool> closing_{false};
  std::atomic<int> failure_{0};                       // errno of a write that failed
  std::atomic<std::uint64_t> mark_{kNoMark};          // rows up to which marked_bytes_ is asked for
  std::atomic<std::uint64_t> marked_bytes_{kNoMark};  // written by the writer
  std::uint64_t room_until_ = 0;                      // head up to which the ring is known to have room
  std::unique_ptr<Writer> writer_;
  std::thread thread_;
  std::atomic<bool> ended_{false};  // the writer has written everything
  std::optional<SavedOnCrash> saved_;
};

}  // namespace cotwin::master
