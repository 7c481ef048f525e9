// A twin beside a controller of which the test writes every quantity: components/io/links/rtde_link.h, rtde_line.h. What goes wrong on a robot
// and its network: programs that run already, numbers that are none, silence, refused connections, steps that are too rare.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "components/io/link/belief.h"
#include "components/io/link/datagram_queue.h"
#include "components/io/links/rtde_line.h"
#include "tests/components/io/rtde/bytes.h"
#include "tests/components/io/rtde/ports.h"
#include "tests/support/error_of.h"

#ifdef __linux__
#include <poll.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#endif

namespace {

bool sends_of_the_twin = false;

}  // namespace

#ifdef __linux__
// A network on which a refusal takes a while, as every one but the loopback device: connect() says EINPROGRESS, and the refusal is there
// at the second poll(). And one that takes nothing of the twin.
namespace {

bool slow_refusals = false, network_is_full = false;
int connects = 0, polls = 0;

}  // namespace

extern "C" int connect(int descriptor, const sockaddr* address, socklen_t size) {
  ++connects;
  polls = 0;
  const long result = syscall(SYS_connect, descriptor, address, size);
  if (slow_refusals && result < 0 && errno == ECONNREFUSED) errno = EINPROGRESS;
  return static_cast<int>(result);
}

extern "C" int getsockopt(int descriptor, int level, int option, void* value, socklen_t* size) noexcept {
  const long result = syscall(SYS_getsockopt, descriptor, level, option, value, size);
  if (slow_refusals && level == SOL_SOCKET && option == SO_ERROR) *static_cast<int*>(value) = ECONNREFUSED;
  return static_cast<int>(result);
}

extern "C" ssize_t send(int descriptor, const void* bytes, std::size_t size, int flags) {
  if (network_is_full && sends_of_the_twin) {
    errno = EAGAIN;
    return -1;
  }
  return syscall(SYS_sendto, descriptor, bytes, size, flags, nullptr, 0);
}

extern "C" int poll(pollfd* files, nfds_t count, int timeout) {
  if (slow_refusals && ++polls == 1) return 0;
  timespec limit{timeout / 1000, timeout % 1000 * 1'000'000L};
  return static_cast<int>(syscall(SYS_ppoll, files, count, timeout < 0 ? nullptr : &limit, nullptr, 0));
}
#endif

namespace cotwin::io::line_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// A twin in position mode beside a plain robot.
struct Beside {
  PlainRobot robot;
  Ports twin;
  Duration h{2'000'000};
  std::int64_t n = 0;

