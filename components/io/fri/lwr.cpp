#include "components/io/fri/lwr.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace cotwin::fri::lwr {

namespace {

static_assert(std::endian::native == std::endian::little, "values are copied as they are in memory");

constexpr std::uint16_t kMonitor = 1, kCommanding = 2;           // state of the interface
constexpr std::size_t kIndexOfRotation[6] = {0, 1, 2, 5, 4, 3};  // x y z Rz Ry Rx on the wire ↔ x y z Rx Ry Rz

/// Puts one value after the other into a datagram whose size was checked.
class Writer {
 public:
  explicit Writer(std::uint8_t* to) : to_(to) {}

  template <class T>
  void put(T value) {
    std::memcpy(to_, &value, sizeof value);
    to_ += sizeof value;
  }
  void real(double value) { put(static_cast<float>(value)); }
  template <class Values>
  void reals(const Values& values, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) real(values[i]);
  }
  void six(const Wrench& values) {
    for (const std::size_t i : kIndexOfRotation) real(values[static_cast<Eigen::Index>(i)]);
  }
  /// 3 × 4, row-major.
  void frame(const Pose& X) {
    for (Eigen::Index row = 0; row < 3; ++row) {
      for (Eigen::Index column = 0; column < 3; ++column) real(X.R(row, column));
      real(X.p[row]);
    }
  }
  void krl(const KrlVariables& k) {
    for (const float value : k.real) put(value);
    for (const std::int32_t value : k.integer) put(value);
    put(k.boolean);
    put(std::uint16_t{0});
  }

 private:
  std::uint8_t* to_;
};

class Reader {
 public:
  explicit Reader(const std::uint8_t* from) : from_(from) {}

  template <class T>
  T get() {
    T value{};
    std::memcpy(&value, from_, sizeof value);
    from_ += sizeof value;
    return value;
  }
  double real() { return static_cast<double>(get<float>()); }
  template <class Values>
  void reals(Values& values, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) values[i] = real();
  }
  void six(Wrench& values) {
    for (const std::size_t i : kIndexOfRotation) values[static_cast<Eigen::Index>(i)] = real();
  }
  void frame(Pose& X) {
    for (Eigen::Index row = 0; row < 3; ++row) {
      for (Eigen::Index column = 0; column < 3; ++column) X.R(row, column) = real();
      X.p[row] = real();
    }
  }
  void krl(KrlVariables& k) {
    for (float& value : k.real) value = get<float>();
    for (std::int32_t& value : k.integer) value = get<std::int32_t>();
    k.boolean = get<std::uint16_t>();
    from_ += 2;
  }

 private:
  const std::uint8_t* from_;
};

struct Header {
  std::uint16_t counter, reflected, size, identifier;
};

Header read_header(Reader& from) {
  Header h{};
  h.counter = from.get<std::uint16_t>();
  h.reflected = from.get<std::uint16_t>();
  h.size = from.get<std::uint16_t>();
  h.identifier = from.get<std::uint16_t>();
  return h;
}

void write_header(Writer& to, std::uint32_t counter, std::uint32_t reflected, std::size_t size, std::uint16_t identifier) {
  to.put(static_cast<std::uint16_t>(counter));
  to.put(static_cast<std::uint16_t>(reflected));
  to.put(static_cast<std::uint16_t>(size));
  to.put(identifier);
}

std::uint16_t number_of(ControlMode mode) {
  switch (mode) {
    case ControlMode::kPosition:
      return 1;
    case ControlMode::kCartesianImpedance:
      return 2;
    case ControlMode::kJointImpedance:
      return 3;
    case ControlMode::kNone:
      break;
  }
  return 0;
}

ControlMode control_mode_of(std::uint16_t number) {
  switch (number) {
    case 1:
      return ControlMode::kPosition;
    case 2:
      return ControlMode::kCartesianImpedance;
    case 3:
      return ControlMode::kJointImpedance;
    default:
      return ControlMode::kNone;
  }
}

