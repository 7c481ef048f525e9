// The drive train of a robot on a floating base against the same robot in maximal coordinates (contact world), against RK4 of
// articulated bodies with the base's pose, and by conserved quantities.

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "components/contact_world/assemble.h"
#include "components/contact_world/engine/world.h"
#include "models/robot/floating_base.h"
#include "models/robot/urdf/urdf.h"
#include "tests/components/drive_train/harness.h"
#include "tests/models/robot/floating_dynamics.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace cotwin::floating_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::Drive;
using ::testing::HasSubstr;

const std::string kSatellite = places::source() + "/tests/components/data/satellite.urdf";

/// The satellite without friction and gears: M* q̈ + b* = tau_m.
Drive satellite(const std::string& settings = "&transmission=rigid&friction=smooth") {
  Drive drive("base=floating&robot=" + kSatellite + settings);
  drive.set("B", 1e-12).set("K", 1e4);
  for (const char* name : {"sigma0", "sigma1", "sigma2", "tau_C", "tau_S"}) drive.set(name, 0);
  return drive;
}

void set(Drive& drive, const std::string& name, const std::vector<double>& values) {
  std::copy(values.begin(), values.end(), drive[name].begin());
}

Vector3d vector3(std::span<const double> v) { return {v[0], v[1], v[2]}; }
Quaterniond quaternion(std::span<const double> v) { return {v[0], v[1], v[2], v[3]}; }

const std::vector<double> kQ{0.4, -0.7}, kDq{0.3, -0.5}, kP{0.1, 0.2, -0.3}, kQuat{0.5, 0.5, -0.5, 0.5}, kV{0.05, -0.1, 0.02},
    kW{0.05, 0.08, -0.04};

double torque(int ms, int joint) { return 0.3 * std::sin(0.004 * ms + joint) * (joint ? 0.2 : 1); }

void start(Drive& drive) {
  set(drive, "q0", kQ);
  set(drive, "dq0", kDq);
  set(drive, "base_p0", kP);
  set(drive, "base_quat0", kQuat);
  set(drive, "base_v0", kV);
  set(drive, "base_w0", kW);
}

/// (q, dq, base position, base quaternion with the sign of w) of the tree in maximal coordinates after `ms` milliseconds.
VectorXd in_the_world(int ms, int parts_of_ms, const Vector3d& gravity) {
  const robot::RobotModel model = robot::load_urdf(kSatellite);
  const Pose X_WB{quaternion(kQuat).toRotationMatrix(), vector3(kP)};
  scene::Scene scene;
  scene.gravity = gravity;
  const auto parts = contact_world::assemble(scene, model, X_WB, contact_world::Base::kFloating, kQ, kDq);
  const Vector3d v = vector3(kV), w = vector3(kW);
  for (scene::Body& body : scene.bodies) {
    body.V_WB.head<3>() += v + w.cross(body.X_WB.p - X_WB.p);
    body.V_WB.tail<3>() += w;
  }
  for (scene::Joint& joint : scene.joints) joint.q_min = -(joint.q_max = scene::kInfinity);
  contact_world::World world(scene, {});
  for (int k = 0; k < ms * parts_of_ms; ++k) {
    for (int i = 0; i < 2; ++i) world.set_tau(parts.joints[static_cast<std::size_t>(i)], torque(k / parts_of_ms, i));
    world.step(1e-3 / parts_of_ms);
  }
  const Pose X = world.poses()[parts.base];
  Quaterniond Q(X.R);
  if (Q.w() < 0) Q.coeffs() = -Q.coeffs();
  VectorXd all(9);
  all << world.q()[parts.joints[0]], world.q()[parts.joints[1]], X.p, Q.w(), Q.vec();
  return all;
}

