#include "components/bus/udp_transport.h"

#include <algorithm>
#include <cstring>
#include <optional>

#include "components/bus/state_database.h"

namespace cotwin::bus {

namespace {

constexpr std::uint32_t kFrameMagic = 0x52465443;  // "CTFR"
constexpr int kMostDropped = 10'000;               // datagrams at a restart, in case a sender never stops

struct FragmentHeader {
  std::uint32_t magic = kFrameMagic, message = 0;
  std::uint16_t index = 0, count = 0;
  std::uint32_t bytes = 0;
};
static_assert(sizeof(FragmentHeader) == UdpTransport::kHeader);

std::size_t fragments_of(std::size_t bytes) {
  return std::max<std::size_t>((bytes + UdpTransport::kFragment - 1) / UdpTransport::kFragment, 1);
}

}  // namespace

UdpTransport::UdpTransport(net::Endpoint local, net::Endpoint peer, const std::string& place)
    : socket_(local, place), peer_(peer), next_(static_cast<std::uint32_t>(new_session())), datagram_(kHeader + kFragment + 1) {
  for (Partial& p : partials_) p.buffer.resize(max_bytes());
}

void UdpTransport::restart(net::Endpoint peer) {
  for (int i = 0; i < kMostDropped && socket_.receive(datagram_); ++i) {
  }
  for (Partial& p : partials_) p.open = false;
  whole_.fill(std::nullopt);
  peer_ = peer;
  counts_ = {};
}

bool UdpTransport::send(std::span<const std::byte> message) {
  if (message.size() > max_bytes()) return false;
  FragmentHeader h;
  h.message = next_++;
  h.count = static_cast<std::uint16_t>(fragments_of(message.size()));
  h.bytes = static_cast<std::uint32_t>(message.size());
  for (; h.index < h.count; ++h.index) {
    const std::size_t size = std::min(kFragment, message.size());
    std::memcpy(datagram_.data(), &h, kHeader);
    if (size > 0) std::memcpy(datagram_.data() + kHeader, message.data(), size);
    message = message.subspan(size);
    if (!socket_.send(std::span(datagram_).first(kHeader + size), peer_)) {
      ++counts_.unsent;
      return false;
    }
    ++counts_.sent;
    counts_.sent_bytes += kHeader + size;
  }
  return true;
}

std::span<const std::byte> UdpTransport::receive() {
  std::span<const std::byte> message;
  while (examined_ < kMostAtOnce && read_datagram(message)) {
    ++examined_;
    if (!message.empty()) return message;
  }
  examined_ = 0;
  return {};
}

/// False: no datagram has arrived. `message`: the one that it completes.
bool UdpTransport::read_datagram(std::span<const std::byte>& message) {
  const std::optional<net::UdpSocket::Received> datagram = socket_.receive(datagram_);
  if (!datagram) return false;
  if (datagram->from != peer_) {
    ++counts_.foreign;
    return true;
  }
  ++counts_.received;
  counts_.received_bytes += datagram->size;
  message = add_fragment(std::as_bytes(std::span(datagram_).first(std::min(datagram->size, datagram_.size()))));
  return true;
}

/// The partial message with this number: a new one takes the place of the oldest.
UdpTransport::Partial& UdpTransport::partial_of(std::uint32_t message) {
  for (Partial& p : partials_)
    if (p.open && p.message == message) return p;
  Partial& p = partials_[oldest_];
  oldest_ = (oldest_ + 1) % partials_.size();
  if (p.open) ++counts_.incomplete;
  p.open = false;
  return p;
}

std::span<const std::byte> UdpTransport::add_fragment(std::span<const std::byte> datagram) {
  FragmentHeader h;
  const auto damaged = [&]() -> std::span<const std::byte> {
    ++counts_.damaged;
    return {};
  };
  if (datagram.size() < kHeader) return damaged();
  std::memcpy(&h, datagram.data(), kHeader);
  const std::span<const std::byte> part = datagram.subspan(kHeader);
  if (h.magic != kFrameMagic || h.count > kMaxFragments || h.index >= h.count || h.count != fragments_of(h.bytes))
    return damaged();
  const std::size_t offset = h.index * kFragment;
  if (part.size() != std::min<std::size_t>(kFragment, h.bytes - offset)) return damaged();
  if (h.count == 1) return part;
  if (std::find(whole_.begin(), whole_.end(), h.message) != whole_.end()) return {};  // doubled

  Partial& p = partial_of(h.message);
  if (!p.open) {
    p.open = true;
    p.message = h.message;
    p.bytes = h.bytes;
    p.missing = (std::uint64_t{1} << h.count) - 1;
  }
  if (p.bytes != h.bytes) return damaged();
  std::memcpy(p.buffer.data() + offset, part.data(), part.size());
  p.missing &= ~(std::uint64_t{1} << h.index);
  if (p.missing != 0) return {};
  p.open = false;
  last_whole_ = (last_whole_ + 1) % whole_.size();
  whole_[last_whole_] = h.message;
  return std::span(p.buffer).first(p.bytes);
}

}  // namespace cotwin::bus
