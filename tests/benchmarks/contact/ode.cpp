#include <ode/ode.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdarg>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/scene/hull.h"
#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {
namespace {

constexpr int kIterations = 20, kContactsPerPair = 8;

void silent(int, const char*, va_list) {}  // ODE's Dantzig prints every failed pivot

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
  Ode(const scene::Scene& scene, bool dantzig, double h, int sweeps) : scene_(scene), dantzig_(dantzig), h_(h) {
    [[maybe_unused]] static const bool ready = [] {
      dInitODE2(0);
      dSetMessageHandler(silent);
      return dAllocateODEDataForThread(static_cast<unsigned>(dAllocateMaskAll)) != 0;
    }();
    dRandSetSeed(0);  // order of quickstep's rows: equal in each run
    world_ = dWorldCreate();
    space_ = dHashSpaceCreate(nullptr);
    contacts_ = dJointGroupCreate(0);
    dWorldSetGravity(world_, scene.gravity.x(), scene.gravity.y(), scene.gravity.z());
    dWorldSetQuickStepNumIterations(world_, sweeps > 0 ? sweeps : kIterations);
    for (std::size_t k = 0; k < scene.bodies.size(); ++k) add(k);
    for (const scene::Joint& joint : scene.joints) add(joint);
  }
  ~Ode() override {
    dJointGroupDestroy(contacts_);
    dSpaceDestroy(space_);
    dWorldDestroy(world_);
    for (const auto& hull : hulls_) dGeomTriMeshDataDestroy(hull->data);
  }
  Ode(const Ode&) = delete;
  Ode& operator=(const Ode&) = delete;

  void step(double h) override {
    dSpaceCollide(space_, this, [](void* self, dGeomID a, dGeomID b) { static_cast<Ode*>(self)->touch(a, b); });
    dantzig_ ? dWorldStep(world_, h) : dWorldQuickStep(world_, h);
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
    switch (shape.type) {
      case scene::ShapeType::kSphere:
        return dCreateSphere(space_, shape.size.x());
      case scene::ShapeType::kCylinder:
        return dCreateCylinder(space_, shape.size.x(), shape.size.y());
      case scene::ShapeType::kCapsule:
        return dCreateCapsule(space_, shape.size.x(), shape.size.y());
      case scene::ShapeType::kHull: {
        // dCreateConvex penetrates other convex shapes and planes, so a mesh of triangles is used.
        const scene::Polytope polytope = scene::convex_hull(shape.vertices);
        Hull& hull = *hulls_.emplace_back(std::make_unique<Hull>());
        for (const auto& face : polytope.faces) {
          for (std::uint32_t c = 2; c < face.count; ++c) {
            for (const std::uint32_t corner : {0u, c - 1, c}) {
              hull.triangles.push_back(static_cast<dTriIndex>(polytope.corners[face.begin + corner]));
            }
          }
        }
        for (const Eigen::Vector3d& v : polytope.vertices) hull.points.insert(hull.points.end(), v.begin(), v.end());
        hull.data = dGeomTriMeshDataCreate();
        dGeomTriMeshDataBuildDouble(hull.data, hull.points.data(), 3 * sizeof(double),
                                    static_cast<int>(polytope.vertices.size()), hull.triangles.data(),
                                    static_cast<int>(hull.triangles.size()), 3 * sizeof(dTriIndex));
        return dCreateTriMesh(space_, hull.data, nullptr, nullptr, nullptr);
      }
      default:
        return dCreateBox(space_, shape.size.x(), shape.size.y(), shape.size.z());
    }
  }

  void add(const scene::Joint& joint) {
    const auto body = [&](int k) { return k < 0 ? nullptr : bodies_[static_cast<std::size_t>(k)]; };
    const Pose X_WJ = scene_.bodies[static_cast<std::size_t>(joint.child)].X_WB * joint.X_CJ;
    const Eigen::Vector3d axis = X_WJ.R * joint.axis;
    dJointID id = nullptr;
    switch (joint.type) {
      case scene::JointType::kRevolute:
        id = dJointCreateHinge(world_, nullptr);
        dJointAttach(id, body(joint.child), body(joint.parent));
        dJointSetHingeAnchor(id, X_WJ.p.x(), X_WJ.p.y(), X_WJ.p.z());
        dJointSetHingeAxis(id, axis.x(), axis.y(), axis.z());
        if (joint.q_min > -scene::kInfinity) dJointSetHingeParam(id, dParamLoStop, joint.q_min);
        if (joint.q_max < scene::kInfinity) dJointSetHingeParam(id, dParamHiStop, joint.q_max);
        break;
      case scene::JointType::kPrismatic:
        id = dJointCreateSlider(world_, nullptr);
        dJointAttach(id, body(joint.child), body(joint.parent));
        dJointSetSliderAxis(id, axis.x(), axis.y(), axis.z());
        break;
      case scene::JointType::kSpherical:
        id = dJointCreateBall(world_, nullptr);
        dJointAttach(id, body(joint.child), body(joint.parent));
        dJointSetBallAnchor(id, X_WJ.p.x(), X_WJ.p.y(), X_WJ.p.z());
        break;
      case scene::JointType::kFixed:
        id = dJointCreateFixed(world_, nullptr);
        dJointAttach(id, body(joint.child), body(joint.parent));
        dJointSetFixed(id);
        break;
      case scene::JointType::kScrew:
        throw Error("joint " + joint.name, "is a screw, which no compared scene has");
    }
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
      const double bounce = std::max(s_a.material.restitution, s_b.material.restitution);
      if (bounce > 0) {
        contact[i].surface.mode |= dContactBounce;
        contact[i].surface.bounce = bounce;
      }
      const double k = 1 / (1 / s_a.material.stiffness + 1 / s_b.material.stiffness);
      if (std::isfinite(k)) {
        const double d = std::isfinite(s_a.material.stiffness) ? s_a.material.damping : s_b.material.damping;
        contact[i].surface.mode |= dContactSoftERP | dContactSoftCFM;
        contact[i].surface.soft_erp = h_ * k / (h_ * k + d);
        contact[i].surface.soft_cfm = 1 / (h_ * k + d);
      }
      dJointAttach(dJointCreateContact(world_, contacts_, contact + i), dGeomGetBody(a), dGeomGetBody(b));
    }
  }

  struct Surface {
    int body;
    scene::Material material;
  };

  struct Hull {  // ODE keeps pointers into it
    std::vector<double> points;
    std::vector<dTriIndex> triangles;
    dTriMeshDataID data = nullptr;
  };

  scene::Scene scene_;
  bool dantzig_;
  double h_;
  dWorldID world_;
  dSpaceID space_;
  dJointGroupID contacts_;
  std::vector<dBodyID> bodies_;  // null: static
  std::vector<Principal> frames_;
  std::vector<dJointID> joints_;
  std::vector<Surface> materials_;  // of each shape
  std::vector<std::unique_ptr<Hull>> hulls_;
};

}  // namespace

std::unique_ptr<Engine> make_ode_quick(const scene::Scene& scene, double h, int sweeps) {
  return std::make_unique<Ode>(scene, false, h, sweeps);
}
std::unique_ptr<Engine> make_ode_dantzig(const scene::Scene& scene, double h, int sweeps) {
  return std::make_unique<Ode>(scene, true, h, sweeps);
}

}  // namespace cotwin::benchmark
