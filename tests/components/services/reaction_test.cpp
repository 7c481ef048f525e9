// What motions do to a free base, against Newton and Euler of all bodies, closed forms, conserved momentum, and the contact world.

#include "components/services/reaction_service.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <numbers>

#include "components/contact_world/assemble.h"
#include "components/contact_world/engine/world.h"
#include "components/services/json/json.h"
#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "models/trajectory/series/series.h"
#include "tests/models/robot/maximal_coordinates.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::services::reaction_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;
using nlohmann::json;
using ::testing::HasSubstr;
using Vector6 = Eigen::Matrix<double, 6, 1>;

std::vector<double> to_vector(const VectorXd& v) { return {v.begin(), v.end()}; }

/// A quintic from rest to rest.
trajectory::Path move(const VectorXd& from, const VectorXd& to, double T) {
  const std::vector<double> rest(static_cast<std::size_t>(2 * from.size()));
  VectorXd q(2 * from.size());
  q << from, to;
  return {static_cast<std::size_t>(from.size()), {0, T}, to_vector(q), rest, rest};
}

robot::RobotModel random_satellite(robot::testing::Draw& draw, robot::testing::Kind kind, int n) {
  robot::RobotModel robot = draw.robot(kind, n);
  robot.base.name = "hull";
  robot.base.inertia = draw.inertia();
  for (robot::Body* body : {&robot.base, &robot.bodies[0]})
    body->inertia.I_CC = Matrix3d(body->inertia.I_CC.selfadjointView<Eigen::Upper>());
  return robot;
}

/// Joints at a time.
struct Joints {
  Joints(const trajectory::Path& path, double t) : q(path.joints()), dq(q), ddq(q) { path.at(t, q, dq, ddq); }
  std::vector<double> q, dq, ddq;
};

/// The base in an inertial frame: pose and twist of its origin.
struct Base {
  Quaterniond Q = Quaterniond::Identity();
  Vector3d p = Vector3d::Zero(), v = Vector3d::Zero(), w = Vector3d::Zero();
};

struct Sums {
  Vector6 momentum = Vector6::Zero();  // about the inertial origin
  Vector6 rate = Vector6::Zero();      // Σ m a, Σ c × m a + I ẇ + w × I w, for a base that does not accelerate …
  Eigen::Matrix<double, 6, 6> by_base = Eigen::Matrix<double, 6, 6>::Zero();  // … and its derivative by the base's acceleration
};

/// Newton and Euler of all bodies, from the base outwards: velocities and accelerations in the inertial frame.
Sums newton_euler(const robot::RobotModel& robot, const Joints& x, const Base& base) {
  struct Motion {
    Pose X;
    Vector3d v, w, a, dw;
  };
  std::vector<Motion> motions;
  const Motion of_base{{base.Q.toRotationMatrix(), base.p}, base.v, base.w, Vector3d::Zero(), Vector3d::Zero()};
  Sums sums;
  const auto add = [&](const Inertia& body, const Motion& m) {
    const Vector3d r = m.X.R * body.p_LC, c = m.X.p + r;
    const Matrix3d I = m.X.R * body.I_CC * m.X.R.transpose();
    const Vector3d v = m.v + m.w.cross(r), a = m.a + m.dw.cross(r) + m.w.cross(m.w.cross(r));
    sums.momentum.head<3>() += body.mass * v;
    sums.momentum.tail<3>() += body.mass * c.cross(v) + I * m.w;
    sums.rate.head<3>() += body.mass * a;
    sums.rate.tail<3>() += body.mass * c.cross(a) + I * m.dw + m.w.cross(I * m.w);
    for (int k = 0; k < 3; ++k) {
      const Vector3d unit = Vector3d::Unit(k), turned = unit.cross(c - base.p);
      sums.by_base.col(k) += body.mass * (Vector6() << unit, c.cross(unit)).finished();
      sums.by_base.col(k + 3) += (Vector6() << body.mass * turned, body.mass * c.cross(turned) + I * unit).finished();
    }
  };
  add(robot.base.inertia, of_base);
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    const robot::Joint& joint = robot.joints[i];
    const Motion& parent = joint.parent < 0 ? of_base : motions[static_cast<std::size_t>(joint.parent)];
    const bool slides = joint.type == robot::JointType::kPrismatic;
    const Pose before = parent.X * joint.X_PJ;
    const Vector3d z = before.R * joint.axis;
    Motion m;
    m.X = before * (slides ? Pose{Matrix3d::Identity(), x.q[i] * joint.axis}
                           : Pose{Eigen::AngleAxisd(x.q[i], joint.axis).toRotationMatrix(), Vector3d::Zero()});
    const Vector3d r = m.X.p - parent.X.p;
    m.v = parent.v + parent.w.cross(r);
    m.w = parent.w;
    m.a = parent.a + parent.dw.cross(r) + parent.w.cross(parent.w.cross(r));
    m.dw = parent.dw;
    if (slides) {
      m.v += x.dq[i] * z;
      m.a += x.ddq[i] * z + 2 * x.dq[i] * parent.w.cross(z);
    } else {
      m.w += x.dq[i] * z;
      m.dw += x.ddq[i] * z + x.dq[i] * parent.w.cross(z);
    }
    add(robot.bodies[i].inertia, m);
    motions.push_back(m);
  }
  return sums;
}

