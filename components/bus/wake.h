#pragma once
#include <atomic>
#include <cstdint>

namespace cotwin::bus {

/// CLOCK_MONOTONIC in ns.
std::int64_t monotonic_ns();

constexpr std::int64_t kNever = -1;  // a deadline that never comes

/// Waits with poll until `descriptor` is readable or CLOCK_MONOTONIC reaches `deadline`, ns. False: the deadline came first. May
/// return true early (a signal).
bool wait_readable(int descriptor, std::int64_t deadline);

/// Wakes one thread that waits for something that other threads provide: an eventfd on Linux, elsewhere a pipe. A thread that is
/// not waiting costs its notifiers one atomic exchange and no system call.
class Wake {
 public:
  enum class Kind : std::uint8_t { kBest, kPipe };

  /// Throws Error if the system has no descriptors left.
  explicit Wake(Kind kind = Kind::kBest);
  ~Wake();
  Wake(const Wake&) = delete;
  Wake& operator=(const Wake&) = delete;

  /// Call it after the provided thing is visible. From any thread; never blocks, never allocates.
  void notify() noexcept {
    if (armed_.exchange(false, std::memory_order_acq_rel)) write_descriptor();
  }

  /// Waits until ready() is true or CLOCK_MONOTONIC reaches `deadline`, ns. Returns ready(). By one thread at a time.
  template <class Ready>
  bool wait(Ready ready, std::int64_t deadline = kNever) {
    for (;;) {
      if (ready()) return true;
      arm();
      if (ready()) {
        disarm();
        return true;
      }
      const bool in_time = wait_readable(read_end_, deadline);
      disarm();
      if (!in_time) return ready();
    }
  }

  /// For a thread that waits for several descriptors at once: arm(), check what it waits for, poll descriptor() among the others,
  /// disarm(). A descriptor may be readable without a reason.
  int descriptor() const { return read_end_; }
  /// An exchange and not a store: if the last notify() was before it, what that provided is visible after it.
  void arm() noexcept { (void)armed_.exchange(true, std::memory_order_acq_rel); }
  void disarm() noexcept {
    if (!armed_.exchange(false, std::memory_order_acq_rel)) drain();
  }

 private:
  void write_descriptor() noexcept;
  void drain() noexcept;

  alignas(64) std::atomic<bool> armed_ = false;
  int read_end_ = -1, write_end_ = -1;  // the same one for an eventfd
};

}  // namespace cotwin::bus
