#include "tests/support/contact_scenes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "components/contact_world/assemble.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::testing {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Numbers in [low, high) that are the same on every platform.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double operator()(double low, double high) { return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53; }
  Matrix3d rotation() {
    Eigen::Quaterniond q;
    do {
      q.coeffs() << (*this)(-1, 1), (*this)(-1, 1), (*this)(-1, 1), (*this)(-1, 1);
    } while (q.norm() > 1 || q.norm() < 0.1);
    return q.normalized().toRotationMatrix();
  }

 private:
  std::mt19937_64 engine_;
};

scene::Shape box_shape(const Vector3d& edges, double mu) {
  scene::Shape shape;
  shape.name = "box";
  shape.type = scene::ShapeType::kBox;
  shape.size = edges;
  shape.material.mu = mu;
  return shape;
}

scene::Body static_box(const std::string& name, const Vector3d& edges, const Vector3d& p_WB, double mu) {
  scene::Body body;
  body.name = name;
  body.motion = scene::Motion::kStatic;
  body.X_WB.p = p_WB;
  body.shapes = {box_shape(edges, mu)};
  return body;
}

robot::RobotModel lwr4() { return robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf"); }

scene::Scene arm(const robot::RobotModel& model, contact_world::Base base, std::span<const double> q,
                 std::span<const double> dq) {
  scene::Scene scene;
  scene.name = "arm";
  contact_world::assemble(scene, model, {}, base, q, dq);
  for (scene::Joint& joint : scene.joints) {
    joint.q_min = -scene::kInfinity;
    joint.q_max = scene::kInfinity;
  }
  return scene;
}

const Pose& pose_of(int body, std::span<const Pose> X_WB) {
  static const Pose world;
  return body < 0 ? world : X_WB[static_cast<std::size_t>(body)];
}

}  // namespace

scene::Body ground(double mu, double restitution) {
  scene::Body body = slope(0, mu);
  body.name = "ground";
  body.shapes[0].material.restitution = restitution;
  return body;
}

scene::Body slope(double angle, double mu) {
  scene::Body body;
  body.name = "slope";
  body.motion = scene::Motion::kStatic;
  body.X_WB.R = Eigen::AngleAxisd(angle, Vector3d::UnitY()).toRotationMatrix();
  scene::Shape plane;
  plane.name = "plane";
  plane.type = scene::ShapeType::kPlane;
  plane.material.mu = mu;
  body.shapes = {plane};
  return body;
}

scene::Body box(const std::string& name, const Vector3d& edges, double mass, const Vector3d& p_WB, double mu) {
  scene::Body body = static_box(name, edges, p_WB, mu);
  body.motion = scene::Motion::kDynamic;
  body.inertia.mass = mass;
  const Vector3d squares = edges.cwiseAbs2();
  body.inertia.I_CC.diagonal() = mass / 12 * (squares.sum() - squares.array()).matrix();
  return body;
}

scene::Body ball(const std::string& name, double radius, double mass, const Vector3d& p_WB, double mu, double restitution) {
  scene::Body body;
  body.name = name;
  body.X_WB.p = p_WB;
  body.inertia.mass = mass;
  body.inertia.I_CC = 0.4 * mass * radius * radius * Matrix3d::Identity();
  scene::Shape sphere;
  sphere.name = "ball";
  sphere.type = scene::ShapeType::kSphere;
  sphere.size.x() = radius;
  sphere.material = {mu, restitution, scene::kInfinity, 0};
  body.shapes = {sphere};
  return body;
}

scene::Scene arm(std::span<const double> q) {
  const std::vector<double> dq(q.size(), 0.0);
  return arm(lwr4(), contact_world::Base::kFixed, q, dq);
}

scene::Scene floating_arm(std::span<const double> q, std::span<const double> dq) {
  robot::RobotModel model = lwr4();
  model.base.inertia.mass = 10;
  model.base.inertia.I_CC.diagonal() << 0.2, 0.3, 0.25;
  scene::Scene scene = arm(model, contact_world::Base::kFloating, q, dq);
  scene.gravity.setZero();
  return scene;
}

void gravity_torques(std::span<const double> q, std::span<double> tau) {
  const robot::Mechanism mechanism(lwr4());
  robot::Data data(mechanism);
  const Eigen::Map<const Eigen::VectorXd> at(q.data(), static_cast<Eigen::Index>(q.size()));
  const Eigen::VectorXd rest = Eigen::VectorXd::Zero(at.size());
  Eigen::VectorXd out(at.size());
  robot::inverse_dynamics(mechanism, data, at, rest, rest, out);
  std::copy(out.begin(), out.end(), tau.begin());
}

scene::Scene stack(int boxes) {
  scene::Scene scene;
  scene.name = "stack";
  scene.bodies.push_back(ground(0.5));
  for (int k = 0; k < boxes; ++k) {
    scene.bodies.push_back(
        box("box_" + std::to_string(k), Vector3d::Constant(kStackEdge), 1, {0, 0, (k + 0.5) * kStackEdge}, 0.5));
  }
  return scene;
}

