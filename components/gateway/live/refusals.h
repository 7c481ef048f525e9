#pragma once
#include <string>

#include "models/foundation/support/error.h"

/// Refusals of requests to a run.
namespace cotwin::gateway::live {

/// Throws http::Refusal; 429 and 503 say when to ask again.
[[noreturn]] void refuse(int status, const std::string& detail, const std::string& pointer = "");

/// The detail of an error of the bus, without its place.
std::string detail_of(const Error& error);

/// In a handler of exceptions of the bus: the refusal that tells what the client can do.
[[noreturn]] void refuse_error(const std::string& pointer = "");

}  // namespace cotwin::gateway::live
