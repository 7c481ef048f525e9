// The writer of Sunrise's messages.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>

#include "components/io/fri/crc.h"
#include "components/io/fri/protobuf.h"
#include "components/io/fri/sunrise.h"
#include "components/io/fri/sunrise_schema.h"

namespace cotwin::fri::sunrise {

namespace {

using protobuf::Writer;
using C = Command;
using M = Monitoring;

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

}  // namespace cotwin::fri::sunrise
