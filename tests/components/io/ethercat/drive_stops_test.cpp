// What must not move a drive, and what must stop it: components/io/links/ethercat_drives.h.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/servo_drive.h"
#include "components/io/links/ethercat_drives.h"
#include "tests/components/io/ethercat/drive_axes.h"
#include "tests/support/error_of.h"

namespace cotwin::io::drive_stops_test {
namespace {

using cotwin::testing::error_of;
using ::testing::Contains;
using ::testing::HasSubstr;

// The mains contactor closes minutes after the start, after acknowledge and after enable.
TEST(EtherCatDriveStops, ADriveThatCanBeEnabledTooLateDoesNotMove) {
  for (const std::string since : {"start", "acknowledge", "enable"}) {
    Axes a("position");
    if (since == "start") a.set("q1_torque_off", "true");
    a.start();
    if (since != "start") {
      ASSERT_TRUE(a.enables());
      a.set(since == "enable" ? "enable" : "quick_stop", since == "enable" ? "false" : "true");
      a.steps(100);
      a.set("q1_torque_off", "true");
      a.set("quick_stop", "false");
      since == "enable" ? a.set("enable", "true") : a.acknowledge();
    }
    a.command(1, 1);
    a.steps(1900);
    EXPECT_FALSE(a.boolean("awaits_acknowledgement")) << since;
    EXPECT_EQ(a.integer("drive_state", 0), kOff);
    a.steps(1000);
    EXPECT_TRUE(a.boolean("awaits_acknowledgement")) << since;
    a.forget();
    a.set("q1_torque_off", "false");
    a.steps(1000);
    EXPECT_EQ(a.fastest, 0) << since;
    EXPECT_EQ(a.integer("drive_state", 0), kOff);
    EXPECT_EQ(a.integer("drive_state", 1), kOff);
    EXPECT_THAT(a.told(), Contains(HasSubstr("because drive q1 was not enabled within enable_timeout"))) << since;
    a.acknowledge();
    EXPECT_TRUE(a.enables()) << since;
  }
}

TEST(EtherCatDriveStops, ADriveThatIsEnabledInTimeFollows) {
  Axes a("position");
  a.set("q1_torque_off", "true");
  a.set("enable_timeout", "5");
  a.start();
  a.steps(4000);
  a.set("q1_torque_off", "false");
  EXPECT_TRUE(a.enables());
  a.steps(6000);
  EXPECT_TRUE(a.boolean("drives_enabled")) << "the time ended when all were enabled";
  a.command(0.6, -0.2);
  a.set("q1_torque_off", "true");  // an enabled drive
  a.steps(50);
  EXPECT_TRUE(a.boolean("awaits_acknowledgement"));
  EXPECT_THAT(a.told(), Contains(HasSubstr("because drive q1 left Operation enabled by itself")));
}

// A ramp of 5 rad/s²: 0.5²/(2 · 5) = 25 mrad. Without voltage 0.5/50 = 10 mrad.
TEST(EtherCatDriveStops, NothingCutsAQuickStopShort) {
  struct Case {
    const char* what;
    void (*act)(Axes&);
  };
  const Case kCases[] = {{"enable off at once",
                          [](Axes& a) {
                            a.set("enable", "false");
                            a.set("quick_stop", "true");
                          }},
                         {"enable off during the ramp",
                          [](Axes& a) {
                            a.set("quick_stop", "true");
                            a.steps(5);
                            a.set("enable", "false");
                          }},
                         {"an acknowledge before the status shows the stop",
                          [](Axes& a) {
                            a.set("quick_stop", "true");
                            a.steps(1);
                            a.set("quick_stop", "false");
                            a.acknowledge();
                          }},
                         {"an early acknowledge",
                          [](Axes& a) {
                            a.set("quick_stop", "true");
                            a.steps(5);
                            a.set("quick_stop", "false");
                            a.acknowledge();
                          }},
                         {"an early acknowledge and enable off", [](Axes& a) {
                            a.set("quick_stop", "true");
                            a.steps(5);
                            a.set("quick_stop", "false");
                            a.acknowledge();
                            a.set("enable", "false");
                          }}};
  const StartUpFile file("q1,PS,0x6085,0,u32,500000\n");
  for (const Case& c : kCases) {
    Axes a("position", file.setting());
    a.start();
    ASSERT_TRUE(a.enables());
    a.command(5, 5);
    a.steps(1000);
    ASSERT_GT(a.speeds[0], 0.49);
    const double from = a.axis(0);
    c.act(a);
    for (int n = 0; n < 300 && (n < 10 || a.integer("drive_state", 0) == kQuickStop); ++n) a.steps(1);
    EXPECT_NE(a.integer("drive_state", 0), kQuickStop) << c.what;
    EXPECT_NEAR(a.axis(0), from + 0.025, 0.5 * 4e-3) << c.what;
  }
}

// x'' = 1e4 counts/s² per unit − 5 x'. At 0.5 N.m the axis moves with 50 · 1e4/5 counts/s = 1 rad/s.
TEST(EtherCatDriveStops, ATorqueThatIsNoNumberIsZero) {
  Axes a("torque");
  a.set("tau_scale", "0.01 0.01");
  a.set("tau_command_max", "1 1");
  a.set("tau_command", "0.5 0");
  a.start();
  ASSERT_TRUE(a.enables());
  a.steps(2000);
  ASSERT_GT(a.speeds[0], 0.9);
  a.instance.variables.at("tau_command").reals()[0] = std::numeric_limits<double>::quiet_NaN();
  a.steps(2000);  // ten times the time constant of the friction
  EXPECT_LT(std::abs(a.speeds[0]), 1e-3);
  a.set("tau_command", "0.5 0");
  a.steps(100);
  a.set("quick_stop", "true");
  a.steps(300);
  a.set("quick_stop", "false");
  a.instance.variables.at("tau_command").reals()[0] = std::numeric_limits<double>::quiet_NaN();
  a.acknowledge();
  a.forget();
  ASSERT_TRUE(a.enables());
  a.steps(1000);
  EXPECT_EQ(a.fastest, 0) << "the torque of before the stop";
}

TEST(EtherCatDriveStops, TorquesDoNotDriveAnAxisOutOfItsRange) {
  Axes a("torque");
  a.set("tau_scale", "0.01 0.01");
  a.set("tau_command_max", "1 1");
  a.set("q_command_max", "0.6 10");
  a.set("tau_command", "0.5 0");
  a.set("outside", "return");
  a.start();
  ASSERT_TRUE(a.enables());
  a.steps(2000);
  EXPECT_TRUE(a.boolean("awaits_acknowledgement"));
  EXPECT_EQ(a.integer("drive_state", 0), kOff);
  EXPECT_GT(a.axis(0), 0.6);
  constexpr double kMargin = 0.01;  // rad
  EXPECT_LT(a.axis(0), 0.6 + kMargin + 1.0 * 1.0 / (2 * 100) + 1.0 * 5e-3)
      << "the quick stop from at most 1 rad/s, and some cycles";
  EXPECT_THAT(a.told(), Contains(HasSubstr("because drive q1 (joint 1) stands at 0.61")));
  const double rest = a.axis(0);
  a.acknowledge();
  a.steps(1000);
  EXPECT_TRUE(a.boolean("awaits_acknowledgement")) << "the torque still drives it out";
  EXPECT_LT(a.axis(0), rest + kMargin + 0.01);
  a.set("tau_command", "0 0");
  a.acknowledge();
  ASSERT_TRUE(a.enables()) << "at rest outside of the range, where a torque may have to hold it";
  a.steps(500);
  EXPECT_TRUE(a.boolean("drives_enabled"));
  a.set("tau_command", "-0.2 0");
  a.acknowledge();
  ASSERT_TRUE(a.enables());
  a.steps(1500);
  EXPECT_TRUE(a.boolean("drives_enabled"));
  EXPECT_LT(a.axis(0), 0.6);
}

TEST(EtherCatDriveStops, NoDriveIsEnabledWhileOneStandsOutsideOfItsRange) {
  for (const std::string mode : {"position", "velocity", "torque"}) {
    for (const bool returns : {false, true}) {
      SCOPED_TRACE(mode);
      Axes a(mode);
      a.set("tau_scale", "0.01 0.01");
      a.set("tau_command_max", "1 1");
      a.set("q_command_max", "0.4 10");  // it stands at 0.5
      if (returns) a.set("outside", "return");
      a.start();
      EXPECT_EQ(a.enables(), returns);
      a.forget();
      for (int n = 0; n < 2; ++n) {
        if (!returns) a.acknowledge();
        a.steps(1500);
      }
      EXPECT_EQ(a.boolean("awaits_acknowledgement"), !returns);
      if (returns) {
        EXPECT_NEAR(a.axis(0), mode == "torque" ? 0.5 : 0.4, 1e-4);
        continue;
      }
      EXPECT_EQ(a.fastest, 0);
      EXPECT_THAT(a.told(),
                  Contains(HasSubstr("drive q1 (joint 1) stands at 0.5 rad, outside of q_command_min to q_command_max")));
      EXPECT_THAT(a.instance.variables.at("warning").strings()[0], HasSubstr("drive q1 (joint 1) stands at 0.5 rad"));
    }
  }
  Axes a("position");
  a.set("outside", "maybe");
  EXPECT_THAT(error_of([&] { a.start(); }), HasSubstr("outside"));
}

TEST(EtherCatDriveStops, TheLimitOfTorqueIsThatOfTheRobot) {
  Instance io = make_unit("unit:io?robot=ur5e&link=ethercat&slaves=EK1100,q1:DRIVE402", {},
                          {fs::path(places::source()) / "models"}, unit_types());
  EXPECT_EQ(io.variables.at("tau_command_max").reals()[0], 150);
}

// Within the drive 0x6080 limits the speed to 0.05 rad/s.
TEST(EtherCatDriveStops, ADriveFarFromItsTargetStopsAll) {
  for (const std::string mode : {"position", "velocity"}) {
    const StartUpFile file("q1,PS,0x6080,0,u32,5000\n");
    Axes a(mode, file.setting());
    a.start();
    ASSERT_TRUE(a.enables());
    a.command(5, 5);
    a.steps(2000);
    EXPECT_TRUE(a.boolean("awaits_acknowledgement")) << mode;
    EXPECT_EQ(a.integer("drive_state", 1), kOff);
    EXPECT_THAT(a.told(), Contains(HasSubstr("because drive q1 was further from its target than following_error_max")));
    // The target is 0.2 rad ahead, after 0.5 s of soft start (0.125 rad) and the rest with 0.45 rad/s between them.
    EXPECT_LT(a.axis(1), -0.2 + 0.25);
  }
}

// The drives move with 0.8 rad/s, 12 mrad in a step of 15 ms: no jump.
TEST(EtherCatDriveStops, ALongStepIsNoJump) {
  Axes a("velocity");
  a.set("dq_command_max", "0.8 0.8");
  a.start();
  ASSERT_TRUE(a.enables());
  a.command(50, 50);
  a.steps(1500);
  for (int n = 0; n < 5; ++n) {
    a.step(Duration{15'000'000});
    a.steps(1 + n);
  }
  a.steps(100);
  EXPECT_TRUE(a.boolean("drives_enabled"));
  EXPECT_FALSE(a.boolean("awaits_acknowledgement")) << ::testing::PrintToString(a.told());
}

TEST(EtherCatDriveStops, TheTargetMovesByOneCycleAfterALongStep) {
  Axes a("position");
  a.start();
  ASSERT_TRUE(a.enables());
  a.command(5, 5);
  a.steps(1500);
  for (int n = 0; n < 5; ++n) {
    a.step(Duration{15'000'000});
    a.forget();
    a.steps(50);
    ASSERT_TRUE(a.boolean("drives_enabled"));
    ASSERT_GT(a.speeds[0], 0.4);
    // The drive stopped at its last target. A ramp from rest makes its loop overshoot by e⁻², a step of one cycle's way by ω/e of that way.
    constexpr double kSpeed = 0.5, kCycle = 1e-3;
    EXPECT_LT(a.fastest, kSpeed * (1 + std::exp(-2.0)) + kSpeed * kCycle * ethercat::ServoDrive::kBandwidth / std::numbers::e);
  }
}

// An encoder that turns evenly has the same speed in every step, also after longer ones.
TEST(EtherCatDriveStops, ALongStepIsNoSpeedOfAnEncoder) {
  Instance io = make_unit("unit:io?link=ethercat&slaves=EK1100,axis:EL5101", {}, {}, unit_types());
  assign_text(io.variables.at("counts_per_q"), "1e5");
  assign_text(io.variables.at("q_scale"), "1e-5");
  assign_text(io.variables.at("dq_cutoff"), "0");
  io.unit->initialise(Time{});
  const Duration tick{1'000'000};
  Time now{};
  double fastest = 0, slowest = 10;
  for (int n = 0; n < 1000; ++n) {
    const Duration h = n > 500 && n % 7 == 0 ? Duration{15'000'000} : tick;
    const Time sent = Time{now.ns + h.ns - tick.ns};
    io.variables.at("q_field").reals()[0] = 0.3 * 1e-9 * static_cast<double>(sent.ns);
    ASSERT_EQ(io.unit->step(now, h), StepResult::kDone);
    now = now + h;
    if (n < 490) continue;
    fastest = std::max(fastest, io.variables.at("dq").reals()[0]);
    slowest = std::min(slowest, io.variables.at("dq").reals()[0]);
  }
  EXPECT_NEAR(fastest, 0.3, 1.01e-2) << "one count per ms";
  EXPECT_NEAR(slowest, 0.3, 1.01e-2);
  std::vector<std::string> sentences;
  io.unit->append_notes(sentences);
  EXPECT_THAT(sentences, Not(Contains(HasSubstr("counters that no motion explains"))));
}

/// The unit with one drive that is described by an SII image.
struct ImageDrive {
  explicit ImageDrive(const ethercat::Sii& sii) {
    const std::vector<std::uint8_t> bytes = ethercat::write_sii(sii);
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  }
  Instance unit() const { return make_unit("unit:io?link=ethercat&drives=q1&slaves=q1:" + path, {}, {}, unit_types()); }
  std::string refusal() const {
    return error_of([&] { unit(); });
  }
  cotwin::testing::TemporaryFolder folder{"drives"};
  std::string path = (folder.path() / "drive.bin").string();
};

ethercat::PdoEntry entry(std::uint16_t index, std::uint8_t bits, const char* name = "") { return {index, 0, name, 0, bits, 0}; }

TEST(EtherCatDriveStops, OutputsBesideThoseOfTheModeNeedAValue) {
  ethercat::Sii sii = ethercat::servo_drive_sii();
  sii.rx_pdos[0].entries.push_back(entry(0x6072, 16, "Max torque"));
  const ImageDrive drive(sii);
  Instance io = drive.unit();
  const auto refusal = [&] { return error_of([&] { io.unit->initialise(Time{}); }); };
  assign_text(io.variables.at("drive_mode"), "position");
  EXPECT_THAT(refusal(), HasSubstr("q1_6072_0: not given, expected the value of object 0x6072:0 (Max torque)"));
  assign_text(io.variables.at("q1_6072_0"), "65536");
  EXPECT_THAT(refusal(), HasSubstr("q1_6072_0: 65536, expected a value of 16 bits"));
  assign_text(io.variables.at("q1_6072_0"), "1000");
  EXPECT_EQ(refusal(), "");
  sii.rx_pdos[0].entries.back() = entry(0x6840, 16, "Controlword 2");
  EXPECT_THAT(ImageDrive(sii).refusal(), HasSubstr("0x6840:0 (Controlword 2), expected a drive with one axis"));
  sii.rx_pdos[0].entries.back() = entry(0x6071, 16);
  EXPECT_EQ(ImageDrive(sii).refusal(), "") << "the second one gets a value of its own";
}

TEST(EtherCatDriveStops, WideValuesAreRefused) {
  for (const bool outputs : {false, true}) {
    ethercat::Sii sii = ethercat::servo_drive_sii();
    auto& entries = outputs ? sii.rx_pdos[0].entries : sii.tx_pdos[0].entries;
    entries[1].bits = 64;  // mode and mode display
    EXPECT_THAT(ImageDrive(sii).refusal(), HasSubstr("has 64 bits, expected at most 32"));
  }
  ethercat::Sii sii = ethercat::servo_drive_sii();
  sii.rx_pdos[0].entries.push_back(entry(0x2200, 64, "Wide"));
  EXPECT_THAT(ImageDrive(sii).refusal(), HasSubstr("0x2200:0 (Wide) has 64 bits, expected 1 to 32"));
}

/// The image of one drive that a master has not brought to OP.
TEST(EtherCatDriveStops, TheSafeImageIsAQuickStopWithTheValuesThatTheDriveNeeds) {
  ethercat::Sii sii = ethercat::servo_drive_sii();
  sii.rx_pdos[0].entries.push_back(entry(0x6072, 16, "Max torque"));
  SlaveChoice choice;
  choice.name = "q1";
  choice.kind = SlaveChoice::Kind::kDrive;
  choice.setup = ethercat::setup_of(sii, {}, "test");
  EtherCatDrives drives({choice}, {0}, trajectory::free_axes(1), nullptr, "test");
  Variables v;
  const JointMeasures measures(nullptr);
  JointVariables joints(v, measures);
  drives.declare(v, joints);
  assign_text(v.at("drive_mode"), "position");
  assign_text(v.at("q1_6072_0"), "1000");
  const std::vector<double> scale{1e-5}, offset{0};
  Acknowledgement acknowledgement;
  drives.initialise(1e-3, scale, offset, acknowledgement);
  ethercat::BusSetup bus;
  bus.slaves.resize(1);
  bus.slaves[0].setup = choice.setup;
  bus.output_bytes = choice.setup.output_bytes;
  bus.input_bytes = choice.setup.input_bytes;
  ethercat::Master master(std::move(bus), 1'000'000, 20'000'000, {});
  Command command(1);
  drives.write(master, 0, command, 1e-3, acknowledgement);
  const std::span<const std::uint8_t> safe = master.safe_outputs(0);
  EXPECT_EQ(read_bits(safe, 0, 16), 0x02u);
  EXPECT_EQ(read_bits(safe, 16, 8), 8u);
  for (const auto& image : {safe, std::span<const std::uint8_t>(master.outputs(0))})
    EXPECT_EQ(read_bits(image, 112, 16), 1000u);
}

TEST(EtherCatDriveStops, AStartUpValueOfTheModeMustBeThatOfTheRun) {
  const StartUpFile wrong("q1,PS,0x6060,0,i8,10\n"), right("q1,PS,0x6060,0,i8,8\n");
  Axes a("position", wrong.setting());
  EXPECT_THAT(error_of([&] { a.start(); }),
              HasSubstr("drives.csv:2: object 0x6060 is the mode of drive q1, expected 8 (i8) for drive_mode=position"));
  Axes b("position", right.setting());
  EXPECT_THAT(error_of([&] { b.start(); }), Not(HasSubstr("is the mode of drive")));
}

}  // namespace
}  // namespace cotwin::io::drive_stops_test
