// Both sides of FRI as units, in one process over UDP on 127.0.0.x: components/io/links/fri_link.h, fri_controller_link.h. Time is the
// scenario's: each step waits for the datagram of the other side, so that results do not depend on the speed of the machine.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "components/io/link/datagram_queue.h"
#include "components/unit/unit_table.h"
#include "tests/components/io/ports.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/lossy_line.h"
#include "tests/support/places.h"

namespace cotwin::io::link_test {
namespace {

namespace fs = std::filesystem;

/// A client unit and a controller unit; the robot behind the latter follows its commands with the share `a` of the way in each
/// step, from `q0`.
struct Session {
  explicit Session(const std::string& protocol, const std::string& settings = "")
      : twin("robot=lwr4&link=fri&protocol=" + protocol + settings),
        robot("robot=lwr4&link=fri_controller&protocol=" + protocol + settings) {
    twin.set("address", "127.0.0.1");
    twin.set("port", "0");
    robot.set("address", "127.0.0.1");
    robot.set("port", "0");
    robot.set("period", "0.002");
    robot.set("window", "20");
    twin.set("mode", "position");
    std::ranges::copy(robot.reals("dq_max"), twin.reals("dq_command_max").begin());  // the URDF's: faster than the default
  }

  void start() {
    twin.instance.unit->initialise(Time{});
    robot.set("client", net::to_text(twin.datagrams().local()));
    q.assign(q0.begin(), q0.end());
    std::ranges::copy(q, robot.reals("q").begin());
    robot.instance.unit->initialise(Time{});
  }

  /// One period: the robot sends and moves, the twin answers what has come.
  void period(bool twin_runs = true, bool robot_runs = true) {
    const Time now{n * h.ns};
    ++n;
    if (robot_runs) {
      std::ranges::copy(q, robot.reals("q").begin());
      ASSERT_EQ(robot.instance.unit->step(now, h), StepResult::kDone);
      const std::span<const double> command = robot.reals("q_command");
      for (std::size_t i = 0; i < q.size(); ++i) q[i] += a * (command[i] - q[i]);
    }
    if (!twin_runs) return;
    if (robot_runs) {
      ASSERT_TRUE(twin.heard());
    }
    ASSERT_EQ(twin.instance.unit->step(now, h), StepResult::kDone);
    if (robot_runs && twin.integer("state") != 0 && twin.boolean("fresh")) {
      ASSERT_TRUE(robot.heard());
    }
  }
  /// A period whose message is lost, or not.
  void lossy_period(bool lost) {
    const Time now{n * h.ns};
    ++n;
    std::ranges::copy(q, robot.reals("q").begin());
    ASSERT_EQ(robot.instance.unit->step(now, h), StepResult::kDone);
    std::ranges::copy(robot.reals("q_command"), q.begin());
    ASSERT_TRUE(twin.heard());
    if (lost) {
      ASSERT_TRUE(twin.datagrams().receive().has_value());
    }
    ASSERT_EQ(twin.instance.unit->step(now, h), StepResult::kDone);
    if (!lost) {
      ASSERT_TRUE(robot.heard());
    }
  }
  /// Periods until the robot follows the twin; −1: it does not.
  int until_commanding() {
    for (int k = 0; k < 500; ++k) {
      std::ranges::copy(twin.reals("q"), twin.reals("q_command").begin());
      period();
      if (::testing::Test::HasFatalFailure()) return -1;
      if (twin.boolean("commanding") && robot.boolean("active")) return k;
    }
    return -1;
  }

  /// Until the soft start of commands is over.
  void settle() {
    for (int k = 0; k < 260; ++k) period();
  }
  void acknowledge() {
    twin.set("acknowledge", "false");
    for (int k = 0; k < 3; ++k) period();
    twin.set("acknowledge", "true");
    for (int k = 0; k < 25; ++k) period();
  }

