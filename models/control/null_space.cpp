#include "models/control/null_space.h"

namespace cotwin::control {

NullSpace::NullSpace(const Cascade& cascade) : nu(Eigen::VectorXd::Zero(cascade.n())), ddq(nu), p_(nu), force_(nu), Mnu_(nu) {
  for (const Task& task : cascade.tasks) forces_.emplace_back(Eigen::VectorXd::Zero(task.a.size()));
}

void NullSpace::evaluate(Cascade& cascade, const Inputs& in) {
  nu = in.dq;
  cascade.split(nu, forces_);
  p_ = in.dq - 0.5 * nu;
  force_.noalias() = -in.dM.lazyProduct(p_);
  force_ += in.yield * in.tau_e - in.gradient;
  for (std::size_t k = 0; k < cascade.tasks.size(); ++k) {
    if (!forces_[k].isZero(0)) force_.noalias() += cascade.tasks[k].dJ.transpose().lazyProduct(forces_[k]);
  }
  ddq = -in.k_nu * nu;
  if (in.also) ddq += *in.also;
  cascade.project(ddq, force_);

  Mnu_.noalias() = in.M.lazyProduct(nu);
  const double twice = nu.dot(Mnu_);
  energy = twice / 2;
  dissipation = in.k_nu * twice;
  external_work = in.yield * nu.dot(in.tau_e);
}

}  // namespace cotwin::control
