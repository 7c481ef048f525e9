#include "components/io/emulators/ethercat/devices.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/components/io/ethercat/wire.h"

namespace cotwin::ethercat::devices_test {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::int64_t kMillisecond = 1'000'000;  // ns

/// The four devices in OP, with the process image of the captured set-up: outputs from 0, inputs behind them.
struct Cell {
  Cell() {
    bus.append(std::make_unique<Ek1100>());
    inputs = static_cast<El1809*>(&bus.append(std::make_unique<El1809>()));
    outputs = static_cast<El2809*>(&bus.append(std::make_unique<El2809>()));
    encoder = static_cast<El5101*>(&bus.append(std::make_unique<El5101>()));
    wire.number_stations();
  }

  /// PDOs of the encoder and the lengths of its process data.
  void start(std::uint16_t out = 3, std::uint16_t in = 5) {
    for (std::size_t n = 1; n < 4; ++n) wire.set_sync_managers(n, n == 3 ? out : 0, n == 3 ? in : 0);
    out_ = out;
    in_ = in;
    wire.set_fmmu(0x1003, 0, 0, 2, 0, 7, 0x0f00, 0, fmmu::kWrite);
    wire.set_fmmu(0x1004, 0, 2, out, 0, 7, 0x1000, 0, fmmu::kWrite);
    wire.set_fmmu(0x1002, 0, 2u + out, 2, 0, 7, 0x1000, 0, fmmu::kRead);
    wire.set_fmmu(0x1004, 1, 4u + out, in, 0, 7, 0x1100, 0, fmmu::kRead);
    for (std::uint16_t s = 0x1001; s <= 0x1004; ++s) wire.request(s, State::kPreOp);
    for (std::uint16_t s = 0x1001; s <= 0x1004; ++s) wire.request(s, State::kSafeOp);
    image.assign(4u + out + in, 0);
    cycle();
    for (std::uint16_t s = 0x1001; s <= 0x1004; ++s) wire.request(s, State::kOp);
    cycle();
  }
  /// One LRW; the outputs are kept in `image`.
  int cycle(std::int64_t period = kMillisecond) {
    wire.now += period - 1000;
    const auto answer = wire.send(Command::kLrw, 0, image);
    if (answer.count >= 0) std::copy(answer.data.begin() + 2 + out_, answer.data.end(), image.begin() + 2 + out_);
    return answer.count;
  }
  template <class T>
  T input(std::size_t at) const {  // of the encoder
    return load<T>(&image[4u + out_ + at]);
  }
  std::uint16_t digital() const { return load<std::uint16_t>(&image[2u + out_]); }

