// Both sides of RTDE as units, in one process over TCP on 127.0.0.1: components/io/links/rtde_link.h, rtde_controller_link.h. Time is the
// scenario's: the twin's step waits for the robot's data, so that results do not depend on the speed of the machine.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "components/io/link/datagram_queue.h"
#include "tests/components/io/rtde/bytes.h"
#include "tests/components/io/rtde/ports.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::io::link_test {
namespace {

/// A controller with a robot that follows its set points at once, and a twin.
struct Session {
  Ports robot{"robot=ur5e&link=rtde_controller"}, twin;
  std::vector<double> q{0.2, -1.4, 1.5, -1.6, -1.5, 0.3};
  Duration h{2'000'000};
  std::int64_t n = 0;
  double fastest = 0;  // rad/s, of the set points

  explicit Session(const std::string& query = "robot=ur5e&link=rtde") : twin(query) {
    robot.set("port", "0");
    twin.set("mode", "position");
    twin.set("dq_command_max", "3.14");
  }

  void start() {
    std::ranges::copy(q, robot.reals("q").begin());
    robot.instance.unit->initialise(Time{});
    twin.set("controller", "127.0.0.1:" + std::to_string(robot.integer("listening_port")));
    twin.instance.unit->initialise(Time{});
    std::ranges::copy(q, twin.reals("q_command").begin());
  }
  void step_robot() {
    std::ranges::copy(q, robot.reals("q").begin());
    ASSERT_EQ(robot.instance.unit->step(Time{n * h.ns}, h), StepResult::kDone);
    const std::span<const double> command = robot.reals("q_command");
    for (std::size_t i = 0; i < 6; ++i) {
      const double dq = (command[i] - q[i]) / h.seconds();
      fastest = std::max(fastest, std::abs(dq));
      robot.reals("dq")[i] = dq;
      q[i] = command[i];
    }
  }
  /// One period of both. `heard`: the twin waits for the robot's data.
  void period(bool heard = true) {
    step_robot();
    if (heard) {
      ASSERT_TRUE(twin.instance.unit->tick_source()->wait(monotonic_now() + kPatience));
    }
    ASSERT_EQ(twin.instance.unit->step(Time{n * h.ns}, h), StepResult::kDone);
    ++n;
  }
  void periods(int count) {
    for (int k = 0; k < count && !::testing::Test::HasFatalFailure(); ++k) period();
  }
  /// Until `done`, at the pace of the host; data may be missing.
  template <class Done>
  bool until(const Done& done) {
    const std::int64_t deadline = monotonic_now() + kPatience;
    while (!done() && monotonic_now() < deadline && !::testing::Test::HasFatalFailure()) {
      period(false);
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    return done();
  }
  bool connects() {
    return until([&] { return twin.boolean("connected"); });
  }
  void acknowledge() {
    twin.set("acknowledge", "false");
    periods(3);
    twin.set("acknowledge", "true");
    periods(25);
  }
  bool commands() {
    return until([&] { return twin.boolean("commanding") && robot.boolean("active"); });
  }
};

TEST(RtdeLink, MeasuresWhatTheRobotMeasures) {
  Session s;
  const std::array<double, 6> tau{1, -20, 15, 2, 0.1, -0.02};
  std::ranges::copy(tau, s.robot.reals("tau").begin());
  s.robot.set("digital_in", "33025");  // 0x8101
  s.robot.reals("double_out")[30] = 0.75;
  s.robot.instance.variables.at("int_out").integers()[47] = -5;
  s.start();
  ASSERT_TRUE(s.connects());
  s.periods(3);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(s.twin.real("q", i), s.q[i]);
    EXPECT_EQ(s.twin.real("tau", i), tau[i]);
    EXPECT_EQ(s.twin.real("dq", i), s.robot.real("dq", i));
    EXPECT_DOUBLE_EQ(s.twin.real("current", i), tau[i] / 10);
  }
  EXPECT_TRUE(s.twin.boolean("has_tau") && s.twin.boolean("has_tau_e") && s.twin.boolean("fresh"));
  EXPECT_EQ(s.twin.integer("digital_in"), 0x8101);
  EXPECT_EQ(s.twin.real("double_value", 6), 0.75);
  EXPECT_EQ(s.twin.integer("int_value", 23), -5);
  EXPECT_EQ(s.twin.integer("robot_mode"), 7);
  EXPECT_EQ(s.twin.integer("safety"), 1);
  EXPECT_EQ(s.twin.integer("version"), 5);
  EXPECT_EQ(s.twin.integer("skipped"), 0);
  EXPECT_EQ(s.twin.integer("rejected"), 0);
}

TEST(RtdeLink, GivesTheJointTorquesOfTheReportedForce) {
  for (const char* frequency : {"500", "125"}) {  // e-Series: force at the flange; CB3: at the TCP
    SCOPED_TRACE(frequency);
    // Virtual work: a force f at the tool is the torque f · ∂p/∂q_i in joint i; p by the reported positions themselves.
    Session s;
    s.robot.set("frequency", frequency);
    s.twin.set("frequency", frequency);
    s.robot.set("tcp_offset", "0.05 -0.1 0.2 0.3 -0.5 0.7");
    if (std::string(frequency) == "125") s.h = Duration{8'000'000};
    s.start();
    ASSERT_TRUE(s.connects());
    const std::array<double, 6> q0{0.2, -1.4, 1.5, -1.6, -1.5, 0.3};
    const Eigen::Vector3d f(12, -7, 30);
    s.robot.set("ready", "false");  // it rests where it is put
    std::array<double, 6> expected;
    constexpr double kStep = 1e-4;
    // The set points stay at the start; the measured position is what the test writes.
    const auto put = [&](std::size_t joint, double offset) {
      std::ranges::copy(q0, s.robot.reals("q").begin());
      s.robot.reals("q")[joint] += offset;
      EXPECT_EQ(s.robot.instance.unit->step(Time{s.n * s.h.ns}, s.h), StepResult::kDone);
      EXPECT_TRUE(s.twin.instance.unit->tick_source()->wait(monotonic_now() + kPatience));
      EXPECT_EQ(s.twin.instance.unit->step(Time{s.n * s.h.ns}, s.h), StepResult::kDone);
      ++s.n;
      return Eigen::Vector3d(s.twin.real("p", 0), s.twin.real("p", 1), s.twin.real("p", 2));
    };
    const auto place = [&](std::size_t joint, double offset) {
      for (int k = 0; k < 2; ++k) put(joint, offset);
      return put(joint, offset);
    };
    for (std::size_t i = 0; i < 6; ++i) expected[i] = f.dot(place(i, kStep) - place(i, -kStep)) / (2 * kStep);
    std::ranges::copy(expected, s.robot.reals("tau_e").begin());
    for (int k = 0; k < 3; ++k) put(0, 0);  // a step of the force comes with the third package
    for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(s.twin.real("tau_e", i), expected[i], 1e-4) << i;
    const Eigen::Vector3d force(s.twin.real("F_e", 0), s.twin.real("F_e", 1), s.twin.real("F_e", 2));
    const Eigen::Vector3d moment(s.twin.real("F_e", 3), s.twin.real("F_e", 4), s.twin.real("F_e", 5));
    EXPECT_LE((force - f).norm(), 1e-2);
    const bool at_tcp = std::string(frequency) == "125";
    EXPECT_EQ(moment.norm() < 1e-2, at_tcp);
    EXPECT_LE(std::abs(moment.dot(f)), 1e-1);  // r × f
    EXPECT_LE(moment.norm(), std::hypot(0.05, 0.1, 0.2) * f.norm() + 1e-2);
  }
}

// The controller reports the force that explains the external torques best, for one package or from one on.
TEST(RtdeLink, OnePackageGivesNoForceButAHitDoes) {
  for (const bool cb3 : {false, true}) {
    for (const double bad : {20.0, 100.0, -3000.0, 1e5, 3.6e8}) {
      SCOPED_TRACE(bad);
      Session s;
      s.robot.set("frequency", cb3 ? "125" : "500");
      s.twin.set("frequency", cb3 ? "125" : "500");
      if (cb3) s.h = Duration{8'000'000};
      s.robot.set("tcp_offset", "0.05 -0.1 0.2 0.3 -0.5 0.7");
      s.start();
      ASSERT_TRUE(s.connects());
      s.periods(5);
      for (int k = 0; k < 20; ++k) {
        s.robot.reals("tau_e")[1] = k % 10 == 5 ? bad : 0;
        s.robot.reals("tau")[2] = k % 10 == 5 ? bad : 3;
        s.period();
        for (std::size_t i = 0; i < 6; ++i) {
          ASSERT_NEAR(s.twin.real("tau_e", i), 0, 1e-9) << k;
          ASSERT_NEAR(s.twin.real("F_e", i), 0, 1e-9) << k;
        }
        ASSERT_TRUE(k < 2 || s.twin.real("tau", 2) == 3) << k;
      }
      EXPECT_GE(s.twin.integer("implausible"), 2);
      const int before = s.twin.integer("implausible");
      s.robot.reals("tau_e")[1] = bad;
      s.periods(3);
      const bool possible = std::abs(bad) < 1000;
      EXPECT_EQ(s.twin.real("tau_e", 1) != 0, possible);
      EXPECT_EQ(s.twin.integer("implausible") - before, possible ? 0 : 3);
      s.periods(5);
      EXPECT_EQ(s.twin.boolean("has_tau_e"), possible);
    }
  }
}

TEST(RtdeLink, FollowsTheTwinWithoutAStepAndWithinTheSpeedLimit) {
  Session s;
  s.twin.set("dq_command_max", "0.5");
  s.start();
  const std::vector<double> from = s.q;
  for (std::size_t i = 0; i < 6; ++i) s.twin.reals("q_command")[i] += i % 2 == 0 ? 0.4 : -0.3;
  ASSERT_TRUE(s.commands());
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(s.q[i], from[i], 0.02);  // it begins where the robot is
  s.periods(1500);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(s.q[i], from[i] + (i % 2 == 0 ? 0.4 : -0.3), 1e-6);
  EXPECT_LE(s.fastest, 0.6);  // 0.5 rad/s, and what servoj's smoothing catches up
  EXPECT_GT(s.fastest, 0.3);
  EXPECT_GT(s.twin.real("round_trip"), 0);
  EXPECT_GT(s.robot.integer("received"), 1000);
  EXPECT_EQ(s.robot.integer("rejected"), 0);
}

TEST(RtdeLink, StopsTheRobotWhenTheTwinIsSilentAndGoesOnWhenItComesBack) {
  Session s;
  s.start();
  ASSERT_TRUE(s.commands());
  for (int k = 0; k < 200; ++k) {
    s.twin.reals("q_command")[1] += 0.002;  // 1 rad/s
    s.period();
  }
  const double last = s.twin.real("q_command", 1);
  int until_rest = 0;
  for (int k = 0; k < 400; ++k) {
    const double before = s.q[1];
    s.step_robot();
    ++s.n;
    if (std::abs(s.q[1] - before) > 1e-12) until_rest = k + 1;
  }
  EXPECT_EQ(s.robot.integer("state"), 3);
  EXPECT_EQ(s.robot.integer("losses"), 1);
  EXPECT_LE(until_rest * s.h.seconds(), 0.3 + 0.01);  // loss_time + stop_time
  EXPECT_NEAR(s.q[1], last, 0.15);
  // The twin has moved on meanwhile.
  s.twin.reals("q_command")[1] = last - 0.5;
  s.fastest = 0;
  const double rest = s.q[1];
  s.periods(300);
  EXPECT_TRUE(s.twin.boolean("awaits_acknowledgement"));
  EXPECT_EQ(s.robot.integer("state"), 1);
  EXPECT_EQ(s.q[1], rest);
  s.acknowledge();
  ASSERT_TRUE(s.commands());
  s.periods(1500);
  EXPECT_NEAR(s.q[1], last - 0.5, 1e-6);
  EXPECT_LE(s.fastest, 3.3);
}

TEST(RtdeLink, RefusesCommandsThatAreNotFinite) {
  Session s;
  s.start();
  ASSERT_TRUE(s.commands());
  s.periods(300);
  const std::vector<double> before = s.q;
  for (const double wrong : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    s.twin.reals("q_command")[2] = wrong;
    s.periods(200);
    EXPECT_TRUE(s.twin.boolean("commanding"));
    for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(s.q[i], before[i], 1e-6);
  }
  EXPECT_EQ(s.twin.integer("refused"), 400);
  EXPECT_EQ(s.robot.integer("rejected"), 0);
  EXPECT_THAT(s.twin.text("warning"), ::testing::HasSubstr("not finite"));
  s.twin.reals("q_command")[2] = before[2] + 0.1;
  s.periods(400);
  EXPECT_NEAR(s.q[2], before[2] + 0.1, 1e-6);
}

TEST(RtdeLink, HoldsWhileCommandIsFalseAndWhileTheRobotIsNotReady) {
  Session s;
  s.start();
  ASSERT_TRUE(s.commands());
  s.periods(100);
  const double q = s.q[0];
  s.twin.set("command", "false");
  s.twin.reals("q_command")[0] = q + 0.3;
  s.periods(200);
  EXPECT_NEAR(s.q[0], q, 1e-6);
  EXPECT_FALSE(s.twin.boolean("commanding"));
  s.twin.set("command", "true");
  s.robot.set("ready", "false");
  s.periods(200);
  EXPECT_NEAR(s.q[0], q, 0.05);
  EXPECT_FALSE(s.twin.boolean("commanding"));
  EXPECT_EQ(s.twin.integer("safety"), 3);
  const double rest = s.q[0];
  s.robot.set("ready", "true");
  s.fastest = 0;
  s.periods(300);
  EXPECT_EQ(s.q[0], rest) << "nobody has acknowledged the stop";
  s.acknowledge();
  ASSERT_TRUE(s.commands());
  EXPECT_NEAR(s.q[0], rest, 0.05);
  s.periods(600);
  EXPECT_NEAR(s.q[0], q + 0.3, 1e-6);
}

TEST(RtdeLink, ComesBackWhenTheControllerHasStartedAgain) {
  Session s;
  s.start();
  ASSERT_TRUE(s.commands());
  const std::string port = std::to_string(s.robot.integer("listening_port"));
  s.robot.set("port", port);
  s.q[0] += 0.3;  // it was moved meanwhile
  s.robot.instance.unit->initialise(Time{});
  std::ranges::copy(s.q, s.robot.reals("q").begin());
  s.robot.instance.unit->initialise(Time{});
  const std::vector<double> again = s.q;
  ASSERT_TRUE(s.until([&] { return !s.twin.boolean("connected"); }));
  EXPECT_EQ(s.twin.integer("losses"), 1);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(s.twin.real("dq", i), 0);
  ASSERT_TRUE(s.connects());
  s.periods(300);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(s.q[i], again[i]) << "it rests until somebody acknowledges";
  EXPECT_FALSE(s.robot.boolean("active"));
  s.fastest = 0;
  s.acknowledge();
  ASSERT_TRUE(s.commands());
  s.periods(50);
  EXPECT_LT(s.fastest, 3.14 * 0.25) << "a soft start";
  s.periods(1000);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(s.q[i], s.twin.real("q_command", i), 1e-6);
  EXPECT_GE(s.twin.integer("connections"), 2);
}

TEST(RtdeLink, ASecondTwinMayWatchButNotCommand) {
  Session s;
  s.start();
  ASSERT_TRUE(s.commands());
  Ports watcher("robot=ur5e&link=rtde"), rival("robot=ur5e&link=rtde");
  const std::string controller = "127.0.0.1:" + std::to_string(s.robot.integer("listening_port"));
  rival.set("mode", "position");
  for (Ports* other : {&watcher, &rival}) {
    other->set("controller", controller);
    other->instance.unit->initialise(Time{});
  }
  ASSERT_TRUE(s.until([&] {
    EXPECT_EQ(watcher.instance.unit->step(Time{s.n * s.h.ns}, s.h), StepResult::kDone);
    EXPECT_EQ(rival.instance.unit->step(Time{s.n * s.h.ns}, s.h), StepResult::kDone);
    std::vector<std::string> sentences;
    rival.instance.unit->append_notes(sentences);
    return watcher.integer("received") > 100 && sentences.at(0).find("another client writes input_") != std::string::npos;
  }));
  EXPECT_FALSE(rival.boolean("connected"));
  EXPECT_EQ(watcher.real("q", 2), s.twin.real("q", 2));
  EXPECT_TRUE(s.twin.boolean("commanding"));
  EXPECT_EQ(s.robot.integer("clients"), 2);
}

TEST(RtdeLink, AClientThatDoesNotReadHoldsNobodyUp) {
  Session s;
  s.start();
  ASSERT_TRUE(s.commands());
  net::TcpStream slow = net::TcpStream::connect({0x7f000001, static_cast<std::uint16_t>(s.robot.integer("listening_port"))});
  ASSERT_TRUE(s.until([&] { return slow.state() == net::TcpStream::State::kOpen; }));
  using rtde::bytes, rtde::letters, rtde::package;
  std::string all = "timestamp";
  for (int i = 0; i < 40; ++i) all += ",actual_TCP_pose";
  for (const auto& stream :
       {bytes("0005 56 0002"), package('O', rtde::operator+(bytes("407f400000000000"), letters(all))), bytes("0003 53")}) {
    ASSERT_EQ(slow.send(stream), stream.size());
  }
  ASSERT_TRUE(s.until([&] { return s.robot.integer("dropped") > 100; }));
  s.periods(100);
  EXPECT_EQ(s.twin.integer("skipped"), 0);
  EXPECT_TRUE(s.twin.boolean("commanding"));
}

TEST(RtdeLink, WritesDigitalOutputsAndRegisters) {
  Session s;
  s.twin.set("digital_mask", "15");
  s.twin.set("registers", "true");
  s.start();
  s.twin.set("digital_command", "250");
  s.twin.reals("double_command")[10] = -1.5;
  s.twin.instance.variables.at("int_command").integers()[10] = 77;
  ASSERT_TRUE(s.connects());
  s.periods(10);
  EXPECT_EQ(s.robot.integer("digital_out"), 10);
  EXPECT_EQ(s.robot.real("double_in", 34), -1.5);
  EXPECT_EQ(s.robot.integer("int_in", 34), 77);
  s.periods(3);
  EXPECT_EQ(s.twin.integer("digital_out"), 10);
}

TEST(RtdeLink, StepsAllocateNothingWhileConnectingFollowingAndLosing) {
  Session s;
  s.start();
  s.twin.reals("q_command")[0] += 0.1;
  const std::uint64_t before = testing::allocations();
  ASSERT_TRUE(s.commands());
  s.periods(50);
  s.twin.reals("q_command")[0] = std::numeric_limits<double>::quiet_NaN();
  s.periods(5);
  EXPECT_EQ(testing::allocations(), before);
}

TEST(RtdeLink, DataAreTicksWithTheRobotsTime) {
  Session s;
  s.start();
  ASSERT_TRUE(s.connects());
  TickSource& ticks = *s.twin.instance.unit->tick_source();
  EXPECT_EQ(ticks.period(), 2'000'000);
  s.periods(2);
  std::int64_t last = 0;
  for (int k = 0; k < 20; ++k) {
    s.step_robot();
    if (k % 5 == 4) s.step_robot();  // the controller's time goes on by two
    ++s.n;
    const auto arrival = ticks.wait(monotonic_now() + kPatience);
    ASSERT_TRUE(arrival);
    EXPECT_EQ(arrival->source % 2'000'000, 0);
    EXPECT_GT(arrival->source, last);
    last = arrival->source;
    EXPECT_EQ(s.twin.instance.unit->step(Time{s.n * s.h.ns}, s.h), StepResult::kDone);
  }
  EXPECT_FALSE(ticks.wait(monotonic_now() + 1'000'000));
}

TEST(RtdeLink, SaysWhatIsWrong) {
  const auto error = [](const std::string& query, const std::vector<std::pair<std::string, std::string>>& values) {
    return testing::error_of([&] {
      Ports unit(query);
      for (const auto& [name, value] : values) unit.set(name, value);
      unit.instance.unit->initialise(Time{});
    });
  };
  EXPECT_THAT(error("robot=lwr4&link=rtde", {}), ::testing::HasSubstr("7 joints, expected 6"));
  EXPECT_THAT(error("robot=lwr4&link=rtde_controller", {}), ::testing::HasSubstr("7 joints, expected 6"));
  EXPECT_THAT(error("robot=ur5e&link=rtde_controller", {{"port", "0"}, {"q", "0 0 0 0 7 0"}}),
              ::testing::AllOf(::testing::HasSubstr("joint 5 begins at 7 rad"), ::testing::HasSubstr("expected")));
  EXPECT_THAT(error("robot=ur5e&link=rtde_controller", {{"port", "0"}, {"q", "0 0 nan 0 0 0"}}),
              ::testing::HasSubstr("joint 3"));
  EXPECT_THAT(error("robot=ur5e&link=rtde", {{"controller", "robot"}}), ::testing::HasSubstr("no IPv4 address"));
  EXPECT_THAT(error("robot=ur5e&link=rtde", {{"mode", "torque"}}), ::testing::HasSubstr("torque"));
  std::uint16_t nobody = 0;
  { nobody = net::TcpListener({0x7f000001, 0}, "test").local().port; }
  EXPECT_THAT(error("robot=ur5e&link=rtde", {{"controller", "127.0.0.1:" + std::to_string(nobody)}, {"wait", "0.05"}}),
              ::testing::AllOf(::testing::HasSubstr("nobody answers"), ::testing::HasSubstr("within 0.05 s")));
}

TEST(RtdeLink, DoesNotGiveTorquesOfAnotherRobot) {
  Session s("robot=ur10e&link=rtde");
  s.start();
  ASSERT_TRUE(s.connects());
  EXPECT_FALSE(s.twin.boolean("has_tau_e"));
  EXPECT_THAT(s.twin.text("warning"), ::testing::HasSubstr("does not fit to the URDF"));
}

}  // namespace
}  // namespace cotwin::io::link_test
