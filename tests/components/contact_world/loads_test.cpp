// What latches and grips hold on links that a drive train moves: both units as the master couples them.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <regex>
#include <string>
#include <vector>

#include "components/unit/snapshot.h"
#include "models/foundation/support/text.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/robot_links.h"
#include "tests/support/allocations.h"
#include "tests/support/chain_urdf.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/unit_subject.h"

namespace cotwin::loads_test {
namespace {

using cotwin::testing::TemporaryFolder;
using Eigen::Vector3d;
using Subject = cotwin::testing::UnitSubject;
using Values = std::vector<double>;

void copy(Subject& from, const std::string& out, Subject& to, const std::string& in) {
  std::ranges::copy(from[out], to[in].begin());
}

struct Trial {
  int joints = 3;
  double mass = 2;       // kg, of a cube of this size about its centre
  double size = 0.1;     // m
  double stiffness = 0;  // N/m of the latch; 0: rigid
  double h = 1e-3;
  double K = 2e4, D = 0, B = 0.5;
  double gravity = 0;  // m/s²
  Values v0 = {0.2, -0.1, 0.05}, w0 = {0.1, 0.2, -0.1};
  std::string base{};  // "&base=floating", with 20 kg
  const char* link = "inside";
};

/// A chain of joints without friction and motor torques, and a body that a latch takes over at its end.
class Holding {
 public:
  explicit Holding(const Trial& trial)
      : trial_(trial),
        robot_(folder_.write("chain.urdf", urdf(trial)).string()),
        world_("unit:contact_world?robot_shapes=none&latches=L|link_" + std::to_string(trial.joints) + "|b&link_side=" +
               trial.link + "&robot=" + robot_ + "&scene=" + folder_.write("b.sdf", sdf(trial)).string() + trial.base),
        drive_("unit:drive_train?link_side=" + std::string(trial.link) + "&robot=" + robot_ + trial.base) {
    q_.resize(static_cast<std::size_t>(trial.joints));
    for (std::size_t i = 0; i < q_.size(); ++i) q_[i] = 0.4 + 0.3 * std::sin(2.0 * static_cast<double>(i));
    const robot::RobotModel model = robot::load_urdf(robot_);
    std::vector<Pose> X_WL(model.bodies.size());
    std::vector<Twist> V_WL(model.bodies.size());
    scene::place_links(model, {}, q_, Values(q_.size()), X_WL, V_WL);
    const Eigen::Quaterniond Q(X_WL.back().R);
    const Vector3d& p = X_WL.back().p;
    world_.set("b.p0", {p.x(), p.y(), p.z()})
        .set("b.quat0", {Q.w(), Q.x(), Q.y(), Q.z()})
        .set("b.v0", trial.v0)
        .set("b.w0", trial.w0);
    world_.set("gravity", {0, 0, -trial.gravity}).fill("K", trial.K).fill("D", trial.D);
    world_.fill("L.stiffness", trial.stiffness).fill("L.turn_stiffness", trial.stiffness * trial.size * trial.size);
    drive_.fill("K", trial.K).fill("D", trial.D).fill("B", trial.B).fill("sigma2", 0);
    if (inside()) {
      drive_.set("q0", q_).fill("stop_stiffness", 0);
      world_.set("q", q_);
    } else {
      world_.set("q0", q_);
      drive_.set("q", q_).set("link_order", 1);
    }
    drive_.initialise();
    if (inside()) world_.fill("takes_loads", 1);
    copy(drive_, "tau_J", world_, "tau_J");
    world_.initialise();
    close(true);
  }
  void close(bool now) { world_.variables().at("L.close").booleans()[0] = now; }
  void step() {
    for (const char* name : {"tau_J", "dtheta"}) copy(drive_, name, world_, name);
    for (const char* name : {"q", "dq"}) {
      if (inside()) copy(drive_, name, world_, name);
    }
    for (const char* name : {"base_p", "base_quat", "base_v", "base_w"}) {
      if (!trial_.base.empty()) copy(drive_, name, world_, name);
    }
    world_.step(trial_.h);
    for (const char* name : {"q", "dq"}) {
      if (!inside()) copy(world_, name, drive_, name);
    }
    for (const char* name : {"tau_e", "load_factor", "load_torque", "load_damping"}) {
      if (inside()) copy(world_, name, drive_, name);
    }
    for (const char* name : {"base_f", "base_m"}) {
      if (!trial_.base.empty()) copy(world_, name, drive_, name);
    }
    drive_.step(trial_.h);
  }
  void run(double seconds) {
    for (int i = 0; i < std::lround(seconds / trial_.h); ++i) step();
  }
  /// Kinetic and potential energy of all, and of gears and latch, J.
  double energy() {
    const Vector3d arm =
        Eigen::Quaterniond(world_["b.quat"][0], world_["b.quat"][1], world_["b.quat"][2], world_["b.quat"][3]) *
        Vector3d(0, 0, trial_.size);
    const Vector3d w = world_.vector("b.w"), v = world_.vector("b.v") + w.cross(arm);
    const double I = trial_.mass * trial_.size * trial_.size / 6, e = world_.real("L.distance"), k = trial_.stiffness;
    return drive_.real("energy_kinetic") + drive_.real("energy_potential") + drive_.real("energy_elastic") +
           trial_.mass / 2 * v.squaredNorm() + I / 2 * w.squaredNorm() +
           trial_.mass * trial_.gravity * (world_.real("b.p", 2) + arm.z()) + k / 2 * e * e +
           k * trial_.size * trial_.size * (1 - std::cos(world_.real("L.angle")));
  }
  /// Of the body, in W, kg.m/s.
  Vector3d momentum() {
    const Eigen::Quaterniond Q(world_["b.quat"][0], world_["b.quat"][1], world_["b.quat"][2], world_["b.quat"][3]);
    return trial_.mass * (world_.vector("b.v") + world_.vector("b.w").cross(Q * Vector3d(0, 0, trial_.size)));
  }
  std::vector<std::string> notes() {
    std::vector<std::string> all;
    world_.unit().append_notes(all);
    return all;
  }
  Subject& world() { return world_; }
  Subject& drive() { return drive_; }
  Eigen::VectorXd q() const { return (inside() ? drive_ : world_).joints("q"); }
  const std::string& robot() const { return robot_; }

