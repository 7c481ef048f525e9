#pragma once
#include <cstdint>
#include <cstdlib>
#include <span>
#include <string>
#include <vector>

#include "components/io/ethercat/coe.h"
#include "components/io/ethercat/frame.h"
#include "components/io/ethercat/registers.h"

/// What a master sends to bring one slave from a state to another: datagram by datagram, so that it can be done at once when the bus is
/// set up, or with one datagram per cycle when a slave comes back during operation.
namespace cotwin::ethercat {

/// Sum and difference of times that slaves send, modulo 2⁶⁴ as their clocks count: a damaged one may be anything.
inline std::int64_t sum(std::int64_t a, std::int64_t b) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(a) + static_cast<std::uint64_t>(b));
}
inline std::int64_t difference(std::int64_t a, std::int64_t b) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(a) - static_cast<std::uint64_t>(b));
}

/// Times of the bus that a slave's clock is set from.
struct BusTime {
  std::uint16_t reference = 0;  // station address of the first slave with a clock; 0: none
  std::int64_t system = 0;      // ns since 2000-01-01, at `host`
  std::int64_t host = 0;        // ns, Wire::now()
  std::int64_t at(std::int64_t now) const { return sum(system, now - host); }
  /// Whether the reference clock can show `time` at `now`: 10 ms off, and 500 ppm of the time since the last answer, by which its
  /// crystal and the host's may have come apart.
  bool is_plausible(std::int64_t time, std::int64_t now) const {
    const std::int64_t off = difference(time, at(now)), most = 10'000'000 + std::abs(now - host) / 2000;
    return -most <= off && off <= most;
  }
};

/// One datagram, repeated until its answer fits or `timeout` is over.
struct Step {
  enum class Kind : std::uint8_t {
    kDatagram,     // done if the working counter is 1 and the answer fits
    kState,        // reads AL status; ends with an error if the slave reports one
    kMail,         // reads an answer to an SDO; ends with an error if the slave aborts
    kLatch,        // makes all slaves latch their receive times
    kReadLocal,    // local time of the slave at the latch
    kReadSystem,   // local time of the reference at the latch, and its offset
    kWriteOffset,  // system − local
    kReadNow,      // system time of the slave
    kWriteStart,   // begin of SYNC0: the next multiple of its cycle after a lead has passed, and its shift
    kCheckStart,   // system time of the slave; fits if it is before that begin
  };

  Kind kind = Kind::kDatagram;
  Command command = Command::kNop;
  std::uint32_t address = 0;
  std::vector<std::uint8_t> data;  // sent
  std::vector<std::uint8_t> mask,
      expected;  // answer fits if (answer & mask) == expected; shorter than the data: the rest does not count
  std::int64_t timeout = 1'000'000'000;  // ns
  std::size_t back = 0;                  // steps to go back if the answer does not fit
  std::uint16_t least = 1;               // working counter of broadcasts
  bool may_refuse = false;               // a mailbox, which is not accessible while it is full or empty
  bool identity = false;                 // an answer that does not fit is final: it is another device
  std::uint32_t repeat = 0;              // of a mail, and the wait for it: address of the activate byte of its sync manager
  std::string what;                      // for messages: "go to PREOP"
};

/// The values of SYNC0 and delay that computed steps use.
struct SlaveTimes {
  std::uint32_t delay = 0;       // ns from the reference
  std::int64_t sync0_cycle = 0;  // ns
  std::int64_t sync0_shift = 0;  // ns
  bool is_reference = false;
};

class Sequence {
 public:
  enum class Status : std::uint8_t { kBusy, kDone, kFailed };

  /// `steps` must outlive the sequence.
  void start(std::span<const Step> steps, const SlaveTimes& times, std::int64_t now);
  Status status() const { return status_; }

  Command command() const { return repeating_ ? Command::kFpwr : step().command; }
  std::uint32_t address() const { return repeating_ ? step().repeat : step().address; }
  /// The data of the next datagram. Allocates nothing after it was reserved.
  std::span<const std::uint8_t> data() const { return data_; }
  /// Takes the answer to the last datagram; `answered`: false if it was lost. Updates `time` if the sequence read the reference.
  Status receive(bool answered, std::uint16_t working_counter, std::span<const std::uint8_t> answer, BusTime& time,
                 std::int64_t now);
  /// The longest datagram that sequences may have, bytes. Call once before cyclic operation.
  void reserve(std::size_t bytes) { data_.reserve(bytes); }

  /// Its next datagram makes all slaves latch their receive times.
  bool latches() const { return status_ == Status::kBusy && step().kind == Step::Kind::kLatch; }
  /// It has made them do so and has not read all of them yet: nobody else may.
  bool holds_latch() const { return holds_latch_ && status_ == Status::kBusy; }

  /// After kFailed: the AL status code, if the slave gave one, and whether it answered that it is another device.
  AlCode al_code() const { return al_code_; }
  bool found_another() const { return !silent_ && !absent_ && step().identity; }
  /// "slave 2 (EL5101, axis) did not go to PREOP: AL status code 0x0016".
  std::string failure() const;

 private:
  const Step& step() const { return steps_[at_]; }
  Status fail() { return status_ = Status::kFailed; }
  bool note_absence(std::int64_t now);
  void read_value(std::span<const std::uint8_t> answer, std::int64_t now);
  std::int64_t sync0_cycle() const;
  std::int64_t sync_lead() const;
  void prepare(const BusTime& time);
  bool fits(std::span<const std::uint8_t> answer, const BusTime& time) const;
  void go_back(const BusTime& time);

  std::span<const Step> steps_;
  SlaveTimes times_;
  std::size_t at_ = 0, furthest_ = 0;
  std::int64_t deadline_ = 0;
  std::vector<std::uint8_t> data_;
  Status status_ = Status::kDone;
  AlCode al_code_ = AlCode::kNone;
  SdoAbort abort_ = SdoAbort::kNone;
  bool silent_ = true;
  int refusals_ = 0;  // answers in a row with which no slave took the datagram
  std::int64_t refused_since_ = 0;
  bool absent_ = false;
  bool repeat_ = false, repeating_ = false;  // bit of the sync manager; it is written now
  bool asked_again_ = false;                 // it was written while no mail came
  bool holds_latch_ = false;
  std::int64_t sync_start_ = 0;          // ns, system time of the first SYNC0
  std::int64_t latched_at_ = 0;          // ns, Wire::now()
  std::int64_t local_ = 0, system_ = 0;  // ns, at the latch; system_ also: now
};

}  // namespace cotwin::ethercat
