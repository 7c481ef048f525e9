#include "master/services/verify.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "components/services/energy_service.h"
#include "master/run/master.h"
#include "master/services/robot_folder.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using services::Verification;

constexpr double kTick = 1e-3;     // s
constexpr double kLongest = 1000;  // s, of a move

/// Start values of a unit, by name. As texts: one number holds for all joints.
using Values = std::vector<std::pair<std::string, std::string>>;

std::span<double> reals(std::span<const Member> members, const std::string& name) {
  const Signal signal = find_signal(members, name, "verification");
  return signal.variable->reals().subspan(signal.first, signal.count);
}

double sum(std::span<const double> x) { return std::accumulate(x.begin(), x.end(), 0.0); }

/// The loads of the move in the twin. What the robot carries changes the bodies of drive train and controller, as tools do
/// (master/engine/tools.h), but what it carries from the beginning is there before the twin finds its equilibrium. The wrench pushes
/// the links, and the controller, which does not yield, bears it as the plan does.
class TwinLoads {
 public:
  TwinLoads(std::span<const Member> members, const robot::RobotModel& robot, const services::Move& move)
      : move_(move), dynamics_(robot, move.loads), scratch_(dynamics_), begins_(dynamics_.begins()) {
    if (move.loads.none()) return;
    q_ = reals(members, "drive.q");
    tau_e_ = reals(members, "drive.tau_e");
    known_ = reals(members, "compliance.tau_e");
    tool_changes_ = reals(members, "drive.tool_changes");
    for (const double begin : begins_) added_.push_back(difference(robot, robot::loaded(robot, move.loads, begin)));
    for (const char* unit : {"drive.", "compliance."}) {
      Bodies bodies;
      for (const char* name : {"mass", "first_moment", "inertia"}) {
        bodies.values.push_back(reals(members, std::string(unit) + name));
        bodies.empty.emplace_back(bodies.values.back().begin(), bodies.values.back().end());
      }
      bodies_.push_back(std::move(bodies));
    }
    carry(0);
    push(0, move.from_q);
  }
  /// Before a tick that begins at `now`, s. Returns whether there are loads.
  bool apply(double now) {
    if (move_.loads.none()) return false;
    const double s = std::min(now / move_.T, 1.0);
    const auto next = static_cast<std::size_t>(std::ranges::upper_bound(begins_, s) - begins_.begin()) - 1;
    if (next != phase_) {
      carry(next);
      tool_changes_.front() += 1;
    }
    push(now, q_);
    return true;
  }

 private:
  using Parameters = std::vector<Eigen::Matrix<double, 10, 1>>;  // of each body
  struct Bodies {
    std::vector<std::span<double>> values;  // mass, first moment, inertia
    std::vector<std::vector<double>> empty;
  };
  static Parameters difference(const robot::RobotModel& robot, const robot::RobotModel& carrying) {
    Parameters all;
    for (std::size_t b = 0; b < robot.bodies.size(); ++b)
      all.emplace_back(carrying.bodies[b].inertia.parameters() - robot.bodies[b].inertia.parameters());
    return all;
  }
  void carry(std::size_t phase) {
    phase_ = phase;
    constexpr std::size_t kFirst[] = {0, 1, 4}, kSizes[] = {1, 3, 6};  // in Inertia::parameters()
    for (const Bodies& bodies : bodies_)
      for (std::size_t part = 0; part < 3; ++part)
        for (std::size_t i = 0; i < bodies.values[part].size(); ++i)
          bodies.values[part][i] = bodies.empty[part][i] +
                                   added_[phase][i / kSizes[part]][static_cast<Eigen::Index>(kFirst[part] + i % kSizes[part])];
  }
  /// At `now`, s. The controller follows within the time in which it follows payloads.
  void push(double now, std::span<const double> q) {
    if (!move_.loads.wrench) return;
    constexpr double kTransition = 0.05;  // s
    const double share = now > 0 ? 1 - std::exp(-kTick / kTransition) : 1;
    const Eigen::VectorXd& tau = dynamics_.wrench_torque(scratch_, std::min(now / move_.T, 1.0),
                                                         Eigen::Map<const Eigen::VectorXd>(q.data(), scratch_.q.size()));
    for (std::size_t j = 0; j < tau_e_.size(); ++j) {
      tau_e_[j] = now <= move_.T ? tau[static_cast<Eigen::Index>(j)] : 0;
      known_[j] += share * (tau_e_[j] - known_[j]);
    }
  }

