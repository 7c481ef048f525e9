#include "master/services/verify.h"

#include <algorithm>
#include <cmath>
#include <numeric>

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

std::string list(const std::vector<double>& values) {
  std::string all;
  for (const double x : values) all += (all.empty() ? "" : " ") + text::to_text(x);
  return all;
}

std::string escaped(const std::string& text) {
  std::string all;
  for (const char c : text)
    all += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : c == '"' ? "&quot;" : std::string(1, c);
  return all;
}

std::string parameter(const std::string& name, const std::string& value) {
  return "<ssv:Parameter name=\"" + name + "\"><ssv:String value=\"" + value + "\"/></ssv:Parameter>";
}

std::string component(const std::string& name, const std::string& source, const std::string& parameters) {
  std::string xml =
      "<ssd:Component name=\"" + name + "\" source=\"" + escaped(source) + "\" type=\"application/x-cotwin-unit\">";
  if (!parameters.empty())
    xml +=
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version=\"1.0\" "
        "name=\"values\"><ssv:Parameters>" +
        parameters +
        "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>";
  return xml + "</ssd:Component>\n";
}

std::string connection(const std::string& from, const std::string& to, const std::string& variable) {
  return "<ssd:Connection startElement=\"" + from + "\" startConnector=\"" + variable + "\" endElement=\"" + to +
         "\" endConnector=\"" + variable + "\"/>\n";
}

std::span<const double> reals(std::span<const Member> members, const std::string& name) {
  const Signal signal = find_signal(members, name, "verification");
  return signal.variable->reals().subspan(signal.first, signal.count);
}

double sum(std::span<const double> x) { return std::accumulate(x.begin(), x.end(), 0.0); }

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
std::string limits(const optimisation::Bounds& b) {
  constexpr double kWindUp = 0.45;  // of the torque, as unit:compliance has it by default
  std::vector<double> tau, wind_up;
  for (const double bound : b.tau) {
    tau.push_back(std::isfinite(bound) ? bound : 0);
    wind_up.push_back(kWindUp * tau.back());
  }
  return parameter("tau_max", list(tau)) + parameter("tau_wind_up", list(wind_up)) + parameter("q_min", "0") +
         parameter("q_max", "0") + parameter("dq_max", "0");
}

std::string drives_note(const services::Robot& robot, const optimisation::DriveTerms& friction, bool rigid, bool asked_rigid) {
  if (!rigid) return "the twin's drives are those of drive_train.ssv beside " + robot.urdf.filename().string();
  if (!friction.tau_C.empty())
    return "the twin has rigid joints without motor inertia, with the friction of the URDF: there is no drive_train.ssv beside "
           "it";
  return std::string("the twin has rigid joints without motor inertia and friction: ") +
         (asked_rigid ? "the request says drives = none" : "there is no drive_train.ssv beside the URDF");
}

/// Friction of rigid joints, as parameters of the controller and of the drive.
std::string friction_of(const optimisation::DriveTerms& d) {
  return d.tau_C.empty()
             ? ""
             : parameter("sigma2", list(d.sigma2)) + parameter("tau_C", list(d.tau_C)) + parameter("tau_S", list(d.tau_C));
}

