#pragma once
#include <iosfwd>
#include <string>

#include "master/run/master.h"

/// What a run was like, for people and for programs.
namespace cotwin::master {

struct Outcome {
  std::string state = "done";  // "done", "interrupted", "failed"
  std::string message;         // of a failure
};

/// Tables of at most 100 characters a line where the vectors allow it.
void write_report(std::ostream& out, const Summary& summary, const Outcome& outcome);

/// One JSON object with everything that the summary has; numbers that are not finite are null.
void write_json(std::ostream& out, const Summary& summary, const Outcome& outcome);

}  // namespace cotwin::master
