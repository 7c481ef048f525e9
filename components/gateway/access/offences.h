#pragma once
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

namespace cotwin::gateway::access {

/// Counts what somebody does too often, by address or name, in bounded memory.
class Offences {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::chrono::seconds kWindow{60};
  static constexpr std::size_t kPrompt = 4;   // in kWindow that are answered at once
  static constexpr std::size_t kMost = 4096;  // names; further ones count as one

  /// `told`: in a row that are worth a line; afterwards one a second is.
  explicit Offences(double told) : told_(told) {}

  struct Verdict {
    bool late = false;             // there were kPrompt others within kWindow
    bool told = false;             // it is worth a line
    std::uint64_t since_told = 0;  // others since the last line, which had none
  };
  Verdict note(const std::string& who, Time now);
  std::size_t size() const { return entries_.size(); }

 private:
  struct Entry {
    std::array<Time, kPrompt> last{};  // a ring
    std::size_t count = 0;
    double credit = 0;  // lines
    Time at;
    std::uint64_t untold = 0;
  };
  const double told_;
  std::map<std::string, Entry> entries_;
  Time swept_{};
};

}  // namespace cotwin::gateway::access
