#include "master/program/progress_line.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <utility>

namespace cotwin::master {

namespace {

std::size_t columns_of_terminal() {
  winsize size{};
  const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return known ? size.ws_col : 80;
}

}  // namespace

std::optional<double> TimeLeft::update(double elapsed, double share) {
  if (!std::exchange(begun_, true) || share < share_) {
    begin_ = elapsed;
    time_ = done_ = 0;
  } else {
    // Memory of 10 s or a third of the time so far, whichever is longer.
    const double step = elapsed - elapsed_, memory = std::max(10.0, (elapsed - begin_) / 3);
    const double kept = std::exp(-step / memory);
    time_ = kept * time_ + step;
    done_ = kept * done_ + (share - share_);
  }
  elapsed_ = elapsed;
  share_ = share;
  constexpr double kFirst = 1;  // s
  if (elapsed - begin_ < kFirst || !(done_ > 0)) return std::nullopt;
  return (1 - share) * time_ / done_;
}

std::string duration_text(double seconds) {
  constexpr double kLongest = 1e9;  // s
  const auto s = static_cast<long long>(std::ceil(std::clamp(seconds, 0.0, kLongest)));
  const auto two = [](long long large, const char* unit, long long small, const char* other) {
    return std::to_string(large) + unit + (small > 0 ? " " + std::to_string(small) + other : std::string());
  };
  if (s < 60) return std::to_string(s) + " s";
  if (s < 3600) return two(s / 60, " min", s % 60, " s");
  if (s < 86400) return two(s / 3600, " h", s % 3600 / 60, " min");
  return two(s / 86400, " d", s % 86400 / 3600, " h");
}

std::string progress_text(const std::string& what, double share, std::optional<double> left, std::size_t columns) {
  constexpr std::size_t kMost = 40, kLeast = 4, kFrame = 4;  // "[", "] " and the last column, which stays free
  std::string line = what;
  if (left) line += ", " + duration_text(*left) + " left";
  if (columns < line.size() + kFrame + kLeast) return line.substr(0, columns > 1 ? columns - 1 : 0);
  const std::size_t width = std::min(kMost, columns - line.size() - kFrame);
  const auto full = static_cast<std::size_t>(std::clamp(share, 0.0, 1.0) * static_cast<double>(width));
  return "[" + std::string(full, '#') + std::string(width - full, '.') + "] " + line;
}

ProgressLine::ProgressLine(bool wanted) : shown_(wanted && isatty(STDERR_FILENO)) {}

ProgressLine::~ProgressLine() { clear(); }

void ProgressLine::clear() {
  if (drawn_) std::cerr << "\r\x1b[K" << std::flush;
  drawn_ = false;
}

bool ProgressLine::is_due() const { return shown_ && (!last_ || Clock::now() - *last_ >= std::chrono::milliseconds(100)); }

void ProgressLine::update(const std::string& what, double share) {
  if (!is_due()) return;
  last_ = Clock::now();
  drawn_ = true;
  const std::optional<double> left = left_.update(std::chrono::duration<double>(*last_ - begin_).count(), share);
  std::cerr << "\r\x1b[K" << progress_text(what, share, left, columns_of_terminal()) << std::flush;
}

}  // namespace cotwin::master
