#pragma once
#include <atomic>
#include <chrono>
#include <cstdint>
#include <span>
#include <string>

#include "components/unit/variables.h"
#include "fmu/import/under_way.h"

/// What a program and the process of one of its FMUs (host_main.cpp) exchange: memory that both see. Numbers and booleans have
/// a fixed place each, texts lie behind one another. A call is a word that the other side waits for, first awake, then asleep
/// on a futex.
namespace cotwin::fmu {

/// File descriptors that the process is started with.
inline constexpr int kMemoryDescriptor = 3;    // the shared memory
inline constexpr int kLifelineDescriptor = 4;  // a pipe that nobody writes to: its end is that of the program
inline constexpr const char* kHostProgram = "cotwin-fmu-host";
inline constexpr std::uint64_t kChannelVersion = 0x3130656c49575443u;  // both programs must be of the same build

// Those up to kExit may take longer than others.
enum class Verb : std::uint32_t { kMake, kInitialise, kEnter, kUpdate, kExit, kStep, kSave, kRestore, kTell, kEnd };
enum class Reply : std::uint32_t { kDone, kDiscard, kFinished, kError };

/// In front of the values.
struct ChannelHeader {
  static constexpr std::size_t kMessageBytes = 8192;
  std::uint64_t version = kChannelVersion;
  std::uint64_t number_bytes = 0;             // room for the values; kMake compares it
  std::uint64_t memory_limit = 0;             // bytes of the process
  std::atomic<std::uint32_t> asked{0};        // calls so far; futexes
  std::atomic<std::uint32_t> host_sleeps{0};  // and has to be woken
  std::uint32_t may_wait_awake = 0;           // at a word before a wait sleeps: more than 1 where a core is free for that
  Verb verb = Verb::kEnd;
  std::int64_t now_ns = 0, h_ns = 0;
  std::uint64_t text_bytes = 0;  // of texts and of a state
  alignas(64) std::atomic<std::uint32_t> answered{0};
  std::atomic<std::uint32_t> program_sleeps{0};
  Reply reply = Reply::kDone;
  char function[UnderWay::kMirrorBytes] = "";  // of the FMU that is being called
  char message[kMessageBytes] = "";
};
static_assert(std::atomic<std::uint32_t>::is_always_lock_free);

/// Stores `value` and wakes who sleeps on the word.
void post(std::atomic<std::uint32_t>& word, std::uint32_t value, std::atomic<std::uint32_t>& sleeps);
/// Looks at a word for a while before its waiter sleeps: shorter where that was in vain the last times, as it is on a busy
/// machine.
class Lookout {
 public:
  /// Whether the word became `wanted`; `may_wait`: there is a core that would otherwise be idle.
  bool sees(const std::atomic<std::uint32_t>& word, std::uint32_t wanted, bool may_wait);

 private:
  static constexpr std::uint32_t kMost = 400, kRetry = 64;  // looks: 5 to 20 µs; calls
  std::uint32_t looks_ = kMost, calls_ = 0;
};
/// Sleeps until the word is `wanted`, a signal comes or the time is over. Returns whether it is.
bool sleep_for(std::atomic<std::uint32_t>& word, std::uint32_t wanted, std::atomic<std::uint32_t>& sleeps,
               std::chrono::nanoseconds at_most);

/// The shared memory.
class Channel {
 public:
  /// New memory for those variables.
  explicit Channel(const Variables& variables);
  /// That of a descriptor. Throws Error for anything but a channel.
  static Channel open(int descriptor);
  ~Channel();
  Channel(Channel&& other) noexcept;
  Channel& operator=(Channel&&) = delete;

  ChannelHeader& header() const { return *header_; }
  int descriptor() const { return descriptor_; }
  /// Throws Error where these variables are not those that the memory was made for.
  void check_layout(const Variables& variables) const;

  static bool goes_in(Role role) { return role == Role::kInput || role == Role::kTunable; }
  static bool comes_out(Role role) { return role == Role::kOutput || role == Role::kState; }
  static bool every(Role) { return true; }
  /// Writes those variables whose role `wanted` accepts; texts from `text` on, which is moved behind them.
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
