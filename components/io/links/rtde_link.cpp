#include "components/io/links/rtde_link.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string_view>
#include <utility>

#include "components/io/link/datagram_queue.h"
#include "components/io/link/fri_values.h"
#include "components/io/rtde/pose.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

const std::string kRtdePlace = "unit:io?link=rtde";
constexpr const char* kControllerSilent =
    "the robot was silent for longer than timeout: its last positions were held and its external torques set to 0";
constexpr const char* kOtherRobot =
    "the robot's pose does not fit to the URDF (another robot, or another base frame than Base): tau_e is not given";
constexpr const char* kNotCommanded = "after a loss, a restart or a jump nothing was commanded until acknowledge rose";
constexpr const char* kTargetsRefused =
    "q_command or double_command was not finite, or q_command larger than 1e9: the last usable values were sent";

constexpr std::string_view kStates[] = {"robot_mode", "safety_mode", "runtime_state", "output_int_register_25"};
constexpr std::string_view kBits[] = {"actual_digital_input_bits", "actual_digital_output_bits"};

bool is_usable(std::span<const double> values) {
  return std::ranges::all_of(values, [](double x) { return std::abs(x) <= rtde::kLargestNumber; });
}

void count(std::int32_t& number, std::uint64_t more = 1) { number = saturated(static_cast<std::uint64_t>(number) + more); }

}  // namespace

RtdeLink::RtdeLink(Settings& settings, const std::vector<trajectory::Axis>& joints)
    : n_(joints.size()),
      synchronisation_(n_),
      belief_(joints),
      tau_(joints),
      F_(settings.robot_used() != nullptr ? joints : trajectory::free_axes(rtde::kJoints), 6),
      speeds_(joints),
      set_point_(joints),
      dq_command_max_(n_, kSafeSpeed),
      torque_per_current_(n_),
      K_P_(n_),
      K_D_(n_),
      q_robot_(n_),
      q_sent_(n_),
      e_(n_),
      current_(n_),
      q_wanted_(n_),
      q_target_(n_) {
  if (n_ != rtde::kJoints) throw Error(kRtdePlace, std::to_string(n_) + " joints, expected 6, as RTDE has them");
  for (std::size_t i = 0; i < n_; ++i) {
    if (joints[i].dq_max > 0) dq_command_max_[i] = std::min(kSafeSpeed, joints[i].dq_max);
  }
  if (settings.robot_used() != nullptr) kinematics_.emplace(*settings.robot_used());
  const rtde::Directory directory;
  std::vector<BelievedNumbers::Kind> kinds(directory.slots(), BelievedNumbers::Kind::kNumber);
  for (const std::string_view state : kStates) kinds[directory.slot(state)] = BelievedNumbers::Kind::kState;
  for (const std::string_view bits : kBits) kinds[directory.slot(bits)] = BelievedNumbers::Kind::kBits;
  for (const BelievedNumbers::Kind kind : kinds) numbers_.add(kind);
  for (const rtde::Wanted& output : client_settings().outputs) {
    const rtde::Field& field = *directory.find(output.name);
    for (std::size_t i = 0; i < rtde::values_of(field.type); ++i) slots_.push_back(field.slot + i);
  }
}

Link::Needs RtdeLink::needs() const { return {mode_ != "monitor", false}; }

void RtdeLink::choose_mode() {
  enum class Mode : std::uint8_t { kMonitor, kPosition };
  commands_ = text::choose<Mode>(kRtdePlace + ": mode", mode_, {{"monitor", Mode::kMonitor}, {"position", Mode::kPosition}}) ==
              Mode::kPosition;
  if (!commands_ && (registers_ || digital_mask_ != 0)) {
    throw Error(kRtdePlace + ": mode", std::string("'monitor', which writes nothing, with ") +
                                           (registers_ ? "registers=true" : "a digital_mask") + ", expected mode=position");
  }
}

/// s without data for which the robot counts as connected.
double RtdeLink::patience() const { return std::max(timeout_, 20 / frequency_); }

