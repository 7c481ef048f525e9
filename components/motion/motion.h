#pragma once
#include <span>
#include <string>
#include <vector>

#include "components/motion/sources.h"
#include "components/unit/joint_variables.h"
#include "components/unit/unit.h"
#include "models/trajectory/axes.h"
#include "models/trajectory/time_scaling.h"

namespace cotwin::motion {

/// The desired motion q_d(t), q̇_d, q̈_d of the joints, prepared at initialisation and then a function of time alone:
///   q_d = q(s(t)),   q̇_d = q′ ṡ,   q̈_d = q″ ṡ² + q′ s̈
/// with a path q of polynomials (trajectory.h) and the phase s (time_scaling.h: stretching, soft start and stop). The joints
/// rest before t_start; after the end they rest, or the motion repeats or runs back and forth. Joint limits are checked, or
/// met by stretching.
class Motion final : public Unit {
 public:
  /// Declares the settings of the unit.
  static void declare_settings(SettingList& s);
  explicit Motion(Settings& settings);

  void declare(Variables& v) override;
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;

 private:
  enum class Loop { kNo, kRepeat, kThereAndBack };

  Motion(Settings& settings, std::vector<trajectory::Axis> axes);
  void prepare_phase();
  void check_ends();
  void evaluate(const trajectory::Phase::Value& s, std::span<double> q, std::span<double> dq, std::span<double> ddq) const;
  void evaluate_at(double t);

  std::vector<trajectory::Axis> axes_;
  JointMeasures measures_;
  AnySource source_;

  // Parameters.
  double t_start_ = 0, time_scale_ = 1, soft_start_ = 0, soft_stop_ = 0;
  std::string loop_ = "no", limits_ = "error";
  std::vector<double> dq_limit_, ddq_limit_, dddq_limit_;  // 0: the robot's limit, or none

  // Computed from the parameters.
  trajectory::Path path_;
  trajectory::Phase phase_;
  Loop looping_ = Loop::kNo;

  // Outputs.
  std::vector<double> q_d_, dq_d_, ddq_d_;
  bool done_ = false;
  double duration_ = 0, stretch_ = 1;
  std::string warning_;
};

}  // namespace cotwin::motion
