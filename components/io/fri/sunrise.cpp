#include "components/io/fri/sunrise.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>

#include "components/io/fri/crc.h"
#include "components/io/fri/protobuf.h"

namespace cotwin::fri::sunrise {

namespace {

using protobuf::Reader;
using protobuf::Writer;
using M = Monitoring;
using C = Command;

constexpr double kMillimetre = 1e-3;                              // m
constexpr Eigen::Index kIndexOfRotation[6] = {0, 1, 2, 5, 4, 3};  // x y z A B C on the wire: A about z, B about y, C about x
constexpr std::size_t kFrame = 4;                                 // bytes of the length, and of the checksum
constexpr std::int64_t kSecond = 1'000'000'000;                   // ns

/// What differs between the versions.
struct Schema {
  bool ios, quaternions, external_wrench, framed;
};

constexpr Schema schema_of(Protocol version) {
  const bool two = version >= Protocol::kSunrise2_5;
  return {version != Protocol::kSunrise1_11, two, version == Protocol::kSunrise2_7, version == Protocol::kSunrise2_7};
}

// Field numbers of the messages.
namespace message {
enum : std::uint32_t { kHeader = 1, kRobotInfo, kMonitorData, kConnectionInfo, kIpoData, kTransformations };
}
namespace monitor {
enum : std::uint32_t {
  kMeasuredPosition = 1,
  kMeasuredTorque,
  kCommandedPosition,
  kCommandedTorque,
  kExternalTorque,
  kExternalForce,
  kIos = 8,
  kMeasuredPose,
  kRedundancy,
  kTimestamp = 15
};
}
namespace ipo {
enum : std::uint32_t { kPosition = 1, kPose, kRedundancy, kCommandMode = 10, kOverlay, kTracking };
}
namespace info {
enum : std::uint32_t { kJoints = 1, kSafety, kDrives = 5, kOperation, kControl };
}
namespace command {
enum : std::uint32_t { kPosition = 1, kWrench, kTorque, kTransformations, kIos, kPose, kRedundancy };
}

// Enumerations have the numbers of the wire; the first in a message of the other generation is the last here.
template <class Enumeration>
bool set_if_known(Reader& from, Enumeration last, Enumeration& value) {
  const std::uint64_t number = from.varint();
  if (number > static_cast<std::uint64_t>(last)) return false;
  value = static_cast<Enumeration>(number);
  return true;
}

template <class Enumeration>
std::uint64_t number_of(Enumeration value) {
  return static_cast<std::uint64_t>(value);
}

void write_joints(Writer& to, std::uint32_t field, const Joints& values, std::size_t n) {
  to.message(field, [&] { to.reals(1, values.data(), n); });
}

void write_wrench(Writer& to, std::uint32_t field, const Wrench& F) {
  to.message(field, [&] {
    for (const Eigen::Index i : kIndexOfRotation) to.real(1, F[i]);
  });
}

void write_time(Writer& to, std::uint32_t field, std::int64_t time) {
  to.message(field, [&] {
    const std::int64_t t = std::max<std::int64_t>(time, 0);
    to.varint(1, static_cast<std::uint32_t>(t / kSecond));
    to.varint(2, static_cast<std::uint32_t>(t % kSecond));
  });
}

/// 3 × 4 row-major, or position and quaternion (w, x, y, z).
void write_pose(Writer& to, const Schema& schema, std::uint32_t field, std::string_view name, const Pose& X,
                std::optional<std::int64_t> time) {
  to.message(field, [&] {
    to.text(1, name);
    if (schema.quaternions) {
      for (Eigen::Index i = 0; i < 3; ++i) to.real(2, X.p[i] / kMillimetre);
      const Eigen::Quaterniond q = Eigen::Quaterniond(X.R).normalized();
      for (const double value : {q.w(), q.x(), q.y(), q.z()}) to.real(2, value);
    } else {
      for (Eigen::Index row = 0; row < 3; ++row) {
        for (Eigen::Index column = 0; column < 3; ++column) to.real(2, X.R(row, column));
        to.real(2, X.p[row] / kMillimetre);
      }
    }
    if (time) write_time(to, 3, *time);
  });
}

void write_redundancy(Writer& to, std::uint32_t field, const Redundancy& redundancy) {
  to.message(field, [&] {
    to.integer(1, redundancy.strategy);
    to.real(2, redundancy.value);
  });
}

void write_io(Writer& to, std::uint32_t field, const Io& value) {
  to.message(field, [&] {
    to.text(1, value.name.view());
    to.varint(2, number_of(value.type));
    to.varint(3, number_of(value.direction));
    if (value.type == Io::Type::kAnalog) {
      to.real(5, value.analog);
    } else {
      to.varint(4, value.digital);
    }
  });
}

void write_header(Writer& to, std::uint32_t identifier, std::uint32_t counter, std::uint32_t reflected) {
  to.message(message::kHeader, [&] {
    to.varint(1, identifier);
    to.varint(2, counter);
    to.varint(3, reflected);
  });
}

bool has_joints(std::uint32_t joints) { return joints >= 1 && joints <= kMaxJoints; }

/// The message by `content` with the frame of the version. Returns the size of the datagram, or 0.
template <class Content>
std::size_t write_datagram(const Schema& schema, std::span<std::uint8_t> bytes, Content&& content) {
  bytes = bytes.first(std::min(bytes.size(), kMaxDatagram));
  const std::size_t frame = schema.framed ? kFrame : 0;
  if (bytes.size() < 2 * frame) return 0;
  Writer to(bytes.subspan(frame, bytes.size() - 2 * frame));
  content(to);
  if (!to.ok()) return 0;
  if (frame == 0) return to.size();
  const auto length = static_cast<std::uint32_t>(to.size());
  const std::uint32_t crc = crc32(bytes.subspan(frame, length));
  std::memcpy(bytes.data(), &length, sizeof length);
  std::memcpy(bytes.data() + frame + length, &crc, sizeof crc);
  return length + 2 * frame;
}

/// Takes the frame away.
Fault unframe(const Schema& schema, std::span<const std::uint8_t>& bytes) {
  if (bytes.size() > kMaxDatagram) return Fault::kSize;
  if (!schema.framed) return Fault::kNone;
  std::uint32_t length = 0, crc = 0;
  if (bytes.size() < 2 * kFrame) return Fault::kSize;
  std::memcpy(&length, bytes.data(), sizeof length);
  if (length != bytes.size() - 2 * kFrame) return Fault::kSize;
  std::memcpy(&crc, bytes.data() + kFrame + length, sizeof crc);
  bytes = bytes.subspan(kFrame, length);
  return crc32(bytes) == crc ? Fault::kNone : Fault::kChecksum;
}

/// Reads the message of the current field with `content`, which gets its reader.
template <class Content>
void read_message(Reader& from, Content&& content) {
  Reader inner(from.bytes());
  while (inner.next()) content(inner);
  from.fail(inner.fault());
}

/// True if there are values, and then exactly `n` of them.
bool read_joints(Reader& from, std::size_t n, Joints& values) {
  std::size_t count = 0;
  read_message(from, [&](Reader& inner) {
    if (inner.field() == 1) {
      inner.reals(values, count);
    } else {
      inner.skip();
    }
  });
  if (count != 0 && count != n) from.fail(Fault::kCount);
  return count == n;
}

bool read_wrench(Reader& from, Wrench& F) {
  std::array<double, 6> values{};
  std::size_t count = 0;
  read_message(from, [&](Reader& inner) {
    if (inner.field() == 1) {
      inner.reals(values, count);
    } else {
      inner.skip();
    }
  });
  if (count != 0 && count != values.size()) from.fail(Fault::kCount);
  if (count != values.size()) return false;
  for (std::size_t i = 0; i < values.size(); ++i) F[kIndexOfRotation[i]] = values[i];
  return true;
}

std::int64_t read_time(Reader& from) {
  std::uint32_t seconds = 0, nanoseconds = 0, seen = 0;
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case 1:
        seconds = inner.natural(), seen |= 1;
        break;
      case 2:
        nanoseconds = inner.natural(), seen |= 2;
        break;
      default:
        inner.skip();
    }
  });
  if (seen != 3) from.fail(Fault::kMissing);
  return static_cast<std::int64_t>(seconds) * kSecond + nanoseconds;
}

