#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/scene/cell.h"

namespace cotwin::contact_world {

/// The physical environment of robots and the bodies that they handle, in maximal coordinates:
///   M ν̇ = f + f_c                                                                     (1)
/// with joints, limits and contacts as constraints f_c (world.h). A robot's links are held in one of two ways, the same words
/// as the drive train's setting `link`, so that one shared setting chooses for both:
///   link=inside    the drive train integrates (2a) and gives q, q̇; before each step the links are placed there. They take the
///                  step by (1), as they will in the drive train, and the τ_e = Jᵀ F that they meet goes to its same step
///   link=outside   the links move here by (1), and q, q̇ go to the drive train
/// What moves the links between two exchanges is configuration, never a value of τ_J:
///   actuation=torque       τ_J drives them
///   actuation=prescribed   with link=inside: q, q̇ are prescribed, say by a recording, and no torque is known; what drove the
///                          links besides the contacts in the last step, (2a), goes on. No tau_J, dtheta, K, D and B then
/// With torques, τ_J drives the links and follows the gear within the step, τ_J + K (θ̇ s − Δq), taken implicitly: so light
/// links on stiff gears stay stable at 1 ms. The wiring is the same but for `q` and `dq`, which are inputs in the former case
/// and outputs in the latter, just the other way round than the drive train's.
///
/// A step whose points exceed `contacts` allocates once and tells so in `grown`.
class ContactWorld final : public Unit {
 public:
  /// What may be chosen by the source of the unit; cotwin describe shows it.
  static void declare_settings(SettingList& s);
  explicit ContactWorld(Settings& settings);
  ~ContactWorld() override;

  void declare(Variables& v) override;
  /// Throws Error for start values without meaning.
  void initialise(Time start) override;
  /// Throws Error if an input is not finite.
  StepResult step(Time now, Duration h) override;
  void restored() override;

 private:
  struct Robot;
  struct Body;
  enum class Link { kInside, kOutside };
  enum class Actuation { kTorque, kPrescribed };

  void check_names() const;
  void declare_robot(Variables& v, Robot& robot);
  void declare_body(Variables& v, Body& body);
  void build();
  std::vector<double> layout() const;
  void check_parameters() const;
  void check_inputs(Time now) const;
  void place(Robot& robot, double h);
  void carry(Robot& robot);
  void drive(Robot& robot, double h);
  void weigh(Robot& robot);
  void write_outputs(double h);
  void write_robot(Robot& robot, double h);
  void add_contact(int body, const Eigen::Vector3d& p_W, const Eigen::Vector3d& f_W);

  std::string place_;  // for messages
  scene::Cell cell_;
  Link link_;
  Actuation actuation_;
  bool floating_;
  Options options_;
  std::size_t shown_;  // contact points that are outputs
  std::vector<std::unique_ptr<Robot>> robots_;
  std::vector<std::unique_ptr<Body>> bodies_;
  std::unique_ptr<World> world_;
  std::vector<double> built_from_;  // the parameters that world_ was built from

  std::vector<double> gravity_;  // parameters
  std::int32_t iterations_ = 0;
  double tolerance_ = 0;

  std::vector<double> state_;                                // of the world
  double h_before_ = 0;                                      // state
  std::vector<double> contact_p_, contact_f_, contact_gap_;  // outputs
  std::vector<std::int32_t> contact_bodies_;
  std::int32_t contacts_ = 0, used_iterations_ = 0, grown_ = 0, degenerate_ = 0;
  double residual_ = 0, joint_gap_ = 0, energy_ = 0, penetration_ = 0, largest_force_ = 0;
};

}  // namespace cotwin::contact_world
