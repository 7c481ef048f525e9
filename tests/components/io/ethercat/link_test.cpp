// unit:io?link=ethercat with an emulated bus behind it, and with one behind a pair of virtual interfaces.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#ifdef __linux__
#include <pthread.h>
#include <sched.h>
#endif

#include "components/io/emulators/ethercat/devices.h"
#include "components/unit/tick_source.h"
#include "components/unit/unit_table.h"
#include "models/foundation/net/raw_socket.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::io::link_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::error_of;
using ::testing::HasSubstr;

constexpr Duration kTick{1'000'000};

/// The unit and the names of its ports.
struct Ports {
  Instance instance;
  Time now{0};

  explicit Ports(const std::string& query)
      : instance(make_unit("unit:io?" + query, {}, {fs::path(places::source()) / "models"}, unit_types())) {}
  void set(const std::string& name, const std::string& value) { assign_text(instance.variables.at(name), value); }
  void set(const std::string& name, std::size_t i, bool value) { instance.variables.at(name).booleans()[i] = value; }
  double real(const std::string& name, std::size_t i = 0) { return instance.variables.at(name).reals()[i]; }
  int integer(const std::string& name, std::size_t i = 0) { return instance.variables.at(name).integers()[i]; }
  bool boolean(const std::string& name, std::size_t i = 0) { return instance.variables.at(name).booleans()[i]; }
  void start() { instance.unit->initialise(now); }
  void steps(int n) {
    for (int i = 0; i < n; ++i, now = now + kTick) ASSERT_EQ(instance.unit->step(now, kTick), StepResult::kDone);
  }
};

const std::string kCell = "link=ethercat&slaves=EK1100,buttons:EL1809,valves:EL2809,axis:EL5101";

