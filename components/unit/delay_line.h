#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "components/unit/time.h"
#include "components/unit/variables.h"

namespace cotwin {

/// A signal of `width` reals as it was some time ago: a ring of its last `capacity` samples, all of it declared as states.
class DelayLine {
 public:
  DelayLine(std::size_t width, std::size_t capacity);

  /// Declares the states `<name>`, `<name>_t` and `<name>_place`. `what`: the signal, for the descriptions.
  void declare(Variables& v, const std::string& name, const std::string& si, const std::string& what);
  /// Forgets all samples; the signal has had this value at all times before `now`.
  void start(Time now, std::span<const double> value);
  /// Adds the sample at `now`, in place of the latest one if that has the same time, else later than it. Replaces the oldest one
  /// if the ring is full.
  void push(Time now, std::span<const double> value);
  /// Writes the signal at `t`: a sample with all its bits, a linear interpolation between two samples, the first value before
  /// the start, the last one after the last sample. Returns false, and writes nothing, if the samples for it were replaced.
  bool at(Time t, std::span<double> value) const;
  /// The last sample, after start().
  std::span<const double> latest() const { return sample(0); }

 private:
  std::size_t slot(std::size_t age) const;
  double nanoseconds(std::size_t age) const;
  std::span<const double> sample(std::size_t age) const { return std::span(x_).subspan(slot(age) * width_, width_); }
  std::size_t held() const;

  std::size_t width_, capacity_;
  std::vector<double> x_, t_;                    // sample by sample; s
  std::vector<std::int32_t> place_ = {0, 0, 0};  // slot of the latest sample; samples held; whether the first one was replaced
};

}  // namespace cotwin
