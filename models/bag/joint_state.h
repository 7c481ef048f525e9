#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "models/bag/cdr.h"

namespace cotwin::bag {

/// Reads sensor_msgs/JointState messages of a topic, whose joints may have another order in each.
class JointStates {
 public:
  static constexpr std::size_t kQuantities = 3;  // position, velocity, effort
  static constexpr std::array<const char*, kQuantities> kNames = {"position", "velocity", "effort"};

  /// The joints of a message, by their indices in joints().
  struct Layout {
    std::vector<std::size_t> joints;
  };

  JointStates() = default;
  JointStates(JointStates&&) = default;

  /// Reads a message: `values[k]` has a value per joint of the layout, or is empty. Throws Fault.
  const Layout& read(Cdr& message, std::array<std::vector<double>, kQuantities>& values);
  const std::vector<std::string>& joints() const { return joints_; }  // so far, in the order of their first messages
  /// Number of different sets of joints that messages have had.
  std::size_t sets() const { return sets_.size(); }

 private:
  std::vector<std::string> joints_;
  std::map<std::string, std::size_t, std::less<>> index_;  // in joints_
  std::set<std::vector<std::size_t>> sets_;                // sorted; the first ones
  std::map<std::string, Layout, std::less<>> layouts_;     // the last ones, by the bytes of the names
  std::pair<const std::string, Layout>* last_ = nullptr;
};

}  // namespace cotwin::bag
