#include "components/io/ethercat/master/bus_setup.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>

#include "components/io/ethercat/master/start_up.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::ethercat {

namespace {

constexpr std::size_t kLargestSegment = 1200;  // bytes; leaves room for clock and state in the same frame
constexpr std::uint16_t kWatchdogDivider = 0x09c2, kWatchdogTime = kOutputWatchdog / 100'000;  // of 100 us
constexpr int kLatches = 5;  // broadcasts that latch the receive times, until all clocks have taken one

class BusBuilder {
 public:
  BusBuilder(Exchange& exchange, const std::vector<ExpectedSlave>& expected, const SetupOptions& options)
      : exchange_(exchange), expected_(expected), options_(options) {}

  BusSetup build() {
    std::vector<FoundSlave> found = scan_bus(exchange_, options_.place, options_.wait);
    if (!options_.sii_folder.empty()) save_images(found);
    check_identities(found);
    for (std::size_t i = 0; i < found.size(); ++i) {
      BusSlave slave;
      slave.expected = expected_[i];
      slave.found = std::move(found[i]);
      const Sii& sii = slave.expected.sii ? *slave.expected.sii : slave.found.sii;
      slave.setup = setup_of(sii, slave.expected.pdos, place_of(i));
      add_start_up(slave, i);
      check_sii(slave, i);
      check_sizes(slave, i);
      bus_.slaves.push_back(std::move(slave));
    }
    measure_delays();
    lay_out_image();
    for (std::size_t i = 0; i < bus_.slaves.size(); ++i) plan(i);
    time_ = {0, options_.system_time, options_.host_time};
    if (bus_.reference >= 0) time_.reference = bus_.slaves[static_cast<std::size_t>(bus_.reference)].found.station;
    // All clocks are set before the drift is compensated, and SYNC0 is started after it.
    for (std::size_t i = 0; i < bus_.slaves.size(); ++i) run(i, std::span(bus_.slaves[i].start).first(clock_set_[i]));
    if (bus_.reference >= 0) compensate_drift();
    for (std::size_t i = 0; i < bus_.slaves.size(); ++i) run(i, std::span(bus_.slaves[i].start).subspan(clock_set_[i]));
    return std::move(bus_);
  }

 private:
  std::string place_of(std::size_t i) const {
    const ExpectedSlave& e = expected_[i];
    return position_of(options_.place, i) + " (" + e.device + (e.name.empty() ? "" : ", " + e.name) + ")";
  }

  static const std::string& order_of(const FoundSlave& slave) {
    return slave.sii.general.order.empty() ? slave.sii.general.name : slave.sii.general.order;
  }

  void save_images(const std::vector<FoundSlave>& found) const {
    for (std::size_t i = 0; i < found.size(); ++i) {
      std::string name = std::to_string(i) + "_" + order_of(found[i]);
      std::replace_if(
          name.begin(), name.end(), [](char c) { return !std::isalnum(static_cast<unsigned char>(c)) && c != '-'; }, '_');
      const std::filesystem::path path = std::filesystem::path(options_.sii_folder) / (name + ".bin");
      std::error_code ignored;
      std::filesystem::create_directories(options_.sii_folder, ignored);
      std::ofstream file(path, std::ios::binary);
      file.write(reinterpret_cast<const char*>(found[i].image.data()), static_cast<std::streamsize>(found[i].image.size()));
      if (!file.flush()) throw Error(path.string(), "cannot be written, expected a folder for SII images");
    }
  }

  void check_identities(const std::vector<FoundSlave>& found) const {
    const std::size_t common = std::min(found.size(), expected_.size());
    for (std::size_t i = 0; i < common; ++i) {
      const ExpectedSlave& e = expected_[i];
      const Sii& sii = found[i].sii;
      if ((e.vendor == 0 || e.vendor == sii.vendor) && (e.product == 0 || e.product == sii.product)) continue;
      throw Error(position_of(options_.place, i), "is " + describe_identity(order_of(found[i]), sii.vendor, sii.product) +
                                                      ", expected " + describe_identity(e.device, e.vendor, e.product));
    }
    if (found.size() == expected_.size()) return;
    std::string list;
    for (const FoundSlave& f : found) text::append(list, order_of(f).empty() ? "a device" : order_of(f));
    const bool more = found.size() > expected_.size();
    throw Error(options_.place, std::to_string(found.size()) + " slaves answer (" + list + "), expected " +
                                    std::to_string(expected_.size()) + ": slave " + std::to_string(common) +
                                    (more ? " is unknown" : " (" + expected_[common].device + ") is missing"));
  }

