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
  /// Whether a user has been told that the run may be wrong, and whether it has ended for that reason.
  virtual bool told() const { return false; }
  virtual bool ended() const { return false; }
};

/// Thrown by an engine that cannot build a scene: it is left out.
struct NotApplicable : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

struct EngineKind {
  std::string name;
  std::unique_ptr<Engine> (*make)(const scene::Scene& scene, double h, int sweeps);  // 0 sweeps: the engine's number
  bool ours = false;
  bool exact = false;  // pivots: the cost grows with the cube of the number of contacts
};

/// Cotwin as a user gets it, with default options; and with a method and 20 sweeps per step, as many as ODE's quickstep.
std::unique_ptr<Engine> make_default(const scene::Scene& scene, double h, int sweeps);
std::unique_ptr<Engine> make_tree(const scene::Scene& scene, double h, int sweeps);
std::unique_ptr<Engine> make_pgs(const scene::Scene& scene, double h, int sweeps);
std::unique_ptr<Engine> make_dantzig(const scene::Scene& scene, double h, int sweeps);
/// Cotwin as a user gets it with `method=`: default options, and what the unit tells about a run.
std::unique_ptr<Engine> make_user_tree(const scene::Scene& scene, double h, int sweeps);
std::unique_ptr<Engine> make_user_pgs(const scene::Scene& scene, double h, int sweeps);
std::unique_ptr<Engine> make_user_dantzig(const scene::Scene& scene, double h, int sweeps);
/// Open Dynamics Engine: dWorldQuickStep with 20 iterations, or dWorldStep. Other settings are defaults, except: eight contacts
/// per pair, friction pyramid scaled by the normal force; soft contacts by ERP and CFM as its manual has them.
std::unique_ptr<Engine> make_ode_quick(const scene::Scene& scene, double h, int sweeps);
std::unique_ptr<Engine> make_ode_dantzig(const scene::Scene& scene, double h, int sweeps);
/// Bullet in double precision: sequential impulses with 10 iterations, or MLCP with Dantzig's solver. Other settings are
/// defaults, except: no body falls asleep, collision margins are 1 mm (hulls: 0), and continuous collision detection for bodies
/// that start with more than a radius per step.
std::unique_ptr<Engine> make_bullet_si(const scene::Scene& scene, double h, int sweeps);
std::unique_ptr<Engine> make_bullet_dantzig(const scene::Scene& scene, double h, int sweeps);

/// The same with trees of joints as btMultiBody (Featherstone's algorithm in reduced coordinates, hinges and sliders only);
/// loops are closed by two points on the hinge's axis. No damping.
std::unique_ptr<Engine> make_bullet_multibody(const scene::Scene& scene, double h, int sweeps);

/// MuJoCo: Newton's solver, elliptic cones with impratio 10; RK4 for scenes without shapes, else Euler's semi-implicit method.
/// Restitution and stiffness by solref; no motors. Loops are closed by two points on the hinge's axis.
std::unique_ptr<Engine> make_mujoco(const scene::Scene& scene, double h, int sweeps);

/// The frame of principal axes P at the body's centre of mass, and the principal moments: for engines that support no other
/// frame.
struct Principal {
  Pose X_BP;
  Eigen::Vector3d moments = Eigen::Vector3d::Zero();
};
Principal principal(const Inertia& inertia);
/// The joints as trees, for engines with reduced coordinates. Trees begin at the world or a static body; bodies that no joint
/// connects to these begin at the first body of each group, which floats.
struct Trees {
  struct Link {
    int body = -1, parent = -1, joint = -1;  // of the scene; parent −1: the world; joint −1: a floating or free body
    bool reversed = false;                   // the joint's parent is the link's body
  };
  std::vector<Link> links;  // parents first; static bodies are left out
  std::vector<int> loops;   // the other joints
};
Trees make_trees(const scene::Scene& scene);

/// Whether contacts between two bodies are left out because they are joined or the scene excludes the pair: for engines that
/// have no such list.
bool ignored(const scene::Scene& scene, int a, int b);

}  // namespace cotwin::benchmark
