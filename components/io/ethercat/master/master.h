#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "components/io/ethercat/master/bus_setup.h"
#include "components/io/ethercat/master/sequence.h"

namespace cotwin::ethercat {

/// A cyclic EtherCAT master. In each cycle it sends one frame per segment of the process image,
///   FRMW system time of the reference | LRW process data | BRD AL status,
/// and reads the answers to the last ones. Slaves that leave OP are brought back with one datagram per cycle, in turn, while the others
/// go on.
/// Outputs are the safe ones (zeros, unless safe_outputs() was set) from the first cycle without all slaves in OP and the expected working
/// counter until all are back. Slaves that are still in OP get them.
/// After the constructor nothing allocates, waits or throws.
class Master {
 public:
  /// Happenings, counted from the start.
  struct Counters {
    std::int64_t cycles = 0;           // with frames sent
    std::int64_t lost = 0;             // cycles without all answers
    std::int64_t late = 0;             // answers that came after the next cycle began; their data are not used
    std::int64_t foreign = 0;          // frames that are no answers to this master, or damaged ones
    std::int64_t unsent = 0;           // frames that the interface did not take
    std::int64_t working_counter = 0;  // cycles with a wrong working counter
    std::int64_t slave_lost = 0;       // slaves that stopped answering
    std::int64_t slave_fault = 0;      // slaves that left OP with an error
    std::int64_t wrong_slave = 0;      // other devices found in the place of a slave, once until it is back
    std::int64_t unexpected = 0;       // times at which more slaves answered than there should be
    std::int64_t recovered = 0;        // slaves that were brought back to OP
    std::int64_t clock_steps = 0;      // times at which the reference clock went on elsewhere, and was followed
  };

  struct SlaveStatus {
    State state = State::kSafeOp;  // the last that was read
    bool present = true;
    bool down = false;            // lost, or left OP, and not yet back
    int restarts = 0;             // times that it was brought up from INIT during operation
    AlCode code = AlCode::kNone;  // of its last error
  };

  /// `cycle`: ns between two calls of cycle(). `patience`: ns without an answer after which the bus is not operational any more.
  Master(BusSetup bus, std::int64_t cycle, std::int64_t patience, BusTime time);

  /// Takes what the bus has answered, then sends the frames of the next cycle.
  void cycle(Wire& wire);
  /// Takes answers that come until `deadline`, or until all frames have been answered. Returns whether all have been.
  bool collect(Wire& wire, std::int64_t deadline);
  /// The end of operation: sends the safe outputs until they have arrived, then brings all slaves to SAFEOP, to INIT, and switches SYNC0
  /// off. Waits for answers, at most kLongestStop altogether. Returns whether all slaves answered that they are in INIT.
  bool stop(Wire& wire);
  static constexpr std::int64_t kLongestStop = 300'000'000;  // ns

  /// Of one slave, as they arrived in the last cycle with the expected working counter.
  std::span<const std::uint8_t> inputs(std::size_t slave) const;
  /// Of one slave, sent with the next cycle.
  std::span<std::uint8_t> outputs(std::size_t slave);

  /// Of one slave, sent instead of its outputs while the bus is not operational; zeros at first. A drive, for which zeros are no voltage, has a
  /// quick stop here.
  std::span<std::uint8_t> safe_outputs(std::size_t slave);

  /// Whether the safe outputs are sent instead of the outputs, also while the bus is operational.
  void hold_outputs(bool held) { held_ = held; }

  const BusSetup& bus() const { return bus_; }
  /// ns for which the outputs of the last cycle have been at the slaves, at least, when outputs that are sent at `now` reach them; 0 if its frames are
  /// not all back, so that a late one may still be on its way.
  std::int64_t output_interval(std::int64_t now) const;
  /// All slaves are in OP and the last cycle was complete.
  bool operational() const { return operational_; }
  /// The last cycle brought valid inputs.
  bool fresh() const { return fresh_; }
  /// Slaves that answer; 0 from the second cycle in a row without the answer that counts them.
  int present() const { return is_silent() ? 0 : answering_; }
  /// Whether the slave answers.
  bool present(std::size_t slave) const { return status_[slave].present && !is_silent(); }
  const Counters& counters() const { return counters_; }
  const SlaveStatus& status(std::size_t slave) const { return status_[slave]; }
  /// ns since 2000-01-01 at the reference clock, when the frame of the last cycle passed it; 0 without clocks or answer.
  std::int64_t system_time() const { return system_time_; }
  /// ns, Wire::now() in the middle between sending and receiving that frame.
  std::int64_t system_time_at() const { return system_time_at_; }
  /// Largest deviation from the reference that slaves report, ns (register 0x092C), of the last round over all slaves. Of each slave the
  /// smallest of its last three reports counts: damaged frames change nothing.
  std::int64_t clock_difference() const { return clock_difference_; }