/// The acceleration of the base at which the sums of forces and moments are zero.
Vector6 free_acceleration(const robot::RobotModel& robot, const Joints& x, const Base& base) {
  const Sums sums = newton_euler(robot, x, base);
  return sums.by_base.lu().solve(-sums.rate);
}

/// RK4 of the base's second-order motion.
Base fly(const robot::RobotModel& robot, const trajectory::Path& path, Base base, int steps) {
  const double h = path.end() / steps;
  const auto moved = [](Base b, double dt, const Base& at, const Vector6& A) {
    const Vector3d w = at.w;
    b.Q.coeffs() += 0.5 * dt * (Quaterniond(0, w.x(), w.y(), w.z()) * at.Q).coeffs();
    b.p += dt * at.v;
    b.v += dt * A.head<3>();
    b.w += dt * A.tail<3>();
    return b;
  };
  const auto plain = [](Base b) {
    b.Q.normalize();
    return b;
  };
  for (int k = 0; k < steps; ++k) {
    const double t = path.end() * k / steps;
    const Joints first(path, t), middle(path, t + 0.5 * h), last(path, std::min(t + h, path.end()));
    const Base& a = base;
    const Vector6 A_a = free_acceleration(robot, first, plain(a));
    const Base b = moved(base, 0.5 * h, a, A_a);
    const Vector6 A_b = free_acceleration(robot, middle, plain(b));
    const Base c = moved(base, 0.5 * h, b, A_b);
    const Vector6 A_c = free_acceleration(robot, middle, plain(c));
    const Base d = moved(base, h, c, A_c);
    const Vector6 A_d = free_acceleration(robot, last, plain(d));
    base = plain(moved(moved(moved(moved(base, h / 6, a, A_a), h / 3, b, A_b), h / 3, c, A_c), h / 6, d, A_d));
  }
  return base;
}

/// A base that moves as in `b`.
Base base_of(const BaseAt& b, const robot::RobotModel& robot, const Joints& x, const Vector6& momentum) {
  Base base{b.attitude, b.displacement, Vector3d::Zero(), b.rate};
  const Sums at_rest = newton_euler(robot, x, base);
  base.v = (momentum.head<3>() - at_rest.momentum.head<3>()) / at_rest.by_base(0, 0);
  return base;
}

constexpr int kSteps = 340;

