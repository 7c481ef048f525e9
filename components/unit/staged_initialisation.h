#pragma once
#include "components/unit/time.h"

namespace cotwin {

/// A unit that can be kept in its initialisation while its inputs change, so that an algebraic loop at the start is iterated
/// without starting over. Instead of Unit::initialise() the order is: enter, any number of updates, exit.
class StagedInitialisation {
 public:
  virtual ~StagedInitialisation() = default;
  /// The outputs follow the inputs as they are.
  virtual void enter_initialisation(Time start) = 0;
  /// Inputs were changed; the outputs follow them.
  virtual void update_initialisation() = 0;
  /// The unit is as after Unit::initialise(), and can make its first step.
  virtual void exit_initialisation() = 0;
};

}  // namespace cotwin
