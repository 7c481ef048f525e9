#pragma once
#include "models/foundation/support/error.h"

namespace cotwin::bus {

/// Of LiveRun: there is no room now for another watch, client, watched value or request.
class NoRoom : public Error {
 public:
  using Error::Error;
};

/// Of LiveRun: the run has ended.
class RunEnded : public Error {
 public:
  using Error::Error;
};

}  // namespace cotwin::bus
