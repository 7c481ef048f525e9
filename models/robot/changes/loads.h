#pragma once
#include <optional>
#include <span>
#include <vector>

#include "models/robot/changes/attachment.h"
#include "models/robot/floating_base.h"

/// What acts on a robot during a motion beside its own weight: parts that it carries, and a wrench at one of its frames.
namespace cotwin::robot {

/// A part of a motion, in shares s = t/T of its duration, 0 to 1: from ≤ s < to, and with to = 1 also the end.
struct Interval {
  double from = 0, to = 1;
  bool has(double s) const { return s >= from && (s < to || to >= 1); }
  bool whole() const { return from <= 0 && to >= 1; }
};

struct Payload {
  Attachment part;
  Interval when = {};
};

/// What the surroundings do to the robot at the origin of F, constant in the axes of the base or of F.
struct ExternalWrench {
  Frame frame;                // F
  Wrench f = Wrench::Zero();  // N, N m
  bool in_frame = false;      // in the axes of F
  Interval when = {};
};

struct Loads {
  std::vector<Payload> payloads;
  std::optional<ExternalWrench> wrench;
  bool none() const { return payloads.empty() && !wrench; }
  /// Shares within (0, 1) at which a load comes or goes, ascending.
  std::vector<double> breaks() const;
};

/// The robot with the payloads that it carries at the share s.
RobotModel loaded(const RobotModel& robot, const Loads& loads, double s);

/// (2a) along a motion with loads: τ = M q̈ + C q̇ + g − J_Fᵀ f, where M, C and g are those of the robot with what it carries at that time. A
/// part that comes or goes while the robot moves takes or leaves its momentum; no impulse of it is in τ. May be shared by threads.
class LoadedDynamics {
 public:
  /// Throws Error as attach() does.
  explicit LoadedDynamics(const RobotModel& robot, const Loads& loads = {});

  /// Scratch memory of one thread.
  struct Scratch {
    explicit Scratch(const LoadedDynamics& dynamics);
    Data data;
    Eigen::VectorXd q, tau;
    Matrix6X J;
    std::vector<double> run;  // of states of one phase
  };

  const Mechanism& mechanism(double s) const { return mechanisms_[phases_[phase(s)].mechanism]; }
  /// Shares at which the phases begin, the first one at 0; between them the loads do not change.
  std::vector<double> begins() const;
  /// inverse_dynamics_batch() of states at the ascending shares s. Allocates nothing where all states are in one phase.
  void inverse_dynamics(Scratch& scratch, std::size_t count, const double* s, const double* q, const double* dq,
                        const double* ddq, double* tau) const;
  /// Whether a wrench acts at the share s.
  bool pushed(double s) const { return wrench_ && wrench_->when.has(s); }
  /// J_Fᵀ f at q (n, N m or N); 0 where no wrench acts.
  const Eigen::VectorXd& wrench_torque(Scratch& scratch, double s, const VectorIn& q) const;

 private:
  struct Phase {
    double begin;
    std::size_t mechanism;
  };
  std::size_t phase(double s) const;

  std::vector<Mechanism> mechanisms_;  // of the robot with each set of payloads that it carries
  std::vector<Phase> phases_;
  std::optional<ExternalWrench> wrench_;
};

}  // namespace cotwin::robot