void read_name(Reader& from, Name& name) {
  const std::span<const std::uint8_t> bytes = from.bytes();
  if (!name.assign({reinterpret_cast<const char*>(bytes.data()), bytes.size()})) from.fail(Fault::kCount);
}

void set_pose(Reader& from, const Schema& schema, const std::array<double, 12>& v, std::size_t count, Pose& X) {
  if (schema.quaternions) {
    if (count != 7) return from.fail(Fault::kCount);
    const Eigen::Quaterniond q(v[3], v[4], v[5], v[6]);
    const double norm = q.norm();
    if (!(norm > 0.5 && norm < 2)) return from.fail(Fault::kValue);
    X.R = Eigen::Quaterniond(q.coeffs() / norm).toRotationMatrix();
    X.p = Eigen::Vector3d(v[0], v[1], v[2]) * kMillimetre;
    return;
  }
  if (count != 12) return from.fail(Fault::kCount);
  for (Eigen::Index row = 0; row < 3; ++row) {
    const double* const values = &v[static_cast<std::size_t>(4 * row)];
    for (Eigen::Index column = 0; column < 3; ++column) X.R(row, column) = values[column];
    X.p[row] = values[3] * kMillimetre;
  }
}

void read_pose(Reader& from, const Schema& schema, Name& name, Pose& X, std::optional<std::int64_t>& time) {
  std::array<double, 12> values{};
  std::size_t count = 0;
  bool named = false;
  time.reset();
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case 1:
        read_name(inner, name), named = true;
        break;
      case 2:
        inner.reals(values, count);
        break;
      case 3:
        time = read_time(inner);
        break;
      default:
        inner.skip();
    }
  });
  if (!named) from.fail(Fault::kMissing);
  if (from.fault() == Fault::kNone) set_pose(from, schema, values, count, X);
}

