#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "components/contact_world/latches.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/scene/cell.h"

namespace cotwin::contact_world {

/// Robots and the bodies that they handle, in maximal coordinates:
///   M ν̇ = f + f_c                                                                     (1)
/// with joints, limits and contacts as constraints f_c (world.h). The setting `link` has the same values as the drive train's,
/// so that one shared setting configures both:
///   link_side=inside    the drive train integrates (2a) and outputs q, q̇. Each step sets the links to q, q̇, predicts their motion
///                  by (1) and outputs the mean τ_e = Jᵀ F, which the drive train uses in the same step
///   link_side=outside   this unit integrates the links by (1) and outputs q, q̇
/// The setting `maximal` names robots for which the latter holds although link_side=inside. With base=floating and link_side=inside the
/// base's pose and twist are inputs, too, and the wrench of all contacts on the robot is an output for the drive train.
/// The setting `actuation` chooses what drives the links between two exchanges:
///   actuation=torque       τ_J
///   actuation=prescribed   with link_side=inside: q, q̇ are prescribed, for example by a recording, and no torque is known. The
///                          torque that explains the last step by (2a), without the contacts, is applied again. There are no
///                          variables tau_J, dtheta, K, D and B
/// With torques, the gear's change within the step, τ_J + K (θ̇ s − Δq), is integrated implicitly, so that light links on stiff
/// gears are stable at 1 ms. `q` and `dq` are inputs with link_side=inside and outputs with link_side=outside, the opposite of the drive
/// train, so both cases have the same connections.
///
/// A step with more points than `contacts` allocates once and counts this in `grown`.
class ContactWorld final : public Unit {
 public:
  /// Declares the settings of the unit.
  static void declare_settings(SettingList& s);
  explicit ContactWorld(Settings& settings);
  ~ContactWorld() override;

  void declare(Variables& v) override;
  /// Throws Error for invalid start values.
  void initialise(Time start) override;
  /// Throws Error if an input is not finite, a joint parts or energy grows without work (World::fault).
  StepResult step(Time now, Duration h) override;
  void restored() override;
  void append_notes(std::vector<std::string>& notes) const override;

 private:
  struct Robot;
  struct Body;
  struct Loads;
  enum class LinkSide { kInside, kOutside };
  enum class Actuation { kTorque, kPrescribed };

  void check_names() const;
  void declare_robot(Variables& v, Robot& robot);
  void declare_body(Variables& v, Body& body);
  void build();
  void note_limits(const scene::Scene& scene);
  std::vector<double> layout() const;
  void check_parameters() const;
  void check_inputs(Time now) const;
  void set_bodies(Robot& robot);
  void show_tools(const Robot& robot, bool all);
  void set_links(Robot& robot, double h);
  void apply_last_torque(Robot& robot);
  void drive(Robot& robot, double h);
  void compute_mobility(Robot& robot, const std::vector<double>& q);
  static double step_damping(const Robot& robot, std::size_t joint, double h, double resolved);
  void write_outputs(double now, double h);
  void write_robot(Robot& robot, double h);
  bool may_hold(const Robot& robot) const;
  bool gives_loads(const Robot& robot) const;
  bool grips(const ContactPoint& point, const Eigen::Vector3d& f_W) const;
  void add_grip(std::size_t point, double h);
  void find_loads(double h);
  bool free_loads() const;
  double energy_of_loads();
  bool find_body(std::size_t body);
  void find_robot(Robot& robot, double h);
  void write_loads(double h);
  void add_correction(std::size_t body, const Pose& X_WL, const Twist& V_WL);
  void add_correction(Robot& robot);
  void carry_loads();
  void share_among_latches(std::size_t body, const Eigen::Vector3d& impulse, const Eigen::Vector3d& spin);
  void add_latch(int body, const Eigen::Vector3d& p_W, const Wrench& F);
  void add_contact(int body, const Eigen::Vector3d& p_W, const Eigen::Vector3d& f_W, bool grips);

  std::string place_;  // name of the unit, for messages
  scene::Cell cell_;
  LinkSide link_;
  Actuation actuation_;
  bool floating_;
  Options options_;
  std::size_t shown_;  // number of contact points that are outputs
  std::vector<std::unique_ptr<Robot>> robots_;
  std::vector<std::unique_ptr<Body>> bodies_;
  std::vector<LatchPort> latches_;
  std::unique_ptr<Loads> loads_;
  std::unique_ptr<World> world_;
  std::vector<double> built_from_;  // the parameters that world_ was built from

  std::vector<double> gravity_;  // parameters
  std::int32_t iterations_ = 0;
  double tolerance_ = 0, friction_scale_ = 1;
  double joint_gap_limit_ = 0.01, energy_limit_ = 0.25;

  std::vector<double> state_;                                // of the world
  std::vector<std::string> beyond_limits_;                   // notes on joints that start there
  double h_before_ = 0;                                      // state
  std::vector<double> grips_;                                // state: contacts of links with bodies, Loads::kNumbers each
  std::vector<double> load_gain_{0, 0};                      // state: whether the energy that held bodies got is known; J
  std::vector<double> contact_p_, contact_f_, contact_gap_;  // outputs
  std::vector<std::int32_t> contact_bodies_;
  std::int32_t contacts_ = 0, used_iterations_ = 0, grown_ = 0, degenerate_ = 0, extended_ = 0, unsolved_ = 0;
  std::int32_t impacts_ = 0;
  double contact_swing_ = 0;
  double largest_swing_ = 0;                         // of the run
  double unsolved_time_ = 0, largest_unsolved_ = 0;  // of the run, s, m/s
  double residual_ = 0, joint_gap_ = 0, energy_ = 0, penetration_ = 0, largest_force_ = 0;
};

}  // namespace cotwin::contact_world