  Ports twin, robot;
  std::array<double, 7> q0{0, 0.3, 0, -1.2, 0, 0.9, 0};
  std::vector<double> q;
  double a = 1;
  Duration h{2'000'000};
  std::int64_t n = 0;
};

class FriLink : public ::testing::TestWithParam<const char*> {
 protected:
  /// Of the numbers on the wire.
  double rounding() const { return std::string(GetParam()) == "lwr" ? 2e-7 : 1e-12; }
};

TEST_P(FriLink, FollowsTheTwinFromMonitoringToCommandsWithoutAStep) {
  Session s(GetParam());
  s.robot.set("request", "false");
  s.start();
  std::vector<int> states;
  double largest_step = 0;
  std::vector<double> before(s.q0.begin(), s.q0.end());
  for (int k = 0; k < 1000; ++k) {
    if (k == 60) s.robot.set("request", "true");
    // The twin is 0.8 rad away from the robot all the time: commanding must not begin with that step.
    for (std::size_t i = 0; i < 7; ++i) s.twin.reals("q_command")[i] = s.q0[i] + 0.8;
    s.period();
    ASSERT_FALSE(HasFatalFailure());
    const std::span<const double> q_command = s.robot.reals("q_command");
    for (std::size_t i = 0; i < 7; ++i) {
      // Speed limits of the URDF: 1.919 to 3.141 rad/s.
      largest_step = std::max(largest_step, std::abs(q_command[i] - before[i]));
      before[i] = q_command[i];
    }
    if (states.empty() || states.back() != s.twin.integer("state")) states.push_back(s.twin.integer("state"));
  }
  if (std::string(GetParam()) == "lwr") {
    EXPECT_THAT(states, ::testing::ElementsAre(0, 1, 2, 4));
  } else {
    EXPECT_THAT(states, ::testing::ElementsAre(0, 1, 2, 3, 4));
  }
  EXPECT_EQ(s.twin.integer("quality"), 3);
  EXPECT_TRUE(s.twin.boolean("connected"));
  EXPECT_TRUE(s.twin.boolean("commanding"));
  EXPECT_TRUE(s.robot.boolean("active"));
  EXPECT_LE(largest_step, 3.141 * 0.002 * 1.001);
  EXPECT_GT(largest_step, 1.9 * 0.002) << "it approaches with the speed limit";
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_NEAR(s.robot.real("q_command", i), s.q0[i] + 0.8, rounding());
    EXPECT_NEAR(s.twin.real("q", i), s.q0[i] + 0.8, rounding());
    EXPECT_NEAR(s.twin.real("q_own", i), s.q0[i], rounding()) << "the robot's own motion is without the client";
  }
  EXPECT_EQ(s.twin.integer("lost"), 0);
  EXPECT_EQ(s.twin.integer("received"), 1000);
  EXPECT_EQ(s.robot.integer("in_time"), 999) << "the last answer is still on its way";
  EXPECT_EQ(s.robot.integer("missing"), 0);
  EXPECT_EQ(s.robot.integer("drops"), 0);
}

TEST_P(FriLink, MeasuresAreThoseOfTheRobotAndSpeedsItsDifferences) {
  Session s(GetParam());
  s.twin.set("mode", "monitor");
  s.twin.set("dq_cutoff", "0");
  s.robot.set("request", "false");
  s.start();
  const double rate = 2 * std::numbers::pi;
  for (int k = 0; k < 200; ++k) {
    const double t = k * s.h.seconds();
    for (std::size_t i = 0; i < 7; ++i) {
      s.q[i] = s.q0[i] + 0.1 * std::sin(rate * t + static_cast<double>(i));
      s.robot.reals("tau")[i] = 10 + static_cast<double>(i) - t;
      s.robot.reals("tau_e")[i] = t - static_cast<double>(i);
    }
    s.a = 0;
    const std::vector<double> q = s.q;
    s.period();
    ASSERT_FALSE(HasFatalFailure());
    ASSERT_EQ(s.twin.boolean("fresh"), k > 3) << "five messages follow from one another";
    if (k < 4) continue;
    ASSERT_NEAR(s.twin.real("t_measured"), (k + 1) * s.h.seconds(), 1e-7);
    for (std::size_t i = 0; i < 7; ++i) {
      ASSERT_NEAR(s.twin.real("q", i), q[i], rounding());
      const double late = t - 2 * s.h.seconds();  // the middle of five
      ASSERT_NEAR(s.twin.real("tau", i), 10 + static_cast<double>(i) - late, 1e6 * rounding() / 1e5 + 1e-12);
      ASSERT_NEAR(s.twin.real("tau_e", i), late - static_cast<double>(i), 1e6 * rounding() / 1e5 + 1e-12);
      if (k > 4) {
        // Mean speed over the last period, exactly the difference of the two positions.
        const double old = s.q0[i] + 0.1 * std::sin(rate * (t - s.h.seconds()) + static_cast<double>(i));
        ASSERT_NEAR(s.twin.real("dq", i), (q[i] - old) / s.h.seconds(), 2.1 * rounding() / s.h.seconds());
      }
    }
  }
  EXPECT_TRUE(s.twin.boolean("has_tau"));
  EXPECT_TRUE(s.twin.boolean("has_tau_e"));
  EXPECT_FALSE(s.twin.boolean("commanding"));
  EXPECT_NEAR(s.twin.real("period"), 0.002, 1e-9);
}

TEST_P(FriLink, HoldsWhenTheRobotIsSilentAndRecoversWithoutAStep) {
  Session s(GetParam());
  s.twin.set("timeout", "0.1");
  s.robot.set("restart", "0.05");
  s.start();
  ASSERT_GE(s.until_commanding(), 0);
  for (double& tau_e : s.robot.reals("tau_e")) tau_e = 3;
  for (int k = 0; k < 5; ++k) s.period();
  ASSERT_NEAR(s.twin.real("tau_e", 2), 3, 1e-6);
  // Silence for 0.1 s: nothing changes before, and the connection is lost within timeout and one step.
  int until_lost = 0;
  const double q = s.twin.real("q", 3), measured = s.twin.real("t_measured");
  while (s.twin.boolean("connected")) {
    s.period(true, false);
    ASSERT_FALSE(HasFatalFailure());
    ASSERT_LT(++until_lost, 100);
    ASSERT_EQ(s.twin.real("q", 3), q);
    ASSERT_FALSE(s.twin.boolean("fresh"));
    ASSERT_EQ(s.twin.real("t_measured"), measured);
  }
  EXPECT_NEAR(until_lost * s.h.seconds(), 0.1, 2 * s.h.seconds());
  EXPECT_EQ(s.twin.real("tau_e", 2), 0) << "no torque of a robot that is not there may move the twin";
  EXPECT_EQ(s.twin.real("dq", 3), 0);
  EXPECT_EQ(s.twin.integer("losses"), 1);
  EXPECT_EQ(s.twin.integer("state"), 0);
  EXPECT_NE(s.twin.instance.variables.at("warning").strings()[0], "");
  std::vector<std::string> sentences;
  s.twin.instance.unit->append_notes(sentences);
  EXPECT_THAT(sentences, ::testing::Contains(::testing::HasSubstr("silent 1 time,")));
  // The robot goes on from where it is when somebody has acknowledged; the twin is 0.1 rad away meanwhile.
  const double rest = s.robot.real("q_command", 3);
  for (int k = 0; k < 100; ++k) {
    for (std::size_t i = 0; i < 7; ++i) s.twin.reals("q_command")[i] = s.q0[i] + 0.1;
    s.period();
    ASSERT_FALSE(HasFatalFailure());
  }
  EXPECT_TRUE(s.robot.boolean("active")) << "its program asks for commands again";
  EXPECT_FALSE(s.twin.boolean("commanding"));
  EXPECT_TRUE(s.twin.boolean("awaits_acknowledgement"));
  EXPECT_NEAR(s.robot.real("q_command", 3), rest, 1e-6);
  s.acknowledge();
  double before = s.robot.real("q_command", 3), largest = 0;
  for (int k = 0; k < 600; ++k) {
    for (std::size_t i = 0; i < 7; ++i) s.twin.reals("q_command")[i] = s.q0[i] + 0.1;
    s.period();
    ASSERT_FALSE(HasFatalFailure());
    largest = std::max(largest, std::abs(s.robot.real("q_command", 3) - before));
    before = s.robot.real("q_command", 3);
  }
  EXPECT_TRUE(s.twin.boolean("connected"));
  EXPECT_TRUE(s.twin.boolean("commanding"));
  EXPECT_NEAR(s.robot.real("q_command", 3), s.q0[3] + 0.1, 1e-6);
  EXPECT_LE(largest, 2.094 * 1.1 * 0.002) << "speed limit of joint 4";
}

TEST_P(FriLink, StopsTheRobotWhenTheTwinIsSilentWithinTheDocumentedTime) {
  Session s(GetParam());
  s.robot.set("max_lost", "10");
  s.robot.set("window", "100");
  s.robot.set("stop_time", "0.1");
  s.start();
  ASSERT_GE(s.until_commanding(), 0);
  s.settle();
  // The twin moves with 0.5 rad/s when it falls silent.
  double q = s.q0[0];
  for (int k = 0; k < 100; ++k) {
    q += 0.5 * s.h.seconds();
    std::ranges::copy(s.q0, s.twin.reals("q_command").begin());
    s.twin.reals("q_command")[0] = q;
    s.period();
    ASSERT_FALSE(HasFatalFailure());
  }
  int until_rest = 0;
  double before = s.robot.real("q_command", 0);
  for (int k = 0; k < 200; ++k) {
    s.period(false);
    const double now = s.robot.real("q_command", 0);
    ASSERT_LE(std::abs(now - before), 0.5 * s.h.seconds() * 1.001 + 1e-6) << "never faster than before";
    if (std::abs(now - before) > 1e-7) until_rest = k + 1;
    before = now;
  }
  // Ten lost commands are extrapolated, the eleventh stops the robot; some periods until the loss shows.
  EXPECT_LE(until_rest * s.h.seconds(), (10 + 1 + 3) * s.h.seconds() + 0.1);
  EXPECT_GT(until_rest * s.h.seconds(), 10 * s.h.seconds());
  EXPECT_FALSE(s.robot.boolean("active"));
  EXPECT_EQ(s.robot.integer("drops"), 1);
  // One cannot go on by itself: the robot's program has to ask again.
  for (int k = 0; k < 100; ++k) s.period();
  EXPECT_FALSE(s.robot.boolean("active"));
  s.robot.set("request", "false");
  s.period();
  s.robot.set("request", "true");
  EXPECT_EQ(s.until_commanding(), -1) << "nor by the robot's program alone";
  s.acknowledge();
  EXPECT_GE(s.until_commanding(), 0);
}

TEST_P(FriLink, HoldsTheLastPositionWhileCommandIsFalse) {
  Session s(GetParam());
  s.start();
  ASSERT_GE(s.until_commanding(), 0);
  s.twin.set("command", "false");
  s.period();
  const double held = s.robot.real("q_command", 1);
  for (int k = 0; k < 50; ++k) {
    s.twin.reals("q_command")[1] = s.q0[1] + 0.3;
    s.period();
    ASSERT_NEAR(s.robot.real("q_command", 1), held, 2e-7);
    ASSERT_FALSE(s.twin.boolean("commanding"));
  }
  s.twin.set("command", "true");
  for (int k = 0; k < 400; ++k) s.period();
  EXPECT_NEAR(s.robot.real("q_command", 1), s.q0[1] + 0.3, 2e-7);
}

TEST_P(FriLink, AllocatesNothingInAStepWithMessages) {
  Session s(GetParam());
  s.start();
  ASSERT_GE(s.until_commanding(), 0);
  std::uint64_t allocated = 0;
  for (int k = 0; k < 100; ++k) {
    const Time now{s.n++ * s.h.ns};
    std::uint64_t before = testing::allocations();
    (void)s.robot.instance.unit->step(now, s.h);
    allocated += testing::allocations() - before;
    ASSERT_TRUE(s.twin.heard());
    before = testing::allocations();
    (void)s.twin.instance.unit->step(now, s.h);
    allocated += testing::allocations() - before;
    before = testing::allocations();
    ASSERT_TRUE(s.robot.heard());
    allocated += testing::allocations() - before;
  }
  EXPECT_EQ(allocated, 0u);
  EXPECT_EQ(s.twin.integer("lost"), 0);
}

TEST_P(FriLink, GivesTheSameBitsInEveryRun) {
  const auto run = [&] {
    Session s(GetParam());
    s.a = 0.3;
    std::fill_n(s.twin.reals("K_P").begin(), 7, 0.5);
    s.twin.set("guided_M", "0");
    s.twin.set("robot_resonance", "0");
    s.start();
    std::vector<double> all;
    for (int k = 0; k < 150; ++k) {
      for (std::size_t i = 0; i < 7; ++i) s.twin.reals("q_command")[i] = s.q0[i] + 0.05 * std::sin(0.05 * k);
      s.period();
      for (const char* name : {"q", "dq", "q_sent", "e"}) {
        for (const double value : s.twin.reals(name)) all.push_back(value);
      }
      for (const double value : s.robot.reals("q_command")) all.push_back(value);
    }
    return all;
  };
  EXPECT_EQ(run(), run());
}

/// A session whose datagrams pass two lines that disturb them.
struct DisturbedSession : Session {
  explicit DisturbedSession(const std::string& protocol)
      : Session(protocol), robot_side(net::Endpoint{0x7f000001, 0}, "test"), twin_side(net::Endpoint{0x7f000001, 0}, "test") {}