  /// What the SII says must fit the controller, because it decides which registers are written.
  void check_sii(const BusSlave& slave, std::size_t i) const {
    const SiiMailbox& box = slave.setup.mailbox;
    for (const std::uint16_t size : {box.out_size, box.in_size}) {
      if (size != 0 && (size < kShortestMailbox || size > kLongestData)) {
        throw Error(place_of(i), "its SII has a mailbox of " + std::to_string(size) + " bytes, expected " +
                                     std::to_string(kShortestMailbox) + " to " + std::to_string(kLongestData));
      }
    }
    for (const ProcessData& data : slave.setup.process_data) {
      if (data.sync_manager >= slave.found.sync_managers) {
        throw Error(place_of(i), "its SII has a sync manager " + std::to_string(data.sync_manager) +
                                     ", but its controller only " + std::to_string(slave.found.sync_managers));
      }
    }
  }

  /// The values of the user come before the assignment of PDOs.
  void add_start_up(BusSlave& slave, std::size_t i) const {
    const std::vector<StartUpValue>& values = slave.expected.start_up;
    if (values.empty()) return;
    if (!slave.setup.has_coe) {
      throw Error(values.front().origin, "is for " + place_of(i) + ", which has no mailbox with CoE, expected none for it");
    }
    slave.setup.start_up.insert(slave.setup.start_up.begin(), values.begin(), values.end());
  }

  void check_sizes(const BusSlave& slave, std::size_t i) const {
    const ExpectedSlave& e = slave.expected;
    const SlaveSetup& s = slave.setup;
    if (e.input_bytes == s.input_bytes && e.output_bytes == s.output_bytes) return;
    throw Error(place_of(i), "has " + std::to_string(s.output_bytes) + " bytes of outputs and " +
                                 std::to_string(s.input_bytes) + " of inputs, expected " + std::to_string(e.output_bytes) +
                                 " and " + std::to_string(e.input_bytes));
  }

  /// Makes all slaves latch the receive times of one frame.
  void latch_receive_times() {
    const auto clocks = std::count_if(bus_.slaves.begin(), bus_.slaves.end(),
                                      [](const BusSlave& s) { return (s.found.features & feature::kClock) != 0; });
    std::optional<std::uint16_t> count;
    for (int n = 0; n < kLatches; ++n) {
      count = exchange_.broadcast<std::uint32_t>(reg::kReceiveTimes, 0);
      if (count && *count >= clocks && *count <= bus_.slaves.size()) return;
    }
    throw Error(options_.place, (count ? std::to_string(*count) : "none") +
                                    " of the slaves take the command to latch their receive times, expected " +
                                    std::to_string(clocks) + " to " + std::to_string(bus_.slaves.size()));
  }

  void measure_delays() {
    std::vector<SlavePorts> ports;
    if (options_.clocks) latch_receive_times();
    for (std::size_t i = 0; i < bus_.slaves.size(); ++i) {
      FoundSlave& f = bus_.slaves[i].found;
      if (options_.clocks && f.ports.has_clock) {
        const auto times = exchange_.read<std::array<std::uint32_t, 4>>(f.station, reg::kReceiveTimes);
        if (!times) throw Error(place_of(i), "does not answer when its receive times are read");
        f.ports.receive_times = *times;
        if (bus_.reference < 0) bus_.reference = static_cast<int>(i);
      } else {
        f.ports.has_clock = false;
      }
      ports.push_back(f.ports);
    }
    if (options_.clocks && bus_.reference < 0) {
      throw Error(options_.place, "no slave has a distributed clock, expected one (or clocks switched off)");
    }
    // Without clocks nothing depends on the tree.
    std::vector<std::uint32_t> delays(bus_.slaves.size());
    if (options_.clocks) {
      const std::vector<Place> places = find_topology(ports);
      delays = propagation_delays(ports, places);
      for (std::size_t i = 0; i < bus_.slaves.size(); ++i) bus_.slaves[i].place = places[i];
    }
    for (std::size_t i = 0; i < bus_.slaves.size(); ++i) {
      BusSlave& s = bus_.slaves[i];
      s.delay = delays[i];
      s.times = {s.delay, options_.cycle, s.expected.sync0_shift, static_cast<int>(i) == bus_.reference};
    }
  }

