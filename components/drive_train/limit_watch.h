#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "components/drive_train/equations.h"
#include "models/robot/robot_model.h"

namespace cotwin::drive_train {

/// Sees joints pass their limits. Limits without a stop do not act; a stop is an elastic one, so that joints pass a little into it.
class LimitWatch {
 public:
  explicit LimitWatch(std::vector<robot::Joint> joints);

  const std::vector<robot::Joint>& joints() const { return joints_; }
  void clear();
  /// To be called at the end of a step, at the time t (s).
  void look(const double* q, const Parameters& p, double t);
  /// Number of joints that have passed a limit.
  std::size_t count() const;
  /// Appends to `text` which joint passed which limit first and when. Allocates nothing if the text has room for 200 characters.
  void describe(const Parameters& p, std::string& text) const;

  std::vector<double> passed_at, passed_below;  // s: when each joint first passed its upper and its lower limit; -1: never

 private:
  std::vector<robot::Joint> joints_;
};

}  // namespace cotwin::drive_train
