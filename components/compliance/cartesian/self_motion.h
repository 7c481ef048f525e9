#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "components/compliance/cartesian/task_list.h"
#include "components/compliance/joints/link_dynamics.h"
#include "components/unit/joint_variables.h"
#include "components/unit/settings.h"
#include "components/unit/variables.h"
#include "models/control/goals.h"
#include "models/foundation/support/parameter_table.h"

namespace cotwin::compliance {

/// Tunables of lower tasks and of the goals in the null space.
struct SelfMotionParameters {
  using Values = std::vector<double>;
  Values omega_held, shift, activation;                               // of held frames
  Values q_0, K_0, w_limits, limit_margin, w_manipulability, w_mass;  // goals
  Values mass_axis;
  Values yield;
};

/// Self-motion of the joints below the compliant frame (IV-A3, V-B): the list of tasks, the potential V(q) of the goals, and the
/// part of external torques that no task feels. models/control has the equations.
///
/// Held frame F, a lower or higher task: p̈_F = −2 omega_held ṗ_F + omega_held² (p_start + shift − p_F) in the base's axes.
class SelfMotion {
 public:
  static void declare_settings(SettingList& s);
  /// `rendered`: directions of E. `joint_torques`: external joint torques are measured.
  SelfMotion(Settings& settings, const robot::RobotModel& robot, const std::vector<int>& rendered, bool joint_torques);

  const std::vector<TaskEntry>& tasks() const { return tasks_; }
  /// After the variables of Cartesian compliance.
  void declare(Variables& v);
  void check(const std::string& place) const;
  /// Frames are held where they are at `q`.
  void start(LinkDynamics& links, const Eigen::VectorXd& q);
  /// Parameters move towards the tunables: `remaining` of each difference is left.
  void follow(double remaining);

  struct Held {
    Eigen::Vector3d target;  // in B
    double omega, activation;
  };
  /// Of the k-th held frame.
  Held held(std::size_t k) const;
  double yield() const { return joint_torques_ ? in_force_.yield[0] : 0; }
  /// Adds ∇V at q to `gradient`; returns V, J. E: the compliance frame.
  double add_goals(LinkDynamics& links, const Eigen::VectorXd& q, const robot::FrameOnBody& E, Eigen::VectorXd& gradient);

  /// What the motion of the joints computed last.
  struct Computed {
    const Eigen::VectorXd& nu;
    double energy, potential, power;
  };
  void write_outputs(const Computed& c);
  /// Whether a task below the first one that is in force loses a direction to those above, and cannot do what it should there.
  bool contradicts(double sigma_0) const;
  std::vector<double> task_sigma, task_residual;  // by task
  std::vector<double> xi;                         // n, rad/s² or m/s²: of the user's own goal, an input that is added to ξ

 private:
  enum Goal : unsigned { kPosture = 1, kLimits = 2, kManipulability = 4, kMass = 8 };
  template <class F>
  void for_each(F f) const;
  bool has(Goal goal) const { return (goals_ & goal) != 0; }

  JointMeasures measures_;
  std::vector<TaskEntry> tasks_;
  std::size_t held_ = 0;
  unsigned goals_ = 0;
  bool joint_torques_;
  Eigen::VectorXd q_min_, q_max_, no_motors_;  // the last is empty
  control::ManipulabilityGoal manipulability_;
  control::EffectiveMassGoal mass_;
  // Parameters, states.
  SelfMotionParameters wanted_, in_force_;
  std::vector<double> p_start_;
  // Outputs.
  std::vector<double> nu_;
  double energy_ = 0, potential_ = 0, power_ = 0, w_ = 0, m_u_ = 0;
};

}  // namespace cotwin::compliance