rtde::ClientSettings RtdeLink::client_settings() const {
  rtde::ClientSettings s;
  s.frequency = frequency_;
  for (const char* name : {"timestamp", "actual_q", "actual_qd", "target_q"}) s.outputs.push_back({name, true});
  for (const char* name :
       {"actual_current", "actual_current_as_torque", "actual_TCP_pose", "actual_TCP_force", "tcp_offset", "robot_mode",
        "safety_mode", "runtime_state", "speed_scaling", "actual_digital_input_bits", "actual_digital_output_bits"}) {
    s.outputs.push_back({name, false});
  }
  for (std::size_t i = 0; i < kRegisters; ++i) {
    const std::string number = std::to_string(rtde::kFirstRegister + static_cast<int>(i));
    s.outputs.push_back({"output_double_register_" + number, false});
    s.outputs.push_back({"output_int_register_" + number, false});
    if (registers_ || (commands_ && i < rtde::kJoints)) s.inputs.push_back({"input_double_register_" + number});
    if (registers_ || (commands_ && i < 2)) s.inputs.push_back({"input_int_register_" + number});
  }
  if (digital_mask_ != 0) {
    s.inputs.push_back({"standard_digital_output_mask", true});
    s.inputs.push_back({"standard_digital_output", true});
  }
  return s;
}

void RtdeLink::initialise(Time start, Measured& measured) {
  measured.warning.reserve(512);
  for (std::vector<double>* values :
       {&measured.q, &measured.dq, &measured.ddq, &measured.tau, &measured.tau_e, &q_robot_, &q_sent_, &e_, &current_}) {
    std::ranges::fill(*values, 0);
  }
  measured.has_tau = measured.has_tau_e = measured.fresh = measured.done = false;
  connected_ = commanding_ = following_ = was_connected_ = false;
  state_ = robot_mode_ = safety_ = runtime_ = digital_in_ = digital_out_ = 0;
  received_ = skipped_ = rejected_ = sent_ = unsent_ = refused_ = losses_ = connections_ = 0;
  t_robot_ = speed_scaling_ = jitter_ = round_trip_ = lost_time_ = elapsed_ = 0;
  F_e_ = {};
  p_ = {};
  quat_ = {1, 0, 0, 0};
  version_ = {};
  t_sent_ = t_commanded_ = -1;
  set_ups_ = 0;
  registers_sent_ = {};
  registers_int_sent_ = {};
  has_wanted_ = false;
  synchronisation_.start(q_robot_);
  heard_ = start.ns;
  arrived_ = trips_ = 0;
  counter_ = reflected_ = 0;
  sent_at_ = {};
  const net::Endpoint controller = net::endpoint_of(controller_, rtde::kPort, kRtdePlace + ": controller");
  choose_mode();
  acknowledgement_.begin(kRtdePlace);
  belief_.begin();
  period_ = 0;
  forget();
  constexpr double kDelay = 2;  // cycles: the package, and the command
  if (commands_) gains_.check(K_P_, K_D_, std::array{1 / frequency_}, kDelay, kRtdePlace);
  constexpr double kLeastSilence = 2;  // s
  line_.open(controller, client_settings(), Duration::from_seconds(std::max(kLeastSilence, patience())).ns, kRtdePlace);
  if (wait_ <= 0) return;
  waiting_ = true;
  const std::int64_t deadline = monotonic_now() + Duration::from_seconds(wait_).ns;
  while (!read_all(start, measured)) {
    if (line_.wait(deadline) || monotonic_now() < deadline) continue;
    std::string why = line_.reason();
    if (!line_.culprit().empty()) why += " " + std::string(line_.culprit());
    throw Error("unit:io.wait", "no data of a robot came from " + net::to_text(controller) + " within " + text::to_text(wait_) +
                                    " s (" + why + "), expected a controller with RTDE");
  }
  waiting_ = false;
  write_outputs();
}

StepResult RtdeLink::step(Time now, Duration h, const Command& command, Measured& measured) {
  measured.fresh = false;
  if (period_ <= 0) period_ = std::max(1 / frequency_, h.seconds());
  acknowledgement_.decide(connected_ && robot_ready(), !belief_.is_held() && agrees(), h.seconds());
  if (read_all(now, measured)) {
    if (commands_) send(command, measured);
    line_.serve();
  }
  const bool silent = static_cast<double>(now.ns - heard_) > patience() * 1e9;
  if (connected_ && (!line_.client().running() || silent)) note_loss(measured);
  if (acknowledgement_.awaits()) measured.warn(kNotCommanded);
  write_outputs();
  if (was_connected_ && !connected_) lost_time_ += h.seconds();
  return StepResult::kDone;
}

