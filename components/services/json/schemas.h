#pragma once
#include <string>

namespace cotwin::services {

/// The JSON Schemas (2020-12) of a service as {"title", "description", "request": {…}, "reply": {…}}, one line. Throws Error for an
/// unknown service.
std::string schema(const std::string& service);
/// The schema of an answer that is a problem: {"title", "detail", "pointer"}.
std::string problem_schema();

}  // namespace cotwin::services
