#include <BulletDynamics/MLCPSolvers/btDantzigSolver.h>
#include <BulletDynamics/MLCPSolvers/btMLCPSolver.h>
#include <btBulletDynamicsCommon.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/benchmarks/contact/bullet_shapes.h"
#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {
namespace {

constexpr int kIterations = 10;

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
  Bullet(const scene::Scene& scene, double h, bool dantzig, int sweeps)
      : scene_(scene), h_(h), dispatcher_(&configuration_), pivoting_(&dantzig_) {
    btConstraintSolver* solver = &sequential_;
    if (dantzig) solver = &pivoting_;
    world_ = std::make_unique<btDiscreteDynamicsWorld>(&dispatcher_, &broadphase_, solver, &configuration_);
    world_->setGravity(to_bullet(scene.gravity));
    world_->getSolverInfo().m_numIterations = sweeps > 0 ? sweeps : kIterations;
    world_->getSolverInfo().m_minimumSolverBatchSize = dantzig ? 1 : 128;  // as in Bullet's own examples
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
    hinges_[joint]->enableAngularMotor(true, dq, tau_max * h_);
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
    btCollisionShape* shape = shapes_.make(body, frames_.back());
    scene::Material material;
    if (!body.shapes.empty()) {
      material = body.shapes[0].material;
    }
    btRigidBody::btRigidBodyConstructionInfo info(dynamic ? body.inertia.mass : 0, nullptr, shape,
                                                  to_bullet(frames_.back().moments));
    info.m_startWorldTransform = to_bullet(X_WP);
    info.m_friction = std::sqrt(material.mu);  // the product of both bodies' values counts
    info.m_restitution = material.restitution;
    auto b = std::make_unique<btRigidBody>(info);
    const Eigen::Vector3d w = body.V_WB.tail<3>(), v = body.V_WB.head<3>() + w.cross(X_WP.p - body.X_WB.p);
    b->setLinearVelocity(to_bullet(v));
    b->setAngularVelocity(to_bullet(w));
    b->setActivationState(DISABLE_DEACTIVATION);
    if (std::isfinite(material.stiffness)) b->setContactStiffnessAndDamping(material.stiffness, material.damping);
    btVector3 centre;
    btScalar radius = 0;
    if (dynamic && !body.shapes.empty()) shape->getBoundingSphere(centre, radius);
    if (radius > 0 && v.norm() * h_ > radius) {
      b->setCcdMotionThreshold(radius);
      b->setCcdSweptSphereRadius(0.8 * radius);
    }
    world_->addRigidBody(b.get());
    bodies_.push_back(std::move(b));
  }

  void add(const scene::Joint& joint) {
    const Pose X_P = hinge_frame(X_PJ(joint.parent, joint.X_PJ), joint.axis);
    const Pose X_C = hinge_frame(X_PJ(joint.child, joint.X_CJ), joint.axis);
    // The second body rotates about z of the first one's frame.
    hinges_.push_back(nullptr);
    switch (joint.type) {
      case scene::JointType::kRevolute: {
        auto hinge = std::make_unique<btHingeConstraint>(body(joint.child), body(joint.parent), to_bullet(X_C), to_bullet(X_P));
        hinges_.back() = hinge.get();
        if (joint.q_min > -scene::kInfinity && joint.q_max < scene::kInfinity) hinge->setLimit(joint.q_min, joint.q_max);
        joints_.push_back(std::move(hinge));
        break;
      }
      case scene::JointType::kPrismatic: {  // along x of the frames
        const Pose x_to_z{Eigen::AngleAxisd(-M_PI / 2, Eigen::Vector3d::UnitY()).toRotationMatrix(), Eigen::Vector3d::Zero()};
        auto slider = std::make_unique<btSliderConstraint>(body(joint.parent), body(joint.child), to_bullet(X_P * x_to_z),
                                                           to_bullet(X_C * x_to_z), true);
        slider->setLowerLinLimit(1);  // lower > upper: free
        slider->setUpperLinLimit(-1);
        slider->setLowerAngLimit(0);
        slider->setUpperAngLimit(0);
        joints_.push_back(std::move(slider));
        break;
      }
      case scene::JointType::kSpherical:
        joints_.push_back(std::make_unique<btPoint2PointConstraint>(body(joint.child), body(joint.parent), to_bullet(X_C.p),
                                                                    to_bullet(X_P.p)));
        break;
      case scene::JointType::kFixed:
        joints_.push_back(
            std::make_unique<btFixedConstraint>(body(joint.child), body(joint.parent), to_bullet(X_C), to_bullet(X_P)));
        break;
      case scene::JointType::kScrew:
        throw Error("joint " + joint.name, "is a screw, which no compared scene has");
    }
    world_->addConstraint(joints_.back().get(), true);
  }

  scene::Scene scene_;
  double h_;
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_;
  btDbvtBroadphase broadphase_;
  btSequentialImpulseConstraintSolver sequential_;
  btDantzigSolver dantzig_;
  btMLCPSolver pivoting_;
  BulletShapes shapes_;
  std::vector<Principal> frames_;
  std::unique_ptr<btDiscreteDynamicsWorld> world_;
  std::vector<std::unique_ptr<btRigidBody>> bodies_;
  std::vector<std::unique_ptr<btTypedConstraint>> joints_;
  std::vector<btHingeConstraint*> hinges_;  // of each joint; null for other types
};

}  // namespace

std::unique_ptr<Engine> make_bullet_si(const scene::Scene& scene, double h, int sweeps) {
  return std::make_unique<Bullet>(scene, h, false, sweeps);
}
std::unique_ptr<Engine> make_bullet_dantzig(const scene::Scene& scene, double h, int sweeps) {
  return std::make_unique<Bullet>(scene, h, true, sweeps);
}

}  // namespace cotwin::benchmark
