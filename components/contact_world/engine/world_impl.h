#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "components/contact_world/engine/accounts/accounts.h"
#include "components/contact_world/engine/advance.h"
#include "components/contact_world/engine/body/body.h"
#include "components/contact_world/engine/joints/axes.h"
#include "components/contact_world/engine/joints/forest.h"
#include "components/contact_world/engine/joints/joint.h"
#include "components/contact_world/engine/joints/latch.h"
#include "components/contact_world/engine/rows.h"
#include "components/contact_world/engine/world.h"
#include "models/collision/contact/detector.h"

namespace cotwin::contact_world {

/// A joint with rows that have a warm start.
struct LooseJoint {
  int joint = -1;
  bool whole = true;  // false: a tree or its loops hold the joint; rows only act along its axis
};

/// Upper bound of the contact margin, which is the distance that bodies move in a step.
constexpr double kWidestMargin = 0.05;  // m

/// Share of the errors of whole joints that a step corrects.
constexpr double kShareOfJointError = 0.2;

/// Cosine of the angle by which a contact's normal turns in a step at most, unless another feature carries it.
constexpr double kJump = 0.995;

/// Contacts that approach, or in islands move, more slowly than this times the speed that gravity gives in a step are at rest.
constexpr double kSlow = 2;

/// m/s². Weaker gravity is no measure for rest: the acceleration counts that other forces give bodies that they press together, up to the second one.
/// Nothing is at rest where nothing presses.
constexpr double kWeakGravity = 1, kMostPressed = 10;

/// 6 of the joint; spring, lower limit, upper limit, friction, motor; the gear that the joint follows
constexpr std::size_t kJointRows = 12;
constexpr int kSpringRow = 6, kMotorRow = 10, kGearRow = 11;

/// Part of a contact point in one round of impacts.
enum class ImpactRole : char { kNone, kStrikes, kSupports };

/// A place of a surface that has yielded.
struct Dent {
  int body = -1, shape = 0;
  Vector3d p = Vector3d::Zero();  // in the body, m
  double reach = 0;               // m from p that it covers
  double area = 0;                // m²
  double depth = 0;               // that stays, m
  bool pierced = false;
  bool is_new = false;  // made in this step
};

/// How a contact point moves against the centres of mass of its bodies: it may move along the surface.
struct Travel {
  bool known = false;                                                 // the next two are
  Vector3d a = Vector3d::Zero(), b = Vector3d::Zero();                // over the last step, m/s
  Vector3d change_a = Vector3d::Zero(), change_b = Vector3d::Zero();  // since the step before, m/s
  bool goes_on = false;  // it was alike in the step before, so that it will be in the next one
};

struct World::Impl {
  /// A contact point with its material parameters and impulses.
  struct Contact {
    ContactPoint point;
    double mu = 0, restitution = 0, stiffness = 0, damping = 0;
    double gap = 0;                            // soft: of the spring, m; without the depth that stays after yielding
    double limit = scene::kInfinity;           // soft: force at which it yields, N
    double gap_before = 0;                     // soft: gap at the previous poses, m
    bool fresh = true;                         // soft: not indented
    bool can_yield = false, yields_b = false;  // soft: one of the surfaces yields; it is that of b
    bool without_effect = false;               // soft: pierced, or without area
    double torsion = 0;                        // bound of the moment about the normal per normal force, m
    Vector3d tangent = Vector3d::Zero();       // of anisotropic friction; zero: isotropic
    double mu_share[2] = {1, 1};               // of mu, along the tangent and across
    double allowed = 0;                        // depth that separate() leaves, m
    double approach = 0;                       // normal velocity, during the impacts
    Vector3d impulse = Vector3d::Zero();       // on b, from the last solution: start of the next one
    Vector3d impact = Vector3d::Zero();        // on b, of the impacts at the start of the step
    Vector3d sum = Vector3d::Zero();           // of both stages of the step
    double push = 0, share = 0;                // soft: spring's impulse in the velocity stage, N.s; of SoftContact
    bool conserves = false;                    // soft: of SoftContact, in this step
    bool matched = false;                      // with a point of the other list
    bool jumped = true;                        // it is new in this step, or its normal has turned by more than kJump
    Travel travel;
    bool distant = false;   // of a fast body that does not touch yet: without effect in this step
    bool too_deep = false;  // for separate()
    ImpactRole role = ImpactRole::kNone;

