#pragma once
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"
#include "tests/support/unit_subject.h"

namespace cotwin::testing {

inline const std::filesystem::path kModels = std::filesystem::path(places::source()) / "models";
constexpr Duration kTick{1'000'000};

inline robot::RobotModel planar() { return robot::load_urdf(kModels / "robots/planar2/robot.urdf"); }

/// A unit with its variables by name, used as the master does.
class Subject : public UnitSubject {
 public:
  using UnitSubject::UnitSubject;
  std::vector<double> outputs() {
    std::vector<double> all;
    for (const Variable& v : instance_.variables) {
      if (v.role == Role::kOutput && v.kind() == Kind::kReal) all.insert(all.end(), v.reals().begin(), v.reals().end());
    }
    return all;
  }
  /// Every variable that it writes, and its memory, to the bit.
  std::vector<std::string> everything() {
    std::vector<std::string> all;
    for (const Variable& v : instance_.variables) {
      if (v.role != Role::kOutput && v.role != Role::kState) continue;
      if (v.kind() == Kind::kReal)
        for (const double x : v.reals()) all.push_back(std::to_string(std::bit_cast<std::uint64_t>(x)));
      if (v.kind() == Kind::kInteger)
        for (const std::int32_t x : v.integers()) all.push_back(std::to_string(x));
      if (v.kind() == Kind::kBoolean)
        for (const bool x : v.booleans()) all.push_back(x ? "true" : "false");
      if (v.kind() == Kind::kString) all.insert(all.end(), v.strings().begin(), v.strings().end());
    }
    instance_.unit->save_memory(all.emplace_back());
    return all;
  }
  Snapshot save() {
    Snapshot snapshot;
    snapshot.take(instance_.variables, *instance_.unit);
    return snapshot;
  }
  void restore(const Snapshot& snapshot, double now) {
    snapshot.restore(instance_.variables, *instance_.unit);
    now_ = Time::from_seconds(now);
  }
};

/// A motion that excites both joints, and the torques that a robot needs for it.
class Measured {
 public:
  explicit Measured(const robot::RobotModel& robot) : mechanism_(robot), data_(mechanism_), q_(2), dq_(2), ddq_(2), tau_(2) {}
  void at(double t, double shift = 0) {
    q_ << 0.8 * std::sin(1.7 * t + shift) + 0.5 * std::sin(4.1 * t),
        1.1 * std::cos(2.3 * t + 2 * shift) - 0.4 * std::sin(5.3 * t);
    dq_ << 1.36 * std::cos(1.7 * t + shift) + 2.05 * std::cos(4.1 * t),
        -2.53 * std::sin(2.3 * t + 2 * shift) - 2.12 * std::cos(5.3 * t);
    ddq_ << -2.312 * std::sin(1.7 * t + shift) - 8.405 * std::sin(4.1 * t),
        -5.819 * std::cos(2.3 * t + 2 * shift) + 11.236 * std::sin(5.3 * t);
    robot::inverse_dynamics(mechanism_, data_, q_, dq_, ddq_, tau_);
  }
  void feed(Subject& tuner) const {
    for (Eigen::Index i = 0; i < 2; ++i) {
      const auto j = static_cast<std::size_t>(i);
      tuner["q"][j] = q_[i];
      tuner["dq"][j] = dq_[i];
      tuner["tau"][j] = tau_[i];
    }
  }
  const Eigen::VectorXd& q() const { return q_; }
  const Eigen::VectorXd& dq() const { return dq_; }
  const Eigen::VectorXd& ddq() const { return ddq_; }
  const Eigen::VectorXd& tau() const { return tau_; }

 private:
  robot::Mechanism mechanism_;
  robot::Data data_;
  Eigen::VectorXd q_, dq_, ddq_, tau_;
};

inline Subject tuner_of_planar2(const std::string& settings = "") {
  Subject tuner("unit:tuner?robot=planar2&offset=false" + settings);
  tuner.set("interval", "4");
  tuner.set("latency", "0.5");
  tuner.set("rounds", "200");
  tuner.set("particles", "64");
  tuner.set("settle", "0.5");
  tuner.set("cutoff", "40");
  return tuner;
}

inline void run(Subject& tuner, Measured& robot, double from, double to) {
  for (int i = static_cast<int>(from * 1000 + 0.5); i < static_cast<int>(to * 1000 + 0.5); ++i) {
    robot.at(i * 1e-3);
    robot.feed(tuner);
    if (i == 0) tuner.initialise();
    tuner.step();
  }
}

}  // namespace cotwin::testing
