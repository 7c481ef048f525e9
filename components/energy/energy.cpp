#include "components/energy/energy.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>

#include "models/foundation/support/assumed.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"

namespace cotwin::energy {
namespace {

using energetics::Bus;
using energetics::kNode;
using energetics::kNodes;

constexpr double kJoulePerKilowattHour = 3.6e6;
/// Share of the work from which a difference between work_m and the joints' work is told: inputs of another step or unit.
constexpr double kWrongWork = 0.01;
constexpr double kLittleWork = 1;  // J
constexpr std::size_t kLongestWarning = 400;

double sum(const std::vector<double>& x) { return std::accumulate(x.begin(), x.end(), 0.0); }

}  // namespace

void Energy::declare_settings(SettingList& s) {
  s.set_first_variables(
      {"tau_m", "theta", "dtheta", "drawn", "power", "supplied", "returned", "chopped", "peak_power", "cost"});
  s.robot(
      "the robot with the drives: joints without a motor draw nothing, and a file energy.ssv beside it has its values; a name "
      "in "
      "models/robots or a path to a URDF file; none: the setting joints");
  s.integer("joints", 1, 1, 1000, "number of joints where there is no robot");
  s.choice(
      "bus", {"shared", "none", "grid"},
      "supply of the drives: one DC link with capacitor, rectifier and chopper; none: a rectifier and brake resistor for each; "
      "grid: one link whose front end feeds back");
  s.boolean("measured", false, "losses from measured currents, the input i, in place of tau_m / k_t");
  s.boolean("books", false, "further inputs from the drive train close the balance of the whole robot: friction and residual");
}

Energy::Energy(Settings& settings)
    : Energy(settings, [&]() -> const robot::RobotModel* {
        if (settings.text("robot").empty()) return nullptr;
        settings.robot(Settings::Masses::kUnused);
        return settings.robot_used().get();
      }()) {}

Energy::Energy(Settings& settings, const robot::RobotModel* robot)
    : place_(settings.unit()),
      measures_(robot),
      n_(robot != nullptr ? static_cast<std::size_t>(robot->n()) : static_cast<std::size_t>(settings.integer("joints"))),
      measured_(settings.boolean("measured")),
      with_books_(settings.boolean("books")),
      passive_(n_),
      accountant_(n_, text::choose<Bus>(place_ + ".bus", settings.choice("bus"),
                                        {{"none", Bus::kSeparate}, {"shared", Bus::kShared}, {"grid", Bus::kGrid}})),
      books_(n_) {
  if (n_ == 0) throw Error(place_, "robot '" + robot->name + "' has no movable joint, expected at least one");
  for (Joints* joints : {&tau_m_, &dtau_m_, &theta_, &dtheta_, &i_, &tau_before_, &theta_before_, &dtheta_before_, &i_before_})
    joints->resize(n_);
  for (std::size_t j = 0; j < n_ && robot != nullptr; ++j) passive_[j] = robot->joints[j].passive;
}

void Energy::declare(Variables& v) {
  JointVariables joints(v, measures_);
  joints.input("tau_m", tau_m_, "N.m", "motor torque that acts over the step, that of the drive train")
      .rate(dtau_m_)
      .essential();
  joints.input("theta", theta_, "rad", "motor position behind the gear at the step's end").essential();
  joints.input("dtheta", dtheta_, "rad/s", "motor speed behind the gear at the step's end").essential();
  if (measured_) v.input("i", i_, "A", "measured current of each motor at the step's end").essential();
  if (with_books_) {
    const auto input = [&](const char* name, double& storage, const char* what) {
      v.input(name, storage, "J", what).essential();
    };
    input("work_m", drive_.work_m, "drive train: work of tau_m");
    input("work_e", drive_.work_e, "drive train: work of tau_e");
    input("work_0", drive_.work_0, "drive train: taken up by constant parts of friction");
    input("energy_kinetic", drive_.kinetic, "drive train: kinetic energy");
    input("energy_potential", drive_.potential, "drive train: potential energy");
    input("energy_elastic", drive_.elastic, "drive train: elastic energy");
    input("energy_dissipated", drive_.dissipated, "drive train: energy lost in friction, damping and stops");
    v.input("energy_bodies", drive_.bodies, "J", "drive train: energy that changes of the bodies brought");
  }
  declare_drives(v, joints);

  v.output("drawn", books_.drawn, "J", "from the mains since the start, less what was fed back");
  v.output("work_positive", books_.mechanical_positive, "J", "per joint: work of the motor while it drives");
  v.output("work_negative", books_.mechanical_negative, "J", "per joint: work of the motor while it brakes, negative");
  v.output("copper", books_.copper, "J", "per joint: losses of the windings");
  v.output("converter", books_.converter, "J", "per joint: losses of the converter, V_0 |i|");
  v.output("iron", books_.iron, "J", "per joint: losses k_h |dtheta| + k_e dtheta^2");
  v.output("idle", books_.idle, "J", "stand-by, brakes");
  v.output("regenerable", books_.regenerable, "J", "what all drives together gave back, before the stand-by took of it");
  v.output("supplied", books_.link.supplied, "J", "from the supply into the DC link");
  v.output("returned", books_.link.returned, "J", "from the DC link into the supply");
  v.output("chopped", books_.link.chopped, "J", "burnt in brake resistors");
  v.output("stored", books_.stored, "J", "rise of the capacitor's energy since the start");
  v.output("supply_losses", books_.supply_losses, "J", "between mains and DC link");
  v.output("controller_energy", books_.controller, "J", "of the controller");
  v.output("cost", cost_, "1", "of what was drawn, in the currency of price_per_kWh");
  v.output("co2", co2_, "kg", "of what was drawn");
  v.output("V", V_, "V", "voltage of the DC link");
  v.output("power", power_, "W", "drawn from the mains, mean of the last step");
  v.output("peak_power", books_.peak_power, "W", "largest power that drives and stand-by took since the start");
  v.output("servo", servo_, "1: the motors are on; 0: the brakes hold the robot");
  v.output("warning", warning_, "what the user should know after the run; empty if nothing");
  if (with_books_) {
    v.output("friction", friction_, "J", "lost in friction, damping and stops of the drive train, with its constant parts");
    v.output(
        "residual", residual_, "J",
        "drawn less all of the above and the rise of kinetic, potential and elastic energy, plus work_e: error of the drive "
        "train's solver");
  }

  joints.state("tau_before", tau_before_, "N.m", "tau_m at the end of the last step");
  joints.state("theta_before", theta_before_, "rad", "theta at the end of the last step");
  joints.state("dtheta_before", dtheta_before_, "rad/s", "dtheta at the end of the last step");
  if (measured_) v.state("i_before", i_before_, "A", "i at the end of the last step");
  v.state("elapsed", books_.time, "s", "time since the start");
  v.state("rest", rest_, "s", "time at rest so far");
  v.state("opening", opening_, "s", "of the brakes' opening that is still to be booked");
  v.state("opening_power", opening_power_, "W", "what the opening takes beyond P_off");
  v.state("unexplained", unexplained_, "J", "sum of the magnitudes of work_m less the joints' work, per step");
  v.state("moved", moved_, "J", "sum of the magnitudes of the joints' work, per step");
  v.state("warned", warned_, "1 once a wrong work was told");
  if (!with_books_) return;
  v.state("work_m_before", drive_before_.work_m, "J", "work_m at the end of the last step");
  const auto start = [&](const char* name, double& storage) { v.state(name, storage, "J", "at the start"); };
  start("work_m_start", drive_start_.work_m);
  start("work_e_start", drive_start_.work_e);
  start("work_0_start", drive_start_.work_0);
  start("kinetic_start", drive_start_.kinetic);
  start("potential_start", drive_start_.potential);
  start("elastic_start", drive_start_.elastic);
  start("dissipated_start", drive_start_.dissipated);
  start("bodies_start", drive_start_.bodies);
}

void Energy::declare_drives(Variables& v, JointVariables& joints) {
  constexpr double most = 1e12;
  v.parameter("current", current_,
              "what a current is: rms value of a phase, its amplitude (peak, q axis), or dc: of a DC motor");
  for (const auto& row : energetics::kDriveLosses) joints.parameter(accountant_.losses, row);
  v.tunable("P_0", standby_.P_0, "W", "taken from the DC link with the servo on, without the brakes' coils").range(0, most);
  v.tunable("P_off", standby_.P_off, "W", "taken from the DC link with the servo off").range(0, most);
  v.tunable("P_brake", standby_.P_brake, "W", "of the coils that hold the brakes open").range(0, most);
  v.tunable("E_release", standby_.E_release, "J", "to open the brakes, beyond P_brake").range(0, most);
  v.tunable("t_close", standby_.t_close, "s", "that the motors still hold while the brakes close").range(0, most);
  v.tunable("t_release", standby_.t_release, "s", "that the motors hold before a motion while the brakes open").range(0, most);
  v.tunable("servo_off_after", servo_off_after_, "s", "time at rest after which the brakes close; 0: never").range(0, most);
  v.parameter("rest_speed", rest_speed_, "rad/s", "largest speed of a joint at rest").range(0, most);
  v.tunable("controller", standby_.controller, "W", "of the controller's computer and fans, from the mains").range(0, most);
  v.parameter("C", accountant_.link.C, "F", "bus=shared: capacitor of the DC link").range(0, most);
  v.parameter("V_min", accountant_.link.V_min, "V", "bus=shared: voltage that the rectifier holds at least").range(1e-9, most);
  v.parameter("V_max", accountant_.link.V_max, "V", "bus=shared: voltage above which the chopper burns").range(1e-9, most);
  v.parameter("V_start", V_start_, "V", "bus=shared: voltage at the start; 0: V_min").range(0, most);
  v.parameter("efficiency", accountant_.supply.efficiency, "1", "of the supply from the mains to the DC link").range(1e-9, 1);
  v.parameter("eta_r", accountant_.supply.eta_r, "1", "bus=grid: share of what is fed back that reaches the mains").range(0, 1);
  v.tunable("price_per_kWh", accountant_.supply.price_per_kWh, "1", "price of a kilowatt hour, in any currency");
  v.tunable("co2_per_kWh", accountant_.supply.co2_per_kWh, "kg", "CO2 of a kilowatt hour");
  v.parameter("input_order", input_order_,
              "0: tau_m is held over a step; 1: it is a ramp from its last value, as in the drive train")
      .range(0, 1);
  v.parameter("sources", sources_, "where the values of the parameters come from");
  v.parameter("assumed", assumed_, "names of parameters that are assumptions, not measurements; all; or none");
}

void Energy::check() const {
  const auto finite = [this](const char* name, std::span<const double> values) {
    for (std::size_t k = 0; k < values.size(); ++k) {
      if (std::isfinite(values[k])) continue;
      throw Error(place_ + "." + name + "[" + std::to_string(k + 1) + "]",
                  "is " + text::to_text(values[k]) + ", expected a finite value");
    }
  };
  finite("tau_m", tau_m_);
  finite("tau_m (rate)", dtau_m_);
  finite("theta", theta_);
  finite("dtheta", dtheta_);
  finite("i", i_);
  const double books[] = {drive_.work_m,    drive_.work_e,  drive_.work_0,     drive_.kinetic,
                          drive_.potential, drive_.elastic, drive_.dissipated, drive_.bodies};
  finite("energies of the drive train", books);
  const auto& s = standby_;
  for (const auto& [name, value] : {std::pair{"P_0", s.P_0},
                                    {"P_off", s.P_off},
                                    {"P_brake", s.P_brake},
                                    {"E_release", s.E_release},
                                    {"t_close", s.t_close},
                                    {"t_release", s.t_release},
                                    {"controller", s.controller},
                                    {"servo_off_after", servo_off_after_}}) {
    if (value >= 0 && std::isfinite(value)) continue;
    throw Error(place_ + "." + name, "is " + text::to_text(value) + ", expected a finite value >= 0");
  }
  for (const auto& [name, value] :
       {std::pair{"price_per_kWh", accountant_.supply.price_per_kWh}, {"co2_per_kWh", accountant_.supply.co2_per_kWh}}) {
    if (!std::isfinite(value)) throw Error(place_ + "." + name, "is " + text::to_text(value) + ", expected a finite value");
  }
}

void Energy::initialise(Time) {
  check();
  check_assumed(place_ + ".assumed", assumed_, energetics::kMayBeAssumed);
  accountant_.check(place_);
  adopt_drives();
  books_.clear();
  V_ = V_start_ > 0 ? std::clamp(V_start_, accountant_.link.V_min, accountant_.link.V_max) : accountant_.link.V_min;
  tau_before_ = tau_m_;
  theta_before_ = theta_;
  dtheta_before_ = dtheta_;
  i_before_ = i_;
  drive_before_ = drive_start_ = drive_;
  rest_ = opening_ = opening_power_ = unexplained_ = moved_ = power_ = cost_ = co2_ = friction_ = residual_ = 0;
  servo_ = 1;
  warned_ = 0;
  warning_.clear();
  warning_.reserve(assumed_.size() + kLongestWarning);  // a step allocates nothing
  write_warning();
}

void Energy::write_nodes(double h) {
  for (std::size_t j = 0; j < n_; ++j) {
    const double tau0 = passive_[j] ? 0 : input_order_ == 1 ? tau_before_[j] : tau_m_[j];
    const double tau1 = passive_[j] ? 0 : input_order_ == 1 ? tau_m_[j] : tau_m_[j] + h * dtau_m_[j];
    // Speed of Hermite's cubic through θ and θ̇ at both ends.
    const double v0 = dtheta_before_[j], v1 = dtheta_[j], mean = (theta_[j] - theta_before_[j]) / h;
    for (std::size_t k = 0; k < kNodes; ++k) {
      const double s = kNode[k];
      accountant_.tau[k * n_ + j] = tau0 + s * (tau1 - tau0);
      accountant_.speed[k * n_ + j] = passive_[j] ? 0 : v0 + s * (6 * mean - 4 * v0 - 2 * v1 + s * (3 * (v0 + v1) - 6 * mean));
      if (measured_) accountant_.i[k * n_ + j] = passive_[j] ? 0 : i_before_[j] + s * (i_[j] - i_before_[j]);
    }
  }
  if (!measured_) accountant_.currents_from_torques();
}

/// Mean power of stand-by and brakes over the step, after the rule of the servo.
double Energy::idle_power(double h) {
  bool rests = true;
  for (std::size_t j = 0; j < n_; ++j)
    rests = rests && std::abs(dtheta_[j]) <= rest_speed_ && std::abs(dtheta_before_[j]) <= rest_speed_;
  const double on = standby_.P_0 + standby_.P_brake;
  double released = 0;
  if (!rests) {
    if (servo_ == 0) {
      released = standby_.E_release / h;
      opening_ = std::clamp(rest_ - servo_off_after_ - standby_.t_close, 0.0, standby_.t_release);
      opening_power_ = on - standby_.P_off + accountant_.holding_power(tau_before_);
    }
    servo_ = 1;
    rest_ = 0;
  } else {
    if (servo_off_after_ > 0 && rest_ >= servo_off_after_ + standby_.t_close) servo_ = 0;
    rest_ += h;
  }
  if (servo_ == 0) return standby_.P_off;
  const double opened = std::min(h, opening_);
  opening_ -= opened;
  return on + released + opening_power_ * opened / h;
}

// A step:
//   1. torques, speeds and currents at the nodes of the step
//   2. stand-by and servo
//   3. the books
//   4. outputs, and the inputs for the next step
StepResult Energy::step(Time, Duration duration) {
  check();
  const double h = duration.seconds(), drawn_before = books_.drawn;
  write_nodes(h);
  double work = 0;
  for (std::size_t k = 0; k < kNodes; ++k)
    for (std::size_t j = 0; j < n_; ++j)
      work += h * energetics::kWeight[k] * accountant_.tau[k * n_ + j] * accountant_.speed[k * n_ + j];
  const double extra = with_books_ ? drive_.work_m - drive_before_.work_m - work : 0;
  const double idle = idle_power(h);
  accountant_.add(h, servo_ == 1, idle, extra, standby_.controller, V_, books_);
  moved_ += std::abs(work);
  unexplained_ += std::abs(extra);
  write_outputs(h, drawn_before);
  if (warned_ == 0 && unexplained_ > kWrongWork * moved_ + kLittleWork) {
    warned_ = 1;
    write_warning();
  }
  std::ranges::copy(tau_m_, tau_before_.begin());
  std::ranges::copy(theta_, theta_before_.begin());
  std::ranges::copy(dtheta_, dtheta_before_.begin());
  std::ranges::copy(i_, i_before_.begin());
  drive_before_ = drive_;
  return StepResult::kDone;
}

void Energy::write_outputs(double h, double drawn_before) {
  const double drawn = books_.drawn - drawn_before;
  power_ = drawn / h;
  cost_ += drawn / kJoulePerKilowattHour * accountant_.supply.price_per_kWh;
  co2_ += drawn / kJoulePerKilowattHour * accountant_.supply.co2_per_kWh;
  if (!with_books_) return;
  const DriveBooks &end = drive_, &start = drive_start_;
  friction_ = end.dissipated - start.dissipated + end.work_0 - start.work_0;
  const double others = end.inner() - start.inner() + friction_ - (end.work_e - start.work_e) - (end.bodies - start.bodies);
  residual_ = books_.residual() + books_.mechanical() - others;
}

void Energy::write_warning() {
  warning_.clear();
  if (assumed_ != "none" && !assumed_.empty()) {
    warning_ += assumed_ == "all" ? "the energies are those of an assumed drive: all its parameters"
                                  : "the energies rest on assumed values of ";
    if (assumed_ != "all") warning_ += assumed_;
    warning_ += " (parameter assumed)";
  }
  if (warned_ == 0) return;
  if (!warning_.empty()) warning_ += "; ";
  warning_ += "work_m differs from the work of tau_m and theta: expected the inputs of one drive train and one step";
}

void Energy::adopt_drives() {
  accountant_.current = energetics::parse_current(place_ + ".current", current_);
  accountant_.adopt();
}

void Energy::restored() {
  adopt_drives();
  write_warning();
}

void Energy::append_notes(std::vector<std::string>& sentences) const {
  const auto joule = [](double e) { return text::to_text(e, 5) + " J"; };
  sentences.push_back("drew " + joule(books_.drawn) + " from the mains in " + text::to_text(books_.time, 6) + " s: motors " +
                      joule(books_.mechanical()) + ", copper " + joule(sum(books_.copper)) + ", converters and iron " +
                      joule(sum(books_.converter) + sum(books_.iron)) + ", stand-by " + joule(books_.idle + books_.controller) +
                      ", brake resistors " + joule(books_.link.chopped) + ", supply " + joule(books_.supply_losses) +
                      ", stored " + joule(books_.stored) + "; peak " + text::to_text(books_.peak_power, 5) + " W");
}

}  // namespace cotwin::energy
