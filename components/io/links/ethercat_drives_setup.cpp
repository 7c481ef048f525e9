#include <algorithm>
#include <cmath>
#include <utility>

#include "components/io/link/finite.h"
#include "components/io/links/ethercat_drives.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"

namespace cotwin::io {

namespace {

namespace object = cia402::object;

constexpr std::size_t kWidest = 32;  // bits of a value
constexpr double kMostGain = 0.2;    // of K_v · cycle: three cycles of delay leave a phase margin of more than 45 degrees

std::string four_digits(unsigned value) {
  static constexpr char kDigits[] = "0123456789ABCDEF";
  std::string text;
  for (int shift = 12; shift >= 0; shift -= 4) text += kDigits[value >> shift & 15];
  return text;
}

std::string object_name(const ethercat::Channel& c) {
  return "0x" + four_digits(c.index) + ":" + std::to_string(c.subindex) + (c.name.empty() ? "" : " (" + c.name + ")");
}

}  // namespace

EtherCatDrives::Place EtherCatDrives::find(const std::vector<ethercat::Channel>& channels, std::uint16_t object) {
  const auto found =
      std::ranges::find_if(channels, [&](const ethercat::Channel& c) { return c.index == object && c.subindex == 0; });
  return found == channels.end() ? Place{} : Place{found->bit, found->bits};
}

EtherCatDrives::EtherCatDrives(const std::vector<SlaveChoice>& slaves, const std::vector<std::size_t>& joint_of,
                               const std::vector<trajectory::Axis>& joints, const robot::RobotModel* robot,
                               const std::string& place)
    : place_(place), synchronisation_(0), belief_({}), speeds_({}), tau_({}) {
  std::vector<trajectory::Axis> axes;
  for (std::size_t i = 0; i < slaves.size(); ++i) {
    const SlaveChoice& s = slaves[i];
    if (s.kind != SlaveChoice::Kind::kDrive) continue;
    Drive d;
    d.slave = i;
    d.joint = joint_of[i];
    d.name = s.name;
    d.joint_name = joints[joint_of[i]].name;
    d.revolute = joints[joint_of[i]].revolute;
    const auto &out = s.setup.outputs, &in = s.setup.inputs;
    d.control = find(out, object::kControlWord);
    d.mode = find(out, object::kMode);
    d.target_position = find(out, object::kTargetPosition);
    d.target_velocity = find(out, object::kTargetVelocity);
    d.target_torque = find(out, object::kTargetTorque);
    d.status = find(in, object::kStatusWord);
    d.mode_display = find(in, object::kModeDisplay);
    d.position = find(in, object::kPosition);
    d.velocity = find(in, object::kVelocity);
    d.torque = find(in, object::kTorque);
    d.error = find(in, object::kErrorCode);
    const char* const lacks = d.control.bits != 16    ? "0x6040 (control word, 16 bits) in its outputs"
                              : d.status.bits != 16   ? "0x6041 (status word, 16 bits) in its inputs"
                              : d.position.bits != 32 ? "0x6064 (position, 32 bits) in its inputs"
                                                      : nullptr;
    if (lacks != nullptr) {
      throw Error(place_ + ": slave " + s.name,
                  "the process data of the " + s.device + " have no object " + lacks + ", expected a drive with it");
    }
    for (const Place& used :
         {d.mode, d.target_position, d.target_velocity, d.target_torque, d.mode_display, d.velocity, d.torque, d.error}) {
      if (used.bits > kWidest) {
        throw Error(place_ + ": slave " + s.name, "a value of the " + s.device + " has " + std::to_string(used.bits) +
                                                      " bits, expected at most " + std::to_string(kWidest));
      }
    }
    add_constants(s, d);
    const trajectory::Axis& axis = axes.emplace_back(joints[d.joint]);
    dq_command_max_.push_back(std::min(kSafeSpeed, finite(axis.dq_max, kSafeSpeed)));
    q_command_min_.push_back(finite(axis.q_min, -kUnlimited));
    q_command_max_.push_back(finite(axis.q_max, kUnlimited));
    tau_command_max_.push_back(robot == nullptr ? kUnlimited : std::min(robot->joints[d.joint].tau_max, kUnlimited));
    drives_.push_back(std::move(d));
  }
  const std::size_t n = drives_.size();
  synchronisation_ = Synchronisation(n);
  belief_ = Belief(axes);
  speeds_ = Agreement(axes);
  tau_ = BelievedTorques(axes);
  errors_.add(BelievedNumbers::Kind::kState, n);
  for (std::vector<double>* values : {&q_, &q_wanted_, &q_target_, &tau_target_, &outside_, &no_gain_, &dq_scale_, &tau_scale_,
                                      &q_read_, &dq_read_, &dq_given_, &tau_read_})
    values->resize(n);
  following_error_max_.resize(n, kLargestFollowingError);
  home_ = std::make_unique<bool[]>(n);
  homed_ = std::make_unique<bool[]>(n);
  home_before_.resize(n);
  for (std::vector<std::int32_t>* values : {&state_, &error_, &warning_}) values->resize(n);
}

/// Outputs that the PDOs of the drive have beside those of its mode: torque limits, offsets, digital outputs. What 0 means for them is up to
/// the drive, so that the user gives their values.
void EtherCatDrives::add_constants(const SlaveChoice& s, Drive& d) const {
  constexpr std::uint16_t kSecondAxis = 0x6800;
  const std::string place = place_ + ": slave " + s.name;
  for (const ethercat::Channel& c : s.setup.outputs) {
    const auto is_at = [&](const Place& p) { return p.bits != 0 && p.bit == c.bit; };
    if (is_at(d.control) || is_at(d.mode) || is_at(d.target_position) || is_at(d.target_velocity) || is_at(d.target_torque))
      continue;
    if (c.index >= kSecondAxis) {
      throw Error(place,
                  "its outputs have the object " + object_name(c) + ", expected a drive with one axis (objects below 0x6800)");
    }
    if (c.bits == 0 || c.bits > kWidest) {
      throw Error(place, "its output " + object_name(c) + " has " + std::to_string(c.bits) + " bits, expected 1 to " +
                             std::to_string(kWidest));
    }
    std::string port = s.name + "_" + four_digits(c.index) + "_" + std::to_string(c.subindex);
    const bool twice = std::ranges::any_of(d.constants, [&](const Constant& other) { return other.port == port; });
    if (twice) throw Error(place, "its outputs have the object " + object_name(c) + " twice, expected each object once");
    d.constants.push_back({{c.bit, c.bits}, std::move(port), object_name(c), kNotGiven});
  }
}

Link::Needs EtherCatDrives::needs() const {
  return {mode_text_ == "position" || mode_text_ == "velocity", mode_text_ == "torque"};
}

void EtherCatDrives::declare(Variables& v, JointVariables& joints) {
  if (empty()) return;
  v.parameter("drive_mode", mode_text_,
              "what the drives (CiA 402) do: monitor (they stay off), position (csp), velocity (csv) or torque (cst)");
  v.input("enable", enable_, "the drives are enabled with drive_mode other than monitor; false: they are shut down");
  v.input("quick_stop", quick_stop_, "stops all drives at once; they are enabled again when it is false and acknowledge rises");
  v.input(
      "home", std::span<bool>(home_.get(), drives_.size()),
      "of each drive: a rising edge while all drives are enabled and stand makes it find its home (objects 0x6098, 0x6099)");
  v.output("homed", std::span<bool>(homed_.get(), drives_.size()), "of each drive: it has found its home since the start");
  v.output("drives_enabled", enabled_, "whether all drives are enabled and follow the commands");
  v.output("drive_state", state_,
           "state of each drive: 0 not ready, 1 switch on disabled, 2 ready to switch on, 3 switched on, 4 operation enabled, "
           "5 quick stop, 6 fault reaction, 7 fault");
  v.output("drive_error", error_, "error code of each drive (object 0x603F); 0: none, or not in its process data");
  v.output("drive_limits", warning_, "of each drive: 1 a limit within the drive acts, 2 it warns, 3 both");
  joints
      .parameter("dq_command_max", dq_command_max_, "rad/s",
                 "of each drive: speed limit of commands, at first the URDF's, but at most 0.5 rad/s")
      .range(1e-6, 1e9);
  joints.parameter("q_command_min", q_command_min_, "rad", "of each drive: lower limit of commanded positions, from the URDF")
      .range(-kUnlimited, kUnlimited);
  joints.parameter("q_command_max", q_command_max_, "rad", "of each drive: upper limit of commanded positions, from the URDF")
      .range(-kUnlimited, kUnlimited);
  joints.parameter("tau_command_max", tau_command_max_, "N.m", "of each drive: limit of commanded torques, from the URDF")
      .range(0, kUnlimited);
  joints
      .parameter("following_error_max", following_error_max_, "rad",
                 "of each drive with drive_mode=position or velocity: distance from its target at which all drives are stopped")
      .range(1e-6, kUnlimited);
  joints
      .parameter("dq_scale", dq_scale_, "rad/s",
                 "of each drive: joint speed per unit of its velocity; 0: q_scale, for counts/s")
      .range(-kUnlimited, kUnlimited);
  joints
      .parameter("tau_scale", tau_scale_, "N.m",
                 "of each drive: joint torque per unit of its torque, 1/1000 of the rated torque; 0: not known")
      .range(-kUnlimited, kUnlimited);
  v.parameter("ddq_command_max", ddq_command_max_, "rad/s2", "limit of the acceleration of commands").range(1e-3, 1e9);
  v.parameter(
       "enable_timeout", enable_timeout_, "s",
       "time from the start, from enable or from acknowledge until all drives are enabled; later ones need acknowledge again")
      .range(0.01, 3600);
  for (Drive& d : drives_) {
    for (Constant& c : d.constants)
      v.parameter(
          c.port, c.value,
          "what drive " + d.name + " gets in each cycle as object " + c.object + "; needed unless drive_mode is monitor");
  }
  v.parameter("K_v", K_v_, "1/s", "drive_mode=velocity: gain of the position").range(0, 1e4);
  v.parameter("outside", outside_text_,
              "what a drive may do outside of q_command_min to q_command_max: refuse (none is enabled or goes on), or return "
              "(position, velocity: it moves back; torque: its torque may move it back)");
}

cia402::Mode EtherCatDrives::profile_mode() const {
  switch (mode_) {
    case Mode::kPosition:
      return cia402::Mode::kPosition;
    case Mode::kVelocity:
      return cia402::Mode::kVelocity;
    case Mode::kTorque:
      return cia402::Mode::kTorque;
    case Mode::kMonitor:
      break;
  }
  return cia402::Mode::kNone;
}

/// The object that the mode needs and the outputs of the drive lack; nullptr: none.
const char* EtherCatDrives::missing(const Drive& d) const {
  if (mode_ == Mode::kPosition && d.target_position.bits != 32) return "0x607A (target position, 32 bits)";
  if (mode_ == Mode::kVelocity && d.target_velocity.bits != 32) return "0x60FF (target velocity, 32 bits)";
  if (mode_ == Mode::kTorque && d.target_torque.bits != 16) return "0x6071 (target torque, 16 bits)";
  return nullptr;
}

void EtherCatDrives::initialise(double cycle, std::span<const double> q_scale, std::span<const double> q_offset,
                                const Acknowledgement& acknowledgement) {
  mode_ = text::choose<Mode>(
      place_ + ": drive_mode", mode_text_,
      {{"monitor", Mode::kMonitor}, {"position", Mode::kPosition}, {"velocity", Mode::kVelocity}, {"torque", Mode::kTorque}});
  if (drives() && acknowledgement.is_automatic()) {
    throw Error(place_ + ": restart", "automatic with drive_mode=" + mode_text_ +
                                          ", expected acknowledged: after a loss or a fault no drive may move by itself");
  }
  if (mode_ == Mode::kVelocity && K_v_ * cycle > kMostGain) {
    throw Error(place_ + ": K_v", text::to_text(K_v_) + " with a cycle of " + text::to_text(cycle) + " s, expected at most " +
                                      text::to_text(kMostGain / cycle, 4) + ": the loop over the bus would swing");
  }
  when_outside_ =
      text::choose<Outside>(place_ + ": outside", outside_text_, {{"refuse", Outside::kRefuse}, {"return", Outside::kReturn}});
  q_scale_ = q_scale;
  q_offset_ = q_offset;
  place_outside_.clear();
  place_outside_.reserve(512);
  told_outside_ = false;
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    const std::string place = place_ + ": slave " + d.name;
    if (q_scale_[d.joint] == 0) throw Error(place, "q_scale of its joint is 0, expected the joint position per count");
    if (const char* const lacks = missing(d); lacks != nullptr) {
      throw Error(place, "its outputs have no object " + std::string(lacks) + ", which drive_mode=" + mode_text_ + " needs");
    }
    if (mode_ == Mode::kTorque && tau_scale_[k] == 0) {
      throw Error(place, "tau_scale is 0, expected the joint torque per unit of its torque for drive_mode=torque");
    }
    if (mode_ == Mode::kTorque && tau_command_max_[k] >= kUnlimited) {
      throw Error(place,
                  "tau_command_max of its joint is not given and the robot has no limit of effort, expected the largest torque "
                  "for drive_mode=torque");
    }
    if (q_scale_[d.joint] * dq_scale_[k] < 0) {
      throw Error(place, "dq_scale is " + text::to_text(dq_scale_[k]) + " and q_scale " + text::to_text(q_scale_[d.joint]) +
                             ", expected the same sign");
    }
    check_constants(d);
    d.axis.forget();
    d.homing = {};
    home_before_[k] = true;  // an input that is on at the start has not risen
    homed_[k] = false;
    d.status_word = 0;
    d.known = false;
    belief_.set_resolution(k, q_scale_[d.joint]);
    speeds_.set_resolution(k, q_scale_[d.joint], dq_scale_of(k));
    d.error_code = d.mode_shown = 0;
    d.speed = 0;
    d.doubts = d.unconfirmed = 0;
    d.stood = 0;
    tau_target_[k] = 0;
  }
  awaited_ = follows_ = fresh_ = were_enabled_ = blind_ = pauses_ = false;
  were_asked_ = differed_ = false;
  missing_ = 0;
  jumped_ = nullptr;
  cycle_ = cycle;
  enabling_ = 0;
  since_acknowledged_ = kReset;
  silent_ = elapsed_ = 0;
  stops_ = 0;
  stopped_by_ = "";
  belief_.begin();
  speeds_.forget();
  tau_.forget();
  errors_.forget();
  write_outputs();
}