  void start() {
    robot.set("max_lost", "100");
    robot.set("fair", "0");
    robot.set("good", "0.5");
    robot.set("restart", "0.01");
    robot.set("window", "100");
    Session::start();
    to_twin = twin.datagrams().local();
    to_robot = robot.datagrams().local();
    robot.set("client", net::to_text(robot_side.local()));
    robot.instance.unit->initialise(Time{});
  }

  static std::vector<std::uint8_t> next(net::UdpSocket& socket) {
    std::vector<std::uint8_t> bytes(2048);
    const std::int64_t deadline = monotonic_now() + kPatience;
    while (monotonic_now() < deadline) {
      if (const auto received = socket.receive(bytes)) {
        bytes.resize(received->size);
        return bytes;
      }
    }
    ADD_FAILURE() << "no datagram";
    return {};
  }

  void period() {
    const Time now{n * h.ns};
    ++n;
    std::ranges::copy(q, robot.reals("q").begin());
    ASSERT_EQ(robot.instance.unit->step(now, h), StepResult::kDone);
    std::ranges::copy(robot.reals("q_command"), q.begin());
    down.push(now.ns, next(robot_side));
    std::size_t count = twin.datagrams().waiting();
    for (; down.due() <= now.ns; ++count) twin_side.send(down.pop(now.ns), to_twin);
    ASSERT_TRUE(twin.has(count));
    const int answers = twin.integer("answers");
    ASSERT_EQ(twin.instance.unit->step(now, h), StepResult::kDone);
    for (int k = answers; k < twin.integer("answers"); ++k) up.push(now.ns, next(twin_side));
    count = robot.datagrams().waiting();
    for (; up.due() <= now.ns; ++count) robot_side.send(up.pop(now.ns), to_robot);
    ASSERT_TRUE(robot.has(count));
  }