void read_pose(Reader& from, const Schema& schema, Pose& X) {
  Name name;
  std::optional<std::int64_t> time;
  read_pose(from, schema, name, X, time);
}

void read_transformation(Reader& from, const Schema& schema, Few<Transformation, kMaxTransformations>& to) {
  Transformation* const t = to.add();
  if (t == nullptr) return from.fail(Fault::kCount);
  read_pose(from, schema, t->name, t->pose, t->time);
}

void read_redundancy(Reader& from, Redundancy& redundancy) {
  std::uint32_t seen = 0;
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case 1:
        redundancy.strategy = inner.integer(), seen |= 1;
        break;
      case 2:
        redundancy.value = inner.real(), seen |= 2;
        break;
      default:
        inner.skip();
    }
  });
  if (seen != 3) from.fail(Fault::kMissing);
}

void read_io(Reader& from, Few<Io, kMaxIos>& to) {
  Io* const value = to.add();
  if (value == nullptr) return from.fail(Fault::kCount);
  *value = {};
  std::uint32_t seen = 0;
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case 1:
        read_name(inner, value->name), seen |= 1;
        break;
      case 2:
        seen |= set_if_known(inner, Io::Type::kAnalog, value->type) ? 2u : 0u;
        break;
      case 3:
        seen |= set_if_known(inner, Io::Direction::kOutput, value->direction) ? 4u : 0u;
        break;
      case 4:
        value->digital = inner.varint();
        break;
      case 5:
        value->analog = inner.real();
        break;
      default:
        inner.skip();
    }
  });
  if (seen != 7) from.fail(Fault::kMissing);
}

void read_header(Reader& from, std::uint32_t identifier, std::uint32_t& counter, std::uint32_t& reflected) {
  std::uint32_t seen = 0;
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case 1:
        if (inner.natural() != identifier) inner.fail(Fault::kIdentifier);
        seen |= 1;
        break;
      case 2:
        counter = inner.natural(), seen |= 2;
        break;
      case 3:
        reflected = inner.natural(), seen |= 4;
        break;
      default:
        inner.skip();
    }
  });
  if (seen != 7) from.fail(Fault::kMissing);
}

