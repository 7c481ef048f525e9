#include "components/services/json/assumptions.h"

#include <algorithm>
#include <cmath>

#include "components/services/energy_service.h"
#include "components/services/json/move_json.h"
#include "models/foundation/support/assumed.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

using Parameters = robot::DriveParameters;

/// Parameters of the drives that count in the rigid formulas, with words for them.
struct Named {
  const char *name, *what;
  std::vector<double> Parameters::*values;
};
constexpr Named kMotors{"B", "inertia of motors", &Parameters::B};
constexpr Named kStiffness{"K", "stiffness of joints", &Parameters::K};
constexpr Named kFrictions[] = {{"tau_C", "Coulomb friction", &Parameters::tau_C},
                                {"sigma2", "viscous friction", &Parameters::sigma2},
                                {"tau_0", "constant friction", &Parameters::tau_0},
                                {"link_tau_C", "Coulomb friction of links", &Parameters::link_tau_C},
                                {"link_sigma2", "viscous friction of links", &Parameters::link_sigma2},
                                {"link_tau_0", "constant friction of links", &Parameters::link_tau_0}};
/// Those of the electrical data without which energies are too small.
constexpr const char* kEssential[] = {"R", "k_t", "P_0", "controller", "efficiency"};

/// One number for all joints if it is the same.
Json number_of(const std::vector<double>& values) {
  const bool same = std::ranges::all_of(values, [&](double x) { return x == values.front(); });
  return same && !values.empty() ? Json(values.front()) : Json(values);
}

class Assumptions {
 public:
  Assumptions(const Robot& robot, bool searched, bool contact) : robot_(robot) {
    moves_ = searched ? "durations, torques and power are" : "torques and power are";
    if (contact) moves_ += ", and the mass in a collision is,";
  }

  void unknown(const std::string& what, const Json& value, const std::string& effect, const std::string& file) {
    add(what, value, effect, file);
    if (unknown_.empty() || unknown_.back().second != effect) unknown_.push_back({"", effect});
    text::append(unknown_.back().first, what);
  }
  void assumed(const std::string& what, const Json& value, const std::string& effect, const std::string& file) {
    add(what, value, effect, file);
    text::append(assumed_, what);
  }

  void limits(Reader& r) {
    for (const auto& [plain, what, order, limit] : {std::tuple{"dq_max", "limit of speed", 1, &robot::Joint::dq_max},
                                                    {"tau_max", "limit of torque", 4, &robot::Joint::tau_max}}) {
      std::string names;
      for (const robot::Joint& joint : robot_.model.joints)
        if (std::isinf(joint.*limit) && !joint.passive) text::append(names, joint.name);
      if (names.empty() || r.gives(JointUnits(robot_.model).name(plain, order).c_str())) continue;
      unknown(std::string(what) + " of " + names, nullptr, "the motion may be too fast for it",
              robot_.urdf.filename().string());
    }
  }
  /// `counts`: the request lets the drives count.
  void drives(bool counts, const std::string& why_not) {
    const std::string too_small = moves_ + " too small", uncertain = moves_ + " as uncertain";
    const std::string file = counts ? kDrivesFile : why_not;
    if (!counts || !robot_.drives) {
      unknown(kMotors.what, 0, too_small, file);
      if (!counts || drive_terms(robot_).tau_C.empty()) unknown("friction", 0, too_small, file);
      return;
    }
    const DriveData& d = *robot_.drives;
    const std::vector<std::size_t> motors = robot_.unknown_motors();
    if (!motors.empty()) {
      std::string names;
      for (const std::size_t j : motors) text::append(names, robot_.model.joints[j].name);
      unknown(kMotors.what + (" of " + names), number_of(d.B), moves_ + " uncertain", file);
    }
    one(kMotors, uncertain);
    const char* const frictions[] = {"tau_C", "sigma2", "tau_S", "link_tau_C", "link_sigma2", "link_A"};
    if (std::ranges::none_of(frictions, [&](const char* name) { return d.has(name); })) unknown("friction", 0, too_small, file);
    for (const Named& friction : kFrictions) one(friction, uncertain);
  }
  /// Of a twin with elastic joints: what the rigid formulas do not have.
  void elastic() {
    if (!robot_.drives) return;
    const DriveData& d = *robot_.drives;
    if (!d.has("K")) unknown(kStiffness.what, number_of(d.K), "how the robot swings is uncertain", kDrivesFile);
    one(kStiffness, "how the robot swings is as uncertain");
    std::string others;
    for (const std::string& name : d.given)
      if (is_assumed(d.assumed, name) && name != kMotors.name && name != kStiffness.name &&
          std::ranges::find(robot::kDriveParameterNames, name) != robot::kDriveParameterNames.end() &&
          std::ranges::none_of(kFrictions, [&](const Named& f) { return f.name == name; }))
        text::append(others, name);
    if (!others.empty()) assumed(others, nullptr, "how the robot swings and sticks is as uncertain", kDrivesFile);
  }
  void energy() {
    if (!robot_.energy) return unknown("losses of motors and supply", 0, "energy is the work of the joints alone", kEnergyFile);
    const EnergyData& e = *robot_.energy;
    std::string guessed, missing;
    for (const char* name : energetics::kMayBeAssumed)
      if (is_assumed(e.assumed, name) && e.has(name)) text::append(guessed, name);
    for (const char* name : kEssential)
      if (!e.has(name)) text::append(missing, name);
    if (!missing.empty()) unknown("energy data " + missing, nullptr, "energy is uncertain", kEnergyFile);
    if (!guessed.empty()) assumed("energy data " + guessed, nullptr, "energy is as uncertain", kEnergyFile);
  }

