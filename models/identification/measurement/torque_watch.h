#pragma once
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "models/trajectory/axes.h"

namespace cotwin::measurement {

/// Watches the torque of a joint, in the rows in which the joint moves, for values that are cut off and for standstill.
class TorqueWatch {
 public:
  /// The next row; t: s. True at the end of the longest way so far that took a second or more at the same torque.
  bool add(double t, double q, double tau, bool begins);
  /// Sentences. `place`: of the column; `frozen`: of the row for which add() was true last.
  std::vector<std::string> damage(const trajectory::Axis& axis, const std::string& place, const std::string& frozen) const;

 private:
  /// The greatest value and the next one below it, and how often they occur.
  struct Top {
    double first = -std::numeric_limits<double>::infinity(), second = first;
    std::size_t of_first = 0, of_second = 0;
    void add(double x);
  };

  Top top_, bottom_;                       // of τ and −τ
  std::size_t moving_ = 0, changes_ = 0;   // rows with motion; of them with another torque than the row before
  double q_ = 0, q_min_ = 0, q_max_ = 0;   // of the row before; of all rows
  double tau_ = 0, since_ = 0, from_ = 0;  // the torque, since when it is the same, and from which position
  double way_ = 0, time_ = 0;              // the longest standstill
  bool empty_ = true;
};

}  // namespace cotwin::measurement
