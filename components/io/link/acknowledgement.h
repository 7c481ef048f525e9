#pragma once
#include <string>

#include "components/unit/variables.h"

namespace cotwin::io {

/// Whether a link may command its device after a loss. Nothing may move by itself when a cable is plugged in again or a controller
/// has started again: after demand() the link commands nothing until the input `acknowledge` was off for kLowSteps steps and then
/// on for kHighTime while the device is ready. Steps in which the device is not believed do not count: damage presses no button.
/// The start of a run needs no acknowledgement.
class Acknowledgement {
 public:
  static constexpr int kLowSteps = 3;
  static constexpr double kHighTime = 0.05;  // s

  /// Declares the output awaits_acknowledgement, the input acknowledge and the parameter restart. `withheld`: what holds
  /// meanwhile, "outputs are off"; `ready`: when it counts, "the bus is operational".
  void declare(Variables& v, const std::string& withheld, const std::string& ready);
  /// The start of a run: nothing is awaited, and an input that is on has not risen. Throws Error at `place` if the parameter has another value.
  void begin(const std::string& place);
  /// After a loss, a restart or a jump. What was pressed before does not count. Without effect with restart=automatic.
  void demand();
  /// Once in each step, of h seconds. `ready`: the device is back; else the input has to rise again. `believed`: its last message is.
  void decide(bool ready, bool believed, double h);
  bool awaits() const { return awaits_; }
  /// Whether nothing is ever awaited.
  bool is_automatic() const { return restart_ == "automatic"; }

 private:
  std::string restart_ = "acknowledged";
  bool acknowledge_ = false;  // the input
  bool awaits_ = false;
  int low_ = 0;      // steps in a row in which the input was off; kept while it is on, 0 if that does not count
  double high_ = 0;  // s for which it has been on since then
};

}  // namespace cotwin::io