 private:
  bool inside() const { return trial_.link == std::string("inside"); }
  static std::string urdf(const Trial& trial) {
    std::string xml = cotwin::testing::chain_urdf(trial.joints);
    xml.insert(xml.find('>') + 1, "<gravity xyz=\"0 0 " + std::to_string(-trial.gravity) + "\"/>");
    const std::string base = R"(<link name="link_0"/>)";
    if (!trial.base.empty())
      xml.replace(
          xml.find(base), base.size(),
          R"(<link name="link_0"><inertial><mass value="20"/><inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>)");
    return xml;
  }
  static std::string sdf(const Trial& trial) {
    const std::string I = text::to_text(trial.mass * trial.size * trial.size / 6);
    return R"(<sdf version="1.11"><world name="w"><model name="b"><link name="l"><inertial><pose>0 0 )" +
           text::to_text(trial.size) + " 0 0 0</pose><mass>" + text::to_text(trial.mass) + "</mass><inertia><ixx>" + I +
           "</ixx><iyy>" + I + "</iyy><izz>" + I + "</izz></inertia></inertial></link></model></world></sdf>";
  }

  Trial trial_;
  TemporaryFolder folder_{"loads"};
  std::string robot_;
  Subject world_, drive_;
  Values q_;
};

/// The same in every size: what the closing takes is lost, and nothing comes back.
TEST(Loads, GiveNoEnergyToTheArm) {
  for (const int joints : {1, 3, 7}) {
    for (const double mass : {0.02, 1.0, 40.0}) {
      for (const double h : {1e-3, 4e-3, 1e-2}) {
        for (const bool soft : {false, true}) {
          for (const double D : {0.0, 5.0}) {
            Trial trial{.joints = joints, .mass = mass, .h = h, .D = D};
            if (soft) trial.stiffness = mass * 1e4;  // 100 rad/s
            Holding arm(trial);
            const double at_start = arm.energy();
            double most = 0;
            if (soft) arm.run(80 * h);  // the body is seen before the drive train's last correction, which is large at first
            for (int i = 0; i < 120; ++i) {
              arm.step();
              most = std::max(most, arm.energy());
            }
            EXPECT_LT(most, at_start * (soft ? 1.001 : 1 + 1e-6))
                << joints << " joints, " << mass << " kg, " << h << " s, soft " << soft << ", D " << D;
          }
        }
      }
    }
  }
}

/// Second formulation: a body that is part of the last link from the start, as a tool, without any contact world.
TEST(Loads, MoveAsATool) {
  for (const double gravity : {0.0, 9.81}) {
    Trial trial{.mass = 1.5, .h = 5e-4, .D = 8, .gravity = gravity, .v0 = {0, 0, 0}, .w0 = {0, 0, 0}};
    Holding arm(trial);
    Subject tool("unit:drive_train?robot=" + arm.robot());
    const double m = trial.mass, s = trial.size, I = m * s * s / 6;
    tool.fill("K", trial.K).fill("D", trial.D).fill("B", trial.B).fill("sigma2", 0).fill("stop_stiffness", 0);
    tool.set("q0", arm.drive().values("q"));
    tool.initialise();
    arm.step();  // both arms carry themselves at first, without the body
    tool.step(trial.h);
    tool["mass"][2] += m;
    tool["first_moment"][8] += m * s;
    for (const std::size_t k : {12u, 15u}) tool["inertia"][k] += I + m * s * s;
    tool["inertia"][17] += I;
    tool["tool_changes"][0] += 1;
    double way = 0, error = 0;
    const Eigen::VectorXd start = arm.q();
    for (int i = 0; i < 400; ++i) {
      const double push = i < 100 ? 3.0 : 0.0;
      arm.drive().fill("tau_m", push);
      tool.fill("tau_m", push);
      arm.step();
      tool.step(trial.h);
      way = std::max(way, (arm.q() - start).cwiseAbs().maxCoeff());
      error = std::max(error, (arm.q() - tool.joints("q")).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(way, 0.05);
    EXPECT_LT(error, 0.005 * way) << gravity;
  }
}

/// The world that moves the links itself is a second formulation for soft latches, too.
TEST(Loads, MoveAsWithTheLinksInTheWorld) {
  for (const double stiffness : {0.0, 2e4}) {
    Trial trial{.stiffness = stiffness, .h = 1e-4, .D = 8};
    Holding inside(trial);
    trial.link = "outside";
    Holding outside(trial);
    const Eigen::VectorXd start = inside.q();
    double way = 0, error = 0;
    for (int i = 0; i < 2000; ++i) {
      inside.step();
      outside.step();
      way = std::max(way, (outside.q() - start).cwiseAbs().maxCoeff());
      error = std::max(error, (inside.q() - outside.q()).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(way, 0.01);
    EXPECT_LT(error, 0.01 * way) << stiffness;
  }
}

/// The latch's force is that which moves the body, whatever the drive train makes of it.
TEST(Loads, ExplainTheMotionOfTheBodyByTheLatchesForce) {
  Trial trial{.mass = 5, .h = 4e-3, .D = 2};
  Holding arm(trial);
  arm.run(0.1);
  Vector3d impulse = Vector3d::Zero(), before = arm.momentum();
  double largest = 0;
  for (int i = 0; i < 100; ++i) {
    arm.step();
    impulse += trial.h * arm.world().vector("L.f");
    largest = std::max(largest, impulse.norm());
    EXPECT_LT((arm.momentum() - before - impulse).norm(), 1e-3 * largest) << i;
  }
  EXPECT_GT(largest, 0.01);
}

TEST(Loads, KeepTheMomentumOnAFloatingBase) {
  for (const double stiffness : {0.0, 2e4}) {
    Trial trial{.stiffness = stiffness, .h = 4e-3, .D = 5, .base = "&base=floating"};
    Holding arm(trial);
    const Vector3d before = arm.momentum() + arm.drive().vector("momentum");
    arm.run(0.5);
    EXPECT_GT(arm.drive().vector("momentum").norm(), 0.1 * before.norm());
    EXPECT_LT((arm.momentum() + arm.drive().vector("momentum") - before).norm(), 1e-9 * before.norm());
  }
}

TEST(Loads, AreRefusedWhereTheyAreNoNumbers) {
  Holding arm({});
  arm.drive()["load_factor"][3] = std::nan("");
  EXPECT_THAT(cotwin::testing::error_of([&] { arm.drive().step(1e-3); }),
              ::testing::HasSubstr("drive_train.load_factor[4]: is nan at 0 s, expected a finite value"));
}

TEST(Loads, AreGoneWhenTheLatchOpens) {
  Holding arm({});
  const auto load = [&] { return arm.world().joints("load_factor").norm() + arm.world().joints("load_damping").norm(); };
  EXPECT_EQ(load(), 0);
  arm.run(0.02);
  EXPECT_GT(arm.world().joints("load_factor").norm(), 0.1);
  arm.close(false);
  arm.step();
  EXPECT_EQ(load(), 0);
  EXPECT_EQ(arm.world().joints("load_torque").norm(), 0);
}

/// The inertia of a rigid load is that of the body in the joints, Jᵀ M J.
TEST(Loads, HaveTheBodysInertia) {
  Trial trial{.joints = 2, .mass = 3};
  Holding arm(trial);
  arm.run(0.01);
  robot::RobotModel model = robot::load_urdf(arm.robot());
  const Eigen::VectorXd q = arm.world().joints("q_link");
  Eigen::MatrixXd without(2, 2), with(2, 2);
  const auto mass_matrix = [&](Eigen::MatrixXd& M) {
    const robot::Mechanism mechanism(model);
    robot::Data data(mechanism);
    robot::mass_matrix(mechanism, data, q, M);
  };
  mass_matrix(without);
  Inertia body{trial.mass, Vector3d(0, 0, trial.size), trial.mass * trial.size * trial.size / 6 * Eigen::Matrix3d::Identity()};
  model.bodies.back().inertia = model.bodies.back().inertia + body;
  mass_matrix(with);
  const Eigen::Map<Eigen::Matrix<double, 2, 2, Eigen::RowMajor>> F(arm.world()["load_factor"].data());
  EXPECT_LT((F.transpose() * F - (with - without)).norm(), 1e-6 * (with - without).norm());
}

/// Where energy grows all the same, it is told with its joules.
TEST(Loads, TellWhatTheyGain) {
  Trial trial{.joints = 1, .mass = 0.05, .size = 0.04, .h = 8e-3, .K = 6e3, .D = 3, .B = 2};
  trial.stiffness = 0.05 * 200 * 200;
  Holding arm(trial);
  double least = arm.energy(), gained = 0;
  for (int i = 0; i < 100; ++i) {
    arm.step();
    const double energy = arm.energy() + arm.drive().real("energy_dissipated");
    least = std::min(least, energy);
    gained = std::max(gained, energy - least);
  }
  std::smatch found;
  double told = 0;
  for (const std::string& note : arm.notes()) {
    if (std::regex_search(note, found, std::regex("grown without work by ([0-9.e-]+) J"))) told = std::stod(found[1]);
  }
  EXPECT_GT(gained, 1e-5);
  EXPECT_NEAR(told, gained, 0.15 * gained);
}

TEST(Loads, AreRestoredToTheSameBits) {
  for (const double stiffness : {0.0, 2e4}) {
    Trial trial{.stiffness = stiffness, .h = 4e-3};
    Holding arm(trial);
    arm.run(0.1);
    Snapshot world, drive;
    world.take(arm.world().variables(), arm.world().unit());
    drive.take(arm.drive().variables(), arm.drive().unit());
    arm.run(0.1);
    const Values q = arm.drive().values("q"), p = arm.world().values("b.p");
    world.restore(arm.world().variables(), arm.world().unit());
    drive.restore(arm.drive().variables(), arm.drive().unit());
    arm.run(0.1);
    EXPECT_EQ(arm.drive().values("q"), q);
    EXPECT_EQ(arm.world().values("b.p"), p);
  }
}

TEST(Loads, AllocateNothing) {
  Holding arm({});
  arm.run(0.02);
  const std::uint64_t before = cotwin::testing::allocations();
  arm.step();
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
}

/// Two fingers press a block of 5 kg at the end of a swinging arm of 2 kg. What the motors have not given is at rest after a while.
struct Grip {
  explicit Grip(bool told) : told(told) {
    std::string xml =
        R"(<robot name="grip"><gravity xyz="0 0 0"/><link name="base"/><joint name="swing" type="revolute"><parent link="base"/>
<child link="arm"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="9" effort="900"/></joint>
<link name="arm"><inertial><origin xyz="0 0 0.15"/><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>)";
    for (const char* side : {"-", ""}) {
      const std::string name = *side != 0 ? "left" : "right", inward = *side != 0 ? "1 0 0" : "-1 0 0";
      xml +=
          "<joint name=\"" + name + R"(" type="prismatic"><parent link="arm"/><child link=")" + name +
          R"(_pad"/><origin xyz=")" + side + R"(0.04 0 0.4"/><axis xyz=")" + inward +
          R"("/><limit lower="-0.05" upper="0.05" velocity="1" effort="9000"/></joint><link name=")" + name +
          R"(_pad"><inertial><mass value="0.3"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.02 0.04 0.04"/></geometry></collision></link>)";
    }
    const std::string robot = "?robot=" + folder.write("grip.urdf", xml + "</robot>").string();
    const std::string block =
        folder
            .write("b.sdf", R"(<sdf version="1.11"><world name="w"><model name="b"><pose>0 0 0.6 0 0 0</pose><link name="l">
<inertial><mass>5</mass><inertia><ixx>0.003</ixx><iyy>0.003</iyy><izz>0.003</izz></inertia></inertial><collision name="c"><geometry>
<box><size>0.06 0.06 0.06</size></box></geometry></collision></link></model></world></sdf>)")
            .string();
    world = std::make_unique<Subject>("unit:contact_world" + robot + "&scene=" + block);
    drive = std::make_unique<Subject>("unit:drive_train" + robot);
    for (Subject* unit : {world.get(), drive.get()}) unit->set("K", {5e3, 1e5, 1e5}).set("D", {0.5, 20, 20});
    drive->set("B", {0.4, 1, 1})
        .fill("sigma2", 0)
        .fill("stop_stiffness", 0)
        .set("tau_m", {0, 200, 200})
        .set("dq0", {0.5, 0, 0});
    world->set("b.v0", {0.2, 0, 0}).set("b.w0", {0, 0.5, 0}).set("gravity", {0, 0, 0});
    drive->initialise();
    world->fill("takes_loads", told ? 1 : 0).fill("energy_limit", told ? 0.25 : 0).initialise();
  }
  void step() {
    for (const char* name : {"q", "dq", "tau_J", "dtheta"}) copy(*drive, name, *world, name);
    world->step(5e-3);
    for (const char* name : {"tau_e", "load_factor", "load_torque", "load_damping"}) {
      copy(*world, name, *drive, name);
    }
    drive->step(5e-3);
  }
  double energy() const {  // without that of the motors
    return drive->real("energy_kinetic") + drive->real("energy_elastic") - drive->real("work_m") +
           5.0 / 2 * world->vector("b.v").squaredNorm() + 0.003 / 2 * world->vector("b.w").squaredNorm();
  }
  /// How much the energy rises from one step to the next, in a second after the first one, J.
  double rises() {
    for (int i = 0; i < 200; ++i) step();
    double sum = 0;
    for (int i = 0; i < 200; ++i) {
      const double before = energy();
      step();
      sum += std::max(0.0, energy() - before);
    }
    return sum;
  }

  bool told;
  TemporaryFolder folder{"grip"};
  std::unique_ptr<Subject> world, drive;
};

TEST(Loads, LieStillInAGrip) {
  Grip told(true), untold(false);
  const double rises = told.rises();
  EXPECT_LT(rises, 0.01);
  EXPECT_GT(untold.rises(), 10 * rises) << "the same without what the drive train is told";
  EXPECT_NEAR((told.world->vector("b.p") - Vector3d(0, 0, 0.2)).norm(), 0.4, 0.005) << "the block was lost";
}

}  // namespace
}  // namespace cotwin::loads_test