 private:
  struct Frame {
    std::int64_t sent = 0, back = -1;  // ns, also of a damaged answer; -1: not yet
    bool answered = true;
    bool complete = false;  // with the expected working counters
  };
  /// What the datagram beside the cyclic ones is for.
  enum class AcyclicRequest : std::uint8_t { kNone, kState, kSequence, kDifference };
  /// The steps that bring a slave back.
  enum class Way : std::uint8_t { kNone, kAddress, kStart, kRun };
  struct Recovery {
    Way way = Way::kNone;
    Sequence sequence;
    std::int64_t retry = 0;  // ns; it is left alone until then
    bool wrong = false;      // another device is in its place
  };

  void take(std::span<const std::uint8_t> frame, std::int64_t now);
  bool is_silent() const { return unanswered_ >= 2; }
  bool is_answer(FrameReader reader, std::size_t segment, std::uint8_t index) const;
  bool is_intact(const FrameReader& frame, std::size_t segment) const;
  bool is_errand(const Datagram& d) const;
  void read_cyclic(const FrameReader& frame, std::uint8_t index, std::int64_t now);
  std::optional<std::int64_t> trip() const;
  void read_system_time(std::int64_t time, std::uint16_t working_counter, std::int64_t now);
  void read_acyclic(bool answered, std::uint16_t working_counter, std::span<const std::uint8_t> data, std::int64_t now);
  void close_cycle(std::int64_t now);
  bool all_in_op() const;
  bool all_answer() const;
  void send_frames(Wire& wire);
  void add_process_data(FrameWriter& writer, const Segment& s);
  void choose_errand(std::int64_t now);
  void send_errand(Wire& wire);
  bool is_confirmed(bool present, std::span<const std::uint8_t> data);
  void see_state(bool present, std::span<const std::uint8_t> data, std::int64_t now);
  void reach_op(std::size_t slave);
  void begin(std::size_t slave, Way way, std::int64_t now);
  void end_sequence(std::size_t slave, std::int64_t now);
  bool choose_recovery();
  std::optional<std::uint16_t> ask(Wire& wire, Command command, std::uint16_t offset, std::span<std::uint8_t> data,
                                   std::int64_t deadline);
  bool bring_all_to(Wire& wire, State state, std::int64_t deadline);

  static constexpr std::uint8_t kAcyclic = 0x80;  // indices of acyclic requests begin here

  BusSetup bus_;
  std::int64_t patience_;
  BusTime time_;
  std::vector<std::uint8_t> inputs_, outputs_, safe_outputs_, sent_outputs_;
  std::vector<Frame> frames_;  // one per segment, at least one
  std::vector<SlaveStatus> status_;
  std::vector<Recovery> recoveries_;  // per slave
  Counters counters_;
  std::array<std::uint8_t, kLongestFrame> buffer_{};
  std::uint8_t index_ = 0;  // of the cyclic datagrams: 0 to 127; acyclic requests have 128 to 255
  bool sent_ = false;       // a cycle waits for answers
  bool operational_ = false, fresh_ = false, held_ = false;
  bool watching_ = true;  // something is wrong: the states of the slaves are read one by one
  bool crowded_ = false;  // more slaves answer than there should be
  std::int64_t last_good_ = 0;
  std::int64_t least_trip_ = 0;      // ns of the frames of a cycle from sending to the last answer, lately; 0: not known
  int counted_ = 0, answering_ = 0;  // slaves in the last answer, and in two of them in a row
  int unanswered_ = 0;               // cycles in a row without the answer that counts them
  // FPRD while the reference clock is not to be followed, and after each cycle in which it was not read.
  Command time_command_ = Command::kFprd;
  bool reference_read_ = false;  // a plausible time came with the last cycle
  std::int64_t sent_time_ = 0;   // ns, that slaves take over if the reference does not replace it
  BusTime elsewhere_;            // the last time of the reference that was not plausible
  int elsewhere_answers_ = 0;    // in a row that go on from one another
  std::uint8_t states_ = 0;      // of all slaves, combined by OR
  std::int64_t system_time_ = 0, system_time_at_ = 0;
  std::int64_t clock_difference_ = 0, difference_ = 0;  // of the last round over the slaves, of this one
  std::vector<std::array<std::int64_t, 2>> reported_;   // ns, by each slave before, the newer one first

  AcyclicRequest acyclic_ = AcyclicRequest::kNone;
  bool acyclic_open_ = false;  // it waits for its answer
  std::uint8_t acyclic_index_ = 128;
  std::array<Datagram, 128> acyclic_sent_;  // the last ones, by their indices
  std::size_t looked_at_ = 0;               // slave of kState and kDifference
  std::array<std::uint8_t, 7> doubted_{};   // its answer that is asked for once more: whether it is present, AL status and code
  bool look_again_ = false;
  std::size_t recovering_ = 0;  // slave of kSequence
  int turn_ = 0;                // acyclic requests since the last one for the states, while slaves are brought back
};

}  // namespace cotwin::ethercat
