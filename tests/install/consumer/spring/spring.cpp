#include "spring.h"

#include <cmath>

#include "models/robot/robot_model.h"

namespace cotwin::spring {

void Spring::declare_settings(SettingList& s) { s.robot("a robot: one spring for each of its joints; none: one spring"); }

Spring::Spring(Settings& settings) {
  const std::size_t n = settings.text("robot").empty() ? 1 : settings.robot(Settings::Masses::kUnused).joints.size();
  for (auto* values : {&f_, &x_, &v_, &position_}) values->resize(n);
}

void Spring::declare(Variables& v) {
  v.parameter("m", m_, "kg", "mass of each body").range(1e-6, 1e6);
  v.tunable("k", k_, "N/m", "stiffness of each spring").range(1e-6, 1e9);
  v.input("f", f_, "N", "force on the bodies");
  v.state("x", x_, "m", "distance from the unloaded position");
  v.state("v", v_, "m/s", "speed of the bodies");
  v.output("position", position_, "m", "distance from the unloaded position, x");
}

void Spring::initialise(Time) { position_ = x_; }

StepResult Spring::step(Time, Duration h) {
  const double omega = std::sqrt(k_ / m_), c = std::cos(omega * h.seconds()), s = std::sin(omega * h.seconds());
  for (std::size_t i = 0; i < x_.size(); ++i) {
    const double rest = f_[i] / k_, x = x_[i] - rest, v = v_[i];
    x_[i] = rest + c * x + s / omega * v;
    v_[i] = c * v - omega * s * x;
  }
  position_ = x_;
  return StepResult::kDone;
}

}  // namespace cotwin::spring
