#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>

#include "components/io/fri/fri.h"

/// What the writer and the reader of Sunrise's messages share.
namespace cotwin::fri::sunrise {

inline constexpr double kMillimetre = 1e-3;  // m
inline constexpr Eigen::Index kIndexOfRotation[6] = {0, 1, 2,
                                                     5, 4, 3};  // x y z A B C on the wire: A about z, B about y, C about x
inline constexpr std::size_t kFrame = 4;                        // bytes of the length, and of the checksum
inline constexpr std::int64_t kSecond = 1'000'000'000;          // ns

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

}  // namespace cotwin::fri::sunrise
