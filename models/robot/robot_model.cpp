#include "models/robot/robot_model.h"

#include <algorithm>

#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::robot {

const Frame& RobotModel::frame(const std::string& wanted) const {
  std::vector<std::string> names;
  for (const Frame& frame : frames) {
    if (frame.name == wanted) return frame;
    names.push_back(frame.name);
  }
  const std::string close = text::closest(wanted, names);
  throw Error("robot '" + name + "'",
              "no frame '" + wanted + "'" + (close.empty() ? std::string() : ", did you mean '" + close + "'?"));
}

const Frame& RobotModel::end_effector() const {
  int last_body = -1;
  int longest = 0;
  std::vector<int> length;  // of the chain from the base, in joints
  for (int i = 0; i < n(); ++i) {
    const int parent = joints[static_cast<std::size_t>(i)].parent;
    length.push_back(1 + (parent < 0 ? 0 : length[static_cast<std::size_t>(parent)]));
    if (length.back() > longest) {
      longest = length.back();
      last_body = i;
    }
  }
  const auto found = std::find_if(frames.rbegin(), frames.rend(), [&](const Frame& f) { return f.body == last_body; });
  if (found == frames.rend()) throw Error("robot '" + name + "'", "no frame at the end of its longest chain");
  return *found;
}

}  // namespace cotwin::robot
