// VI-G, Fig. 17: a fixed cell and its free twins exchange a block of a satellite by the same joint commands (examples/24_satellite_servicing).
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "components/services/json/json.h"
#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "master/scenario/scenario.h"
#include "models/robot/floating_base.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/sdf/sdf.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::master::fig17_servicing_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;
using nlohmann::json;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::StartsWith;

const std::filesystem::path kExample = std::filesystem::path(places::source()) / "examples/24_satellite_servicing";
const VectorXd kHome = (VectorXd(14) << 0, 0, 0, 1.8, 0, -1.341593, 0, 0, 0, 0, 1.8, 0, -1.341593, 0).finished();
const VectorXd kCapture =
    (VectorXd(14) << -0.003107, -1.382568, 0.029749, 1.480932, -1.576456, -1.599572, -1.849016, 0, 0, 0, 1.8, 0, -1.341593, 0)
        .finished();  // second row of plan.csv

/// A run of the example.
class Servicing {
 public:
  explicit Servicing(const std::string& scenario, const std::vector<std::string>& set = {}, double tick = 1e-3) {
    Scenario read = load_scenario(kExample / scenario);
    for (const std::string& assignment : set) assign(read, assignment, unit_types());
    read.tick = Duration{std::llround(tick * 1e9)};
    read.recording.clear();
    MasterOptions options;
    options.types = unit_types();
    options.folders = {read.folder, std::filesystem::path(places::source()) / "models"};
    master_ = std::make_unique<Master>(std::move(read), std::move(options));
    master_->initialise();
  }
  void to(double t) {
    while (master_->now().seconds() < t - 1e-9) ASSERT_TRUE(master_->step_tick());
  }
  bool step() { return master_->step_tick(); }
  double now() const { return master_->now().seconds(); }
  Summary summary() const { return master_->summary(); }
  VectorXd values(const std::string& name) const {
    const auto reals = find_signal(master_->members(), name, "").variable->reals();
    return Eigen::Map<const VectorXd>(reals.data(), static_cast<Eigen::Index>(reals.size()));
  }
  double value(const std::string& name) const { return values(name)[0]; }
  bool is(const std::string& name) const { return find_signal(master_->members(), name, "").variable->booleans()[0]; }
  Quaterniond attitude(const std::string& name) const {
    const VectorXd Q = values(name);
    return {Q[0], Q[1], Q[2], Q[3]};
  }
  /// Turn of the free base since the start, rad.
  double turn() const { return attitude("free_world.base_quat").angularDistance(Quaterniond::Identity()); }

 private:
  std::unique_ptr<Master> master_;
};

/// Momentum of the free twins, satellite and blocks about W's origin, from what the world shows.
class Momentum {
 public:
  /// Also Σ of the sizes of the momenta of robot and bodies.
  Wrench of(const Servicing& run, double* size) {
    const Matrix3d R = run.attitude("free_world.base_quat").toRotationMatrix();
    Twist V;
    V << R.transpose() * run.values("free_world.base_v"), R.transpose() * run.values("free_world.base_w");
    robot::floating_inertia(mechanism_, data_, run.values("free_world.q"), inertia_);
    const Wrench h = inertia_.momentum(V, run.values("free_world.dq"));
    Wrench sum = Wrench::Zero();
    *size = 0;
    const auto add = [&](const Vector3d& p, const Vector3d& L) {
      sum.head<3>() += p;
      sum.tail<3>() += L;
      *size += p.norm() + L.norm();
    };
    const Vector3d p = R * h.head<3>();
    add(p, R * h.tail<3>() + Vector3d(run.values("free_world.base_p")).cross(p));
    for (const scene::Body& body : scene_.bodies) {
      const std::string name = "free_world." + body.name;
      const Matrix3d R_B = run.attitude(name + ".quat").toRotationMatrix();
      const Vector3d w = run.values(name + ".w"),
                     momentum = body.inertia.mass * run.values(name + ".v");  // their frames are their centres
      add(momentum, R_B * body.inertia.I_CC * R_B.transpose() * w + Vector3d(run.values(name + ".p")).cross(momentum));
    }
    return sum;
  }

 private:
  const robot::RobotModel robot_ = robot::load_urdf((kExample / "servicer.urdf").string());
  const scene::Scene scene_ = scene::load(kExample / "servicing.sdf");
  const robot::FloatingMechanism mechanism_{robot_};
  robot::FloatingData data_{mechanism_};
  robot::FloatingInertia inertia_{14};
};

/// The turn of the free base that the service `reaction` predicts for the approach, rad.
double predicted_turn() {
  services::Robots robots({kExample.string()});
  const json request{{"service", "reaction"},
                     {"robot", "servicer"},
                     {"from_q_rad", std::vector<double>(kHome.begin(), kHome.end())},
                     {"to_q_rad", std::vector<double>(kCapture.begin(), kCapture.end())},
                     {"T_s", 4}};
  return json::parse(services::answer(robots, request.dump()))["end"]["turn_rad"];
}

