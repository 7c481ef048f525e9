#pragma once
#include "models/foundation/database/database.h"

namespace cotwin::gateway {

using database::DatabaseError;

/// The queue cannot be asked now: it is closed, or its database cannot be read. Nothing is wrong with the request.
using Unavailable = DatabaseError;

}  // namespace cotwin::gateway