  net::UdpSocket robot_side, twin_side;
  net::Endpoint to_twin, to_robot;
  testing::LossyLine down{{}}, up{{}};
};

TEST_P(FriLink, CountsWhatALossyNetworkHasDone) {
  DisturbedSession s(GetParam());
  s.start();
  for (int k = 0; k < 120; ++k) s.period();
  ASSERT_TRUE(s.robot.boolean("active"));
  testing::Disturbance disturbance;
  disturbance.loss = 0.02;
  disturbance.burst = 3;
  disturbance.duplicate = 0.05;
  disturbance.reorder = 0.04;
  disturbance.hold = 3 * s.h.ns;
  s.down.set(disturbance);
  disturbance.seed = 2;
  s.up.set(disturbance);
  double largest = 0, farthest = 0, before = s.robot.real("q_command", 0);
  for (int k = 0; k < 1500; ++k) {
    for (std::size_t i = 0; i < 7; ++i) s.twin.reals("q_command")[i] = s.q0[i] + 0.1 * std::sin(0.01 * k);
    s.period();
    ASSERT_FALSE(HasFatalFailure());
    largest = std::max(largest, std::abs(s.robot.real("q_command", 0) - before));
    before = s.robot.real("q_command", 0);
    if (k > 100) farthest = std::max(farthest, std::abs(before - s.twin.real("q_command", 0)));
  }
  s.down.set({});
  s.up.set({});
  for (int k = 0; k < 100; ++k) s.period();
  EXPECT_EQ(s.robot.integer("drops"), 0);
  EXPECT_GT(s.robot.integer("bridged"), 50);
  EXPECT_GT(s.down.counts().overtaken, 20);
  EXPECT_EQ(s.twin.integer("lost"), s.down.counts().lost);
  EXPECT_EQ(s.twin.integer("duplicates"), s.down.counts().duplicates);
  EXPECT_EQ(s.twin.integer("reordered"), s.down.counts().overtaken);
  EXPECT_EQ(s.twin.integer("received"), s.down.counts().delivered - s.down.counts().duplicates);
  const int sent = s.twin.integer("received") + s.twin.integer("lost");
  EXPECT_NEAR(s.twin.real("t_measured"), sent * s.h.seconds(), 1e-6) << "whatever was lost or came together";
  EXPECT_GT(s.up.counts().lost, 50);
  EXPECT_EQ(s.robot.integer("lost"), s.up.counts().lost);
  EXPECT_EQ(s.robot.integer("duplicates"), s.up.counts().duplicates);
  EXPECT_EQ(s.robot.integer("reordered"), s.up.counts().overtaken);
  EXPECT_EQ(s.twin.integer("rejected") + s.robot.integer("rejected"), 0);
  EXPECT_LE(largest, 1.919 * s.h.seconds() * 1.001) << "no jump beyond the speed limit";
  // 0.5 rad/s at most: one period of transport, and two bursts of three that are extrapolated and corrected.
  EXPECT_LT(farthest, 0.5 * s.h.seconds() * 8);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_NEAR(s.robot.real("q_command", i), s.twin.real("q_command", i), 1e-6) << "in step afterwards";
  }
}

