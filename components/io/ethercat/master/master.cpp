#include "components/io/ethercat/master/master.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "components/io/ethercat/little_endian.h"

namespace cotwin::ethercat {

namespace {

constexpr std::uint8_t kErrands = 0x80;          // indices of errands begin here
constexpr std::int64_t kPlausible = 10'000'000;  // ns by which the reference clock may be off
constexpr int kMostFrames = 64;                  // that a cycle reads
constexpr std::int64_t kRetry = 100'000'000;     // ns from a failed recovery to the next attempt
constexpr std::uint8_t kAllOp = static_cast<std::uint8_t>(State::kOp);

}  // namespace

Master::Master(BusSetup bus, std::int64_t cycle, std::int64_t patience, BusTime time)
    : bus_(std::move(bus)), patience_(std::max(cycle, patience)), time_(time) {
  inputs_.resize(bus_.input_bytes);
  outputs_.resize(bus_.output_bytes);
  frames_.resize(std::max<std::size_t>(bus_.segments.size(), 1));
  status_.resize(bus_.slaves.size());
  retry_.resize(bus_.slaves.size());
  sequence_.reserve(kLongestFrame);
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

void Master::cycle(Wire& wire) {
  collect(wire, 0);
  const std::int64_t now = wire.now();
  if (sent_) close_cycle(now);
  if (errand_open_) take_errand(false, 0, {}, now);
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
  if (d.index >= kErrands) {
    if (errand_open_ && d.index == errand_index_) {
      take_errand(true, d.working_counter, reader.data(d), now);
    } else {
      ++counters_.late;
    }
    return;
  }
  if (d.index != index_ || !sent_) {
    ++counters_.late;
    return;
  }
  take_cyclic(FrameReader(frame), std::max(now, frames_[0].sent));
}

/// Whether the datagrams of an answer are those that were sent for a segment. Slaves change the address of broadcasts only.
bool Master::is_answer(FrameReader reader, std::size_t segment) const {
  Datagram d;
  const auto next_is = [&](Command command, std::size_t length) {
    return reader.next(d) && d.command == command && d.length == length;
  };
  if (segment == 0) {
    if (bus_.reference >= 0 && !(next_is(time_command_, 8) && d.address == at_station(time_.reference, reg::kSystemTime)))
      return false;
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

void Master::take_cyclic(const FrameReader& frame, std::int64_t now) {
  std::size_t segment = 0;
  while (segment < frames_.size() && !is_answer(frame, segment)) ++segment;
  if (segment == frames_.size()) {
    ++counters_.foreign;
    return;
  }
  if (frames_[segment].answered) {
    ++counters_.late;
    return;
  }
  FrameReader reader = frame;
  Datagram d;
  bool complete = true;
  std::span<const std::uint8_t> arriving;
  while (reader.next(d)) {
    const std::span<const std::uint8_t> data = reader.data(d);
    if (d.command == time_command_) {
      take_system_time(load<std::int64_t>(data.data()), d.working_counter, now);
    } else if (d.command == Command::kBrd) {
      states_ = data[0];
      answering_ = d.working_counter;
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
/// the others count even if it does not answer at all.
void Master::take_system_time(std::int64_t time, std::uint16_t working_counter, std::int64_t now) {
  const std::int64_t middle = std::min(frames_[0].sent + (now - frames_[0].sent) / 2, now);
  if (working_counter == 0 || std::abs(time - time_.at(middle)) > kPlausible) return;
  system_time_ = time_.system = time;
  system_time_at_ = time_.host = middle;
}

void Master::close_cycle(std::int64_t now) {
  sent_ = false;
  bool answered = true, complete = true;
  for (const Frame& f : frames_) {
    answered = answered && f.answered;
    complete = complete && f.complete;
  }
  if (!answered) {
    ++counters_.lost;
  } else if (!complete) {
    ++counters_.working_counter;
  }
  const int slaves = static_cast<int>(bus_.slaves.size());
  if (frames_[0].answered && answering_ > slaves && !crowded_) ++counters_.unexpected;
  if (frames_[0].answered) crowded_ = answering_ > slaves;
  fresh_ = answered && complete;
  const bool good = fresh_ && answering_ == slaves && states_ == kAllOp;
  if (good) {
    last_good_ = now;
    operational_ = all_in_op();
  } else if (answered || now - last_good_ > patience_) {
    // A lost frame is tolerated for a while; missing slaves and slaves that left OP are not.
    operational_ = false;
  }
  watching_ = !good || !operational_;
}

bool Master::all_in_op() const {
  return std::all_of(status_.begin(), status_.end(), [](const SlaveStatus& s) { return s.present && s.state == State::kOp; });
}

void Master::send_frames(Wire& wire) {
  index_ = static_cast<std::uint8_t>((index_ + 1) % kErrands);
  // A reference that is away or not yet set again must not pass its time on.
  const bool distributes = bus_.reference >= 0 && !status_[static_cast<std::size_t>(bus_.reference)].down &&
                           (counters_.cycles == 0 || answering_ == static_cast<int>(bus_.slaves.size()));
  time_command_ = distributes ? Command::kFrmw : Command::kFprd;
  ++counters_.cycles;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    FrameWriter writer(buffer_);
    writer.begin();
    if (i == 0) {
      if (bus_.reference >= 0) writer.add(time_command_, index_, at_station(time_.reference, reg::kSystemTime), std::size_t{8});
      writer.add(Command::kBrd, index_, at_position(0, reg::kAlStatus), std::size_t{2});
    }
    if (i < bus_.segments.size()) add_process_data(writer, bus_.segments[i]);
    frames_[i] = {wire.now(), false, false};
    if (!wire.send(writer.finish())) ++counters_.unsent;
  }
  sent_ = true;
}

void Master::add_process_data(FrameWriter& writer, const Segment& s) {
  const auto set_outputs = [&](std::size_t at) {
    if (at == 0 || !operational_) return;
    std::copy_n(outputs_.begin() + static_cast<std::ptrdiff_t>(s.outputs_at), s.output_bytes,
                buffer_.begin() + static_cast<std::ptrdiff_t>(at));
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

void Master::choose_errand(std::int64_t now) {
  if (errand_ == Errand::kSequence) {
    if (sequence_.status() == Sequence::Status::kBusy) return;
    end_sequence(now);
    if (errand_ == Errand::kSequence) return;
  }
  const std::size_t slaves = bus_.slaves.size();
  errand_ = Errand::kNone;
  looked_at_ = (looked_at_ + 1) % slaves;
  if (watching_) {
    errand_ = Errand::kState;
  } else if (bus_.reference >= 0) {
    if (looked_at_ == 0) clock_difference_ = std::exchange(difference_, 0);
    const BusSlave& s = bus_.slaves[looked_at_];
    if (s.found.ports.has_clock && !s.times.is_reference) errand_ = Errand::kDifference;
  }
}

void Master::send_errand(Wire& wire) {
  if (errand_ == Errand::kNone) return;
  errand_index_ = static_cast<std::uint8_t>(kErrands | (errand_index_ + 1));
  FrameWriter writer(buffer_);
  writer.begin();
  const std::uint16_t station = bus_.slaves[looked_at_].found.station;
  if (errand_ == Errand::kSequence) {
    writer.add(sequence_.command(), errand_index_, sequence_.address(), sequence_.data());
  } else if (errand_ == Errand::kState) {
    writer.add(Command::kFprd, errand_index_, at_station(station, reg::kAlStatus), std::size_t{6});
  } else {
    writer.add(Command::kFprd, errand_index_, at_station(station, reg::kSystemTimeDifference), std::size_t{4});
  }
  errand_open_ = true;
  if (!wire.send(writer.finish())) ++counters_.unsent;
}

void Master::take_errand(bool answered, std::uint16_t working_counter, std::span<const std::uint8_t> data, std::int64_t now) {
  errand_open_ = false;
  if (errand_ == Errand::kSequence) {
    sequence_.receive(answered, working_counter, data, time_, now);
  } else if (!answered) {
    return;
  } else if (errand_ == Errand::kState && data.size() == 6) {
    see_state(working_counter == 1, data, now);
  } else if (errand_ == Errand::kDifference && data.size() == 4 && working_counter == 1) {
    difference_ = std::max<std::int64_t>(difference_, load<std::uint32_t>(data.data()) & 0x7fffffffu);
  }
}

void Master::see_state(bool present, std::span<const std::uint8_t> data, std::int64_t now) {
  const std::size_t slave = looked_at_;
  SlaveStatus& status = status_[slave];
  const int slaves = static_cast<int>(bus_.slaves.size());
  if (!present) {
    if (status.present) ++counters_.slave_lost;
    status.present = false;
    status.down = true;
    // All slaves answer, but this one not under its address: it has been switched off and on, or replaced.
    if (answering_ == slaves && now >= retry_[slave]) begin(slave, Way::kAddress, now);
    return;
  }
  status.present = true;
  const auto state = static_cast<State>(data[0] & kStateBits);
  const bool error = (data[0] & kStateError) != 0;
  if (error) status.code = static_cast<AlCode>(load<std::uint16_t>(data.data() + 4));
  if (status.state == State::kOp && (state != State::kOp || error)) {
    ++counters_.slave_fault;
    status.down = true;
  }
  status.state = error && state == State::kOp ? State::kSafeOp : state;
  if (state == State::kOp && !error) return reach_op(slave);
  if (now >= retry_[slave]) begin(slave, state == State::kSafeOp ? Way::kRun : Way::kStart, now);
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
  errand_ = Errand::kSequence;
  recovering_ = slave;
  way_ = way;
  sequence_.start(way == Way::kAddress ? s.address : way == Way::kStart ? s.start : s.run, s.times, now);
}

void Master::end_sequence(std::int64_t now) {
  errand_ = Errand::kNone;
  if (sequence_.status() == Sequence::Status::kFailed) {
    if (sequence_.al_code() != AlCode::kNone) status_[recovering_].code = sequence_.al_code();
    if (way_ == Way::kAddress && sequence_.answered_otherwise()) ++counters_.wrong_slave;
    retry_[recovering_] = now + kRetry;
    return;
  }
  if (way_ == Way::kRun) return reach_op(recovering_);
  if (way_ == Way::kStart) ++status_[recovering_].restarts;
  begin(recovering_, way_ == Way::kAddress ? Way::kStart : Way::kRun, now);
}

void Master::stop(Wire& wire) {
  operational_ = false;
  send_frames(wire);
  FrameWriter writer(buffer_);
  writer.begin();
  std::array<std::uint8_t, 2> init{};
  store(init.data(), static_cast<std::uint16_t>(static_cast<std::uint16_t>(State::kInit) | kStateError));
  writer.add(Command::kBwr, kErrands, at_position(0, reg::kAlControl), init);
  wire.send(writer.finish());
}

}  // namespace cotwin::ethercat