  /// Packs slaves into segments in the order of the bus.
  void lay_out_image() {
    const bool combined = std::none_of(bus_.slaves.begin(), bus_.slaves.end(), [](const BusSlave& s) {
      return (s.found.features & feature::kNoLrw) != 0 && s.setup.input_bytes + s.setup.output_bytes > 0;
    });
    std::vector<std::size_t> segment_of(bus_.slaves.size());
    for (std::size_t i = 0; i < bus_.slaves.size(); ++i) {
      BusSlave& s = bus_.slaves[i];
      const std::size_t bytes = s.setup.input_bytes + s.setup.output_bytes;
      if (bytes > kLargestSegment) {
        throw Error(place_of(i), "has " + std::to_string(bytes) + " bytes of process data, expected at most " +
                                     std::to_string(kLargestSegment));
      }
      s.inputs_at = bus_.input_bytes;
      s.outputs_at = bus_.output_bytes;
      bus_.input_bytes += s.setup.input_bytes;
      bus_.output_bytes += s.setup.output_bytes;
      if (bytes > 0) {
        if (bus_.segments.empty() ||
            bus_.segments.back().input_bytes + bus_.segments.back().output_bytes + bytes > kLargestSegment) {
          Segment segment;
          segment.logical = static_cast<std::uint32_t>(bus_.segments.size()) * kSegmentSpan;
          segment.inputs_at = s.inputs_at;
          segment.outputs_at = s.outputs_at;
          segment.combined = combined;
          bus_.segments.push_back(segment);
        }
        Segment& segment = bus_.segments.back();
        segment.input_bytes += s.setup.input_bytes;
        segment.output_bytes += s.setup.output_bytes;
        if (s.setup.input_bytes > 0) ++segment.read_count;
        if (s.setup.output_bytes > 0) ++segment.write_count;
      }
      segment_of[i] = bus_.segments.empty() ? 0 : bus_.segments.size() - 1;
    }
    for (std::size_t i = 0; i < bus_.slaves.size(); ++i) {
      BusSlave& s = bus_.slaves[i];
      if (s.setup.input_bytes + s.setup.output_bytes == 0) continue;
      const Segment& segment = bus_.segments[segment_of[i]];
      s.logical_outputs = segment.logical + static_cast<std::uint32_t>(s.outputs_at - segment.outputs_at);
      s.logical_inputs = segment.logical + static_cast<std::uint32_t>(segment.output_bytes + s.inputs_at - segment.inputs_at);
    }
  }

  // ------------------------------------------------------------------------------------------------------ the steps of a slave

  static Step datagram(Command command, std::uint32_t address, std::vector<std::uint8_t> data, const char* what) {
    Step step;
    step.command = command;
    step.address = address;
    step.data = std::move(data);
    step.what = what;
    return step;
  }

  template <class T>
  static Step write(std::uint16_t station, std::uint16_t offset, T value, const char* what) {
    std::vector<std::uint8_t> bytes(sizeof value);
    store(bytes.data(), value);
    return datagram(Command::kFpwr, at_station(station, offset), std::move(bytes), what);
  }

  void go_to(std::vector<Step>& steps, std::uint16_t station, State state, const char* what) const {
    steps.push_back(write(station, reg::kAlControl, static_cast<std::uint16_t>(state), what));
    Step step = datagram(Command::kFprd, at_station(station, reg::kAlStatus), std::vector<std::uint8_t>(6), what);
    step.kind = Step::Kind::kState;
    step.mask = {0x1f};
    step.expected = {static_cast<std::uint8_t>(state)};
    step.timeout = state == State::kPreOp ? 3'000'000'000 : 10'000'000'000;
    steps.push_back(std::move(step));
  }

