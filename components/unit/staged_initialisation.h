#pragma once
#include "components/unit/time.h"

namespace cotwin {

/// A unit whose inputs may change during initialisation, so that an algebraic loop at the start is iterated without a new
/// initialisation. Call order instead of Unit::initialise(): enter, any number of updates, exit.
class StagedInitialisation {
 public:
  virtual ~StagedInitialisation() = default;
  /// Computes the outputs from the present inputs.
  virtual void enter_initialisation(Time start) = 0;
  /// Computes the outputs again after inputs were changed.
  virtual void update_initialisation() = 0;
  /// Ends the initialisation, as Unit::initialise() does; the first step may follow.
  virtual void exit_initialisation() = 0;
};

}  // namespace cotwin
