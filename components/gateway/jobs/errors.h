#pragma once
#include "models/foundation/support/error.h"

namespace cotwin::gateway {

/// The queue cannot be asked now: it is closed, or its database cannot be read. Nothing is wrong with the request.
class Unavailable : public Error {
 public:
  using Error::Error;
};

/// A statement of SQLite failed: disk full, file damaged, no permission.
class DatabaseError : public Unavailable {
 public:
  using Unavailable::Unavailable;
};

}  // namespace cotwin::gateway
