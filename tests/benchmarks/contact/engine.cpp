#include "tests/benchmarks/contact/engine.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>

namespace cotwin::benchmark {
namespace {

class Ours final : public Engine {
 public:
  Ours(const scene::Scene& scene, contact_world::Options options) : world_(scene, options) {}
  void step(double h) override { world_.step(h); }
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
  contact_world::World world_;
};

contact_world::Options options_for(const scene::Scene& scene) {
  contact_world::Options options;
  options.contacts = 16 * scene.bodies.size();
  return options;
}

}  // namespace

std::unique_ptr<Engine> make_default(const scene::Scene& scene, double) {
  return std::make_unique<Ours>(scene, options_for(scene));
}
std::unique_ptr<Engine> make_dantzig(const scene::Scene& scene, double) {
  contact_world::Options options = options_for(scene);
  options.method = contact_world::Method::kDantzig;
  return std::make_unique<Ours>(scene, options);
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

std::vector<Link> make_trees(const scene::Scene& scene) {
  const auto index = [](int k) { return static_cast<std::size_t>(k); };
  const auto fixed = [&](int k) { return k < 0 || scene.bodies[index(k)].motion != scene::Motion::kDynamic; };
  std::vector<Link> links;
  std::vector<bool> placed(scene.bodies.size()), used(scene.joints.size());
  std::size_t next = 0;
  const auto grow = [&] {  // breadth first
    for (; next <= links.size(); ++next) {
      const int at = next == 0 ? -1 : links[next - 1].body;
      for (std::size_t j = 0; j < scene.joints.size(); ++j) {
        const scene::Joint& joint = scene.joints[j];
        const auto here = [&](int k) { return next == 0 ? fixed(k) : k == at; };
        const bool forward = here(joint.parent), backward = here(joint.child);
        if (used[j] || forward == backward) continue;
        const int body = forward ? joint.child : joint.parent;
        if (fixed(body) || placed[index(body)]) continue;
        used[j] = placed[index(body)] = true;
        links.push_back({body, forward ? joint.parent : joint.child, static_cast<int>(j), backward});
      }
    }
  };
  grow();
  for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
    if (placed[b] || fixed(static_cast<int>(b))) continue;
    placed[b] = true;
    links.push_back({static_cast<int>(b), -1, -1, false});
    grow();
  }
  return links;
}

bool ignored(const scene::Scene& scene, int a, int b) {
  const auto same = [a, b](int c, int d) { return (a == c && b == d) || (a == d && b == c); };
  return std::any_of(scene.joints.begin(), scene.joints.end(), [&](const auto& j) { return same(j.parent, j.child); }) ||
         std::any_of(scene.no_contact.begin(), scene.no_contact.end(), [&](const auto& p) { return same(p.first, p.second); });
}

}  // namespace cotwin::benchmark
