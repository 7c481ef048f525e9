#include "models/anomaly/event.h"

#include <cmath>

#include "models/foundation/support/text.h"

namespace cotwin::anomaly {

std::string describe(const Event& event, const TorqueModel& model, const std::vector<robot::Joint>& joints) {
  const std::size_t j = static_cast<std::size_t>(event.joint);
  const bool slide = joints[j].type == robot::JointType::kPrismatic;
  const std::string torque = text::to_text(std::abs(event.torque), 2) + (slide ? " N" : " N.m"),
                    at = " at joint " + std::to_string(j + 1);
  if (event.brief) return "a blow: the torque was off by up to " + (event.torque < 0 ? "-" + torque : torque) + at;
  const std::string cause =
      event.other == event.cause ? to_text(event.cause) : std::string(to_text(event.cause)) + " or " + to_text(event.other);
  if (event.spread)
    return cause + ": residuals" + at + " scatter " + text::to_text(event.size, 2) + " times as much, " + torque;
  const auto signed_text = [&](double factor, const char* unit) {
    const double size = factor * event.size;
    return " " + std::string(size < 0 ? "" : "+") + text::to_text(size, 2) + " ± " +
           text::to_text(factor * event.deviation, 1) + unit;
  };
  switch (event.cause) {
    case Cause::kLoad:
      return cause + signed_text(1, " kg") + ", " + torque + at;
    case Cause::kFriction:
      if (model.has_friction(event.joint)) return cause + at + signed_text(100, " %") + ", " + torque;
      break;
    case Cause::kContact:
      break;
    case Cause::kEncoder: {
      const int k = model.joint(event.which);
      const bool linear = joints[static_cast<std::size_t>(k)].type == robot::JointType::kPrismatic;
      return cause + " of joint " + std::to_string(k + 1) + signed_text(1, linear ? " m" : " rad") + ", " + torque + at;
    }
  }
  return cause + at + signed_text(1, slide ? " N" : " N.m");
}

}  // namespace cotwin::anomaly
