#pragma once
#include <chrono>
#include <cstddef>
#include <optional>
#include <string>

/// How far a long computation is, on a terminal.
namespace cotwin::master {

/// Estimates the time that a computation still takes from its rate in the last part of the time so far.
class TimeLeft {
 public:
  /// `elapsed`: s, not decreasing; `share` done, 0 to 1. The first call, and one with a share below the last one, begins a
  /// computation. Returns s; nothing in its first second and before anything is done in it.
  std::optional<double> update(double elapsed, double share);

 private:
  bool begun_ = false;
  double begin_ = 0;                // s
  double elapsed_ = 0, share_ = 0;  // at the last update
  double time_ = 0, done_ = 0;      // since the begin, older parts with less weight
};

/// "12 s", "3 min 20 s", "2 h 5 min", "3 d 4 h".
std::string duration_text(double seconds);

/// One line of at most `columns` − 1 characters: "[####....] what, 12 s left"; without a bar where there is no room for it.
std::string progress_text(const std::string& what, double share, std::optional<double> left, std::size_t columns);

/// A progress line on stderr that overwrites itself. Prints nothing if stderr is not a terminal.
class ProgressLine {
 public:
  explicit ProgressLine(bool wanted);
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  /// Whether update() would draw: on a terminal, and not within 100 ms of the last time.
  bool is_due() const;
  /// Draws the line if it is due. `share` in [0, 1].
  void update(const std::string& what, double share);
  /// Removes the line.
  void clear();

 private:
  using Clock = std::chrono::steady_clock;

  bool shown_, drawn_ = false;
  Clock::time_point begin_ = Clock::now();
  std::optional<Clock::time_point> last_;
  TimeLeft left_;
};

}  // namespace cotwin::master
