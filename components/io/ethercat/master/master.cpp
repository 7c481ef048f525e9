#include "components/io/ethercat/master/master.h"

#include <algorithm>
#include <utility>

#include "components/io/ethercat/little_endian.h"

namespace cotwin::ethercat {

namespace {

constexpr int kMostFrames = 64;               // that a cycle reads
constexpr int kAnswersElsewhere = 50;         // of the reference clock in a row after which a step of it is followed
constexpr std::int64_t kRetry = 100'000'000;  // ns from a failed recovery to the next attempt
constexpr int kTurns = 4;                     // one in so many acyclic requests reads the states, while slaves are brought back
constexpr std::uint8_t kAllOp = static_cast<std::uint8_t>(State::kOp);

}  // namespace

Master::Master(BusSetup bus, std::int64_t cycle, std::int64_t patience, BusTime time)
    : bus_(std::move(bus)), patience_(std::max(cycle, patience)), time_(time) {
  inputs_.resize(bus_.input_bytes);
  outputs_.resize(bus_.output_bytes);
  safe_outputs_.resize(bus_.output_bytes);
  sent_outputs_.resize(bus_.output_bytes);
  reported_.resize(bus_.slaves.size());
  frames_.resize(std::max<std::size_t>(bus_.segments.size(), 1));
  status_.resize(bus_.slaves.size());
  recoveries_.resize(bus_.slaves.size());
  for (Recovery& r : recoveries_) r.sequence.reserve(kLongestFrame);
  if (bus_.reference >= 0) time_.reference = bus_.slaves[static_cast<std::size_t>(bus_.reference)].found.station;
}

std::span<const std::uint8_t> Master::inputs(std::size_t slave) const {
  const BusSlave& s = bus_.slaves[slave];
  return std::span(inputs_).subspan(s.inputs_at, s.setup.input_bytes);
}

std::span<std::uint8_t> Master::outputs(std::size_t slave) {
  const BusSlave& s = bus_.slaves[slave];
  return std::span(outputs_).subspan(s.outputs_at, s.setup.output_bytes);
}

std::span<std::uint8_t> Master::safe_outputs(std::size_t slave) {
  const BusSlave& s = bus_.slaves[slave];
  return std::span(safe_outputs_).subspan(s.outputs_at, s.setup.output_bytes);
}

void Master::cycle(Wire& wire) {
  collect(wire, 0);
  const std::int64_t now = wire.now();
  if (sent_) close_cycle(now);
  if (acyclic_open_) read_acyclic(false, 0, {}, now);
  choose_errand(now);
  send_frames(wire);
  send_errand(wire);
}

bool Master::collect(Wire& wire, std::int64_t deadline) {
  const auto all_answered = [&] {
    return std::all_of(frames_.begin(), frames_.end(), [](const Frame& f) { return f.answered; });
  };
  // A deadline of 0 takes everything that has come; another one is over when all answers are here.
  for (int n = 0; n < kMostFrames && (deadline == 0 || !all_answered()); ++n) {
    const std::size_t size = wire.receive(buffer_, deadline);
    if (size == 0) break;
    take(std::span<const std::uint8_t>(buffer_).first(size), wire.received_at());
  }
  return all_answered();
}

void Master::take(std::span<const std::uint8_t> frame, std::int64_t now) {
  FrameReader reader(frame);
  Datagram d;
  if (!reader.next(d)) {
    ++counters_.foreign;
    return;
  }
  if (d.index >= kAcyclic) {
    if (!is_errand(d)) {
      ++counters_.foreign;
    } else if (acyclic_open_ && d.index == acyclic_index_) {
      read_acyclic(true, d.working_counter, reader.data(d), now);
    } else {
      ++counters_.late;
    }
    return;
  }
  read_cyclic(FrameReader(frame), d.index, std::max(now, frames_[0].sent));
}

/// Whether the datagrams of an answer are those that are sent for a segment in this cycle or in another one. Slaves change the address of
/// broadcasts only.
bool Master::is_answer(FrameReader reader, std::size_t segment, std::uint8_t index) const {
  Datagram d;
  const auto next_is = [&](Command command, std::size_t length) {
    return reader.next(d) && d.command == command && d.length == length && d.index == index;
  };
  if (segment == 0) {
    if (bus_.reference >= 0) {
      const bool time = reader.next(d) && (d.command == Command::kFrmw || d.command == Command::kFprd) && d.length == 8;
      if (!time || d.address != at_station(time_.reference, reg::kSystemTime)) return false;
    }
    if (!(next_is(Command::kBrd, 2) && d.offset() == reg::kAlStatus)) return false;
  }
  if (segment < bus_.segments.size()) {
    const Segment& s = bus_.segments[segment];
    if (s.combined) {
      if (!(next_is(Command::kLrw, s.output_bytes + s.input_bytes) && d.address == s.logical)) return false;
    } else {
      if (s.output_bytes > 0 && !(next_is(Command::kLwr, s.output_bytes) && d.address == s.logical)) return false;
      const std::uint32_t inputs = s.logical + static_cast<std::uint32_t>(s.output_bytes);
      if (s.input_bytes > 0 && !(next_is(Command::kLrd, s.input_bytes) && d.address == inputs)) return false;
    }
  }
  return !reader.next(d);
}

/// Whether the outputs come back as they were sent: slaves do not change them. The checksum of Ethernet is not seen here, and not every interface
/// checks it.
bool Master::is_intact(const FrameReader& frame, std::size_t segment) const {
  if (segment >= bus_.segments.size()) return true;
  const Segment& s = bus_.segments[segment];
  FrameReader reader = frame;
  Datagram d;
  while (reader.next(d)) {
    if (d.command != Command::kLrw && d.command != Command::kLwr) continue;
    const std::span<const std::uint8_t> data = reader.data(d).first(s.output_bytes);
    if (!std::equal(data.begin(), data.end(), sent_outputs_.begin() + static_cast<std::ptrdiff_t>(s.outputs_at))) return false;
  }
  return true;
}

/// Whether a datagram is that of the last acyclic request with its index. Slaves change the position in the address, and the offset never.
bool Master::is_errand(const Datagram& d) const {
  const Datagram& sent = acyclic_sent_[d.index - kAcyclic];
  const bool by_position = d.command == Command::kAprd || d.command == Command::kApwr || d.command == Command::kBwr;
  return d.command == sent.command && d.length == sent.length &&
         (by_position ? d.offset() == sent.offset() : d.address == sent.address);
}

void Master::read_cyclic(const FrameReader& frame, std::uint8_t index, std::int64_t now) {
  std::size_t segment = 0;
  while (segment < frames_.size() && !is_answer(frame, segment, index)) ++segment;
  if (segment == frames_.size()) {
    ++counters_.foreign;
    return;
  }
  FrameReader reader = frame;
  Datagram d;
  const bool other_command = segment == 0 && bus_.reference >= 0 && reader.next(d) && d.command != time_command_;
  reader = frame;
  if (!sent_ || index != index_ || other_command || frames_[segment].answered) {
    ++counters_.late;
    return;
  }
  frames_[segment].back = now;
  if (!is_intact(frame, segment)) {
    ++counters_.foreign;
    return;
  }
  bool complete = true;
  std::span<const std::uint8_t> arriving;
  while (reader.next(d)) {
    const std::span<const std::uint8_t> data = reader.data(d);
    if (d.command == time_command_) {
      read_system_time(load<std::int64_t>(data.data()), d.working_counter, now);
    } else if (d.command == Command::kBrd) {
      states_ = data[0];
      if (counted_ == d.working_counter) answering_ = counted_;
      counted_ = d.working_counter;
    } else {
      const Segment& s = bus_.segments[segment];
      const bool writes = d.command == Command::kLwr;
      if (d.working_counter != (writes ? s.write_count : s.expected())) complete = false;
      if (!writes) arriving = data.last(s.input_bytes);
    }
  }
  frames_[segment].answered = true;
  frames_[segment].complete = complete;
  if (complete && !arriving.empty()) {
    std::copy(arriving.begin(), arriving.end(),
              inputs_.begin() + static_cast<std::ptrdiff_t>(bus_.segments[segment].inputs_at));
  }
}

/// The time of the reference clock, if it is plausible: a reference that was switched off answers with the time since then, and the writes of
/// the others count even if it does not answer at all. After a gap in the host's clock (a suspended machine) it is never plausible again,
/// so that of a reference which did not restart is taken when it has gone on evenly for a while.
void Master::read_system_time(std::int64_t time, std::uint16_t working_counter, std::int64_t now) {
  const std::int64_t middle = std::min(frames_[0].sent + (now - frames_[0].sent) / 2, now);
  if (working_counter == 0 || (time_command_ == Command::kFrmw && time == sent_time_)) return;
  if (!time_.is_plausible(time, middle)) {
    const bool even = elsewhere_answers_ > 0 && elsewhere_.is_plausible(time, middle);
    elsewhere_answers_ = even ? elsewhere_answers_ + 1 : 1;
    elsewhere_.system = time;
    elsewhere_.host = middle;
    if (elsewhere_answers_ < kAnswersElsewhere || status_[static_cast<std::size_t>(bus_.reference)].down) return;
    ++counters_.clock_steps;
  }
  elsewhere_answers_ = 0;
  reference_read_ = true;
  system_time_ = time_.system = time;
  system_time_at_ = time_.host = middle;
}

/// ns from sending the first frame of the last cycle to the last answer; nothing while one is missing.
std::optional<std::int64_t> Master::trip() const {
  std::int64_t last = 0;
  for (const Frame& f : frames_) {
    if (f.back < 0) return std::nullopt;
    last = std::max(last, f.back - frames_[0].sent);
  }
  return last;
}

std::int64_t Master::output_interval(std::int64_t now) const {
  const std::optional<std::int64_t> last = trip();
  if (!last) return 0;
  // What the last trip took longer than others counts for the way to the slaves.
  const std::int64_t excess = least_trip_ > 0 ? std::max<std::int64_t>(*last - least_trip_, 0) : 0;
  return std::max<std::int64_t>(now - frames_[0].sent - excess, 0);
}

void Master::close_cycle(std::int64_t now) {
  constexpr std::int64_t kMemory = 1000;  // cycles
  sent_ = false;
  if (const std::optional<std::int64_t> last = trip()) {
    const bool longer = least_trip_ > 0 && *last > least_trip_;
    least_trip_ = longer ? least_trip_ + (*last - least_trip_) / kMemory : *last;
  }
  bool answered = true, complete = true, wrong = false;
  for (const Frame& f : frames_) {
    answered = answered && f.answered;
    complete = complete && f.complete;
    wrong = wrong || (f.answered && !f.complete);
  }
  if (!answered) ++counters_.lost;
  unanswered_ = frames_[0].answered ? 0 : std::min(unanswered_ + 1, 2);
  if (wrong) ++counters_.working_counter;
  const int slaves = static_cast<int>(bus_.slaves.size());
  if (frames_[0].answered && answering_ > slaves && !crowded_) ++counters_.unexpected;
  if (frames_[0].answered) crowded_ = answering_ > slaves;
  fresh_ = answered && complete;
  const bool bad = wrong || (frames_[0].answered && (counted_ != slaves || states_ != kAllOp));
  const bool good = fresh_ && !bad;
  if (good) {
    last_good_ = now;
    operational_ = all_in_op();
  } else if (bad || now - last_good_ > patience_) {
    // A lost frame is tolerated for a while; missing slaves and slaves that left OP are not, whatever else was lost.
    operational_ = false;
  }
  watching_ = !good || !operational_;
}

bool Master::all_in_op() const {
  return std::all_of(status_.begin(), status_.end(), [](const SlaveStatus& s) { return s.present && s.state == State::kOp; });
}

bool Master::all_answer() const { return counted_ == answering_ && answering_ == static_cast<int>(bus_.slaves.size()); }

void Master::send_frames(Wire& wire) {
  index_ = static_cast<std::uint8_t>((index_ + 1) % kAcyclic);
  // A reference that is away or not yet set again must not pass its time on. Whether it is there, the last cycle has shown; if it has
  // gone since then, the others take over what is sent: the extrapolated time.
  const bool distributes =
      std::exchange(reference_read_, false) && !status_[static_cast<std::size_t>(bus_.reference)].down && all_answer();
  time_command_ = distributes ? Command::kFrmw : Command::kFprd;
  ++counters_.cycles;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    FrameWriter writer(buffer_);
    writer.begin();
    if (i == 0) {
      if (bus_.reference >= 0) {
        std::array<std::uint8_t, 8> time;
        store(time.data(), sent_time_ = time_.at(wire.now()));
        writer.add(time_command_, index_, at_station(time_.reference, reg::kSystemTime), time);
      }
      writer.add(Command::kBrd, index_, at_position(0, reg::kAlStatus), std::size_t{2});
    }
    if (i < bus_.segments.size()) add_process_data(writer, bus_.segments[i]);
    frames_[i] = {wire.now(), -1, false, false};
    if (!wire.send(writer.finish())) ++counters_.unsent;
  }
  sent_ = true;
}