/// Whether there are new data. Several packages are read in their order; the newest ones are measured last.
bool RtdeLink::read_all(Time now, Measured& measured) {
  // A bound, so that a robot that sends without end does not hold the scenario up.
  for (int pieces = 0; pieces < 64; ++pieces) {
    const bool more = line_.serve();
    bool read = false;
    while (line_.client().read(monotonic_now())) {
      read = true;
      // The clock may have waited until a new connection had data.
      if (line_.set_ups() != set_ups_) {
        if (connected_) note_loss(measured);
        registers_sent_ = {};
        registers_int_sent_ = {};
      }
      set_ups_ = line_.set_ups();
      measure(measured, now);
    }
    if (!more && !read) break;
  }
  return measured.fresh;
}

/// What follows is of another session.
void RtdeLink::forget() {
  belief_.forget();
  tau_.forget();
  F_.forget();
  speeds_.forget();
  set_point_.forget();
  numbers_.forget();
  follows_ = {};
  t_waiting_ = t_offered_ = -1;
  misfits_ = 0;
}

/// Whether the newest package is further ahead of the last one than time has passed, so that the next one has to go on from there. The robot may
/// have left out packages; or the time stamp is damaged.
bool RtdeLink::waits(double t, std::int64_t host, Time now) {
  const double cycle = 1.5 / frequency_, since = t - t_robot_;
  const double passed =
      static_cast<double>(std::max(host - arrived_, now.ns - heard_)) / 1e9;  // scenarios without a clock may be faster
  const bool ahead = connected_ && since > cycle && since > passed + cycle && since <= passed + patience();
  const bool follows = t_waiting_ >= 0 && t > t_waiting_ && t - t_waiting_ <= passed + cycle;
  if (t_waiting_ >= 0 && !(ahead && follows)) belief_.count_implausible("its time is ahead");
  t_waiting_ = ahead && !follows ? t : -1;
  return t_waiting_ >= 0;
}

/// Whether a motion of the robot explains the newest package. One that none does is not used; several in a row show that the robot is elsewhere
/// or that its clock has begun anew.
bool RtdeLink::is_believed(double t, std::int64_t host) {
  const rtde::Client& c = line_.client();
  const auto joints = [&](const char* name) { return c.values().subspan(c.directory().slot(name), n_); };
  const double since = t - t_robot_, passed = static_cast<double>(host - arrived_) / 1e9;
  const bool in_time = !connected_ || (since >= 0 && since <= passed + patience());
  // Before there is a time of the robot, that of the package before counts.
  bool possible = connected_ || t_offered_ < 0 || (t > t_offered_ && t - t_offered_ <= patience());
  for (std::size_t i = 0; i < n_; ++i) possible = possible && belief_.allows(i, joints("actual_qd")[i]);
  // Packages without a possible time are taken for a cycle apart.
  const double elapsed = in_time && t > t_offered_ ? std::min(t - t_offered_, patience()) : 1 / frequency_;
  if (in_time) t_offered_ = t;
  since_used_ += elapsed;
  const Belief::Verdict verdict = belief_.add(joints("actual_q"), elapsed, in_time, possible);
  if (verdict == Belief::Verdict::kJump) demand_acknowledgement();
  std::ranges::copy(joints("target_q"), q_target_.begin());
  const char* why = set_point_.take(q_target_, joints("actual_q"), elapsed, !belief_.is_held(), false, following_);
  if (why != nullptr) belief_.count_implausible(why);
  if (belief_.is_held()) return false;
  why = speeds_.compare(joints("actual_q"), joints("actual_qd"), std::exchange(since_used_, 0));
  if (why != nullptr && !following_) belief_.count_implausible(why);
  return true;
}

