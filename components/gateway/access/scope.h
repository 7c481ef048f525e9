#pragma once
#include <cstdint>
#include <string>
#include <utility>

#include "models/foundation/support/text.h"

namespace cotwin::gateway::access {

/// What a client may do.
enum class Scope : std::uint8_t {
  kRead = 1,         // ask, read, watch
  kJobs = 2,         // order and command jobs
  kTune = 4,         // set values of the run, pause it, step it
  kAcknowledge = 8,  // set inputs of the run that are called acknowledge
  kEnd = 16          // end the run
};
inline constexpr std::pair<const char*, Scope> kScopeWords[] = {{"read", Scope::kRead},
                                                                {"jobs", Scope::kJobs},
                                                                {"tune", Scope::kTune},
                                                                {"acknowledge", Scope::kAcknowledge},
                                                                {"end", Scope::kEnd}};

/// A set of scopes.
class Scopes {
 public:
  constexpr Scopes() = default;
  constexpr Scopes(Scope scope) : bits_(static_cast<std::uint8_t>(scope)) {}  // NOLINT: a scope is a set of one
  static constexpr Scopes all() { return Scopes(std::uint8_t{31}); }
  /// Those that change something.
  static constexpr Scopes changing() { return Scopes(std::uint8_t{30}); }

  constexpr bool empty() const { return bits_ == 0; }
  constexpr bool has(Scope scope) const { return any_of(scope); }
  constexpr bool any_of(Scopes others) const { return (bits_ & others.bits_) != 0; }
  constexpr Scopes operator|(Scopes others) const { return Scopes(static_cast<std::uint8_t>(bits_ | others.bits_)); }
  bool operator==(const Scopes&) const = default;
  /// "tune or acknowledge", with another `between` accordingly.
  std::string words(const std::string& between) const {
    std::string all;
    for (const auto& [word, scope] : kScopeWords) {
      if (has(scope)) text::append(all, word, between);
    }
    return all;
  }

 private:
  explicit constexpr Scopes(std::uint8_t bits) : bits_(bits) {}
  std::uint8_t bits_ = 0;
};
constexpr Scopes operator|(Scope a, Scope b) { return Scopes(a) | Scopes(b); }

}  // namespace cotwin::gateway::access