void Master::add_process_data(FrameWriter& writer, const Segment& s) {
  const auto set_outputs = [&](std::size_t at) {
    const auto first = static_cast<std::ptrdiff_t>(s.outputs_at);
    if (at == 0) return;
    const std::vector<std::uint8_t>& from = operational_ && !held_ ? outputs_ : safe_outputs_;
    std::copy_n(from.begin() + first, s.output_bytes, sent_outputs_.begin() + first);
    std::copy_n(from.begin() + first, s.output_bytes, buffer_.begin() + static_cast<std::ptrdiff_t>(at));
  };
  if (s.combined) {
    set_outputs(writer.add(Command::kLrw, index_, s.logical, s.output_bytes + s.input_bytes));
    return;
  }
  if (s.output_bytes > 0) set_outputs(writer.add(Command::kLwr, index_, s.logical, s.output_bytes));
  if (s.input_bytes > 0) {
    writer.add(Command::kLrd, index_, s.logical + static_cast<std::uint32_t>(s.output_bytes), s.input_bytes);
  }
}

/// The next slave that is brought back. One that sets its clock has the latched receive times of all for itself.
bool Master::choose_recovery() {
  const std::size_t slaves = recoveries_.size();
  const bool latched = std::any_of(recoveries_.begin(), recoveries_.end(),
                                   [](const Recovery& r) { return r.way != Way::kNone && r.sequence.holds_latch(); });
  for (std::size_t n = 1; n <= slaves; ++n) {
    const std::size_t slave = (recovering_ + n) % slaves;
    const Recovery& r = recoveries_[slave];
    if (r.way == Way::kNone || (latched && r.sequence.latches())) continue;
    recovering_ = slave;
    acyclic_ = AcyclicRequest::kSequence;
    return true;
  }
  return false;
}

