#include <ode/ode.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {
namespace {

constexpr int kIterations = 20, kContactsPerPair = 8;

void to_ode(const Eigen::Matrix3d& R, dMatrix3 out) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) out[4 * i + j] = R(i, j);
    out[4 * i + 3] = 0;
  }
}

Eigen::Matrix3d from_ode(const dReal* R) {
  Eigen::Matrix3d out;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) out(i, j) = R[4 * i + j];
  }
  return out;
}

class Ode final : public Engine {
 public:
  explicit Ode(const scene::Scene& scene) : scene_(scene) {
    [[maybe_unused]] static const bool ready = [] {
      dInitODE2(0);
      return dAllocateODEDataForThread(static_cast<unsigned>(dAllocateMaskAll)) != 0;
    }();
    dRandSetSeed(0);  // order of quickstep's rows: equal in each run
    world_ = dWorldCreate();
    space_ = dHashSpaceCreate(nullptr);
    contacts_ = dJointGroupCreate(0);
    dWorldSetGravity(world_, scene.gravity.x(), scene.gravity.y(), scene.gravity.z());
    dWorldSetQuickStepNumIterations(world_, kIterations);
    for (std::size_t k = 0; k < scene.bodies.size(); ++k) add(k);
    for (const scene::Joint& joint : scene.joints) add(joint);
  }
  ~Ode() override {
    dJointGroupDestroy(contacts_);
    dSpaceDestroy(space_);
    dWorldDestroy(world_);
  }
  Ode(const Ode&) = delete;
  Ode& operator=(const Ode&) = delete;

  void step(double h) override {
    dSpaceCollide(space_, this, [](void* self, dGeomID a, dGeomID b) { static_cast<Ode*>(self)->touch(a, b); });
    dWorldQuickStep(world_, h);
    dJointGroupEmpty(contacts_);
  }

  void read(std::span<Pose> X_WB, std::span<Twist> V_WB) const override {
    for (std::size_t k = 0; k < bodies_.size(); ++k) {
      if (!bodies_[k]) {
        X_WB[k] = scene_.bodies[k].X_WB;
        V_WB[k].setZero();
        continue;
      }
      const Pose X_WP{from_ode(dBodyGetRotation(bodies_[k])), Eigen::Vector3d(dBodyGetPosition(bodies_[k]))};
      X_WB[k] = X_WP * frames_[k].X_BP.inverse();
      const Eigen::Vector3d v(dBodyGetLinearVel(bodies_[k])), w(dBodyGetAngularVel(bodies_[k]));
      V_WB[k] << v + w.cross(X_WB[k].p - X_WP.p), w;
    }
  }

  void set_tau(std::size_t joint, double tau) override { dJointAddHingeTorque(joints_[joint], tau); }
  void set_motor(std::size_t joint, double dq, double tau_max) override {
    dJointSetHingeParam(joints_[joint], dParamVel, dq);
    dJointSetHingeParam(joints_[joint], dParamFMax, tau_max);
  }
  void apply(std::size_t body, const Wrench& F_C_W) override {
    dBodyAddForce(bodies_[body], F_C_W(0), F_C_W(1), F_C_W(2));
    dBodyAddTorque(bodies_[body], F_C_W(3), F_C_W(4), F_C_W(5));
  }

 private:
  void add(std::size_t k) {
    const scene::Body& body = scene_.bodies[k];
    bodies_.push_back(nullptr);
    frames_.push_back({});
    if (body.motion == scene::Motion::kDynamic) {
      frames_[k] = principal(body.inertia);
      const Pose X_WP = body.X_WB * frames_[k].X_BP;
      dBodyID b = bodies_[k] = dBodyCreate(world_);
      dMatrix3 R;
      to_ode(X_WP.R, R);
      dBodySetRotation(b, R);
      dBodySetPosition(b, X_WP.p.x(), X_WP.p.y(), X_WP.p.z());
      const Eigen::Vector3d w = body.V_WB.tail<3>(), v = body.V_WB.head<3>() + w.cross(X_WP.p - body.X_WB.p);
      dBodySetLinearVel(b, v.x(), v.y(), v.z());
      dBodySetAngularVel(b, w.x(), w.y(), w.z());
      dMass mass;
      const Eigen::Vector3d& I = frames_[k].moments;
      dMassSetParameters(&mass, body.inertia.mass, 0, 0, 0, I.x(), I.y(), I.z(), 0, 0, 0);
      dBodySetMass(b, &mass);
    }
    for (const scene::Shape& shape : body.shapes) add(k, shape);
  }

