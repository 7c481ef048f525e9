// Drives with the profile CiA 402 on a bus, from the commands of the twin to the axes of emulated drives: components/io/links/ethercat_drives.h.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/servo_drive.h"
#include "components/unit/unit_table.h"
#include "tests/components/io/ethercat/drive_axes.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::io::drives_test {
namespace {

using cotwin::testing::error_of;
using ::testing::Contains;
using ::testing::HasSubstr;

TEST(EtherCatDrives, StayOffAndAreMeasuredInModeMonitor) {
  Axes a("monitor");
  a.start();
  a.command(2, 2);
  a.steps(300);
  EXPECT_TRUE(a.boolean("operational"));
  EXPECT_FALSE(a.boolean("drives_enabled"));
  EXPECT_EQ(a.integer("drive_state", 0), kOff);
  EXPECT_DOUBLE_EQ(a.real("q", 0), 0.5);
  EXPECT_DOUBLE_EQ(a.real("q", 1), -0.2);
  EXPECT_EQ(a.fastest, 0);
}

// (csp) The drives' loops follow a ramp; their lag is that of the bus and of the interpolation, 3 ms · 0.2 rad/s.
TEST(EtherCatDrives, FollowTheCommandOfTheTwin) {
  Axes a("position");
  a.set("dq_command_max", "1 1");
  a.start();
  ASSERT_TRUE(a.enables());
  EXPECT_EQ(a.integer("drive_state", 0), kEnabled);
  EXPECT_EQ(a.fastest, 0) << "nothing moves while the command is where the axes are";
  a.steps(600);  // the soft start
  for (int n = 0; n < 1500; ++n) {
    a.command(0.5 + 2e-4 * n, -0.2 - 1e-4 * n);
    a.steps(1);
  }
  EXPECT_NEAR(a.axis(0), 0.5 + 2e-4 * 1499, 0.2 * 4e-3);
  EXPECT_NEAR(a.real("q", 0), a.axis(0), 0.2 * 2e-3);
  EXPECT_NEAR(a.real("dq", 0), 0.2, 2e-3);
  EXPECT_NEAR(a.real("dq", 1), -0.1, 2e-3);
  a.steps(200);
  EXPECT_NEAR(a.axis(0), 0.5 + 2e-4 * 1499, 2e-5);
  EXPECT_NEAR(a.axis(1), -0.2 - 1e-4 * 1499, 2e-5);
}

TEST(EtherCatDrives, BeginWhereTheyAreAndApproachTheTwinWithinTheLimits) {
  Axes a("position");
  a.start();
  a.command(1.0, 0.6);  // elsewhere
  ASSERT_TRUE(a.enables());
  a.steps(20);
  EXPECT_NEAR(a.axis(0), 0.5, 1e-3);
  EXPECT_NEAR(a.axis(1), -0.2, 1e-3);
  a.steps(5000);
  EXPECT_NEAR(a.axis(0), 1.0, 2e-5);
  EXPECT_NEAR(a.axis(1), 0.6, 2e-5);
  EXPECT_LT(a.fastest, 0.5 * 1.02);  // kSafeSpeed, and the overshoot of the drive's loop
  EXPECT_LT(a.hardest, 2 * 20.0);    // kSafeAcceleration, within rounded targets
}

TEST(EtherCatDrives, AllStopAtAFaultOfOneUntilItIsAcknowledged) {
  Axes a("position");
  a.start();
  ASSERT_TRUE(a.enables());
  a.command(5, 5);
  a.steps(1000);
  ASSERT_GT(a.speeds[0], 0.4);
  a.set("q2_fault", "true");
  a.steps(100);
  EXPECT_EQ(a.integer("drive_state", 1), kFault);
  EXPECT_EQ(a.integer("drive_error", 1), ethercat::ServoDrive::kExternalFault);
  EXPECT_EQ(a.integer("drive_state", 0), kOff) << "a quick stop, and off";
  EXPECT_TRUE(a.boolean("awaits_acknowledgement"));
  EXPECT_TRUE(a.boolean("operational"));
  const double rest[] = {a.axis(0), a.axis(1)};
  a.set("q2_fault", "false");  // the cause goes
  a.steps(1000);
  EXPECT_EQ(a.integer("drive_state", 1), kFault);
  EXPECT_EQ(a.axis(0), rest[0]);
  EXPECT_EQ(a.axis(1), rest[1]);
  a.acknowledge();
  a.forget();
  ASSERT_TRUE(a.enables());
  a.steps(10);
  EXPECT_NEAR(a.axis(0), rest[0], 1e-4) << "from where it is";
  a.steps(500);
  EXPECT_GT(a.axis(0), rest[0] + 0.05);
  EXPECT_LT(a.hardest, 2 * 20.0);
  std::vector<std::string> sentences;
  a.instance.unit->append_notes(sentences);
  EXPECT_THAT(sentences, Contains("the drives were stopped 1 time, last because drive q2 left Operation enabled by itself"));
}

TEST(EtherCatDrives, DoNotComeBackWhenTheCauseOfAnAcknowledgedFaultGoesLater) {
  Axes a("position");
  a.start();
  ASSERT_TRUE(a.enables());
  a.command(5, 5);
  a.set("q1_fault", "true");
  a.steps(100);
  a.acknowledge();  // too early
  a.steps(700);
  EXPECT_EQ(a.integer("drive_state", 0), kFault);
  EXPECT_TRUE(a.boolean("awaits_acknowledgement"));
  a.set("q1_fault", "false");
  a.forget();
  a.steps(1000);
  EXPECT_EQ(a.integer("drive_state", 0), kFault);
  EXPECT_EQ(a.fastest, 0);
  a.acknowledge();
  EXPECT_TRUE(a.enables());
}

TEST(EtherCatDrives, AFaultAtTheStartIsNotReset) {
  Axes a("position");
  a.set("q1_fault", "true");
  a.start();
  a.steps(100);
  a.set("q1_fault", "false");
  a.steps(500);
  EXPECT_EQ(a.integer("drive_state", 0), kFault);
  EXPECT_EQ(a.integer("drive_state", 1), kOff);
  a.acknowledge();
  EXPECT_TRUE(a.enables());
}

TEST(EtherCatDrives, StopQuicklyAndAreNotEnabledAgainByTheEndOfTheStop) {
  Axes a("position");
  a.start();
  ASSERT_TRUE(a.enables());
  a.command(5, 5);
  a.steps(1000);
  const double from = a.axis(0);
  a.set("quick_stop", "true");
  a.steps(50);
  // With 1e7 counts/s² from 0.5 rad/s to rest: 0.5²/(2 · 100) = 1.3 mrad, and some cycles of delay.
  EXPECT_NEAR(a.axis(0), from + 0.00125, 0.5 * 4e-3);
  EXPECT_EQ(a.speeds[0], 0);
  a.acknowledge();
  a.steps(200);
  EXPECT_FALSE(a.boolean("drives_enabled")) << "it is still pressed";
  a.set("quick_stop", "false");
  a.steps(500);
  EXPECT_FALSE(a.boolean("drives_enabled"));
  a.acknowledge();
  EXPECT_TRUE(a.enables());
}

TEST(EtherCatDrives, AreShutDownWithoutEnableAndBeginWhereTheyAreAfterIt) {
  Axes a("position");
  a.start();
  ASSERT_TRUE(a.enables());
  a.command(0.55, -0.2);
  a.steps(1000);
  a.set("enable", "false");
  a.steps(50);
  EXPECT_EQ(a.integer("drive_state", 0), kOff);
  a.command(0.2, -0.2);
  a.forget();
  a.set("enable", "true");
  ASSERT_TRUE(a.enables());
  EXPECT_EQ(a.fastest, 0);
  a.steps(3000);
  EXPECT_NEAR(a.axis(0), 0.2, 2e-5);
  EXPECT_LT(a.hardest, 2 * 20.0);
}

TEST(EtherCatDrives, AfterALossOfTheBusNothingMovesUntilItIsAcknowledged) {
  for (const std::string loss : {"cut", "off"}) {
    Axes a("position");
    a.start();
    ASSERT_TRUE(a.enables());
    a.command(5, 5);
    a.steps(1000);
    a.set(loss, "2");  // drive q2, and with a cut cable the valves
    const double from = a.axis(0);
    a.steps(300);
    // Its quick stop: 0.5²/(2 · 100) = 1.3 mrad, and some cycles of delay. Without voltage it would be 10 mrad.
    EXPECT_NEAR(a.axis(0), from + 0.00125, 0.5 * 5e-3) << loss;
    EXPECT_FALSE(a.boolean("operational")) << loss;
    EXPECT_FALSE(a.boolean("drives_enabled"));
    EXPECT_EQ(a.speeds[0], 0) << "also the drive that is still there";
    const double rest = a.axis(0);
    a.set(loss, "-1");
    a.steps(1000);
    EXPECT_TRUE(a.boolean("operational"));
    EXPECT_EQ(a.axis(0), rest) << loss;
    a.acknowledge();
    a.forget();
    ASSERT_TRUE(a.enables()) << loss;
    a.steps(400);
    EXPECT_GT(a.axis(0), rest);
    EXPECT_LT(a.hardest, 2 * 20.0);
  }
}

TEST(EtherCatDrives, AFollowingErrorIsAFaultOfTheDrive) {
  const cotwin::testing::TemporaryFolder folder("drives");
  const std::string file = (folder.path() / "drives.csv").string();
  std::ofstream(file) << "slave,when,index,subindex,type,value\n"
                         "q1,PS,0x6065,0,u32,20\n";  // counts
  Axes a("position", "&start_up=" + file);
  a.start();
  ASSERT_TRUE(a.enables());
  a.command(5, 5);
  a.steps(1000);
  EXPECT_EQ(a.integer("drive_state", 0), kFault);
  EXPECT_EQ(a.integer("drive_error", 0), ethercat::ServoDrive::kFollowingError);
  EXPECT_EQ(a.integer("drive_state", 1), kOff);
}

TEST(EtherCatDrives, LimitsOfTheCommandAndOfTheDriveHold) {
  const cotwin::testing::TemporaryFolder folder("drives");
  const std::string file = (folder.path() / "drives.csv").string();
  std::ofstream(file) << "slave,when,index,subindex,type,value\n"
                         "q2,PS,0x607d,1,i32,-30000\n"
                         "q2,PS,0x607d,2,i32,-10000\n";
  Axes a("position", "&start_up=" + file);
  a.set("q_command_max", "0.6 10");
  a.set("following_error_max", "10 10");
  a.start();
  ASSERT_TRUE(a.enables());
  a.command(5, 5);
  a.steps(4000);
  EXPECT_NEAR(a.axis(0), 0.6, 2e-5);
  EXPECT_NEAR(a.axis(1), -0.1, 2e-5);
  EXPECT_EQ(a.integer("drive_limits", 0), 0);
  EXPECT_EQ(a.integer("drive_limits", 1), 1);
}

TEST(EtherCatDrives, FollowTheCommandWithVelocities) {
  Axes a("velocity");
  a.start();
  a.command(0.9, -0.2);
  ASSERT_TRUE(a.enables());
  a.steps(4000);
  EXPECT_NEAR(a.axis(0), 0.9, 1e-4);
  EXPECT_NEAR(a.axis(1), -0.2, 1e-4);
  EXPECT_LT(a.fastest, 0.5 * 1.05);
  for (int n = 0; n < 1000; ++n) {
    a.command(0.9 - 2e-4 * n, -0.2);
    a.steps(1);
  }
  EXPECT_NEAR(a.real("dq", 0), -0.2, 5e-3);
  EXPECT_NEAR(a.axis(0), 0.9 - 2e-4 * 999, 0.2 * 10e-3);
}

// cst: 1e4 counts/s² per unit of torque and a friction of 5 1/s; with 0.01 N.m per unit, 2 N.m at rest of the speed.
TEST(EtherCatDrives, ExertTorques) {
  Axes a("torque");
  a.set("tau_scale", "0.01 0.01");
  a.set("tau_command_max", "1 10");
  a.set("tau_command", "5 0");  // limited to 1 N.m, 100 units
  a.start();
  ASSERT_TRUE(a.enables());
  a.steps(2500);
  // At full torque: x' = 100 · 1e4/5 counts/s = 2 rad/s.
  EXPECT_NEAR(a.speeds[0], 2.0, 0.01);
  EXPECT_NEAR(a.real("tau", 0), 1.0, 0.02);
  EXPECT_TRUE(a.boolean("has_tau"));
  EXPECT_EQ(a.speeds[1], 0);
}

// The axis of q1 stands at 50000 counts, at a pulse: the next ones are at 60000 and 40000.
TEST(EtherCatDrives, FindTheirHomeAndFollowFromWhereTheyAre) {
  struct Case {
    const char* method;
    double pulse;  // counts
  };
  for (const Case& c : {Case{"34", 60'000}, Case{"33", 40'000}, Case{"37", 50'000}}) {
    const cotwin::testing::TemporaryFolder folder("drives");
    const std::string file = (folder.path() / "drives.csv").string();
    std::ofstream(file) << "slave,when,index,subindex,type,value\nq1,PS,0x6098,0,i8," << c.method
                        << "\nq1,PS,0x6099,2,u32,20000\n";
    Axes a("position", "&start_up=" + file);
    a.start();
    ASSERT_TRUE(a.enables());
    a.set("home", "true false");
    a.steps(800);
    EXPECT_TRUE(a.boolean("homed", 0)) << c.method;
    EXPECT_FALSE(a.boolean("homed", 1));
    EXPECT_FALSE(a.boolean("awaits_acknowledgement"));
    EXPECT_TRUE(a.boolean("drives_enabled"));
    EXPECT_EQ(a.axis(1), -0.2) << "the other one holds";
    a.command(0.1, -0.2);
    a.steps(3000);
    EXPECT_NEAR(a.real("q", 0), 0.1, 2e-5);
    EXPECT_NEAR(a.axis(0), kScale * c.pulse + 0.1, 2e-5) << c.method;
    // It turns round with a = 20 rad/s² and lags by a/ω² then: the critically damped loop makes that up with at most a/(ω e). Targets
    // are rounded to a count per ms.
    EXPECT_LT(a.fastest, 0.5 + 20 / (ethercat::ServoDrive::kBandwidth * std::numbers::e) + kScale / 1e-3);
  }
}

TEST(EtherCatDrives, StopWhenAHomingFailsAndHomeOnlyWhileTheyStand) {
  const cotwin::testing::TemporaryFolder folder("drives");
  const std::string file = (folder.path() / "drives.csv").string();
  std::ofstream(file)
      << "slave,when,index,subindex,type,value\nq1,PS,0x6098,0,i8,1\n";  // a switch that the emulated drive does not have
  Axes a("position", "&start_up=" + file);
  a.set("home", "true false");  // on at the start: no edge
  a.start();
  ASSERT_TRUE(a.enables());
  a.steps(100);
  EXPECT_TRUE(a.boolean("drives_enabled"));
  a.set("home", "false false");
  a.command(5, -0.2);
  a.steps(1000);
  a.set("home", "true false");  // it moves
  a.steps(100);
  EXPECT_TRUE(a.boolean("drives_enabled"));
  EXPECT_GT(a.speeds[0], 0.4);
  a.command(a.real("q", 0), -0.2);
  a.steps(2000);
  a.set("home", "false false");
  a.steps(1);
  a.set("home", "true false");
  a.steps(300);
  EXPECT_FALSE(a.boolean("homed", 0));
  EXPECT_TRUE(a.boolean("awaits_acknowledgement"));
  EXPECT_EQ(a.integer("drive_state", 0), kOff);
  EXPECT_EQ(a.integer("drive_state", 1), kOff);
  a.acknowledge();
  EXPECT_TRUE(a.enables()) << "without another homing";
}

// Without the quick stop the brake of the emulated axis would stop it in 1/50 s: 0.5 rad/s / 50 = 10 mrad further.
TEST(EtherCatDrives, StopQuicklyAtTheEndOfARun) {
  Axes a("position");
  a.start();
  ASSERT_TRUE(a.enables());
  a.command(5, 5);
  a.steps(1000);
  const double from = a.axis(0);
  a.instance.unit->end();
  EXPECT_NEAR(a.axis(0), from + 0.00125, 0.5 * 3e-3);
}

TEST(EtherCatDrives, RefuseWhatCannotBeSafe) {
  const auto refusal = [](auto change) {
    Axes a("position");
    change(a);
    return error_of([&] { a.start(); });
  };
  EXPECT_THAT(refusal([](Axes& a) { a.set("restart", "automatic"); }),
              HasSubstr("restart: automatic with drive_mode=position, expected acknowledged"));
  EXPECT_THAT(refusal([](Axes& a) { a.set("drive_mode", "fast"); }), HasSubstr("drive_mode"));
  EXPECT_THAT(refusal([](Axes& a) { a.set("q_scale", "1e-5 0"); }), HasSubstr("slave q2: q_scale of its joint is 0"));
  EXPECT_THAT(refusal([](Axes& a) { a.set("drive_mode", "torque"); }), HasSubstr("slave q1: tau_scale is 0"));
  EXPECT_THAT(refusal([](Axes& a) {
                a.set("drive_mode", "torque");
                a.set("tau_scale", "0.01 0.01");
                a.set("tau_command_max", "1 1e9");
              }),
              HasSubstr("slave q2: tau_command_max of its joint is not given and the robot has no limit of effort"));
  EXPECT_THAT(refusal([](Axes& a) { a.set("dq_scale", "-1e-5 0"); }),
              HasSubstr("slave q1: dq_scale is -1e-05 and q_scale 1e-05, expected the same sign"));
  EXPECT_THAT(refusal([](Axes& a) {
                a.set("drive_mode", "velocity");
                a.set("K_v", "300");
              }),
              HasSubstr("expected at most 200"));
  const auto settings = [](const std::string& query) { return error_of([&] { Axes a("monitor", query); }); };
  EXPECT_THAT(settings("&drives=valves"),
              HasSubstr("drives: 'valves', expected the name of a slave that is described by its SII image"));
  EXPECT_THAT(error_of([] { make_unit("unit:io?link=ethercat&slaves=a:DRIVE402,b:DRIVE402", {}, {}, unit_types()); }),
              HasSubstr("0 encoders and 2 drives, but 1 joints"));
}

TEST(EtherCatDrives, ADriveByItsSiiNeedsTheObjectsOfItsMode) {
  const cotwin::testing::TemporaryFolder folder("drives");
  const auto image = [&](ethercat::Sii sii) {
    const std::vector<std::uint8_t> bytes = ethercat::write_sii(sii);
    const fs::path file = folder.path() / "drive.bin";
    std::ofstream(file, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return "link=ethercat&slaves=q1:" + file.string() + "&drives=q1";
  };
  const auto unit = [](const std::string& query) { return make_unit("unit:io?" + query, {}, {}, unit_types()); };
  ethercat::Sii sii = ethercat::servo_drive_sii();
  sii.rx_pdos[0].entries[3].index = 0x2100;  // no target position
  Instance io = unit(image(sii));
  assign_text(io.variables.at("drive_mode"), "position");
  EXPECT_THAT(
      error_of([&] { io.unit->initialise(Time{}); }),
      HasSubstr("slave q1: its outputs have no object 0x607A (target position, 32 bits), which drive_mode=position needs"));
  sii.tx_pdos[0].entries[0].index = 0x2101;  // no status word
  EXPECT_THAT(error_of([&] { unit(image(sii)); }), HasSubstr("have no object 0x6041 (status word, 16 bits) in its inputs"));
}

TEST(EtherCatDrives, StepWithoutAllocation) {
  Axes a("position");
  a.start();
  std::uint64_t allocated = 0;
  const auto steps = [&] {
    const std::uint64_t before = cotwin::testing::allocations();
    a.steps(200);
    allocated += cotwin::testing::allocations() - before;
  };
  steps();
  a.command(1, 1);
  steps();
  a.set("q1_fault", "true");
  steps();
  EXPECT_EQ(a.integer("drive_state", 0), kFault);
  EXPECT_EQ(allocated, 0u);
}

TEST(EtherCatDrives, TheSameRunGivesTheSameBits) {
  const auto run = [] {
    Axes a("position");
    a.start();
    a.command(0.8, 0.1);
    a.steps(800);
    return std::vector<double>{a.axis(0), a.axis(1), a.real("q", 0), a.real("dq", 1)};
  };
  EXPECT_EQ(run(), run());
}

}  // namespace
}  // namespace cotwin::io::drives_test
