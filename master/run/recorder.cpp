#include "master/run/recorder.h"

#define XXH_INLINE_ALL
#include <fcntl.h>
#include <pthread.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <xxhash.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

using namespace std::chrono_literals;

constexpr auto kIdle = 2ms;         // sleep of the writer while the ring is empty: waking it would cost the loop a system call
constexpr auto kPackedIdle = 20ms;  // the same for the few rows for pages
constexpr auto kFlush = 20ms;       // largest age of a row in memory
constexpr std::size_t kBuffer = std::size_t{1} << 18;  // bytes of text per write
constexpr std::size_t kRoom = 28;                      // bytes of text for a number
constexpr const char* kOtherBytes =
    "what it had at the checkpoint was changed or damaged, expected the file as the interrupted run left it";

/// RFC 4180.
std::string csv_field(const std::string& name) {
  if (name.find_first_of(",\"\n\r") == std::string::npos) return name;
  std::string field = "\"";
  for (const char c : name) field += c == '"' ? std::string("\"\"") : std::string(1, c);
  return field + '"';
}

/// Writes seconds with at most nine digits after the point: exact, unlike n · 1e-9.
char* write_time(char* to, std::int64_t ns) {
  if (ns < 0) *to++ = '-';
  const auto magnitude = static_cast<std::uint64_t>(ns < 0 ? -ns : ns);
  to = std::to_chars(to, to + 24, magnitude / 1'000'000'000).ptr;
  std::uint64_t fraction = magnitude % 1'000'000'000;
  if (fraction == 0) return to;
  *to++ = '.';
  int digits = 9;
  for (; fraction % 10 == 0; fraction /= 10) --digits;
  for (int i = digits - 1; i >= 0; --i, fraction /= 10) to[i] = static_cast<char>('0' + fraction % 10);
  return to + digits;
}

}  // namespace

/// XXH3 of the bytes so far.
class Recorder::Hash {
 public:
  Hash() { XXH3_64bits_reset(&state_); }
  void add(std::string_view bytes) { XXH3_64bits_update(&state_, bytes.data(), bytes.size()); }
  std::uint64_t value() const { return XXH3_64bits_digest(&state_); }
  /// The first bytes of a file. False: it has fewer, or cannot be read.
  bool add_start(int descriptor, std::uint64_t bytes) {
    std::vector<char> part(kBuffer);
    for (std::uint64_t done = 0; done < bytes;) {
      const std::size_t wanted = std::min<std::uint64_t>(part.size(), bytes - done);
      const ssize_t n = ::pread(descriptor, part.data(), wanted, static_cast<off_t>(done));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return false;
      add({part.data(), static_cast<std::size_t>(n)});
      done += static_cast<std::uint64_t>(n);
    }
    return true;
  }

 private:
  XXH3_state_t state_;
};

