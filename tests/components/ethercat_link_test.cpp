// unit:io?link=ethercat with an emulated bus behind it, and with one behind a pair of virtual interfaces.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#ifdef __linux__
#include <sched.h>
#endif

#include "components/io/ethercat/devices.h"
#include "components/unit/tick_source.h"
#include "components/unit/unit_table.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::io {
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
  io.steps(2);
  EXPECT_EQ(io.integer("axis_count"), 1000);
  io.set("axis_set_value", "-5");
  io.set("axis_set", 0, true);
  io.steps(3);
  EXPECT_TRUE(io.boolean("axis_set_done"));
  EXPECT_EQ(io.integer("axis_count"), -5);
  io.set("q_field", "1010");
  io.steps(2);
  EXPECT_EQ(io.integer("axis_count"), 5);
}

TEST(EtherCatLink, SwitchesOffAndTellsIfACableIsCutAndAPositionIsLost) {
  Ports io(kCell);
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
  EXPECT_EQ(io.integer("recovered"), 1) << "after 4 ms without the cable the terminal was still in OP";
  std::vector<std::string> told;
  io.instance.unit->tell(told);
  ASSERT_EQ(told.size(), 2u);
  EXPECT_THAT(told[0], HasSubstr("was not operational at some time"));
  EXPECT_THAT(told[1], HasSubstr("an encoder terminal was switched off and on"));
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
}  // namespace cotwin::io
