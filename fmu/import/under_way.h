#pragma once
#include <cstddef>
#include <cstdint>
#include <utility>

/// Which function of which FMU a thread is in. A crash or an exit() inside an FMU is reported with this.
namespace cotwin::fmu {

/// For messages. The texts must live as long as calls are made.
struct CallPlace {
  const char* fmu = "";       // "x.fmu"
  const char* instance = "";  // name of the component
};

struct UnderWay {
  static constexpr std::size_t kMirrorBytes = 64;
  const char* function = nullptr;  // "fmi2DoStep"; nullptr: the thread is in no FMU
  const CallPlace* place = nullptr;
  std::int64_t ns = 0;     // simulated time at the begin of the step
  char* mirror = nullptr;  // where the function's name is copied to, kMirrorBytes; nullptr: nowhere
};

/// Of this thread. Read in signal handlers: plain data without a constructor.
extern constinit thread_local UnderWay under_way;

/// Copies the name of the function to under_way.mirror.
void mirror_function(const char* function) noexcept;

/// Which FMU and which time the following calls of this thread belong to.
inline void set_call_place(const CallPlace& place, std::int64_t ns) noexcept {
  under_way.place = &place;
  under_way.ns = ns;
}

/// A call into an FMU, as long as this lives. Calls may be nested: an FMU calls back, and is called from there.
class CallUnderWay {
 public:
  explicit CallUnderWay(const char* function) noexcept : outer_(std::exchange(under_way.function, function)) {
    if (under_way.mirror != nullptr) [[unlikely]]
      mirror_function(function);
  }
  ~CallUnderWay() {
    under_way.function = outer_;
    if (under_way.mirror != nullptr) [[unlikely]]
      mirror_function(outer_);
  }
  CallUnderWay(const CallUnderWay&) = delete;
  CallUnderWay& operator=(const CallUnderWay&) = delete;

 private:
  const char* outer_;
};

/// Throws Error for the exception that is being handled: an FMU must not throw any. An Error of ours that passes through the
/// FMU is thrown on.
[[noreturn]] void rethrow_from(const char* function);

/// A function of an FMU's library with its name. It may be absent (nullptr).
template <class Signature>
class Function;
template <class Result, class... Arguments>
class Function<Result(Arguments...)> {
 public:
  using Pointer = Result (*)(Arguments...);
  Function() = default;
  Function(Pointer pointer, const char* name) : pointer_(pointer), name_(name) {}

  Result operator()(Arguments... arguments) const {
    const CallUnderWay call(name_);
    try {
      return pointer_(arguments...);
    } catch (...) {
      rethrow_from(name_);
    }
  }
  /// Of destructors: an exception is dropped.
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
