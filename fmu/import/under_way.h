#pragma once
#include <cstddef>
#include <cstdint>
#include <utility>

/// The function of an FMU that a thread is executing. Messages about a crash or an exit() inside an FMU name it.
namespace cotwin::fmu {

/// Names for messages. They must outlive the calls.
struct CallPlace {
  const char* fmu = "";       // "x.fmu"
  const char* instance = "";  // name of the component
};

struct UnderWay {
  static constexpr std::size_t kMirrorBytes = 64;
  const char* function = nullptr;  // "fmi2DoStep"; nullptr: not in an FMU
  const CallPlace* place = nullptr;
  std::int64_t ns = 0;     // simulated time at the beginning of the step
  char* mirror = nullptr;  // buffer of kMirrorBytes for a copy of the function's name, or nullptr
};

/// Of this thread: its own, and one that another process reads (WatchedCalls), or nullptr. Plain data without a constructor,
/// because signal handlers read it.
extern constinit thread_local UnderWay own_call;
extern constinit thread_local UnderWay* watched_call;
inline UnderWay& under_way() noexcept { return watched_call != nullptr ? *watched_call : own_call; }

/// Copies the function's name to under_way().mirror.
void mirror_function(const char* function) noexcept;

class WatchedCalls;
extern constinit WatchedCalls* watched_calls;  // nullptr: no process watches this one
void begin_watched_call() noexcept;            // gives this thread its place in watched_calls

/// Sets FMU and simulated time of the following calls of this thread.
inline void set_call_place(const CallPlace& place, std::int64_t ns) noexcept {
  if (watched_calls != nullptr && watched_call == nullptr) [[unlikely]]
    begin_watched_call();
  UnderWay& call = under_way();
  call.place = &place;
  call.ns = ns;
}

/// Marks a call into an FMU for the lifetime of this object. Calls can be nested, through callbacks of the FMU.
class CallUnderWay {
 public:
  explicit CallUnderWay(const char* function) noexcept : call_(under_way()), outer_(std::exchange(call_.function, function)) {
    if (call_.mirror != nullptr) [[unlikely]]
      mirror_function(function);
  }
  ~CallUnderWay() {
    call_.function = outer_;
    if (call_.mirror != nullptr) [[unlikely]]
      mirror_function(outer_);
  }
  CallUnderWay(const CallUnderWay&) = delete;
  CallUnderWay& operator=(const CallUnderWay&) = delete;

 private:
  UnderWay& call_;
  const char* outer_;
};

/// The same name, also for the process that watches this one.
const char* known_function(const char* function) noexcept;

/// Turns the exception that is being handled into an Error, because an FMU must not throw. An Error of this program that passed
/// through the FMU is rethrown.
[[noreturn]] void rethrow_from(const char* function);

/// A function of an FMU's library, with its name. It can be absent (nullptr).
template <class Signature>
class Function;
template <class Result, class... Arguments>
class Function<Result(Arguments...)> {
 public:
  using Pointer = Result (*)(Arguments...);
  Function() = default;
  Function(Pointer pointer, const char* name) : pointer_(pointer), name_(known_function(name)) {}

  // Inline by order: clang takes the handler for expensive, and a trivial FMU is called in 2 ns.
  [[gnu::always_inline]] Result operator()(Arguments... arguments) const {
    const CallUnderWay call(name_);
    try {
      return pointer_(arguments...);
    } catch (...) {
      rethrow_from(name_);
    }
  }
  /// For destructors: ignores exceptions.
  void call_quietly(Arguments... arguments) const noexcept {
    try {
      static_cast<void>((*this)(arguments...));
    } catch (...) {
      return;
    }
  }
  bool operator==(std::nullptr_t) const { return pointer_ == nullptr; }

 private:
  Pointer pointer_ = nullptr;
  const char* name_ = "";
};

}  // namespace cotwin::fmu
