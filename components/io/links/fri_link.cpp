#include "components/io/links/fri_link.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "components/io/fri/finite.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

const std::string kFriPlace = "unit:io?link=fri";
constexpr const char* kSilent =
    "the robot was silent for longer than timeout: its last positions were held and its external torques set to 0";
constexpr const char* kRefused = "inputs were not finite or larger than 1e9: their last usable values were sent";
constexpr const char* kOther =
    "the robot did not ask for the quantity of mode (client_mode): its last commanded position was held";
constexpr const char* kOpen =
    "the controller is on another machine, and FRI has neither authentication nor encryption: use a network of its own";
constexpr const char* kWithheld = "after a loss, a restart or a jump nothing was commanded until acknowledge rose";
constexpr std::int64_t kRepeatAnswer = 20'000'000;  // ns without a message, until an answer is repeated
constexpr int kLastTimes = 5;                       // the last answer is sent again at the end

const char* reason(fri::Fault fault) {
  switch (fault) {
    case fri::Fault::kStranger:
      return "it is not from the controller";
    case fri::Fault::kMissing:
      return "a field is missing";
    case fri::Fault::kValue:
      return "a state or a period is out of its range";
    case fri::Fault::kCount:
      return "it is of another number of joints";
    case fri::Fault::kChecksum:
      return "its checksum is wrong";
    case fri::Fault::kNotFinite:
      return "a number is not finite or too large";
    default:
      return "it is no message of this protocol";
  }
}

/// Of the numbers of a rotation matrix and a position.
std::vector<trajectory::Axis> axes_of_pose() {
  std::vector<trajectory::Axis> axes = trajectory::free_axes(12);
  for (trajectory::Axis& axis : axes) axis.dq_max = 5;  // 1/s, m/s
  return axes;
}

}  // namespace

FriLink::FriLink(Settings& settings, std::vector<trajectory::Axis> joints)
    : protocol_(protocol_of(settings)),
      n_(joints.size()),
      datagrams_(*this),
      synchronisation_(n_),
      belief_(joints),
      tau_(joints),
      tau_external_(joints),
      F_external_(settings.robot_used() != nullptr ? joints : trajectory::free_axes(6), 6),
      set_point_(joints),
      pose_(axes_of_pose()),
      port_(default_port(protocol_)),
      dq_command_max_(n_, kSafeSpeed),
      writes_(settings.text("io_write"), fri::Io::Direction::kOutput, kFriPlace + "&io_write"),
      K_P_(n_),
      K_D_(n_),
      stiffness_(n_, 1000.0),
      damping_(n_, 0.7),
      cartesian_stiffness_{2000, 2000, 2000, 200, 200, 200},
      cartesian_damping_{0.7, 0.7, 0.7, 0.7, 0.7, 0.7},
      q_robot_(n_),
      q_own_(n_),
      q_sent_(n_),
      e_(n_),
      reads_(settings.text("io_read"), fri::Io::Direction::kInput, kFriPlace + "&io_read"),
      inputs_(n_) {
  fri::check_joints(protocol_, n_, kFriPlace);
  if (settings.robot_used() != nullptr) kinematics_.emplace(*settings.robot_used());
  add_numbers();
  reads_.examine();
  for (std::size_t i = 0; i < n_; ++i) {
    if (joints[i].dq_max > 0) dq_command_max_[i] = std::min(kSafeSpeed, joints[i].dq_max);
  }
}

Link::Needs FriLink::needs() const {
  const bool positions = mode_text_ != "monitor" && mode_text_ != "cartesian_impedance";
  return {positions, mode_text_ == "torque"};
}