TEST(EtherCatLink, HasPortsForEachDevice) {
  for (const std::string bits : {"16", "32"}) {
    Ports io(kCell + "&encoder_bits=" + bits);
    io.set("q_scale", "1e-5");
    io.set("q_offset", "0.25");
    io.start();
    io.steps(80);
    ASSERT_TRUE(io.boolean("operational")) << bits;
    EXPECT_EQ(io.integer("answering"), 4);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(io.integer("state", i), 8) << i;
    io.set("buttons_field", 0, true);
    io.set("buttons_field", 15, true);
    io.set("valves", 2, true);
    io.set("valves", 14, true);
    io.steps(8);  // the filter of the inputs takes 3 ms
    for (std::size_t c = 0; c < 16; ++c) {
      EXPECT_EQ(io.boolean("buttons", c), c == 0 || c == 15) << c;
      EXPECT_EQ(io.boolean("valves_field", c), c == 2 || c == 14) << c;
    }
    // A motion further than 16 bits can count.
    for (int i = 1; i <= 100; ++i) {
      io.set("q_field", std::to_string(-2000.5 * i));
      io.steps(1);
    }
    io.steps(2);
    EXPECT_EQ(io.integer("axis_count"), -200'050);
    EXPECT_DOUBLE_EQ(io.real("q"), 0.25 - 2.0005);
    EXPECT_EQ(io.integer("lost") + io.integer("working_counter_errors") + io.integer("slaves_lost"), 0);
  }
}

TEST(EtherCatLink, MeasuresTheSpeedOfAnAxis) {
  Ports io(kCell);
  io.set("q_scale", "1e-3");
  io.set("dq_cutoff", "20");
  io.start();
  for (int i = 0; i < 300; ++i) {
    io.set("q_field", std::to_string(5.0 * i));
    io.steps(1);
  }
  EXPECT_NEAR(io.real("dq"), 5.0, 1e-6);  // 5 counts per ms of 1e-3
  EXPECT_NEAR(io.real("ddq"), 0.0, 1e-3);
}

TEST(EtherCatLink, SetsTheCounterOnARisingEdge) {
  Ports io(kCell + "&encoder_bits=32");
  io.start();
  io.steps(60);
  io.set("q_field", "1000");
  io.steps(3);  // no motion explains it: one cycle more for its confirmation
  EXPECT_EQ(io.integer("axis_count"), 1000);
  io.set("axis_set_value", "-5");
  io.set("axis_set", 0, true);
  io.steps(3);
  EXPECT_TRUE(io.boolean("axis_set_done"));
  EXPECT_EQ(io.integer("axis_count"), -5);
  io.set("q_field", "1010");
  io.steps(3);
  EXPECT_EQ(io.integer("axis_count"), 5);
}

TEST(EtherCatLink, SwitchesOffAndTellsIfACableIsCutAndAPositionIsLost) {
  Ports io(kCell);
  io.set("restart", "automatic");
  io.start();
  io.set("valves", 0, true);
  io.steps(80);
  io.set("q_field", "500");
  io.steps(2);
  ASSERT_TRUE(io.boolean("valves_field", 0));
  io.set("cut", "3");
  io.steps(4);
  EXPECT_FALSE(io.boolean("operational"));
  EXPECT_FALSE(io.boolean("valves_field", 0));
  EXPECT_FALSE(io.boolean("fresh"));
  io.set("q_field", "600");  // moved while it is cut off
  io.set("cut", "-1");
  io.steps(200);
  EXPECT_TRUE(io.boolean("operational"));
  EXPECT_TRUE(io.boolean("valves_field", 0));
  EXPECT_EQ(io.integer("axis_count"), 600);
  io.set("off", "3");
  io.steps(100);
  EXPECT_EQ(io.integer("state", 3), 0);
  io.set("q_field", "700");
  io.set("off", "-1");
  io.steps(300);
  EXPECT_TRUE(io.boolean("operational"));
  EXPECT_EQ(io.integer("axis_count"), 600) << "the terminal has forgotten its counter";
  EXPECT_EQ(io.integer("recovered"), io.integer("slaves_lost"));
  EXPECT_TRUE(io.boolean("axis_uncertain"));
  std::vector<std::string> told;
  io.instance.unit->append_notes(told);
  ASSERT_EQ(told.size(), 2u);
  EXPECT_THAT(told[0], HasSubstr("was not operational at some time"));
  EXPECT_THAT(told[1], HasSubstr("an encoder terminal was switched off and on"));
}

TEST(EtherCatLink, ShowsATotalLossWithinTwoCycles) {
  Ports io(kCell);
  io.start();
  io.steps(80);
  ASSERT_EQ(io.integer("answering"), 4);
  io.set("cut", "0");
  io.steps(1);
  io.steps(2);
  EXPECT_EQ(io.integer("answering"), 0);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(io.integer("state", i), 0) << i;
  io.set("cut", "-1");
  io.steps(300);
  EXPECT_EQ(io.integer("answering"), 4);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(io.integer("state", i), 8) << i;
}

// The counter is 100 000 further in one cycle, 25 times as far as the terminal can count.
TEST(EtherCatLink, AnEncoderThatIsElsewhereIsALossAndMovesNothing) {
  Ports io(kCell);
  io.set("q_scale", "1e-5");
  io.set("counts_per_q", "1e5");
  io.start();
  io.set("valves", 3, true);
  io.steps(100);
  ASSERT_TRUE(io.boolean("valves_field", 3));
  io.instance.variables.at("q_field").reals()[0] = 1;
  io.steps(40);
  EXPECT_EQ(io.real("q"), 0);
  EXPECT_EQ(io.real("dq"), 0);
  EXPECT_EQ(io.integer("implausible"), 5);
  EXPECT_TRUE(io.boolean("axis_uncertain"));
  EXPECT_TRUE(io.boolean("awaits_acknowledgement"));
  EXPECT_FALSE(io.boolean("valves_field", 3)) << "outputs are off";
  io.instance.variables.at("q_field").reals()[0] = 1.01;
  io.set("acknowledge", "true");
  io.steps(60);
  EXPECT_NEAR(io.real("q"), 0.01, 2e-5) << "it goes on from where it was";
  EXPECT_TRUE(io.boolean("valves_field", 3));
  std::vector<std::string> told;
  io.instance.unit->append_notes(told);
  EXPECT_THAT(told, ::testing::Contains(HasSubstr("encoder terminals gave such counters 1 time in a row")));
}

TEST(EtherCatLink, GivesABitThatThreeAnswersInARowHave) {
  Ports io(kCell);
  io.start();
  io.steps(80);
  for (int cycles = 1; cycles <= 4; ++cycles) {
    io.set("buttons_field", 0, true);
    bool seen = false;
    for (int k = 0; k < 15; ++k) {
      if (k == cycles) io.set("buttons_field", 0, false);
      io.steps(1);
      seen = seen || io.boolean("buttons", 0);
    }
    EXPECT_EQ(seen, cycles > 2) << cycles;
    EXPECT_FALSE(io.boolean("buttons", 0));
  }
}

// However long its timeout: the slaves have switched off themselves after 0.1 s.
TEST(EtherCatLink, AwaitsAnAcknowledgementAfterASilenceInWhichSlavesSwitchOff) {
  Ports io(kCell);
  io.set("timeout", "10");
  io.start();
  io.steps(100);
  ASSERT_TRUE(io.boolean("operational"));
  io.set("cut", "0");
  io.steps(4);
  EXPECT_FALSE(io.boolean("operational"));
  EXPECT_FALSE(io.boolean("awaits_acknowledgement"));
  io.steps(101);
  EXPECT_TRUE(io.boolean("awaits_acknowledgement"));
}

TEST(EtherCatLink, SwitchesOutputsOnAgainAsItsRestartSays) {
  for (const std::string restart : {"acknowledged", "automatic"}) {
    Ports io(kCell);
    if (restart != "acknowledged") io.set("restart", restart);  // which is the default
    io.set("acknowledge", 0, true);                             // from the start: no edge
    io.start();
    io.set("valves", 0, true);
    io.steps(80);
    ASSERT_TRUE(io.boolean("valves_field", 0)) << "no acknowledgement is needed for the first start";
    for (int loss = 0; loss < 2; ++loss) {
      io.set("cut", "3");
      io.steps(10);
      EXPECT_FALSE(io.boolean("valves_field", 0));
      io.set("acknowledge", 0, false);
      io.steps(5);
      io.set("acknowledge", 0, true);  // too early
      io.steps(5);
      io.set("cut", "-1");
      io.steps(300);
      ASSERT_TRUE(io.boolean("operational"));
      EXPECT_EQ(io.boolean("valves_field", 0), restart == "automatic");
      EXPECT_EQ(io.boolean("awaits_acknowledgement"), restart == "acknowledged");
      io.set("acknowledge", 0, false);
      io.steps(5);
      EXPECT_EQ(io.boolean("valves_field", 0), restart == "automatic");
      io.set("acknowledge", 0, true);
      io.steps(52);
      EXPECT_TRUE(io.boolean("valves_field", 0)) << restart;
      EXPECT_FALSE(io.boolean("awaits_acknowledgement"));
    }
  }
  Ports io(kCell);
  io.set("restart", "never");
  EXPECT_THAT(error_of([&] { io.start(); }), HasSubstr("restart is 'never', expected acknowledged or automatic"));
}

TEST(EtherCatLink, SetsTheCounterOnceAlsoIfACycleIsBad) {
  Ports io(kCell + "&encoder_bits=32");
  io.start();
  io.steps(60);
  io.set("axis_set_value", "1000");
  io.set("axis_set", 0, true);
  io.steps(4);
  ASSERT_TRUE(io.boolean("axis_set_done"));
  io.set("q_field", "50");
  io.steps(3);
  ASSERT_EQ(io.integer("axis_count"), 1050);
  io.set("cut", "3");
  io.steps(3);
  io.set("cut", "-1");
  io.steps(100);
  ASSERT_TRUE(io.boolean("operational"));
  EXPECT_EQ(io.integer("axis_count"), 1050) << "the axis did not move";
  EXPECT_FALSE(io.boolean("axis_uncertain"));
}

TEST(EtherCatLink, GivesASpeedWithoutJumpsWhenDataAreMissing) {
  for (const int missing : {3, 200}) {  // ms; timeout is 20 ms
    Ports io(kCell + "&encoder_bits=32");
    io.set("q_scale", "1e-3");
    io.start();
    int i = 0;
    const auto move = [&](int n) {
      for (const int end = i + n; i < end; ++i) {
        io.set("q_field", std::to_string(5 * i));
        io.steps(1);
        // 5 counts per ms of 1e-3
        if (i > 200) {
          ASSERT_GE(io.real("dq"), 0.0) << i;
          ASSERT_LE(io.real("dq"), 5.001) << i;
        }
      }
    };
    move(300);
    EXPECT_NEAR(io.real("dq"), 5.0, 1e-6);
    io.set("cut", "3");
    move(missing);
    EXPECT_NEAR(io.real("dq"), missing == 3 ? 5.0 : 0.0, 1e-6) << missing;
    io.set("cut", "-1");
    move(300);
    EXPECT_NEAR(io.real("dq"), 5.0, 1e-6);
  }
}

TEST(EtherCatLink, SwitchesOutputsOffAtTheEndOfTheRunAndMayBeStartedAgain) {
  Ports io(kCell);
  io.instance.unit->end();  // before the start nothing is to be done
  io.start();
  io.set("valves", 4, true);
  io.set("q_field", "10");
  io.steps(80);
  io.set("q_field", "300");
  io.steps(5);
  ASSERT_TRUE(io.boolean("valves_field", 4));
  EXPECT_EQ(io.integer("axis_count"), 290);
  io.instance.unit->end();
  io.instance.unit->end();
  EXPECT_FALSE(io.boolean("valves_field", 4));
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(io.integer("bus_state", i), 1) << i;
  std::vector<std::string> told;
  io.instance.unit->append_notes(told);
  EXPECT_TRUE(told.empty());
  for (const bool ended : {true, false}) {
    if (ended) io.instance.unit->end();
    io.start();
    EXPECT_FALSE(io.boolean("operational"));
    EXPECT_FALSE(io.boolean("valves_field", 4));
    EXPECT_EQ(io.integer("cycles"), 0);
    io.steps(80);
    EXPECT_TRUE(io.boolean("operational"));
    EXPECT_TRUE(io.boolean("valves_field", 4));
    EXPECT_EQ(io.integer("axis_count"), 0) << "the position counts from the new start";
    EXPECT_EQ(io.integer("recovered") + io.integer("slaves_lost"), 0);
  }
}

TEST(EtherCatLink, TellsWhatIsWrongIfTheBusNeverBecomesOperational) {
  Ports io(kCell);
  io.start();
  io.set("off", "2");
  io.steps(200);
  io.instance.unit->end();
  std::vector<std::string> told;
  io.instance.unit->append_notes(told);
  ASSERT_EQ(told.size(), 2u);
  EXPECT_EQ(told[0],
            "the bus was never operational, expected state 8 (OP) of all slaves: EK1100 8, EL1809 8, EL2809 0, EL5101 0");
  EXPECT_THAT(told[1], HasSubstr("not all slaves answered at the end of the run that they are in INIT"));
}

TEST(EtherCatLink, RefusesStepsOfAnotherLengthThanItsCycle) {
  Ports io(kCell);
  io.set("cycle", "2e-3");
  io.start();
  EXPECT_THAT(
      error_of([&] { io.steps(1); }),
      HasSubstr("cycle is 2 ms, but a step lasts 1 ms, expected the same (parameter cycle, or the tick of the scenario)"));
  Ports fits(kCell);
  fits.start();
  fits.steps(5);
  // Ticks that are left out make longer steps.
  ASSERT_EQ(fits.instance.unit->step(fits.now, Duration{3 * kTick.ns}), StepResult::kDone);
}

TEST(EtherCatLink, UsesADeviceByItsSii) {
  ethercat::Sii sii;
  sii.vendor = 0x1234;
  sii.product = 0x5678;
  sii.general.order = "XY7";
  sii.fmmus = {1, 2};
  sii.sync_managers = {{0x1000, 0, 0x24, 0, 1, ethercat::SyncManagerType::kOutputs},
                       {0x1100, 0, 0x20, 0, 1, ethercat::SyncManagerType::kInputs}};
  ethercat::Pdo out, in;
  out.index = 0x1600;
  out.sync_manager = 0;
  out.entries = {{0x7000, 1, "set point", 6, 16, 0}, {0, 0, "", 0, 4, 0}, {0x7000, 2, "enable", 1, 1, 0}};
  in.index = 0x1a00;
  in.sync_manager = 1;
  in.entries = {{0x6000, 1, "a", 1, 1, 0}, {0x6000, 2, "b", 1, 1, 0}, {0x6000, 3, "c", 1, 1, 0}};
  sii.rx_pdos = {out};
  sii.tx_pdos = {in};
  const std::vector<std::uint8_t> image = ethercat::write_sii(sii);
  const cotwin::testing::TemporaryFolder folder("sii");
  const fs::path file = folder.path() / "xy7.bin";
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(image.data()), static_cast<std::streamsize>(image.size()));
  Ports io("link=ethercat&slaves=EK1100,door:" + file.string());
  io.set("door_7000_1", "-2");
  io.set("door_7000_2", "1");
  io.start();
  io.steps(60);
  EXPECT_TRUE(io.boolean("operational"));
  EXPECT_EQ(io.instance.variables.at("door").size(), 3u);

  // The image that the master reads from the bus describes the same device.
  Ports saving("link=ethercat&slaves=EK1100,door:" + file.string());
  saving.set("sii_folder", (folder.path() / "found").string());
  saving.start();
  Ports again("link=ethercat&slaves=EK1100,door:" + (folder.path() / "found/1_XY7.bin").string());
  again.start();
  again.steps(60);
  EXPECT_TRUE(again.boolean("operational"));
}