// The world's error is of second order, so two runs give its limit for h → 0.
TEST(DriveTrainFloating, MovesAsTheTreeInTheContactWorldForTenSeconds) {
  for (const double g : {0.0, -9.81}) {
    Drive drive = satellite();
    start(drive);
    set(drive, "gravity", {0, 0, g});
    drive.initialise();
    for (int k = 0; k < 10000; ++k) {
      set(drive, "tau_m", {torque(k, 0), torque(k, 1)});
      drive.step(1e-3);
    }
    const VectorXd coarse = in_the_world(10000, 2, {0, 0, g}), fine = in_the_world(10000, 4, {0, 0, g});
    const VectorXd limit = (4 * fine - coarse) / 3;
    VectorXd reduced(9);
    reduced << drive["q"][0], drive["q"][1], vector3(drive["base_p"]), drive["base_quat"][0], drive["base_quat"][1],
        drive["base_quat"][2], drive["base_quat"][3];
    if (std::getenv("COTWIN_PRINT_FIGURES"))
      std::printf("difference %g, world at 0.25 ms %g\n", (reduced - limit).cwiseAbs().maxCoeff(),
                  (fine - limit).cwiseAbs().maxCoeff());
    EXPECT_LT((reduced - limit).cwiseAbs().maxCoeff(), 1e-6) << "gravity " << g << "\n"
                                                             << (reduced - limit).transpose() << "\n"
                                                             << (fine - limit).transpose();
    EXPECT_GT(std::abs(reduced[0] - kQ[0]), 0.1);
    EXPECT_GT(quaternion(drive["base_quat"]).angularDistance(quaternion(kQuat)), 0.1);
  }
}

/// The satellite by RK4 with articulated bodies, under constant torques and a constant wrench in W at the base.
struct Flight {
  VectorXd q, dq;
  Vector3d p, v;  // of the base in W
  Quaterniond Q;
  Vector3d w;  // in B
};

Flight fly(double time, double h, const VectorXd& tau, const Vector3d& f, const Vector3d& m, const Vector3d& gravity) {
  const robot::FloatingMechanism mechanism(robot::load_urdf(kSatellite));
  robot::FloatingData data(mechanism);
  struct Rate {
    VectorXd dq, ddq;
    Vector3d v, a, w, dw;
  };
  const auto rate = [&](const Flight& x) {
    const Eigen::Matrix3d R = x.Q.normalized().toRotationMatrix();
    Twist V, A;
    Wrench W;
    V << R.transpose() * x.v, x.w;
    W << R.transpose() * f, R.transpose() * m;
    VectorXd ddq(2);
    floating_forward_dynamics(mechanism, data, x.q, x.dq, tau, V, W, R.transpose() * gravity, ddq, A);
    return Rate{x.dq, ddq, x.v, R * A.head<3>(), x.w, A.tail<3>()};
  };
  const auto moved = [](Flight x, double dt, const Rate& r) {
    x.q += dt * r.dq;
    x.dq += dt * r.ddq;
    x.p += dt * r.v;
    x.v += dt * r.a;
    x.w += dt * r.dw;
    x.Q.coeffs() += dt / 2 * (x.Q * Quaterniond(0, r.w.x(), r.w.y(), r.w.z())).coeffs();
    return x;
  };
  Flight x{VectorXd::Map(kQ.data(), 2), VectorXd::Map(kDq.data(), 2), vector3(kP), vector3(kV), quaternion(kQuat), {}};
  x.w = x.Q.conjugate() * vector3(kW);
  for (int k = 0; k < static_cast<int>(std::lround(time / h)); ++k) {
    // Classical RK4; the rate of the quaternion is taken along each stage's.
    const Rate r1 = rate(x);
    const Flight x2 = moved(x, h / 2, r1);
    const Rate r2 = rate(x2);
    const Flight x3 = [&] {
      Flight y = moved(x, h / 2, r2);
      y.Q.coeffs() = x.Q.coeffs() + h / 4 * (x2.Q * Quaterniond(0, r2.w.x(), r2.w.y(), r2.w.z())).coeffs();
      return y;
    }();
    const Rate r3 = rate(x3);
    const Flight x4 = [&] {
      Flight y = moved(x, h, r3);
      y.Q.coeffs() = x.Q.coeffs() + h / 2 * (x3.Q * Quaterniond(0, r3.w.x(), r3.w.y(), r3.w.z())).coeffs();
      return y;
    }();
    const Rate r4 = rate(x4);
    const auto turn = [&](const Flight& at, const Rate& r) {
      return Eigen::Vector4d((at.Q * Quaterniond(0, r.w.x(), r.w.y(), r.w.z())).coeffs() / 2);
    };
    const Eigen::Vector4d dQ = h / 6 * (turn(x, r1) + 2 * turn(x2, r2) + 2 * turn(x3, r3) + turn(x4, r4));
    const Quaterniond Q(x.Q.coeffs() + dQ);
    x.q += h / 6 * (r1.dq + 2 * r2.dq + 2 * r3.dq + r4.dq);
    x.dq += h / 6 * (r1.ddq + 2 * r2.ddq + 2 * r3.ddq + r4.ddq);
    x.p += h / 6 * (r1.v + 2 * r2.v + 2 * r3.v + r4.v);
    x.v += h / 6 * (r1.a + 2 * r2.a + 2 * r3.a + r4.a);
    x.w += h / 6 * (r1.dw + 2 * r2.dw + 2 * r3.dw + r4.dw);
    x.Q = Q.normalized();
  }
  return x;
}