  /// Requests `state` with and without acknowledging an error: terminals without a processor copy the acknowledgement to AL status, where
  /// it reads as an error.
  static void acknowledge(std::vector<Step>& steps, std::uint16_t station, State state, const char* what) {
    const auto value = static_cast<std::uint16_t>(state);
    steps.push_back(write(station, reg::kAlControl, static_cast<std::uint16_t>(value | kStateError), what));
    steps.push_back(write(station, reg::kAlControl, value, what));
  }

  static void set_sync_manager(std::vector<Step>& steps, std::uint16_t station, int n, std::uint16_t start,
                               std::uint16_t length, std::uint8_t control) {
    std::vector<std::uint8_t> bytes(reg::kSyncManagerSize);
    store(bytes.data(), start);
    store(bytes.data() + 2, length);
    bytes[4] = control;
    bytes[6] = sync_manager::kEnabled;
    steps.push_back(datagram(Command::kFpwr,
                             at_station(station, static_cast<std::uint16_t>(reg::kSyncManager + n * reg::kSyncManagerSize)),
                             std::move(bytes), "take the settings of its sync managers"));
  }

  void map(std::vector<Step>& steps, const BusSlave& s, std::size_t i) const {
    std::uint16_t fmmu = 0;
    for (const bool outputs : {true, false}) {
      const ProcessData* first = nullptr;
      std::size_t length = 0;
      const auto flush = [&] {
        if (first == nullptr) return;
        if (fmmu >= s.found.fmmus) {
          throw Error(place_of(i), "has " + std::to_string(s.found.fmmus) + " FMMUs, expected more for its process data");
        }
        std::vector<std::uint8_t> bytes(reg::kFmmuSize);
        const std::uint32_t logical =
            (outputs ? s.logical_outputs : s.logical_inputs) + static_cast<std::uint32_t>(first->offset);
        store(bytes.data(), logical);
        store(bytes.data() + 4, static_cast<std::uint16_t>(length));
        bytes[7] = 7;  // last bit of the last byte
        store(bytes.data() + 8, first->start);
        bytes[11] = outputs ? fmmu::kWrite : fmmu::kRead;
        bytes[12] = 1;
        steps.push_back(datagram(Command::kFpwr,
                                 at_station(s.found.station, static_cast<std::uint16_t>(reg::kFmmu + fmmu * reg::kFmmuSize)),
                                 std::move(bytes), "take the settings of its FMMUs"));
        ++fmmu;
        first = nullptr;
      };
      for (const ProcessData& data : s.setup.process_data) {
        if (data.outputs != outputs) continue;
        // Neighbouring buffers, as those of 16 outputs on two sync managers, share an FMMU.
        if (first != nullptr && first->start + length == data.start) {
          length += data.length;
          continue;
        }
        flush();
        first = &data;
        length = data.length;
      }
      flush();
    }
  }

  void set_clock(std::vector<Step>& steps, const BusSlave& s) const {
    const std::uint16_t station = s.found.station;
    Step step =
        datagram(Command::kBwr, at_position(0, reg::kReceiveTimes), std::vector<std::uint8_t>(4), "latch the receive times");
    step.kind = Step::Kind::kLatch;
    step.least = s.times.is_reference ? 1 : 2;
    steps.push_back(std::move(step));
    step =
        datagram(Command::kFprd, at_station(station, reg::kReceiveTime), std::vector<std::uint8_t>(8), "give its receive time");
    step.kind = Step::Kind::kReadLocal;
    steps.push_back(std::move(step));
    if (!s.times.is_reference) {
      const std::uint16_t reference = bus_.slaves[static_cast<std::size_t>(bus_.reference)].found.station;
      step = datagram(Command::kFprd, at_station(reference, reg::kReceiveTime), std::vector<std::uint8_t>(16),
                      "find the reference clock");
      step.kind = Step::Kind::kReadSystem;
      step.back = 2;  // to the latch
      steps.push_back(std::move(step));
    }
    step = write<std::int64_t>(station, reg::kSystemTimeOffset, 0, "take the offset of its clock");
    step.kind = Step::Kind::kWriteOffset;
    steps.push_back(std::move(step));
    steps.push_back(write(station, reg::kSystemTimeDelay, s.delay, "take the delay of its clock"));
    steps.push_back(write<std::uint16_t>(station, reg::kSpeedCounterStart, 0x1000, "restart the loop of its clock"));
  }

