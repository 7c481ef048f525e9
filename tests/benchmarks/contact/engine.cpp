#include "tests/benchmarks/contact/engine.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>

namespace cotwin::benchmark {
namespace {

constexpr int kSweeps = 10;  // in each of the two solutions of a step: 20 together, as ODE's quickstep has here

class Ours final : public Engine {
 public:
  Ours(const scene::Scene& scene, contact_world::Method method, int sweeps) : world_(scene, options(scene, method, sweeps)) {}
  Ours(const scene::Scene& scene, contact_world::Options options) : world_(scene, options) {}
  void step(double h) override {
    world_.step(h);
    ended_ = ended_ || !world_.fault(kGapLimit, kEnergyLimit).empty();
    if (world_.status().unsolved > 0) unsolved_ += h;
  }
  bool told() const override { return ended_ || unsolved_ > kUnsolved; }
  bool ended() const override { return ended_; }
  void read(std::span<Pose> X_WB, std::span<Twist> V_WB) const override {
    std::copy(world_.poses().begin(), world_.poses().end(), X_WB.begin());
    std::copy(world_.twists().begin(), world_.twists().end(), V_WB.begin());
  }
  void set_tau(std::size_t joint, double tau) override { world_.set_tau(joint, tau); }
  void set_motor(std::size_t joint, double dq, double tau_max) override { world_.set_motor(joint, dq, tau_max); }
  void apply(std::size_t body, const Wrench& F_C_W) override {
    Wrench F_B_W = F_C_W;
    const Eigen::Vector3d p_BC_W = world_.poses()[body].R * world_.scene().bodies[body].inertia.p_LC;
    F_B_W.tail<3>() += p_BC_W.cross(F_C_W.head<3>());
    world_.apply(body, F_B_W);
  }

 private:
  static contact_world::Options options(const scene::Scene& scene, contact_world::Method method, int sweeps) {
    contact_world::Options options;
    options.method = method;
    options.iterations = sweeps > 0 ? std::max(1, sweeps / 2) : kSweeps;
    options.contacts = 16 * scene.bodies.size();
    return options;
  }

  // As the unit contact_world
  static constexpr double kGapLimit = 0.01, kEnergyLimit = 0.25;  // m
  static constexpr double kUnsolved = 0.05;                       // s

  contact_world::World world_;
  bool ended_ = false;
  double unsolved_ = 0;  // s
};

std::unique_ptr<Engine> make_user(const scene::Scene& scene, contact_world::Method method) {
  contact_world::Options options;
  options.method = method;
  options.contacts = 16 * scene.bodies.size();
  return std::make_unique<Ours>(scene, options);
}

}  // namespace

std::unique_ptr<Engine> make_default(const scene::Scene& scene, double, int sweeps) {
  contact_world::Options options;
  if (sweeps > 0) options.iterations = std::max(1, sweeps / 2);
  options.contacts = 16 * scene.bodies.size();
  return std::make_unique<Ours>(scene, options);
}
std::unique_ptr<Engine> make_tree(const scene::Scene& scene, double, int sweeps) {
  return std::make_unique<Ours>(scene, contact_world::Method::kTree, sweeps);
}
std::unique_ptr<Engine> make_pgs(const scene::Scene& scene, double, int sweeps) {
  return std::make_unique<Ours>(scene, contact_world::Method::kPgs, sweeps);
}
std::unique_ptr<Engine> make_dantzig(const scene::Scene& scene, double, int sweeps) {
  return std::make_unique<Ours>(scene, contact_world::Method::kDantzig, sweeps);
}
std::unique_ptr<Engine> make_user_tree(const scene::Scene& scene, double, int) {
  return make_user(scene, contact_world::Method::kTree);
}
std::unique_ptr<Engine> make_user_pgs(const scene::Scene& scene, double, int) {
  return make_user(scene, contact_world::Method::kPgs);
}
std::unique_ptr<Engine> make_user_dantzig(const scene::Scene& scene, double, int) {
  return make_user(scene, contact_world::Method::kDantzig);
}

Principal principal(const Inertia& inertia) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(inertia.I_CC);
  Principal p;
  p.X_BP.p = inertia.p_LC;
  p.moments = inertia.I_CC.diagonal();
  if (inertia.I_CC.isDiagonal()) return p;
  p.X_BP.R = axes.eigenvectors();
  p.moments = axes.eigenvalues();
  if (p.X_BP.R.determinant() < 0) p.X_BP.R.col(0) *= -1;
  return p;
}

Trees make_trees(const scene::Scene& scene) {
  const auto index = [](int k) { return static_cast<std::size_t>(k); };
  const auto fixed = [&](int k) { return k < 0 || scene.bodies[index(k)].motion != scene::Motion::kDynamic; };
  Trees trees;
  std::vector<bool> placed(scene.bodies.size()), used(scene.joints.size());
  std::size_t next = 0;
  const auto grow = [&] {  // breadth first
    for (; next <= trees.links.size(); ++next) {
      const int at = next == 0 ? -1 : trees.links[next - 1].body;
      for (std::size_t j = 0; j < scene.joints.size(); ++j) {
        const scene::Joint& joint = scene.joints[j];
        const auto here = [&](int k) { return next == 0 ? fixed(k) : k == at; };
        const bool forward = here(joint.parent), backward = here(joint.child);
        if (used[j] || forward == backward) continue;
        const int body = forward ? joint.child : joint.parent;
        if (fixed(body) || placed[index(body)]) continue;
        used[j] = placed[index(body)] = true;
        trees.links.push_back({body, forward ? joint.parent : joint.child, static_cast<int>(j), backward});
      }
    }
  };
  grow();
  for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
    if (placed[b] || fixed(static_cast<int>(b))) continue;
    placed[b] = true;
    trees.links.push_back({static_cast<int>(b), -1, -1, false});
    grow();
  }
  for (std::size_t j = 0; j < scene.joints.size(); ++j) {
    if (!used[j]) trees.loops.push_back(static_cast<int>(j));
  }
  return trees;
}

bool ignored(const scene::Scene& scene, int a, int b) {
  const auto same = [a, b](int c, int d) { return (a == c && b == d) || (a == d && b == c); };
  return std::any_of(scene.joints.begin(), scene.joints.end(), [&](const auto& j) { return same(j.parent, j.child); }) ||
         std::any_of(scene.no_contact.begin(), scene.no_contact.end(), [&](const auto& p) { return same(p.first, p.second); });
}

}  // namespace cotwin::benchmark
