#include "components/services/assumptions.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "components/services/energy_service.h"
#include "models/foundation/support/assumed.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

using Values = std::vector<double>;

/// Parameters of the drives that count in the rigid formulas, and the stiffness, with words for them.
struct Named {
  const char *name, *what;
  Values robot::DriveParameters::*values;
};
using P = robot::DriveParameters;
constexpr Named kMotors{"B", "inertia of motors", &P::B};
constexpr Named kStiffness{"K", "stiffness of joints", &P::K};
constexpr Named kFrictions[] = {{"tau_C", "Coulomb friction", &P::tau_C},
                                {"sigma2", "viscous friction", &P::sigma2},
                                {"tau_0", "constant friction", &P::tau_0},
                                {"link_tau_C", "Coulomb friction of links", &P::link_tau_C},
                                {"link_sigma2", "viscous friction of links", &P::link_sigma2},
                                {"link_tau_0", "constant friction of links", &P::link_tau_0}};
/// Any of these tells of friction.
constexpr const char* kTellFriction[] = {"tau_C", "sigma2", "tau_S", "link_tau_C", "link_sigma2", "link_A"};
/// Those of the electrical data without which energies are too small.
constexpr const char* kEssential[] = {"R", "k_t", "P_0", "controller", "efficiency"};

class Collector {
 public:
  Collector(const Robot& robot, const Needs& needs)
      : robot_(robot), moves_(needs.searched ? "durations, torques and power are" : "torques and power are") {
    if (needs.contact) contact_ = ", and so is the mass in a collision";
  }

  void limit(const char* what, double robot::Joint::*limit) {
    std::string names;
    for (const robot::Joint& joint : robot_.model.joints)
      if (std::isinf(joint.*limit) && !joint.passive) text::append(names, joint.name);
    if (!names.empty()) unknown(what + names, {}, "the motion may be too fast for it", robot_.urdf.filename().string());
  }
  void drives(const std::string& without) {
    const std::string too_small = moves_ + " too small", uncertain = moves_ + " as uncertain";
    const std::string file = without.empty() ? kDrivesFile : without;
    if (!without.empty() || !robot_.drives) {
      unknown(kMotors.what, {0}, too_small + contact_, file);
      if (!without.empty() || drive_terms(robot_).tau_C.empty()) unknown("friction", {0}, too_small, file);
      return;
    }
    std::string names;
    for (const std::size_t j : robot_.unknown_motors()) text::append(names, robot_.model.joints[j].name);
    if (!names.empty()) unknown(kMotors.what + (" of " + names), robot_.drives->B, moves_ + " uncertain" + contact_, file);
    assumed(kMotors, uncertain + contact_);
    if (std::ranges::none_of(kTellFriction, [&](const char* name) { return robot_.drives->has(name); }))
      unknown("friction", {0}, too_small, file);
    for (const Named& friction : kFrictions) assumed(friction, uncertain);
  }
  /// Of a twin with elastic joints: what the rigid formulas do not have.
  void elastic() {
    if (!robot_.drives) return;
    const DriveData& d = *robot_.drives;
    if (!d.has("K")) unknown(kStiffness.what, d.K, "how the robot swings is uncertain", kDrivesFile);
    assumed(kStiffness, "how the robot swings is as uncertain");
    std::string others;
    for (const char* name : robot::kDriveParameterNames) {
      const auto named = [&](const Named& one) { return std::string_view(one.name) == name; };
      if (d.has(name) && is_assumed(d.assumed, name) && !named(kMotors) && !named(kStiffness) &&
          std::ranges::none_of(kFrictions, named))
        text::append(others, name);
    }
    if (!others.empty()) add({others, {}, "how the robot swings and sticks is as uncertain", kDrivesFile, false});
  }
  void energy() {
    if (!robot_.energy)
      return unknown("losses of motors and supply", {0}, "energy is the work of the joints alone", kEnergyFile);
    const EnergyData& e = *robot_.energy;
    std::string guessed, missing;
    for (const char* name : energetics::kMayBeAssumed)
      if (e.has(name) && is_assumed(e.assumed, name)) text::append(guessed, name);
    for (const char* name : kEssential)
      if (!e.has(name)) text::append(missing, name);
    if (!missing.empty()) unknown("energy data " + missing, {}, "energy is uncertain", kEnergyFile);
    if (!guessed.empty()) add({"energy data " + guessed, {}, "energy is as uncertain", kEnergyFile, false});
  }
  void unknown(const std::string& what, const Values& value, const std::string& effect, const std::string& file) {
    add({what, value, effect, file, true});
  }
  std::vector<Assumption> take() { return std::move(all_); }

 private:
  void add(Assumption one) {
    if (std::ranges::adjacent_find(one.value, std::not_equal_to{}) == one.value.end() && !one.value.empty())
      one.value.resize(1);
    all_.push_back(std::move(one));
  }
  void assumed(const Named& parameter, const std::string& effect) {
    const DriveData& d = *robot_.drives;
    if (d.has(parameter.name) && is_assumed(d.assumed, parameter.name))
      add({parameter.what, d.*parameter.values, effect, kDrivesFile, false});
  }

  const Robot& robot_;
  std::string moves_, contact_;
  std::vector<Assumption> all_;
};

}  // namespace

std::vector<Assumption> assumptions(const Robot& robot, const Needs& needs) {
  Collector c(robot, needs);
  c.drives(needs.without_drives);
  if (needs.limits_of_speed) c.limit("limit of speed of ", &robot::Joint::dq_max);
  if (needs.limits_of_torque) c.limit("limit of torque of ", &robot::Joint::tau_max);
  if (needs.load > 0) c.unknown("load in the motion", {0}, "torques and durations are too small", "request: load_kg");
  if (needs.elastic) c.elastic();
  if (needs.energy) c.energy();
  return c.take();
}

std::string unknown_motors(const Robot& robot) {
  if (!robot.drives) return "there is no drive_train.ssv beside the URDF, and the inertia of the motors is unknown";
  std::string names;
  for (const std::size_t j : robot.unknown_motors()) text::append(names, robot.model.joints[j].name);
  return names.empty() ? "" : "drive_train.ssv has no inertia of the motors of " + names;
}

}  // namespace cotwin::services
