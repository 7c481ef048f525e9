#include "master/program/tuning/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <iostream>

namespace cotwin::master::tuning {

ProgressLine::ProgressLine(bool wanted) : shown_(wanted && isatty(STDERR_FILENO)) {}

ProgressLine::~ProgressLine() { clear(); }

void ProgressLine::clear() {
  if (drawn_) std::cerr << "\r\x1b[K" << std::flush;
  drawn_ = false;
}

void ProgressLine::update(const std::string& what, double share) {
  if (!shown_) return;
  const auto now = std::chrono::steady_clock::now();
  if (drawn_ && now - last_ < std::chrono::milliseconds(100)) return;
  last_ = now;
  drawn_ = true;
  winsize size{};
  const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  const std::size_t columns = known ? size.ws_col : 80;
  constexpr std::size_t kMost = 40, kFrame = 4;  // "[", "] " and the last column, which stays free
  std::string line = what.substr(0, columns > 1 ? columns - 1 : 0);
  if (columns > what.size() + kFrame + 4) {
    const std::size_t width = std::min(kMost, columns - what.size() - kFrame);
    const std::size_t full = static_cast<std::size_t>(std::clamp(share, 0.0, 1.0) * static_cast<double>(width));
    line = "[" + std::string(full, '#') + std::string(width - full, '.') + "] " + what;
  }
  std::cerr << "\r\x1b[K" << line << std::flush;
}

}  // namespace cotwin::master::tuning