void read_robot_info(Reader& from, std::size_t joints, Monitoring& m) {
  std::size_t drives = 0;
  const auto add_drive = [&](std::uint64_t number) {
    if (drives < joints) m.drives[drives] = static_cast<DriveState>(std::min<std::uint64_t>(number, 2));
    ++drives;
  };
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case info::kJoints:
        if (inner.integer() != static_cast<std::int32_t>(joints)) inner.fail(Fault::kCount);
        break;
      case info::kSafety:
        if (set_if_known(inner, SafetyState::kStopLevel2, m.safety)) m.fields |= M::kSafetyState;
        break;
      case info::kDrives:
        inner.numbers(add_drive);
        break;
      case info::kOperation:
        if (set_if_known(inner, OperationMode::kAutomatic, m.operation)) m.fields |= M::kOperationMode;
        break;
      case info::kControl:
        if (set_if_known(inner, ControlMode::kNone, m.control)) m.fields |= M::kControlMode;
        break;
      default:
        inner.skip();
    }
  });
  if (drives == joints) m.fields |= M::kDriveStates;
  if (drives > joints) from.fail(Fault::kCount);
}

void read_monitor_data(Reader& from, const Schema& schema, std::size_t joints, Monitoring& m) {
  const auto vector = [&](Reader& inner, Joints& values, std::uint32_t field) {
    if (read_joints(inner, joints, values)) m.fields |= field;
  };
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case monitor::kMeasuredPosition:
        return vector(inner, m.q_measured, M::kMeasuredPosition);
      case monitor::kMeasuredTorque:
        return vector(inner, m.tau_measured, M::kMeasuredTorque);
      case monitor::kCommandedPosition:
        return schema.quaternions ? inner.skip() : vector(inner, m.q_commanded, M::kCommandedPosition);
      case monitor::kCommandedTorque:
        return vector(inner, m.tau_commanded, M::kCommandedTorque);
      case monitor::kExternalTorque:
        return vector(inner, m.tau_external, M::kExternalTorque);
      case monitor::kExternalForce:
        if (!schema.external_wrench) return inner.skip();
        if (read_wrench(inner, m.F_external)) m.fields |= M::kExternalWrench;
        return;
      case monitor::kIos:
        return schema.ios ? read_io(inner, m.ios) : inner.skip();
      case monitor::kMeasuredPose:
        if (!schema.quaternions) return inner.skip();
        read_pose(inner, schema, m.X_measured);
        m.fields |= M::kMeasuredPose;
        return;
      case monitor::kRedundancy:
        if (!schema.quaternions) return inner.skip();
        read_redundancy(inner, m.redundancy_measured);
        m.fields |= M::kMeasuredRedundancy;
        return;
      case monitor::kTimestamp:
        m.time = read_time(inner);
        m.fields |= M::kTime;
        return;
      default:
        inner.skip();
    }
  });
}

void read_ipo_data(Reader& from, const Schema& schema, std::size_t joints, Monitoring& m) {
  const ClientCommandMode last = schema.quaternions ? ClientCommandMode::kCartesianPose : ClientCommandMode::kTorque;
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case ipo::kPosition:
        if (read_joints(inner, joints, m.q_interpolator)) m.fields |= M::kInterpolatorPosition;
        return;
      case ipo::kPose:
        if (!schema.quaternions) return inner.skip();
        read_pose(inner, schema, m.X_interpolator);
        m.fields |= M::kInterpolatorPose;
        return;
      case ipo::kRedundancy:
        if (!schema.quaternions) return inner.skip();
        read_redundancy(inner, m.redundancy_interpolator);
        m.fields |= M::kInterpolatorRedundancy;
        return;
      case ipo::kCommandMode:
        if (set_if_known(inner, last, m.command_mode)) m.fields |= M::kCommandMode;
        return;
      case ipo::kOverlay:
        if (set_if_known(inner, OverlayType::kCartesian, m.overlay)) m.fields |= M::kOverlay;
        return;
      case ipo::kTracking:
        m.tracking_performance = inner.real();
        m.fields |= M::kTracking;
        return;
      default:
        inner.skip();
    }
  });
}

void read_connection(Reader& from, Monitoring& m) {
  std::uint32_t seen = 0;
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case 1:
        if (!set_if_known(inner, SessionState::kCommandingActive, m.state)) inner.fail(Fault::kValue);
        seen |= 1;
        break;
      case 2:
        if (!set_if_known(inner, Quality::kExcellent, m.quality)) inner.fail(Fault::kValue);
        seen |= 2;
        break;
      case 3:
        m.send_period = static_cast<double>(inner.natural()) * 1e-3;
        break;
      case 4:
        m.receive_multiplier = std::max(1u, inner.natural());
        break;
      default:
        inner.skip();
    }
  });
  if (seen != 3) from.fail(Fault::kMissing);
}

