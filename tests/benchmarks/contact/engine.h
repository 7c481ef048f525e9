#pragma once
#include <cstddef>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

namespace cotwin::benchmark {

/// One scene in one engine: the interface that the benchmark uses for Cotwin and its peers.
class Engine {
 public:
  virtual ~Engine() = default;
  virtual void step(double h) = 0;
  /// X_WB and V_WB (of B's origin, expressed in W), one per body of the scene.
  virtual void read(std::span<Pose> X_WB, std::span<Twist> V_WB) const = 0;
  virtual void set_tau(std::size_t joint, double tau) = 0;  // over the next step, N.m
  virtual void set_motor(std::size_t joint, double dq, double tau_max) = 0;
  virtual void apply(std::size_t body, const Wrench& F_C_W) = 0;  // at the centre of mass, over the next step
};

/// Thrown by an engine that cannot build a scene: it is left out.
struct NotApplicable : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

struct EngineKind {
  std::string name;
  std::unique_ptr<Engine> (*make)(const scene::Scene& scene, double h);
  bool ours = false;
  bool exact = false;  // pivots: the cost grows with the cube of the number of contacts
};

/// Cotwin as a user gets it, with default options; and with Dantzig's method.
std::unique_ptr<Engine> make_default(const scene::Scene& scene, double h);
std::unique_ptr<Engine> make_dantzig(const scene::Scene& scene, double h);
/// Open Dynamics Engine: dWorldQuickStep with 20 iterations. Other settings are defaults, except: eight contacts per pair, friction
/// pyramid scaled by the normal force.
std::unique_ptr<Engine> make_ode(const scene::Scene& scene, double h);
/// Bullet in double precision: sequential impulses with 10 iterations. Other settings are defaults, except: no body falls asleep, and
/// collision margins are 1 mm.
std::unique_ptr<Engine> make_bullet(const scene::Scene& scene, double h);
/// MuJoCo: Newton's solver, elliptic cones with impratio 10; RK4 for scenes without shapes, else Euler's semi-implicit method; no motors.
std::unique_ptr<Engine> make_mujoco(const scene::Scene& scene, double h);

/// The frame of principal axes P at the body's centre of mass, and the principal moments: for engines that support no other
/// frame.
struct Principal {
  Pose X_BP;
  Eigen::Vector3d moments = Eigen::Vector3d::Zero();
};
Principal principal(const Inertia& inertia);
/// The links of trees of joints, parents first, for engines with reduced coordinates. Static bodies are left out; bodies that no joint
/// connects to the world or a static body begin at the first body of each group, which floats.
struct Link {
  int body = -1, parent = -1, joint = -1;  // of the scene; parent −1: the world; joint −1: a floating or free body
  bool reversed = false;                   // the joint's parent is the link's body
};
std::vector<Link> make_trees(const scene::Scene& scene);

/// Whether contacts between two bodies are left out because they are joined or the scene excludes the pair: for engines that
/// have no such list.
bool ignored(const scene::Scene& scene, int a, int b);

}  // namespace cotwin::benchmark
