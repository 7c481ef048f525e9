#pragma once
#include "components/io/fri/fri.h"

/// Codec of FRI 1.0 of the LWR 4+: packed little-endian structs of single floats. A monitoring message (MSR) has 916 bytes, a
/// command (CMD) 376. Rotational triples of wrenches, stiffness, damping and rows of the Jacobian are about z, y, x on the wire.
namespace cotwin::fri::lwr {

inline constexpr std::size_t kJoints = 7;
inline constexpr std::size_t kMonitoringSize = 916, kCommandSize = 376;  // bytes
inline constexpr std::uint16_t kMonitoringIdentifier = 0x2006, kCommandIdentifier = 0x1005;

std::size_t encode(const Monitoring& message, std::span<std::uint8_t> bytes);
std::size_t encode(const Command& message, std::span<std::uint8_t> bytes);
Fault decode(std::span<const std::uint8_t> bytes, Monitoring& message);
Fault decode(std::span<const std::uint8_t> bytes, Command& message);

}  // namespace cotwin::fri::lwr