/// Converts rows to text and writes it, on its own thread.
class Recorder::Writer {
 public:
  /// `written`, `hash`: present length of the file in bytes, and of what it has.
  Writer(Recorder& recorder, int descriptor, std::uint64_t written, const Hash& hash, const std::vector<bool>& integral)
      : recorder_(recorder),
        descriptor_(descriptor),
        written_(written),
        hash_(hash),
        integral_(integral),
        known_(std::bit_ceil(std::clamp<std::size_t>(4 * recorder.width_, 256, 65536))),
        known_shift_(64 - std::countr_zero(known_.size())),
        buffer_(kBuffer + 2 * kRoom + 32 * recorder.width_) {}
  ~Writer() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }

  void run() {
    using Steady = std::chrono::steady_clock;
    auto flushed = Steady::now();
    for (;;) {
      const bool closing = recorder_.closing_.load(std::memory_order_acquire);  // read before head_, so that no row is missed
      const std::uint64_t head = recorder_.head_.load(std::memory_order_acquire);
      std::uint64_t tail = recorder_.tail_.load(std::memory_order_relaxed);
      const std::uint64_t mark = recorder_.mark_.load(std::memory_order_acquire);
      if (tail == mark) {
        flush();
        recorder_.mark_.store(kNoMark, std::memory_order_relaxed);
        recorder_.marked_hash_.store(hash_.value(), std::memory_order_relaxed);
        recorder_.marked_bytes_.store(written_, std::memory_order_release);
        continue;
      }
      if (tail == head) {
        if (closing) break;
        if (Steady::now() - flushed >= kFlush) {
          flush();
          flushed = Steady::now();
        }
        std::unique_lock lock(recorder_.idle_mutex_);
        recorder_.idle_.wait_for(lock, recorder_.packed_ ? kPackedIdle : kIdle, [this] { return recorder_.closing_.load(); });
        continue;
      }
      // Releases room in portions, so that a waiting loop continues while this thread writes.
      std::uint64_t until = std::min(head, tail + std::max<std::uint64_t>(1, recorder_.capacity_ / 8));
      if (mark > tail) until = std::min(until, mark);
      for (; tail < until; ++tail)
        write_row(recorder_.ring_.get() + (tail & (recorder_.capacity_ - 1)) * (recorder_.width_ + 1));
      recorder_.tail_.store(tail, std::memory_order_release);
      recorder_.tail_.notify_one();
      if (Steady::now() - flushed >= kFlush) {
        flush();
        flushed = Steady::now();
      }
    }
    flush();
    recorder_.ended_.store(true, std::memory_order_release);
  }

  void write_text(std::string_view text) {
    for (std::size_t done = 0; done < text.size();) {
      const ssize_t n = ::write(descriptor_, text.data() + done, text.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) {
        const int reason = n < 0 ? errno : EIO;
        drop_partial_row(text.substr(0, done));
        recorder_.in_file_ += recorder_.packed_
                                  ? static_cast<std::int64_t>(done / recorder_.packed_row())
                                  : std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(done), '\n');
        recorder_.failure_.store(reason, std::memory_order_release);
        return;
      }
      done += static_cast<std::size_t>(n);
    }
    written_ += text.size();
    hash_.add(text);
    recorder_.in_file_ += in_buffer_;
    in_buffer_ = 0;
  }

  void close() {
    const int descriptor = descriptor_;
    descriptor_ = -1;
    if (::close(descriptor) != 0 && recorder_.failure_ == 0)
      recorder_.failure_ = errno;  // network file systems report errors here
  }
  /// On any thread, before close().
  bool sync() const { return ::fdatasync(descriptor_) == 0 || errno == EINVAL || errno == ENOTSUP; }

 private:
  /// A value and its text.
  struct Known {
    std::uint64_t bits = 0x7ff8dead0000beefu;  // a NaN that no computation yields
    std::uint32_t length = 0;
    char text[kRoom];
  };

  void write_packed(const double* row) {
    char* to = buffer_.data() + used_;
    std::memcpy(to, row, sizeof(std::int64_t));
    to += sizeof(std::int64_t);
    for (std::size_t i = 1; i <= recorder_.width_; ++i, to += sizeof(float)) {
      const auto value = static_cast<float>(row[i]);
      std::memcpy(to, &value, sizeof value);
    }
    used_ += recorder_.packed_row();
  }

  void write_row(const double* row) {
    if (recorder_.packed_) {
      write_packed(row);
    } else {
      write_text_row(row);
    }
    ++in_buffer_;
    if (used_ >= kBuffer) flush();
  }

  void write_text_row(const double* row) {
    char* to = write_time(buffer_.data() + used_, std::bit_cast<std::int64_t>(row[0]));
    for (std::size_t i = 0; i < integral_.size(); ++i) {
      *to++ = ',';
      const double value = row[i + 1];
      to = integral_[i] ? std::to_chars(to, to + kRoom, static_cast<std::int32_t>(value)).ptr : write_real(to, value);
    }
    *to++ = '\n';
    used_ = static_cast<std::size_t>(to - buffer_.data());
  }

  char* write_real(char* to, double value) {
    const auto bits = std::bit_cast<std::uint64_t>(value);
    Known& known = known_[(bits * 0x9e3779b97f4a7c15u) >> known_shift_];
    if (bits == known.bits) {
      std::memcpy(to, known.text, sizeof known.text);  // a fixed length is faster; the next text overwrites the rest
      return to + known.length;
    }
    char* const end = std::to_chars(to, to + kRoom, value).ptr;
    known.bits = bits;
    known.length = static_cast<std::uint32_t>(end - to);
    std::memcpy(known.text, to, sizeof known.text);
    return end;
  }

  /// Cuts a row that is incomplete because the disk is full. `last`: the written part of the last text.
  void drop_partial_row(std::string_view last) {
    const std::size_t row_end = last.rfind('\n');
    const std::size_t whole = recorder_.packed_                   ? last.size() - last.size() % recorder_.packed_row()
                              : row_end == std::string_view::npos ? 0
                                                                  : row_end + 1;
    if (::ftruncate(descriptor_, static_cast<off_t>(written_ + whole)) != 0) return;  // a pipe cannot be cut
  }

  void flush() {
    if (recorder_.failure_.load(std::memory_order_relaxed) == 0) write_text({buffer_.data(), used_});
    used_ = 0;
  }

  Recorder& recorder_;
  int descriptor_;
  std::uint64_t written_;  // bytes in the file, whole rows
  Hash hash_;              // of them
  std::vector<bool> integral_;
  std::vector<Known> known_;  // by hash: signals are often constant, and an input repeats an output
  int known_shift_;
  std::vector<char> buffer_;
  std::size_t used_ = 0;
  std::int64_t in_buffer_ = 0;  // rows
};

