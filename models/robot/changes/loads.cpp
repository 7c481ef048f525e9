#include "models/robot/changes/loads.h"

#include <algorithm>

namespace cotwin::robot {

std::vector<double> Loads::breaks() const {
  std::vector<double> all;
  const auto add = [&](const Interval& when) { all.insert(all.end(), {when.from, when.to}); };
  for (const Payload& payload : payloads) add(payload.when);
  if (wrench) add(wrench->when);
  std::erase_if(all, [](double s) { return !(s > 0 && s < 1); });
  std::ranges::sort(all);
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

RobotModel loaded(const RobotModel& robot, const Loads& loads, double s) {
  RobotModel carrying = robot;
  for (const Payload& payload : loads.payloads)
    if (payload.when.has(s)) attach(carrying, payload.part);
  return carrying;
}

LoadedDynamics::LoadedDynamics(const RobotModel& robot, const Loads& loads) : wrench_(loads.wrench) {
  std::vector<std::vector<bool>> carried;  // of each mechanism
  std::vector<double> begins = loads.breaks();
  begins.insert(begins.begin(), 0);
  for (const double s : begins) {
    std::vector<bool> own;
    for (const Payload& payload : loads.payloads) own.push_back(payload.when.has(s));
    const auto same = std::ranges::find(carried, own);
    phases_.push_back({s, static_cast<std::size_t>(same - carried.begin())});
    if (same != carried.end()) continue;
    const bool none = std::ranges::find(own, true) == own.end();
    mechanisms_.push_back(none ? Mechanism(robot) : Mechanism(loaded(robot, loads, s)));
    carried.push_back(std::move(own));
  }
}

LoadedDynamics::Scratch::Scratch(const LoadedDynamics& d)
    : data(d.mechanisms_.front()), q(d.mechanisms_.front().n()), tau(q), J(6, q.size()) {}

std::vector<double> LoadedDynamics::begins() const {
  std::vector<double> all;
  for (const Phase& phase : phases_) all.push_back(phase.begin);
  return all;
}

std::size_t LoadedDynamics::phase(double s) const {
  std::size_t k = phases_.size() - 1;
  while (k > 0 && s < phases_[k].begin) --k;
  return k;
}

const Eigen::VectorXd& LoadedDynamics::wrench_torque(Scratch& scratch, double s, const VectorIn& q) const {
  if (!pushed(s)) return scratch.tau.setZero();
  const Pose X_BF = jacobian(mechanism(s), scratch.data, q, on_body(wrench_->frame), scratch.J);
  Wrench f = wrench_->f;
  if (wrench_->in_frame) f << X_BF.R * f.head<3>(), X_BF.R * f.tail<3>();
  scratch.tau.noalias() = scratch.J.transpose() * f;
  return scratch.tau;
}

void LoadedDynamics::inverse_dynamics(Scratch& scratch, std::size_t count, const double* s, const double* q, const double* dq,
                                      const double* ddq, double* tau) const {
  const auto n = static_cast<std::size_t>(scratch.q.size());
  for (std::size_t first = 0, last = 0; first < count; first = last) {
    const std::size_t own = phase(s[first]);
    while (last < count && phase(s[last]) == own) ++last;
    const std::size_t part = last - first;
    const Mechanism& mechanism = mechanisms_[phases_[own].mechanism];
    if (part == count) {
      inverse_dynamics_batch(mechanism, scratch.data, count, q, dq, ddq, tau);
      break;
    }
    scratch.run.resize(4 * n * part);
    double* const run = scratch.run.data();
    for (std::size_t j = 0; j < n; ++j) {
      std::copy_n(q + j * count + first, part, run + j * part);
      std::copy_n(dq + j * count + first, part, run + (n + j) * part);
      std::copy_n(ddq + j * count + first, part, run + (2 * n + j) * part);
    }
    inverse_dynamics_batch(mechanism, scratch.data, part, run, run + n * part, run + 2 * n * part, run + 3 * n * part);
    for (std::size_t j = 0; j < n; ++j) std::copy_n(run + (3 * n + j) * part, part, tau + j * count + first);
  }
  if (!wrench_) return;
  for (std::size_t i = 0; i < count; ++i) {
    if (!pushed(s[i])) continue;
    for (std::size_t j = 0; j < n; ++j) scratch.q[static_cast<Eigen::Index>(j)] = q[j * count + i];
    const Eigen::VectorXd& own = wrench_torque(scratch, s[i], scratch.q);
    for (std::size_t j = 0; j < n; ++j) tau[j * count + i] -= own[static_cast<Eigen::Index>(j)];
  }
}

}  // namespace cotwin::robot