TEST(Reaction, IsTheMotionByNewtonAndEulerOfTwentyRandomTrees) {
  robot::testing::Draw draw(7);
  for (int i = 0; i < 20; ++i) {
    const int n = draw.integer(2, 6);
    SCOPED_TRACE("tree " + std::to_string(i) + " of " + std::to_string(n));
    const robot::RobotModel robot = random_satellite(draw, static_cast<robot::testing::Kind>(i % 3), n);
    const VectorXd from = draw.numbers(n, -0.4, 0.4), to = draw.numbers(n, -0.4, 0.4);
    const trajectory::Path path = move(from, to, 2);
    ReactionOptions o;
    if (i % 2 == 1) {
      o.momentum = draw.numbers(3, -1, 1);
      o.spin = draw.numbers(3, -0.05, 0.05);
    }
    const Reaction r = reaction(robot, path, o);
    const Joints start(path, 0);
    Vector6 momentum;
    momentum << o.momentum, o.spin;
    const Sums sums = newton_euler(robot, start, {});
    EXPECT_NEAR(sums.by_base(0, 0), r.mass, 1e-12 * r.mass);
    const Vector3d centre = Vector3d(sums.by_base(5, 1), sums.by_base(3, 2), sums.by_base(4, 0)) / r.mass;
    momentum.tail<3>() += centre.cross(o.momentum);
    const Base end = fly(robot, path, base_of(r.series.front(), robot, start, momentum), kSteps);
    if (std::getenv("COTWIN_PRINT_FIGURES")) std::printf("tree %d: %g rad\n", i, end.Q.angularDistance(r.end.attitude));
    EXPECT_LT(end.Q.angularDistance(r.end.attitude), 1e-10);
    EXPECT_LT((end.p - r.end.displacement).norm(), 1e-10);
    EXPECT_LT((end.w - r.end.rate).norm(), 1e-10);
    EXPECT_GT(r.most_turned.turn, 1e-3);
    for (const BaseAt& b : r.series) {
      const Joints x(path, b.t);
      const Vector6 now = newton_euler(robot, x, base_of(b, robot, x, momentum)).momentum;
      EXPECT_LT((now - momentum).norm(), 1e-12 * (10 + momentum.norm())) << b.t;
      EXPECT_LE(b.turn, r.most_turned.turn + 1e-12);
      EXPECT_LE(b.rate.norm(), r.fastest.rate.norm() + 1e-12);
      EXPECT_LE(b.displacement.norm(), r.farthest.displacement.norm() + 1e-12);
    }
  }
}

/// A hull of 8 kg and a link of 3 kg in the plane, see floating_base_test.
robot::RobotModel planar(bool prismatic = false) {
  robot::RobotModel robot;
  robot.base.name = "hull";
  robot.base.inertia = {8, {0, 0, 0}, Vector3d(0.5, 0.6, 0.7).asDiagonal()};
  robot.joints.resize(1);
  robot.joints[0].X_PJ.p = {0.4, 0, 0};
  if (prismatic) robot.joints[0].type = robot::JointType::kPrismatic;
  robot.bodies.resize(1);
  robot.bodies[0].inertia = {3, {0.3, 0, 0}, Vector3d(0.01, 0.05, 0.06).asDiagonal()};
  return robot;
}

// dφ/dq = −(I + μ (b² + a b cos q))/(J + 2 μ a b cos q) has a closed integral.
TEST(Reaction, OfOneLinkIsTheClosedForm) {
  const double mu = 8.0 * 3 / 11, a = 0.4, b = 0.3, c = 2 * mu * a * b, J = 0.76 + mu * (a * a + b * b);
  const auto integral = [&](double q) {
    const double root = std::sqrt(J * J - c * c);
    return -(0.5 * q + (0.06 + mu * b * b - 0.5 * J) * 2 / root * std::atan(std::sqrt((J - c) / (J + c)) * std::tan(0.5 * q)));
  };
  for (const auto& [from, to] : {std::pair{-2.5, 2.8}, {0.0, 1.0}, {3.0, -3.0}}) {
    const Reaction r = reaction(planar(), move(VectorXd::Constant(1, from), VectorXd::Constant(1, to), 1.3), {});
    const double turn = integral(to) - integral(from);
    EXPECT_LT(r.end.attitude.angularDistance(Quaterniond(Eigen::AngleAxisd(turn, Vector3d::UnitZ()))), 1e-11);
    EXPECT_NEAR(r.end.turn, std::abs(turn), 1e-11);
    EXPECT_GE(r.most_turned.turn, std::abs(turn) - 1e-11);
    EXPECT_NEAR(r.fastest.t, 0.65, 0.5);
    EXPECT_FALSE(r.drift);
  }
  // A slide along the line through both centres of mass does not turn the base, and moves it by the ratio of masses.
  robot::RobotModel slide = planar(true);
  slide.joints[0].axis = Vector3d::UnitX();
  const Reaction r = reaction(slide, move(VectorXd::Zero(1), VectorXd::Constant(1, 0.5), 1), {});
  EXPECT_LT(r.most_turned.turn, 1e-14);
  EXPECT_NEAR(r.end.displacement.x(), -0.5 * 3 / 11, 1e-14);
  EXPECT_NEAR(r.torques[0].value, 8.0 * 3 / 11 * 0.5 * 10 / std::sqrt(3.0), 1e-4);  // reduced mass · largest acceleration
}