  void start_sync(std::vector<Step>& steps, const BusSlave& s) const {
    const std::uint16_t station = s.found.station;
    const char* const what = "take the settings of SYNC0";
    steps.push_back(write<std::uint16_t>(station, reg::kCyclicControl, 0, what));
    Step step =
        datagram(Command::kFprd, at_station(station, reg::kSystemTime), std::vector<std::uint8_t>(8), "give its system time");
    step.kind = Step::Kind::kReadNow;
    steps.push_back(std::move(step));
    step = write<std::int64_t>(station, reg::kStartTime, 0, what);
    step.kind = Step::Kind::kWriteStart;
    steps.push_back(std::move(step));
    steps.push_back(write(station, reg::kSync0Cycle, static_cast<std::uint32_t>(options_.cycle), what));
    steps.push_back(write(station, reg::kCyclicControl, s.expected.sync_activation, what));
    // A begin in the past never comes.
    step = datagram(Command::kFprd, at_station(station, reg::kSystemTime), std::vector<std::uint8_t>(8), "start SYNC0 in time");
    step.kind = Step::Kind::kCheckStart;
    step.back = 5;  // to the first step of these
    steps.push_back(std::move(step));
  }

  void plan(std::size_t i) {
    BusSlave& s = bus_.slaves[i];
    const std::uint16_t station = s.found.station;
    // A slave that was off has lost its address, and may be another one.
    const auto position = static_cast<std::uint16_t>(i);
    const auto identity = [&](std::uint32_t word, std::uint32_t value) {
      std::vector<std::uint8_t> request(6);
      store(request.data(), sii_control::kRead);
      store(request.data() + 2, word);
      s.address.push_back(
          datagram(Command::kApwr, at_position(position, reg::kSiiControl), std::move(request), "take requests to its SII"));
      Step ready =
          datagram(Command::kAprd, at_position(position, reg::kSiiControl), std::vector<std::uint8_t>(2), "read its SII");
      ready.mask = {0, (sii_control::kBusy | sii_control::kErrors) >> 8};
      ready.expected = {0, 0};
      ready.back = 1;
      s.address.push_back(std::move(ready));
      Step compare =
          datagram(Command::kAprd, at_position(position, reg::kSiiData), std::vector<std::uint8_t>(4), "show its identity");
      compare.mask.assign(4, 0xff);
      compare.expected.resize(4);
      store(compare.expected.data(), value);
      compare.identity = true;
      s.address.push_back(std::move(compare));
    };
    identity(0x08, s.found.sii.vendor);
    identity(0x0a, s.found.sii.product);
    // One that has an address did not restart: it is another slave, at another place since this one has gone.
    Step fresh = datagram(Command::kAprd, at_position(position, reg::kStation), std::vector<std::uint8_t>(2),
                          "come without a station address");
    fresh.mask = {0xff, 0xff};
    fresh.expected = {0, 0};
    fresh.identity = true;
    s.address.push_back(std::move(fresh));
    std::vector<std::uint8_t> bytes(2);
    store(bytes.data(), station);
    s.address.push_back(
        datagram(Command::kApwr, at_position(position, reg::kStation), std::move(bytes), "take a station address"));

    std::vector<Step>& steps = s.start;
    acknowledge(steps, station, State::kInit, "go to INIT");
    Step init = datagram(Command::kFprd, at_station(station, reg::kAlStatus), std::vector<std::uint8_t>(6), "go to INIT");
    init.mask = {0x1f};
    init.expected = {static_cast<std::uint8_t>(State::kInit)};
    init.timeout = 5'000'000'000;
    steps.push_back(std::move(init));
    for (std::uint16_t n = 0; n < s.found.fmmus; ++n) {
      steps.push_back(datagram(Command::kFpwr, at_station(station, static_cast<std::uint16_t>(reg::kFmmu + n * reg::kFmmuSize)),
                               std::vector<std::uint8_t>(reg::kFmmuSize), "clear its FMMUs"));
    }
    const SiiMailbox& box = s.setup.mailbox;
    if (box.out_size != 0) {
      set_sync_manager(steps, station, 0, box.out, box.out_size, 0x26);
      set_sync_manager(steps, station, 1, box.in, box.in_size, 0x22);
    }
    go_to(steps, station, State::kPreOp, "go to PREOP");
    SdoClient client(std::max<std::size_t>(box.out_size, kShortestMailbox),
                     std::max<std::size_t>(box.in_size, kShortestMailbox));
    const auto download = [&](bool before_op) {
      for (const StartUpValue& value : s.setup.start_up) {
        if (value.before_op == before_op) append_download(steps, station, box, client, value);
      }
    };
    download(false);
    for (const ProcessData& data : s.setup.process_data) {
      // Not all SIIs ask for the watchdog: outputs would stay on for ever when the cable breaks.
      const auto control = static_cast<std::uint8_t>(data.control | (data.outputs ? sync_manager::kWatchdog : 0));
      set_sync_manager(steps, station, data.sync_manager, data.start, data.length, control);
    }
    map(steps, s, i);
    if (s.setup.output_bytes > 0) {  // whatever another master has left there
      steps.push_back(write(station, reg::kWatchdogDivider, kWatchdogDivider, "take the time of its watchdog"));
      steps.push_back(write(station, reg::kProcessDataWatchdog, kWatchdogTime, "take the time of its watchdog"));
    }
    const bool clock = bus_.reference >= 0 && s.found.ports.has_clock;
    if (clock) set_clock(steps, s);
    clock_set_.push_back(steps.size());
    if (clock && s.expected.sync_activation != 0) start_sync(steps, s);
    go_to(steps, station, State::kSafeOp, "go to SAFEOP");
    download(true);

    acknowledge(s.run, station, State::kSafeOp, "clear its error");
    Step safe = datagram(Command::kFprd, at_station(station, reg::kAlStatus), std::vector<std::uint8_t>(6), "clear its error");
    safe.mask = {0x1f};
    safe.expected = {static_cast<std::uint8_t>(State::kSafeOp)};
    s.run.push_back(std::move(safe));
    go_to(s.run, station, State::kOp, "go to OP");
  }

