#include "models/robot/robot_model.h"

#include <algorithm>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::robot {

const Frame& RobotModel::frame(const std::string& wanted) const {
  std::vector<std::string> names;
  for (const Frame& frame : frames) {
    if (frame.name == wanted) return frame;
    names.push_back(frame.name);
  }
  const std::string close = text::closest(wanted, names);
  const std::string all = text::joined(names);
  throw Error("robot '" + name + "'",
              "no frame '" + wanted + "'" + (close.empty() ? ", expected one of " + all : ", did you mean '" + close + "'?"));
}

const Joint& RobotModel::joint_of(int body) const {
  return body < n() ? joints[static_cast<std::size_t>(body)] : mimics[static_cast<std::size_t>(body - n())].joint;
}

int RobotModel::leader_of(int body) const { return body < n() ? body : mimics[static_cast<std::size_t>(body - n())].leader; }

std::vector<int> RobotModel::depth_first() const {
  std::vector<int> order;
  int next = 0;
  for (int k = 0; k < body_count() - n(); ++k) {
    while (next < n() && static_cast<int>(order.size()) < mimics[static_cast<std::size_t>(k)].place) order.push_back(next++);
    order.push_back(n() + k);
  }
  while (next < n()) order.push_back(next++);
  return order;
}

bool RobotModel::moves(int joint, int body) const {
  while (body >= 0 && leader_of(body) != joint) body = joint_of(body).parent;
  return body >= 0;
}

const Frame& RobotModel::end_effector() const {
  int last_body = -1;
  int longest = 0;
  std::vector<int> length(static_cast<std::size_t>(body_count()));  // of the chain from the base, in joints
  for (const int i : depth_first()) {
    const int parent = joint_of(i).parent;
    int& own = length[static_cast<std::size_t>(i)];
    own = 1 + (parent < 0 ? 0 : length[static_cast<std::size_t>(parent)]);
    if (own > longest || (own == longest && i < last_body)) {
      longest = own;
      last_body = i;
    }
  }
  const auto found = std::find_if(frames.rbegin(), frames.rend(), [&](const Frame& f) { return f.body == last_body; });
  if (found == frames.rend()) throw Error("robot '" + name + "'", "no frame at the end of its longest chain");
  return *found;
}

}  // namespace cotwin::robot