  Bus bus;
  El1809* inputs;
  El2809* outputs;
  El5101* encoder;
  BusWire wire{bus};
  Bytes image;
  std::uint16_t out_ = 3, in_ = 5;
};

TEST(Devices, ACycleOfTheFourDevicesCountsSix) {
  // EK1100 0, EL1809 1 (inputs), EL2809 2 (outputs), EL5101 3 (both).
  Cell c;
  c.start();
  EXPECT_EQ(c.encoder->state(), State::kOp);
  EXPECT_EQ(c.cycle(), 6);
  c.bus.cut(3, true);
  EXPECT_EQ(c.cycle(), 3);
}

TEST(Devices, OutputsFollowInOpAndFallWithTheWatchdog) {
  Cell c;
  c.start();
  c.image[0] = 0x5a;
  c.image[1] = 0xc3;
  c.cycle();
  EXPECT_EQ(c.outputs->channels(), 0xc35a);
  c.wire.request(0x1003, State::kSafeOp);
  EXPECT_EQ(c.outputs->channels(), 0);
  c.wire.request(0x1003, State::kOp);
  c.cycle();
  EXPECT_EQ(c.outputs->channels(), 0xc35a);
  c.bus.advance(c.wire.now + 99 * kMillisecond);
  EXPECT_EQ(c.outputs->channels(), 0xc35a);
  c.bus.advance(c.wire.now + 101 * kMillisecond);
  EXPECT_EQ(c.outputs->channels(), 0);
  c.wire.now += 101 * kMillisecond;
  c.cycle();
  EXPECT_EQ(c.outputs->channels(), 0xc35a);  // without a processor the state stays OP
}

TEST(Devices, AnInputIsSeenThreeMillisecondsAfterItsLastChange) {
  Cell c;
  c.start();
  c.inputs->set_channels(0x8001, c.wire.now);
  const std::int64_t set = c.wire.now;
  std::int64_t seen = 0;
  for (int i = 0; i < 50 && seen == 0; ++i) {
    c.cycle(100'000);
    if (c.digital() == 0x8001) seen = c.wire.now - set;
  }
  EXPECT_GE(seen, 3 * kMillisecond);
  EXPECT_LT(seen, 3 * kMillisecond + 100'000);
  // A pulse of 2.9 ms is not seen, on no channel; a change of another channel does not delay the first.
  c.inputs->set_channels(0x0001, c.wire.now);
  c.bus.advance(c.wire.now + 2'900'000);
  c.inputs->set_channels(0x8001, c.wire.now += 2'900'000);
  for (int i = 0; i < 10; ++i) {
    c.cycle();
    EXPECT_EQ(c.digital(), 0x8001);
  }
}

TEST(Devices, TheCounterWrapsAndReportsItsDirection) {
  Cell c;
  c.start();
  const auto at = [&](std::int64_t counts) {
    c.encoder->set_position(counts, c.wire.now);
    c.cycle();
    return c.input<std::uint16_t>(1);
  };
  const auto status = [&] { return c.input<std::uint8_t>(0); };
  EXPECT_EQ(at(65535), 65535);
  EXPECT_EQ(status() & 0x18, 0);
  EXPECT_EQ(at(65537), 1);
  EXPECT_EQ(status() & 0x18, 0x10);  // overflow
  EXPECT_EQ(at(65536 + 21845), 21845);
  EXPECT_EQ(status() & 0x18, 0x10);
  at(65536 + 21846);  // beyond a third of the range
  EXPECT_EQ(status() & 0x18, 0);
  EXPECT_EQ(at(-1), 65535);
  EXPECT_EQ(status() & 0x18, 0x08);  // underflow
  at(43690 - 65536);
  EXPECT_EQ(status() & 0x18, 0x00);  // below two thirds of the range
}

TEST(Devices, TheLatchTakesThePulseCAndTheExternalEdge) {
  Cell c;
  c.start();
  c.encoder->set_counts_per_turn(4096);
  c.encoder->set_position(100, c.wire.now);
  c.image[2] = 0x01;  // enable latch C
  c.cycle();
  c.encoder->set_position(9000, c.wire.now);  // passes 4096 first
  c.cycle();
  EXPECT_EQ(c.input<std::uint8_t>(0) & 3, 1);
  EXPECT_EQ(c.input<std::uint16_t>(3), 4096);
  c.encoder->set_position(20'000, c.wire.now);
  c.cycle();
  EXPECT_EQ(c.input<std::uint16_t>(3), 4096);  // valid until it is disabled
  c.image[2] = 0;
  c.cycle();
  c.cycle();
  EXPECT_EQ(c.input<std::uint8_t>(0) & 3, 0);
  c.image[2] = 0x01;
  c.cycle();
  c.encoder->set_position(16'000, c.wire.now);  // back over 16384
  c.cycle();
  EXPECT_EQ(c.input<std::uint16_t>(3), 16384);
  c.image[2] = 0x02;  // the external latch on its rising edge
  c.cycle();
  c.encoder->set_latch_input(true);
  c.encoder->set_position(17'000, c.wire.now);
  c.encoder->set_latch_input(false);
  c.encoder->set_latch_input(true);
  c.cycle();
  EXPECT_EQ(c.input<std::uint8_t>(0), 0x22);  // valid, input level
  EXPECT_EQ(c.input<std::uint16_t>(3), 16'000);
  c.image[2] = 0;
  c.cycle();
  c.image[2] = 0x08;  // on its falling edge
  c.cycle();
  c.encoder->set_latch_input(false);
  c.cycle();
  EXPECT_EQ(c.input<std::uint16_t>(3), 17'000);
  c.image[2] = 0;
  c.cycle();
  c.encoder->set_position(16'384, c.wire.now);
  c.image[2] = 0x01;
  c.cycle();
  c.encoder->set_position(20'480, c.wire.now);  // from a pulse exactly to the next
  c.cycle();
  EXPECT_EQ(c.input<std::uint16_t>(3), 20'480);
}

TEST(Devices, TheCounterIsSetOnTheRisingEdge) {
  Cell c;
  c.start();
  c.encoder->set_position(1000, c.wire.now);
  c.image[2] = 0x04;
  c.image[3] = 0x88;
  c.image[4] = 0x13;  // 5000
  c.cycle();
  c.cycle();
  EXPECT_EQ(c.input<std::uint8_t>(0) & 4, 4);
  EXPECT_EQ(c.input<std::uint16_t>(1), 5000);
  c.encoder->set_position(1001, c.wire.now);
  c.cycle();
  EXPECT_EQ(c.input<std::uint16_t>(1), 5001);  // not set again
  c.image[2] = 0;
  c.cycle();
  c.cycle();
  EXPECT_EQ(c.input<std::uint8_t>(0) & 4, 0);
  EXPECT_EQ(c.input<std::uint16_t>(1), 5001);
}

/// Assigns PDOs to the encoder, which is brought to PREOP.
void assign(Cell& c, std::uint16_t out, const std::vector<std::uint16_t>& in) {
  c.wire.set_sync_managers(3);
  c.wire.request(0x1004, State::kPreOp);
  SdoClient client(246, 246);
  const auto write = [&](std::uint16_t index, std::size_t subindex, std::size_t value, std::size_t bytes) {
    Bytes data = {static_cast<std::uint8_t>(value), static_cast<std::uint8_t>(value >> 8)};
    data.resize(bytes);
    client.download(index, static_cast<std::uint8_t>(subindex), data);
    Bytes mail(246);
    std::copy(client.request().begin(), client.request().end(), mail.begin());
    c.wire.write_bytes(0x1004, 0x1800, mail);
    EXPECT_EQ(client.receive(c.wire.read(0x1004, 0x18f6, 246).data), SdoClient::Result::kDone);
  };
  write(0x1c12, 0, 0, 1);
  write(0x1c12, 1, out, 2);
  write(0x1c12, 0, 1, 1);
  write(0x1c13, 0, 0, 1);
  for (std::size_t i = 0; i < in.size(); ++i) write(0x1c13, i + 1, in[i], 2);
  write(0x1c13, 0, in.size(), 1);
}

TEST(Devices, TheLayoutOf32BitsHasTheSameMeaning) {
  Cell c;
  assign(c, 0x1603, {0x1a04});
  c.start(6, 10);
  ASSERT_EQ(c.encoder->state(), State::kOp);
  EXPECT_EQ(c.cycle(), 6);
  c.encoder->set_position(70'000, c.wire.now);
  c.cycle();
  EXPECT_EQ(c.input<std::uint32_t>(2), 70'000u);
  c.image[2] = 0x04;  // set counter: bit 2 of the first byte, value from the third
  store(&c.image[4], std::uint32_t{0xfffffffe});
  c.cycle();
  c.encoder->set_position(70'003, c.wire.now);
  c.cycle();
  EXPECT_EQ(c.input<std::uint32_t>(2), 1u);
  EXPECT_EQ(c.input<std::uint16_t>(0) & 0x1f, 0x14);  // done, overflow
}

TEST(Devices, TheEncoderReportsFrequencyAndPeriodOfItsSignal) {
  Cell c;
  assign(c, 0x1600, {0x1a02, 0x1a03});  // the frequency first
  c.start(3, 14);
  ASSERT_EQ(c.encoder->state(), State::kOp);
  c.encoder->set_position(0, c.wire.now);
  const std::int64_t t = c.wire.now + 10 * kMillisecond;
  c.encoder->set_position(-40, t);  // 4000 counts/s are 1000 periods/s
  c.wire.now = t;
  c.cycle();
  EXPECT_EQ(c.input<std::uint32_t>(0), 100'000u);     // 0.01 Hz
  EXPECT_EQ(c.input<std::uint16_t>(4), 2000);         // 500 ns
  EXPECT_EQ(c.input<std::uint16_t>(8 + 2), 0xffd8u);  // counter of 0x1A03
}

TEST(Devices, WithSync0TheEncoderIsSampledAtItsPulses) {
  Cell c;
  c.start();
  const std::uint64_t start = c.encoder->esc().clock().system_time(c.wire.now) + 5'000'000;
  c.wire.write(0x1004, reg::kStartTime, start);
  c.wire.write(0x1004, reg::kSync0Cycle, std::uint32_t{10'000'000});
  c.encoder->set_position(100, c.wire.now);
  c.wire.write(0x1004, reg::kActivation, std::uint8_t{3});
  c.encoder->set_position(200, c.wire.now);
  c.cycle();
  EXPECT_EQ(c.input<std::uint16_t>(1), 100);  // no pulse yet
  for (int i = 0; i < 6; ++i) c.cycle();
  EXPECT_EQ(c.input<std::uint16_t>(1), 200);
  c.encoder->set_position(300, c.wire.now);
  c.cycle();
  EXPECT_EQ(c.input<std::uint16_t>(1), 200);
  for (int i = 0; i < 10; ++i) c.cycle();
  EXPECT_EQ(c.input<std::uint16_t>(1), 300);
}

}  // namespace
}  // namespace cotwin::ethercat::devices_test