  void run(std::size_t i, std::span<const Step> steps) {
    Sequence sequence;
    sequence.start(steps, bus_.slaves[i].times, exchange_.wire().now());
    std::vector<std::uint8_t> data;
    while (sequence.status() == Sequence::Status::kBusy) {
      data.assign(sequence.data().begin(), sequence.data().end());
      // States and latched times do not change from one read to the next; what a mailbox and a clock give does.
      const auto offset = static_cast<std::uint16_t>(sequence.address() >> 16);
      const bool stays = sequence.command() == Command::kFprd && (offset == reg::kAlStatus || offset == reg::kReceiveTime);
      std::optional<std::uint16_t> count;
      if (!stays) {
        count = exchange_.transfer(sequence.command(), sequence.address(), std::span<std::uint8_t>(data));
      } else if (exchange_.confirm(sequence.command(), sequence.address(), data)) {
        count = std::uint16_t{1};
      }
      sequence.receive(count.has_value(), count.value_or(0), data, time_, exchange_.wire().now());
    }
    if (sequence.status() == Sequence::Status::kFailed) throw Error(place_of(i), sequence.failure());
  }

  void compensate_drift() {
    std::array<std::uint8_t, 8> time{};
    const std::int64_t end = exchange_.wire().now() + options_.drift_time;
    for (int n = 0; n < options_.drift_frames && exchange_.wire().now() < end; ++n) {
      exchange_.transfer(Command::kFrmw, at_station(time_.reference, reg::kSystemTime), time);
    }
  }

  Exchange& exchange_;
  const std::vector<ExpectedSlave>& expected_;
  const SetupOptions& options_;
  BusSetup bus_;
  BusTime time_;
  std::vector<std::size_t> clock_set_;  // per slave: number of steps until its clock is set
};

}  // namespace

BusSetup set_up_bus(Exchange& exchange, const std::vector<ExpectedSlave>& expected, const SetupOptions& options) {
  return BusBuilder(exchange, expected, options).build();
}

}  // namespace cotwin::ethercat
