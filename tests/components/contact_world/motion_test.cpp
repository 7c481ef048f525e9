// The contact world without contacts: free bodies, joints, and whole robots compared with reduced coordinates (2a).

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <vector>

#include "components/contact_world/assemble.h"
#include "components/contact_world/engine/world.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/contact_scenes.h"
#include "tests/support/places.h"

namespace cotwin::contact_world::motion_test {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;
using robot::testing::Draw;
using robot::testing::Kind;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
const double kPi = std::acos(-1.0);

scene::Body rod(double mass, const Vector3d& moments) {
  scene::Body body;
  body.name = "body";
  body.inertia.mass = mass;
  body.inertia.I_CC = moments.asDiagonal();
  return body;
}

scene::Scene without_gravity(scene::Body body) {
  scene::Scene scene;
  scene.gravity.setZero();
  scene.bodies.push_back(std::move(body));
  return scene;
}

/// A body on a revolute joint about y with the world, its centre 1 m below at q = 0.
scene::Scene pendulum(double angle) {
  scene::Scene scene;
  scene::Body body = rod(2, {0.1, 0.2, 0.15});
  body.inertia.p_LC = {0, 0, -1};
  body.X_WB.R = Eigen::AngleAxisd(angle, Vector3d::UnitY()).toRotationMatrix();
  scene.bodies.push_back(body);
  scene::Joint joint;
  joint.name = "hinge";
  joint.child = 0;
  joint.axis = Vector3d::UnitY();
  scene.joints.push_back(joint);
  return scene;
}

TEST(ContactWorldMotion, SymmetricTopPrecessesAsItsClosedFormSays) {
  // Torque-free: the axis of symmetry turns about L with L / I₁, the body about its axis with (1/I₃ − 1/I₁) L₃ in addition.
  scene::Body body = rod(1, {0.02, 0.02, 0.03});
  const Vector3d w(3, 0, 20);
  body.V_WB << 0, 0, 0, w;
  World world(without_gravity(body), {});
  const double h = 1e-3;
  const int steps = 5000;
  for (int k = 0; k < steps; ++k) world.step(h);
  const Vector3d L(0.02 * w.x(), 0, 0.03 * w.z());
  const double t = h * steps;
  const Eigen::Matrix3d R = Eigen::AngleAxisd(L.norm() / 0.02 * t, L.normalized()).toRotationMatrix() *
                            Eigen::AngleAxisd((1 / 0.03 - 1 / 0.02) * L.z() * t, Vector3d::UnitZ()).toRotationMatrix();
  EXPECT_LT((world.poses()[0].R - R).norm(), 1e-10);  // exact except for the rounding of 5000 steps
}

TEST(ContactWorldMotion, BodyAboutItsMiddleAxisTurnsOverInTheTimeOfItsEllipticIntegral) {
  // I₁ < I₂ < I₃ and rotation near axis 2. With 2E and L², ω₂ is periodic with 4 K(m) / p (Landau, Lifshitz I, § 37), and K(m)
  // = π / 2 agm(1, √(1 − m)).
  const Vector3d I(0.01, 0.02, 0.028), w0(0.05, 4, 0.02);
  scene::Body body = rod(1, I);
  body.V_WB << 0, 0, 0, w0;
  World world(without_gravity(body), {});
  const double E2 = I.dot(w0.cwiseAbs2()), L2 = I.cwiseAbs2().dot(w0.cwiseAbs2());
  const bool below = L2 < E2 * I[1];  // which of the two families
  const double I1 = below ? I[2] : I[0], I2 = I[1], I3 = below ? I[0] : I[2];
  const double p = std::sqrt((I3 - I2) * (L2 - E2 * I1) / (I1 * I2 * I3));
  const double m = (I2 - I1) * (E2 * I3 - L2) / ((I3 - I2) * (L2 - E2 * I1));
  double a = 1, b = std::sqrt(1 - m);
  for (int k = 0; k < 20; ++k) {
    const double mean = (a + b) / 2;
    b = std::sqrt(a * b);
    a = mean;
  }
  const double period = 4 * kPi / (2 * a) / p;

  const double h = 2.5e-4;
  std::vector<double> crossings;
  double before = 0;
  for (int k = 1; crossings.size() < 5; ++k) {
    world.step(h);
    const double w2 = (world.poses()[0].R.transpose() * world.twists()[0].tail<3>())[1];
    if (k > 1 && before < 0 && w2 >= 0) crossings.push_back(h * (k - w2 / (w2 - before)));
    before = w2;
  }
  EXPECT_NEAR((crossings.back() - crossings.front()) / 4, period, 2e-5 * period);
}

TEST(ContactWorldMotion, PendulumSwingsInTheTimeOfItsEllipticIntegral) {
  // T = 2π √(I / m g r) / agm(1, cos(q₀ / 2)).
  const double q0 = 2.5, inertia = 2 * 1 + 0.2;
  double a = 1, b = std::cos(q0 / 2);
  for (int k = 0; k < 20; ++k) {
    const double mean = (a + b) / 2;
    b = std::sqrt(a * b);
    a = mean;
  }
  const double period = 2 * kPi * std::sqrt(inertia / (2 * 9.81)) / a;
  double errors[2];
  for (int i = 0; i < 2; ++i) {
    World world(pendulum(q0), {});
    const double h = i == 0 ? 2e-3 : 1e-3;
    double before = q0, crossing = 0;
    int seen = 0;
    for (int k = 1; seen < 4; ++k) {
      world.step(h);
      const double q = world.q()[0];
      if (before * q < 0 && ++seen == 4) crossing = h * (k - q / (q - before));  // the zeros are at T/4, 3T/4, …
      before = q;
    }
    errors[i] = std::abs(crossing / 1.75 - period);
  }
  EXPECT_LT(errors[1], 2e-6 * period);
  EXPECT_NEAR(errors[0] / errors[1], 4, 0.3);  // second order
}

TEST(ContactWorldMotion, PendulumKeepsItsEnergyOverManySwings) {
  World world(pendulum(2.5), {});
  const double before = world.energy();
  double worst = 0;
  for (int k = 0; k < 100000; ++k) {
    world.step(1e-3);
    worst = std::max(worst, std::abs(world.energy() - before));
  }
  EXPECT_LT(worst, 2e-4);  // of 35 J, over 30 swings: no drift, oscillation of O(h²)
  EXPECT_LT(world.largest_gap(), 1e-9);
}

robot::RobotModel random_robot(Draw& draw, int n) {
  robot::RobotModel model = draw.robot(Kind::kTree, n);
  for (robot::Body& body : model.bodies) body.inertia.I_CC = body.inertia.I_CC.selfadjointView<Eigen::Upper>();  // to the bit
  return model;
}

/// The largest difference of q between the contact world and (2a) with a fine Runge–Kutta step, after 0.3 s of free fall.
double difference(const robot::RobotModel& model, const VectorXd& q0, const VectorXd& dq0, const VectorXd& tau, double h,
                  Method method) {
  scene::Scene scene;
  scene.gravity = model.gravity;
  const Assembled parts = assemble(scene, model, {}, Base::kFixed, std::span(q0.data(), static_cast<std::size_t>(q0.size())),
                                   std::span(dq0.data(), static_cast<std::size_t>(dq0.size())));
  for (scene::Joint& joint : scene.joints) {
    joint.q_min = -kInfinity;
    joint.q_max = kInfinity;
  }
  Options options;
  options.method = method;
  options.iterations = 2000;
  options.tolerance = 1e-12;
  World world(scene, options);
  constexpr double kTime = 0.3;
  for (int k = 0; k < static_cast<int>(std::lround(kTime / h)); ++k) {
    for (std::size_t i = 0; i < parts.joints.size(); ++i) world.set_tau(parts.joints[i], tau[static_cast<Eigen::Index>(i)]);
    world.step(h);
  }

  const robot::Mechanism mechanism(model);
  robot::Data data(mechanism);
  VectorXd q = q0, dq = dq0;
  const auto f = [&](const VectorXd& at, const VectorXd& speed) {
    VectorXd ddq(q.size());
    robot::forward_dynamics(mechanism, data, at, speed, tau, ddq);
    return ddq;
  };
  const double fine = 1e-4;
  for (int k = 0; k < static_cast<int>(std::lround(kTime / fine)); ++k) {
    const VectorXd a1 = f(q, dq), v2 = dq + fine / 2 * a1;
    const VectorXd a2 = f(q + fine / 2 * dq, v2), v3 = dq + fine / 2 * a2;
    const VectorXd a3 = f(q + fine / 2 * v2, v3), v4 = dq + fine * a3;
    const VectorXd a4 = f(q + fine * v3, v4);
    q += fine / 6 * (dq + 2 * v2 + 2 * v3 + v4);
    dq += fine / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
  }
  double worst = 0;
  for (std::size_t i = 0; i < parts.joints.size(); ++i) {
    const double apart = world.q()[parts.joints[i]] - q[static_cast<Eigen::Index>(i)];
    const bool turns = scene.joints[parts.joints[i]].type == scene::JointType::kRevolute;
    worst = std::max(worst, std::abs(turns ? std::remainder(apart, 2 * kPi) : apart));
  }
  return worst;
}

TEST(ContactWorldKeystone, Lwr4MovesAsInReducedCoordinatesWithErrorOfSecondOrder) {
  const robot::RobotModel model = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  VectorXd q(7), dq(7), tau(7);
  q << 0.3, 0.5, -0.2, 1.2, 0.4, -0.6, 0.2;
  dq << 0.5, -1, 0.8, 1, -0.7, 0.6, 1;
  tau << 5, -20, 3, 10, 0.1, 0.05, 0.005;
  for (const Method method : {Method::kTree, Method::kDantzig}) {
    const double coarse = difference(model, q, dq, tau, 1e-3, method), fine = difference(model, q, dq, tau, 5e-4, method);
    EXPECT_LT(coarse, 2e-4);
    EXPECT_NEAR(coarse / fine, 4, 0.2);
  }
}

TEST(ContactWorldKeystone, BranchedTreesMoveAsInReducedCoordinatesWithErrorOfSecondOrder) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Draw draw(seed);
    const robot::RobotModel model = random_robot(draw, 9);
    const VectorXd q = draw.numbers(9, -0.5, 0.5), dq = draw.numbers(9, -0.5, 0.5), tau = draw.numbers(9, -2, 2);
    const double coarse = difference(model, q, dq, tau, 5e-4, Method::kTree);
    const double fine = difference(model, q, dq, tau, 2.5e-4, Method::kTree);
    EXPECT_LT(coarse, 1e-3) << "seed " << seed;
    EXPECT_NEAR(coarse / fine, 4, 0.5) << "seed " << seed;
  }
}

