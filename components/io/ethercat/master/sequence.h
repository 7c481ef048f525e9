#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "components/io/ethercat/coe.h"
#include "components/io/ethercat/frame.h"
#include "components/io/ethercat/registers.h"

/// What a master sends to bring one slave from a state to another: datagram by datagram, so that it can be done at once when the bus is
/// set up, or with one datagram per cycle when a slave comes back during operation.
namespace cotwin::ethercat {

/// Times of the bus that a slave's clock is set from.
struct BusTime {
  std::uint16_t reference = 0;  // station address of the first slave with a clock; 0: none
  std::int64_t system = 0;      // ns since 2000-01-01, at `host`
  std::int64_t host = 0;        // ns, Wire::now()
  std::int64_t at(std::int64_t now) const { return system + (now - host); }
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
    kWriteStart,   // begin of SYNC0: the next multiple of its cycle after `lead` has passed, and its shift
  };

  Kind kind = Kind::kDatagram;
  Command command = Command::kNop;
  std::uint32_t address = 0;
  std::vector<std::uint8_t> data;  // sent
  std::vector<std::uint8_t> mask,
      expected;  // answer fits if (answer & mask) == expected; shorter than the data: the rest does not count
  std::int64_t timeout = 1'000'000'000;  // ns
  std::size_t back = 0;                  // steps to go back if the answer does not fit
  const char* what = "";                 // for messages: "go to PREOP"
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

  Command command() const { return step().command; }
  std::uint32_t address() const { return step().address; }
  /// The data of the next datagram. Allocates nothing after it was reserved.
  std::span<const std::uint8_t> data() const { return data_; }
  /// Takes the answer to the last datagram; `answered`: false if it was lost. Updates `time` if the sequence read the reference.
  Status receive(bool answered, std::uint16_t working_counter, std::span<const std::uint8_t> answer, BusTime& time,
                 std::int64_t now);
  /// The longest datagram that sequences may have, bytes. Call once before cyclic operation.
  void reserve(std::size_t bytes) { data_.reserve(bytes); }

  /// After kFailed: the AL status code, if the slave gave one, and whether it answered at all.
  AlCode al_code() const { return al_code_; }
  bool answered_otherwise() const { return !silent_; }
  /// "slave 2 (EL5101, axis) did not go to PREOP: AL status code 0x0016".
  std::string failure() const;

 private:
  const Step& step() const { return steps_[at_]; }
  void prepare(const BusTime& time);
  bool fits(std::span<const std::uint8_t> answer) const;

  std::span<const Step> steps_;
  SlaveTimes times_;
  std::size_t at_ = 0;
  std::int64_t deadline_ = 0;
  std::vector<std::uint8_t> data_;
  Status status_ = Status::kDone;
  AlCode al_code_ = AlCode::kNone;
  SdoAbort abort_ = SdoAbort::kNone;
  bool silent_ = true;
  std::int64_t latched_at_ = 0;          // ns, Wire::now()
  std::int64_t local_ = 0, system_ = 0;  // ns, at the latch; system_ also: now
};

}  // namespace cotwin::ethercat