// Joints at rest: Euler's equations of a rigid body, here about a principal axis and with three different moments.
TEST(Reaction, WithMomentumDriftsAsARigidBody) {
  robot::RobotModel robot = planar();
  const VectorXd rest = VectorXd::Zero(1);
  ReactionOptions o;
  o.spin = {0, 0, 0.5};
  o.momentum = {0.11, 0, 0};
  const double J = 0.76 + 8.0 * 3 / 11 * 0.49;
  const Reaction r = reaction(robot, move(rest, rest, 3), o);
  EXPECT_NEAR(r.end.turn, 0.5 / J * 3, 1e-10);
  const double x_C = 3 * 0.7 / 11;
  EXPECT_NEAR(r.end.displacement.x(), 0.01 * 3 + x_C * (1 - std::cos(0.5 / J * 3)), 1e-10);
  ASSERT_TRUE(r.drift);
  EXPECT_LT(r.drift->attitude.angularDistance(r.end.attitude), 1e-12);
  // Many turns in a short time need more steps, and have them.
  o.spin = {0, 0, 200 * J};
  const Reaction fast = reaction(robot, move(rest, rest, 3), o);
  EXPECT_LT(fast.end.attitude.angularDistance(Quaterniond(Eigen::AngleAxisd(600, Vector3d::UnitZ()))), 1e-8);
  o.spin = {1e6, 1e6, 1e6};
  EXPECT_THAT(
      testing::error_of([&] { (void)reaction(robot, move(rest, rest, 100), o); }),
      HasSubstr("base: turns too fast to be followed over 100 s, expected less momentum, or a shorter or smoother motion"));
}

// A recording at 1 kHz with the noise of encoders: 20 000 splines that bend to and fro.
TEST(Reaction, FollowsANoisyRecording) {
  robot::testing::Draw draw(3);
  trajectory::Series clean, noisy;
  clean.width = noisy.width = 1;
  for (int k = 0; k <= 20000; ++k) {
    clean.t.push_back(1e-3 * k);
    clean.x.push_back(std::sin(1e-3 * k));
    noisy.x.push_back(clean.x.back() + draw.number(-3e-4, 3e-4));
  }
  noisy.t = clean.t;
  const Reaction a = reaction(planar(), trajectory::interpolate(clean), {}),
                 b = reaction(planar(), trajectory::interpolate(noisy), {});
  EXPECT_LT(a.end.attitude.angularDistance(b.end.attitude), 5e-4);
  EXPECT_GT(a.end.turn, 0.1);
}