void read_command_data(Reader& from, const Schema& schema, std::size_t joints, Command& c) {
  read_message(from, [&](Reader& inner) {
    switch (inner.field()) {
      case command::kPosition:
        if (read_joints(inner, joints, c.q)) c.fields |= C::kPosition;
        return;
      case command::kWrench:
        if (read_wrench(inner, c.F)) c.fields |= C::kWrench;
        return;
      case command::kTorque:
        if (read_joints(inner, joints, c.tau)) c.fields |= C::kTorque;
        return;
      case command::kTransformations:
        return read_transformation(inner, schema, c.transformations);
      case command::kIos:
        return schema.ios ? read_io(inner, c.ios) : inner.skip();
      case command::kPose:
        if (!schema.quaternions) return inner.skip();
        read_pose(inner, schema, c.X);
        c.fields |= C::kPose;
        return;
      case command::kRedundancy:
        if (!schema.quaternions) return inner.skip();
        read_redundancy(inner, c.redundancy);
        c.fields |= C::kRedundancy;
        return;
      default:
        inner.skip();
    }
  });
}

}  // namespace

std::size_t encode(Protocol version, const Monitoring& m, std::span<std::uint8_t> bytes) {
  const Schema schema = schema_of(version);
  const std::size_t n = m.joints;
  if (!has_joints(m.joints)) return 0;
  return write_datagram(schema, bytes, [&](Writer& to) {
    write_header(to, kMonitoringIdentifier, m.counter, m.reflected);
    to.message(message::kRobotInfo, [&] {
      to.integer(info::kJoints, static_cast<std::int32_t>(n));
      if (m.has(M::kSafetyState)) to.varint(info::kSafety, number_of(m.safety));
      if (m.has(M::kDriveStates)) {
        for (std::size_t i = 0; i < n; ++i) to.varint(info::kDrives, number_of(m.drives[i]));
      }
      if (m.has(M::kOperationMode)) to.varint(info::kOperation, number_of(m.operation));
      if (m.has(M::kControlMode)) to.varint(info::kControl, number_of(m.control));
    });
    to.message(message::kMonitorData, [&] {
      if (m.has(M::kMeasuredPosition)) write_joints(to, monitor::kMeasuredPosition, m.q_measured, n);
      if (m.has(M::kMeasuredTorque)) write_joints(to, monitor::kMeasuredTorque, m.tau_measured, n);
      if (m.has(M::kCommandedPosition) && !schema.quaternions) {
        write_joints(to, monitor::kCommandedPosition, m.q_commanded, n);
      }
      if (m.has(M::kCommandedTorque)) write_joints(to, monitor::kCommandedTorque, m.tau_commanded, n);
      if (m.has(M::kExternalTorque)) write_joints(to, monitor::kExternalTorque, m.tau_external, n);
      if (m.has(M::kExternalWrench) && schema.external_wrench) write_wrench(to, monitor::kExternalForce, m.F_external);
      if (schema.ios) {
        for (const Io& value : m.ios.all()) write_io(to, monitor::kIos, value);
      }
      if (m.has(M::kMeasuredPose) && schema.quaternions) write_pose(to, schema, monitor::kMeasuredPose, "", m.X_measured, {});
      if (m.has(M::kMeasuredRedundancy) && schema.quaternions) {
        write_redundancy(to, monitor::kRedundancy, m.redundancy_measured);
      }
      if (m.has(M::kTime)) write_time(to, monitor::kTimestamp, m.time);
    });
    to.message(message::kConnectionInfo, [&] {
      to.varint(1, number_of(m.state));
      to.varint(2, number_of(m.quality));
      to.varint(3, static_cast<std::uint32_t>(std::lround(m.send_period * 1e3)));
      to.varint(4, m.receive_multiplier);
    });
    if (is_commanding(m.state)) {
      to.message(message::kIpoData, [&] {
        if (m.has(M::kInterpolatorPosition)) write_joints(to, ipo::kPosition, m.q_interpolator, n);
        if (m.has(M::kInterpolatorPose) && schema.quaternions) write_pose(to, schema, ipo::kPose, "", m.X_interpolator, {});
        if (m.has(M::kInterpolatorRedundancy) && schema.quaternions) {
          write_redundancy(to, ipo::kRedundancy, m.redundancy_interpolator);
        }
        if (m.has(M::kCommandMode)) to.varint(ipo::kCommandMode, number_of(m.command_mode));
        if (m.has(M::kOverlay)) to.varint(ipo::kOverlay, number_of(m.overlay));
        if (m.has(M::kTracking)) to.real(ipo::kTracking, m.tracking_performance);
      });
    }
    for (const Transformation& t : m.transformations.all()) {
      write_pose(to, schema, message::kTransformations, t.name.view(), t.pose, t.time);
    }
  });
}

