// V-C, Fig. 7: the same goal with the standard motion, which turns the base, and with a motion that does not (examples/22_reactionless).
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "components/services/json/json.h"
#include "master/services/motion_file.h"
#include "models/numerics/dense.h"
#include "models/robot/floating_base.h"
#include "models/robot/frame_kinematics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/recording.h"
#include "tests/support/run_program.h"
#include "tests/support/unit_subject.h"

namespace cotwin::master::fig7_reactionless_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;
using nlohmann::json;
using testing::UnitSubject;

const std::filesystem::path kExample = std::filesystem::path(places::source()) / "examples/22_reactionless";
const std::string kRobot = (kExample / "satellite.urdf").string();
constexpr double kT = 4;  // s
const std::vector<double> kFrom{0, 0.5, 0, -1.4, 0, 0.8, 0}, kTo{0.4, -0.6, -0.1, -1.9, -0.9, -0.3, 0.6};

class Fig7Satellite : public ::testing::Test {
 protected:
  /// Where the tip is, seen from the base, and the centre of mass.
  std::pair<Vector3d, Vector3d> places(const std::vector<double>& q) {
    const auto posture = Eigen::Map<const VectorXd>(q.data(), 7);
    floating_inertia(mechanism_, data_, posture, inertia_);
    return {kinematics_.jacobian(posture, J_).p, inertia_.p_C};
  }

  const robot::RobotModel robot_ = robot::load_urdf(kRobot);
  const robot::FloatingMechanism mechanism_{robot_};
  robot::FloatingData data_{mechanism_};
  robot::FloatingInertia inertia_{7};
  robot::FrameKinematics kinematics_{robot_, robot_.end_effector()};
  Eigen::MatrixXd J_{6, 7};
};

/// With a motion that was found in a shorter search than the example's.
class Fig7 : public Fig7Satellite {
 protected:
  Fig7() {
    services::Robots robots({kExample.string()});
    const json request{{"service", "reactionless"},
                       {"robot", "satellite"},
                       {"from_q_rad", kFrom},
                       {"to_q_rad", kTo},
                       {"to_pose", {{"directions", {"x", "y", "z"}}}},
                       {"T_s", kT},
                       {"particles", 16},
                       {"rounds", 10},
                       {"detail", "all"}};
    reply_ = json::parse(services::answer(robots, request.dump()));
    file_ = std::make_unique<testing::TemporaryFile>(motion_file(reply_["motion"].dump()));
  }
  double turn_of_standard() const { return reply_["standard"]["turn_rad"]; }

  json reply_;
  std::unique_ptr<testing::TemporaryFile> file_;
};

// The first four joints have most of the arm's momentum, and they alone move the wrist's centre; a probe moves with the wrist, too.
TEST_F(Fig7Satellite, ReactionlessSpeedsMoveAProbeInAllDirectionsAndTheWristHardlyInOne) {
  const auto posture = Eigen::Map<const VectorXd>(kFrom.data(), 7);
  floating_inertia(mechanism_, data_, posture, inertia_);
  const Eigen::MatrixXd N = numerics::svd(inertia_.Z()).V.rightCols(4);
  const auto speeds = [&](const char* frame) {
    generalised_jacobian(mechanism_, data_, inertia_, posture, robot::on_body(robot_.frame(frame)), J_);
    return numerics::singular_values(J_.topRows<3>() * N);
  };
  EXPECT_GT(speeds("probe").minCoeff(), 0.07);  // m/s at a joint speed of norm 1 rad/s
  EXPECT_LT(speeds("link_7").minCoeff(), 0.003);
}