// What the world's bodies do for 10 s, sampled at each step: the base follows from the joints alone. The world's error is of second
// order, so two runs give its limit.
TEST(Reaction, IsThatOfTheContactWorldForTenSeconds) {
  const robot::RobotModel model = robot::load_urdf(places::source() + "/tests/components/data/satellite.urdf");
  const std::vector<double> kStart{0.4, -0.7}, kRest{0, 0};
  const auto run = [&](int parts_of_ms) {
    scene::Scene scene;
    scene.gravity.setZero();
    const auto parts = contact_world::assemble(scene, model, {}, contact_world::Base::kFloating, kStart, kRest);
    for (scene::Joint& joint : scene.joints) joint.q_min = -(joint.q_max = scene::kInfinity);
    contact_world::World world(scene, {});
    trajectory::Series q;
    q.width = 2;
    const auto record = [&](double t) {
      q.t.push_back(t);
      for (const auto joint : parts.joints) q.x.push_back(world.q()[joint]);
    };
    record(0);
    for (int k = 0; k < 10000 * parts_of_ms; ++k) {
      const double t = 1e-3 * (k / parts_of_ms);
      world.set_tau(parts.joints[0], 0.3 * std::sin(4 * t));
      world.set_tau(parts.joints[1], 0.06 * std::sin(4 * t + 1));
      world.step(1e-3 / parts_of_ms);
      if ((k + 1) % (2 * parts_of_ms) == 0) record(1e-3 * (k + 1) / parts_of_ms);
    }
    const Reaction r = reaction(model, trajectory::interpolate(q), {});
    EXPECT_GT(r.most_turned.turn, 0.1);
    const Pose X = world.poses()[parts.base];
    Vector6 difference;
    const Eigen::AngleAxisd turn(X.R.transpose() * r.end.attitude.toRotationMatrix());
    difference << r.end.displacement - X.p, turn.angle() * turn.axis();
    return difference;
  };
  const Vector6 coarse = run(1), fine = run(2);
  EXPECT_LT(((4 * fine - coarse) / 3).cwiseAbs().maxCoeff(), 1e-6) << coarse.transpose() << "\n" << fine.transpose();
}

// ---- as JSON ---------------------------------------------------------------------------------------------------------------

std::string robots_folder() { return places::source() + "/models/robots"; }
json ask(Robots& robots, const json& request) { return json::parse(answer(robots, request.dump())); }
const json kBase{{"mass_kg", 30}, {"com_m", {0.05, -0.03, -0.2}}, {"inertia_kg_m2", {1.5, 0.1, 0.05, 1.2, -0.04, 0.9}}};

json question() {
  return {{"service", "reaction"},
          {"robot", "lwr4"},
          {"from_q_rad", {0, 0.5, 0, -1, 0, 0.6, 0}},
          {"to_q_rad", {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}},
          {"T_s", 2},
          {"base", kBase}};
}

Quaterniond quaternion(const json& q) { return {q[0], q[1], q[2], q[3]}; }

TEST(ReactionService, AnswersASeriesAsTheMoveThatItSamples) {
  Robots robots({robots_folder()});
  const json whole = ask(robots, question());
  EXPECT_TRUE(whole["feasible"]);
  EXPECT_EQ(whole["limiting"]["bound"], "dq");
  EXPECT_EQ(whole["joints"].size(), 7U);
  EXPECT_FALSE(whole.contains("drift"));
  json sampled = question();
  sampled["detail"] = "series";
  for (const char* name : {"from_q_rad", "to_q_rad", "T_s"}) sampled.erase(name);
  const auto robot = robots.find("lwr4");
  Move m;
  m.from_q = question()["from_q_rad"].get<std::vector<double>>();
  m.to_q = question()["to_q_rad"].get<std::vector<double>>();
  m.T = 2;
  const trajectory::Path path = plan(robot->model, m).solution.path;
  for (int k = 0; k <= 200; ++k) {
    sampled["series"]["t_s"].push_back(7 + 0.01 * k);
    sampled["series"]["q_rad"].push_back(Joints(path, 0.01 * k).q);
  }
  const json replay = ask(robots, sampled);
  EXPECT_NEAR(replay["T_s"].get<double>(), 2, 1e-12);
  EXPECT_EQ(replay["feasible"], whole["feasible"]);
  EXPECT_LT(quaternion(replay["end"]["quaternion_wxyz"]).angularDistance(quaternion(whole["end"]["quaternion_wxyz"])), 1e-9);
  for (const char* worst : {"turn", "rate", "displacement"}) {
    EXPECT_NEAR(replay["worst"][worst]["t_s"].get<double>() - 7, whole["worst"][worst]["t_s"].get<double>(), 1e-5);
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_NEAR(replay["worst"][worst]["displacement_m"][k].get<double>(),
                  whole["worst"][worst]["displacement_m"][k].get<double>(), 1e-7);
  }
  EXPECT_EQ(replay["series"]["quaternion_wxyz"].size(), 101U);
  EXPECT_EQ(replay["series"]["t_s"][0], 7);
}