TEST(Fig17, TheFreeTwinsExchangeTheBlockByTheCommandsOfTheFixedCellAndKeepTheirMomentum) {
  Servicing run("servicing.ssd");
  Momentum momentum;
  double size = 0, largest = 0, drift = 0;
  const Wrench before = momentum.of(run, &size);
  EXPECT_LT((run.values("motion.q_d") - kHome).norm(), 1e-9);
  double turn = 0;
  for (int k = 1; run.step(); ++k) {
    ASSERT_EQ(run.values("free_control.q_d"), run.values("fixed_control.q_d"));
    if (k % 20 != 0) continue;
    drift = std::max(drift, (momentum.of(run, &size) - before).norm());
    largest = std::max(largest, size);
    if (std::abs(run.now() - 4.18) < 1e-9) turn = run.turn();
  }
  EXPECT_LT(drift, 1e-10 * largest) << largest;
  EXPECT_GT(largest, 5);  // N s and N m s
  EXPECT_NEAR(turn / predicted_turn(), 1, 1e-3);
  EXPECT_GT(turn, 0.1);
  for (const std::string world : {"free_world.", "fixed_world."}) {
    EXPECT_TRUE(run.is(world + "hold.closed") && run.is(world + "dock_4.closed")) << world;
    EXPECT_FALSE(run.is(world + "grip.closed") || run.is(world + "dock_1.closed")) << world;
    EXPECT_LT(run.value(world + "dock_4.distance"), 1e-5) << world;
  }
  // The block's seat relative to the satellite is that of the plan in both.
  for (const std::string world : {"free_world.", "fixed_world."}) {
    const Quaterniond Q = run.attitude(world + "satellite.quat");
    const Vector3d p = Q.conjugate() * (run.values(world + "block_1.p") - run.values(world + "satellite.p"));
    EXPECT_LT((p - Vector3d(0.12, -0.12, 0.29)).norm(), 1e-5) << world;
  }
  for (const std::string books : {"free_energy.", "fixed_energy."})
    EXPECT_LT(std::abs(run.value(books + "residual")), 1e-6 * run.value(books + "friction")) << books;
  const auto& tallies = run.summary().tallies;
  EXPECT_NEAR(tallies.at(0).max[1], 0.124, 0.001);       // relative attitude about y, rad
  EXPECT_NEAR(tallies.at(1).total_max, 21.4, 1);         // N at the capture, where the fixed cell has none
  EXPECT_LT(run.summary().tallies.at(3).total_max, 20);  // N: the planned force on the block
}

TEST(Fig17, AMissedCaptureIsToldAndTheRunGoesOn) {
  Servicing run("servicing.ssd", {"free_world.hold.reach=0.02"}, 4e-3);
  run.to(10);
  EXPECT_THAT(run.summary().notes, Contains(StartsWith("free_world: latch 'hold' closed on nothing at 4.2 s")));
  EXPECT_THAT(run.summary().notes, Contains(HasSubstr("free_world: latch 'grip' closed on nothing")));
  EXPECT_TRUE(run.is("fixed_world.grip.closed"));
}

// Ten times lighter and heavier, and 5 deg/s about each axis, for a gripper that draws a satellite in from further away: the capture keeps the momentum,
// and the plan ends with the block on its seat.
TEST(Fig17, SatellitesOfOtherMassesAndSpinsAreServed) {
  const std::vector<std::string> wide{"free_world.hold.reach=0.35", "free_world.hold.tilt=0.7"};
  const auto inertial = [](double factor) {
    const std::string I = std::to_string(2.0833 * factor);
    return "<mass>" + std::to_string(50 * factor) + "</mass><inertia><ixx>" + I + "</ixx><iyy>" + I + "</iyy><izz>" + I +
           "</izz>";
  };
  std::string scene = testing::content((kExample / "servicing.sdf").string());
  const std::string own = "<mass>50</mass><inertia><ixx>2.0833</ixx><iyy>2.0833</iyy><izz>2.0833</izz>";
  ASSERT_NE(scene.find(own), std::string::npos);
  for (const double factor : {0.1, 10.0}) {
    const testing::TemporaryFile other(std::string(scene).replace(scene.find(own), own.size(), inertial(factor)),
                                       "servicing.sdf");
    std::vector<std::string> set = wide;
    set.push_back("scene=" + other.path());
    Servicing run("servicing.ssd", set, 4e-3);
    run.to(16);
    for (const std::string world : {"free_world.", "fixed_world."})
      EXPECT_TRUE(run.is(world + "dock_4.closed")) << world << factor;
  }
  const scene::Scene bodies = scene::load(kExample / "servicing.sdf");
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d w = Vector3d::Unit(axis) * 5 * M_PI / 180;
    std::vector<std::string> set = wide;
    for (const scene::Body& body : bodies.bodies) {
      const Vector3d v = w.cross(body.X_WB.p - bodies.bodies.front().X_WB.p);
      for (const auto& [name, x] : {std::pair{".v0=", v}, {".w0=", w}})
        set.push_back("free_world." + body.name + name + std::to_string(x[0]) + " " + std::to_string(x[1]) + " " +
                      std::to_string(x[2]));
    }
    Servicing run("servicing.ssd", set, 4e-3);
    Momentum momentum;
    double size = 0;
    const Wrench before = momentum.of(run, &size);
    EXPECT_GT(before.tail<3>()[axis], 0.15);
    run.to(16);
    EXPECT_LT((momentum.of(run, &size) - before).norm(), 1e-10) << axis;
    EXPECT_TRUE(run.is("free_world.hold.closed")) << axis;
    EXPECT_TRUE(run.is("free_world.dock_4.closed")) << axis;
  }
}

}  // namespace
}  // namespace cotwin::master::fig17_servicing_test