  explicit Beside(const std::string& query = "robot=ur5e&link=rtde") : twin(query) {
    twin.set("mode", "position");
    twin.set("timeout", "30");
  }
  void start() {
    twin.set("controller", robot.address());
    twin.instance.unit->initialise(Time{});
    std::ranges::copy(robot.q, twin.reals("q_command").begin());
  }
  void step() {
    robot.exchange();
    sends_of_the_twin = true;
    ASSERT_EQ(twin.instance.unit->step(Time{n++ * h.ns}, h), StepResult::kDone);
    sends_of_the_twin = false;
  }
  /// A control cycle whose data the twin takes.
  void period() {
    robot.cycle();
    sends_of_the_twin = true;
    ASSERT_TRUE(twin.instance.unit->tick_source()->wait(monotonic_now() + kPatience));
    sends_of_the_twin = false;
    step();
    robot.exchange();
  }
  void periods(int count) {
    for (int k = 0; k < count && !::testing::Test::HasFatalFailure(); ++k) period();
  }
  bool until(const std::function<bool()>& done) {
    const std::int64_t deadline = monotonic_now() + kPatience;
    while (!done() && monotonic_now() < deadline && !::testing::Test::HasFatalFailure()) {
      robot.cycle();
      step();
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    return done();
  }
  /// Until commands may begin.
  bool connects() {
    const bool connected = until([&] { return twin.boolean("connected"); });
    periods(50);
    return connected;
  }
  /// `acknowledge` is off, and then on for the least time that counts, which ends with the last period.
  void acknowledge() {
    twin.set("acknowledge", "false");
    periods(3);
    twin.set("acknowledge", "true");
    periods(25);
  }
  double request() { return robot.controller.at("input_int_register_25"); }
  double command(std::size_t i) { return robot.controller.at("input_double_register_24", i); }
};

TEST(RtdeLink, WritesNothingUnlessItsModeSaysSo) {
  PlainRobot robot;
  robot.say(2);
  Ports twin("robot=ur5e&link=rtde");
  EXPECT_EQ(twin.text("mode"), "monitor");
  for (const double speed : twin.reals("dq_command_max")) EXPECT_EQ(speed, 0.5);
  twin.set("controller", robot.address());
  twin.instance.unit->initialise(Time{});
  twin.reals("q_command")[0] = kNaN;
  const std::int64_t deadline = monotonic_now() + kPatience;
  for (std::int64_t n = 0; twin.integer("received") < 100 && monotonic_now() < deadline; ++n) {
    robot.cycle();
    ASSERT_EQ(twin.instance.unit->step(Time{n * 2'000'000}, Duration{2'000'000}), StepResult::kDone);
  }
  EXPECT_GE(twin.integer("received"), 100);
  EXPECT_EQ(twin.integer("sent"), 0);
  EXPECT_EQ(twin.integer("refused"), 0);
  EXPECT_THAT(twin.text("warning"), ::testing::Not(HasSubstr("not finite")));
  EXPECT_EQ(robot.controller.statistics().received, 0u);
}

TEST(RtdeLink, NeedsItsCommandsWhenItDrivesARobot) {
  const auto required = [](const std::string& mode, const std::string& mask, const std::string& port) {
    Ports twin("robot=ur5e&link=rtde");
    twin.set("mode", mode);
    twin.set("digital_mask", mask);
    Variables now;
    twin.instance.unit->declare(now);
    return now.at(port).required;
  };
  EXPECT_FALSE(required("monitor", "0", "q_command"));
  EXPECT_TRUE(required("position", "0", "q_command"));
  EXPECT_FALSE(required("position", "0", "digital_command"));
  EXPECT_TRUE(required("position", "4", "digital_command"));
  for (const auto& [name, value] : {std::pair("digital_mask", "1"), std::pair("registers", "true")}) {
    Ports twin("robot=ur5e&link=rtde");
    twin.set(name, value);
    EXPECT_THAT(testing::error_of([&] { twin.instance.unit->initialise(Time{}); }),
                AllOf(HasSubstr("'monitor'"), HasSubstr(name)));
  }
}

TEST(RtdeLink, BeginsAtTheRobotThoughItsProgramFollowsAlready) {
  Beside s;
  s.robot.say(2);
  s.start();
  for (int session = 0; session < 2; ++session) {
    SCOPED_TRACE(session);
    const std::uint64_t before = s.robot.controller.statistics().received;
    ASSERT_TRUE(s.until([&] { return s.robot.controller.statistics().received > before; }));
    for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(s.command(i), s.robot.q[i], 0.5 * 0.002 * 3);
    s.periods(55);
    EXPECT_EQ(s.twin.boolean("commanding"), session == 0) << "after a loss it asks for rest until somebody acknowledges";
    EXPECT_EQ(s.request(), session == 0 ? 1 : 0);
    // It is moved while the connection is set up again; the clock waits meanwhile, so that the twin makes no step.
    s.robot.hang_up();
    for (double& q : s.robot.q) q += 1;
    const std::int64_t deadline = monotonic_now() + kPatience;
    const int accepted = s.robot.accepted;
    bool arrived = false;
    while (!arrived && monotonic_now() < deadline) {
      if (s.robot.accepted > accepted) s.robot.cycle();
      s.robot.exchange();
      arrived = s.twin.instance.unit->tick_source()->wait(monotonic_now() + 1'000'000).has_value();
    }
    ASSERT_TRUE(arrived);
    EXPECT_EQ(s.twin.integer("losses"), session);
  }
}

// Killed and started again at q₁ = 0.3, moved while it stood still, or with another clock: the robot gets its own position and no request, whatever
// its program does, until somebody acknowledges.
TEST(RtdeLink, ALossARestartOrAJumpIsFollowedByNothingUntilItIsAcknowledged) {
  for (const std::string event : {"restart", "jump", "clock", "stop", "pause"}) {
    SCOPED_TRACE(event);
    Beside s;
    s.robot.q[0] = 0;
    s.start();
    ASSERT_TRUE(s.connects());
    s.periods(5);
    ASSERT_EQ(s.request(), 1);
    s.robot.say(2);
    s.periods(260);
    ASSERT_TRUE(s.twin.boolean("commanding"));
    if (event == "restart") {
      s.robot.hang_up();
      s.robot.t = 0;
      s.robot.q[0] = 0.3;
      ASSERT_TRUE(s.until([&] { return s.twin.integer("connections") == 2; }));
    } else if (event == "jump") {
      s.robot.q[0] = 0.3;
    } else if (event == "clock") {
      s.robot.t = 0;
    } else {
      s.robot.say(event == "stop" ? 3 : 2, event == "stop" ? 2 : 4);
      s.periods(3);
      for (int k = 0; k < 150; ++k) {  // by hand, slowly
        s.robot.q[0] += 0.002;
        s.period();
      }
      s.robot.say(event == "stop" ? 3 : 2);
    }
    if (event == "jump" || event == "clock") s.periods(Belief::kMostHeld);  // nothing is sent
    if (event == "restart") s.periods(Belief::kMostHeld);                   // nor before five packages
    for (int k = 0; k < 260; ++k) {                                         // 0.5 s: position and speed agree again
      s.period();
      ASSERT_EQ(s.request(), 0) << k;
      ASSERT_EQ(s.command(0), s.robot.q[0]) << k;
    }
    EXPECT_TRUE(s.twin.boolean("awaits_acknowledgement"));
    EXPECT_FALSE(s.twin.boolean("commanding"));
    EXPECT_THAT(s.twin.text("warning"), HasSubstr("until acknowledge rose"));
    s.robot.say(1);  // what the program makes of a request that has ended
    s.acknowledge();
    EXPECT_EQ(s.request(), 1);
    EXPECT_EQ(s.command(0), s.robot.q[0]);
    s.robot.say(2);
    double before = s.command(0), speed = 0;
    for (int k = 0; k < 600; ++k) {
      s.period();
      const double now = (s.command(0) - before) / 0.002;
      ASSERT_LE(std::abs(now), 0.5 * std::min(1.0, (k + 2) * 0.002 / 0.5) + 1e-9) << k;
      ASSERT_LE(std::abs(now - speed), 20 * 0.002 + 1e-9) << k;
      before = s.command(0);
      speed = now;
    }
    EXPECT_NEAR(before, 0, 1e-9) << "where the twin is";
  }
}

// Four of five packages are damaged and well-formed: they are not used, and the robot goes on.
TEST(RtdeLink, DamagedPackagesAreNotUsed) {
  Beside s;
  s.start();
  ASSERT_TRUE(s.connects());
  s.periods(5);
  s.robot.say(2);
  s.periods(260);
  ASSERT_TRUE(s.twin.boolean("commanding"));
  const auto q = s.robot.q;
  const double started = s.robot.t;
  for (int k = 0; k < 100; ++k) {
    const double t = s.robot.t;
    if (k % 5 == 1) s.robot.q[0] += 0.5;
    if (k % 5 == 2) s.robot.q[4] = -1e8;
    if (k % 5 == 3) s.robot.t += 100;
    if (k % 5 == 4) s.robot.t -= 100;
    s.period();
    s.robot.q = q;
    s.robot.t = t + 0.002;
    for (std::size_t i = 0; i < 6; ++i) {
      ASSERT_EQ(s.twin.reals("q")[i], q[i]) << k;
      ASSERT_EQ(s.twin.reals("dq")[i], 0) << k;
    }
    ASSERT_NEAR(s.twin.real("t_robot"), started, 1) << k;
  }
  EXPECT_TRUE(s.twin.boolean("commanding"));
  EXPECT_FALSE(s.twin.boolean("awaits_acknowledgement"));
  EXPECT_EQ(s.twin.integer("implausible"), 80);
}

TEST(RtdeLink, OneTimeStampIsNotUsedButAClockThatStepsIsFound) {
  for (const double off : {1.0, 5.0, 20.0, 3000.0, -0.05, -1.0, -100.0}) {
    SCOPED_TRACE(off);
    Beside s;
    s.start();
    ASSERT_TRUE(s.connects());
    s.periods(5);
    s.robot.say(2);
    s.periods(300);
    s.twin.reals("q_command")[2] += 0.1;
    double before = s.command(2);
    for (int k = 0; k < 100; ++k) {
      const double t = s.robot.t;
      if (k % 20 == 7) s.robot.t += off;
      s.period();
      s.robot.t = t + 0.002;
      ASSERT_LE(s.command(2) - before, 0.5 * 0.002 * (k % 20 == 8 ? 2 : 1) + 1e-9) << k;
      ASSERT_NEAR(s.twin.real("t_robot"), s.robot.t, 0.003) << k;
      before = s.command(2);
    }
    EXPECT_TRUE(s.twin.boolean("commanding"));
    EXPECT_FALSE(s.twin.boolean("awaits_acknowledgement"));
    EXPECT_EQ(s.twin.integer("implausible"), 5);
    s.robot.t += off;
    s.periods(20);
    EXPECT_NEAR(s.twin.real("t_robot"), s.robot.t, 0.003) << "it goes on from there";
    EXPECT_EQ(s.twin.boolean("awaits_acknowledgement"), off > 30 || off < 0) << "the robot may have left out packages";
  }
}

TEST(RtdeLink, CommandsBeginWhereTheRobotIsThoughItsSetPointIsDamaged) {
  for (const double off : {0.02, 0.5, -3.0}) {
    for (const int where : {-1, 0, 1, 2, 3, 20}) {
      SCOPED_TRACE(::testing::Message() << off << " rad, package " << where);
      Beside s;
      s.start();
      ASSERT_TRUE(s.connects());
      s.periods(5);
      for (int k = -5; k < 50; ++k) {
        if (k == 0) s.robot.say(2);
        s.robot.target_off = k == where ? off : 0;
        s.period();
        ASSERT_NEAR(s.command(2), s.robot.q[2], 1e-9) << k;
        ASSERT_NEAR(s.twin.real("q_robot", 2), s.robot.q[2], 1e-9) << k;
      }
      const bool begins = where == 1 || where == 2;  // with the third package, for which it and the one before it count
      EXPECT_EQ(s.twin.boolean("awaits_acknowledgement"), begins);
      if (begins) {
        s.robot.say(1);
        s.acknowledge();
        s.robot.say(2);
        s.periods(3);
      }
      EXPECT_EQ(s.request(), 1);
      EXPECT_TRUE(s.twin.boolean("commanding"));
    }
  }
}

/// A twin that tau_e pushes, 4 kg.m² and 30 N.m.s per joint, beside a robot that rests and that nobody touches.
struct Guided : Beside {
  std::vector<double> dq = std::vector<double>(6);
  double way = 0,
         pushed = 0;  // rad: of commands that the robot is asked to follow, from where it is; that of a twin without inertia

