#include <BulletDynamics/Featherstone/btMultiBody.h>
#include <BulletDynamics/Featherstone/btMultiBodyConstraintSolver.h>
#include <BulletDynamics/Featherstone/btMultiBodyDynamicsWorld.h>
#include <BulletDynamics/Featherstone/btMultiBodyJointMotor.h>
#include <BulletDynamics/Featherstone/btMultiBodyLinkCollider.h>
#include <BulletDynamics/Featherstone/btMultiBodyPoint2Point.h>

#include <Eigen/Geometry>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "tests/benchmarks/contact/bullet_shapes.h"
#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {
namespace {

constexpr int kIterations = 10;
constexpr double kSpread = 0.1;  // m: distance of the points that close a hinge

std::size_t index(int k) { return static_cast<std::size_t>(k); }

btQuaternion to_bullet(const Eigen::Matrix3d& R) {
  const Eigen::Quaterniond q(R);
  return {q.x(), q.y(), q.z(), q.w()};
}

class BulletMultiBody final : public Engine {
 public:
  BulletMultiBody(const scene::Scene& scene, double h, int sweeps)
      : scene_(scene),
        h_(h),
        dispatcher_(&configuration_),
        world_(&dispatcher_, &broadphase_, &solver_, &configuration_),
        places_(scene.bodies.size()),
        frames_(scene.bodies.size()),
        links_(scene.joints.size()) {
    world_.setGravity(cotwin::benchmark::to_bullet(scene.gravity));
    world_.getSolverInfo().m_numIterations = sweeps > 0 ? sweeps : kIterations;
    for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
      if (scene.bodies[b].motion == scene::Motion::kDynamic) frames_[b] = principal(scene.bodies[b].inertia);
    }
    const Trees trees = make_trees(scene);
    for (std::size_t first = 0; first < trees.links.size(); ++first) {
      const Trees::Link& link = trees.links[first];
      const bool begins =
          link.joint < 0 || link.parent < 0 || scene.bodies[index(link.parent)].motion != scene::Motion::kDynamic;
      if (begins) add_tree(trees, first);
    }
    for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
      if (!places_[b].multibody) add_rigid(b);
    }
    for (const int j : trees.loops) close(scene.joints[index(j)]);
    for (std::size_t a = 0; a < scene.bodies.size(); ++a) {
      for (std::size_t b = a + 1; b < scene.bodies.size(); ++b) {
        if (!ignored(scene, static_cast<int>(a), static_cast<int>(b)) || !collider(a) || !collider(b)) continue;
        collider(a)->setIgnoreCollisionCheck(collider(b), true);
        collider(b)->setIgnoreCollisionCheck(collider(a), true);
      }
    }
  }
  ~BulletMultiBody() override {
    for (const auto& constraint : constraints_) world_.removeMultiBodyConstraint(constraint.get());
    for (const auto& multibody : multibodies_) world_.removeMultiBody(multibody.get());
    for (const auto& c : colliders_) world_.removeCollisionObject(c.get());
    for (const auto& b : rigid_) world_.removeRigidBody(b.get());
  }

  void step(double h) override { world_.stepSimulation(h, 0); }

  void read(std::span<Pose> X_WB, std::span<Twist> V_WB) const override {
    for (const auto& multibody : multibodies_) multibody->forwardKinematics(rotations_, origins_);
    for (std::size_t b = 0; b < places_.size(); ++b) {
      const Place& place = places_[b];
      Pose X_WP;
      Eigen::Vector3d v, w;
      if (place.rigid) {
        X_WP = from_bullet(place.rigid->getWorldTransform());
        v = from_bullet(place.rigid->getLinearVelocity());
        w = from_bullet(place.rigid->getAngularVelocity());
      } else {
        const btMultiBody& m = *place.multibody;
        X_WP = from_bullet(place.link < 0 ? m.getBaseWorldTransform() : m.getLink(place.link).m_cachedWorldTransform);
        omega_.resize(index(m.getNumLinks()) + 1);
        velocity_.resize(omega_.size());
        m.compTreeLinkVelocities(omega_.data(), velocity_.data());
        v = X_WP.R * from_bullet(velocity_[index(place.link + 1)]);
        w = X_WP.R * from_bullet(omega_[index(place.link + 1)]);
      }
      X_WB[b] = X_WP * frames_[b].X_BP.inverse();
      V_WB[b] << v + w.cross(X_WB[b].p - X_WP.p), w;
    }
  }

  void set_tau(std::size_t joint, double tau) override {
    links_[joint].multibody->addJointTorque(links_[joint].link, links_[joint].sign * tau);
  }
  void set_motor(std::size_t joint, double dq, double tau_max) override {
    constraints_.push_back(std::make_unique<btMultiBodyJointMotor>(links_[joint].multibody, links_[joint].link,
                                                                   links_[joint].sign * dq, tau_max * h_));
    world_.addMultiBodyConstraint(constraints_.back().get());
  }
  void apply(std::size_t k, const Wrench& F_C_W) override {
    if (!places_[k].rigid) throw std::logic_error("a wrench on a link of a btMultiBody");
    places_[k].rigid->applyCentralForce(cotwin::benchmark::to_bullet(F_C_W.head<3>().eval()));
    places_[k].rigid->applyTorque(cotwin::benchmark::to_bullet(F_C_W.tail<3>().eval()));
  }

 private:
  struct Place {  // of a body
    btMultiBody* multibody = nullptr;
    int link = -1;  // −1: the base
    btRigidBody* rigid = nullptr;
  };
  struct Axis {  // of a joint
    btMultiBody* multibody = nullptr;
    int link = -1;
    double sign = 1;
  };

  static btVector3 vector(const Eigen::Vector3d& v) { return cotwin::benchmark::to_bullet(v); }
  Pose X_WP(int b) const { return b < 0 ? Pose{} : scene_.bodies[index(b)].X_WB * frames_[index(b)].X_BP; }
  btCollisionObject* collider(std::size_t b) const {
    const Place& place = places_[b];
    if (place.rigid) return place.rigid;
    return place.link < 0 ? place.multibody->getBaseCollider() : place.multibody->getLink(place.link).m_collider;
  }

  // A tree that begins at trees.links[first]: on the world, or floating. A body alone stays a rigid body.
  void add_tree(const Trees& trees, std::size_t first) {
    std::vector<std::size_t> of_tree{first};
    std::vector<bool> in_tree(scene_.bodies.size());
    in_tree[index(trees.links[first].body)] = true;
    for (std::size_t l = first + 1; l < trees.links.size(); ++l) {
      const int parent = trees.links[l].joint < 0 ? -1 : trees.links[l].parent;
      if (parent < 0 || !in_tree[index(parent)]) continue;
      in_tree[index(trees.links[l].body)] = true;
      of_tree.push_back(l);
    }
    const bool floating = trees.links[first].joint < 0;
    if (floating && of_tree.size() == 1) return;

    const int root = trees.links[first].body;
    const int count = static_cast<int>(of_tree.size()) - (floating ? 1 : 0);
    const scene::Body& base = scene_.bodies[index(root)];
    auto multibody =
        floating ? std::make_unique<btMultiBody>(count, base.inertia.mass, vector(frames_[index(root)].moments), false, false)
                 : std::make_unique<btMultiBody>(count, 0, btVector3(0, 0, 0), true, false);
    multibody->setLinearDamping(0);
    multibody->setAngularDamping(0);
    multibody->setMaxCoordinateVelocity(1e6);
    multibody->setBaseWorldTransform(floating ? cotwin::benchmark::to_bullet(X_WP(root)) : btTransform::getIdentity());
    if (floating) places_[index(root)].multibody = multibody.get();
    std::vector<double> speeds;
    for (std::size_t i = floating ? 1 : 0; i < of_tree.size(); ++i) {
      speeds.push_back(set_up(*multibody, static_cast<int>(speeds.size()), trees.links[of_tree[i]]));
    }
    multibody->finalizeMultiDof();
    if (floating) {
      const Eigen::Vector3d w = base.V_WB.tail<3>();
      multibody->setBaseVel(vector(base.V_WB.head<3>() + w.cross(X_WP(root).p - base.X_WB.p)));
      multibody->setBaseOmega(vector(w));
    }
    for (std::size_t i = 0; i < speeds.size(); ++i) multibody->setJointVel(static_cast<int>(i), speeds[i]);
    world_.addMultiBody(multibody.get());
    multibody->forwardKinematics(rotations_, origins_);
    for (std::size_t b = 0; b < scene_.bodies.size(); ++b) {
      if (places_[b].multibody == multibody.get()) add_collider(b);
    }
    multibodies_.push_back(std::move(multibody));
  }

  // The joint's position is 0 at the start. Returns its speed.
  double set_up(btMultiBody& multibody, int i, const Trees::Link& link) {
    const scene::Joint& joint = scene_.joints[index(link.joint)];
    const bool on_world = link.parent < 0 || scene_.bodies[index(link.parent)].motion != scene::Motion::kDynamic;
    const int parent = on_world ? -1 : places_[index(link.parent)].link;
    const Pose X_Wparent = on_world ? Pose{} : X_WP(link.parent), X_Wchild = X_WP(link.body);
    const Pose X_WJ = scene_.bodies[index(joint.child)].X_WB * joint.X_CJ;
    const double sign = link.reversed ? -1 : 1;
    const Eigen::Vector3d axis_W = sign * (X_WJ.R * joint.axis), axis = X_Wchild.R.transpose() * axis_W;
    const scene::Body& body = scene_.bodies[index(link.body)];
    const btQuaternion parent_to_this = to_bullet((X_Wchild.R.transpose() * X_Wparent.R).eval());
    const btVector3 to_pivot = vector(X_Wparent.inverse() * X_WJ.p), to_centre = vector(-(X_Wchild.inverse() * X_WJ.p));
    const btVector3 moments = vector(frames_[index(link.body)].moments);
    if (joint.type == scene::JointType::kRevolute) {
      multibody.setupRevolute(i, body.inertia.mass, moments, parent, parent_to_this, vector(axis), to_pivot, to_centre, true);
    } else if (joint.type == scene::JointType::kPrismatic) {
      multibody.setupPrismatic(i, body.inertia.mass, moments, parent, parent_to_this, vector(axis), to_pivot, to_centre, true);
    } else {
      throw NotApplicable("btMultiBody: joint '" + joint.name + "' is neither a hinge nor a slider");
    }
    places_[index(link.body)].multibody = &multibody;
    places_[index(link.body)].link = i;
    links_[index(link.joint)] = {&multibody, i, sign};
    const Twist V_parent = on_world ? Twist::Zero().eval() : scene_.bodies[index(link.parent)].V_WB;
    const bool turns = joint.type == scene::JointType::kRevolute;
    const Eigen::Vector3d difference = turns ? (body.V_WB - V_parent).tail<3>() : (body.V_WB - V_parent).head<3>();
    return axis_W.dot(difference);
  }

  // Links without shapes have one too: Bullet leaves constraints out whose links have none.
  void add_collider(std::size_t b) {
    const Place& place = places_[b];
    auto object = std::make_unique<btMultiBodyLinkCollider>(place.multibody, place.link);
    object->setCollisionShape(shapes_.make(scene_.bodies[b], frames_[b]));
    object->setWorldTransform(cotwin::benchmark::to_bullet(X_WP(static_cast<int>(b))));
    const bool touches = !scene_.bodies[b].shapes.empty();
    if (touches) {
      object->setFriction(std::sqrt(scene_.bodies[b].shapes[0].material.mu));
      object->setRestitution(scene_.bodies[b].shapes[0].material.restitution);
    }
    object->setActivationState(DISABLE_DEACTIVATION);
    world_.addCollisionObject(object.get(), btBroadphaseProxy::DefaultFilter, touches ? btBroadphaseProxy::AllFilter : 0);
    if (place.link < 0) {
      place.multibody->setBaseCollider(object.get());
    } else {
      place.multibody->getLink(place.link).m_collider = object.get();
    }
    colliders_.push_back(std::move(object));
  }

  void add_rigid(std::size_t b) {
    const scene::Body& body = scene_.bodies[b];
    const bool dynamic = body.motion == scene::Motion::kDynamic;
    const Pose X = X_WP(static_cast<int>(b));
    btRigidBody::btRigidBodyConstructionInfo info(dynamic ? body.inertia.mass : 0, nullptr, shapes_.make(body, frames_[b]),
                                                  vector(frames_[b].moments));
    info.m_startWorldTransform = cotwin::benchmark::to_bullet(X);
    if (!body.shapes.empty()) {
      info.m_friction = std::sqrt(body.shapes[0].material.mu);
      info.m_restitution = body.shapes[0].material.restitution;
    }
    rigid_.push_back(std::make_unique<btRigidBody>(info));
    const Eigen::Vector3d w = body.V_WB.tail<3>();
    rigid_.back()->setLinearVelocity(vector(body.V_WB.head<3>() + w.cross(X.p - body.X_WB.p)));
    rigid_.back()->setAngularVelocity(vector(w));
    rigid_.back()->setActivationState(DISABLE_DEACTIVATION);
    world_.addRigidBody(rigid_.back().get());
    places_[b].rigid = rigid_.back().get();
  }

  void close(const scene::Joint& joint) {
    if (joint.type == scene::JointType::kPrismatic) throw NotApplicable("btMultiBody: a loop of sliders");
    const Pose X_WJ = scene_.bodies[index(joint.child)].X_WB * joint.X_CJ;
    const Pose X_WPj = (joint.parent < 0 ? Pose{} : scene_.bodies[index(joint.parent)].X_WB) * joint.X_PJ;
    for (const double side : {-0.5, 0.5}) {
      const Eigen::Vector3d shift =
          joint.type == scene::JointType::kRevolute ? (side * kSpread * joint.axis).eval() : Eigen::Vector3d::Zero();
      const btVector3 of_child = vector(X_WP(joint.child).inverse() * (X_WJ * shift));
      const btVector3 of_parent = vector(X_WP(joint.parent).inverse() * (X_WPj * shift));
      const Place& child = places_[index(joint.child)];
      if (joint.parent < 0) {
        constraints_.push_back(std::make_unique<btMultiBodyPoint2Point>(
            child.multibody, child.link, &btTypedConstraint::getFixedBody(), of_child, of_parent));
      } else {
        const Place& parent = places_[index(joint.parent)];
        constraints_.push_back(std::make_unique<btMultiBodyPoint2Point>(child.multibody, child.link, parent.multibody,
                                                                        parent.link, of_child, of_parent));
      }
      world_.addMultiBodyConstraint(constraints_.back().get());
      if (joint.type == scene::JointType::kSpherical) return;
    }
  }

  scene::Scene scene_;
  double h_;
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_;
  btDbvtBroadphase broadphase_;
  btMultiBodyConstraintSolver solver_;
  BulletShapes shapes_;
  btMultiBodyDynamicsWorld world_;
  std::vector<Place> places_;
  std::vector<Principal> frames_;
  std::vector<Axis> links_;
  std::vector<std::unique_ptr<btMultiBody>> multibodies_;
  std::vector<std::unique_ptr<btMultiBodyLinkCollider>> colliders_;
  std::vector<std::unique_ptr<btRigidBody>> rigid_;
  std::vector<std::unique_ptr<btMultiBodyConstraint>> constraints_;
  mutable btAlignedObjectArray<btQuaternion> rotations_;
  mutable btAlignedObjectArray<btVector3> origins_;
  mutable std::vector<btVector3> omega_, velocity_;
};

}  // namespace

std::unique_ptr<Engine> make_bullet_multibody(const scene::Scene& scene, double h, int sweeps) {
  if (scene.joints.empty()) throw NotApplicable("a scene without joints");
  return std::make_unique<BulletMultiBody>(scene, h, sweeps);
}

}  // namespace cotwin::benchmark
