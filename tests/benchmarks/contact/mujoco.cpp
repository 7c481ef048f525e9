#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {
namespace {

std::size_t index(int k) { return static_cast<std::size_t>(k); }

std::string numbers(std::initializer_list<double> values) {
  std::string text;
  for (const double v : values) {
    std::array<char, 32> one{};
    std::snprintf(one.data(), one.size(), "%.17g ", v);
    text += one.data();
  }
  return text;
}
std::string vector(const Eigen::Vector3d& v) { return numbers({v.x(), v.y(), v.z()}); }
std::string place(const Pose& X) {
  const Eigen::Quaterniond q(X.R);
  return " pos='" + vector(X.p) + "' quat='" + numbers({q.w(), q.x(), q.y(), q.z()}) + "'";
}

/// A scene in MuJoCo's XML format (MJCF). Bodies are named by their index.
class Document {
 public:
  Document(const scene::Scene& scene, double h) : scene_(scene), h_(h), links_(make_trees(scene)) {
    for (const scene::Body& body : scene.bodies) {
      for (const scene::Shape& shape : body.shapes) {
        by_pairs_ = by_pairs_ || shape.material.mu != first_mu();
        touching_ = true;
      }
    }
    for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
      const int k = static_cast<int>(b);
      if (scene.bodies[b].motion != scene::Motion::kDynamic) bodies_ += "<body" + head(k, Pose{}) + geoms(k) + "</body>";
    }
    for (std::size_t l = 0; l < links_.size(); ++l) {
      if (on_world(l)) bodies_ += link(l);
    }
    contacts();
  }

  std::string text() const {
    // Memory grows with the square of the rows.
    const std::size_t contacts = (scene_.bodies.size() > 100 ? 6 : 16) * scene_.bodies.size() + 100;
    const std::size_t rows = 3 * contacts + 12 * scene_.joints.size();
    return "<mujoco><compiler angle='radian' inertiafromgeom='false' boundinertia='1e-12'/><size nconmax='" +
           std::to_string(contacts) + "' njmax='" + std::to_string(rows) + "'/><option timestep='" + numbers({h_}) +
           "' gravity='" + vector(scene_.gravity) + "' cone='elliptic' impratio='10' integrator='" +
           (touching_ ? "Euler" : "RK4") + "'/><worldbody>" + bodies_ + "</worldbody><contact>" + contact_ +
           "</contact></mujoco>";
  }
  const std::vector<Link>& links() const { return links_; }

 private:
  double first_mu() const {
    for (const scene::Body& body : scene_.bodies) {
      if (!body.shapes.empty()) return body.shapes[0].material.mu;
    }
    return 0;
  }
  bool fixed(int k) const { return k < 0 || scene_.bodies[index(k)].motion != scene::Motion::kDynamic; }
  bool on_world(std::size_t l) const { return links_[l].joint < 0 || fixed(links_[l].parent); }

  std::string head(int k, const Pose& X_WP) const {
    return " name='b" + std::to_string(k) + "'" + place(X_WP.inverse() * scene_.bodies[index(k)].X_WB) + ">";
  }

