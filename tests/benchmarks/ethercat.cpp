// An EtherCAT cycle with four slaves: the master's frame built and the answer parsed, against copying the frame twice; the whole cycle of the
// master with its second frame, checks and statistics, against making up the answers; and what the emulated bus in OP needs to answer it, for
// information. CPU time of this thread, because the load of the machine changes wall time several times.
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <vector>

#include "components/io/emulators/ethercat/bus.h"
#include "components/io/emulators/ethercat/devices.h"
#include "components/io/ethercat/frame.h"
#include "components/io/ethercat/little_endian.h"
#include "components/io/ethercat/registers.h"
#include "tests/benchmarks/measure.h"
#include "tests/components/io/ethercat/cell.h"
#include "tests/components/io/ethercat/wire.h"
#include "tests/support/allocations.h"

namespace {

using namespace cotwin::ethercat;
using namespace cotwin::benchmark;

constexpr std::size_t kImage = 12;  // bytes of process data: EL2809 2, EL5101 3 and 5, EL1809 2

struct Cycle {
  std::uint8_t outputs[5] = {1, 2, 3, 4, 5}, inputs[7] = {};
  std::uint64_t time = 0;
  int counter = 0, states = 0;

  /// LRW of the process data, FRMW of the system time, BRD of AL status.
  std::size_t build(std::span<std::uint8_t> buffer) {
    FrameWriter writer(buffer);
    writer.begin();
    const std::size_t at = writer.add(Command::kLrw, 1, 0, kImage);
    std::memcpy(&buffer[at], outputs, sizeof outputs);
    writer.add(Command::kFrmw, 2, at_station(0x1001, reg::kSystemTime), 8);
    writer.add(Command::kBrd, 3, at_position(0, reg::kAlStatus), 2);
    return writer.finish().size();
  }
  bool parse(std::span<const std::uint8_t> frame) {
    FrameReader reader(frame);
    Datagram d;
    if (!reader.next(d) || d.command != Command::kLrw || d.length != kImage) return false;
    counter = d.working_counter;
    std::memcpy(inputs, reader.data(d).data() + sizeof outputs, sizeof inputs);
    if (!reader.next(d) || d.length != 8) return false;
    time = load<std::uint64_t>(reader.data(d).data());
    if (!reader.next(d)) return false;
    states = reader.data(d)[0];
    return !reader.next(d);
  }
};

/// All slaves in OP, outputs from logical address 0, inputs behind them.
void bring_up(BusWire& w) {
  w.number_stations();
  for (std::size_t n = 1; n < 4; ++n) w.set_sync_managers(n);
  w.set_fmmu(0x1003, 0, 0, 2, 0, 7, 0x0f00, 0, fmmu::kWrite);
  w.set_fmmu(0x1004, 0, 2, 3, 0, 7, 0x1000, 0, fmmu::kWrite);
  w.set_fmmu(0x1002, 0, 5, 2, 0, 7, 0x1000, 0, fmmu::kRead);
  w.set_fmmu(0x1004, 1, 7, 5, 0, 7, 0x1100, 0, fmmu::kRead);
  for (const State state : {State::kPreOp, State::kSafeOp, State::kOp}) {
    for (std::uint16_t station = 0x1001; station <= 0x1004; ++station) w.request(station, state);
    w.send(Command::kLrw, 0, std::vector<std::uint8_t>(kImage));
  }
}

/// A bus whose slaves answer each frame as they do in OP, without effort.
class Mirror final : public Wire {
 public:
  Mirror(std::int64_t now, std::int64_t system_time) : now_(now), system_time_(system_time) {}
  bool send(std::span<const std::uint8_t> frame) override {
    Answer& a = answers_[count_++ % answers_.size()];
    a.size = frame.size();
    std::memcpy(a.bytes.data(), frame.data(), frame.size());
    FrameReader reader(frame);
    Datagram d;
    while (reader.next(d)) {
      const bool states = d.command == Command::kBrd;
      if (d.offset() == reg::kAlStatus) a.bytes[d.data] = static_cast<std::uint8_t>(State::kOp);
      if (d.offset() == reg::kSystemTime && d.length == 8) store(&a.bytes[d.data], system_time_ + now_);
      store<std::uint16_t>(&a.bytes[d.data + d.length], d.command == Command::kLrw ? 6 : states ? 4 : 1);
    }
    return true;
  }
  std::size_t receive(std::span<std::uint8_t> buffer, std::int64_t) override {
    if (taken_ == count_) return 0;
    const Answer& a = answers_[taken_++ % answers_.size()];
    std::memcpy(buffer.data(), a.bytes.data(), a.size);
    return a.size;
  }
  std::int64_t now() const override { return now_; }
  std::int64_t received_at() const override { return now_; }
  void advance() { now_ += kMs; }