scene::Scene slot(double clearance) {
  constexpr double kWall = 0.04, kMu = 0.3;
  scene::Scene scene;
  scene.name = "slot";
  const double x = 0.5 * (kPegWidth + clearance + kWall);
  scene.bodies.push_back(static_box("floor", {0.2, 0.2, kWall}, {0, 0, -0.5 * kWall}, kMu));
  scene.bodies.push_back(static_box("left", {kWall, 0.1, kPegLength}, {-x, 0, 0.5 * kPegLength}, kMu));
  scene.bodies.push_back(static_box("right", {kWall, 0.1, kPegLength}, {x, 0, 0.5 * kPegLength}, kMu));
  scene.bodies.push_back(box("peg", {kPegWidth, kPegWidth, kPegLength}, 0.2, {0, 0, kPegLength}, kMu));
  scene.no_contact = {{0, 1}, {0, 2}, {1, 2}};
  return scene;
}

scene::Scene pile(int boxes, std::uint64_t seed) {
  scene::Scene scene;
  scene.name = "pile";
  scene.bodies.push_back(ground(0.5));
  Random random(seed);
  const int across = std::max(2, static_cast<int>(std::cbrt(boxes)));
  constexpr double kEdge = 0.1, kPitch = 0.19;  // a cube's diagonal is 0.173 m
  for (int k = 0; k < boxes; ++k) {
    const int layer = k / (across * across), row = k / across % across, column = k % across;
    scene::Body body = box("box_" + std::to_string(k), Vector3d::Constant(kEdge), 1,
                           {kPitch * column + random(0, 0.01), kPitch * row + random(0, 0.01), kPitch * (layer + 0.6)}, 0.5);
    body.X_WB.R = random.rotation();
    scene.bodies.push_back(body);
  }
  return scene;
}

scene::Scene balls(int count, std::uint64_t seed) {
  constexpr double kRadius = 0.05, kPitch = 0.11, kWall = 0.1;
  constexpr int kAcross = 6;
  scene::Scene scene;
  scene.name = "balls";
  scene.bodies.push_back(ground(0.5));
  const double width = kPitch * kAcross, height = 3, middle = 0.5 * (width - kPitch);
  for (const double side : {-1.0, 1.0}) {
    const double offset = side * 0.5 * (width + kWall);
    scene.bodies.push_back(
        static_box("wall_x", {kWall, width + 2 * kWall, height}, {middle + offset, middle, 0.5 * height}, 0.5));
    scene.bodies.push_back(
        static_box("wall_y", {width + 2 * kWall, kWall, height}, {middle, middle + offset, 0.5 * height}, 0.5));
  }
  for (int a = 0; a < 5; ++a) {
    for (int b = a + 1; b < 5; ++b) scene.no_contact.emplace_back(a, b);
  }
  Random random(seed);
  for (int k = 0; k < count; ++k) {
    const int layer = k / (kAcross * kAcross), row = k / kAcross % kAcross, column = k % kAcross;
    scene.bodies.push_back(ball("ball_" + std::to_string(k), kRadius, 0.5,
                                {kPitch * column + random(-0.004, 0.004), kPitch * row + random(-0.004, 0.004),
                                 kPitch * (layer + 0.5) + random(-0.004, 0.004)},
                                0.5));
  }
  return scene;
}

namespace {

constexpr double kBallRadius = 0.1, kBallMu = 0.3, kGravity = 9.81;
const Vector3d kBallSpeed(2, 0.5, 0), kBallSpin(3, -4, 6);

}  // namespace

scene::Scene pushed_ball() {
  scene::Scene scene;
  scene.name = "pushed_ball";
  scene.bodies = {ground(kBallMu), ball("ball", kBallRadius, 1, {0, 0, kBallRadius}, kBallMu)};
  scene.bodies[1].V_WB << kBallSpeed, kBallSpin;
  return scene;
}

Twist pushed_ball_at(double t, Vector3d& p_WB) {
  const Vector3d arm(0, 0, -kBallRadius), slip = kBallSpeed + kBallSpin.cross(arm), direction = slip.normalized();
  const double rolls = 2 * slip.norm() / (7 * kBallMu * kGravity), s = std::min(t, rolls);
  const Vector3d v = kBallSpeed - kBallMu * kGravity * s * direction;
  p_WB = Vector3d(0, 0, kBallRadius) + 0.5 * (kBallSpeed + v) * s + v * (t - s);
  // I ω̇ = arm × (−μ m g ŝ) with I = 0.4 m r²
  const Vector3d w = kBallSpin - s * kBallMu * kGravity / (0.4 * kBallRadius * kBallRadius) * arm.cross(direction);
  return (Twist() << v, w).finished();
}

scene::Scene bouncing_ball() {
  scene::Scene scene;
  scene.name = "bouncing_ball";
  scene.bodies = {ground(0.5, 1), ball("ball", kBallRadius, 1, {0, 0, 1 + kBallRadius}, 0.5, 1)};
  return scene;
}