  std::string link(std::size_t l) {
    const Link& link = links_[l];
    const Inertia& inertia = scene_.bodies[index(link.body)].inertia;
    const Eigen::Matrix3d& I = inertia.I_CC;
    std::string text = "<body" + head(link.body, on_world(l) ? Pose{} : scene_.bodies[index(link.parent)].X_WB);
    text += "<inertial pos='" + vector(inertia.p_LC) + "' mass='" + numbers({inertia.mass}) + "' fullinertia='" +
            numbers({I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2)}) + "'/>";
    text += link.joint < 0 ? "<freejoint/>" : joint(link);
    text += geoms(link.body);
    for (std::size_t c = l + 1; c < links_.size(); ++c) {
      if (links_[c].joint >= 0 && links_[c].parent == link.body) text += this->link(c);
    }
    return text + "</body>";
  }

  std::string joint(const Link& link) const {
    const scene::Joint& joint = scene_.joints[index(link.joint)];
    if (joint.type != scene::JointType::kRevolute) throw Error("joint " + joint.name, "is not revolute");
    const Pose& X = link.reversed ? joint.X_PJ : joint.X_CJ;
    return "<joint type='hinge' name='j" + std::to_string(link.joint) + "' pos='" + vector(X.p) + "' axis='" +
           vector((link.reversed ? -1 : 1) * (X.R * joint.axis)) + "'/>";
  }

  std::string geoms(int k) {
    const scene::Body& body = scene_.bodies[index(k)];
    std::string text;
    for (std::size_t s = 0; s < body.shapes.size(); ++s) {
      const scene::Shape& shape = body.shapes[s];
      const std::string name = "g" + std::to_string(k) + "_" + std::to_string(s);
      const Eigen::Vector3d& size = shape.size;
      text +=
          "<geom name='" + name + "'" + place(shape.X_BS) + " condim='3' friction='" + numbers({shape.material.mu, 0, 0}) + "'";
      if (by_pairs_) text += " contype='0' conaffinity='0'";
      switch (shape.type) {
        case scene::ShapeType::kSphere:
          text += " type='sphere' size='" + numbers({size.x()}) + "'";
          break;
        case scene::ShapeType::kBox:
          text += " type='box' size='" + vector(0.5 * size) + "'";
          break;
        case scene::ShapeType::kPlane:
          text += " type='plane' size='0 0 1'";
          break;
        default:
          throw Error("shape " + shape.name, "is neither a sphere, a box nor a plane");
      }
      text += "/>";
    }
    return text;
  }

  void contacts() {
    for (int a = 0; a < static_cast<int>(scene_.bodies.size()); ++a) {
      for (int b = a + 1; b < static_cast<int>(scene_.bodies.size()); ++b) {
        if (fixed(a) && fixed(b)) continue;
        const bool out = ignored(scene_, a, b);
        const std::string of_a = std::to_string(a), of_b = std::to_string(b);
        if (out && !by_pairs_) contact_ += "<exclude body1='b" + of_a + "' body2='b" + of_b + "'/>";
        if (out || !by_pairs_ || scene_.bodies[index(a)].shapes.empty() || scene_.bodies[index(b)].shapes.empty()) continue;
        const double mu =
            std::sqrt(scene_.bodies[index(a)].shapes[0].material.mu * scene_.bodies[index(b)].shapes[0].material.mu);
        contact_ +=
            "<pair geom1='g" + of_a + "_0' geom2='g" + of_b + "_0' condim='3' friction='" + numbers({mu, mu, 0, 0, 0}) + "'/>";
      }
    }
  }

  const scene::Scene& scene_;
  double h_;
  std::vector<Link> links_;
  bool by_pairs_ = false, touching_ = false;  // friction differs between bodies
  std::string bodies_, contact_;
};

void silent(const char*) {}

class MuJoCo final : public Engine {
 public:
  MuJoCo(const scene::Scene& scene, double h)
      : scene_(scene), addresses_(scene.joints.size(), -1), signs_(scene.joints.size(), 1) {
    mju_user_warning = silent;
    const Document document(scene_, h);
    const std::string text = document.text();
    const auto files = std::make_unique<mjVFS>();
    mj_defaultVFS(files.get());
    mj_makeEmptyFileVFS(files.get(), "scene.xml", static_cast<int>(text.size()));
    std::memcpy(files->filedata[0], text.data(), text.size());
    std::array<char, 500> error{};
    model_.reset(mj_loadXML("scene.xml", files.get(), error.data(), static_cast<int>(error.size())));
    mj_deleteVFS(files.get());
    if (!model_) throw std::runtime_error(error.data());
    data_.reset(mj_makeData(model_.get()));
    for (std::size_t b = 0; b < scene_.bodies.size(); ++b) {
      ids_.push_back(mj_name2id(model_.get(), mjOBJ_BODY, ("b" + std::to_string(b)).c_str()));
    }
    for (const Link& link : document.links()) start(link);
    mj_forward(model_.get(), data_.get());
  }

