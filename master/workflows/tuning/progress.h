#pragma once
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

}  // namespace cotwin::master::tuning
