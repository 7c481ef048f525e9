#pragma once
#include <iosfwd>

#include "components/services/json/json.h"

/// Services as a process of their own, for queues of jobs.
namespace cotwin::master {

/// Answers requests line by line until the end of `in`:
///   in    {"id": "7", "request": {"service": …}}
///   out   {"id": "7", "progress": 0.25, "message": "…"}      any number of times
///         {"id": "7", "reply": {…}}   or   {"id": "7", "problem": {"title": …, "detail": …, "pointer": …}}
/// A line that is not such an object, or is longer than kLongestLine bytes, is answered with a problem, whose id is null where it
/// cannot be read. Each line is written at once. Returns false if `out` cannot be written.
bool run_worker(std::istream& in, std::ostream& out, services::Robots& robots, const services::Context& context);

inline constexpr std::size_t kLongestLine = 4 << 20;

}  // namespace cotwin::master
