#pragma once
#include <Eigen/Core>

#include "components/compliance/joints/link_dynamics.h"
#include "components/unit/joint_variables.h"

namespace cotwin::compliance {

/// The terms of inverse dynamics (2a) of the compliant motion, N.m: M q̈_c, C q̇_c and g; with a floating base M* q̈_c and b*, where
/// gravity is no load.
class TorqueTerms {
 public:
  explicit TorqueTerms(std::size_t joints);

  void declare(JointVariables& joints);
  void compute(LinkDynamics& links, const std::vector<double>& q_c, const std::vector<double>& dq_c,
               const std::vector<double>& ddq_c);

 private:
  Eigen::VectorXd inertia_, coriolis_, gravity_, rest_;
};

}  // namespace cotwin::compliance