TEST(DriveTrainFloating, FollowsAWrenchOnItsBaseWithErrorOfSecondOrder) {
  const std::vector<double> f{3, -2, 5}, m{0.2, 0.5, -0.3}, g{0.3, -0.2, -1};
  const Flight expected = fly(2, 1e-3, Eigen::Vector2d(0.3, -0.1), vector3(f), vector3(m), vector3(g));
  double errors[2];
  for (const int steps : {1000, 2000}) {
    Drive drive = satellite();
    start(drive);
    drive.substeps(1).set("stop_stiffness", 0);  // the joints pass their limits
    set(drive, "gravity", g);
    set(drive, "base_f", f);
    set(drive, "base_m", m);
    set(drive, "tau_m", {0.3, -0.1});
    drive.initialise();
    for (int k = 0; k < steps; ++k) drive.step(2.0 / steps);
    const VectorXd q = VectorXd::Map(drive["q"].data(), 2), dq = VectorXd::Map(drive["dq"].data(), 2);
    double& error = errors[steps / 2000];
    error =
        std::max({(q - expected.q).norm(), (dq - expected.dq).norm(), (vector3(drive["base_p"]) - expected.p).norm(),
                  (vector3(drive["base_v"]) - expected.v).norm(), (vector3(drive["base_w"]) - expected.Q * expected.w).norm(),
                  quaternion(drive["base_quat"]).angularDistance(expected.Q)});
  }
  EXPECT_LT(errors[0], 2e-5);
  EXPECT_GT(errors[0] / errors[1], 3.5);
  EXPECT_GT((expected.p - vector3(kP)).norm(), 0.5);
}

TEST(DriveTrainFloating, KeepsMomentumAndBalancesItsEnergyOnElasticGears) {
  Drive drive = satellite("&friction=lugre");
  start(drive);
  drive.set("B", 0.05).set("K", 300).set("D", 0.2);
  drive.set("sigma0", 200).set("sigma1", 1).set("sigma2", 0.3).set("tau_C", 0.4).set("tau_S", 0.5).set("v_S", 0.05);
  set(drive, "gravity", {0, 0, 0});
  drive.initialise();
  const Vector3d momentum = vector3(drive["momentum"]), spin = vector3(drive["spin"]),
                 centre = vector3(drive["centre_of_mass"]);
  const double energy = drive.energy();
  robot::RobotModel model = robot::load_urdf(kSatellite);
  const robot::FloatingMechanism mechanism(model);
  robot::FloatingData data(mechanism);
  robot::FloatingInertia inertia(2);
  for (int k = 0; k < 3000; ++k) {
    set(drive, "tau_m", {3 * torque(k, 0), 3 * torque(k, 1)});
    drive.step(1e-3);
    // the momenta of pose and twist, which are outputs
    const Quaterniond Q = quaternion(drive["base_quat"]);
    Twist V;
    V << Q.conjugate() * vector3(drive["base_v"]), Q.conjugate() * vector3(drive["base_w"]);
    floating_inertia(mechanism, data, VectorXd::Map(drive["q"].data(), 2), inertia);
    const Wrench h = inertia.momentum(V, VectorXd::Map(drive["dq"].data(), 2));
    ASSERT_LT((Q * Vector3d(h.head<3>()) - momentum).norm(), 1e-11);
    ASSERT_LT((Q * Vector3d(h.tail<3>() - inertia.p_C.cross(h.head<3>())) - spin).norm(), 1e-11);
    ASSERT_LT((vector3(drive["base_p"]) + Q * inertia.p_C - centre - momentum / inertia.mass * drive.now()).norm(), 1e-11);
  }
  EXPECT_NEAR(drive.unbalanced(energy), 0, 1e-4);
  EXPECT_GT(drive["energy_dissipated"][0], 0.1);
}