// The twin moves at the speed limit, to and fro; messages are lost, at most nine in a row.
TEST_P(FriLink, MovesTheRobotNoFasterAfterPauses) {
  for (const double share : {0.05, 0.5, 0.9}) {
    Session s(GetParam());
    s.robot.set("max_lost", "100");
    s.robot.set("fair", "0");
    s.robot.set("good", "0");
    std::ranges::fill(s.twin.reals("dq_command_max"), 0.5);
    s.start();
    ASSERT_GE(s.until_commanding(), 0);
    s.settle();
    std::mt19937 random(4);
    double q = s.robot.real("q_command", 0), before = q, largest = 0;
    int in_a_row = 0;
    for (int k = 0; k < 1500; ++k) {
      q += 0.5 * s.h.seconds() * (k / 300 % 2 == 0 ? 1 : -1);
      s.twin.reals("q_command")[0] = q;
      const bool lost = in_a_row < 9 && static_cast<double>(random() % 1000) < 1000 * share;
      in_a_row = lost ? in_a_row + 1 : 0;
      s.lossy_period(lost);
      ASSERT_FALSE(HasFatalFailure());
      const double now = s.robot.real("q_command", 0);
      largest = std::max(largest, std::abs(now - before) / s.h.seconds());
      before = now;
    }
    EXPECT_TRUE(s.robot.boolean("active")) << share;
    EXPECT_EQ(s.robot.integer("drops"), 0) << share;
    // Where nine periods in a row are extrapolated over a reversal, the robot's controller catches up.
    EXPECT_LE(largest, share < 0.1 ? 1.01 * 0.5 : 0.7) << share;
  }
}