void EtherCatDrives::check_constants(const Drive& d) const {
  if (!drives()) return;
  for (const Constant& c : d.constants) {
    const std::string place = place_ + ": " + c.port;
    if (c.value == kNotGiven) {
      throw Error(place, "not given, expected the value of object " + c.object + ", which is mapped in the outputs of slave " +
                             d.name + ": for a limit 0 would be no torque at all");
    }
    const std::int64_t most = (std::int64_t{1} << c.place.bits) - 1, least = -(std::int64_t{1} << (c.place.bits - 1));
    if (c.value < least || c.value > most) {
      throw Error(place, std::to_string(c.value) + ", expected a value of " + std::to_string(c.place.bits) + " bits");
    }
  }
}

void EtherCatDrives::add_start_up(std::vector<ethercat::ExpectedSlave>& expected) const {
  if (!drives()) return;
  for (const Drive& d : drives_) {
    std::vector<ethercat::StartUpValue>& values = expected[d.slave].start_up;
    const auto mode = static_cast<std::uint8_t>(profile_mode());
    bool given = false;
    for (const ethercat::StartUpValue& value : values) {
      if (value.index != object::kMode) continue;
      given = true;
      if (value.data == std::vector{mode}) continue;
      throw Error(value.origin, "object 0x6060 is the mode of drive " + d.name + ", expected " + std::to_string(mode) +
                                    " (i8) for drive_mode=" + mode_text_ + ", or no such line");
    }
    if (d.mode.bits != 0 || given) continue;
    values.push_back({object::kMode, 0, {mode}, false, "drive_mode=" + mode_text_});
  }
}

}  // namespace cotwin::io
