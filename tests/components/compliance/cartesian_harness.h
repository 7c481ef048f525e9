#pragma once
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "components/unit/unit_table.h"
#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"
#include "tests/support/unit_subject.h"

/// The compliance unit with space=cartesian, alone or with the drive train of its robot.
namespace cotwin::testing {

constexpr Duration kMillisecond{1'000'000};

inline Eigen::VectorXd lwr4_posture() {
  Eigen::VectorXd q(7);
  q << 0.2, 0.6, -0.3, -1.2, 0.4, 0.9, 0.1;
  return q;
}

class Subject : public UnitSubject {
 public:
  Subject(const std::string& source, const std::string& robot)
      : UnitSubject(source + (source.find('?') == std::string::npos ? '?' : '&') + "robot=" + robot) {}

  Eigen::Map<Eigen::VectorXd> operator[](const char* name) const {
    const std::span<double> reals = variables().at(name).reals();
    return {reals.data(), static_cast<Eigen::Index>(reals.size())};
  }
  void initialise() { start(); }
  double value(const char* name) const { return (*this)[name][0]; }
  std::string warning() const { return text("warning"); }
};

/// Kinematics of a robot of the project by name, for comparisons.
class Kinematics {
 public:
  explicit Kinematics(const std::string& robot, const std::string& frame = "")
      : model_(robot::load_urdf(std::filesystem::path(places::source()) / "models/robots" / robot / "robot.urdf")),
        mechanism_(model_),
        data_(mechanism_),
        frame_(robot::on_body(frame.empty() ? model_.end_effector() : model_.frame(frame))) {}
  Pose at(const Eigen::VectorXd& q) { return robot::forward_kinematics(mechanism_, data_, q, frame_); }
  Eigen::MatrixXd jacobian(const Eigen::VectorXd& q) {
    Eigen::MatrixXd J(6, q.size());
    robot::jacobian(mechanism_, data_, q, frame_, J);
    return J;
  }

 private:
  robot::RobotModel model_;
  robot::Mechanism mechanism_;
  robot::Data data_;
  robot::FrameOnBody frame_;
};

inline Eigen::VectorXd quaternion_values(const Eigen::Quaterniond& Q) { return Eigen::Vector4d(Q.w(), Q.x(), Q.y(), Q.z()); }
inline Eigen::Quaterniond quaternion(const Eigen::VectorXd& v) { return {v[0], v[1], v[2], v[3]}; }

/// The desired pose of `unit` is X.
inline void desire(const Subject& unit, const Pose& X) {
  unit["p_d"] = X.p;
  unit["quat_d"] = quaternion_values(Eigen::Quaterniond(X.R));
}

/// Controller and drive train.
class CartesianLoop {
 public:
  CartesianLoop(const std::string& query, const std::string& robot)
      : unit("unit:compliance?space=cartesian" + query, robot), drive("unit:drive_train", robot) {}

  /// At rest at `q`; the desired pose must be set.
  void start(const Eigen::VectorXd& q) {
    drive["q0"] = q;
    drive.initialise();
    exchange();
    unit.initialise();
  }
  void step() {
    exchange();
    unit.step();
    drive["tau_m"] = unit["tau_m"];
    drive["tau_e"] = unit["tau_wrench"];
    drive.step();
  }
  /// `push` sets tau_e of the drive train, in each part of the step.
  void step_parts(int parts, const std::function<void(Subject&)>& push) {
    exchange();
    unit.step();
    drive["tau_m"] = unit["tau_m"];
    for (int k = 0; k < parts; ++k) {
      push(drive);
      drive.step(Duration{kMillisecond.ns / parts});
    }
  }

  Subject unit, drive;

 private:
  void exchange() {
    for (const char* name : {"q", "dq", "theta", "dtheta"}) unit[name] = drive[name];
  }
};

}  // namespace cotwin::testing