void Master::choose_errand(std::int64_t now) {
  const std::size_t slaves = bus_.slaves.size();
  for (std::size_t i = 0; i < slaves; ++i) {
    Recovery& r = recoveries_[i];
    // Positions count only while all slaves answer.
    const bool lost_place = r.way == Way::kAddress && !all_answer();
    if (r.way != Way::kNone && (lost_place || r.sequence.status() != Sequence::Status::kBusy)) end_sequence(i, now);
  }
  acyclic_ = AcyclicRequest::kNone;
  turn_ = (turn_ + 1) % kTurns;
  if (turn_ != 0 && choose_recovery()) return;
  // A slave that gets its address does not answer under it yet.
  std::size_t n = 0;
  if (!std::exchange(look_again_, false)) looked_at_ = (looked_at_ + 1) % slaves;
  while (recoveries_[looked_at_].way == Way::kAddress && ++n < slaves) looked_at_ = (looked_at_ + 1) % slaves;
  if (n == slaves) {
    choose_recovery();
    return;
  }
  if (watching_) {
    acyclic_ = AcyclicRequest::kState;
  } else if (bus_.reference >= 0) {
    if (looked_at_ == 0) clock_difference_ = std::exchange(difference_, 0);
    const BusSlave& s = bus_.slaves[looked_at_];
    if (s.found.ports.has_clock && !s.times.is_reference) acyclic_ = AcyclicRequest::kDifference;
  }
}