  const services::Move& move_;
  robot::LoadedDynamics dynamics_;
  robot::LoadedDynamics::Scratch scratch_;
  std::vector<double> begins_;
  std::size_t phase_ = 0;
  std::vector<Parameters> added_;  // of each phase
  std::vector<Bodies> bodies_;
  std::span<double> q_, tau_e_, known_, tool_changes_;
};

/// What is read from the running twin.
struct Signals {
  Signals(std::span<const Member> members, bool with_energy)
      : q_d(reals(members, "motion.q_d")),
        q(reals(members, "drive.q")),
        dq(reals(members, "drive.dq")),
        tau_m(reals(members, "compliance.tau_m")),
        tau_excess(reals(members, "compliance.tau_excess")),
        work(reals(members, "drive.work_m")),
        dissipated(reals(members, "drive.energy_dissipated")) {
    if (with_energy) drawn = reals(members, "energy.drawn");
  }
  std::span<const double> q_d, q, dq, tau_m, tau_excess, work, dissipated, drawn;
};

/// The first bound that the run did not meet.
std::string violation(const services::Robot& robot, const optimisation::Bounds& b, const Verification& v, double tracking_max) {
  constexpr double kSpeedShare = 0.01,
                   kPositionShare = 0.001;  // of the bound, of the range: the twin oscillates about the plan
  for (std::size_t j = 0; j < v.tau.size(); ++j) {
    const robot::Joint& joint = robot.model.joints[j];
    const bool revolute = joint.type == robot::JointType::kRevolute;
    const char* unit = revolute ? "rad" : "m";
    const auto say = [&](const char* what, double value, double bound, const std::string& in) {
      return "joint " + joint.name + ": " + what + " " + text::to_text(value, 6) + " " + in + " in the twin, bound " +
             text::to_text(bound, 6) + " " + in;
    };
    const char* torque = revolute ? "N m" : "N";
    if (v.tau[j] > b.tau[j]) return say("motor torque", v.tau[j], b.tau[j], torque);
    if (v.dq[j] > b.dq[j] * (1 + kSpeedShare)) return say("speed", v.dq[j], b.dq[j], std::string(unit) + "/s");
    const double slack = kPositionShare * (b.q_max[j] - b.q_min[j]);
    if (v.q_max[j] > b.q_max[j] + slack) return say("position", v.q_max[j], b.q_max[j], unit);
    if (v.q_min[j] < b.q_min[j] - slack) return say("position", v.q_min[j], b.q_min[j], unit);
    if (v.tracking[j] > tracking_max) return say("tracking error", v.tracking[j], tracking_max, unit);
  }
  return "";
}

/// The controller's limits: the torque bounds of the move. Positions and speeds are judged after the run, not held by the controller.
Values limits(const optimisation::Bounds& b) {
  constexpr double kWindUp = 0.45;  // of the torque, as unit:compliance has it by default
  std::vector<double> tau, wind_up;
  for (const double bound : b.tau) {
    tau.push_back(std::isfinite(bound) ? bound : 0);
    wind_up.push_back(kWindUp * tau.back());
  }
  return {
      {"tau_max", text::joined(tau)}, {"tau_wind_up", text::joined(wind_up)}, {"q_min", "0"}, {"q_max", "0"}, {"dq_max", "0"}};
}

std::string drives_note(const services::Robot& robot, const optimisation::DriveTerms& friction, bool rigid, bool asked_rigid) {
  if (!rigid) return "the twin's drives are those of drive_train.ssv beside " + robot.urdf.filename().string();
  if (!friction.tau_C.empty())
    return "the twin has rigid joints without motor inertia, with the friction of the URDF: there is no drive_train.ssv beside "
           "it";
  return std::string("the twin has rigid joints without motor inertia and friction: ") +
         (asked_rigid ? "the request says drives = none" : "there is no drive_train.ssv beside the URDF");
}

/// Adds friction of rigid joints to the start values of the controller or of the drive.
void add_friction(Values& values, const optimisation::DriveTerms& d) {
  if (d.tau_C.empty()) return;
  values.insert(values.end(),
                {{"sigma2", text::joined(d.sigma2)}, {"tau_C", text::joined(d.tau_C)}, {"tau_S", text::joined(d.tau_C)}});
}