  void add(std::size_t k, const scene::Shape& shape) {
    const Pose X_WS = scene_.bodies[k].X_WB * shape.X_BS;
    dGeomID geom = nullptr;
    if (shape.type == scene::ShapeType::kPlane) {
      const Eigen::Vector3d n = X_WS.R.col(2);
      geom = dCreatePlane(space_, n.x(), n.y(), n.z(), n.dot(X_WS.p));
    } else {
      geom = make_geom(shape);
      const Pose X = bodies_[k] ? frames_[k].X_BP.inverse() * shape.X_BS : X_WS;
      dMatrix3 R;
      to_ode(X.R, R);
      if (bodies_[k]) {
        dGeomSetBody(geom, bodies_[k]);
        dGeomSetOffsetPosition(geom, X.p.x(), X.p.y(), X.p.z());
        dGeomSetOffsetRotation(geom, R);
      } else {
        dGeomSetPosition(geom, X.p.x(), X.p.y(), X.p.z());
        dGeomSetRotation(geom, R);
      }
    }
    materials_.push_back({static_cast<int>(k), shape.material});
    dGeomSetData(geom, reinterpret_cast<void*>(materials_.size() - 1));
  }

  dGeomID make_geom(const scene::Shape& shape) {
    if (shape.type == scene::ShapeType::kSphere) return dCreateSphere(space_, shape.size.x());
    if (shape.type == scene::ShapeType::kBox) return dCreateBox(space_, shape.size.x(), shape.size.y(), shape.size.z());
    throw Error("shape " + shape.name, "is neither a sphere, a box nor a plane");
  }

  void add(const scene::Joint& joint) {
    if (joint.type != scene::JointType::kRevolute) throw Error("joint " + joint.name, "is not revolute");
    const auto body = [&](int k) { return k < 0 ? nullptr : bodies_[static_cast<std::size_t>(k)]; };
    const Pose X_WJ = scene_.bodies[static_cast<std::size_t>(joint.child)].X_WB * joint.X_CJ;
    const Eigen::Vector3d axis = X_WJ.R * joint.axis;
    dJointID id = dJointCreateHinge(world_, nullptr);
    dJointAttach(id, body(joint.child), body(joint.parent));
    dJointSetHingeAnchor(id, X_WJ.p.x(), X_WJ.p.y(), X_WJ.p.z());
    dJointSetHingeAxis(id, axis.x(), axis.y(), axis.z());
    joints_.push_back(id);
  }

  void touch(dGeomID a, dGeomID b) {
    const Surface& s_a = materials_[reinterpret_cast<std::size_t>(dGeomGetData(a))];
    const Surface& s_b = materials_[reinterpret_cast<std::size_t>(dGeomGetData(b))];
    if (s_a.body == s_b.body || (!dGeomGetBody(a) && !dGeomGetBody(b)) || ignored(scene_, s_a.body, s_b.body)) return;
    dContact contact[kContactsPerPair];
    const int count = dCollide(a, b, kContactsPerPair, &contact[0].geom, sizeof(dContact));
    for (int i = 0; i < count; ++i) {
      contact[i].surface = {};
      contact[i].surface.mode = dContactApprox1;
      contact[i].surface.mu = std::sqrt(s_a.material.mu * s_b.material.mu);
      dJointAttach(dJointCreateContact(world_, contacts_, contact + i), dGeomGetBody(a), dGeomGetBody(b));
    }
  }

  struct Surface {
    int body;
    scene::Material material;
  };

  scene::Scene scene_;
  dWorldID world_;
  dSpaceID space_;
  dJointGroupID contacts_;
  std::vector<dBodyID> bodies_;  // null: static
  std::vector<Principal> frames_;
  std::vector<dJointID> joints_;
  std::vector<Surface> materials_;  // of each shape
};

}  // namespace

std::unique_ptr<Engine> make_ode(const scene::Scene& scene, double) { return std::make_unique<Ode>(scene); }

}  // namespace cotwin::benchmark
