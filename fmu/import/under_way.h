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

/// One per thread. Plain data without a constructor, because signal handlers read it.
extern constinit thread_local UnderWay under_way;

/// Copies the function's name to under_way.mirror.
void mirror_function(const char* function) noexcept;

/// Sets FMU and simulated time of the following calls of this thread.
inline void set_call_place(const CallPlace& place, std::int64_t ns) noexcept {
  under_way.place = &place;
  under_way.ns = ns;
}

/// Marks a call into an FMU for the lifetime of this object. Calls can be nested, through callbacks of the FMU.
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
  Function(Pointer pointer, const char* name) : pointer_(pointer), name_(name) {}

  Result operator()(Arguments... arguments) const {
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
