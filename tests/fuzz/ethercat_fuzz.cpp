// Any bytes as frames on an emulated bus, as an SII image, also of a drive, as mails in both directions of CoE, and as a file of start-up values. Nothing is read or written outside, and
// the state stays sane: known states, working counters within what the slaves can count, lengths and indices unchanged.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/bus.h"
#include "components/io/emulators/ethercat/coe_server.h"
#include "components/io/emulators/ethercat/devices.h"
#include "components/io/ethercat/coe.h"
#include "components/io/ethercat/frame.h"
#include "components/io/ethercat/little_endian.h"
#include "components/io/ethercat/master/start_up.h"
#include "components/io/ethercat/registers.h"
#include "components/io/ethercat/sii.h"
#include "components/io/links/ethercat_drives.h"
#include "models/foundation/support/error.h"

namespace {

using namespace cotwin::ethercat;
using Bytes = std::span<const std::uint8_t>;

void check(bool good) {
  if (!good) std::abort();
}

/// Takes parts of the input; zeros after its end.
class Input {
 public:
  explicit Input(Bytes bytes) : bytes_(bytes) {}
  bool empty() const { return bytes_.empty(); }
  template <class T>
  T value() {
    T v{};
    std::memcpy(&v, bytes_.data(), std::min(sizeof v, bytes_.size()));
    bytes_ = bytes_.subspan(std::min(sizeof v, bytes_.size()));
    return v;
  }
  Bytes part(std::size_t size) {
    const Bytes p = bytes_.first(std::min(size, bytes_.size()));
    bytes_ = bytes_.subspan(p.size());
    return p;
  }