// Torques by M* q̈ + b*, without control. The world keeps the angular momentum, so that its base turns with its error in q, of order 2.
TEST_F(Fig7, TheWrittenMotionDoesNotTurnTheBaseAndTheContactWorldAgreesToSecondOrder) {
  ASSERT_TRUE(reply_["reactionless"].get<bool>()) << reply_["notes"];
  UnitSubject motion("unit:motion?kind=csv&robot=" + kRobot);
  motion.set("file", file_->path());
  motion.initialise();
  double fastest = 0;
  for (double t = 0; t < kT; t += 0.37e-3) {
    motion.at(t);
    floating_inertia(mechanism_, data_, motion.joints("q_d"), inertia_);
    fastest = std::max(fastest, (inertia_.Z() * motion.joints("dq_d")).norm());
  }
  EXPECT_LT(fastest, 1e-9);

  const auto turn_in_world = [&](double h) {
    UnitSubject world("unit:contact_world?link_side=outside&base=floating&robot_shapes=none&robot=" + kRobot);
    world.set("gravity", {0, 0, 0}).set("q0", kFrom);
    world.initialise();
    VectorXd tau(7);
    double turn = 0;
    for (int k = 0; k < std::lround(kT / h); ++k) {
      motion.at((k + 0.5) * h);
      const VectorXd q = motion.joints("q_d");
      floating_inertia(mechanism_, data_, q, inertia_);
      reduced_inverse_dynamics(mechanism_, data_, inertia_, q, motion.joints("dq_d"), motion.joints("ddq_d"), Vector3d::Zero(),
                               Wrench::Zero(), tau);
      world.set("tau_J", std::vector<double>(tau.begin(), tau.end()));
      world.step(h);
      const auto Q = world["base_quat"];
      turn = std::max(turn, 2 * Vector3d(Q[1], Q[2], Q[3]).norm());
    }
    return turn;
  };
  const double coarse = turn_in_world(4e-3), middle = turn_in_world(2e-3), fine = turn_in_world(1e-3);
  EXPECT_LT(fine, 1e-4 * turn_of_standard());
  EXPECT_NEAR(coarse / middle, 4, 0.2) << coarse;
  EXPECT_NEAR(middle / fine, 4, 0.1) << middle;
}

// The base does not turn, so the place that the tip is to reach follows from the centre of mass, which rests.
TEST_F(Fig7, TheElasticTwinKeepsItsAttitudeAndReachesThePlaceThatTheStandardMotionMisses) {
  const testing::TemporaryFolder results("fig7");
  const testing::RunResult run =
      testing::run_program({"run", (kExample / "reactionless.ssd").string(), "--quiet", "--out", results.path().string(),
                            "--set", "reactionless_motion.file=" + file_->path()});
  ASSERT_EQ(run.code, 0) << run.err;
  const auto columns = testing::read_recording(results / "signals.csv");
  const auto row = [&](const std::string& name, std::size_t size, std::size_t k) {
    std::vector<double> x;
    for (std::size_t i = 1; i <= size; ++i) x.push_back(columns.at("world." + name + "[" + std::to_string(i) + "]")[k]);
    return x;
  };
  const auto attitude = [&](const std::string& robot, std::size_t k) {
    const std::vector<double> Q = row(robot + ".base_quat", 4, k);
    return Quaterniond(Q[0], Q[1], Q[2], Q[3]);
  };
  const std::size_t last = columns.at("time").size() - 1;
  double turn = 0;
  for (std::size_t k = 0; k <= last; ++k)
    turn = std::max(turn, attitude("reactionless", k).angularDistance(Quaterniond::Identity()));
  EXPECT_NEAR(attitude("standard", last).angularDistance(Quaterniond::Identity()), turn_of_standard(), 1e-6);
  EXPECT_GT(turn_of_standard(), 0.4);
  EXPECT_LT(turn, 1e-4 * turn_of_standard());
  const auto [tip, centre] = places(kTo);
  const Vector3d goal = tip + places(kFrom).second - centre;
  const auto missed = [&](const std::string& robot, double y) {
    const std::vector<double> p = row(robot + ".base_p", 3, last);
    return (Vector3d(p[0], p[1] - y, p[2] - 1) + attitude(robot, last) * places(row(robot + ".q", 7, last)).first - goal)
        .norm();
  };
  EXPECT_LT(missed("reactionless", 0.8), 1e-5);
  EXPECT_NEAR(missed("standard", -0.8), 0.38675, 1e-5);
}

}  // namespace
}  // namespace cotwin::master::fig7_reactionless_test