TEST(ReactionService, TakesTheGivenBaseAlsoBesideLockedJoints) {
  Robots robots({robots_folder()});
  // Joint 1 holds link 1 to the base, whose mass the request does not replace.
  json moving = question();
  moving["to_q_rad"][0] = 0;
  json locked = moving;
  for (const char* name : {"from_q_rad", "to_q_rad"}) locked[name].erase(0);
  locked["locked_q"] = {{"joint_1", 0}};
  const json a = ask(robots, moving), b = ask(robots, locked);
  EXPECT_NEAR(a["mass_kg"].get<double>(), b["mass_kg"].get<double>(), 1e-12);
  EXPECT_NEAR(a["mass_kg"].get<double>(), 30 + 16.37074316, 1e-6);
  EXPECT_LT(quaternion(a["end"]["quaternion_wxyz"]).angularDistance(quaternion(b["end"]["quaternion_wxyz"])), 1e-12);
  // The robot's own base is 2 kg.
  json own = question();
  own.erase("base");
  EXPECT_NEAR(ask(robots, own)["mass_kg"].get<double>(), 18.37074316, 1e-6);
  // 10⁴ times heavier or lighter than the arm: the turn goes to zero, or to that of a base without mass.
  const auto turn = [&](double factor) {
    json request = question();
    request["base"] = {{"mass_kg", 16.4 * factor}, {"inertia_kg_m2", {factor, 0, 0, factor, 0, factor}}};
    return ask(robots, request)["end"]["turn_rad"].get<double>();
  };
  EXPECT_NEAR(turn(1e4) / turn(1e5), 10, 0.01);
  EXPECT_NEAR((turn(1e-5) - turn(1e-4)) / (turn(1e-6) - turn(1e-5)), 10, 0.1);
  EXPECT_GT(turn(1e-4), turn(1));
}

TEST(ReactionService, JudgesTorquesOfTheFreeBaseAndTellsTheDrift) {
  Robots robots({robots_folder()});
  json request = question();
  request["drives"] = "none";
  const json free = ask(robots, request);
  const double tau = free["joints"][3]["tau_Nm"]["value"];
  request["tau_max_Nm"] = {nullptr, nullptr, nullptr, 0.9 * std::abs(tau), nullptr, nullptr, nullptr};
  const json bounded = ask(robots, request);
  EXPECT_FALSE(bounded["feasible"]);
  EXPECT_THAT(bounded["reason"].get<std::string>(), HasSubstr("joint joint_4: tau = "));
  EXPECT_EQ(bounded["limiting"]["bound"], "tau");
  EXPECT_NEAR(bounded["limiting"]["share"].get<double>(), 1 / 0.9, 1e-9);
  // Without T_s: the shortest duration, and a note on what it was found with.
  request.erase("T_s");
  request.erase("tau_max_Nm");
  EXPECT_THAT(ask(robots, request)["notes"][0].get<std::string>(), HasSubstr("T_s is the shortest duration"));
  request["T_s"] = 2;
  request["momentum"] = {{"angular_Nms", {0, 0, 0.2}}, {"linear_Ns", {0.1, 0, 0}}};
  const json spinning = ask(robots, request);
  EXPECT_GT(spinning["drift"]["turn_rad"].get<double>(), 0.05);
  EXPECT_EQ(spinning["momentum"], json({{"linear_Ns", {0.1, 0.0, 0.0}}, {"angular_Nms", {0.0, 0.0, 0.2}}}));
}

