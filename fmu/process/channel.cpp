#include "fmu/process/channel.h"

#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <new>
#include <system_error>
#include <type_traits>
#include <utility>
#include <variant>

#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace {

constexpr std::size_t kTextBytes = 256u << 20;  // reserved address space; a page uses memory only once it is written

/// Calls `call` with the bytes of the values, unless they are strings, and with those of the rates.
template <class Call>
void each_number(const Variable& v, Call call) {
  std::visit(
      [&](auto values) {
        if constexpr (!std::is_same_v<typename decltype(values)::value_type, std::string>)
          call(values.data(), values.size_bytes());
      },
      v.storage);
  call(v.rate.data(), v.rate.size_bytes());
}

std::size_t bytes_of(const Variables& variables) {
  std::size_t bytes = 0;
  for (const Variable& v : variables) each_number(v, [&](const void*, std::size_t n) { bytes += n; });
  return (bytes + 63) / 64 * 64;
}

std::string system_error() { return std::generic_category().message(errno); }

}  // namespace

void post(std::atomic<std::uint32_t>& word, std::uint32_t value, std::atomic<std::uint32_t>& sleeps) {
  word.store(value, std::memory_order_seq_cst);
  if (sleeps.load(std::memory_order_seq_cst) != 0) syscall(SYS_futex, &word, FUTEX_WAKE, 1, nullptr, nullptr, 0);
}

bool SpinWait::wait_for(const std::atomic<std::uint32_t>& word, std::uint32_t wanted, bool may_spin) {
  if (++calls_ % kRetry == 0) reads_ = std::max(reads_, kMost / 4);
  const std::uint32_t reads = may_spin ? reads_ : 0;
  for (std::uint32_t i = 0; i <= reads; ++i) {
    if (word.load(std::memory_order_acquire) == wanted) {
      reads_ = std::min(kMost, 2 * reads_ + 16);
      return true;
    }
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#endif
  }
  reads_ /= 2;
  return false;
}

bool sleep_for(std::atomic<std::uint32_t>& word, std::uint32_t wanted, std::atomic<std::uint32_t>& sleeps,
               std::chrono::nanoseconds at_most) {
  timespec time{};
  time.tv_sec = static_cast<time_t>(at_most.count() / 1'000'000'000);
  time.tv_nsec = static_cast<long>(at_most.count() % 1'000'000'000);
  sleeps.store(1, std::memory_order_seq_cst);
  const std::uint32_t seen = word.load(std::memory_order_seq_cst);
  if (seen != wanted) syscall(SYS_futex, &word, FUTEX_WAIT, seen, &time, nullptr, 0);
  sleeps.store(0, std::memory_order_relaxed);
  return word.load(std::memory_order_acquire) == wanted;
}

Channel::Channel(const Variables& variables) {
  const std::size_t numbers = bytes_of(variables);
  bytes_ = sizeof(ChannelHeader) + numbers + kTextBytes;
  descriptor_ = memfd_create("cotwin-fmu", MFD_CLOEXEC);
  if (descriptor_ < 0) throw Error("cannot create shared memory for the FMU's process: " + system_error());
  void* memory = MAP_FAILED;
  if (ftruncate(descriptor_, static_cast<off_t>(bytes_)) == 0)
    memory = mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_NORESERVE, descriptor_, 0);
  if (memory == MAP_FAILED) {
    const std::string why = system_error();
    close(descriptor_);
    throw Error("cannot create shared memory for the FMU's process: " + why);
  }
  header_ = new (memory) ChannelHeader;
  header_->number_bytes = numbers;
  values_ = static_cast<char*>(memory) + sizeof(ChannelHeader);
  texts_ = values_ + numbers;
}

Channel Channel::open(int descriptor) {
  Channel channel;
  struct stat file {};
  if (fstat(descriptor, &file) != 0 || file.st_size < static_cast<off_t>(sizeof(ChannelHeader) + kTextBytes))
    throw Error("file descriptor " + std::to_string(descriptor) + " is not shared memory of cotwin");
  const auto bytes = static_cast<std::size_t>(file.st_size);
  void* memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_NORESERVE, descriptor, 0);
  if (memory == MAP_FAILED) throw Error("cannot map the shared memory: " + system_error());
  channel.bytes_ = bytes;
  channel.header_ = static_cast<ChannelHeader*>(memory);
  channel.values_ = static_cast<char*>(memory) + sizeof(ChannelHeader);
  if (channel.header_->version != kChannelVersion ||
      channel.header_->number_bytes != bytes - sizeof(ChannelHeader) - kTextBytes)
    throw Error("was started by a program of another version, expected the same build");
  channel.texts_ = channel.values_ + channel.header_->number_bytes;
  return channel;
}

Channel::~Channel() {
  if (header_ != nullptr) munmap(header_, bytes_);
  if (descriptor_ >= 0) close(descriptor_);
}

Channel::Channel(Channel&& other) noexcept
    : header_(std::exchange(other.header_, nullptr)),
      values_(other.values_),
      texts_(other.texts_),
      bytes_(other.bytes_),
      descriptor_(std::exchange(other.descriptor_, -1)) {}

void Channel::check_layout(const Variables& variables) const {
  if (bytes_of(variables) != header_->number_bytes)
    throw Error("the variables differ from those of the program that started this process");
}

void Channel::write(const Variables& variables, bool (*wanted)(Role), std::size_t& text) {
  char* out = values_;
  for (const Variable& v : variables) {
    const bool skip = !wanted(v.role);
    each_number(v, [&](const void* at, std::size_t n) {
      if (!skip && n > 0) std::memcpy(out, at, n);
      out += n;
    });
    if (v.kind() == Kind::kString && !skip) {
      for (const std::string& s : v.strings()) append(s, text);
    }
  }
  header_->text_bytes = text;
}

void Channel::read(const Variables& variables, bool (*wanted)(Role), std::size_t& text) const {
  const char* in = values_;
  for (const Variable& v : variables) {
    const bool skip = !wanted(v.role);
    each_number(v, [&](void* at, std::size_t n) {
      if (!skip && n > 0) std::memcpy(at, in, n);
      in += n;
    });
    if (v.kind() == Kind::kString && !skip) {
      for (std::string& s : v.strings()) take(s, text);
    }
  }
}

void Channel::append(const std::string& s, std::size_t& at) {
  const std::uint64_t n = s.size();
  if (n > kTextBytes || at + sizeof n + n > kTextBytes)
    throw Error("strings of more than " + std::to_string(kTextBytes) + " bytes cannot be passed between two processes");
  std::memcpy(texts_ + at, &n, sizeof n);
  std::memcpy(texts_ + at + sizeof n, s.data(), s.size());
  at += sizeof n + s.size();
  header_->text_bytes = at;
}

void Channel::take(std::string& s, std::size_t& at) const {
  std::uint64_t n = 0;
  const std::uint64_t end = std::min<std::uint64_t>(header_->text_bytes, kTextBytes);
  if (at + sizeof n > end) throw Error("a string is missing in the shared memory");
  std::memcpy(&n, texts_ + at, sizeof n);
  if (n > end - at - sizeof n) throw Error("a string is truncated in the shared memory");
  s.assign(texts_ + at + sizeof n, n);
  at += sizeof n + n;
}

}  // namespace cotwin::fmu
