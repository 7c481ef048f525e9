#pragma once
#include <chrono>
#include <functional>
#include <thread>

namespace cotwin::testing {

/// Waits until the condition holds, for a minute at most: longer than any loaded machine needs. False: it never held.
inline bool within_patience(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

}  // namespace cotwin::testing