  void rest() {
    std::ranges::fill(dq, 0);
    std::ranges::copy(robot.q, twin.reals("q_command").begin());
    way = pushed = 0;
  }
  void period() {
    double largest = 0;
    for (std::size_t i = 0; i < 6; ++i) {
      const double tau_e = twin.real("tau_e", i);
      dq[i] += 0.002 * (tau_e - 30 * dq[i]) / 4;
      twin.reals("q_command")[i] += 0.002 * dq[i];
      largest = std::max(largest, std::abs(tau_e));
    }
    pushed += largest * 0.002 / 30;
    Beside::period();
    for (std::size_t i = 0; i < 6 && request() == 1; ++i) way = std::max(way, std::abs(command(i) - robot.q[i]));
  }
  /// Follows, whatever was before.
  void begin() {
    robot.say(1);
    for (int k = 0; k < 60; ++k) period();
    if (twin.boolean("awaits_acknowledgement")) acknowledge();
    robot.say(2);
    rest();
    for (int k = 0; k < 8; ++k) period();
    ASSERT_TRUE(twin.boolean("commanding"));
    way = pushed = 0;
  }
};

// Every number of a package, by itself. Where at most two of any five are damaged nothing moves; else tau_e moves the twin as long as the middle of five
// says so, and a robot that is shown to be elsewhere is not asked to follow.
TEST(RtdeLink, DamagedNumbersMoveNothing) {
  Guided s;
  s.start();
  ASSERT_TRUE(s.connects());
  s.begin();
  std::vector<const rtde::Field*> fields;
  const rtde::Directory directory;
  for (const rtde::Field& field : directory.all()) {
    const bool low = field.name.find("_register") != std::string::npos && field.name.find("_register_2") == std::string::npos;
    if (field.output && !low) fields.push_back(&field);
  }
  std::mt19937 random(11);
  const auto one_of = [&](auto&& list) { return list[random() % std::size(list)]; };
  int stopped = 0;
  for (int n = 0; n < 900 && !HasFatalFailure(); ++n) {
    const rtde::Field& field = *one_of(fields);
    const std::size_t i = random() % rtde::values_of(field.type);
    const double off = one_of(std::array{0.003, -0.02, 0.5, 1.0, 8.0, 100.0, -1000.0, 1e4, 1e6});
    const int in_a_row = static_cast<int>(random() % 7), every = in_a_row > 0 ? 0 : one_of(std::array{2, 3, 5});
    SCOPED_TRACE(::testing::Message() << field.name << '[' << i << "] + " << off << ": " << in_a_row << " in a row, or every "
                                      << every);
    for (int k = 0; k < 30 && !HasFatalFailure(); ++k) {
      const bool damaged = every > 0 ? k % every == 0 : k < in_a_row;
      const double sound = s.robot.controller.at(field.name, i);
      if (damaged) s.robot.damage = [&](rtde::Controller& c) { c.at(field.name, i) += off; };
      s.period();
      s.robot.damage = nullptr;
      s.robot.controller.at(field.name, i) = sound;
    }
    EXPECT_LE(s.way, 1e-3 + (in_a_row > 2 || every == 2 ? s.pushed : 0));
    stopped += s.twin.boolean("awaits_acknowledgement") ? 1 : 0;
    if (s.twin.boolean("awaits_acknowledgement") || s.way > 1e-4) s.begin();
    s.rest();
  }
  EXPECT_GT(stopped, 0);
}

// A position or a set point that drifts while the robot rests: commands do not begin, or where the robot is, and that is told.
TEST(RtdeLink, CommandsDoNotBeginAtAPositionThatDrifts) {
  for (const std::string name : {"actual_q", "target_q", "both"}) {
    for (const double drift : {5e-5, 4e-4, -1e-3, 5e-3}) {
      SCOPED_TRACE(name + ' ' + std::to_string(drift));
      Guided s;
      s.start();
      ASSERT_TRUE(s.connects());
      double off = 0;
      s.robot.damage = [&](rtde::Controller& c) {
        off += drift;
        if (name != "target_q") c.at("actual_q", 2) += off;
        if (name != "actual_q") c.at("target_q", 2) += off;
      };
      for (int k = 0; k < 60; ++k) s.period();
      s.robot.say(2);
      for (int k = 0; k < 60; ++k) s.period();
      EXPECT_FALSE(s.twin.boolean("commanding"));
      EXPECT_GE(s.twin.integer("implausible"), 1);
      std::vector<std::string> sentences;
      s.twin.instance.unit->append_notes(sentences);
      EXPECT_THAT(sentences, ::testing::Contains(HasSubstr(" has moved by ")));
    }
  }
}

// Packages do not come for a while, but within timeout; the twin moves at the speed limit.
TEST(RtdeLink, MovesByOnePeriodAfterAPause) {
  std::mt19937 random(6);
  for (const double share : {0.05, 0.5, 0.9}) {
    Beside s;
    s.twin.set("timeout", "0.1");
    s.start();
    ASSERT_TRUE(s.connects());
    s.robot.say(2);
    s.periods(5);
    double before = s.command(2);
    for (int k = 0; k < 1500 && !HasFatalFailure(); ++k) {
      s.twin.reals("q_command")[2] = s.robot.q[2] + 10;
      if (static_cast<double>(random() % 100) < 100 * share) s.robot.t += 0.002 * static_cast<double>(random() % 48);
      s.period();
      ASSERT_LE(s.command(2) - before, 1.01 * 0.5 * 0.002) << share << ' ' << k;
      before = s.command(2);
    }
    EXPECT_EQ(s.twin.integer("losses"), 0);
  }
}

TEST(RtdeLink, OutputsAndRegistersStayUntilTheLossIsAcknowledged) {
  for (const std::string event : {"jump", "silent", "hangs up"}) {
    SCOPED_TRACE(event);
    const bool hangs_up = event == "hangs up";
    Beside s;
    s.twin.set("registers", "true");
    s.twin.set("digital_mask", "3");
    s.start();
    s.twin.set("digital_command", "1");
    s.twin.reals("double_command")[20] = 0.5;
    s.twin.instance.variables.at("int_command").integers()[20] = 5;
    ASSERT_TRUE(s.connects());
    s.robot.say(2);
    s.periods(5);
    ASSERT_EQ(s.robot.controller.at("standard_digital_output_mask"), 3);
    ASSERT_EQ(s.robot.controller.at("input_double_register_44"), 0.5);
    if (hangs_up) {
      s.robot.hang_up();
      ASSERT_TRUE(s.until([&] { return s.twin.integer("connections") == 2; }));
    } else if (event == "silent") {  // for the twin's time only, so that the connection stays
      s.n += 20000;
      s.step();
      ASSERT_EQ(s.twin.integer("losses"), 1);
    } else {
      s.robot.q[0] += 0.3;
    }
    s.twin.set("digital_command", "2");
    s.twin.reals("double_command")[20] = 0.75;
    s.twin.instance.variables.at("int_command").integers()[20] = 7;
    s.periods(260);  // 0.5 s: position and speed agree again
    EXPECT_EQ(s.twin.integer("connections"), hangs_up ? 2 : 1);
    EXPECT_EQ(s.robot.controller.at("standard_digital_output_mask"), 0);
    EXPECT_EQ(s.robot.controller.at("input_double_register_44"), hangs_up ? 0 : 0.5);
    EXPECT_EQ(s.robot.controller.at("input_int_register_44"), hangs_up ? 0 : 5);
    s.acknowledge();
    EXPECT_EQ(s.robot.controller.at("standard_digital_output_mask"), 3);
    EXPECT_EQ(s.robot.controller.at("input_double_register_44"), 0.75);
    EXPECT_EQ(s.robot.controller.at("input_int_register_44"), 7);
  }
}

TEST(RtdeLink, AnAcknowledgementCountsOnlyWhileTheRobotIsReady) {
  Beside s;
  s.start();
  ASSERT_TRUE(s.connects());
  s.robot.say(2);
  s.periods(5);
  s.robot.say(2, 4);
  s.periods(5);
  s.acknowledge();
  EXPECT_TRUE(s.twin.boolean("awaits_acknowledgement"));
  s.robot.say(1);
  s.periods(60);
  EXPECT_EQ(s.request(), 0);
  s.acknowledge();
  EXPECT_FALSE(s.twin.boolean("awaits_acknowledgement"));
  EXPECT_EQ(s.request(), 1);
}

TEST(RtdeLink, GoesOnByItselfOnlyIfItIsAskedTo) {
  Beside s;
  s.twin.set("restart", "automatic");
  s.start();
  ASSERT_TRUE(s.connects());
  s.robot.say(2);
  s.periods(5);
  s.robot.say(3);
  s.periods(2);
  EXPECT_EQ(s.request(), 1) << "what was asked stays until three packages say so";
  s.period();
  EXPECT_EQ(s.request(), 0) << "the program needs the end of the request";
  s.robot.say(1);
  s.periods(3);
  EXPECT_EQ(s.request(), 1);
  EXPECT_FALSE(s.twin.boolean("awaits_acknowledgement"));
}

TEST(RtdeLink, HoldsARegisterWithoutANumberAndItsSpeedLimit) {
  Beside s;
  s.twin.set("registers", "true");
  s.start();
  ASSERT_TRUE(s.connects());
  s.periods(5);
  s.robot.say(2);
  s.periods(260);  // the soft start
  s.twin.reals("q_command")[0] += 2;
  s.twin.reals("double_command")[20] = 0.75;
  s.periods(20);
  double before = s.command(0);
  const int sent = s.twin.integer("sent");
  for (int k = 0; k < 100; ++k) {
    s.twin.reals("double_command")[20] = 20 <= k && k < 60 ? kNaN : 0.25;
    s.twin.reals("double_command")[0] = kNaN;  // the commands are there
    s.period();
    EXPECT_NEAR(s.command(0) - before, 0.5 * 0.002, 1e-12) << k;
    EXPECT_EQ(s.robot.controller.at("input_double_register_44"), 0.25);
    before = s.command(0);
  }
  EXPECT_EQ(s.twin.integer("sent"), sent + 100);
  EXPECT_EQ(s.twin.integer("refused"), 40);
  EXPECT_THAT(s.twin.text("warning"), HasSubstr("double_command was not finite"));
}

#ifdef __linux__
TEST(RtdeLink, KeepsItsSpeedLimitOverCommandsThatTheNetworkDidNotTake) {
  Beside s;
  s.start();
  ASSERT_TRUE(s.connects());
  s.periods(5);
  s.robot.say(2);
  s.periods(260);  // the soft start
  s.twin.reals("q_command")[0] += 2;
  for (const bool full : {true, false}) {
    network_is_full = full;
    for (int k = 0; k < 25; ++k) {
      const double before = s.command(0), t = s.robot.t;
      s.period();
      if (!full && k > 2) {
        EXPECT_NEAR(s.command(0) - before, 0.5 * (s.robot.t - t), 1e-9) << k;
      }
    }
    if (full) {
      EXPECT_EQ(s.command(0), s.robot.q[0]);
    }
  }
  EXPECT_EQ(s.twin.integer("unsent"), 24);  // one waits for the network
  // 20 rad/s² for twelve cycles, then 0.5 rad/s.
  EXPECT_NEAR(s.command(0), s.robot.q[0] + (20 * 0.002 * 78 + 0.5 * 38) * 0.002, 1e-9);
}
#endif

TEST(RtdeLink, AddsItsWarnings) {
  Beside s;
  s.robot.controller.at("actual_TCP_pose") = 5;  // m, beyond every UR
  s.start();
  s.twin.reals("q_command")[3] = kNaN;
  ASSERT_TRUE(s.connects());
  s.periods(10);
  EXPECT_THAT(s.twin.text("warning"), AllOf(HasSubstr("does not fit to the URDF"), HasSubstr("; "), HasSubstr("not finite")));
  EXPECT_EQ(s.twin.text("warning").find("not finite"), s.twin.text("warning").rfind("not finite"));
}

TEST(RtdeLink, ShowsAProgramThatDoesNotPlayAsOff) {
  Beside s;
  s.robot.say(2);
  s.start();
  ASSERT_TRUE(s.connects());
  s.periods(3);
  EXPECT_EQ(s.twin.integer("state"), 2);
  s.robot.say(2, 4);  // paused; the register stays
  s.periods(3);
  EXPECT_EQ(s.twin.integer("state"), 0);
  EXPECT_FALSE(s.twin.boolean("commanding"));
}

TEST(RtdeLink, CountsAnyCounterThatTheRobotReflects) {
  Beside s;
  s.start();
  ASSERT_TRUE(s.connects());
  for (const double reflected : {-2147483648.0, 2147483647.0, -1.0}) {
    s.robot.controller.at("timestamp") = s.robot.t += 0.002;
    s.robot.controller.at("output_int_register_24") = reflected;
    s.robot.controller.cycle();
    s.robot.exchange();
    ASSERT_TRUE(s.twin.instance.unit->tick_source()->wait(monotonic_now() + kPatience));
    s.step();
  }
  EXPECT_LT(s.twin.real("round_trip"), 20);
}

TEST(RtdeLink, TicksGoOnWhenStepsAreRare) {
  Beside s;
  s.start();
  ASSERT_TRUE(s.connects());
  TickSource& ticks = *s.twin.instance.unit->tick_source();
  while (ticks.wait(0)) continue;
  for (int k = 0; k < 60; ++k) {
    s.robot.q[0] = 1 + 0.001 * k;
    s.robot.cycle();
    ASSERT_TRUE(ticks.wait(monotonic_now() + kPatience)) << k;
  }
  s.step();
  EXPECT_DOUBLE_EQ(s.twin.real("t_robot"), s.robot.t);
  EXPECT_DOUBLE_EQ(s.twin.real("q"), 1.059);
  EXPECT_EQ(s.twin.integer("connections"), 1);
}

rtde::ClientSettings wanted() {
  rtde::ClientSettings settings;
  settings.outputs = {{"timestamp"}, {"actual_q"}};
  return settings;
}

/// A line whose set-up is complete.
struct Line {
  PlainRobot robot;
  RtdeLine line;