void FriLink::open(Measured& measured) {
  mode_ = text::choose<Mode>(kFriPlace + ": mode", mode_text_,
                             {{"monitor", Mode::kMonitor},
                              {"position", Mode::kPosition},
                              {"torque", Mode::kTorque},
                              {"wrench", Mode::kWrench},
                              {"joint_impedance", Mode::kJointImpedance},
                              {"cartesian_impedance", Mode::kCartesianImpedance}});
  if (mode_ >= Mode::kJointImpedance && protocol_ != fri::Protocol::kLwr) {
    throw Error(kFriPlace + ": mode", "'" + mode_text_ + "' with protocol " + fri::to_text(protocol_) +
                                          ", expected it only with lwr: Sunrise's robot program sets the impedance");
  }
  fri::ClientSettings settings;
  settings.protocol = protocol_;
  settings.joints = n_;
  if (!controller_.empty()) settings.controller = net::endpoint_of(controller_, 0, kFriPlace + ": controller");
  settings.timeout = Duration::from_seconds(timeout_).ns;
  net::Endpoint local = net::endpoint_of(address_, 0, kFriPlace + ": address");
  const bool here = local.is_loopback(), anyone = settings.controller.address == 0;
  const bool elsewhere = !anyone && !settings.controller.is_loopback();
  if (here && elsewhere) {
    throw Error(kFriPlace + ": address", address_ + ", which only programs on this machine reach, with the controller " +
                                             controller_ +
                                             ", expected this machine's address in the controller's network, or 0.0.0.0");
  }
  if (!here && anyone) {
    throw Error(kFriPlace + ": controller", "not given, and address is " + address_ +
                                                ", which other machines reach: the first sender would be taken for the robot; "
                                                "expected the address of the robot's controller");
  }
  if (elsewhere) measured.warn(kOpen);
  for (const auto* values : {&stiffness_, &damping_}) {
    if (!std::ranges::all_of(*values, fri::is_usable))
      throw Error(kFriPlace + ": stiffness, damping", "expected finite values");
  }
  for (const auto* values : {&cartesian_stiffness_, &cartesian_damping_}) {
    if (!std::ranges::all_of(*values, fri::is_usable)) {
      throw Error(kFriPlace + ": cartesian_stiffness, cartesian_damping", "expected finite values");
    }
  }
  client_.emplace(settings, kFriPlace);
  local.port = static_cast<std::uint16_t>(port_);
  datagrams_.open(local, kFriPlace + ": address, port");
  datagrams_.set_source(settings.controller, protocol_ == fri::Protocol::kLwr ? 16 : 32,
                        [this](auto bytes) { return stamp(bytes); });
  datagrams_.set_period(0);
}

std::optional<DatagramQueue::Stamp> FriLink::stamp(std::span<const std::uint8_t> bytes) {
  if (fri::decode(protocol_, bytes, n_, seen_) != fri::Fault::kNone || fri::usability(seen_) != fri::Fault::kNone) {
    return std::nullopt;
  }
  constexpr double kMicroseconds = 1e6;  // of a period that is a single float
  return DatagramQueue::Stamp{seen_.counter, std::llround(seen_.send_period * kMicroseconds) * 1000};
}

void FriLink::initialise(Time start, Measured& measured) {
  acknowledgement_.begin(kFriPlace);
  measured.warning.reserve(1024);
  open(measured);
  for (std::vector<double>* values :
       {&measured.q, &measured.dq, &measured.ddq, &measured.tau, &measured.tau_e, &q_robot_, &q_own_, &q_sent_, &e_}) {
    std::ranges::fill(*values, 0);
  }
  measured.has_tau = measured.has_tau_e = true;
  measured.fresh = measured.done = false;
  connected_ = commanding_ = following_ = follows_ = begins_ = was_connected_ = false;
  state_ = quality_ = command_mode_ = losses_ = refused_ = unsent_ = restarts_ = 0;
  belief_.begin();
  forget();
  sessions_ = 0;
  inputs_ = Inputs(n_);
  wanted_ = {};
  answer_ = {};
  refuses_ = false;
  t_robot_ = period_ = lost_time_ = 0;
  F_e_ = {};
  p_ = {};
  quat_ = {1, 0, 0, 0};
  counts_ = {};
  host_ = monotonic_now();
  at_ = start.ns;
  waiting_ = false;
  if (wait_ > 0) wait_for_robot(start, measured);
  check_gains();
}