TEST(DriveTrainFloating, AStepAllocatesNothingAndGoesOnFromASnapshotToTheSameBits) {
  Drive drive = satellite("&friction=lugre"), other = satellite("&friction=lugre");
  for (Drive* d : {&drive, &other}) {
    start(*d);
    d->set("B", 0.05).set("K", 300);
  }
  drive.initialise();
  other.initialise();
  set(drive, "base_f", {1, 0, 2});
  set(drive, "tau_m", {0.5, -0.2});
  for (int k = 0; k < 50; ++k) drive.step(1e-3);
  const auto before = testing::allocations();
  for (int k = 0; k < 50; ++k) drive.step(1e-3);
  EXPECT_EQ(testing::allocations() - before, 0u);
  Snapshot snapshot;
  snapshot.take(drive.variables(), *drive.instance().unit);
  snapshot.restore(other.variables(), *other.instance().unit);
  other.move_clock_to(drive);
  for (int k = 0; k < 50; ++k) {
    drive.step(1e-3);
    other.step(1e-3);
  }
  for (const char* name : {"q", "dq", "base_p", "base_quat", "base_w", "energy_kinetic", "base_work"})
    for (std::size_t i = 0; i < drive[name].size(); ++i) EXPECT_EQ(drive[name][i], other[name][i]) << name;
}

// A mass that changes during the run, for example a load that is taken up at the base's speed: pose and twist do not jump.
TEST(DriveTrainFloating, KeepsItsMotionWhenABodyChanges) {
  Drive drive = satellite();
  start(drive);
  drive.set("transition", 0.05);
  drive.initialise();
  for (int k = 0; k < 100; ++k) drive.step(1e-3);
  drive["mass"][1] *= 3;
  Vector3d p = vector3(drive["base_p"]), v = vector3(drive["base_v"]), w = vector3(drive["base_w"]);
  for (int k = 0; k < 300; ++k) {
    drive.step(1e-3);
    EXPECT_LT((vector3(drive["base_p"]) - p).norm(), 0.02);
    EXPECT_LT((vector3(drive["base_w"]) - w).norm(), 0.01);
    EXPECT_LT((vector3(drive["base_v"]) - v).norm(), 0.02);
    p = vector3(drive["base_p"]), v = vector3(drive["base_v"]), w = vector3(drive["base_w"]);
  }
}