  void tell(Json& reply) const {
    if (all_.empty()) return;
    reply["assumptions"] = all_;
    for (const auto& [what, effect] : unknown_) add_notes(reply, {"unknown: " + what + "; " + effect});
    if (!assumed_.empty()) add_notes(reply, {"assumed, not measured: " + assumed_ + "; the answer is as uncertain"});
  }

 private:
  void add(const std::string& what, const Json& value, const std::string& effect, const std::string& file) {
    all_.push_back({{"what", what}, {"value", value}, {"effect", effect}, {"file", file}});
  }
  void one(const Named& parameter, const std::string& effect) {
    const DriveData& d = *robot_.drives;
    if (d.has(parameter.name) && is_assumed(d.assumed, parameter.name))
      assumed(parameter.what, number_of(d.*parameter.values), effect, kDrivesFile);
  }

  const Robot& robot_;
  std::string moves_, assumed_;
  std::vector<std::pair<std::string, std::string>> unknown_;  // of each effect the names
  Json all_ = Json::array();
};

/// Whether the costs of an optimisation have this one.
bool has_cost(Reader& r, const char* name) {
  const Json* cost = r.any("cost");
  if (!cost) return false;
  if (!cost->is_array()) return *cost == name;
  return std::ranges::any_of(*cost, [&](const Json& one) { return one.value("name", "") == name; });
}

}  // namespace

void add_assumptions(const std::string& service, const Robot& robot, Reader& r, Json& reply) {
  const auto is = [&](std::initializer_list<const char*> names) { return std::ranges::find(names, service) != names.end(); };
  const bool series = service == "reaction" && r.gives("series");
  const bool searched = !series && !r.gives("T_s") && (service != "optimise" || r.gives("T_max_s"));
  if (service == "jerk" && !searched) return;  // of the shape alone
  const Json* const drives = r.any("drives");
  const bool none = drives && *drives == "none", optimise = service == "optimise";
  const bool contact =
      is({"safety", "effective_mass"}) || (optimise && (has_cost(r, "safety") || has_cost(r, "effective_mass")));
  Assumptions a(robot, searched, contact);
  a.drives(!none && !series, none ? "request: drives = none" : "request: of a series without drives");
  if (!series) a.limits(r);
  if (const Json* const load = r.any("load_kg"); contact && load && *load > 0)
    a.unknown("load in the motion", 0, "torques and durations are too small", "request: load_kg");
  const Json* const verified = r.any("verify");
  if (!none && (service == "verify" || (verified && *verified == true))) a.elastic();
  if (service == "energy" || (optimise && has_cost(r, "energy")) || (service == "verify" && robot.energy)) a.energy();
  a.tell(reply);
}

Json data_of(const Robot& robot) {
  const auto word = [](const auto& data) {
    if (!data) return "missing";
    return data->assumed == "all" ? "assumed" : data->assumed.empty() || data->assumed == "none" ? "given" : "partly assumed";
  };
  std::error_code none;
  const bool compliance = std::filesystem::is_regular_file(robot.urdf.parent_path() / kComplianceFile, none);
  return {{kDrivesFile, word(robot.drives)},
          {kComplianceFile, compliance ? "given" : "missing"},
          {kEnergyFile, word(robot.energy)}};
}

Json data_of_all(Robots& robots) {
  Json all = Json::object();
  for (const std::string& name : robots.names()) try {
      const std::shared_ptr<const Robot> robot = robots.find(name);
      all[name] = {{"joints", robot->model.joints.size()}};
      all[name].update(data_of(*robot));
    } catch (const Error& e) {
      all[name] = {{"problem", e.what()}};
    }
  return all;
}

std::string unknown_motors(const Robot& robot) {
  if (!robot.drives) return "there is no drive_train.ssv beside the URDF, and the inertia of the motors is unknown";
  std::string names;
  for (const std::size_t j : robot.unknown_motors()) text::append(names, robot.model.joints[j].name);
  return names.empty() ? "" : "drive_train.ssv has no inertia of the motors of " + names;
}

}  // namespace cotwin::services
