#pragma once
#include <chrono>
#include <string>
#include <string_view>
#include <vector>

namespace cotwin {

/// A program that has been run.
struct Ended {
  int error = 0;      // of the start: errno
  bool late = false;  // killed after the time limit
  int status = 0;     // of waitpid
  std::string out, err;
  bool well() const;  // started, in time, with exit code 0
};

/// Runs a program to its end: `command` is its path, or its name in PATH, and its arguments; `input` is its stdin. Its output files are
/// bounded by its own limits on files. Throws Error where there is no memory for its input.
Ended run_process(std::vector<std::string> command, std::string_view input, std::chrono::seconds limit);

}  // namespace cotwin