/// The largest distance from a desired motion, rad, of the tumbling satellite under `unit:compliance?` + `query`, after the start.
double tracking_error(const std::string& query, double passivity, double K) {
  Drive drive = satellite(K > 0 ? "&friction=smooth" : "&transmission=rigid&friction=smooth");
  start(drive);
  set(drive, "dq0", {0.6, -0.5});
  drive.set("B", 0.02);
  if (K > 0) drive.set("K", K).set("D", 5);
  drive.initialise();
  Instance control = make_unit("unit:compliance?robot=" + kSatellite + query, {},
                               {std::filesystem::path(places::source()) / "models"}, unit_types());
  const auto port = [&](const std::string& name) { return control.variables.at(name).reals(); };
  const auto connect = [&](const std::string& from, const std::string& to) {
    if (control.variables.find(to)) std::copy(drive[from].begin(), drive[from].end(), port(to).begin());
  };
  std::fill(port("B").begin(), port("B").end(), 0.02);
  std::fill(port("K").begin(), port("K").end(), K);
  std::fill(port("passivity").begin(), port("passivity").end(), passivity);
  double worst = 0;
  for (int k = 0; k <= 3000; ++k) {
    for (const char* name : {"q", "dq", "theta", "dtheta", "base_quat", "spin"}) connect(name, name);
    const double t = 1e-3 * k;
    for (std::size_t i = 0; i < 2; ++i) {
      const double w = i == 0 ? 1.5 : 1.0, size = i == 0 ? 0.4 : -0.5;
      port("q_d")[i] = kQ[i] + size * std::sin(w * t);
      port("dq_d")[i] = size * w * std::cos(w * t);
      port("ddq_d")[i] = -size * w * w * std::sin(w * t);
      if (k > 1000) worst = std::max(worst, std::abs(drive["q"][i] - port("q_d")[i]));
    }
    if (k == 0) {
      control.unit->initialise(Time{});
    } else {
      (void)control.unit->step(Time{}, Duration::from_seconds(1e-3));
    }
    std::copy_n(port("tau_m").begin(), 2, drive["tau_m"].begin());
    drive.step(1e-3);
  }
  return worst;
}

TEST(DriveTrainFloating, FollowsComplianceThatHasTheDynamicsOfTheFloatingRobot) {
  for (const double passivity : {0.0, 1.0})
    for (const double K : {0.0, 5000.0}) {
      const double floating = tracking_error("&base=floating", passivity, K), fixed = tracking_error("", passivity, K);
      EXPECT_LT(floating, 1e-3) << "passivity " << passivity << ", K " << K;
      EXPECT_GT(fixed, 5 * floating) << "passivity " << passivity << ", K " << K;
    }
  EXPECT_THAT(testing::error_of(
                  [] { (void)make_unit("unit:compliance?base=floating&robot=" + testing::kRotor, {}, {}, unit_types()); }),
              HasSubstr("base=floating: the base of robot"));
}

/// The satellite with a hull and a ball at the tip of its forearm.
std::string satellite_with_shapes() {
  std::string urdf = testing::content(kSatellite);
  const auto add = [&](const std::string& link, const std::string& origin, const std::string& shape) {
    const std::size_t end = urdf.find("</link>", urdf.find("<link name=\"" + link + "\""));
    urdf.insert(end, "<collision><origin xyz=\"" + origin + "\"/><geometry>" + shape + "</geometry></collision>");
  };
  add("hull", "0 0 0", "<box size=\"0.4 0.4 0.4\"/>");
  add("forearm", "0.35 0 0", "<sphere radius=\"0.05\"/>");
  return urdf;
}

std::string ball(const std::string& name, double y) {
  return "<model name='" + name + "'><pose>1 " + std::to_string(y) +
         " 0.2 0 0 0</pose><link name='link'><inertial><mass>1</mass><inertia><ixx>0.004</ixx><iyy>0.004</iyy><izz>0.004</izz>"
         "</inertia></inertial><collision name='c'><geometry><sphere><radius>0.1</radius></sphere></geometry><surface><contact>"
         "<ode><kp>20000</kp><kd>20</kd></ode></contact><friction><ode><mu>0.3</mu><mu2>0.3</mu2></ode></friction></surface>"
         "</collision></link></model>";
}