scene::Scene box_on_slope(double angle) {
  scene::Scene scene;
  scene.name = "box_on_slope";
  scene.bodies = {slope(angle, 0.5), box("box", {0.2, 0.2, 0.1}, 1, Vector3d::Zero(), 0.5)};
  scene.bodies[1].X_WB.R = scene.bodies[0].X_WB.R;
  scene.bodies[1].X_WB.p = scene.bodies[0].X_WB.R * Vector3d(0, 0, 0.05);
  return scene;
}

scene::Scene held_box() {
  scene::Scene scene;
  scene.name = "held_box";
  scene.bodies = {static_box("wall", {0.1, 0.4, 0.4}, {-0.05, 0, 1}, 0.5),
                  box("box", Vector3d::Constant(0.1), 1, {0.05, 0, 1}, 0.5),
                  box("plate", {0.02, 0.1, 0.1}, 0.3, {0.11, 0, 1}, 0.5)};
  return scene;
}

scene::Scene spinning_box() {
  scene::Scene scene;
  scene.name = "spinning_box";
  scene.gravity.setZero();
  scene.bodies = {box("box", {0.1, 0.2, 0.3}, 1, Vector3d::Zero(), 0.5)};
  scene.bodies[0].V_WB << 0, 0, 0, 0.01, 10, 0;
  return scene;
}

scene::Scene tossed_box() {
  scene::Scene scene;
  scene.name = "tossed_box";
  scene.bodies = {ground(0.5), box("box", {0.1, 0.15, 0.2}, 1, {0, 0, 0.5}, 0.5)};
  scene.bodies[1].X_WB.R = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  scene.bodies[1].V_WB << 1, 0.3, 0, 5, -8, 3;
  return scene;
}

double depth_on_top(const Pose& X_WU, const Pose& X_WL, const Vector3d& edges) {
  const Pose X_LU = X_WL.inverse() * X_WU;
  double depth = -scene::kInfinity;
  for (int corner = 0; corner < 8; ++corner) {
    const Vector3d signs(corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5);
    depth = std::max(depth, 0.5 * edges.z() - (X_LU * Vector3d(signs.cwiseProduct(edges))).z());
  }
  return depth;
}

double energy(const scene::Scene& scene, std::span<const Pose> X_WB, std::span<const Twist> V_WB) {
  double sum = 0;
  for (std::size_t k = 0; k < scene.bodies.size(); ++k) {
    const scene::Body& body = scene.bodies[k];
    if (body.motion != scene::Motion::kDynamic) continue;
    const Matrix3d& R = X_WB[k].R;
    const Vector3d r = R * body.inertia.p_LC, w = V_WB[k].tail<3>(), v = V_WB[k].head<3>() + w.cross(r),
                   w_B = R.transpose() * w;
    sum += 0.5 * body.inertia.mass * v.squaredNorm() + 0.5 * w_B.dot(body.inertia.I_CC * w_B) -
           body.inertia.mass * scene.gravity.dot(X_WB[k].p + r);
  }
  return sum;
}

Wrench momentum(const scene::Scene& scene, std::span<const Pose> X_WB, std::span<const Twist> V_WB) {
  Wrench sum = Wrench::Zero();
  for (std::size_t k = 0; k < scene.bodies.size(); ++k) {
    const scene::Body& body = scene.bodies[k];
    if (body.motion != scene::Motion::kDynamic) continue;
    const Matrix3d& R = X_WB[k].R;
    const Vector3d r = R * body.inertia.p_LC, w = V_WB[k].tail<3>();
    const Vector3d p = body.inertia.mass * (V_WB[k].head<3>() + w.cross(r));
    sum.head<3>() += p;
    sum.tail<3>() += R * (body.inertia.I_CC * (R.transpose() * w)) + (X_WB[k].p + r).cross(p);
  }
  return sum;
}

double joint_gap(const scene::Scene& scene, std::span<const Pose> X_WB) {
  double gap = 0;
  for (const scene::Joint& joint : scene.joints) {
    if (joint.type == scene::JointType::kPrismatic) continue;
    gap = std::max(gap, (pose_of(joint.parent, X_WB) * joint.X_PJ.p - pose_of(joint.child, X_WB) * joint.X_CJ.p).norm());
  }
  return gap;
}

double joint_angle(const scene::Scene& scene, std::size_t joint, std::span<const Pose> X_WB) {
  const scene::Joint& j = scene.joints[joint];
  const Pose X_JJ = (pose_of(j.parent, X_WB) * j.X_PJ).inverse() * (pose_of(j.child, X_WB) * j.X_CJ);
  const Vector3d x = j.axis.unitOrthogonal(), y = j.axis.cross(x), turned = X_JJ.R * x;
  return std::atan2(y.dot(turned), x.dot(turned));
}

}  // namespace cotwin::testing
