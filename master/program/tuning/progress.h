#pragma once
#include <chrono>
#include <cstddef>
#include <functional>
#include <string>

namespace cotwin::master::tuning {

/// The callbacks of a long computation.
struct Hooks {
  std::function<void(const std::string& what, double share)> progress;  // share in [0, 1]
  std::function<bool()> stop;                                           // true: end as soon as possible
  void tell(const std::string& what, double share) const {
    if (progress) progress(what, share);
  }
  bool stopped() const { return stop && stop(); }
};

/// A progress bar on one line of the terminal; nothing if stderr is not a terminal.
class ProgressLine {
 public:
  explicit ProgressLine(bool wanted);
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;
  void update(const std::string& what, double share);
  void clear();

 private:
  bool shown_, drawn_ = false;
  std::chrono::steady_clock::time_point last_;
};

}  // namespace cotwin::master::tuning
