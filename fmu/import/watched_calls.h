#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <string>

#include "fmu/import/under_way.h"

namespace cotwin::fmu {

/// The calls into FMUs of a forked process, in memory that its parent reads after its end, however it ended.
class WatchedCalls {
 public:
  /// Memory that is shared with processes that are forked from now on. nullptr if the system has none.
  static WatchedCalls* make() noexcept;
  /// In the child, before it has threads: from now on its calls are in this memory.
  void begin() noexcept;

  /// Stores the names of a place, so that the parent can read them. Places beyond kPlaces have no names there.
  void add(const CallPlace& place) noexcept;
  /// Stores the name of a function, for the same reason: the FMU may damage the memory that pointers to names are in, and the
  /// parent must not follow what is left of them. Calls of functions beyond kFunctions have no name there.
  void add(const char* function) noexcept;
  /// The memory for the calls of the calling thread; its own, which no other process sees, beyond kThreads.
  UnderWay* call_of_this_thread() noexcept;

  /// In the parent: the calls under way, otherwise the last call of the main thread:
  /// "component 'pump' at t = 0.5 s: x.fmu: fmi2DoStep". "" if no FMU was called. May also be called before the end.
  std::string last_calls() const;

  /// How the child ends: set by it.
  enum class End : std::uint32_t { kUnexpected, kExpected, kReported };
  std::atomic<End> end{End::kUnexpected};
  /// Nothing was written yet: the parent may kill the child. Set by the child.
  std::atomic<bool> initialising{true};

 private:
  static constexpr std::size_t kThreads = 256, kPlaces = 4096, kFunctions = 128, kNameBytes = 96;
  struct Place {
    std::atomic<const CallPlace*> place;
    std::array<char, kNameBytes> fmu, instance;
  };
  struct FunctionName {
    std::atomic<const char*> function;
    std::array<char, kNameBytes> name;
  };

  const Place* names_of(const CallPlace* place) const;
  const FunctionName* name_of(const char* function) const;
  std::string describe(const UnderWay& call) const;

  std::atomic<std::uint32_t> places_{0};
  std::array<std::atomic<bool>, kThreads> taken_{};  // of calls_
  std::array<UnderWay, kThreads> calls_{};           // the first is that of the main thread
  std::array<Place, kPlaces> names_{};
  std::atomic<std::uint32_t> functions_{0};
  std::array<FunctionName, kFunctions> function_names_{};
};

}  // namespace cotwin::fmu
