#include <algorithm>

#include "components/motion/poses.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"

namespace cotwin::motion {

using Eigen::VectorXd;

namespace {

constexpr double kNearSingular = 0.02;  // m/rad: smaller singular values are reported

robot::PostureChoice choice_of(Settings& settings) {
  using Kind = robot::PostureChoice::Kind;
  robot::PostureChoice choice;
  choice.kind = text::choose<Kind>(
      "unit:motion: null_space", settings.choice("null_space"),
      {{"reference", Kind::kReference}, {"centre", Kind::kCentre}, {"joint", Kind::kJoint}, {"arm", Kind::kArmAngle}});
  if (choice.kind == Kind::kJoint) choice.joint = static_cast<int>(settings.integer("null_joint")) - 1;
  return choice;
}

}  // namespace

void JointsOfPoses::declare_settings(SettingList& s) {
  s.boolean("inverse", false, "space=cartesian: also the joint motion as output, by inverse kinematics; needs a robot");
  s.choice(
      "null_space", {"reference", "centre", "joint", "arm"},
      "inverse=true: posture of a robot with more joints than task directions; reference: closest to q_start; centre: closest "
      "to the middle of the joint limits; joint: null_joint at null_value; arm: arm angle null_value of a chain of seven "
      "joints");
  s.integer("null_joint", 1, 1, 1000, "null_space=joint: number of the joint");
  s.text("directions", "all", "inverse=true: directions that the frame has to follow, some of x,y,z,rx,ry,rz, or all");
  s.choice("directions_of", {"base", "tool"}, "directions: frame whose axes are meant");
}

JointsOfPoses::JointsOfPoses(Settings& settings, const robot::RobotModel& robot)
    : kinematics_(std::make_unique<robot::InverseKinematics>(
          robot, frame_of(settings, robot),
          robot::task_directions(settings.text("directions"), settings.choice("directions_of") == "tool"),
          choice_of(settings))) {
  const robot::PostureChoice& choice = kinematics_->choice();
  prismatic_ = choice.kind == robot::PostureChoice::Kind::kJoint &&
               robot.joints[static_cast<std::size_t>(choice.joint)].type == robot::JointType::kPrismatic;
}

void JointsOfPoses::declare_outputs(Variables& v) {
  v.output("sigma_min", sigma_min_, "1",
           "smallest singular value of the Jacobian of the directions, rotations times 0.3 m; 0: singular posture");
  v.output("inverse_error", inverse_error_, "1",
           "largest error of the pose between the computed postures before correction, m or rad");
}

void JointsOfPoses::declare_parameters(Variables& v, bool by_start) {
  using Kind = robot::PostureChoice::Kind;
  const Kind kind = kinematics_->choice().kind;
  if (by_start || (kind != Kind::kJoint && kind != Kind::kArmAngle)) return;
  v.parameter("null_value", value_, prismatic_ ? "m" : "rad",
              kind == Kind::kJoint ? "position of joint null_joint" : "arm angle, 0 with the elbow upwards");
}

void JointsOfPoses::prepare(const trajectory::PosePath& poses, const RobotInWorld& robot, std::span<const double> q_start,
                            bool from_start, std::string& warning) {
  const Eigen::Map<const VectorXd> reference(q_start.data(), static_cast<Eigen::Index>(q_start.size()));
  const Pose X_WB{robot.Q_WB().toRotationMatrix(), robot.p_WB()}, X_BW = X_WB.inverse();
  VectorXd start = reference;
  kinematics_->set_value(value_);
  if (from_start) {
    using Kind = robot::PostureChoice::Kind;
    const Kind kind = kinematics_->choice().kind;
    if (kind == Kind::kJoint || kind == Kind::kArmAngle) kinematics_->set_value(kinematics_->value_of(reference));
  } else {
    const trajectory::PoseMotion first = poses.at(poses.begin());
    const Eigen::Quaterniond Q(first.Q[0], first.Q[1], first.Q[2], first.Q[3]);
    const robot::Posture posture = kinematics_->solve({X_BW * first.p, robot.Q_WB().conjugate() * Q}, reference);
    if (!posture.reached) throw Error("motion: inverse kinematics at the first waypoint", posture.message);
    start = posture.q;
  }
  path_.emplace(poses, X_WB, *kinematics_, reference, start);
  inverse_error_ = path_->table_error();
  if (path_->least_sigma().value < kNearSingular) {
    warning += (warning.empty() ? "motion: " : "; motion: ") + std::string("the posture is nearly singular at ") +
               text::to_text(path_->least_sigma().t - poses.begin(), 6) + " s: smallest singular value " +
               text::to_text(path_->least_sigma().value, 3);
  }
}

void JointsOfPoses::at(double t, std::span<double> q, std::span<double> dq, std::span<double> ddq) {
  path_->at(t, q, dq, ddq);
  sigma_min_ = path_->sigma_min(t);
}

}  // namespace cotwin::motion
