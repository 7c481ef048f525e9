#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "components/unit/time.h"
#include "fmu/import/foreign.h"

namespace cotwin::fmu {

/// Saves the state of a foreign FMU as bytes for a snapshot: the serialised state, which a new instance can restore; or, if the
/// FMU cannot serialise, the number of one of the last kKept states that are kept in the instance. A state that is saved over
/// the bytes of another replaces it.
class StateKeeper {
 public:
  static constexpr std::size_t kKept = 16;
  static constexpr const char* kPlace = "FMU's state";  // of errors; short enough for a string without an allocation
  explicit StateKeeper(const Interface& interface) : serialises_(interface.can_serialise_state) {}

  /// Writes `time`, `extra` and the instance's state over `bytes`.
  void save(ForeignInstance& instance, Time time, std::string_view extra, std::string& bytes);
  /// The same, but keeps the state in the instance in any case.
  void save_here(ForeignInstance& instance, Time time, std::string_view extra, std::string& bytes);
  /// Returns the time of a saved state. Throws Error for empty bytes.
  static Time time_of(const std::string& bytes);
  /// Restores the state and returns `extra`, a part of `bytes`. Throws Error for bytes of another FMU and for a state that is no longer kept.
  std::string_view restore(ForeignInstance& instance, const std::string& bytes);
  /// Frees the kept states. Must be called before the instance is destroyed.
  void clear(ForeignInstance& instance) noexcept;
  /// The same, but serialises the states before if the FMU can, so that the next instance can restore them.
  void leave(ForeignInstance& instance) noexcept;

 private:
  struct Kept {
    std::uint64_t number = 0;  // 0: none
    void* state = nullptr;     // in the instance
    std::string serialised;    // if not empty: of an instance before, in place of `state`
  };
  Kept& place_for(const std::string& bytes);
  void restore_serialised(ForeignInstance& instance, std::string_view serialised);

  bool serialises_;
  std::uint64_t next_ = 1;
  std::array<Kept, kKept> kept_{};
  void* passing_ = nullptr;  // a state in the instance that is only serialised
  std::string scratch_;
};

/// Returns whether bytes of StateKeeper contain the serialised state, so that an instance in another process can restore it.
bool holds_state(std::string_view saved);

}  // namespace cotwin::fmu