/// The robot's period is known only if it was waited for.
void FriLink::check_gains() const {
  if (!drives()) return;
  constexpr std::array kPossible{0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1};  // s
  const std::array known{period_ * client_->monitoring().receive_multiplier};
  const std::span<const double> cycles = period_ > 0 ? std::span<const double>(known) : std::span<const double>(kPossible);
  constexpr double kDelay = 2;  // cycles: the message, and the command
  gains_.check(K_P_, K_D_, cycles, kDelay, kFriPlace);
}

void FriLink::wait_for_robot(Time start, Measured& measured) {
  waiting_ = true;  // the robot's position is held
  heard_ = {};
  const std::int64_t deadline = host_ + Duration::from_seconds(wait_).ns;
  while (!measured.fresh) {
    if (!datagrams_.wait_for_any(deadline) || monotonic_now() > deadline) {
      const std::string seen = heard_.refused == 0
                                   ? "nothing came"
                                   : text::counted(static_cast<std::int64_t>(heard_.refused), "datagram") +
                                         " refused, the first from " + net::to_text(heard_.from) + ": " + heard_.why;
      throw Error("unit:io.wait", "no message of a robot came to " + net::to_text(datagrams_.local()) + " within " +
                                      text::to_text(wait_) + " s (" + seen + "), expected a controller with protocol " +
                                      fri::to_text(protocol_) + " that sends there");
    }
    while (const auto datagram = datagrams_.receive()) {
      if (take(*datagram, start.ns, start.ns)) {
        measure(measured);
      } else if (client_->last_fault() != fri::Fault::kNone) {
        note_refused(*datagram);
      }
    }
  }
  waiting_ = false;
  datagrams_.set_period(std::llround(period_ * 1e6) * 1000);
  host_ = monotonic_now();
  write_outputs(start.ns);
}

void FriLink::note_refused(const DatagramQueue::Datagram& datagram) {
  if (++heard_.refused > 1) return;
  heard_.from = datagram.from;
  heard_.why = reason(client_->last_fault());
  if (client_->last_fault() == fri::Fault::kStranger) return;
  std::string others;
  for (const fri::Protocol other : fri::kProtocols) {
    const bool fits = other != protocol_ && (other != fri::Protocol::kLwr || n_ == 7) &&
                      fri::decode(other, datagram.bytes, n_, seen_) == fri::Fault::kNone;
    if (fits) text::append(others, fri::to_text(other));
  }
  if (!others.empty()) heard_.why += ", but fits " + others;
}

StepResult FriLink::step(Time now, Duration h, const Command& command, Measured& measured) {
  measured.fresh = false;
  acknowledgement_.decide(connected_ && robot_ready(), !belief_.is_held() && set_point_.moves_alike(), h.seconds());
  if (drives() && !read_inputs(command)) {
    refused_ = saturated(static_cast<std::uint64_t>(refused_) + 1);
    measured.warn(kRefused);
  }
  datagrams_.keep_only(connected_ ? client_->controller() : net::Endpoint{}, client_->longest_silence());
  for (std::size_t left = datagrams_.waiting(); left > 0; --left) {
    const auto datagram = datagrams_.receive();
    const std::int64_t arrival = scenario_time(datagram->arrival, host_, at_, now.ns);
    if (take(*datagram, arrival, now.ns)) measure(measured);
  }
  host_ = monotonic_now();
  at_ = now.ns;
  if (refuses_) measured.warn(kOther);
  const bool silent = now.ns - believed_at_ > client_->longest_silence();
  if (connected_ && (silent || !client_->connected(now.ns))) note_loss(measured);
  if (acknowledgement_.awaits()) measured.warn(kWithheld);
  write_outputs(now.ns);
  if (was_connected_ && !connected_) lost_time_ += h.seconds();
  return StepResult::kDone;
}

