#pragma once
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "components/unit/time.h"
#include "master/run/columns.h"
#include "master/run/crash.h"

/// Records selected variables over time as CSV.
namespace cotwin::master {

/// Copies rows into a ring in memory; another thread writes them: time first, numbers as the shortest text that reads back to
/// the same bits (CSV) or as float32 (Options::heading), whole rows only. The file is <file>.part until close() renames it; a file that is not regular (a pipe) is
/// written to directly. All rows are in the file after close(), and at any time all but those of the last 0.2 s.
class Recorder {
 public:
  /// How much of an interrupted recording is kept on resume.
  struct Kept {
    std::uint64_t bytes = 0;
    std::int64_t rows = 0, dropped = 0;
    std::uint64_t hash = 0;  // of these bytes, XXH3

    static auto fields(auto& k, auto each) { return each(k.bytes, k.rows, k.dropped, k.hash); }
  };
  struct Options {
    bool may_wait = true;  // if the ring is full: wait for the writer; false: drop the row
    std::size_t ring_bytes = std::size_t{16} << 20;
    std::size_t least_rows = 64;  // that the ring has room for
    bool holds =
        false;  // rows are held back until commit(), so that rewind() can drop them; but where the ring is full, and in a crash
    std::optional<Kept> kept = {};  // cut the existing recording and append to it
    std::string heading = {};  // of a file of view_heading(); empty: CSV. To resume one, what it has is kept, without an error
    bool joint_names = false;  // the heading has "drive.q[elbow]" in place of "drive.q[2]"
  };

  /// Opens the file and writes the heading. Throws Error if that fails, or if the recording to resume is missing, shorter than
  /// `kept`, or has other columns or other bytes.
  Recorder(std::vector<Column> columns, std::filesystem::path file, Options options);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Allocates nothing. Throws Error if an earlier row could not be written (disk full).
  void sample(Time now);
  /// Lets the rows so far be written.
  void commit() { head_.store(next_, std::memory_order_release); }
  /// Drops the rows since the last commit().
  void rewind();
  /// Writes the remaining rows and closes the file. Throws Error as sample(). May be called repeatedly.
  void close();

  /// Requests the position in the file where the rows so far end. Call on the sampling thread, and again only after
  /// sync_to_mark() has returned.
  void mark() {
    commit();
    marked_bytes_.store(kNoMark, std::memory_order_relaxed);
    mark_.store(head_.load(std::memory_order_relaxed), std::memory_order_release);
  }
  /// Call on another thread, before close(). Waits until the rows up to the last mark() are on the disk and tells their length
  /// in bytes and their hash. False: they cannot be written.
  bool sync_to_mark(Kept& kept) const;

  const std::filesystem::path& file() const { return file_; }
  std::size_t columns() const { return width_; }
  /// Those of the file once a write has failed.
  std::int64_t rows() const { return failure_.load(std::memory_order_acquire) == 0 ? sampled_ : in_file_.load(); }
  std::int64_t dropped() const { return dropped_; }

 private:
  class Hash;
  class Writer;
  static constexpr std::uint64_t kNoMark = ~std::uint64_t{0};

  /// Address of a value and its place in the row.
  template <class T>
  struct Source {
    const T* from;
    std::size_t column;
  };

  template <class T>
  void add(std::span<const T> values, std::vector<Source<T>>& sources);
  void copy_row(Time now, double* row) const;
  int open_file(const std::string& heading, std::optional<Kept>& kept, Hash& hash);
  int reopen_file(const std::string& heading, const Kept& kept, Hash& hash);
  int reopen_packed(const std::string& heading, Kept& kept, Hash& hash);
  std::size_t packed_row() const { return sizeof(std::int64_t) + width_ * sizeof(float); }  // bytes
  [[noreturn]] void throw_failure();
  void end_writing();
  static void save(void* self) noexcept;

  std::vector<Source<double>> reals_;
  std::vector<Source<std::int32_t>> integers_;
  std::vector<Source<bool>> booleans_;
  std::filesystem::path file_, written_to_;
  bool may_wait_;
  std::size_t width_ = 0;     // values per row, without the time
  bool packed_ = false;       // not CSV
  std::size_t capacity_ = 0;  // rows in the ring, a power of two
  std::unique_ptr<double[]> ring_;
  std::int64_t sampled_ = 0, dropped_ = 0;

  alignas(64) std::atomic<std::uint64_t> head_{0};  // rows put in
  alignas(64) std::atomic<std::uint64_t> tail_{0};  // rows taken out
  std::atomic<bool> closing_{false};
  std::mutex idle_mutex_;
  std::condition_variable idle_;                      // of the writer: ends its sleep when closing_ is set
  std::atomic<std::int64_t> in_file_{0};              // whole rows that are written
  std::atomic<int> failure_{0};                       // errno of a write that failed
  std::atomic<std::uint64_t> mark_{kNoMark};          // rows for which marked_bytes_ is requested
  std::atomic<std::uint64_t> marked_bytes_{kNoMark};  // written by the writer
  std::atomic<std::uint64_t> marked_hash_{0};         // of these bytes
  bool holds_;
  std::uint64_t next_ = 0;        // rows sampled: head_, and those that are held back
  std::uint64_t room_until_ = 0;  // value of next_ up to which the ring has room
  std::unique_ptr<Writer> writer_;
  std::thread thread_;
  std::atomic<bool> ended_{false};  // the writer has written everything
  std::optional<SavedOnCrash> saved_;
};

}  // namespace cotwin::master