/// The scenario of a verification: unit:motion runs the polynomial, unit:compliance tracks it, unit:drive_train is the robot with
/// elastic joints and friction, or with rigid ones and the friction of `move.drives`, and unit:energy measures it where the robot has an
/// energy.ssv.
Scenario scenario_of(const services::Robot& robot, const RobotFolder& folder, const services::Move& move, double T,
                     const optimisation::Bounds& bounds, const services::VerificationOptions& options) {
  Scenario scenario;
  scenario.name = "verification";
  scenario.folder = folder.urdf().parent_path();
  // A move that ends in motion ends with its last whole tick.
  const double end =
      std::max(move.ends().at_rest_at_end() ? std::ceil((T + options.settle) / kTick) : std::floor(T / kTick), 1.0);
  scenario.stop = Time::from_seconds(end * kTick);
  scenario.tick = Duration::from_seconds(kTick);
  scenario.settings["robot"] = folder.urdf().string();
  const auto add = [&](const char* name, const std::string& source, const Values& values) {
    ComponentSpec component;
    component.name = name;
    component.source = source;
    component.place = scenario.name;
    component.stage = static_cast<int>(scenario.components.size());
    for (const auto& [variable, value] : values) component.start_values.push_back({variable, value, "", scenario.name});
    scenario.components.push_back(std::move(component));
  };
  const auto connect = [&](const char* from, const char* to, std::initializer_list<const char*> names) {
    for (const char* name : names)
      scenario.connections.push_back({{from, name, ""}, {to, name, ""}, 1, 0, false, scenario.name});
  };

  Values polynomial = {{"T", text::to_text(T)},
                       {"q_start", text::joined(move.from_q)},
                       {"q_end", text::joined(move.to_q)},
                       {"limits", "ignore"}};
  const optimisation::Ends ends = move.ends();
  for (const auto& [name, values] : {std::pair{"dq_start", &ends.dq_from},
                                     {"ddq_start", &ends.ddq_from},
                                     {"dq_end", &ends.dq_to},
                                     {"ddq_end", &ends.ddq_to}})
    polynomial.emplace_back(name, text::joined(*values));
  if (move.degree > 5) {
    const std::size_t coefficients = move.from_q.size() * static_cast<std::size_t>(move.degree - 5);
    polynomial.emplace_back("c_r", text::joined(move.c.empty() ? std::vector<double>(coefficients) : move.c));
  }
  add("motion", "unit:motion?kind=polynomial&degree=" + std::to_string(move.degree), polynomial);

  // The request may lift the robot's limits: no stops.
  Values controller = limits(bounds),
         drive = {{"q0", text::joined(move.from_q)}, {"dq0", text::joined(ends.dq_from)}, {"q_min", "-1e6"}, {"q_max", "1e6"}};
  std::string source = "unit:drive_train";
  if (options.rigid) {
    source += move.drives.tau_C.empty() ? "?transmission=rigid" : "?transmission=rigid&friction=smooth";
    controller.insert(controller.end(), {{"K", "0"}, {"B", "0"}});
    drive.emplace_back("B", "1e-9");  // kg m^2; the unit demands more than 0
    add_friction(controller, move.drives);
    add_friction(drive, move.drives);
  } else if (!folder.has(services::kComplianceFile)) {
    const robot::DriveParameters& d = *robot.drives;
    for (const auto& [name, values] : {std::pair{"K", &d.K}, {"B", &d.B}, {"sigma2", &d.sigma2}, {"tau_C", &d.tau_C}})
      controller.emplace_back(name, text::joined(*values));
  }
  if (move.loads.wrench) controller.insert(controller.end(), {{"S_a", "1e12"}, {"M_a", "1e9"}});
  add("compliance", "unit:compliance", controller);
  add("drive", source, drive);
  connect("motion", "compliance", {"q_d", "dq_d", "ddq_d"});
  connect("compliance", "drive", {"tau_m"});
  connect("drive", "compliance", {"q", "dq", "theta", "dtheta"});
  if (robot.energy) {
    add("energy", "unit:energy", {});
    connect("compliance", "energy", {"tau_m"});
    connect("drive", "energy", {"theta", "dtheta"});
  }
  return scenario;
}