bool FriLink::robot_ready() const {
  return !client_->monitoring().has(fri::Monitoring::kSafetyState) ||
         numbers_.used(kSafety) == static_cast<double>(fri::SafetyState::kNormal);
}

/// Whether the robot may wait for the last answer and was heard within its timeout.
bool FriLink::Datagrams::repeats() const {
  return waits_ && !link_.answer_.empty() && monotonic_now() - heard() <= link_.client_->longest_silence();
}

/// Repeats the last answer while the clock waits for the next message.
std::optional<Arrival> FriLink::Datagrams::wait(std::int64_t deadline) {
  while (repeats()) {
    const std::int64_t until = std::min(deadline, link_.repeat_at_);
    if (const std::optional<Arrival> arrival = DatagramQueue::wait(until)) return arrival;
    if (monotonic_now() < link_.repeat_at_) return std::nullopt;  // the deadline, or a signal
    send(link_.answer_, link_.client_->controller());
    link_.repeat_at_ = monotonic_now() + link_.repetition();
  }
  return DatagramQueue::wait(deadline);
}

/// ns. Between messages that come at their period nothing is repeated.
std::int64_t FriLink::repetition() const {
  return std::max(kRepeatAnswer, 2 * static_cast<std::int64_t>(client_->monitoring().send_period * 1e9));
}

/// Whether there is a new message; it is answered.
bool FriLink::take(const DatagramQueue::Datagram& datagram, std::int64_t arrival, std::int64_t now) {
  const auto reception = client_->receive(datagram.bytes, datagram.from, arrival, datagram.arrival);
  if (reception == fri::Client::Reception::kRefused) return false;
  if (client_->statistics().sessions != sessions_) {
    begin_session();
    believed_at_ = now;
  }
  const bool believed = is_believed();
  if (believed) believed_at_ = now;
  if (!believed) {
    // The first messages of a session: a controller may wait for their answers.
    if (position_ >= 0 || client_->commanding() || reception != fri::Client::Reception::kAnswerDue) return false;
    begins_ = true;
  }
  if (client_->monitoring().state == fri::SessionState::kIdle) answer_ = {};
  if (reception == fri::Client::Reception::kAnswerDue) {
    choose_command();
    answer_ = client_->answer(wanted_, now);
    if (!answer_.empty() && !datagrams_.send(answer_, client_->controller())) {
      unsent_ = saturated(static_cast<std::uint64_t>(unsent_) + 1);
    }
    repeat_at_ = monotonic_now() + repetition();
  }
  return believed && client_->statistics().monitoring.newest() != position_;
}

void FriLink::begin_session() {
  if (sessions_ > 0) demand_acknowledgement();
  sessions_ = client_->statistics().sessions;
  forget();
  begins_ = true;
  wanted_.krl = {};
}

/// What follows is of another session.
void FriLink::forget() {
  position_ = answered_ = offered_ = -1;
  belief_.forget();
  numbers_.forget();
  takes_ = {};
  for (BelievedTorques* torques : {&tau_, &tau_external_, &F_external_}) torques->forget();
  for (BelievedSetPoint* place : {&set_point_, &pose_}) place->forget();
  following_ = follows_ = own_ = false;
}