TEST(EtherCatLink, RefusesSettingsThatMakeNoBus) {
  const auto refusal = [](const std::string& query) { return error_of([&] { Ports io(query); }); };
  EXPECT_THAT(refusal("link=ethercat"), HasSubstr("slaves is missing, expected the slaves in the order of the bus"));
  EXPECT_THAT(refusal("link=ethercat&slaves=EK1100,EL1809"),
              HasSubstr("EL1809 has process data, expected a name for its ports, as in name:EL1809"));
  EXPECT_THAT(refusal("link=ethercat&slaves=EK1100,a:EL1809,a:EL2809"), HasSubstr("two slaves are named 'a'"));
  EXPECT_THAT(refusal("link=ethercat&slaves=x:EL9999"),
              HasSubstr("no device 'EL9999', expected EK1100, EL1809, EL2809, EL5101"));
  EXPECT_THAT(refusal("link=ethercat&slaves=1x:EL1809"), HasSubstr("'1x' cannot be a name"));
  EXPECT_THAT(refusal("link=ethercat&slaves=a:EL5101,b:EL5101"), HasSubstr("2 encoders, but 1 joints"));
  EXPECT_THAT(refusal("link=ethercat&slaves=a:EL5101&encoder_bits=24"), HasSubstr("encoder_bits=24, expected 16 or 32"));
  EXPECT_THAT(refusal("link=ethercat_bus&slaves=EK1100"), HasSubstr("interface is missing"));
  Ports io("link=ethercat&interface=no-such-if&slaves=EK1100");
  EXPECT_THAT(error_of([&] { io.start(); }), HasSubstr("interface 'no-such-if': there is no such interface"));
}