void RtdeLink::measure(Measured& measured, Time now) {
  const rtde::Client& c = line_.client();
  const double t = c.value("timestamp");
  const std::int64_t host = monotonic_now();
  elapsed_ = connected_ && t > t_robot_ && t - t_robot_ <= rtde::kLongestPause ? t - t_robot_ : 0;
  count(received_);
  const bool used = !waits(t, host, now) && is_believed(t, host);
  // While nothing is commanded a stop gets through.
  if (used || !connected_) read_others(measured);
  if (!used) return;
  heard_ = now.ns;
  if (elapsed_ > 0) {
    measured.elapsed += elapsed_;
    count(skipped_, static_cast<std::uint64_t>(std::max(std::round(elapsed_ * frequency_) - 1, 0.0)));
    jitter_ += (std::abs(static_cast<double>(host - arrived_) / 1e9 - elapsed_) - jitter_) / 16;
  }
  arrived_ = host;
  t_robot_ = t;
  connected_ = was_connected_ = measured.fresh = true;
  const double old = ddq_cutoff_ > 0 ? std::exp(-2 * std::numbers::pi * ddq_cutoff_ * elapsed_) : 0;
  const bool gives_tau_e = measured.has_tau_e && (!tau_e_gated_ || (following_ && command_));
  for (std::size_t i = 0; i < n_; ++i) {
    const double dq = c.value("actual_qd", i);
    if (elapsed_ > 0) {
      const double ddq = (dq - measured.dq[i]) / elapsed_;
      measured.ddq[i] = ddq + old * (measured.ddq[i] - ddq);
    }
    measured.q[i] = c.value("actual_q", i);
    measured.dq[i] = dq;
    measured.tau_e[i] = gives_tau_e ? F_.torque(i) : 0;
  }
  q_robot_ = q_target_;
  count_reflected();
}

double RtdeLink::used(std::string_view name, std::size_t i) const {
  return numbers_.used(line_.client().directory().slot(name) + i);
}

/// All but the positions, their speeds, time stamp and counter.
void RtdeLink::read_others(Measured& measured) {
  const rtde::Client& c = line_.client();
  for (const std::size_t slot : slots_) numbers_.put(slot, c.values()[slot]);
  std::array<double, rtde::kJoints> tau;
  has_torque_ = c.has("actual_current_as_torque");
  for (std::size_t i = 0; i < n_; ++i) {
    current_[i] = used("actual_current", i);
    tau[i] = has_torque_ ? c.value("actual_current_as_torque", i) : c.value("actual_current", i) * torque_per_current_[i];
  }
  if (const char* const why = tau_.add(tau)) belief_.count_implausible(why);
  for (std::size_t i = 0; i < n_; ++i) measured.tau[i] = tau_.torque(i);
  measured.has_tau = tau_.known() && (has_torque_ || std::ranges::any_of(torque_per_current_, [](double k) { return k > 0; }));
  read_forces();
  measured.has_tau_e =
      kinematics_ && c.has("actual_TCP_pose") && c.has("actual_TCP_force") && F_.known() && misfits_ <= Belief::kMostHeld;
  if (misfits_ > Belief::kMostHeld) measured.warn(kOtherRobot);
  robot_mode_ = static_cast<std::int32_t>(used("robot_mode"));
  safety_ = static_cast<std::int32_t>(used("safety_mode"));
  runtime_ = static_cast<std::int32_t>(std::min(used("runtime_state"), 2147483647.0));
  // The register keeps what the program wrote last.
  state_ = c.has("runtime_state") && runtime_ != 2 ? 0 : static_cast<std::int32_t>(used("output_int_register_25"));
  speed_scaling_ = used("speed_scaling");
  digital_in_ = static_cast<std::int32_t>(std::clamp(used("actual_digital_input_bits"), 0.0, 2147483647.0));
  digital_out_ = static_cast<std::int32_t>(std::clamp(used("actual_digital_output_bits"), 0.0, 2147483647.0));
  for (std::size_t i = 0; i < kRegisters; ++i) {
    double_value_[i] = used("output_double_register_24", i);
    int_value_[i] = static_cast<std::int32_t>(used("output_int_register_24", i));
  }
  follows_.see(robot_follows() ? 1 : 0);
}

