#include <btBulletDynamicsCommon.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {
namespace {

constexpr int kIterations = 10;
constexpr double kMargin = 1e-3;  // m

btVector3 to_bullet(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
btTransform to_bullet(const Pose& X) {
  return btTransform(
      btMatrix3x3(X.R(0, 0), X.R(0, 1), X.R(0, 2), X.R(1, 0), X.R(1, 1), X.R(1, 2), X.R(2, 0), X.R(2, 1), X.R(2, 2)),
      to_bullet(X.p));
}
Eigen::Vector3d from_bullet(const btVector3& v) { return {v.x(), v.y(), v.z()}; }
Pose from_bullet(const btTransform& X) {
  Pose out;
  out.p = from_bullet(X.getOrigin());
  for (int i = 0; i < 3; ++i) out.R.row(i) = from_bullet(X.getBasis().getRow(i)).transpose();
  return out;
}

// A hinge's frame, z along the axis.
Pose hinge_frame(const Pose& X, const Eigen::Vector3d& axis) {
  Pose hinge = X;
  const Eigen::Vector3d x = axis.unitOrthogonal();
  Eigen::Matrix3d R;
  R << x, axis.cross(x), axis;
  hinge.R = X.R * R;
  return hinge;
}

class Bullet final : public Engine {
 public:
  Bullet(const scene::Scene& scene, double h) : scene_(scene), h_(h), dispatcher_(&configuration_) {
    world_ = std::make_unique<btDiscreteDynamicsWorld>(&dispatcher_, &broadphase_, &solver_, &configuration_);
    world_->setGravity(to_bullet(scene.gravity));
    world_->getSolverInfo().m_numIterations = kIterations;
    for (const scene::Body& body : scene.bodies) add(body);
    for (const scene::Joint& joint : scene.joints) add(joint);
    for (const auto& [a, b] : scene.no_contact) body(a).setIgnoreCollisionCheck(&body(b), true);
  }
  ~Bullet() override {
    for (const auto& joint : joints_) world_->removeConstraint(joint.get());
    for (const auto& b : bodies_) world_->removeRigidBody(b.get());
  }

  void step(double h) override { world_->stepSimulation(h, 0); }

  void read(std::span<Pose> X_WB, std::span<Twist> V_WB) const override {
    for (std::size_t k = 0; k < bodies_.size(); ++k) {
      const Pose X_WP = from_bullet(bodies_[k]->getWorldTransform());
      X_WB[k] = X_WP * frames_[k].X_BP.inverse();
      const Eigen::Vector3d v = from_bullet(bodies_[k]->getLinearVelocity()), w = from_bullet(bodies_[k]->getAngularVelocity());
      V_WB[k] << v + w.cross(X_WB[k].p - X_WP.p), w;
    }
  }

  void set_tau(std::size_t joint, double tau) override {
    const scene::Joint& j = scene_.joints[joint];
    const btVector3 axis =
        body(j.child).getWorldTransform().getBasis() * to_bullet((X_PJ(j.child, j.X_CJ).R * j.axis).eval()) * tau;
    body(j.child).applyTorque(axis);
    body(j.parent).applyTorque(-axis);
  }
  void set_motor(std::size_t joint, double dq, double tau_max) override {
    joints_[joint]->enableAngularMotor(true, dq, tau_max * h_);
  }
  void apply(std::size_t k, const Wrench& F_C_W) override {
    bodies_[k]->applyCentralForce(to_bullet(F_C_W.head<3>().eval()));
    bodies_[k]->applyTorque(to_bullet(F_C_W.tail<3>().eval()));
  }

 private:
  btRigidBody& body(int k) { return k < 0 ? btTypedConstraint::getFixedBody() : *bodies_[static_cast<std::size_t>(k)]; }
  Pose X_PJ(int k, const Pose& X_BJ) const { return k < 0 ? X_BJ : frames_[static_cast<std::size_t>(k)].X_BP.inverse() * X_BJ; }

  void add(const scene::Body& body) {
    const bool dynamic = body.motion == scene::Motion::kDynamic;
    frames_.push_back(dynamic ? principal(body.inertia) : Principal{});
    const Pose X_WP = body.X_WB * frames_.back().X_BP;
    btCollisionShape* shape = make_shape(body, frames_.back());
    btRigidBody::btRigidBodyConstructionInfo info(dynamic ? body.inertia.mass : 0, nullptr, shape,
                                                  to_bullet(frames_.back().moments));
    info.m_startWorldTransform = to_bullet(X_WP);
    if (!body.shapes.empty())
      info.m_friction = std::sqrt(body.shapes[0].material.mu);  // the product of both bodies' values counts
    auto b = std::make_unique<btRigidBody>(info);
    const Eigen::Vector3d w = body.V_WB.tail<3>(), v = body.V_WB.head<3>() + w.cross(X_WP.p - body.X_WB.p);
    b->setLinearVelocity(to_bullet(v));
    b->setAngularVelocity(to_bullet(w));
    b->setActivationState(DISABLE_DEACTIVATION);
    world_->addRigidBody(b.get());
    bodies_.push_back(std::move(b));
  }

  void add(const scene::Joint& joint) {
    const Pose X_P = hinge_frame(X_PJ(joint.parent, joint.X_PJ), joint.axis);
    const Pose X_C = hinge_frame(X_PJ(joint.child, joint.X_CJ), joint.axis);
    if (joint.type != scene::JointType::kRevolute) throw Error("joint " + joint.name, "is not revolute");
    joints_.push_back(
        std::make_unique<btHingeConstraint>(body(joint.child), body(joint.parent), to_bullet(X_C), to_bullet(X_P)));
    world_->addConstraint(joints_.back().get(), true);
  }

  // The body's first shape at X_PS in the frame P of its principal axes; an empty shape if it has none.
  btCollisionShape* make_shape(const scene::Body& body, const Principal& frame) {
    if (body.shapes.empty()) return &nothing_;
    const scene::Shape& shape = body.shapes[0];
    const Pose X_PS = frame.X_BP.inverse() * shape.X_BS;
    if (shape.type == scene::ShapeType::kPlane) {
      shapes_.push_back(std::make_unique<btStaticPlaneShape>(to_bullet(X_PS.R.col(2).eval()), X_PS.R.col(2).dot(X_PS.p)));
      return shapes_.back().get();
    }
    if (shape.type == scene::ShapeType::kSphere) {
      shapes_.push_back(std::make_unique<btSphereShape>(shape.size.x()));
    } else if (shape.type == scene::ShapeType::kBox) {
      shapes_.push_back(std::make_unique<btBoxShape>(to_bullet((0.5 * shape.size).eval())));
      shapes_.back()->setMargin(kMargin);
    } else {
      throw Error("shape " + shape.name, "is neither a sphere, a box nor a plane");
    }
    if (X_PS == Pose{}) return shapes_.back().get();
    auto compound = std::make_unique<btCompoundShape>();
    compound->addChildShape(to_bullet(X_PS), shapes_.back().get());
    shapes_.push_back(std::move(compound));
    return shapes_.back().get();
  }

  scene::Scene scene_;
  double h_;
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_;
  btDbvtBroadphase broadphase_;
  btSequentialImpulseConstraintSolver solver_;
  btEmptyShape nothing_;
  std::vector<std::unique_ptr<btCollisionShape>> shapes_;
  std::vector<Principal> frames_;
  std::unique_ptr<btDiscreteDynamicsWorld> world_;
  std::vector<std::unique_ptr<btRigidBody>> bodies_;
  std::vector<std::unique_ptr<btHingeConstraint>> joints_;
};

}  // namespace

std::unique_ptr<Engine> make_bullet(const scene::Scene& scene, double h) { return std::make_unique<Bullet>(scene, h); }

}  // namespace cotwin::benchmark