 private:
  Bytes bytes_;
};

void check_states(const Bus& bus) {
  for (std::size_t n = 0; n < bus.size(); ++n) {
    const auto state = static_cast<int>(bus.slave(n).state());
    check(state == 1 || state == 2 || state == 3 || state == 4 || state == 8);
  }
}

/// Sends a frame and compares what must not change.
void send(Bus& bus, std::span<std::uint8_t> frame, std::int64_t now) {
  const std::vector<std::uint8_t> before(frame.begin(), frame.end());
  constexpr auto kLenient = FrameReader::Reserved::kIgnored;
  const bool valid = FrameReader(before, kLenient).fault() == FrameFault::kNone;
  const auto back = bus.transmit(frame, now);
  check(!back || *back >= now);
  check_states(bus);
  if (!valid) return;
  FrameReader sent(before, kLenient), returned(frame, kLenient);
  check(returned.fault() == FrameFault::kNone);
  Datagram a, b;
  while (sent.next(a)) {
    check(returned.next(b));
    check(a.command == b.command && a.index == b.index && a.length == b.length && a.circulating == b.circulating);
    const int counted = static_cast<std::uint16_t>(b.working_counter - a.working_counter);
    check(counted <= 3 * static_cast<int>(bus.size()));
    if (a.command == Command::kNop) check(counted == 0 && std::ranges::equal(sent.data(a), returned.data(b)));
    if (is_logical(a.command)) check(a.address == b.address);
  }
}

void run(Bus& bus, Input in) {
  std::vector<std::uint8_t> buffer(kLongestFrame);
  std::int64_t now = 0;
  for (int steps = 0; !in.empty() && steps < 200; ++steps) {
    const auto what = in.value<std::uint8_t>();
    now += std::int64_t{1} << (what >> 4) * 2;
    if ((what & 15) == 15) {
      bus.advance(now);
    } else if ((what & 15) == 14) {
      const std::size_t n = in.value<std::uint8_t>() % bus.size();
      bus.power(n, what & 16, now);
    } else if ((what & 15) == 13) {
      const std::size_t n = in.value<std::uint8_t>() % bus.size();
      bus.cut(n, what & 16);
    } else if ((what & 15) == 12) {
      const Bytes raw = in.part(in.value<std::uint16_t>() % kLongestFrame);
      std::copy(raw.begin(), raw.end(), buffer.begin());
      send(bus, std::span(buffer).first(raw.size()), now);
    } else {
      FrameWriter writer(buffer);
      writer.begin();
      for (int n = 0; n <= (what & 3); ++n) {
        const auto command = static_cast<Command>(in.value<std::uint8_t>() % (kLastCommand + 1));
        const auto address = in.value<std::uint32_t>();
        const std::size_t size = in.value<std::uint16_t>() % 512;
        const std::size_t at = writer.add(command, 0, address, size);
        if (at == 0) break;
        const Bytes data = in.part(size);
        std::copy(data.begin(), data.end(), buffer.begin() + static_cast<std::ptrdiff_t>(at));
      }
      send(bus, std::span(buffer).first(writer.finish().size()), now);
    }
  }
}

void devices(Input in) {
  Bus bus;
  bus.append(std::make_unique<Ek1100>());
  bus.append(std::make_unique<El1809>(terminal_options({.drift = 50e-6, .jitter = 10})));
  bus.append(std::make_unique<El2809>(), {.parent = 0, .port = 3});
  bus.append(std::make_unique<El5101>(), {.parent = 1, .port = 2});
  std::vector<std::uint8_t> buffer(100);
  for (std::uint16_t n = 0; n < 4; ++n) {
    FrameWriter writer(buffer);
    writer.begin();
    const std::uint8_t station[2] = {static_cast<std::uint8_t>(n + 1), 0x10};
    writer.add(Command::kApwr, 0, at_position(n, reg::kStation), station);
    send(bus, std::span(buffer).first(writer.finish().size()), 0);
  }
  run(bus, in);
}

void image(Bytes bytes) {
  const Sii sii = read_sii(bytes, "fuzz");
  Sii again = sii;
  again.checksum_correct = true;
  try {
    check(read_sii(write_sii(sii), "fuzz") == again);
  } catch (const cotwin::Error&) {
    // Names or categories that do not fit into the format in the order of write_sii.
  }
  SlaveOptions options;
  options.esc.sync_managers = kMostSyncManagers;
  Bus bus;
  bus.append(std::make_unique<Slave>(std::vector<std::uint8_t>(bytes.begin(), bytes.end()), options));
  run(bus, Input(bytes.subspan(0x20)));
}

/// An image of a drive: it is refused, or its values can be written and read.
void drive(Bytes bytes) {
  using namespace cotwin::io;
  std::vector<SlaveChoice> slaves(1);
  slaves[0].name = "q1";
  slaves[0].kind = SlaveChoice::Kind::kDrive;
  slaves[0].setup = setup_of(read_sii(bytes, "fuzz"), {}, "fuzz");
  EtherCatDrives drives(slaves, {0}, cotwin::trajectory::free_axes(1), nullptr, "fuzz");
  cotwin::Variables v;
  const cotwin::JointMeasures measures(nullptr);
  cotwin::JointVariables joints(v, measures);
  drives.declare(v, joints);
  const std::vector<double> scale{1e-5}, offset{0};
  Acknowledgement acknowledgement;
  drives.initialise(1e-3, scale, offset, acknowledgement);
  BusSetup setup;
  setup.slaves.resize(1);
  setup.slaves[0].setup = slaves[0].setup;
  setup.output_bytes = slaves[0].setup.output_bytes;
  setup.input_bytes = slaves[0].setup.input_bytes;
  Master master(std::move(setup), 1'000'000, 20'000'000, {});
  cotwin::io::Command command(1);
  for (int n = 0; n < 3; ++n) {
    drives.write(master, n * 1'000'000, command, 1e-3, acknowledgement);
    drives.wait(1e-3, 0.02);
    drives.read(master);
  }
}

void start_up(Bytes bytes) {
  const std::string text(bytes.begin(), bytes.end());
  for (const StartUpRow& row : read_start_up(text, "fuzz")) {
    check(!row.slave.empty() && !row.value.data.empty() && row.value.data.size() <= 4096 && !row.value.origin.empty());
  }
}

struct Owner final : ObjectOwner {
  void refresh(const ObjectEntry&) override {}
  SdoAbort check(const ObjectEntry&, Bytes) override { return SdoAbort::kNone; }
};

void mails(Input in) {
  ObjectDictionary objects;
  objects.add(0x1000, 0, "a", object_type::kU32, 32, 1, true);
  objects.add(0x1001, 1, "b", object_type::kU32, 64, 1, true);
  objects.add_text(0x2000, 0, "text", std::string(100, 'x'));
  Owner owner;
  const std::size_t size = 16 + in.value<std::uint8_t>() % 64;
  CoeServer server(objects, owner, size, size);
  SdoClient client(size, size, 64);
  client.upload(0x2000, 0);
  while (!in.empty()) {
    const auto what = in.value<std::uint8_t>();
    const Bytes data = in.part(in.value<std::uint8_t>());
    if (what % 4 == 0) check(server.answer(data).size() <= size);
    if (what % 4 == 1) {
      client.receive(data);
      check(client.request().size() <= size && client.data().size() <= 64);
    }
    if (what % 4 == 2 && data.size() <= 64) client.download(0x1001, 1, data);
    if (what % 4 == 3) {
      check(server.next_part().size() <= size);
      client.receive(server.answer(client.request()));
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const Bytes rest(data + 1, size - 1);
  try {
    switch (data[0] % 5) {
      case 0:
        devices(Input(rest));
        break;
      case 1:
        image(rest);
        break;
      case 2:
        mails(Input(rest));
        break;
      case 3:
        drive(rest);
        break;
      default:
        start_up(rest);
    }
  } catch (const cotwin::Error& e) {
    check(e.what()[0] != '\0');
  }
  return 0;
}
