#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

/// The messages of a state database, wire format 2. All numbers little-endian, without padding:
///   0  u32  magic "CTST"           24  i64  epoch
///   4  u8   wire format: 2         32  u64  version
///   5  u8   kind                   40  u64  base
///   6  u16  0                      48  u32  number of runs
///   8  u64  hash of the layout     52  u32  bytes after the header
///  16  u64  session of the owner
/// and then
///   kUpdate   runs, ascending and apart: u32 offset, u32 length, bytes. base: version to which they are applied; base = version:
///             nothing changed, only the epoch
///   kFull     u32 length of the layout's text, text, the whole image. base: number of the request that it answers
///   kRequest  u32 length of the layout's text, text. version: that of the reader, 0 without one. base: number of the request. From
///             reader to owner
namespace cotwin::bus {

struct StateMessage {
  enum class Kind : std::uint8_t { kUpdate = 1, kFull = 2, kRequest = 3 };

  Kind kind = Kind::kUpdate;
  std::uint64_t layout = 0;   // hash
  std::uint64_t session = 0;  // of the owner: differs after its restart
  std::int64_t epoch = 0;     // of the owner: tick or time, does not decrease within a session
  std::uint64_t version = 0;  // number of changes of the owner's states, from 1
  std::uint64_t base =
      0;  // version to which an update is applied; number of a request, and of the one that a full copy answers
  std::uint32_t runs = 0;
  std::span<const std::byte> payload;  // runs of an update, image of a full copy
  std::string_view text;               // layout of a full copy or a request
};

constexpr std::uint8_t kStateWireFormat = 2;
constexpr std::size_t kStateHeader = 56;  // bytes
constexpr std::size_t kRunHeader = 8;     // bytes

/// Whether bytes are a state message of any wire format, and of which: 0 if they are none.
std::uint8_t state_wire_format(std::span<const std::byte> bytes);

/// Reads a message; the views in it are into `bytes`. False: `bytes` are damaged or of another wire format. The runs of an update
/// are checked against an image of `image_bytes`, and a full copy must have this size, but only if the hash of the layout is
/// `layout`.
bool decode(std::span<const std::byte> bytes, std::uint64_t layout, std::size_t image_bytes, StateMessage& message);

/// Writes the runs of a decoded update into the image, which has the checked size.
void write_runs(const StateMessage& update, std::span<std::byte> image);

/// Writes the header for a payload of `payload_bytes`, of which `runs` are runs, to the beginning of `to`.
void write_header(std::span<std::byte> to, const StateMessage& message, std::size_t payload_bytes);

}  // namespace cotwin::bus
