#include "components/io/ethercat/frame.h"

#include <algorithm>
#include <cassert>
#include <cstring>

#include "components/io/ethercat/little_endian.h"

namespace cotwin::ethercat {

namespace {

constexpr std::uint16_t kLengthBits = 0x07ff;
constexpr std::uint16_t kFrameReserved = 0x0800;
constexpr std::uint16_t kDatagramReserved = 0x3800;
constexpr std::uint16_t kCirculating = 0x4000;
constexpr std::uint16_t kMore = 0x8000;
constexpr std::uint16_t kDatagramProtocol = 1;

}  // namespace

FrameReader::FrameReader(std::span<const std::uint8_t> frame, Reserved reserved)
    : frame_(frame), fault_(check(reserved == Reserved::kFault)) {
  if (fault_ == FrameFault::kNone) end_ += load<std::uint16_t>(&frame_[14]) & kLengthBits;
}

FrameFault FrameReader::check(bool strict) const {
  if (frame_.size() > kLongestFrame) return FrameFault::kTooLong;
  if (frame_.size() < kFrameHeader || frame_[12] != (kEtherType >> 8) || frame_[13] != (kEtherType & 0xff))
    return FrameFault::kNotEtherCat;
  const auto header = load<std::uint16_t>(&frame_[14]);
  if (header >> 12 != kDatagramProtocol) return FrameFault::kProtocol;
  if (strict && (header & kFrameReserved)) return FrameFault::kReserved;
  std::size_t left = header & kLengthBits;
  if (left > frame_.size() - kFrameHeader) return FrameFault::kCutShort;
  const std::uint8_t* d = frame_.data() + kFrameHeader;
  for (std::size_t count = 0;; ++count) {
    if (count == kMostDatagrams) return FrameFault::kTooMany;
    if (left < kDatagramOverhead) return FrameFault::kCutDatagram;
    const auto bits = load<std::uint16_t>(d + 6);
    const std::size_t size = (bits & kLengthBits) + kDatagramOverhead;
    if (d[0] > kLastCommand) return FrameFault::kCommand;
    if (strict && (bits & kDatagramReserved)) return FrameFault::kReserved;
    if (size > left) return FrameFault::kCutDatagram;
    left -= size;
    d += size;
    if (((bits & kMore) != 0) != (left != 0)) return FrameFault::kMore;
    if (left == 0) return FrameFault::kNone;
  }
}

bool FrameReader::next(Datagram& d) {
  if (at_ >= end_) return false;
  const std::uint8_t* const from = frame_.data() + at_;
  const auto bits = load<std::uint16_t>(from + 6);
  d.command = static_cast<Command>(from[0]);
  d.index = from[1];
  d.address = load<std::uint32_t>(from + kAddressField);
  d.circulating = (bits & kCirculating) != 0;
  d.irq = load<std::uint16_t>(from + kIrqField);
  d.data = at_ + kDatagramHeader;
  d.length = bits & kLengthBits;
  d.working_counter = load<std::uint16_t>(from + kDatagramHeader + d.length);
  at_ += d.length + kDatagramOverhead;
  return true;
}

FrameWriter::FrameWriter(std::span<std::uint8_t> buffer) : buffer_(buffer.first(std::min(buffer.size(), kLongestFrame))) {
  assert(buffer.size() >= kShortestFrame);
}

void FrameWriter::begin(const MacAddress& source, const MacAddress& destination) {
  std::copy(destination.begin(), destination.end(), buffer_.begin());
  std::copy(source.begin(), source.end(), buffer_.begin() + 6);
  buffer_[12] = kEtherType >> 8;
  buffer_[13] = kEtherType & 0xff;
  end_ = kFrameHeader;
  last_ = count_ = 0;
}

bool FrameWriter::add(Command command, std::uint8_t index, std::uint32_t address, std::span<const std::uint8_t> data) {
  const std::size_t at = add(command, index, address, data.size());
  if (at != 0) std::copy(data.begin(), data.end(), buffer_.begin() + static_cast<std::ptrdiff_t>(at));
  return at != 0;
}

std::size_t FrameWriter::add(Command command, std::uint8_t index, std::uint32_t address, std::size_t length) {
  if (count_ == kMostDatagrams || buffer_.size() - end_ < kDatagramOverhead + length) return 0;
  if (last_ != 0) buffer_[last_ + 7] |= kMore >> 8;
  std::uint8_t* const to = buffer_.data() + end_;
  to[0] = static_cast<std::uint8_t>(command);
  to[1] = index;
  store(to + kAddressField, address);
  store(to + 6, static_cast<std::uint16_t>(length));
  std::memset(to + kIrqField, 0, length + kDatagramOverhead - kIrqField);
  last_ = end_;
  end_ += length + kDatagramOverhead;
  ++count_;
  return last_ + kDatagramHeader;
}

std::span<const std::uint8_t> FrameWriter::finish() {
  store(&buffer_[14], static_cast<std::uint16_t>((end_ - kFrameHeader) | kDatagramProtocol << 12));
  const std::size_t size = std::max(end_, kShortestFrame);
  std::fill(buffer_.begin() + static_cast<std::ptrdiff_t>(end_), buffer_.begin() + static_cast<std::ptrdiff_t>(size),
            std::uint8_t{0});
  return buffer_.first(size);
}

}  // namespace cotwin::ethercat
