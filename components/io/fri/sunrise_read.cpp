// The reader of Sunrise's messages.
#include <Eigen/Geometry>
#include <algorithm>
#include <cstring>

#include "components/io/fri/crc.h"
#include "components/io/fri/protobuf.h"
#include "components/io/fri/sunrise.h"
#include "components/io/fri/sunrise_schema.h"

namespace cotwin::fri::sunrise {

namespace {

using protobuf::Reader;
using C = Command;
using M = Monitoring;

// Enumerations have the numbers of the wire; the first in a message of the other generation is the last here.
template <class Enumeration>
bool set_if_known(Reader& from, Enumeration last, Enumeration& value) {
  const std::uint64_t number = from.varint();
  if (number > static_cast<std::uint64_t>(last)) return false;
  value = static_cast<Enumeration>(number);
  return true;
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

/// The numbers of the message of the current field. True if there are values, and then exactly `n` of them.
template <std::size_t room>
bool read_reals(Reader& from, std::size_t n, std::array<double, room>& values) {
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
  if (!read_reals(from, values.size(), values)) return false;
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

/// False if there is no pose: without elements, or with a quaternion that is no rotation (all zero: unknown). Elements that are not
/// finite are passed on.
bool set_pose(Reader& from, const Schema& schema, const std::array<double, 12>& v, std::size_t count, Pose& X) {
  if (count == 0) return false;
  if (count != (schema.quaternions ? 7u : 12u)) {
    from.fail(Fault::kCount);
    return false;
  }
  if (schema.quaternions) {
    const Eigen::Quaterniond q(v[3], v[4], v[5], v[6]);
    const double norm = q.norm();
    if (norm <= 0.5 || norm >= 2) return false;
    X.R = Eigen::Quaterniond(q.coeffs() / norm).toRotationMatrix();
    X.p = Eigen::Vector3d(v[0], v[1], v[2]) * kMillimetre;
    return true;
  }
  for (Eigen::Index row = 0; row < 3; ++row) {
    const double* const values = &v[static_cast<std::size_t>(4 * row)];
    for (Eigen::Index column = 0; column < 3; ++column) X.R(row, column) = values[column];
    X.p[row] = values[3] * kMillimetre;
  }
  return true;
}

bool read_pose(Reader& from, const Schema& schema, Name& name, Pose& X, std::optional<std::int64_t>& time) {
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
  return from.fault() == Fault::kNone && set_pose(from, schema, values, count, X);
}

/// False also for versions without such a pose.
bool read_pose(Reader& from, const Schema& schema, Pose& X) {
  if (!schema.quaternions) {
    from.skip();
    return false;
  }
  Name name;
  std::optional<std::int64_t> time;
  return read_pose(from, schema, name, X, time);
}

void read_transformation(Reader& from, const Schema& schema, Few<Transformation, kMaxTransformations>& to) {
  Transformation* const t = to.add();
  if (t == nullptr) return from.fail(Fault::kCount);
  if (!read_pose(from, schema, t->name, t->pose, t->time)) from.fail(Fault::kValue);
}

/// False for versions without it.
bool read_redundancy(Reader& from, const Schema& schema, Redundancy& redundancy) {
  if (!schema.quaternions) {
    from.skip();
    return false;
  }
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
  return true;
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
    if (read_reals(inner, joints, values)) m.fields |= field;
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
        if (read_pose(inner, schema, m.X_measured)) m.fields |= M::kMeasuredPose;
        return;
      case monitor::kRedundancy:
        if (read_redundancy(inner, schema, m.redundancy_measured)) m.fields |= M::kMeasuredRedundancy;
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
        if (read_reals(inner, joints, m.q_interpolator)) m.fields |= M::kInterpolatorPosition;
        return;
      case ipo::kPose:
        if (read_pose(inner, schema, m.X_interpolator)) m.fields |= M::kInterpolatorPose;
        return;
      case ipo::kRedundancy:
        if (read_redundancy(inner, schema, m.redundancy_interpolator)) m.fields |= M::kInterpolatorRedundancy;
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
        if (read_reals(inner, joints, c.q)) c.fields |= C::kPosition;
        return;
      case command::kWrench:
        if (read_wrench(inner, c.F)) c.fields |= C::kWrench;
        return;
      case command::kTorque:
        if (read_reals(inner, joints, c.tau)) c.fields |= C::kTorque;
        return;
      case command::kTransformations:
        return read_transformation(inner, schema, c.transformations);
      case command::kIos:
        return schema.ios ? read_io(inner, c.ios) : inner.skip();
      case command::kPose:
        if (read_pose(inner, schema, c.X)) c.fields |= C::kPose;
        return;
      case command::kRedundancy:
        if (read_redundancy(inner, schema, c.redundancy)) c.fields |= C::kRedundancy;
        return;
      default:
        inner.skip();
    }
  });
}

}  // namespace

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