// Bits of the command's flags. 0x0002 and 0x0200, velocities, are reserved.
struct Flag {
  std::uint32_t wire;
  std::uint32_t field;
};
constexpr Flag kFlags[] = {
    {0x0001, Command::kPosition},
    {0x0100, Command::kPose},
    {0x0004, Command::kTorque},
    {0x0400, Command::kWrench},
    {0x0010, Command::kJointStiffness},
    {0x0020, Command::kJointDamping},
    {0x1000, Command::kCartesianStiffness},
    {0x2000, Command::kCartesianDamping},
};

/// The sum as the controller means it: rotation and position element by element.
Pose sum_of(const Pose& a, const Pose& b) { return {a.R + b.R, a.p + b.p}; }
Pose difference_of(const Pose& a, const Pose& b) { return {a.R - b.R, a.p - b.p}; }

}  // namespace

std::size_t encode(const Monitoring& m, std::span<std::uint8_t> bytes) {
  if (bytes.size() < kMonitoringSize || m.joints != kJoints || m.state == SessionState::kIdle) return 0;
  Writer to(bytes.data());
  write_header(to, m.counter, m.reflected, kMonitoringSize, kMonitoringIdentifier);
  to.krl(m.krl);
  to.real(static_cast<double>(m.time) / 1e9);
  to.put(is_commanding(m.state) ? kCommanding : kMonitor);
  to.put(static_cast<std::uint16_t>(m.quality));
  to.real(m.send_period);
  to.real(m.command_period);
  to.real(m.safety_factor);
  to.real(m.answer_rate);
  to.real(m.latency);
  to.real(m.jitter);
  to.real(m.miss_rate);
  to.put(m.misses);
  std::uint16_t power = 0;
  for (std::size_t i = 0; i < kJoints; ++i) {
    if (m.drives[i] == DriveState::kActive) power = static_cast<std::uint16_t>(power | 1u << i);
  }
  to.put(power);
  to.put(number_of(m.control));
  to.put(m.errors);
  to.put(m.warnings);
  to.reals(m.temperature, kJoints);
  to.reals(m.q_measured, kJoints);
  to.frame(m.X_measured);
  to.reals(m.q_interpolator, kJoints);
  for (std::size_t i = 0; i < kJoints; ++i) to.real(m.q_commanded[i] - m.q_interpolator[i]);
  to.frame(m.X_interpolator);
  to.frame(difference_of(m.X_commanded, m.X_interpolator));
  to.reals(m.tau_measured, kJoints);
  to.reals(m.tau_external, kJoints);
  to.six(m.F_external);
  for (const std::size_t row : kIndexOfRotation) to.reals(&m.jacobian[7 * row], 7);
  to.reals(m.mass, m.mass.size());
  to.reals(m.gravity, kJoints);
  return kMonitoringSize;
}