  explicit Line(std::int64_t silence = kPatience) {
    line.open(robot.listener.local(), wanted(), silence, "test");
    EXPECT_TRUE(until([&] { return line.set_ups() == 1; }));
  }
  bool until(const std::function<bool()>& done) {
    const std::int64_t deadline = monotonic_now() + kPatience;
    while (!done() && monotonic_now() < deadline) {
      robot.exchange();
      line.serve();
    }
    return done();
  }
};

TEST(RtdeLine, ConnectsAgainWhenTheControllerIsSilent) {
  Line s(50'000'000);
  EXPECT_EQ(s.robot.accepted, 1);
  EXPECT_TRUE(s.until([&] { return s.line.set_ups() == 2; }));
  EXPECT_STREQ(s.line.reason(), "the controller is silent");
  EXPECT_EQ(s.robot.accepted, 2);
}

TEST(RtdeLine, EndsAStreamWithoutSenseWhileItWaits) {
  Line s;
  s.robot.cycle();
  const auto senseless = rtde::bytes("0001 55 0000");
  for (net::TcpStream& stream : s.robot.streams) stream.send(senseless);
  EXPECT_TRUE(s.line.wait(monotonic_now() + kPatience));  // the package before it is good
  EXPECT_FALSE(s.line.wait(monotonic_now() + 10'000'000));
  EXPECT_STREQ(s.line.reason(), "the stream of the controller cannot be read");
}

TEST(RtdeLine, GivesTicksATimeWhateverTheStampsAre) {
  Line s;
  std::int64_t last = 0;
  int arrivals = 0;
  for (const double t : {0.002, 0.004, 1e308, 1e9, -1e9, 1e9, 0.002, kNaN, 3000.0, 1e9}) {
    s.robot.controller.at("timestamp") = t;
    s.robot.controller.cycle();
    s.robot.exchange();
    const auto arrival = s.line.wait(monotonic_now() + (std::abs(t) <= 1e9 ? kPatience : 10'000'000));
    if (!arrival) continue;
    ++arrivals;
    EXPECT_GT(arrival->source, last);
    EXPECT_LE(arrival->source - last, 3'600'000'000'000) << "1 h at " << t;
    last = arrival->source;
  }
  EXPECT_EQ(arrivals, 8);
}

#ifdef __linux__
TEST(RtdeLine, PausesAfterARefusalThatComesLater) {
  std::uint16_t nobody = 0;
  { nobody = net::TcpListener({0x7f000001, 0}, "test").local().port; }
  slow_refusals = true;
  connects = 0;
  RtdeLine line;
  line.open({0x7f000001, nobody}, wanted(), kPatience, "test");
  for (int k = 0; k < 1000; ++k) line.serve();
  const bool in_time = !line.wait(monotonic_now() + 100'000'000);
  slow_refusals = false;
  EXPECT_TRUE(in_time);
  EXPECT_LE(connects, 2);  // one each 0.5 s
  EXPECT_STREQ(line.reason(), "nobody answers");
}
#endif

}  // namespace
}  // namespace cotwin::io::line_test