void Master::send_errand(Wire& wire) {
  if (acyclic_ == AcyclicRequest::kNone) return;
  acyclic_index_ = static_cast<std::uint8_t>(kAcyclic | (acyclic_index_ + 1));
  FrameWriter writer(buffer_);
  writer.begin();
  const std::uint16_t station = bus_.slaves[looked_at_].found.station;
  Datagram& d = acyclic_sent_[acyclic_index_ - kAcyclic];
  if (acyclic_ == AcyclicRequest::kSequence) {
    const Sequence& sequence = recoveries_[recovering_].sequence;
    d.command = sequence.command();
    d.address = sequence.address();
    d.length = sequence.data().size();
    writer.add(d.command, acyclic_index_, d.address, sequence.data());
  } else {
    const bool state = acyclic_ == AcyclicRequest::kState;
    d.command = Command::kFprd;
    d.address = at_station(station, state ? reg::kAlStatus : reg::kSystemTimeDifference);
    d.length = state ? 6 : 4;
    writer.add(d.command, acyclic_index_, d.address, d.length);
  }
  acyclic_open_ = true;
  if (!wire.send(writer.finish())) ++counters_.unsent;
}

void Master::read_acyclic(bool answered, std::uint16_t working_counter, std::span<const std::uint8_t> data, std::int64_t now) {
  acyclic_open_ = false;
  if (acyclic_ == AcyclicRequest::kSequence) {
    recoveries_[recovering_].sequence.receive(answered, working_counter, data, time_, now);
  } else if (!answered) {
    return;
  } else if (acyclic_ == AcyclicRequest::kState && data.size() == 6) {
    see_state(working_counter == 1, data, now);
  } else if (acyclic_ == AcyclicRequest::kDifference && data.size() == 4 && working_counter == 1) {
    const std::int64_t now_reported = load<std::uint32_t>(data.data()) & 0x7fffffffu;
    auto& [last, before] = reported_[looked_at_];
    difference_ = std::max(difference_, std::min({before, last, now_reported}));
    before = std::exchange(last, now_reported);
  }
}

