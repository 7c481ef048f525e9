#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "master/run/master.h"
#include "master/workflows/watched.h"

namespace cotwin::master {

/// The numbers that are kept of one run. They do not depend on what is recorded.
class Figures {
 public:
  /// `keep`: as in a study. Throws Error for words and variables that are not there.
  Figures(const std::vector<std::string>& keep, Master& master);
  /// Call after the initialisation and after each tick.
  void sample();
  struct Named {
    std::string name;  // "peak world.force", "rms contact force"
    double value = 0;
  };
  /// All of a run that is over; before it, their names.
  std::vector<Named> all(const Summary& summary) const;

 private:
  enum class Kind : std::uint8_t { kEnd, kMin, kMax, kPeak };
  struct Kept {
    Kind kind;
    std::string word;
    Watched watched;
    std::vector<double> values;
  };
  std::vector<Kept> kept_;
  bool summary_ = false;
};

/// "peak world.force<30" as a condition on a figure, whose name is then complete: "end world.contacts".
Condition success_condition(const std::string& text);

}  // namespace cotwin::master
