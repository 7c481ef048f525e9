#pragma once
#include <string>
#include <vector>

#include "components/gateway/http/message.h"

namespace cotwin::gateway::http {

/// An error as application/problem+json (RFC 9457).
struct Problem {
  int status = 500;
  std::string detail;                                             // place, fact and expectation
  std::string pointer;                                            // JSON pointer into the request's body; "": none
  std::string title;                                              // "": the reason of the status
  std::vector<std::pair<std::string, std::string>> members = {};  // further ones, with texts as values
};

/// `fields` are added to the header, as Retry-After.
Response to_response(const Problem& problem, std::vector<Field> fields = {});

/// Thrown by a handler: the response is the problem.
struct Refusal {
  Problem problem;
  std::vector<Field> fields;
};

}  // namespace cotwin::gateway::http