/// Whether what a slave says of itself is nothing new or was said twice in a row. Otherwise it is asked again: a damaged frame brings no slave
/// down.
bool Master::is_confirmed(bool present, std::span<const std::uint8_t> data) {
  const SlaveStatus& status = status_[looked_at_];
  const bool same_state = !present || (data[0] & (kStateBits | kStateError)) == static_cast<std::uint8_t>(status.state);
  if (present == status.present && same_state) return true;
  std::array<std::uint8_t, 7> said{static_cast<std::uint8_t>(present)};
  if (present) std::ranges::copy(data, said.begin() + 1);
  look_again_ = doubted_ != said;
  doubted_ = look_again_ ? said : decltype(doubted_){0xff};
  return !look_again_;
}

void Master::see_state(bool present, std::span<const std::uint8_t> data, std::int64_t now) {
  const std::size_t slave = looked_at_;
  SlaveStatus& status = status_[slave];
  Recovery& recovery = recoveries_[slave];
  if (!is_confirmed(present, data)) return;
  if (!present) {
    if (status.present) ++counters_.slave_lost;
    status.present = false;
    status.down = true;
    if (std::exchange(recovery.way, Way::kNone) != Way::kNone) return;  // it has gone again
    // All slaves answer, but this one not under its address: it has been switched off and on, or replaced.
    if (all_answer() && now >= recovery.retry) begin(slave, Way::kAddress, now);
    return;
  }
  status.present = true;
  recovery.wrong = false;
  const auto state = static_cast<State>(data[0] & kStateBits);
  const bool error = (data[0] & kStateError) != 0;
  if (error) status.code = static_cast<AlCode>(load<std::uint16_t>(data.data() + 4));
  if (status.state == State::kOp && (state != State::kOp || error)) {
    ++counters_.slave_fault;
    status.down = true;
  }
  status.state = error && state == State::kOp ? State::kSafeOp : state;
  if (recovery.way != Way::kNone) return;
  if (state == State::kOp && !error) return reach_op(slave);
  if (now >= recovery.retry) begin(slave, state == State::kSafeOp ? Way::kRun : Way::kStart, now);
}

void Master::reach_op(std::size_t slave) {
  SlaveStatus& status = status_[slave];
  status.state = State::kOp;
  status.present = true;
  if (status.down) ++counters_.recovered;
  status.down = false;
}

void Master::begin(std::size_t slave, Way way, std::int64_t now) {
  const BusSlave& s = bus_.slaves[slave];
  Recovery& r = recoveries_[slave];
  r.way = way;
  r.sequence.start(way == Way::kAddress ? s.address : way == Way::kStart ? s.start : s.run, s.times, now);
}

void Master::end_sequence(std::size_t slave, std::int64_t now) {
  Recovery& r = recoveries_[slave];
  const Way way = std::exchange(r.way, Way::kNone);
  if (r.sequence.status() != Sequence::Status::kDone) {
    if (r.sequence.al_code() != AlCode::kNone) status_[slave].code = r.sequence.al_code();
    if (way == Way::kAddress && r.sequence.status() == Sequence::Status::kFailed && r.sequence.found_another() &&
        !std::exchange(r.wrong, true))
      ++counters_.wrong_slave;
    r.retry = now + kRetry;
    return;
  }
  if (way == Way::kRun) return reach_op(slave);
  if (way == Way::kStart) ++status_[slave].restarts;
  begin(slave, way == Way::kAddress ? Way::kStart : Way::kRun, now);
}

}  // namespace cotwin::ethercat
