#pragma once
#include <string>

#include "models/foundation/support/error.h"

namespace cotwin::testing {

/// The message of the Error that `action` throws; "" if it throws none.
template <class Action>
std::string error_of(const Action& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace cotwin::testing
