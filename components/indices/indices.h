#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/unit/joint_variables.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/robot/body_parameters.h"
#include "models/robot/body_parts.h"
#include "models/robot/drives/drive_parameters.h"
#include "models/robot/indices.h"

namespace cotwin::indices {

/// What a person feels and risks at a frame E of a robot that moves (V-B, VI-C): effective mass and inertia along u,
/// manipulability, reflected energy, speed limits against body parts. models/robot/indices.h has the equations. All outputs are
/// functions of the inputs at the step's end; nothing acts on the robot.
///
/// base=floating: M and J are those of the robot with its base, which recoils (robot::FloatingMechanism); kinematic ellipsoids
/// are those of the generalised Jacobian. Z and the singular values of Z and J* tell how the joints turn the base, and where they
/// cannot move the frame (V-C).
///
/// Body parts: collision with the reduced mass μ = (1/m + 1/m_H)⁻¹ at the speed of E along u, v_max = F_max/√(μ k_H); m is the larger
/// one of m_u and M/2 + m_L (ISO/TS 15066, A.3.4), or with robot_mass=effective m_u. The bodies of the robot and B may be changed during
/// the run; the values in force follow smoothly.
class Indices final : public Unit {
 public:
  static void declare_settings(SettingList& s);
  explicit Indices(Settings& settings);

  void declare(Variables& v) override;
  /// Throws Error for an unreadable table, an unknown body part, u = 0.
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;
  void restored() override;

 private:
  using Joints = std::vector<double>;
  enum class Along { kFrame, kWorld, kMotion };

  /// An ellipsoid as ports.
  struct EllipsoidPorts {
    double measure = 0;
    std::array<double, 9> axes{};
    std::array<double, 3> lengths{}, centre{};
    void write(const robot::Ellipsoid& ellipsoid, const Eigen::Matrix3d& R_WB);
  };

  /// A robot whose base floats.
  struct Floating {
    explicit Floating(const robot::RobotModel& robot)
        : mechanism(robot),
          data(mechanism),
          inertia(robot.n()),
          without_momentum(robot.n()),
          rows(robot.n(), 6),
          Z(3 * static_cast<std::size_t>(robot.n())) {}
    robot::FloatingMechanism mechanism;
    robot::FloatingData data;
    robot::FloatingInertia inertia;
    robot::FrameInertia without_momentum;  // of J* only
    Eigen::MatrixXd rows;                  // scratch of singular values (n x 6)
    // Outputs.
    Joints Z;
    std::array<double, 3> sigma_Z{};
    double sigma_min = 0;
  };

  Indices(Settings& settings, const robot::RobotModel& robot, bool floating);
  void declare_ellipsoid(Variables& v, const std::string& name, EllipsoidPorts& e, const std::string& what,
                         const std::string& length, const std::string& measure, bool with_centre);
  void check() const;
  void read_body_parts();
  void adopt_bodies();
  void update_motion(const Eigen::Matrix3d& R_WB);
  void compute();
  void compute_reaction();
  void compute_body_parts(double mass, double speed);
  void write_warning();
  Eigen::Vector3d direction(const Eigen::Vector3d& v_E, const Eigen::Matrix3d& R_WB) const;

  Settings settings_;
  std::string place_;  // for messages
  JointMeasures measures_;
  robot::Mechanism mechanism_;
  robot::Data data_;
  robot::BodyParameters bodies_;
  robot::FrameOnBody frame_;
  std::unique_ptr<Floating> floating_;  // nullptr: the base is fixed
  Along along_;
  bool held_;  // motors=held
  bool transient_, only_effective_;
  std::vector<std::size_t> passive_;    // joints without a motor
  std::vector<std::size_t> unlimited_;  // joints without a torque limit in the URDF
  std::vector<std::string> names_;      // of the selected body parts

  // Inputs.
  Joints q_, dq_;
  std::array<double, 4> base_quat_{1, 0, 0, 0};
  std::array<double, 3> base_v_{}, base_w_{};  // of a floating base
  // Parameters and tunables.
  std::array<double, 3> u_{0, 0, 1};
  double margin_ = 0, area_ = 0, transition_ = 0.05, load_ = 0;
  Joints tau_max_;
  std::string body_parts_ = "people/iso_ts_15066.csv";
  robot::DriveParameters drive_;
  // States.
  Joints B_;                        // in force
  std::vector<std::int32_t> fast_;  // 1: the speed was above the limit of this part
  // Outputs.
  double mass_ = 0, inertia_ = 0, speed_ = 0, energy_ = 0, simple_mass_ = 0;
  Joints gradient_;
  EllipsoidPorts kin_v_, kin_w_, dyn_v_, dyn_w_;
  Joints mu_, collision_, v_max_;
  std::string warning_;

  std::vector<robot::BodyPart> parts_;  // selected
  double moving_mass_ = 0;              // kg, in force
  // Of a floating robot with the six joints of its base first.
  Eigen::VectorXd q_all_, dq_all_, tau_max_all_, gradient_all_;
  robot::FrameInertia inertia_at_E_;
  robot::Manipulability kinematic_, dynamic_;
};

}  // namespace cotwin::indices