    /// Twice the energy of the contact's spring, J.
    double stored() const {
      if (!(stiffness < scene::kInfinity && gap < 0)) return 0;
      const double depth = std::min(-gap, limit / stiffness);
      return (fresh ? point.spread : 1) * stiffness * depth * depth;
    }
  };

  Impl(scene::Scene the_scene, Options the_options);

  // Phases of a step, in order
  void step(double h);
  void refresh(double h,
               double drifted);  // updates all that depends on poses alone, which have moved for the time `drifted`, s
  void resolve_impacts(double h);
  void kick(double half);
  void solve(Stage stage, double h);
  void drift(double h);
  void separate(double h);
  void publish(double h);

  // Of fast bodies, and drift(); fast_bodies.cpp
  Vector3d common_velocity() const;
  void set_margin(double h);
  bool find_fast(double h);
  bool fast(int a, int b, double h) const;
  void find_distant_points(double h);

  // Of resolve_impacts(); impacts.cpp
  bool find_impacts(double h);
  bool strikes(const Contact& touch, double h) const;
  bool begin_round(double h);
  void find_supports(double h);
  void find_all_struck(double h);
  void collect_impacts(double h, bool newton);
  void apply_impact_rows();
  void set_impact_rows(std::span<const double> x);
  void solve_impacts(double h, bool newton);
  void limit_energy(bool newton);
  void end_round();

  // Of soft contacts; soft_contacts.cpp
  bool collect_spring(std::size_t t, ConeRow& row, Stage stage, double h);
  bool has_stiff_springs() const;
  bool linearise_springs();
  void store_spring_impulses();
  void apply_lost_springs();

  // Of yielding contacts; yielding.cpp
  void make_dents();
  void set_spring(Contact& touch) const;
  Vector3d place_on_surface(const Contact& touch) const;
  std::size_t dent_at(const Contact& touch) const;
  Dent& make_dent(const Contact& touch);
  void yield(double h);
  void sum_yielding(double h);

  // Of the guard; guard.cpp
  void open_accounts();
  void set_small_energies();
  void join_accounts();
  void find_deep();
  void take_back_gains();
  std::size_t root_of(std::size_t account) const;
  Account* account(int body);
  Account* account_of_joint(std::size_t joint);
  template <class F>
  void divide(int a, int b, const F& f);
  void exchange(int a, int b, double at_a, double at_b);
  void measure_energies();
  void begin_impacts();
  void account_impacts();
  void begin_guard();
  void begin_stage();
  void account_stage(Stage stage, double h);
  void account_position_stage(double h);
  void account_velocity_stage(double h);
  double axis_impulse(std::size_t joint);
  void account_axis(std::size_t joint, double q_0, double s_0, double s_1, double h);
  template <class F>
  void add_driven_work(const F& impulse_of, double Account::*sum);
  void end_guard();
  bool assembled();
  double largest_gap() const;
  std::size_t widest_joint() const;
  std::size_t fastest(std::size_t account) const;

  // Of latches; latches.cpp
  void latches_changed();
  void begin_latches();
  void apply_soft_latches(Stage stage);
  void collect_latch(std::size_t i, Stage stage, double h);
  static void store_latch_row(const BoxRow& row, Latch& latch);
  void account_latches();
  void advance_latches(double h);

  // Of solve()
  void begin_inertias();
  void drive_loose_joints(Stage stage, double h);
  void begin_axes(Stage stage, double h);
  bool solve_trees();
  bool settle(Forest::Tree& tree);
  void collect_rows(Stage stage, double h);
  void collect_joint(const LooseJoint& one, Stage stage, double h);
  void check_gears() const;
  void collect_gear(const scene::Gear& gear, Stage stage, double h);
  double gear_error(const scene::Gear& gear);
  void collect_contact(std::size_t t, Stage stage, double h);
  ConeRow contact_row(std::size_t t) const;
  void solve_rows();
  void satisfy_joints(double h);
  void store_impulses();
  void store_spring_torques(double h);

  // Of the state
  template <class Self, class Visit>
  static void each_state(Self& world, Visit& visit);
  void after_restore();

  void reserve(std::size_t contacts);
  void reserve_impacts(std::size_t contacts);
  void detect();
  void update_points();
  bool allow_depths(int pass);
  void mark_too_deep();
  bool move_apart(double h);
  void match(double drifted);
  void follow(Contact& touch, const Contact& before, double drifted) const;
  Vector3d change_along(const Contact& touch) const;
  void set_friction(Contact& touch, const scene::Material& a, const scene::Material& b) const;
  bool is_dynamic(int body) const { return body >= 0 && bodies[index(body)].dynamic(); }
  double normal_velocity(const Contact& touch) const;
  Vector3d start_velocity(const Contact& touch) const;
  bool weightless(double h) const { return rest < kSlow * h * kWeakGravity; }
  double pressed_before(const Contact& touch) const;
  double rest_of(double pressed, double h) const;
  double rest_of(const Contact& touch, double h) const;