Fault decode(std::span<const std::uint8_t> bytes, Monitoring& m) {
  if (bytes.size() != kMonitoringSize) return Fault::kSize;
  Reader from(bytes.data());
  const Header header = read_header(from);
  if (header.identifier != kMonitoringIdentifier) return Fault::kIdentifier;
  if (header.size != kMonitoringSize) return Fault::kSize;
  m.counter = header.counter;
  m.reflected = header.reflected;
  m.joints = kJoints;
  from.krl(m.krl);
  const double seconds = from.real();
  m.time = std::abs(seconds) < 1e9 ? std::llround(seconds * 1e9) : 0;
  const auto state = from.get<std::uint16_t>(), quality = from.get<std::uint16_t>();
  if ((state != kMonitor && state != kCommanding) || quality > static_cast<std::uint16_t>(Quality::kExcellent)) {
    return Fault::kValue;
  }
  m.quality = static_cast<Quality>(quality);
  m.state = state == kCommanding          ? SessionState::kCommandingActive
            : m.quality >= Quality::kGood ? SessionState::kMonitoringReady
                                          : SessionState::kMonitoringWait;
  m.send_period = from.real();
  m.receive_multiplier = 1;
  m.command_period = from.real();
  m.safety_factor = from.real();
  m.answer_rate = from.real();
  m.latency = from.real();
  m.jitter = from.real();
  m.miss_rate = from.real();
  m.misses = from.get<std::uint32_t>();
  const auto power = from.get<std::uint16_t>();
  for (std::size_t i = 0; i < kJoints; ++i) m.drives[i] = (power >> i & 1) != 0 ? DriveState::kActive : DriveState::kOff;
  m.control = control_mode_of(from.get<std::uint16_t>());
  m.errors = from.get<std::uint16_t>();
  m.warnings = from.get<std::uint16_t>();
  from.reals(m.temperature, kJoints);
  from.reals(m.q_measured, kJoints);
  from.frame(m.X_measured);
  from.reals(m.q_interpolator, kJoints);
  for (std::size_t i = 0; i < kJoints; ++i) m.q_commanded[i] = m.q_interpolator[i] + from.real();
  from.frame(m.X_interpolator);
  from.frame(m.X_commanded);
  m.X_commanded = sum_of(m.X_interpolator, m.X_commanded);
  from.reals(m.tau_measured, kJoints);
  from.reals(m.tau_external, kJoints);
  from.six(m.F_external);
  for (const std::size_t row : kIndexOfRotation) {
    double* to = &m.jacobian[7 * row];
    from.reals(to, 7);
  }
  from.reals(m.mass, m.mass.size());
  from.reals(m.gravity, kJoints);
  m.fields = Monitoring::kMeasuredPosition | Monitoring::kMeasuredTorque | Monitoring::kCommandedPosition |
             Monitoring::kExternalTorque | Monitoring::kInterpolatorPosition | Monitoring::kMeasuredPose |
             Monitoring::kCommandedPose | Monitoring::kInterpolatorPose | Monitoring::kExternalWrench | Monitoring::kTime |
             Monitoring::kControlMode | Monitoring::kDriveStates | Monitoring::kDynamics;
  m.transformations.count = m.ios.count = 0;
  return Fault::kNone;
}

std::size_t encode(const Command& c, std::span<std::uint8_t> bytes) {
  if (bytes.size() < kCommandSize || c.joints != kJoints) return 0;
  Writer to(bytes.data());
  write_header(to, c.counter, c.reflected, kCommandSize, kCommandIdentifier);
  to.krl(c.krl);
  std::uint32_t flags = 0;
  for (const Flag& flag : kFlags) flags |= c.has(flag.field) ? flag.wire : 0;
  to.put(flags);
  to.reals(c.q, kJoints);
  to.frame(c.X);
  to.reals(c.tau, kJoints);
  to.six(c.F);
  to.reals(c.joint_stiffness, kJoints);
  to.reals(c.joint_damping, kJoints);
  to.six(c.cartesian_stiffness);
  to.six(c.cartesian_damping);
  return kCommandSize;
}

Fault decode(std::span<const std::uint8_t> bytes, Command& c) {
  if (bytes.size() != kCommandSize) return Fault::kSize;
  Reader from(bytes.data());
  const Header header = read_header(from);
  if (header.identifier != kCommandIdentifier) return Fault::kIdentifier;
  if (header.size != kCommandSize) return Fault::kSize;
  c.counter = header.counter;
  c.reflected = header.reflected;
  c.joints = kJoints;
  from.krl(c.krl);
  const auto flags = from.get<std::uint32_t>();
  c.fields = 0;
  for (const Flag& flag : kFlags) c.fields |= (flags & flag.wire) != 0 ? flag.field : 0;
  from.reals(c.q, kJoints);
  from.frame(c.X);
  from.reals(c.tau, kJoints);
  from.six(c.F);
  from.reals(c.joint_stiffness, kJoints);
  from.reals(c.joint_damping, kJoints);
  from.six(c.cartesian_stiffness);
  from.six(c.cartesian_damping);
  c.transformations.count = c.ios.count = 0;
  return Fault::kNone;
}

}  // namespace cotwin::fri::lwr