void FriLink::measure(Measured& measured) {
  const fri::Monitoring& m = client_->monitoring();
  const std::int64_t newest = client_->statistics().monitoring.newest();
  const double elapsed = position_ >= 0 ? m.send_period * static_cast<double>(newest - position_) : 0;
  position_ = newest;
  measured.elapsed += elapsed;
  const double old = dq_cutoff_ > 0 ? std::exp(-2 * std::numbers::pi * dq_cutoff_ * elapsed) : 0;
  measured.has_tau = m.has(fri::Monitoring::kMeasuredTorque) && tau_.known();
  measured.has_tau_e = m.has(fri::Monitoring::kExternalTorque) && tau_external_.known();
  const bool gives_tau_e = measured.has_tau_e && (!tau_e_gated_ || follows_);
  if (elapsed <= 0) {  // the first message of a session
    std::ranges::fill(measured.dq, 0);
    std::ranges::fill(measured.ddq, 0);
  }
  for (std::size_t i = 0; i < n_; ++i) {
    if (elapsed > 0) {
      const double raw = (m.q_measured[i] - measured.q[i]) / elapsed;
      const double dq = raw + old * (measured.dq[i] - raw);
      measured.ddq[i] = (dq - measured.dq[i]) / elapsed;
      measured.dq[i] = dq;
    }
    measured.q[i] = m.q_measured[i];
    measured.tau[i] = measured.has_tau ? tau_.torque(i) : 0;
    measured.tau_e[i] = gives_tau_e ? tau_external_.torque(i) : 0;
    if (m.has(fri::Monitoring::kCommandedPosition)) q_robot_[i] = m.q_commanded[i];
    if (m.has(fri::Monitoring::kInterpolatorPosition)) q_own_[i] = m.q_interpolator[i];
  }
  measured.fresh = true;
  period_ = m.send_period;
  if (m.has(fri::Monitoring::kTime)) t_robot_ = static_cast<double>(m.time) / 1e9;
}

void FriLink::note_loss(Measured& measured) {
  ++losses_;
  demand_acknowledgement();
  forget();
  std::ranges::fill(measured.dq, 0);
  std::ranges::fill(measured.ddq, 0);
  std::ranges::fill(measured.tau_e, 0);
  F_e_ = {};
  measured.warn(kSilent);
}

void FriLink::write_outputs(std::int64_t now) {
  connected_ = client_->connected(now) && now - believed_at_ <= client_->longest_silence();
  was_connected_ = was_connected_ || connected_;
  state_ = client_->connected(now) ? static_cast<std::int32_t>(numbers_.used(kState)) : 0;
  quality_ = connected_ ? static_cast<std::int32_t>(numbers_.used(kQuality)) : 0;
  commanding_ = connected_ && follows_;
  restarts_ = saturated(client_->statistics().restarts);
  command_mode_ = static_cast<std::int32_t>(numbers_.used(kCommandMode));
  std::copy_n(client_->sent().q.begin(), n_, q_sent_.begin());
  std::ranges::copy(synchronisation_.discrepancy(), e_.begin());
  counts_.read(client_->statistics());
  const std::uint64_t strangers = datagrams_.strangers();
  counts_.strangers = saturated(static_cast<std::uint64_t>(counts_.strangers) + strangers);
  counts_.rejected = saturated(static_cast<std::uint64_t>(counts_.rejected) + strangers);
}

/// A robot that waits for the last answer, which may be lost, would wait for ever.
void FriLink::end() noexcept {
  if (!datagrams_.waits() || answer_.empty()) return;
  for (int times = 0; times < kLastTimes; ++times) datagrams_.send(answer_, client_->controller());
}

void FriLink::append_notes(std::vector<std::string>& sentences) const {
  if (!was_connected_) {
    sentences.push_back("no message of a robot came to " + net::to_text(datagrams_.local()) + " (" + fri::to_text(protocol_) +
                        ")");
    return;
  }
  sentences.push_back("robot: " + text::counted(counts_.received, "message") + ", " + std::to_string(counts_.lost) + " lost, " +
                      text::counted(counts_.answers, "answer"));
  belief_.append_notes(sentences, "message");
  if (unsent_ > 0) sentences.push_back(text::counted(unsent_, "answer") + " to the robot not sent by the system");
  if (restarts_ > 0) sentences.push_back("the robot's controller began anew " + text::counted(restarts_, "time"));
  if (acknowledgement_.awaits())
    sentences.emplace_back("at the end nothing was commanded: acknowledge had not risen since a loss");
  if (refused_ > 0) sentences.push_back("in " + text::counted(refused_, "step") + " " + kRefused);
  if (losses_ > 0) {
    sentences.push_back("the robot was silent " + text::counted(losses_, "time") + ", for " + text::to_text(lost_time_, 3) +
                        " s beyond timeout");
  }
}

}  // namespace cotwin::io
