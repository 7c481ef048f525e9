#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

/// EtherCAT frames (ETG.1000.4): Ethernet header, EtherCAT header and up to 15 datagrams,
///   dst(6) src(6) 0x88A4 | length and type (2) | datagram: header(10) data working counter(2) | … | padding to 60 bytes,
/// without the frame check sequence. Nothing here allocates.
namespace cotwin::ethercat {

inline constexpr std::uint16_t kEtherType = 0x88A4;
inline constexpr std::size_t kFrameHeader = 16;       // bytes of the Ethernet and the EtherCAT header
inline constexpr std::size_t kDatagramHeader = 10;    // bytes
inline constexpr std::size_t kDatagramOverhead = 12;  // bytes of header and working counter
inline constexpr std::size_t kShortestFrame = 60;     // bytes, Ethernet
inline constexpr std::size_t kLongestFrame = 1514;    // bytes, Ethernet
inline constexpr std::size_t kMostDatagrams = 15;
inline constexpr std::size_t kLongestData = kLongestFrame - kFrameHeader - kDatagramOverhead;  // bytes of a single datagram

using MacAddress = std::array<std::uint8_t, 6>;
inline constexpr MacAddress kBroadcast = {0xff, 0xff, 0xff, 0xff, 0xff, 0xff};
/// Source address of frames of this master. Slaves set bit 1 of the first byte on the way.
inline constexpr MacAddress kMasterAddress = {0x01, 0x01, 0x01, 0x01, 0x01, 0x01};

enum class Command : std::uint8_t {
  kNop,
  kAprd,
  kApwr,
  kAprw,
  kFprd,
  kFpwr,
  kFprw,
  kBrd,
  kBwr,
  kBrw,
  kLrd,
  kLwr,
  kLrw,
  kArmw,
  kFrmw
};
inline constexpr std::uint8_t kLastCommand = 14;

constexpr bool is_logical(Command c) { return c == Command::kLrd || c == Command::kLwr || c == Command::kLrw; }

/// Address of a register or memory cell of a slave with a station address (FP… commands).
constexpr std::uint32_t at_station(std::uint16_t station, std::uint16_t offset) {
  return static_cast<std::uint32_t>(station) | static_cast<std::uint32_t>(offset) << 16;
}
/// The same for the slave with `position` slaves before it (AP… commands), or with position 0 for B… commands.
constexpr std::uint32_t at_position(std::uint16_t position, std::uint16_t offset) {
  return at_station(static_cast<std::uint16_t>(0u - position), offset);
}

/// One datagram of a frame. Its data are bytes [data, data + length) of the frame.
struct Datagram {
  Command command = Command::kNop;
  std::uint8_t index = 0;     // set by the master, unchanged by slaves
  std::uint32_t address = 0;  // logical, or at_station() or at_position()
  bool circulating = false;   // has passed a slave whose upstream port is closed
  std::uint16_t irq = 0;      // event requests of all slaves, combined by OR
  std::size_t data = 0;       // offset in the frame, bytes
  std::size_t length = 0;     // bytes
  std::uint16_t working_counter = 0;

  std::uint16_t station() const { return static_cast<std::uint16_t>(address); }
  std::uint16_t offset() const { return static_cast<std::uint16_t>(address >> 16); }
};

enum class FrameFault : std::uint8_t {
  kNone,
  kTooLong,      // longer than an Ethernet frame
  kNotEtherCat,  // shorter than its headers, or another Ethernet type
  kProtocol,     // not type 1 (datagrams) of EtherCAT
  kReserved,     // a reserved bit is set
  kCutShort,     // shorter than its header says
  kCutDatagram,  // a datagram reaches past the length in the header
  kCommand,      // unknown command
  kMore,         // the "more" bit is set in the last datagram, or bytes follow a datagram without it
  kTooMany,      // more than 15 datagrams
};

/// Reads the datagrams of a frame. The constructor checks the whole frame: a frame with a fault has no datagrams.
class FrameReader {
 public:
  /// Reserved bits are a fault, or ignored as slaves do.
  enum class Reserved : std::uint8_t { kFault, kIgnored };

  explicit FrameReader(std::span<const std::uint8_t> frame, Reserved reserved = Reserved::kFault);

  FrameFault fault() const { return fault_; }
  /// Sets `d` to the next datagram; false if there is none.
  bool next(Datagram& d);
  std::span<const std::uint8_t> data(const Datagram& d) const { return frame_.subspan(d.data, d.length); }

 private:
  FrameFault check(bool strict) const;

  std::span<const std::uint8_t> frame_;
  std::size_t at_ = kFrameHeader;  // of the next datagram
  std::size_t end_ = kFrameHeader;
  FrameFault fault_;
};

/// Writes a frame into a buffer of the caller: begin, add …, finish.
class FrameWriter {
 public:
  /// `buffer`: at least 60 bytes; bytes beyond 1514 are not used.
  explicit FrameWriter(std::span<std::uint8_t> buffer);

  /// Starts a frame without datagrams.
  void begin(const MacAddress& source = kMasterAddress, const MacAddress& destination = kBroadcast);
  /// Adds a datagram with `data`. Returns false and adds nothing if it does not fit.
  bool add(Command command, std::uint8_t index, std::uint32_t address, std::span<const std::uint8_t> data);
  /// Adds a datagram of `length` zero bytes (a read, or data that the caller sets). Returns the offset of its data in the buffer; 0 if
  /// it does not fit.
  std::size_t add(Command command, std::uint8_t index, std::uint32_t address, std::size_t length);
  /// Sets the length and pads. Returns the frame.
  std::span<const std::uint8_t> finish();

 private:
  std::span<std::uint8_t> buffer_;
  std::size_t end_ = kFrameHeader;
  std::size_t last_ = 0;  // offset of the last datagram; 0: none
  std::size_t count_ = 0;
};

/// Offsets from the beginning of a datagram, for slaves, which change these fields and the working counter in place.
inline constexpr std::size_t kAddressField = 2, kIrqField = 8;

}  // namespace cotwin::ethercat