Recorder::Recorder(std::vector<Column> columns, std::filesystem::path file, Options options)
    : file_(std::move(file)), may_wait_(options.may_wait), packed_(!options.heading.empty()), holds_(options.holds) {
  std::string heading = "time";
  std::vector<bool> integral;
  for (const Column& column : columns) {
    const Signal& s = column.signal;
    const Variable& v = *s.variable;
    const auto part = [&s](auto all) { return all.subspan(s.first, s.count); };
    switch (v.kind()) {
      case Kind::kReal:
        add<double>(part(v.reals()), reals_);
        break;
      case Kind::kInteger:
        add<std::int32_t>(part(v.integers()), integers_);
        break;
      case Kind::kBoolean:
        add<bool>(part(v.booleans()), booleans_);
        break;
      case Kind::kString:
        throw Error("'" + s.name + "' is a String, which cannot be recorded");
    }
    integral.insert(integral.end(), s.count, v.kind() != Kind::kReal);
    const Elements elements = s.of_elements();
    for (std::size_t i = 0; i < s.count; ++i) {
      const std::string& name = column.names[i];
      const bool named = options.joint_names && !elements.names.empty() && name.ends_with(']');
      heading += "," + csv_field(named ? name.substr(0, name.rfind('[') + 1) + elements.names[i] + "]" : name);
    }
  }
  heading = packed_ ? options.heading : heading + '\n';
  const std::size_t rows = std::max(options.least_rows, options.ring_bytes / sizeof(double) / (width_ + 1));
  capacity_ = options.holds ? std::bit_ceil(rows) : std::bit_floor(rows);
  ring_ = std::make_unique<double[]>(capacity_ * (width_ + 1));  // zeroed, so that the loop causes no page faults
  room_until_ = capacity_;

  Hash hash;
  const int descriptor = open_file(heading, options.kept, hash);
  if (options.kept) {
    sampled_ = in_file_ = options.kept->rows;
    dropped_ = options.kept->dropped;
  }
  writer_ = std::make_unique<Writer>(*this, descriptor, options.kept ? options.kept->bytes : 0, hash, integral);
  if (!options.kept) writer_->write_text(heading);
  if (failure_ != 0) throw_failure();
  const EndingSignalsBlocked blocked;
  thread_ = std::thread([this] { writer_->run(); });
  saved_.emplace(save, this, file_.string());
}

