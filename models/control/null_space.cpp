#include "models/control/null_space.h"

namespace cotwin::control {

NullSpace::NullSpace(const Cascade& cascade) : nu(Eigen::VectorXd::Zero(cascade.n())), ddq(nu), p_(nu), Mnu_(nu) {
  for (const Task& task : cascade.tasks) forces_.emplace_back(Eigen::VectorXd::Zero(task.a.size()));
}

void NullSpace::evaluate(Cascade& cascade, const Inputs& in) {
  nu = in.dq;
  cascade.split(nu, forces_);
  p_ = in.dq - 0.5 * nu;
  ddq.noalias() = in.dM * p_;
  p_ = in.gradient - in.yield * in.tau_e + ddq;
  for (std::size_t k = 0; k < cascade.tasks.size(); ++k) {
    if (!forces_[k].isZero(0)) p_.noalias() -= cascade.tasks[k].dJ.transpose() * forces_[k];
  }
  cascade.solve_mass(p_);
  ddq = -in.k_nu * nu - p_;
  cascade.project(ddq);

  Mnu_.noalias() = in.M * nu;
  const double twice = nu.dot(Mnu_);
  energy = twice / 2;
  dissipation = in.k_nu * twice;
  external_work = in.yield * nu.dot(in.tau_e);
}

double rate_step(const VectorIn& dq) {
  const double most = dq.lpNorm<Eigen::Infinity>();
  return most > 0 ? 1e-4 / most : 0;
}

}  // namespace cotwin::control
