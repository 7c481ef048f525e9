// Returning frames with flipped bits behind the header of their first datagram, as behind a switch or an interface that does not check the checksum
// of Ethernet: nothing that the axes cannot do is given to the twin, and no single frame changes what is known of the slaves.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "components/io/emulators/ethercat_field.h"
#include "components/io/links/ethercat_drives.h"
#include "components/io/links/ethercat_encoder.h"
#include "tests/components/io/ethercat/cell.h"
#include "tests/components/io/ethercat/faulty_wire.h"

namespace cotwin::ethercat::damage_test {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;

/// Flips one bit of a share of the frames that come back.
struct Flips {
  double share = 0;
  std::mt19937 random{3};
  std::size_t from = kFrameHeader + kDatagramHeader;
  int flipped = 0;
  void operator()(std::span<std::uint8_t> frame) {
    if (static_cast<double>(random() % 1000) >= 1000 * share) return;
    ++flipped;
    frame[from + random() % (frame.size() - from)] ^= static_cast<std::uint8_t>(1u << random() % 8);
  }
};

// 40 counts per cycle, of at most 80 that are believed. Nine of ten frames are damaged at most, so that several in a row are.
TEST(DamagedFrames, MoveNoEncoderFasterThanItsAxis) {
  for (const double share : {0.01, 0.2, 0.9}) {
    Cell cell;
    cell.set_up();
    cell.cycles(60);
    FaultyWire wire(cell.wire);
    Flips flips;
    wire.changes = [&](std::span<std::uint8_t> frame) { flips(frame); };
    io::EtherCatEncoder encoder(true);
    encoder.reset(80e3);
    std::int64_t position = 0, before = 0, start = 0;
    int cycles = 0;
    for (int i = 0; i < 6000; ++i) {
      if (i == 100) flips.share = share;
      cell.wire.advance_to(cell.next += kMs);
      cell.encoder().set_position(position += 40, cell.next);
      cell.master->cycle(wire);
      encoder.advance(1e-3);
      ++cycles;
      if (cell.master->fresh()) encoder.read(cell.master->inputs(3), false, 0.02);
      if (i == 100) start = encoder.counts() - position;
      if (const auto speed = encoder.pop_speed(); speed && i > 100) {
        ASSERT_LE(std::abs(speed->value), 80e3 + 3 / speed->duration) << share << ' ' << i;
        cycles = 0;
      }
      ASSERT_LE(std::abs(encoder.counts() - before), 80 * (cycles + 200)) << share << ' ' << i;
      before = encoder.counts();
      if (i > 100 && cycles == 0) {
        ASSERT_LE(std::abs(encoder.counts() - start - position), 250) << share << ' ' << i;
      }
    }
    EXPECT_GT(flips.flipped, 6000 * share);
    EXPECT_GT(encoder.implausible(), 0);
    EXPECT_EQ(encoder.jumps(), 0) << share;
  }
}

TEST(DamagedFrames, ChangeNothingThatIsKnownOfTheSlavesByASingleOne) {
  Cell cell;
  cell.set_up();
  cell.cycles(500);
  FaultyWire wire(cell.wire);
  Flips flips;
  flips.share = 1;
  int cyclic = 0, errands = 0;
  wire.changes = [&](std::span<std::uint8_t> frame) {
    FrameReader reader(frame);
    Datagram d;
    if (!reader.next(d)) return;
    // States are read one by one after a damaged cycle.
    if (d.index < 0x80 ? ++cyclic % 20 == 0 : ++errands % 5 == 0) flips(frame);
  };
  std::int64_t largest = 0;
  for (int i = 0; i < 20'000; ++i) {
    cell.wire.advance_to(cell.next += kMs);
    cell.master->cycle(wire);
    ASSERT_TRUE(cell.master->present() == 4 || cell.master->present() == 0) << i << ": " << cell.master->present();
    largest = std::max(largest, cell.master->clock_difference());
  }
  EXPECT_LT(largest, 100) << "ns";
  EXPECT_EQ(cell.master->counters().slave_lost, 0);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(cell.master->status(i).restarts, 0) << i;
}

TEST(DamagedFrames, ACounterThatIsElsewhereLosesThePositionAndMovesNothing) {
  io::EtherCatEncoder encoder(true);
  encoder.reset(1000);
  std::vector<std::uint8_t> in(10);
  const auto read = [&](std::int64_t counter) {
    io::write_bits(in, 16, 32, static_cast<std::uint32_t>(counter));
    encoder.advance(1e-3);
    encoder.read(in, false, 0.02);
    return encoder.counts();
  };
  std::int64_t counter = 0;
  for (int i = 0; i < 100; ++i) read(++counter);
  const std::int64_t at = encoder.counts();
  for (const int wrong : {1 << 19, 1 << 18, (1 << 18) + 1, 1 << 30}) EXPECT_EQ(read(counter + wrong), at);
  EXPECT_EQ(read(++counter), at + 1) << "four damaged ones in a row are held, whatever they agree on";
  EXPECT_EQ(encoder.jumps(), 0);
  EXPECT_FALSE(encoder.uncertain);
  counter += 100'000;
  for (int i = 0; i < 5; ++i) EXPECT_EQ(read(++counter), at + 1);
  EXPECT_EQ(encoder.jumps(), 1);
  EXPECT_TRUE(encoder.uncertain);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(read(++counter), at + 2 + i) << "it goes on from where it was";
  EXPECT_EQ(encoder.implausible(), 9);
}

// One frame of twenty is lost on each way, and one bit of every twentieth answer is turned.
TEST(DamagedFrames, DoNotKeepABusFromStartingAndGiveItNoWrongSlaves) {
  Cell sound;
  sound.set_up();
  const BusSetup& expected = sound.master->bus();
  for (unsigned seed = 1; seed <= 40; ++seed) {
    SCOPED_TRACE(seed);
    Cell cell;
    FaultyWire wire(cell.wire, seed);
    wire.loss = 0.05;
    Flips flips;
    flips.share = 0.05;
    flips.from = kFrameHeader;
    flips.random.seed(seed);
    wire.changes = [&](std::span<std::uint8_t> frame) { flips(frame); };
    Exchange exchange(wire);
    std::string refusal;
    try {
      cell.master = std::make_unique<Master>(set_up_bus(exchange, cell.slaves, cell.options), kMs, 20 * kMs,
                                             BusTime{0, cell.options.system_time, 0});
    } catch (const Error& e) {
      refusal = e.what();
    }
    ASSERT_EQ(refusal, "");
    const BusSetup& bus = cell.master->bus();
    ASSERT_EQ(bus.slaves.size(), expected.slaves.size());
    for (std::size_t i = 0; i < bus.slaves.size(); ++i) {
      EXPECT_EQ(bus.slaves[i].found.image, expected.slaves[i].found.image) << i;
      EXPECT_EQ(bus.slaves[i].found.features, expected.slaves[i].found.features) << i;
      EXPECT_NEAR(bus.slaves[i].delay, expected.slaves[i].delay, 20) << i;
    }
    cell.next = cell.wire.now() + kMs;
    cell.cycles(3000);
    EXPECT_TRUE(cell.master->operational());
    EXPECT_LT(cell.master->clock_difference(), 5000) << "ns";
  }
}

TEST(DamagedFrames, CountersThatDoNotFollowFromOneAnotherAreHeldOn) {
  io::EtherCatEncoder encoder(true);
  encoder.reset(1000);
  std::vector<std::uint8_t> in(10);
  const auto read = [&](std::int64_t counter) {
    io::write_bits(in, 16, 32, static_cast<std::uint32_t>(counter));
    encoder.advance(1e-3);
    encoder.read(in, false, 0.02);
    return encoder.counts();
  };
  read(1 << 20);  // the first one is damaged
  std::int64_t counter = 7;
  for (int i = 0; i < 50; ++i) read(++counter);
  EXPECT_EQ(encoder.counts(), 49);
  EXPECT_EQ(encoder.implausible(), 1);
  for (int i = 0; i < 15; ++i) EXPECT_EQ(read(++counter + (std::int64_t{1} << (8 + i))), 49) << i;
  EXPECT_EQ(encoder.jumps(), 0) << "five and more in a row, but at other places";
  EXPECT_EQ(read(++counter), 65);
  EXPECT_FALSE(encoder.uncertain);
  for (int i = 0; i < 30; ++i) EXPECT_EQ(read(++counter + (std::int64_t{1} << (8 + i % 20))), 65) << i;
  EXPECT_GE(encoder.jumps(), 1) << "longer than patience";
  EXPECT_TRUE(encoder.uncertain);
}

/// Two emulated drives whose answers are damaged before they are read.
struct Drives {
  /// Without `gives_speed` the process data have no speed.
  explicit Drives(double rad_per_count = 1e-5, double dq_max = 1, bool gives_speed = true,
                  double q_max = std::numeric_limits<double>::infinity(), const char* mode = "position")
      : slaves(choices(gives_speed)),
        scale(2, rad_per_count),
        field(slaves, 2),
        wire(field.bus()),
        faulty(wire),
        drives(slaves, io::joints_of(slaves, 2, "test"), axes(dq_max, q_max), nullptr, "test") {
    const JointMeasures measures(nullptr);
    JointVariables joints(v, measures);
    drives.declare(v, joints);
    field.declare(v, joints);
    assign_text(v.at("drive_mode"), mode);
    drives.initialise(1e-3, scale, offset, acknowledgement);
    field.initialise(0);
    field.apply(0);
    Exchange exchange(wire);
    std::vector<ExpectedSlave> expected = io::expected_slaves(slaves, false, 0);
    drives.add_start_up(expected);
    master.emplace(set_up_bus(exchange, expected, options), kMs, 20 * kMs, BusTime{});
    next = wire.now();
  }
  static std::vector<io::SlaveChoice> choices(bool gives_speed) {
    SettingList list;
    io::declare_ethercat_settings(list);
    Settings settings("io", "slaves=EK1100,q1:DRIVE402,q2:DRIVE402", {}, {});
    settings.declare(std::move(list));
    std::vector<io::SlaveChoice> all = io::read_slaves(settings, "test");
    for (io::SlaveChoice& s : all) {
      if (!gives_speed) std::erase_if(s.setup.inputs, [](const Channel& c) { return c.index == cia402::object::kVelocity; });
    }
    return all;
  }
  static std::vector<trajectory::Axis> axes(double dq_max, double q_max) {
    std::vector<trajectory::Axis> result = trajectory::free_axes(2);
    for (trajectory::Axis& axis : result) {
      axis.dq_max = dq_max;
      axis.q_min = -q_max;
      axis.q_max = q_max;
    }
    return result;
  }
  void step() {
    field.exchange();
    wire.advance_to(next += kMs);
    field.apply(next);
    master->collect(faulty, 0);
    drives.write(*master, wire.now(), command, 1e-3, acknowledgement);
    master->cycle(faulty);
    drives.wait(1e-3, 0.02);
    if (master->fresh()) drives.read(*master);
    drives.measure(measured, 0, 0.02);
  }
  bool enabled() { return v.at("drives_enabled").booleans()[0]; }