void RtdeLink::read_forces() {
  const rtde::Client& c = line_.client();
  std::array<double, 6> pose, used_pose, F, torques;
  for (std::size_t i = 0; i < 6; ++i) {
    pose[i] = c.value("actual_TCP_pose", i);
    used_pose[i] = used("actual_TCP_pose", i);
    F[i] = torques[i] = c.value("actual_TCP_force", i);
  }
  const Eigen::Quaterniond Q(rtde::from_ur_pose(used_pose).R);
  p_ = {used_pose[0], used_pose[1], used_pose[2]};
  quat_ = {Q.w(), Q.x(), Q.y(), Q.z()};
  if (kinematics_) {
    const std::span<const double> q = c.values().subspan(c.directory().slot("actual_q"), n_);
    const Pose X = rtde::from_ur_pose(pose), X_BE = kinematics_->pose(q);
    // A flange elsewhere than the URDF has it: J would be that of another robot. Calibrations are some millimetres. A single one is damaged.
    constexpr double kCalibration = 0.03;  // m
    const Eigen::Vector3d offset(c.value("tcp_offset", 0), c.value("tcp_offset", 1), c.value("tcp_offset", 2));
    const bool fits = !c.has("actual_TCP_pose") || !c.has("tcp_offset") || (X.p - X_BE * offset).norm() < kCalibration;
    misfits_ = fits ? 0 : std::min(misfits_ + 1, Belief::kMostHeld + 1);
    // CB3 gives the force at the TCP; e-Series at the flange, unless it comes from a sensor of the user (ur_robot_driver, pull request 1287).
    const bool at_tcp = fits && c.version()[0] > 0 && c.version()[0] < 5;
    kinematics_->torques_of(moved(Eigen::Map<const Wrench>(F.data()), at_tcp ? X.p : X_BE.p, X_BE.p), q, torques);
  }
  const bool known = F_.known();
  const char* const why = F_.add(torques, F, misfits_ == 0 || misfits_ > Belief::kMostHeld);
  if (why != nullptr && known) belief_.count_implausible(why);
  for (std::size_t i = 0; i < 6; ++i) F_e_[i] = F_.along(i);
}

void RtdeLink::count_reflected() {
  const auto reflected = static_cast<std::int32_t>(line_.client().value("output_int_register_24"));
  if (reflected == reflected_) return;
  reflected_ = reflected;
  const std::int64_t at = sent_at_[static_cast<std::uint32_t>(reflected) % sent_at_.size()];
  const std::int64_t behind = static_cast<std::int64_t>(counter_) - reflected;
  if (at == 0 || behind < 0 || behind >= static_cast<std::int64_t>(sent_at_.size())) return;
  ++trips_;
  round_trip_ += (static_cast<double>(arrived_ - at) / 1e9 - round_trip_) / static_cast<double>(trips_);
}

bool RtdeLink::is_ready(int robot_mode, int safety, int runtime) const {
  const rtde::Client& c = line_.client();
  const bool runs = !c.has("robot_mode") || robot_mode == 7;
  const bool safe = !c.has("safety_mode") || safety == 1 || safety == 2;
  const bool plays = !c.has("runtime_state") || runtime == 2;
  return runs && safe && plays;
}

/// Whether the newest package says that the robot follows commands.
bool RtdeLink::robot_follows() const {
  const auto state = [&](const char* name) { return static_cast<int>(line_.client().value(name)); };
  return is_ready(state("robot_mode"), state("safety_mode"), state("runtime_state")) &&
         state("output_int_register_25") == static_cast<int>(rtde::FollowState::kFollowing);
}

/// Whether all values of double_command that are sent are finite; takes those that are. Until somebody acknowledges the last ones stay, or 0 where
/// the connection is a new one.
bool RtdeLink::read_registers() {
  if (!registers_ || acknowledgement_.awaits()) return true;
  registers_int_sent_ = int_command_;
  bool all = true;
  for (std::size_t i = rtde::kJoints; i < kRegisters; ++i) {  // those before are commands
    if (std::isfinite(double_command_[i])) {
      registers_sent_[i] = double_command_[i];
    } else {
      all = false;
    }
  }
  return all;
}

void RtdeLink::send(const Command& command, Measured& measured) {
  rtde::Client& c = line_.client();
  const bool usable = is_usable(command.q), all = read_registers() && usable;
  if (!all) {
    count(refused_);
    measured.warn(kTargetsRefused);
  }
  for (std::size_t i = 0; i < kRegisters; ++i) {
    c.at("input_double_register_24", i) = registers_sent_[i];
    c.at("input_int_register_24", i) = registers_int_sent_[i];
  }
  c.at("standard_digital_output_mask") = acknowledgement_.awaits() ? 0 : digital_mask_;
  c.at("standard_digital_output") = digital_command_ & 0xff;
  if (usable) q_wanted_ = command.q;
  has_wanted_ = has_wanted_ || usable;
  follow();
  if (counter_ == 0) counter_ = reflected_;  // the first command has another number than the robot has read last
  counter_ = counter_ == 2147483647 ? 1 : counter_ + 1;
  c.at("input_int_register_24") = counter_;
  c.at("input_int_register_25") = requests() ? 1 : 0;
  for (std::size_t i = 0; i < n_; ++i) c.at("input_double_register_24", i) = synchronisation_.last()[i];
  if (!c.send()) return;
  t_sent_ = t_robot_;
  count(sent_);
  sent_at_[static_cast<std::uint32_t>(counter_) % sent_at_.size()] = monotonic_now();
  std::ranges::copy(synchronisation_.last(), q_sent_.begin());
}