/// Two satellites in one world, each struck by a ball at its forearm: `left` in reduced coordinates by a drive train, `right` in
/// maximal coordinates. Returns the largest difference of their motions after 1 s.
double difference_side_by_side(double h) {
  const testing::TemporaryFolder folder("side_by_side");
  const std::string robot = folder.write("satellite.urdf", satellite_with_shapes()).string();
  const std::string scene = folder
                                .write("balls.sdf", "<sdf version='1.9'><world name='balls'><gravity>0 0 0</gravity>" +
                                                        ball("ball_left", 0) + ball("ball_right", 5) + "</world></sdf>")
                                .string();
  Instance world =
      make_unit("unit:contact_world?base=floating&maximal=right&robots=left:" + robot + ",right:" + robot + "&scene=" + scene,
                {}, {}, unit_types());
  const auto port = [&](const std::string& name) { return world.variables.at(name).reals(); };
  Drive drive = satellite();
  set(drive, "gravity", {0, 0, 0});
  drive.initialise();
  port("right.base_p0")[1] = 5;
  const auto connect = [&](const std::string& from, const std::string& to) {
    std::copy(drive[from].begin(), drive[from].end(), port(to).begin());
  };
  Time now;
  double force = 0;
  for (int k = 0; k <= static_cast<int>(std::lround(1 / h)); ++k) {
    for (const char* name : {"q", "dq", "tau_J", "base_p", "base_quat", "base_v", "base_w"})
      connect(name, std::string("left.") + name);
    for (const char* name : {"ball_left.f", "ball_right.f"}) port(name)[2] = k * h < 0.0499 ? -20 : 0;
    if (k == 0) {
      world.unit->initialise(now);
      continue;
    }
    EXPECT_EQ(world.unit->step(now, Duration::from_seconds(h)), StepResult::kDone);
    now = now + Duration::from_seconds(h);
    for (const char* name : {"tau_e", "base_f", "base_m"})
      std::copy(port(std::string("left.") + name).begin(), port(std::string("left.") + name).end(), drive[name].begin());
    force = std::max(force, vector3(drive["base_f"]).norm());
    drive.step(h);
  }
  EXPECT_GT(force, 10);
  EXPECT_GT(std::abs(port("right.dq")[0]), 0.1);
  EXPECT_GT(vector3(port("right.base_w")).norm(), 0.002);
  double worst = quaternion(drive["base_quat"]).angularDistance(quaternion(port("right.base_quat")));
  for (std::size_t i = 0; i < 2; ++i) worst = std::max(worst, std::abs(drive["q"][i] - port("right.q")[i]));
  return std::max(worst, (vector3(drive["base_p"]) + Vector3d(0, 5, 0) - vector3(port("right.base_p"))).norm());
}

TEST(DriveTrainFloating, AndARobotInMaximalCoordinatesBesideItAnswerTheSameImpactAlike) {
  const double coarse = difference_side_by_side(1e-3), fine = difference_side_by_side(2.5e-4);
  if (std::getenv("COTWIN_PRINT_FIGURES")) std::printf("side by side: %g at 1 ms, %g at 0.25 ms\n", coarse, fine);
  EXPECT_LT(coarse, 5e-3);
  EXPECT_LT(fine, coarse / 2.5);
}

TEST(DriveTrainFloating, ReportsErrorsInSettingsAndValues) {
  using testing::error_of;
  EXPECT_EQ(error_of([] { Drive("base=floating&link_side=outside&robot=" + kSatellite); }),
            "");  // a setting shared with the world
  EXPECT_THAT(error_of([] { Drive("base=floating&method=cvode&robot=" + kSatellite); }), HasSubstr("expected rosenbrock"));
  EXPECT_THAT(error_of([] { Drive("base=floating&robot=" + testing::kRotor); }), HasSubstr("cannot float"));
  const auto with = [](const char* name, double value) {
    return error_of([&] {
      Drive drive = satellite();
      drive[name][0] = value;
      drive.initialise();
    });
  };
  EXPECT_THAT(with("base_quat0", 2), HasSubstr("has length 2, expected 1"));
  EXPECT_THAT(with("base_w0", NAN), HasSubstr("base_w0[1]"));
  EXPECT_THAT(with("base_f", INFINITY), HasSubstr("base_f[1]: is inf"));
}

}  // namespace
}  // namespace cotwin::floating_test
