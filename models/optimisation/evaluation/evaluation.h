#pragma once
#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "models/optimisation/evaluation/drive_power.h"
#include "models/optimisation/evaluation/problem.h"
#include "models/optimisation/evaluation/quadrature.h"
#include "models/robot/changes/loads.h"

namespace cotwin::optimisation {

inline constexpr std::size_t kLanes = numerics::BatchMatrix::kLanes;

/// What the violation of a range is relative to: its width, 1 if it has none.
double scale_of(double low, double high);

/// Eight motions, one per lane: element i of lane k at [i · kLanes + k].
struct Motions {
  std::vector<double> c;           // n · (degree − 5) coefficients c_r, joint by joint
  std::vector<double> q_from;      // n
  std::vector<double> q_to;        // n
  std::array<double, kLanes> T{};  // s
  std::size_t count = kLanes;      // motions in use, those of the first lanes
  std::vector<double> compliance;  // 3 · axes: M, D, S of each axis of the compliant frame
};

/// What was found of eight motions.
struct Values {
  std::vector<double> costs;  // of each cost term; unspecified for motions that were pruned
  /// Relative violations of position, speed, acceleration and jerk: the sum of what is found at nine places, else the sum of the
  /// exact ones between them; 0 if and only if there is none.
  std::array<double, kLanes> kinematic{};
  /// Sum over the joints of the relative violation of the torque bound less its margin, at the samples, and of the violated
  /// conditions of the compliant frame; 0: none.
  std::array<double, kLanes> torque{};
  /// The bound that is exceeded most, of those that were looked at: 0 to 4 for q, dq, ddq, dddq, tau.
  struct Excess {
    int bound = 0;
    std::size_t joint = 0;
    double by = 0;  // relative
  };
  std::array<Excess, kLanes> worst;
  /// Motions with a violated kinematic bound are pruned: their torques are not computed.
  std::array<bool, kLanes> pruned{};
};

/// Costs and violations of motions of one problem. May be shared by threads; scratch memory is per thread. Allocates nothing
/// after the first evaluation.
class Evaluator {
 public:
  static constexpr int kParts = 8;  // of the hulls

  explicit Evaluator(const Problem& problem);
  ~Evaluator();

  const Problem& problem() const { return problem_; }
  const MotionBasis& basis() const { return basis_; }
  std::size_t joints() const { return n_; }
  std::size_t samples() const { return nodes_.s.size(); }
  /// Weights of the samples' quadrature, Σ w = 1.
  std::span<const double> weights() const { return nodes_.w; }
  /// Their places s = t/T.
  std::span<const double> nodes() const { return nodes_.s; }
  Motions motions() const;
  Values values() const;

  class Scratch;
  std::unique_ptr<Scratch> scratch() const;

  /// Torques of the samples first … first + count − 1 of the motion in one lane: of joint j at sample first + s at
  /// tau[j · count + s].
  using Visit =
      std::function<void(std::size_t lane, std::size_t first, std::size_t count, const double* tau, const double* dq)>;
  /// `all`: computes the torques of all motions, without a look at the kinematic bounds. `visit` may be empty.
  void evaluate(const Motions& motions, Scratch& scratch, Values& values, bool all = false, const Visit& visit = {}) const;

  /// Coordinates of a joint in the basis divided by Tʳ, of the last evaluate(): what the tables of dʳq/dtʳ are multiplied with.
  const double* coordinates(const Scratch& scratch, int derivative, std::size_t joint) const;

  /// Parameters and responses of the compliant frame in the last motion that evaluate() did not prune.
  struct Compliance {
    std::vector<ComplianceValues> values;
    std::vector<AxisResponse> responses;
  };
  Compliance compliance(const Scratch& scratch) const;

  /// Control points of joint j of lane k over s.
  std::vector<double> control_points(const Motions& motions, std::size_t lane, std::size_t joint) const;

 private:
  void set_coordinates(const Motions& motions, Scratch& s) const;
  double violation(const Scratch& s, std::size_t joint, int derivative, std::size_t lane, double low, double high) const;
  void check_kinematics(Scratch& s, Values& values) const;
  void exact_costs(const Motions& motions, Scratch& s, Values& values) const;
  void dynamics(const Motions& motions, std::size_t lane, Scratch& s, Values& values, const Visit& visit) const;
  void add_drives(Scratch& s, std::size_t count) const;
  void states_at(const std::array<std::vector<double>, 3>& tables, std::size_t lane, Scratch& s) const;
  void frames(const Motions& motions, std::size_t lane, Scratch& s, Values& values) const;

  Problem problem_;
  std::size_t n_;
  MotionBasis basis_;
  robot::LoadedDynamics dynamics_;
  Quadrature nodes_, exact_;
  std::vector<std::size_t> parts_;  // where parts with the same loads begin, of at most 64 samples; then the number of samples
  std::array<numerics::BatchMatrix, 4> hull_;
  std::array<std::vector<double>, 3> tables_;          // of q, q′ and q″: column c at the samples from [c · samples()] on
  std::array<numerics::BatchMatrix, 2> exact_tables_;  // q″ and q‴ at the nodes of exact_
  std::optional<DrivePower> electrical_;
  std::array<std::vector<double>, 3> contact_tables_, compliant_tables_;  // as tables_, at the places of the frames' values
  bool torques_ = false, contact_ = false, compliant_ = false;
};

class Evaluator::Scratch {
 public:
  explicit Scratch(const Evaluator& e);

 private:
  friend class Evaluator;
  robot::LoadedDynamics::Scratch loaded;
  std::array<std::vector<double>, 4> x;  // n · columns · kLanes: coordinates divided by Tʳ
  std::vector<double> rows;              // of hulls and exact tables
  struct Undecided {                     // bounds of the derivative of a joint that the hull does not decide
    int derivative;
    std::size_t joint, lane;
  };
  std::vector<Undecided> undecided;
  std::vector<double> own;              // n · columns: coordinates of one motion
  std::vector<double> q, dq, ddq, tau;  // n · samples of a part
  std::vector<double> largest;          // n: max |τ_m|
  std::vector<double> squares;          // n: ∫ τ_m² ds
  std::vector<double> power, sums;      // W; of each cost
  std::vector<double> drawn;            // electrical power of all samples, W
  std::optional<ContactMotion> contact;
  std::optional<CompliantMotion> compliant;
  std::array<std::vector<double>, 3> at_places;  // n · places: q, q̇, q̈ of one motion
  std::vector<ComplianceValues> compliance;
  std::vector<AxisResponse> responses;
};

}  // namespace cotwin::optimisation
