#pragma once
#include <cstdint>
#include <iosfwd>
#include <string>

#include "master/run/master.h"

/// Writes the summary of a run as text and as JSON.
namespace cotwin::master {

struct Outcome {
  enum class State : std::uint8_t { kDone, kInterrupted, kFailed };
  State state = State::kDone;
  std::string message;  // the reason, unless kDone
};

/// "3.2 us", "41 ms", "12 s".
std::string duration(double seconds);

/// Writes tables with lines of at most 100 characters if the vectors allow it.
void write_report(std::ostream& out, const Summary& summary, const Outcome& outcome);

/// Writes the whole summary as one JSON object. Numbers that are not finite become null.
void write_json(std::ostream& out, const Summary& summary, const Outcome& outcome);

}  // namespace cotwin::master
