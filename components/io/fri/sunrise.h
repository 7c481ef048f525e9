#pragma once
#include "components/io/fri/fri.h"

/// Codec of the FRI of Sunrise: Protocol Buffers messages in UDP datagrams of at most 1500 bytes. The versions differ:
///   1.11         no I/O values
///   1.14 … 1.16  one schema
///   2.x          poses as position and quaternion; no commanded joint position; measured and interpolated Cartesian pose
///   2.7          external wrench; a datagram is the length of the message (32 bits), the message and its CRC-32
/// Strict: a wrong identifier, another number of joints, a truncated field, a known field of another wire type and a missing
/// required field are faults. Unknown fields are skipped, unknown values of optional enumerations are ignored, repeated numbers
/// are read packed and unpacked and written unpacked.
namespace cotwin::fri::sunrise {

inline constexpr std::uint32_t kMonitoringIdentifier = 0x245142, kCommandIdentifier = 0x34001;

std::size_t encode(Protocol version, const Monitoring& message, std::span<std::uint8_t> bytes);
std::size_t encode(Protocol version, const Command& message, std::span<std::uint8_t> bytes);
Fault decode(Protocol version, std::span<const std::uint8_t> bytes, std::size_t joints, Monitoring& message);
Fault decode(Protocol version, std::span<const std::uint8_t> bytes, std::size_t joints, Command& message);

}  // namespace cotwin::fri::sunrise