Fault decode(Protocol version, std::span<const std::uint8_t> bytes, std::size_t joints, Monitoring& m) {
  const Schema schema = schema_of(version);
  if (const Fault fault = unframe(schema, bytes); fault != Fault::kNone) return fault;
  m.fields = 0;
  m.joints = static_cast<std::uint32_t>(joints);
  m.send_period = 0;
  m.receive_multiplier = 1;
  m.transformations.count = m.ios.count = 0;
  std::uint32_t seen = 0;
  Reader from(bytes);
  while (from.next()) {
    switch (from.field()) {
      case message::kHeader:
        read_header(from, kMonitoringIdentifier, m.counter, m.reflected), seen |= 1;
        break;
      case message::kRobotInfo:
        read_robot_info(from, joints, m);
        break;
      case message::kMonitorData:
        read_monitor_data(from, schema, joints, m);
        break;
      case message::kConnectionInfo:
        read_connection(from, m), seen |= 2;
        break;
      case message::kIpoData:
        read_ipo_data(from, schema, joints, m);
        break;
      case message::kTransformations:
        read_transformation(from, schema, m.transformations);
        break;
      default:
        from.skip();
    }
  }
  if (seen != 3) from.fail(Fault::kMissing);
  m.command_period = m.send_period * m.receive_multiplier;
  return from.fault();
}

std::size_t encode(Protocol version, const Command& c, std::span<std::uint8_t> bytes) {
  const Schema schema = schema_of(version);
  if (!has_joints(c.joints)) return 0;
  const std::uint32_t fields =
      c.fields & (schema.quaternions ? C::kPosition | C::kTorque | C::kWrench | C::kPose | C::kRedundancy
                                     : C::kPosition | C::kTorque | C::kWrench);
  const bool empty = fields == 0 && c.transformations.count == 0 && (c.ios.count == 0 || !schema.ios);
  return write_datagram(schema, bytes, [&](Writer& to) {
    write_header(to, kCommandIdentifier, c.counter, c.reflected);
    if (empty) return;
    to.message(2, [&] {
      if ((fields & C::kPosition) != 0) write_joints(to, command::kPosition, c.q, c.joints);
      if ((fields & C::kWrench) != 0) write_wrench(to, command::kWrench, c.F);
      if ((fields & C::kTorque) != 0) write_joints(to, command::kTorque, c.tau, c.joints);
      for (const Transformation& t : c.transformations.all()) {
        write_pose(to, schema, command::kTransformations, t.name.view(), t.pose, t.time);
      }
      if (schema.ios) {
        for (const Io& value : c.ios.all()) write_io(to, command::kIos, value);
      }
      if ((fields & C::kPose) != 0) write_pose(to, schema, command::kPose, "", c.X, {});
      if ((fields & C::kRedundancy) != 0) write_redundancy(to, command::kRedundancy, c.redundancy);
    });
  });
}

Fault decode(Protocol version, std::span<const std::uint8_t> bytes, std::size_t joints, Command& c) {
  const Schema schema = schema_of(version);
  if (const Fault fault = unframe(schema, bytes); fault != Fault::kNone) return fault;
  c.fields = 0;
  c.joints = static_cast<std::uint32_t>(joints);
  c.transformations.count = c.ios.count = 0;
  bool header = false;
  Reader from(bytes);
  while (from.next()) {
    switch (from.field()) {
      case message::kHeader:
        read_header(from, kCommandIdentifier, c.counter, c.reflected), header = true;
        break;
      case 2:
        read_command_data(from, schema, joints, c);
        break;
      default:
        from.skip();
    }
  }
  if (!header) from.fail(Fault::kMissing);
  return from.fault();
}

}  // namespace cotwin::fri::sunrise