  scene::Scene scene;
  Options options;
  std::vector<RigidBody> bodies;
  std::vector<Joint> joints;
  std::vector<Axis> axes;  // one a joint
  Forest forest;
  Rows rows;
  collision::Detector detector;
  Advance advance;
  std::vector<LooseJoint> loose;
  std::vector<Latch> latches;
  bool has_whole_joints = false;
  std::vector<char> in_loops;                           // per joint: closes a loop of a tree
  std::vector<std::array<double, kJointRows>> joint_x;  // impulses of the joints' rows in the last solution
  struct RowOrigin {
    int joint;
    int row;
    int latch = -1;
  };
  std::vector<RowOrigin> row_origin;  // of the box rows, in the order of collection
  std::vector<AxisLaw> laws;          // of the freedoms' joints, in this stage
  std::vector<double> drives;         // constant impulse along each joint's axis, in this stage
  struct Place {
    Vector3d p;
    Eigen::Vector4d Q;
    Matrix3d R;
    Vector3d v, w, L;
  };
  std::vector<int> linked;        // bodies with joints
  std::vector<Place> places;      // their states at the start of the step
  std::vector<RigidBody> pushed;  // the bodies that separate() moves, without rotation
  struct Start {
    Vector3d p = Vector3d::Zero(), v = Vector3d::Zero(), w = Vector3d::Zero();
  };
  std::vector<Start> starts;          // of the bodies before the kick of a stage
  std::vector<char> shifted, frozen;  // bodies that separate() moves; bodies that it never moves
  std::vector<std::vector<const scene::Material*>> materials;

  std::vector<Contact> touches, touches_before;

  std::vector<Dent> dents;         // of fixed number; those without a body are free
  std::size_t next_dent = 0;       // that is used or replaced next
  std::size_t forgotten = 0;       // number of dents that were replaced
  std::vector<Yielding> yielding;  // one a body that yields
  /// Work data of the impacts.
  struct Impacts {
    struct Island {
      double work = 0, scale = 0;                      // of Newton's law, J; sum of |x u|
      double e = 1;                                    // the least restitution
      double linear = 0, square = 0, s = 0;            // of the plastic solution: x · u, xᵀ A x; its scale
      double at_scaled = 0, slope = 0, curvature = 0;  // work between the scaled solution and Newton's
      double share = 0;                                // of Newton's solution
    };
    double slow = 0;                    // m/s; slower approaches are no impacts
    double tolerance = 0;               // m/s
    std::vector<char> struck, carried;  // bodies that impacts have changed; bodies of the round
    std::vector<double> first;          // s, when each body meets another for the first time
    std::vector<double> u_start, x, u;  // per direction of each row: velocity before the round; impulse, velocity after it
    std::vector<double> x_plastic, u_plastic;
    std::vector<Island> islands;
  } impacts;

  std::vector<ContactPoint> points;
  std::vector<Vector3d> forces;
  std::vector<Wrench> applied;
  std::vector<Pose> poses;
  std::vector<Twist> twists;
  std::vector<double> q, dq;
  Status status;
  Guard guard;
  std::vector<int> account_of;  // of each body; −1: none, it is not dynamic
  std::vector<int> carriers;    // driven bodies with joints
  bool has_driven = false;
  bool joints_hold = false;  // in this step, all errors of joints are below those that fault() looks for
  std::size_t capacity = 0;  // number of points without allocation
  double margin = 0;
  double rest = 0;         // speed of contacts at rest by gravity, m/s
  bool pivots = false;     // a shape has a restitution or a stiffness
  bool torsional = false;  // a surface has torsional friction
  bool prepared = false;   // the rows match these poses and factors
  bool stale = true;       // poses changed since refresh()
  bool restored = false;   // the margin is that of the restored state
};

/// Calls f(account, share) for each of two bodies that has an account: they share equally.
template <class F>
void World::Impl::divide(int a, int b, const F& f) {
  Account *of_a = account(a), *of_b = account(b);
  const double share = of_a != nullptr && of_b != nullptr ? 0.5 : 1;
  if (of_a != nullptr) f(*of_a, share);
  if (of_b != nullptr) f(*of_b, share);
}

}  // namespace cotwin::contact_world