/// The scenario of a verification as SSD text: unit:motion runs the polynomial, unit:compliance tracks it, unit:drive_train is the
/// robot with elastic joints and friction, or with rigid ones and the friction of `move.drives`, and unit:energy measures it where the
/// robot has an energy.ssv.
std::string scenario_of(const services::Robot& robot, const RobotFolder& folder, const services::Move& move, double T,
                        const optimisation::Bounds& bounds, const services::VerificationOptions& options) {
  std::string polynomial = parameter("T", text::to_text(T)) + parameter("q_start", list(move.from_q)) +
                           parameter("q_end", list(move.to_q)) + parameter("limits", "ignore");
  if (move.degree > 5)
    polynomial += parameter(
        "c_r",
        list(move.c.empty() ? std::vector<double>(move.from_q.size() * static_cast<std::size_t>(move.degree - 5)) : move.c));
  std::string controller = limits(bounds), drive = parameter("q0", list(move.from_q));
  if (options.rigid) {
    controller += parameter("K", "0") + parameter("B", "0") + friction_of(move.drives);
    drive += parameter("B", "1e-9") + friction_of(move.drives);  // kg m^2; the unit demands more than 0
  } else if (!folder.has("compliance.ssv")) {
    const robot::DriveParameters& d = *robot.drives;
    for (const auto& [name, values] : {std::pair{"K", &d.K}, {"B", &d.B}, {"sigma2", &d.sigma2}, {"tau_C", &d.tau_C}})
      controller += parameter(name, list(*values));
  }
  const bool energy = robot.energy.has_value();
  const double stop = std::ceil((T + options.settle) / kTick) * kTick;
  std::string xml =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<ssd:SystemStructureDescription version=\"1.0\" name=\"verification\" "
      "xmlns:ssd=\"http://ssp-standard.org/SSP1/SystemStructureDescription\" "
      "xmlns:ssc=\"http://ssp-standard.org/SSP1/SystemStructureCommon\" "
      "xmlns:ssv=\"http://ssp-standard.org/SSP1/SystemStructureParameterValues\"><ssd:System "
      "name=\"verification\"><ssd:Elements>\n";
  xml += component("motion", "unit:motion?kind=polynomial&degree=" + std::to_string(move.degree), polynomial);
  xml += component("compliance", "unit:compliance", controller);
  const bool smooth = options.rigid && !move.drives.tau_C.empty();
  xml += component("drive",
                   smooth          ? "unit:drive_train?transmission=rigid&friction=smooth"
                   : options.rigid ? "unit:drive_train?transmission=rigid"
                                   : "unit:drive_train",
                   drive);
  if (energy) xml += component("energy", "unit:energy", "");
  xml += "</ssd:Elements><ssd:Connections>\n";
  for (const char* name : {"q_d", "dq_d", "ddq_d"}) xml += connection("motion", "compliance", name);
  xml += connection("compliance", "drive", "tau_m");
  for (const char* name : {"q", "dq", "theta", "dtheta"}) xml += connection("drive", "compliance", name);
  if (energy) {
    xml += connection("compliance", "energy", "tau_m");
    for (const char* name : {"theta", "dtheta"}) xml += connection("drive", "energy", name);
  }
  xml += "</ssd:Connections></ssd:System><ssd:DefaultExperiment startTime=\"0\" stopTime=\"" + text::to_text(stop) +
         "\"/><ssd:Annotations><ssc:Annotation type=\"cotwin.master\"><cotwin:Master xmlns:cotwin=\"urn:cotwin:master:1\" "
         "tick=\"1 ms\"><cotwin:Setting name=\"robot\" value=\"" +
         escaped(folder.urdf().string()) + "\"/>";
  int stage = 0;
  for (const char* name : {"motion", "compliance", "drive", "energy"})
    if (energy || std::string_view(name) != "energy")
      xml += "<cotwin:Component name=\"" + std::string(name) + "\" stage=\"" + std::to_string(stage++) + "\"/>";
  return xml + "</cotwin:Master></ssc:Annotation></ssd:Annotations></ssd:SystemStructureDescription>\n";
}

/// Runs the initialised twin to its end.
Verification watched(Master& master, bool with_energy, double T, const services::VerificationOptions& options) {
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
  while (master.step_tick()) {
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
    Master master(
        parse_scenario(scenario_of(robot, folder, timed, T, bounds, options), "verification", folder.urdf().parent_path()),
        std::move(run));
    master.initialise();
    Verification v = watched(master, robot.energy.has_value(), T, options);
    v.notes.insert(v.notes.begin(), drives_note(robot, timed.drives, options.rigid, wanted.rigid));
    compare(robot, rigid, options, v);
    return v;
  } catch (const Error& e) {
    throw Error(folder.in_own_folder(e.what()));
  }
}

}  // namespace cotwin::master