/// Whether the robot is asked to follow. Its program takes only a request that begins while it waits, so that one that stopped because of
/// a loss does not go on by itself.
bool RtdeLink::requests() const {
  using State = rtde::FollowState;
  const bool waits = state_ == static_cast<std::int32_t>(State::kWaiting);
  const bool follows = state_ == static_cast<std::int32_t>(State::kFollowing);
  return (waits || follows) && !acknowledgement_.awaits();
}

/// A command moves by one period at most, however long there was none. While the newest package alone says that the robot does
/// not follow, it comes to rest.
void RtdeLink::follow() {
  const double elapsed = t_commanded_ >= 0 ? std::clamp(t_robot_ - t_commanded_, 0.0, period_) : period_;
  t_commanded_ = t_robot_;
  const Synchronisation::Gains gains{K_P_, K_D_, dq_command_max_, ddq_command_max_};
  const bool robot_follows = follows_.value != 0 && (following_ || agrees());
  if (following_ ? !robot_follows : robot_follows && !set_point_.believed()) demand_acknowledgement();
  const bool commanding = robot_follows && !acknowledgement_.awaits();
  // A program that still follows when the connection is set up goes on from where it is.
  if (!commanding || t_sent_ < 0) synchronisation_.start(q_robot_);
  if (commanding && !follows_.is_sure()) {
    synchronisation_.pause(gains, elapsed);
  } else if (commanding && command_ && has_wanted_) {
    synchronisation_.command(q_wanted_, gains, elapsed);
    synchronisation_.measure(q_wanted_, line_.client().values().subspan(line_.client().directory().slot("actual_q"), n_), gains,
                             elapsed);
  } else if (commanding) {
    synchronisation_.rest(gains, elapsed);
  }
  following_ = commanding;
}

void RtdeLink::note_loss(Measured& measured) {
  count(losses_);
  demand_acknowledgement();
  forget();
  connected_ = following_ = false;
  state_ = 0;
  t_sent_ = t_commanded_ = -1;
  std::ranges::fill(measured.dq, 0);
  std::ranges::fill(measured.ddq, 0);
  std::ranges::fill(measured.tau_e, 0);
  F_e_ = {};
  measured.warn(kControllerSilent);
}

void RtdeLink::write_outputs() {
  const rtde::Client& c = line_.client();
  commanding_ = connected_ && following_ && command_;
  std::ranges::copy(synchronisation_.discrepancy(), e_.begin());
  for (std::size_t i = 0; i < version_.size(); ++i) version_[i] = static_cast<std::int32_t>(c.version()[i] & 0x7fffffff);
  rejected_ = saturated(c.rejected());
  unsent_ = saturated(c.unsent());
  connections_ = saturated(line_.set_ups());
}

void RtdeLink::append_notes(std::vector<std::string>& sentences) const {
  const std::string why = line_.reason() + (line_.culprit().empty() ? "" : " " + std::string(line_.culprit()));
  if (!was_connected_) {
    sentences.push_back("no data of a robot came from " + net::to_text(line_.controller()) + ": " + why);
    return;
  }
  sentences.push_back("robot: " + text::counted(received_, "data package") + ", " + std::to_string(skipped_) + " left out, " +
                      text::counted(sent_, "command"));
  belief_.append_notes(sentences, "package");
  if (acknowledgement_.awaits())
    sentences.emplace_back("at the end nothing was commanded: acknowledge had not risen since a loss");
  if (losses_ > 0) {
    sentences.push_back("the robot was silent " + text::counted(losses_, "time") + ", for " + text::to_text(lost_time_, 3) +
                        " s beyond timeout; last: " + why);
  }
}

}  // namespace cotwin::io