/// Runs the initialised twin to its end.
Verification watched(Master& master, TwinLoads& loads, bool with_energy, double T,
                     const services::VerificationOptions& options) {
  Verification v;
  v.rigid = options.rigid;
  v.with_drives = with_energy;
  v.T = T;
  v.settle = options.settle;
  const Signals s(master.members(), v.with_drives);
  const std::size_t n = s.q.size();
  for (auto* x : {&v.tracking, &v.end_error, &v.tau, &v.tau_cut, &v.dq}) x->assign(n, 0);
  v.q_min.assign(s.q.begin(), s.q.end());
  v.q_max = v.q_min;
  // The work and energy of the move end at T; the tick in which it ends is divided linearly.
  const double work_0 = sum(s.work), lost_0 = sum(s.dissipated), drawn_0 = sum(s.drawn);
  double before = 0, work_before = work_0, lost_before = lost_0, drawn_before = drawn_0;
  const auto next_tick = [&] {
    if (loads.apply(master.now().seconds())) master.values_changed();
    return master.step_tick();
  };
  while (next_tick()) {
    const double now = master.now().seconds();
    for (std::size_t j = 0; j < n; ++j) {
      v.tracking[j] = std::max(v.tracking[j], std::abs(s.q[j] - s.q_d[j]));
      // The controller cuts what it asks of the motors at the bounds of the move; the excess is a second output.
      v.tau[j] = std::max(v.tau[j], std::abs(s.tau_m[j] + s.tau_excess[j]));
      v.tau_cut[j] = std::max(v.tau_cut[j], std::abs(s.tau_excess[j]));
      v.q_min[j] = std::min(v.q_min[j], s.q[j]);
      v.q_max[j] = std::max(v.q_max[j], s.q[j]);
      v.dq[j] = std::max(v.dq[j], std::abs(s.dq[j]));
    }
    if (before < T) {
      const double share = std::min(1.0, (T - before) / (now - before));
      v.work = work_before + share * (sum(s.work) - work_before) - work_0;
      v.friction = lost_before + share * (sum(s.dissipated) - lost_before) - lost_0;
      v.drawn = drawn_before + share * (sum(s.drawn) - drawn_before) - drawn_0;
    }
    before = now;
    work_before = sum(s.work);
    lost_before = sum(s.dissipated);
    drawn_before = sum(s.drawn);
  }
  for (std::size_t j = 0; j < n; ++j) v.end_error[j] = std::abs(s.q[j] - s.q_d[j]);
  master.finish();
  for (const std::string& warning : master.summary().warnings) v.notes.push_back("in the twin, " + warning);
  return v;
}

/// Adds the prediction of the rigid formula and the verdict.
void compare(const services::Robot& robot, const services::MotionCost& rigid, const services::VerificationOptions& options,
             Verification& v) {
  const std::size_t n = v.tau.size();
  v.work_rigid = rigid.energy.books.mechanical();
  v.drawn_rigid = v.with_drives ? rigid.energy.books.drawn : 0;
  for (std::size_t j = 0; j < n; ++j) {
    v.tau_rigid.push_back(std::abs(rigid.plan.solution.peaks[j * 5 + 4].value));
    v.tau_limit.push_back(rigid.plan.problem.bounds.tau[j]);
  }
  const optimisation::Solution& planned = rigid.plan.solution;
  v.reason = planned.status == optimisation::Status::kFeasible
                 ? violation(robot, rigid.plan.problem.bounds, v, options.tracking_max)
                 : planned.reason;
  v.feasible = v.reason.empty();
}

}  // namespace

Verification verify(std::span<const UnitType> types, const std::vector<fs::path>& folders, const services::Robot& robot,
                    const services::Move& move, double T, const services::VerificationOptions& wanted) {
  if (!(T > 0 && T <= kLongest))
    throw Error("verify",
                "a move of " + text::to_text(T) + " s, expected at most " + text::to_text(kLongest) + " s for a co-simulation");
  services::VerificationOptions options = wanted;
  if (!move.ends().at_rest_at_end()) options.settle = 0;
  options.rigid = wanted.rigid || !robot.drives;
  const RobotFolder folder(robot, options.rigid);
  services::Move timed = move;
  timed.T = T;
  timed.drives = wanted.rigid ? optimisation::DriveTerms{} : services::drive_terms(robot);
  const services::MotionCost rigid = services::energy_of(robot, timed);
  const optimisation::Bounds& bounds = rigid.plan.problem.bounds;

  MasterOptions run;
  run.types = types;
  run.folders = folders;
  run.threads = 1;
  try {
    Master master(scenario_of(robot, folder, timed, T, bounds, options), std::move(run));
    TwinLoads loads(master.members(), robot.model, timed);
    master.initialise();
    Verification v = watched(master, loads, robot.energy.has_value(), T, options);
    v.notes.insert(v.notes.begin(), drives_note(robot, timed.drives, options.rigid, wanted.rigid));
    if (timed.loads.wrench) v.notes.emplace_back("the controller of the twin knows the wrench, and does not yield to it");
    compare(robot, rigid, options, v);
    return v;
  } catch (const Error& e) {
    throw Error(folder.in_own_folder(e.what()));
  }
}

}  // namespace cotwin::master