TEST(EtherCatLink, StepsWithoutAllocation) {
  Ports io(kCell);
  io.start();
  io.steps(20);
  const std::uint64_t before = cotwin::testing::allocations();
  io.steps(100);
  EXPECT_EQ(cotwin::testing::allocations(), before);
  EXPECT_FALSE(io.instance.unit->restorable());
}

#ifdef __linux__
/// A pair of virtual interfaces in a network namespace of this process.
bool make_interfaces() {
  if (unshare(CLONE_NEWNET) != 0) return false;
  const auto run = [](const char* command) { return std::system(command) == 0; };
  return run("ip link add cotwin0 type veth peer name cotwin1 2>/dev/null") &&
         run("sysctl -qw net.ipv6.conf.cotwin0.disable_ipv6=1 net.ipv6.conf.cotwin1.disable_ipv6=1 2>/dev/null || true") &&
         run("ip link set cotwin0 up && ip link set cotwin1 up");
}

TEST(EtherCatLink, AWaitForASilentBusGoesOnAfterSignals) {
  if (!make_interfaces()) GTEST_SKIP() << "needs the permission for network namespaces and virtual interfaces (root)";
  struct sigaction action = {}, before = {};
  action.sa_handler = [](int) {};
  sigaction(SIGUSR1, &action, &before);
  Ports io(kCell + "&interface=cotwin0");
  io.set("wait", "0.3");
  std::atomic<bool> over{false};
  const pthread_t self = pthread_self();
  std::thread signals([&] {
    while (!over) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      pthread_kill(self, SIGUSR1);
    }
  });
  const auto begin = std::chrono::steady_clock::now();
  const std::string error = error_of([&] { io.start(); });
  over = true;
  signals.join();
  sigaction(SIGUSR1, &before, nullptr);
  EXPECT_THAT(error, HasSubstr("no frame comes back")) << "signals of others are no reason to give up";
  EXPECT_GT(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(290));
}