TEST(ReactionService, RefusesWhatIsNoMotionAndNoBase) {
  Robots robots({robots_folder(), places::source() + "/tests/components/data"});
  const auto refusal = [&](const json& change) {
    json request = question();
    request.merge_patch(change);
    return testing::error_of([&] { (void)ask(robots, request); });
  };
  const json no_move{{"from_q_rad", nullptr}, {"to_q_rad", nullptr}, {"T_s", nullptr}};
  const auto series = [&](const json& s) {
    json request = question();
    for (const auto& [name, unused] : no_move.items()) request.erase(name);
    request["series"] = s;
    return testing::error_of([&] { (void)ask(robots, request); });
  };
  const json row{0, 0, 0, 0, 0, 0, 0};
  EXPECT_THAT(refusal({{"base", {{"mass_kg", nullptr}}}}), HasSubstr("/base/mass_kg: is missing"));
  EXPECT_THAT(refusal({{"base", {{"inertia_kg_m2", nullptr}}}}), HasSubstr("/base/inertia_kg_m2: is missing"));
  EXPECT_THAT(refusal({{"base", {{"mass_kg", 0}}}}), HasSubstr("/base/mass_kg: is 0"));
  EXPECT_THAT(refusal({{"base", {{"inertia_kg_m2", {1, 0, 0, 1, 0, 3}}}}}),
              HasSubstr("/base: principal moments 1, 1, 3 kg m2"));
  EXPECT_THAT(refusal({{"base", {{"mass_kg", 1e15}}}}), HasSubstr("/base/mass_kg: is 1e+15"));
  EXPECT_THAT(refusal({{"base", {{"com_m", {1e15, 0, 0}}}}}), HasSubstr("/base/com_m: has numbers of 1e15 and more"));
  EXPECT_THAT(refusal({{"base", {{"colour", 1}}}}), HasSubstr("/base/colour: is an unknown member"));
  EXPECT_THAT(refusal({{"momentum", {{"angular_Nms", {0, 0}}}}}), HasSubstr("/momentum/angular_Nms: has 2 values, expected 3"));
  EXPECT_THAT(refusal({{"series", {{"t_s", {0, 1}}, {"q_rad", {row, row}}}}}),
              HasSubstr("/from_q_rad: is given beside series"));
  for (const char* service : {"feasibility", "effective_mass", "energy", "verify"}) {
    EXPECT_THAT(refusal({{"service", service}}),
                HasSubstr("/base: is given, but this service knows fixed bases only; `reaction`"))
        << service;
    EXPECT_THAT(refusal({{"service", service}, {"base", nullptr}, {"momentum", {{"linear_Ns", {1, 0, 0}}}}}),
                HasSubstr("`reactionless` answer for a free base"));
  }
  EXPECT_THAT(series({{"t_s", {0, 1}}}),
              HasSubstr("/series/q_rad: is missing, expected 2 postures, one per time (2 to 100000)"));
  EXPECT_THAT(series({{"t_s", {0, 1}}, {"q_rad", 3}}), HasSubstr("/series/q_rad: is no array of 2 postures"));
  EXPECT_THAT(series({{"t_s", {0, 1}}, {"q_rad", {row}}}), HasSubstr("/series/q_rad: is no array of 2 postures"));
  EXPECT_THAT(series({{"t_s", {0}}, {"q_rad", {row}}}),
              HasSubstr("/series/q_rad: is no array of 1 postures, one per time (2 to 100000)"));
  EXPECT_THAT(series({{"t_s", {0, 1}}, {"q_rad", {row, {0, 0}}}}), HasSubstr("/series/q_rad/1: has 2 values, expected 7"));
  EXPECT_THAT(series({{"t_s", {0, 0}}, {"q_rad", {row, row}}}),
              HasSubstr("/series/t_s/1: is 0 after 0, expected at least 0.0001 s more"));
  EXPECT_THAT(series({{"t_s", {0, 1}}, {"q_rad", {row, {0, 0, 0, 1e7, 0, 0, 0}}}}), HasSubstr("/series/q_rad/1/3: is 1e+07"));
  EXPECT_THAT(series({{"t_s", {0, 1}}, {"q_rad", {row, {0, 0, 0, "x", 0, 0, 0}}}}),
              HasSubstr("/series/q_rad/1/3: is of type string"));
  const testing::TemporaryFolder folder("hollow");
  folder.write("hollow.urdf", R"(<robot name="hollow"><link name="frame"/><link name="disc"><inertial><mass value="1"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.8" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="axis" type="continuous">
    <parent link="frame"/><child link="disc"/><axis xyz="0 0 1"/></joint></robot>)");
  Robots hollow({folder.path()});
  json request{{"service", "reaction"}, {"robot", "hollow"}, {"from_q_rad", {0}}, {"to_q_rad", {1}}, {"T_s", 1}};
  EXPECT_THAT(
      testing::error_of([&] { (void)ask(hollow, request); }),
      HasSubstr("/base: is missing, and the robot's base 'frame' cannot float: mass 0 kg, expected > 0; expected its mass_kg, "
                "com_m and inertia_kg_m2"));
  request["base"] = {{"mass_kg", 1}, {"inertia_kg_m2", {1, 0, 0, 1, 0, 0.8}}};
  EXPECT_NEAR(ask(hollow, request)["end"]["turn_rad"].get<double>(), 0.5, 1e-12);  // equal moments about the axis
}