  void step(double) override {
    mj_step(model_.get(), data_.get());
    mju_zero(data_->qfrc_applied, model_->nv);
    mju_zero(data_->xfrc_applied, 6 * model_->nbody);
  }

  void read(std::span<Pose> X_WB, std::span<Twist> V_WB) const override {
    mjData* d = data_.get();
    mj_kinematics(model_.get(), d);
    mj_comPos(model_.get(), d);
    mj_comVel(model_.get(), d);
    bool failed = false;  // MuJoCo resets the simulation when it diverges, and drops contacts when its memory is full
    for (const int kind : {mjWARN_BADQPOS, mjWARN_BADQVEL, mjWARN_BADQACC, mjWARN_CONTACTFULL, mjWARN_CNSTRFULL}) {
      failed = failed || d->warning[kind].number > 0;
    }
    for (std::size_t b = 0; b < ids_.size(); ++b) {
      const mjtNum* R = d->xmat + 9 * ids_[b];
      X_WB[b].R = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R);
      X_WB[b].p = Eigen::Map<const Eigen::Vector3d>(d->xpos + 3 * ids_[b]);
      std::array<mjtNum, 6> V{};
      mj_objectVelocity(model_.get(), d, mjOBJ_XBODY, ids_[b], V.data(), 0);
      V_WB[b] << V[3], V[4], V[5], V[0], V[1], V[2];
      if (failed) X_WB[b].p.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
  }

  void set_tau(std::size_t joint, double tau) override { data_->qfrc_applied[addresses_[joint]] = signs_[joint] * tau; }
  void set_motor(std::size_t, double, double) override { throw NotApplicable("MuJoCo: motors as constraints"); }
  void apply(std::size_t body, const Wrench& F_C_W) override {
    for (int i = 0; i < 6; ++i) data_->xfrc_applied[6 * ids_[body] + i] = F_C_W(i);
  }

 private:
  struct Delete {
    void operator()(mjModel* m) const { mj_deleteModel(m); }
    void operator()(mjData* d) const { mj_deleteData(d); }
  };

  // Speeds at the start. A free joint has linear velocity in W and angular velocity in B.
  void start(const Link& link) {
    const scene::Body& body = scene_.bodies[index(link.body)];
    const int id = ids_[index(link.body)];
    if (model_->body_dofnum[id] == 0) return;
    const int first = model_->body_dofadr[id];
    if (link.joint < 0) {
      const Eigen::Vector3d w = body.X_WB.R.transpose() * body.V_WB.tail<3>();
      for (int i = 0; i < 3; ++i) {
        data_->qvel[first + i] = body.V_WB(i);
        data_->qvel[first + 3 + i] = w(i);
      }
      return;
    }
    const scene::Joint& joint = scene_.joints[index(link.joint)];
    addresses_[index(link.joint)] = first;
    signs_[index(link.joint)] = link.reversed ? -1 : 1;
    const Twist V_parent = link.parent < 0 ? Twist::Zero().eval() : scene_.bodies[index(link.parent)].V_WB;
    const Eigen::Vector3d axis = scene_.bodies[index(joint.child)].X_WB.R * (joint.X_CJ.R * joint.axis);
    const Twist difference = body.V_WB - V_parent;
    data_->qvel[first] = (link.reversed ? -1 : 1) * axis.dot(difference.tail<3>());
  }

  scene::Scene scene_;
  std::unique_ptr<mjModel, Delete> model_;
  std::unique_ptr<mjData, Delete> data_;
  std::vector<int> ids_;        // of each body
  std::vector<int> addresses_;  // of each joint's speed
  std::vector<int> signs_;
};

}  // namespace

std::unique_ptr<Engine> make_mujoco(const scene::Scene& scene, double h) { return std::make_unique<MuJoCo>(scene, h); }

}  // namespace cotwin::benchmark