TEST_P(FriLink, IgnoresAndCountsDatagramsOfOthersAndDamagedOnes) {
  DisturbedSession s(GetParam());
  s.start();
  for (int k = 0; k < 150; ++k) s.period();
  ASSERT_TRUE(s.twin.boolean("commanding"));
  const std::vector<double> q(s.twin.reals("q").begin(), s.twin.reals("q").end());
  net::UdpSocket stranger(net::Endpoint{0x7f000001, 0}, "test");
  const std::vector<std::uint8_t> noise(1000, 0x5a);
  for (int k = 0; k < 50; ++k) {
    stranger.send(noise, s.to_twin);
    stranger.send(noise, s.to_robot);
    s.twin_side.send(std::span(noise).first(static_cast<std::size_t>(k)), s.to_twin);
    s.robot_side.send(std::span(noise).first(static_cast<std::size_t>(k)), s.to_robot);
    ASSERT_TRUE(s.twin.has(1)) << "those of strangers are not kept";
    ASSERT_TRUE(s.robot.has(2)) << "and the last answer";
    s.period();
    ASSERT_FALSE(HasFatalFailure());
  }
  for (int k = 0; k < 3; ++k) s.period();
  EXPECT_EQ(s.twin.integer("strangers"), 50);
  EXPECT_EQ(s.robot.integer("strangers"), 50);
  EXPECT_EQ(s.twin.integer("rejected"), 100);
  EXPECT_EQ(s.robot.integer("rejected"), 100);
  EXPECT_TRUE(s.twin.boolean("commanding"));
  EXPECT_EQ(s.robot.integer("drops"), 0);
}

INSTANTIATE_TEST_SUITE_P(Protocols, FriLink,
                         ::testing::Values("lwr", "sunrise-1.11", "sunrise-1.14", "sunrise-1.15", "sunrise-1.16", "sunrise-2.5",
                                           "sunrise-2.7"),
                         [](const auto& protocol) {
                           std::string name = protocol.param;
                           std::erase_if(name, [](char c) { return c == '-' || c == '.'; });
                           return name;
                         });

}  // namespace
}  // namespace cotwin::io::link_test