// Two arms on one base that move as mirror images turn it only about the axis in the mirror's plane that both share.
TEST(ReactionService, KnowsRobotsWithTwoArms) {
  const testing::TemporaryFolder folder("arms");
  std::string arms;
  for (const auto& [name, y] : {std::pair{"left", 0.3}, {"right", -0.3}})
    arms += "<link name=\"" + std::string(name) + R"("><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="at_)" +
            name + R"(" type="revolute"><parent link="hull"/><child link=")" + name + R"("/><origin xyz="0 )" +
            std::to_string(y) + R"( 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="3" effort="50"/></joint>)";
  folder.write("arms.urdf", R"(<robot name="arms"><link name="hull"><inertial><mass value="10"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>)" +
                                arms + "</robot>");
  Robots robots({folder.path()});
  json request{{"service", "reaction"}, {"robot", "arms"}, {"from_q_rad", {0, 0}}, {"to_q_rad", {1, -1}}, {"T_s", 1}};
  const json mirrored = ask(robots, request);
  EXPECT_LT(mirrored["worst"]["turn"]["turn_rad"].get<double>(), 1e-14);
  EXPECT_NEAR(mirrored["end"]["displacement_m"][0].get<double>(), -2 * 2 * 0.2 * (std::cos(1.0) - 1) / 14, 1e-14);
  request["to_q_rad"] = {1, 1};
  EXPECT_GT(ask(robots, request)["end"]["turn_rad"].get<double>(), 0.1);
}

TEST(ReactionService, ReadsARecordingAsSeries) {
  Robots robots({robots_folder()});
  const testing::TemporaryFolder folder("recording");
  folder.write("log.csv", "t,q1,q2,q3,q4,q5,q6,q7\n3,0,10,0,20,0,0,0\n3.1,0,11,0,21,0,0,0\n3.2,0,12,0,22,0,0,0\n");
  const json request{{"service", "reaction"}, {"robot", "lwr4"}};
  trajectory::RecordingFormat degrees;
  degrees.angle_unit = std::numbers::pi / 180;
  const json series = series_member(robots, request, folder.path() / "log.csv", degrees);
  EXPECT_EQ(series["q_rad"].size(), 3U);
  EXPECT_NEAR(series["t_s"][2].get<double>(), 0.2, 1e-12);
  EXPECT_NEAR(series["q_rad"][2][3].get<double>(), 22 * std::numbers::pi / 180, 1e-12);
  EXPECT_THAT(testing::error_of([&] { (void)series_member(robots, request, folder.path() / "log.csv", {}); }),
              HasSubstr("log.csv:2: column 'q2'"));
  EXPECT_THAT(testing::error_of([&] { (void)series_member(robots, request, folder.path() / "none.csv", {}); }),
              HasSubstr("none.csv"));
}

}  // namespace
}  // namespace cotwin::services::reaction_test
