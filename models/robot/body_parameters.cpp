#include "models/robot/body_parameters.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"

namespace cotwin::robot {

BodyParameters::BodyParameters(const RobotModel& robot) : robot_(robot) {
  robot_.history.clear();
  for (const Body& body : robot_.bodies) {
    const auto pi = body.inertia.parameters();
    mass.push_back(pi[0]);
    first_moment.insert(first_moment.end(), pi.data() + 1, pi.data() + 4);
    inertia.insert(inertia.end(), pi.data() + 4, pi.data() + 10);
    in_force.insert(in_force.end(), pi.data(), pi.data() + 10);
    first_.push_back(body.inertia);
  }
  seen_ = first_pi_ = in_force;
}

double BodyParameters::wanted(std::size_t k) const {
  const std::size_t body = k / 10, element = k % 10;
  return element == 0 ? mass[body] : element < 4 ? first_moment[3 * body + element - 1] : inertia[6 * body + element - 4];
}

void BodyParameters::check(const std::string& place) {
  for (std::size_t body = 0; body < mass.size(); ++body) {
    Eigen::Matrix<double, 10, 1> pi;
    bool changed = false;
    for (std::size_t element = 0; element < 10; ++element) {
      const std::size_t k = 10 * body + element;
      pi[static_cast<Eigen::Index>(element)] = wanted(k);
      changed = changed || wanted(k) != seen_[k];
    }
    if (!changed) continue;
    const std::string why = pi.allFinite() ? Inertia::from_parameters(pi).unphysical() : "a value is not finite";
    if (!why.empty()) {
      throw Error(place + ".mass[" + std::to_string(body + 1) + "]",
                  "with first_moment and inertia of body '" + robot_.bodies[body].name + "': " + why);
    }
    std::copy(pi.data(), pi.data() + 10, seen_.data() + 10 * body);
  }
}

void BodyParameters::adopt(Mechanism& mechanism) {
  for (std::size_t body = 0; body < robot_.bodies.size(); ++body) {
    const double* pi = in_force.data() + 10 * body;
    robot_.bodies[body].inertia = std::equal(pi, pi + 10, first_pi_.data() + 10 * body)
                                      ? first_[body]
                                      : Inertia::from_parameters(Eigen::Map<const Eigen::Matrix<double, 10, 1>>(pi));
  }
  mechanism.update(robot_);
}

void BodyParameters::take(const std::string& place, Mechanism& mechanism) {
  check(place);
  bool changed = false;
  for (std::size_t k = 0; k < in_force.size(); ++k) {
    changed = changed || in_force[k] != wanted(k);
    in_force[k] = wanted(k);
  }
  if (changed) adopt(mechanism);
}

bool BodyParameters::pending() const {
  int changed = 0;  // without branches, because it is called in every step
  const double* pi = in_force.data();
  for (std::size_t body = 0; body < mass.size(); ++body, pi += 10) {
    changed += pi[0] != mass[body];
    for (std::size_t k = 0; k < 3; ++k) changed += pi[1 + k] != first_moment[3 * body + k];
    for (std::size_t k = 0; k < 6; ++k) changed += pi[4 + k] != inertia[6 * body + k];
  }
  return changed > 0;
}

bool BodyParameters::follow(const std::string& place, double remaining, Mechanism& mechanism) {
  if (!pending()) return false;
  check(place);
  for (std::size_t k = 0; k < in_force.size(); ++k) {
    const double target = wanted(k), next = target + (in_force[k] - target) * remaining;
    // reach the target exactly
    in_force[k] = std::abs(next - target) <= 1e-9 * (std::abs(target) + 1e-3) ? target : next;
  }
  adopt(mechanism);
  return true;
}

void BodyParameters::restored(Mechanism& mechanism) {
  for (std::size_t k = 0; k < seen_.size(); ++k) seen_[k] = in_force[k];
  adopt(mechanism);
}

}  // namespace cotwin::robot
