#include "components/bus/state_message.h"

#include <bit>
#include <cstring>

namespace cotwin::bus {

static_assert(std::endian::native == std::endian::little, "messages hold values as they are in memory");

namespace {

constexpr std::uint32_t kStateMagic = 0x54535443;  // "CTST"

template <class T>
T read_at(std::span<const std::byte> bytes, std::size_t place) {
  T value;
  std::memcpy(&value, bytes.data() + place, sizeof value);
  return value;
}

template <class T>
void write_at(std::span<std::byte> bytes, std::size_t place, T value) {
  std::memcpy(bytes.data() + place, &value, sizeof value);
}

bool runs_fit(std::span<const std::byte> payload, std::uint32_t runs, std::size_t image_bytes) {
  std::size_t end = 0;  // of the run before
  for (std::uint32_t i = 0; i < runs; ++i) {
    if (payload.size() < kRunHeader) return false;
    const std::size_t offset = read_at<std::uint32_t>(payload, 0), length = read_at<std::uint32_t>(payload, 4);
    payload = payload.subspan(kRunHeader);
    if (length == 0 || length > payload.size() || offset > image_bytes || length > image_bytes - offset) return false;
    if (i > 0 && offset <= end) return false;
    end = offset + length;
    payload = payload.subspan(length);
  }
  return payload.empty();
}

}  // namespace

std::uint8_t state_wire_format(std::span<const std::byte> bytes) {
  return bytes.size() >= 5 && read_at<std::uint32_t>(bytes, 0) == kStateMagic ? read_at<std::uint8_t>(bytes, 4)
                                                                              : std::uint8_t{0};
}

bool decode(std::span<const std::byte> bytes, std::uint64_t layout, std::size_t image_bytes, StateMessage& m) {
  if (bytes.size() < kStateHeader || state_wire_format(bytes) != kStateWireFormat) return false;
  const auto kind = read_at<std::uint8_t>(bytes, 5);
  if (kind < 1 || kind > 3 || read_at<std::uint16_t>(bytes, 6) != 0) return false;
  m.kind = static_cast<StateMessage::Kind>(kind);
  m.layout = read_at<std::uint64_t>(bytes, 8);
  m.session = read_at<std::uint64_t>(bytes, 16);
  m.epoch = read_at<std::int64_t>(bytes, 24);
  m.version = read_at<std::uint64_t>(bytes, 32);
  m.base = read_at<std::uint64_t>(bytes, 40);
  m.runs = read_at<std::uint32_t>(bytes, 48);
  m.payload = bytes.subspan(kStateHeader);
  m.text = {};
  if (m.payload.size() != read_at<std::uint32_t>(bytes, 52)) return false;
  if (m.kind == StateMessage::Kind::kUpdate) {
    const bool consistent = m.version >= 1 && (m.base == m.version ? m.runs == 0 : m.base + 1 == m.version && m.runs > 0);
    return consistent && (m.layout != layout || runs_fit(m.payload, m.runs, image_bytes));
  }
  if (m.runs != 0 || m.payload.size() < sizeof(std::uint32_t)) return false;
  const std::size_t length = read_at<std::uint32_t>(m.payload, 0);
  m.payload = m.payload.subspan(sizeof(std::uint32_t));
  if (length > m.payload.size()) return false;
  m.text = {reinterpret_cast<const char*>(m.payload.data()), length};
  m.payload = m.payload.subspan(length);
  if (m.kind == StateMessage::Kind::kRequest) return m.payload.empty();
  return m.version >= 1 && (m.layout != layout || m.payload.size() == image_bytes);
}

void write_runs(const StateMessage& update, std::span<std::byte> image) {
  std::span<const std::byte> rest = update.payload;
  while (!rest.empty()) {
    const std::size_t offset = read_at<std::uint32_t>(rest, 0), length = read_at<std::uint32_t>(rest, 4);
    std::memcpy(image.data() + offset, rest.data() + kRunHeader, length);
    rest = rest.subspan(kRunHeader + length);
  }
}

void write_header(std::span<std::byte> to, const StateMessage& m, std::size_t payload_bytes) {
  write_at<std::uint32_t>(to, 0, kStateMagic);
  write_at<std::uint8_t>(to, 4, kStateWireFormat);
  write_at<std::uint8_t>(to, 5, static_cast<std::uint8_t>(m.kind));
  write_at<std::uint16_t>(to, 6, 0);
  write_at<std::uint64_t>(to, 8, m.layout);
  write_at<std::uint64_t>(to, 16, m.session);
  write_at<std::int64_t>(to, 24, m.epoch);
  write_at<std::uint64_t>(to, 32, m.version);
  write_at<std::uint64_t>(to, 40, m.base);
  write_at<std::uint32_t>(to, 48, m.runs);
  write_at<std::uint32_t>(to, 52, static_cast<std::uint32_t>(payload_bytes));
}

}  // namespace cotwin::bus