TEST(EtherCatLink, AFloodOfFramesNeitherHoldsTheEndOfABusNorItsTerminals) {
  if (!make_interfaces()) GTEST_SKIP() << "needs the permission for network namespaces and virtual interfaces (root)";
  std::atomic<bool> over{false};
  std::atomic<int> answering{0};
  std::thread flood;
  {
    Ports bus("link=ethercat_bus&interface=cotwin1&slaves=EK1100,buttons:EL1809,valves:EL2809,axis:EL5101");
    bus.start();
    net::RawSocket socket("cotwin0", ethercat::kEtherType, "test");
    flood = std::thread([&over, &answering, socket = std::move(socket)]() mutable {
      std::array<std::uint8_t, ethercat::kLongestFrame> buffer{};
      while (!over) {
        ethercat::FrameWriter writer(buffer);
        writer.begin();
        writer.add(ethercat::Command::kBrd, 1, ethercat::at_position(0, ethercat::reg::kType), std::size_t{1});
        socket.send(writer.finish());
        while (const auto received = socket.receive(buffer)) {
          ethercat::FrameReader reader(std::span<const std::uint8_t>(buffer).first(std::min(received->size, buffer.size())));
          ethercat::Datagram d;
          if (reader.next(d)) answering = d.working_counter;
        }
      }
    });
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    const auto wait_for = [&](auto&& done) {
      while (!done() && std::chrono::steady_clock::now() < deadline) {
        bus.steps(1);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      return done();
    };
    EXPECT_TRUE(wait_for([&] { return bus.integer("frames") > 1000 && answering == 4; }));
    bus.set("cut", "2");
    EXPECT_TRUE(wait_for([&] { return answering == 2; }));
  }  // the bus ends here, under the flood
  over = true;
  flood.join();
}

TEST(EtherCatLink, AnEmulatedBusAnswersNobodyAfterItsEnd) {
  if (!make_interfaces()) GTEST_SKIP() << "needs the permission for network namespaces and virtual interfaces (root)";
  Ports bus("link=ethercat_bus&interface=cotwin1&slaves=EK1100,buttons:EL1809,valves:EL2809,axis:EL5101");
  bus.start();
  bus.instance.unit->end();
  Ports io(kCell + "&interface=cotwin0");
  EXPECT_THAT(error_of([&] { io.start(); }), HasSubstr("no frame comes back"));
}

TEST(EtherCatLink, OperatesABusAtAnInterface) {
  if (!make_interfaces()) GTEST_SKIP() << "needs the permission for network namespaces and virtual interfaces (root)";
  Ports bus("link=ethercat_bus&interface=cotwin1&slaves=EK1100,buttons:EL1809,valves:EL2809,axis:EL5101");
  Ports io(kCell + "&interface=cotwin0");
  io.set("timeout", "5");  // of a busy machine
  bus.start();
  io.start();
  bus.set("buttons_field", 3, true);
  io.set("valves", 7, true);
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  const auto done = [&] {
    return io.boolean("operational") && io.boolean("buttons", 3) && bus.boolean("valves_field", 7) &&
           io.integer("axis_count") == 321;
  };
  TickSource* const source = io.instance.unit->tick_source();
  ASSERT_NE(source, nullptr);
  int arrivals = 0;
  while (!done() && std::chrono::steady_clock::now() < deadline) {
    if (io.boolean("operational")) bus.set("q_field", "321");  // from the position at the start
    io.steps(1);
    bus.steps(1);
    const auto next = std::chrono::steady_clock::now() + std::chrono::milliseconds(2);
    arrivals += source->wait(std::chrono::duration_cast<std::chrono::nanoseconds>(next.time_since_epoch()).count()) ? 1 : 0;
    std::this_thread::sleep_until(next);
  }
  EXPECT_TRUE(done());
  EXPECT_GT(arrivals, 0);
  EXPECT_EQ(bus.integer("bus_state", 3), 8);
  EXPECT_GT(bus.integer("frames"), 1000);
}
#endif

}  // namespace
}  // namespace cotwin::io::link_test