TEST(ContactWorldKeystone, GaussSeidelThatConvergesMovesAsTheTree) {
  Draw draw(7);
  const robot::RobotModel model = random_robot(draw, 3);
  const VectorXd q = draw.numbers(3, -0.5, 0.5), dq = draw.numbers(3, -0.5, 0.5), tau = draw.numbers(3, -2, 2);
  const double tree = difference(model, q, dq, tau, 1e-3, Method::kTree);
  EXPECT_NEAR(difference(model, q, dq, tau, 1e-3, Method::kPgs), tree, 1e-9);
}

TEST(ContactWorldMotion, ArmHeldByGravityTorquesDoesNotCreepWhileBoxesCollideBeside) {
  const std::vector<double> q{0.3, 0.5, -0.2, 1.2, 0.4, -0.6, 0.2};
  scene::Scene scene = cotwin::testing::arm(q);
  scene.bodies.push_back(cotwin::testing::ground(0.5));
  scene.bodies.back().X_WB.p.z() = -2;
  for (int k = 0; k < 3; ++k)
    scene.bodies.push_back(cotwin::testing::box("box", {0.1, 0.1, 0.1}, 1, {0.01 * k, 0, -1.9 + 0.15 * k}, 0.5));
  World world(scene, {});
  std::vector<double> tau(7);
  double gap = 0;
  for (int k = 0; k < 2000; ++k) {
    cotwin::testing::gravity_torques(world.q(), tau);
    for (std::size_t i = 0; i < 7; ++i) world.set_tau(i, tau[i]);
    world.step(1e-3);
    gap = std::max(gap, world.largest_gap());
  }
  for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(world.q()[i], q[i], 1e-9);
  EXPECT_LT(gap, 1e-9);
}

TEST(ContactWorldMotion, SpringOnAnAxisSwingsAtItsFrequencyHoweverStiff) {
  // (2c) on the link side: τ(s) = τ + K (θ̇ s − Δq), renewed each step, is a spring to θ. With the implicit midpoint rule its
  // phase is 2 atan(ω h / 2) per step, and its energy is conserved.
  for (const double stiffness : {1e3, 1e7}) {
    scene::Scene scene = pendulum(0.01);
    scene.gravity.setZero();
    World world(scene, {});
    const double h = 1e-3, inertia = 2.2;
    double highest = 0;
    for (int k = 0; k < 20000; ++k) {
      world.set_tau(0, -stiffness * world.q()[0], stiffness);
      world.step(h);
      const double energy = inertia * world.dq()[0] * world.dq()[0] / 2 + stiffness * world.q()[0] * world.q()[0] / 2;
      highest = std::max(highest, std::abs(energy / (stiffness * 1e-4 / 2) - 1));
    }
    EXPECT_LT(highest, 1e-4) << stiffness;  // error due to the joint's tolerance after 20 000 steps
  }
}

}  // namespace
}  // namespace cotwin::contact_world::motion_test
