#pragma once
#include <atomic>
#include <chrono>
#include <cstdint>
#include <span>
#include <string>

#include "components/unit/variables.h"
#include "fmu/import/under_way.h"

/// Shared memory through which a program and the process of one of its FMUs (host_main.cpp) exchange calls and values. Numbers
/// and booleans are stored at fixed places, strings one after another. A call increments a counter; the other side waits for
/// it, first by spinning, then on a futex.
namespace cotwin::fmu {

/// File descriptors of the started process.
inline constexpr int kMemoryDescriptor = 3;    // the shared memory
inline constexpr int kLifelineDescriptor = 4;  // a pipe without data; it is closed when the program ends
inline constexpr const char* kHostProgram = "cotwin-fmu-host";
inline constexpr std::uint64_t kChannelVersion = 0x3230656c49575443u;  // both programs must be of the same build

// Calls up to kExit have a longer time limit.
enum class Verb : std::uint32_t { kMake, kInitialise, kEnter, kUpdate, kExit, kStep, kSave, kRestore, kTell, kEnd };
enum class Reply : std::uint32_t { kDone, kDiscard, kFinished, kError };

/// The start of the shared memory, before the values.
struct ChannelHeader {
  static constexpr std::size_t kMessageBytes = 8192;
  std::uint64_t version = kChannelVersion;
  std::uint64_t number_bytes = 0;             // size of the values; checked by kMake
  std::uint64_t memory_limit = 0;             // of the process, bytes
  std::atomic<std::int32_t> served{0};        // the process with the FMU; a child of the started one
  std::atomic<std::uint32_t> asked{0};        // number of calls so far; a futex
  std::atomic<std::uint32_t> host_sleeps{0};  // 1: the host waits on the futex
  std::uint32_t may_spin = 0;                 // 1: a core is free for spinning
  Verb verb = Verb::kEnd;
  std::int64_t now_ns = 0, h_ns = 0;
  std::uint64_t text_bytes = 0;                        // of strings and of a serialised state
  alignas(64) std::atomic<std::uint32_t> answered{0};  // number of calls answered; a futex
  std::atomic<std::uint32_t> program_sleeps{0};        // 1: the program waits on the futex
  Reply reply = Reply::kDone;
  char function[UnderWay::kMirrorBytes] = "";  // the FMU's function that is being called
  char message[kMessageBytes] = "";
};
static_assert(std::atomic<std::uint32_t>::is_always_lock_free);

/// Stores `value` in `word` and wakes the waiter if `sleeps` is set.
void post(std::atomic<std::uint32_t>& word, std::uint32_t value, std::atomic<std::uint32_t>& sleeps);
/// Spins on a word for a short time before its waiter sleeps. The time halves after each failure, for on a busy machine
/// spinning only costs.
class SpinWait {
 public:
  /// Returns whether the word became `wanted`. `may_spin`: a core is free; otherwise the word is read once.
  bool wait_for(const std::atomic<std::uint32_t>& word, std::uint32_t wanted, bool may_spin);

 private:
  static constexpr std::uint32_t kMost = 400, kRetry = 64;  // reads (5 to 20 µs); calls until more reads are tried again
  std::uint32_t reads_ = kMost, calls_ = 0;
};
/// Sleeps until the word is `wanted`, a signal arrives or the time is over. Returns whether the word is `wanted`.
bool sleep_for(std::atomic<std::uint32_t>& word, std::uint32_t wanted, std::atomic<std::uint32_t>& sleeps,
               std::chrono::nanoseconds at_most);

/// The shared memory.
class Channel {
 public:
  /// Creates memory for these variables. Throws Error if the system has none.
  explicit Channel(const Variables& variables);
  /// Maps the memory of a descriptor. Throws Error if it is not a channel of the same build.
  static Channel open(int descriptor);
  ~Channel();
  Channel(Channel&& other) noexcept;
  Channel& operator=(Channel&&) = delete;

  ChannelHeader& header() const { return *header_; }
  int descriptor() const { return descriptor_; }
  /// Throws Error if the memory was created for other variables.
  void check_layout(const Variables& variables) const;

  static bool is_input(Role role) { return role == Role::kInput || role == Role::kTunable; }
  static bool is_output(Role role) { return role == Role::kOutput || role == Role::kState; }
  static bool any(Role) { return true; }
  /// Writes the variables whose role `wanted` accepts. Strings are written from offset `text` on, which is advanced.
  void write(const Variables& variables, bool (*wanted)(Role), std::size_t& text);
  void read(const Variables& variables, bool (*wanted)(Role), std::size_t& text) const;
  void clear_texts() { header_->text_bytes = 0; }
  void append(const std::string& s, std::size_t& at);
  void take(std::string& s, std::size_t& at) const;

 private:
  Channel() = default;

  ChannelHeader* header_ = nullptr;
  char* values_ = nullptr;
  char* texts_ = nullptr;
  std::size_t bytes_ = 0;
  int descriptor_ = -1;
};

}  // namespace cotwin::fmu