int Recorder::open_file(const std::string& heading, std::optional<Kept>& kept, Hash& hash) {
  make_folder(file_.parent_path());
  struct stat status {};
  const bool regular = ::stat(file_.c_str(), &status) != 0 || S_ISREG(status.st_mode);
  written_to_ = file_;
  if (regular) written_to_ += ".part";
  if (kept) {
    const int there = packed_ ? reopen_packed(heading, *kept, hash) : reopen_file(heading, *kept, hash);
    if (there >= 0) return there;
    kept.reset();
  }
  const int descriptor = ::open(written_to_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor < 0) throw Error(file_.string(), "cannot be written: " + system_reason(errno));
  return descriptor;
}

/// The recording is <file>.part after a crash, and <file> after an orderly end.
int Recorder::reopen_file(const std::string& heading, const Kept& kept, Hash& hash) {
  const auto refuse = [&](const std::string& what) { throw Error(file_.string(), "cannot be resumed: " + what); };
  int descriptor = ::open(written_to_.c_str(), O_RDWR | O_CLOEXEC);
  const bool complete = descriptor < 0 && errno == ENOENT;
  if (complete) descriptor = ::open(file_.c_str(), O_RDWR | O_CLOEXEC);
  if (descriptor < 0) refuse(system_reason(errno));
  try {
    struct stat status {};
    if (::fstat(descriptor, &status) != 0) refuse(system_reason(errno));
    const auto size = static_cast<std::uint64_t>(status.st_size);
    if (!S_ISREG(status.st_mode) || size < kept.bytes || kept.bytes < heading.size())
      refuse("it has " + std::to_string(size) + " bytes, the checkpoint was made after " + std::to_string(kept.bytes));
    std::string there(heading.size(), '\0');
    char last = 0;
    const bool read = ::pread(descriptor, there.data(), there.size(), 0) == static_cast<ssize_t>(there.size()) &&
                      ::pread(descriptor, &last, 1, static_cast<off_t>(kept.bytes) - 1) == 1;
    if (!read || there != heading) refuse("its columns are not those of the run");
    if (last != '\n') refuse("no row ends at byte " + std::to_string(kept.bytes));
    if (!hash.add_start(descriptor, kept.bytes) || hash.value() != kept.hash) refuse(kOtherBytes);
    if (complete && ::rename(file_.c_str(), written_to_.c_str()) != 0) refuse(system_reason(errno));
    const auto end = static_cast<off_t>(kept.bytes);
    if (::ftruncate(descriptor, end) != 0 || ::lseek(descriptor, end, SEEK_SET) != end) refuse(system_reason(errno));
  } catch (...) {
    ::close(descriptor);
    throw;
  }
  return descriptor;
}

/// Keeps the rows of a file of view_heading() that are there, at most kept.rows, and sets `kept`; -1: the file cannot be continued.
int Recorder::reopen_packed(const std::string& heading, Kept& kept, Hash& hash) {
  int descriptor = ::open(written_to_.c_str(), O_RDWR | O_CLOEXEC);
  const bool complete = descriptor < 0;
  if (complete) descriptor = ::open(file_.c_str(), O_RDWR | O_CLOEXEC);
  if (descriptor < 0) return -1;
  std::string there(heading.size(), '\0');
  struct stat status {};
  if (::fstat(descriptor, &status) == 0 &&
      ::pread(descriptor, there.data(), there.size(), 0) == static_cast<ssize_t>(there.size()) && there == heading) {
    const std::size_t rows = (static_cast<std::size_t>(status.st_size) - heading.size()) / packed_row();
    const std::uint64_t all = kept.bytes;
    kept.rows = std::min(kept.rows, static_cast<std::int64_t>(rows));
    kept.bytes = heading.size() + static_cast<std::size_t>(kept.rows) * packed_row();
    const bool read = hash.add_start(descriptor, kept.bytes);
    if (kept.bytes == all && (!read || hash.value() != kept.hash)) {
      ::close(descriptor);
      throw Error(file_.string(), std::string("cannot be resumed: ") + kOtherBytes);
    }
    const auto end = static_cast<off_t>(kept.bytes);
    if ((!complete || ::rename(file_.c_str(), written_to_.c_str()) == 0) && ::ftruncate(descriptor, end) == 0 &&
        ::lseek(descriptor, end, SEEK_SET) == end)
      return descriptor;
    hash = Hash();
  }
  ::close(descriptor);
  return -1;
}