 private:
  struct Answer {
    std::array<std::uint8_t, kLongestFrame> bytes;
    std::size_t size;
  };
  std::int64_t now_, system_time_;
  std::array<Answer, 4> answers_;
  std::size_t count_ = 0, taken_ = 0;
};

/// Returns false if a cycle was not complete.
bool measure_master() {
  Cell cell;
  cell.options.drift_frames = 100;
  cell.set_up();
  cell.cycles(100);
  Mirror mirror(cell.wire.now(), cell.options.system_time), alone(0, 0);
  std::vector<std::uint8_t> cyclic(kLongestFrame), single(kLongestFrame), answer(kLongestFrame);
  FrameWriter writer(cyclic);
  writer.begin();
  writer.add(Command::kFrmw, 1, at_station(0x1001, reg::kSystemTime), std::size_t{8});
  writer.add(Command::kBrd, 1, at_position(0, reg::kAlStatus), std::size_t{2});
  writer.add(Command::kLrw, 1, 0, std::size_t{20});
  const std::span<const std::uint8_t> first = writer.finish();
  FrameWriter second(single);
  second.begin();
  second.add(Command::kFprd, 130, at_station(0x1002, reg::kSystemTimeDifference), std::size_t{4});
  const std::span<const std::uint8_t> other = second.finish();
  cell.master->cycle(mirror);  // the answers to the last cycle on the bus are lost
  mirror.advance();
  cell.master->cycle(mirror);
  const std::int64_t lost = cell.master->counters().lost;
  const Figures master = measure(
      [&] {
        mirror.advance();
        cell.master->outputs(2)[0] ^= 1;
        cell.master->cycle(mirror);
      },
      [&] {
        alone.send(first);
        alone.send(other);
        alone.receive(answer, 0);
        alone.receive(answer, 0);
        keep(answer);
      },
      31, 2e-3, thread_seconds);
  print({"EtherCAT master, a cycle with four slaves and two frames", "ns", 1e9 * master.ours, "making up the answers",
         1e9 * master.peer, 1000, false});
  const Master::Counters& c = cell.master->counters();
  return cell.master->operational() && c.lost == lost && c.late + c.foreign + c.working_counter == 0;
}

}  // namespace

int main() {
  std::vector<std::uint8_t> buffer(kLongestFrame), copy(kLongestFrame);
  Cycle cycle;
  const std::size_t size = cycle.build(buffer);
  const auto before = cotwin::testing::allocations();
  const auto exchange = [&] {
    const std::size_t n = cycle.build(buffer);
    if (!cycle.parse(std::span<const std::uint8_t>(buffer).first(n))) std::abort();
    keep(cycle);
  };
  exchange();
  if (cotwin::testing::allocations() != before) return 1;
  const Figures codec = measure(
      exchange,
      [&] {
        std::memcpy(copy.data(), buffer.data(), size);
        keep(copy);
        std::memcpy(buffer.data(), copy.data(), size);
        keep(buffer);
      },
      31, 2e-3, thread_seconds);
  print({"EtherCAT cycle of four slaves, built and parsed", "ns", 1e9 * codec.ours, "copying the frame twice", 1e9 * codec.peer,
         1000, false});

  if (!measure_master()) {
    std::fprintf(stderr, "cycles of the master were not complete\n");
    return 1;
  }

  Bus bus;
  bus.append(std::make_unique<Ek1100>());
  bus.append(std::make_unique<El1809>());
  bus.append(std::make_unique<El2809>());
  bus.append(std::make_unique<El5101>());
  BusWire wire(bus);
  bring_up(wire);
  std::int64_t now = wire.now;
  std::uint64_t frames = 0, complete = 0;
  const Figures emulated = measure(
      [&] {
        const std::size_t n = cycle.build(buffer);
        if (!bus.transmit(std::span(buffer).first(n), now += 1'000'000)) std::abort();
        if (!cycle.parse(std::span<const std::uint8_t>(buffer).first(n))) std::abort();
        ++frames;
        complete += cycle.counter == 6 && cycle.states == static_cast<int>(State::kOp);
      },
      exchange, 31, 2e-3, thread_seconds);
  if (complete != frames) {
    std::fprintf(stderr, "%llu of %llu frames were not answered by all slaves in OP\n",
                 static_cast<unsigned long long>(frames - complete), static_cast<unsigned long long>(frames));
    return 1;
  }
  print({"emulated bus of four slaves, one frame", "ns", 1e9 * emulated.ours, "the codec of the master", 1e9 * emulated.peer, 0,
         false});
}