  std::vector<io::SlaveChoice> slaves;
  std::vector<double> scale, offset{0, 0};
  io::EtherCatField field;
  EmulatedWire wire;
  FaultyWire faulty;
  io::EtherCatDrives drives;
  Variables v;
  io::Acknowledgement acknowledgement;
  SetupOptions options;
  std::optional<Master> master;
  io::Command command{2};
  io::Measured measured{2};
  std::int64_t next = 0;
};

/// Turns one bit of drive q1's position or speed in returning process data while `runs` says so.
void flip(std::span<std::uint8_t> frame, std::size_t byte, unsigned bit) {
  FrameReader reader(frame);
  Datagram d;
  while (reader.next(d)) {
    if (d.command == Command::kLrw) frame[d.data + byte] ^= static_cast<std::uint8_t>(1u << bit);
  }
}

// 0.4 rad/s are 0.4 counts of 1 mrad per cycle: the mean speed of a cycle with a count is 1 rad/s.
TEST(DamagedFrames, ACoarseDriveWithoutASpeedIsNotTakenForADamagedOne) {
  Drives d(1e-3, 0.4, false);
  for (int i = 0; i < 400 && !d.enabled(); ++i) d.step();
  ASSERT_TRUE(d.enabled());
  d.command.q = {0.3, -0.3};
  for (int i = 0; i < 3000; ++i) d.step();
  EXPECT_NEAR(d.measured.q[0], 0.3, 2e-3);
  EXPECT_NEAR(d.measured.q[1], -0.3, 2e-3);
  EXPECT_EQ(d.drives.implausible(), 0);
  EXPECT_TRUE(d.enabled());
}

TEST(DamagedFrames, MoveNoDriveAndStopAllIfTheyGoOn) {
  Drives d;
  for (int i = 0; i < 400 && !d.enabled(); ++i) d.step();
  ASSERT_TRUE(d.enabled());
  // The inputs of q1 follow the outputs of both drives.
  const BusSlave& q1 = d.master->bus().slaves[1];
  const auto& channels = d.slaves[1].setup.inputs;
  const std::size_t begin = d.master->bus().output_bytes + q1.inputs_at;
  const auto byte_of = [&](std::uint16_t index) {
    return begin + std::ranges::find(channels, index, &Channel::index)->bit / 8;
  };
  for (const std::size_t at : {byte_of(cia402::object::kPosition), byte_of(cia402::object::kVelocity)}) {
    for (int n = 0; n < 400; ++n) {
      const bool damaged = n % 5 != 0;  // four in a row
      d.faulty.changes = [&](std::span<std::uint8_t> frame) {
        if (damaged) flip(frame, at + 2 + n % 2, 2 + n % 6);  // 2.6 rad or rad/s at least
      };
      d.step();
      ASSERT_NEAR(d.measured.q[0], 0, 1e-3) << n;
      ASSERT_NEAR(d.measured.dq[0], 0, 1e-2) << n;
      ASSERT_TRUE(d.enabled()) << n;
    }
  }
  const int held = d.drives.implausible();
  EXPECT_GT(held, 600);
  d.faulty.changes = [&](std::span<std::uint8_t> frame) { flip(frame, byte_of(cia402::object::kPosition) + 2, 6); };
  for (int n = 0; n < 7; ++n) d.step();
  EXPECT_FALSE(d.enabled()) << "a drive that is elsewhere stops all";
  EXPECT_TRUE(d.acknowledgement.awaits());
  std::vector<std::string> sentences;
  d.drives.append_notes(sentences);
  EXPECT_THAT(sentences, Contains(HasSubstr("drive q1 gave positions or speeds that no motion explains")));
}

/// Makes the rig turn one bit of q1's position in the frames for which `runs` is true.
std::size_t position_of(Drives& d) {
  const BusSlave& q1 = d.master->bus().slaves[1];
  const std::size_t bit = std::ranges::find(d.slaves[1].setup.inputs, cia402::object::kPosition, &Channel::index)->bit;
  return d.master->bus().output_bytes + q1.inputs_at + bit / 8;
}

// Bit 31 flipped in any number of answers: beyond the limits of the joint it is no place, and within them (1e-9 rad per count: 2.1 rad) a jump that
// leaves no offset when it ends.
TEST(DamagedFrames, TheSameBitInManyAnswersLeavesNoOffset) {
  for (const double scale : {1e-5, -1e-5, 1e-9}) {
    for (const int answers : {1, 4, 5, 6, 7, 18}) {
      SCOPED_TRACE(::testing::Message() << scale << ' ' << answers);
      Drives d(scale, 1, true, 3);
      for (int i = 0; i < 400 && !d.enabled(); ++i) d.step();
      ASSERT_TRUE(d.enabled());
      const std::size_t at = position_of(d);
      d.faulty.changes = [&](std::span<std::uint8_t> frame) { flip(frame, at + 3, 7); };
      for (int n = 0; n < answers; ++n) {
        d.step();
        EXPECT_LE(std::abs(d.measured.q[0]), 3);
        EXPECT_LE(std::abs(d.measured.dq[0]), 1);
      }
      d.faulty.changes = nullptr;
      for (int n = 0; n < 30; ++n) d.step();
      EXPECT_NEAR(d.measured.q[0], 0, 1e-3);
      EXPECT_EQ(d.acknowledgement.awaits(), answers > 4 && scale == 1e-9);
      d.acknowledgement.begin("test");
      for (int n = 0; n < 400; ++n) d.step();
      EXPECT_NEAR(d.measured.q[0], 0, 1e-3) << "nothing moves";
      EXPECT_TRUE(d.enabled());
    }
  }
}

TEST(DamagedFrames, AJumpInMonitorModeAwaitsAnAcknowledgement) {
  Drives d(1e-9, 1, true, 3, "monitor");
  for (int i = 0; i < 100; ++i) d.step();
  EXPECT_FALSE(d.acknowledgement.awaits());
  const std::size_t at = position_of(d);
  d.faulty.changes = [&](std::span<std::uint8_t> frame) { flip(frame, at + 3, 7); };
  for (int i = 0; i < 6; ++i) d.step();
  EXPECT_TRUE(d.acknowledgement.awaits());
  EXPECT_EQ(d.drives.implausible(), 5);
}

// Nothing that can be believed for longer than patience: the drives stop, although frames come.
TEST(DamagedFrames, StopDrivesWhenNothingIsBelievedForTooLong) {
  Drives d(1e-5, 1, true, 3);
  for (int i = 0; i < 400 && !d.enabled(); ++i) d.step();
  const std::size_t at = position_of(d);
  int n = 0;
  d.faulty.changes = [&](std::span<std::uint8_t> frame) { flip(frame, at + 2, static_cast<unsigned>(++n % 3) + 3); };
  for (int i = 0; i < 30; ++i) d.step();
  EXPECT_FALSE(d.enabled());
  EXPECT_TRUE(d.acknowledgement.awaits());
  EXPECT_NEAR(d.measured.q[0], 0, 1e-9);
}

// Every bit of both drives' inputs, in each mode: the axes stay, and drives that have stopped move again only after an acknowledgement.
TEST(DamagedFrames, NoBitOfADriveMovesAnAxis) {
  for (const char* mode : {"position", "velocity"}) {
    Drives d(1e-5, 1, true, 3, mode);
    const auto begin = [&] {
      d.acknowledgement.begin("test");
      for (int i = 0; i < 600 && !d.enabled(); ++i) d.step();
      for (int i = 0; i < 10; ++i) d.step();
      ASSERT_TRUE(d.enabled());
    };
    const auto axis = [&](const char* name) { return 1e-5 * d.v.at(name).reals()[0]; };
    begin();
    const std::size_t from = d.master->bus().output_bytes, size = d.master->bus().slaves[1].setup.input_bytes;
    std::mt19937 random(9);
    int stops = 0;
    for (int n = 0; n < 700 && !HasFatalFailure(); ++n) {
      const std::size_t at = from + random() % (2 * size);
      const auto bit = static_cast<unsigned>(random() % 8);
      const int in_a_row = static_cast<int>(random() % 5), every = in_a_row > 0 ? 0 : std::array{2, 3, 5}[random() % 3];
      for (int k = 0; k < 30; ++k) {
        const bool damaged = every > 0 ? k % every == 0 : k < in_a_row;
        d.faulty.changes = [&](std::span<std::uint8_t> frame) {
          if (damaged) flip(frame, at, bit);
        };
        d.step();
        for (const char* name : {"q1_field", "q2_field"}) {
          ASSERT_NEAR(axis(name), 0, 1e-3) << mode << " byte " << at - from << " bit " << bit << ": " << in_a_row << ' '
                                           << every;
        }
      }
      d.faulty.changes = nullptr;
      const bool stopped = d.acknowledgement.awaits();
      EXPECT_FALSE(stopped && in_a_row < 3 && every != 2)
          << mode << " byte " << at - from << " bit " << bit << ": " << in_a_row << ' ' << every;
      stops += stopped ? 1 : 0;
      if (stopped) begin();
    }
    EXPECT_GT(stops, 0);
  }
}

/// Adds so many counts to the position in returning process data.
void add(std::span<std::uint8_t> frame, std::size_t byte, int counts) {
  FrameReader reader(frame);
  Datagram d;
  while (reader.next(d)) {
    if (d.command != Command::kLrw) continue;
    const std::span<std::uint8_t> value = frame.subspan(d.data + byte);
    io::write_bits(value, 0, 32, io::read_bits(value, 0, 32) + static_cast<std::uint32_t>(counts));
  }
}

// The position drifts by so much an answer, whose speed says 0: the drives are not enabled, and nothing is acknowledged.
TEST(DamagedFrames, NoDriveIsEnabledAtAPositionThatDrifts) {
  for (const int counts : {5, 20, 100, 400}) {
    Drives d(1e-5, 1, true, 30);
    const std::size_t at = position_of(d);
    int off = 0;
    d.faulty.changes = [&](std::span<std::uint8_t> frame) { add(frame, at, off += counts); };
    for (int i = 0; i < 2500; ++i) {
      d.step();
      ASSERT_NE(d.v.at("drive_state").integers()[0], 4) << counts << ' ' << i;
    }
    EXPECT_TRUE(d.acknowledgement.awaits());
    EXPECT_FALSE(d.drives.agrees());
    std::vector<std::string> sentences;
    d.drives.append_notes(sentences);
    EXPECT_THAT(sentences, Contains(HasSubstr("did not move as its speed says")));
  }
}

// Positions are off from the first answer on: the drive jumps there once when it is enabled, and is not enabled again.
TEST(DamagedFrames, ADriveThatJumpsWhenItIsEnabledStopsUntilItIsAcknowledged) {
  for (const int off : {10'000, 30'000}) {
    Drives d(1e-5, 1, true, 3);
    const std::size_t at = position_of(d);
    d.faulty.changes = [&](std::span<std::uint8_t> frame) { add(frame, at, off); };
    for (int i = 0; i < 3000; ++i) d.step();
    EXPECT_TRUE(d.acknowledgement.awaits());
    EXPECT_LE(std::abs(1e-5 * d.v.at("q1_field").reals()[0]), 1.25e-5 * off) << off;
  }
}

// A difference that ends when the drives are wished on leaves them where nobody knows: somebody has to look.
TEST(DamagedFrames, ADriftBeforeEnablingIsAcknowledged) {
  Drives d(1e-5, 1, true, 3);
  const std::size_t at = position_of(d);
  assign_text(d.v.at("enable"), "false");
  int off = 0;
  d.faulty.changes = [&](std::span<std::uint8_t> frame) { add(frame, at, off); };
  for (int i = 0; i < 1000; ++i, off += 20) d.step();
  assign_text(d.v.at("enable"), "true");
  for (int i = 0; i < 1000; ++i) d.step();
  EXPECT_TRUE(d.acknowledgement.awaits());
  EXPECT_NEAR(d.v.at("q1_field").reals()[0], 0, 10);
}

// What a note names is what was counted.
TEST(DamagedFrames, NotesNameTheCause) {
  Drives d;
  for (int i = 0; i < 400 && !d.enabled(); ++i) d.step();
  const auto& channels = d.slaves[1].setup.inputs;
  const std::size_t status = d.master->bus().output_bytes + d.master->bus().slaves[1].inputs_at +
                             std::ranges::find(channels, cia402::object::kStatusWord, &Channel::index)->bit / 8;
  const auto notes = [&] {
    std::vector<std::string> sentences;
    d.drives.append_notes(sentences);
    return sentences;
  };
  for (int i = 0; i < 40; ++i) {
    d.faulty.changes = [&](std::span<std::uint8_t> frame) {
      if (i == 5 || i == 6) flip(frame, status, 2);
    };
    d.step();
    ASSERT_TRUE(d.enabled());
  }
  EXPECT_THAT(notes(), ::testing::ElementsAre("2 status words of drive q1 not used, because the next ones differed"));
  d.faulty.changes = nullptr;
  d.faulty.loss = 1;
  for (int i = 0; i < 30; ++i) d.step();
  EXPECT_THAT(notes(), Contains("the drives were stopped 1 time, last because 20 answers did not come in time, for 0.02 s"));
}

// Steps of the twin that come late and then at once: what is sent within a cycle of the drive is one step together.
TEST(DamagedFrames, LateStepsAndLateFramesGiveNoTwoTargetsInACycle) {
  Drives d(1e-7, 0.5);
  for (int i = 0; i < 400 && !d.enabled(); ++i) d.step();
  ASSERT_TRUE(d.enabled());
  d.command.q = {100, -100};
  for (int i = 0; i < 700; ++i) d.step();
  const BusSlave& q1 = d.master->bus().slaves[1];
  const std::size_t bit = std::ranges::find(d.slaves[1].setup.outputs, cia402::object::kTargetPosition, &Channel::index)->bit;
  const auto target = [&] { return 1e-7 * static_cast<std::int32_t>(io::read_bits(d.master->outputs(1), bit, 32)); };
  ASSERT_GT(q1.setup.output_bytes, 0u);
  std::mt19937 random(5);
  std::int64_t due = d.next, sent = d.wire.now();
  double before = target(), way = 0;
  for (int i = 0; i < 3000; ++i) {
    due += kMs;
    const bool late = random() % 10 == 0;
    d.next = std::max(d.wire.now(), due + (late ? static_cast<std::int64_t>(random() % (3 * kMs)) : 0)) - kMs;
    d.faulty.loss = random() % 20 == 0 ? 1 : 0;
    d.step();
    const double now = target(), elapsed = 1e-9 * static_cast<double>(d.next - sent);
    ASSERT_LE(std::abs(now - before), 1.01 * 0.5 * std::min(elapsed, 1e-3) + 1e-6) << i << ' ' << elapsed;
    way += now - before;
    before = now;
    sent = d.next;
  }
  EXPECT_GT(way, 0.6 * 0.5 * 3) << "the motion goes on";
}

// A time of 64 bits may be anything, and its differences overflow.
TEST(DamagedFrames, GiveNoTimeOfTheBusAndNoBeginOfSync0) {
  constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min(), kMost = std::numeric_limits<std::int64_t>::max();
  constexpr std::int64_t kNow = 800'000'000'000'000'000, kMs = 1'000'000;
  const BusTime bus{1, kNow, 0};
  for (const std::int64_t time : {kLeast, kLeast + 1, kLeast + kNow, -kNow, kMost - 1, kMost})
    EXPECT_FALSE(bus.is_plausible(time, 0)) << time;
  EXPECT_TRUE(bus.is_plausible(kNow + 9 * kMs, 0));
  EXPECT_FALSE(BusTime({1, kMost, 0}).is_plausible(kLeast, 20 * kMs)) << "2^64 goes on at 0, but 20 ms later";
  EXPECT_TRUE(BusTime({1, kMost, 0}).is_plausible(kLeast, kMs));

  Step read, begin, check;
  read.kind = Step::Kind::kReadNow;
  begin.kind = Step::Kind::kWriteStart;
  check.kind = Step::Kind::kCheckStart;
  check.back = 2;
  for (Step* step : {&read, &begin, &check}) step->data.assign(8, 0);
  const std::vector<Step> steps{read, begin, check};
  const auto answer = [](std::int64_t time) {
    std::vector<std::uint8_t> data(8);
    store(data.data(), time);
    return data;
  };
  for (const std::int64_t damaged : {kLeast, -kNow, kNow - 1'000'000 * kMs, kNow + 1'000'000 * kMs, kMost - kMs, kMost}) {
    Sequence sequence;
    BusTime time = bus;
    sequence.start(steps, {.sync0_cycle = kMs}, 0);
    sequence.receive(true, 1, answer(damaged), time, 0);
    sequence.receive(true, 1, answer(0), time, 0);
    EXPECT_EQ(sequence.receive(true, 1, answer(kNow), time, 0), Sequence::Status::kBusy) << damaged << ": it is read again";
    sequence.receive(true, 1, answer(kNow), time, 0);
    EXPECT_EQ(load<std::int64_t>(sequence.data().data()), kNow + 101 * kMs);
    sequence.receive(true, 1, answer(0), time, 0);
    EXPECT_EQ(sequence.receive(true, 1, answer(kNow + 5 * kMs), time, 0), Sequence::Status::kDone);
  }
}

}  // namespace
}  // namespace cotwin::ethercat::damage_test