Recorder::~Recorder() {
  saved_.reset();
  if (!thread_.joinable()) return;
  end_writing();
}

void Recorder::sample(Time now) {
  if (next_ == room_until_) {
    std::uint64_t tail = tail_.load(std::memory_order_acquire);
    if (tail + capacity_ == next_ && tail == head_.load(std::memory_order_relaxed)) commit();  // only rows that are held back
    while (tail + capacity_ == next_) {
      if (!may_wait_) {
        ++dropped_;
        return;
      }
      tail_.wait(tail, std::memory_order_acquire);
      tail = tail_.load(std::memory_order_acquire);
    }
    room_until_ = tail + capacity_;
  }
  if (failure_.load(std::memory_order_relaxed) != 0) throw_failure();
  copy_row(now, ring_.get() + (next_ & (capacity_ - 1)) * (width_ + 1));
  ++next_;
  ++sampled_;
  if (!holds_) commit();
}

void Recorder::rewind() {
  const std::uint64_t head = head_.load(std::memory_order_relaxed);
  sampled_ -= static_cast<std::int64_t>(next_ - head);
  next_ = head;
}

template <class T>
void Recorder::add(std::span<const T> values, std::vector<Source<T>>& sources) {
  for (const T& value : values) sources.push_back({&value, width_++});
}

void Recorder::copy_row(Time now, double* row) const {
  *row++ = std::bit_cast<double>(now.ns);
  for (const auto& [from, column] : reals_) row[column] = *from;
  for (const auto& [from, column] : integers_) row[column] = *from;
  for (const auto& [from, column] : booleans_) row[column] = *from ? 1 : 0;
}

void Recorder::end_writing() {
  commit();
  {
    const std::lock_guard lock(idle_mutex_);
    closing_ = true;
  }
  idle_.notify_one();
  thread_.join();
}

void Recorder::close() {
  saved_.reset();
  if (!thread_.joinable()) return;
  end_writing();
  writer_->close();
  if (written_to_ != file_ && ::rename(written_to_.c_str(), file_.c_str()) != 0 && failure_ == 0) failure_ = errno;
  if (failure_ != 0) throw_failure();
}

/// Called in a signal handler. The writing thread continues and gets 10 s.
void Recorder::save(void* self) noexcept {
  auto& recorder = *static_cast<Recorder*>(self);
  if (pthread_equal(pthread_self(), recorder.thread_.native_handle()) != 0) return;
  recorder.commit();
  recorder.closing_.store(true, std::memory_order_release);
  constexpr timespec kNap{0, 2'000'000};
  for (int i = 0; i < 5'000 && !recorder.ended_.load(std::memory_order_acquire); ++i) nanosleep(&kNap, nullptr);
  if (recorder.ended_ && recorder.written_to_ != recorder.file_)
    static_cast<void>(std::rename(recorder.written_to_.c_str(), recorder.file_.c_str()));
}

bool Recorder::sync_to_mark(Kept& kept) const {
  for (;;) {
    if (failure_.load(std::memory_order_acquire) != 0) return false;
    kept.bytes = marked_bytes_.load(std::memory_order_acquire);
    kept.hash = marked_hash_.load(std::memory_order_relaxed);
    if (kept.bytes != kNoMark) return writer_->sync();
    std::this_thread::sleep_for(kIdle);
  }
}

void Recorder::throw_failure() {
  throw Error(file_.string(), "cannot be written: " + system_reason(failure_) + "; the recording is incomplete");
}

}  // namespace cotwin::master
