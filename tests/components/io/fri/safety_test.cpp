// The twin's side of FRI when the robot's side, the network or the twin fail: components/io/links/fri_link.h against a controller whose
// messages are made here, so that they can have any contents.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "components/io/fri/fri.h"
#include "models/foundation/net/udp_socket.h"
#include "tests/components/io/fri/rig.h"
#include "tests/support/error_of.h"

namespace cotwin::io::safety_test {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN(), kInfinity = std::numeric_limits<double>::infinity();

/// Lets time pass on the host's clock.
void pass(std::int64_t ns) { std::this_thread::sleep_for(std::chrono::nanoseconds(ns)); }

class FriSafety : public ::testing::TestWithParam<Protocol> {};
INSTANTIATE_TEST_SUITE_P(Protocols, FriSafety, ::testing::ValuesIn(kProtocols), name_of_protocol);

TEST_P(FriSafety, DrivesNothingByDefault) {
  Ports twin(std::string("robot=lwr4&link=fri&protocol=") + fri::to_text(GetParam()));
  EXPECT_EQ(twin.instance.variables.at("mode").strings()[0], "monitor");
  for (const double limit : twin.reals("dq_command_max")) EXPECT_EQ(limit, kSpeed) << "the URDF's are above 1.9 rad/s";
  // Nothing is connected: the twin's zeros must not become the robot's.
  Rig rig(GetParam(), "monitor");
  std::ranges::fill(rig.twin.reals("q_command"), 0);
  rig.start();
  for (int k = 0; k < 100; ++k) {
    rig.m.state = k < 10 ? SessionState::kMonitoringReady : SessionState::kCommandingActive;
    rig.period();
    for (std::size_t i = 0; i < 7 && rig.command.has(fri::Command::kPosition); ++i) {
      ASSERT_NEAR(rig.command.q[i], kQ[i], rig.rounding());
    }
  }
  EXPECT_FALSE(rig.twin.boolean("commanding"));
}

TEST_P(FriSafety, NeverSendsWhatIsNotFiniteAndKeepsTheSpeedLimitAfterwards) {
  for (const double bad : {kNaN, kInfinity, -kInfinity, 1e300}) {
    Rig rig(GetParam());
    rig.begin();
    rig.settle();
    double before = rig.command.q[2];
    for (int k = 0; k < 80; ++k) {
      const double target = kQ[2] + 0.5;  // half a radian away from k = 40 on
      rig.twin.reals("q_command")[2] = k < 60 && (k % 20 == 10 || (k > 30 && k < 36)) ? bad : k < 40 ? kQ[2] : target;
      ASSERT_TRUE(rig.period());
      for (std::size_t i = 0; i < 7; ++i) ASSERT_TRUE(std::isfinite(rig.command.q[i]));
      ASSERT_LE(std::abs(rig.command.q[2] - before), kSpeed * rig.m.send_period * 1.001 + rig.rounding()) << "period " << k;
      before = rig.command.q[2];
    }
    EXPECT_GT(before, kQ[2] + 25 * kSpeed * rig.m.send_period) << "it moves to the new target afterwards";
    EXPECT_EQ(rig.twin.integer("refused"), 3 + 5 - 0);
    EXPECT_THAT(rig.twin.instance.variables.at("warning").strings()[0], ::testing::HasSubstr("not finite"));
  }
}

TEST_P(FriSafety, HoldsTorquesThatAreNotFinite) {
  Rig rig(GetParam(), "torque");
  rig.m.command_mode = fri::ClientCommandMode::kTorque;
  std::ranges::fill(rig.twin.reals("tau_command"), 2.5);
  rig.begin();
  ASSERT_TRUE(rig.command.has(fri::Command::kTorque));
  ASSERT_LT(rig.command.tau[3], 0.1) << "torques rise as the soft start goes on";
  rig.settle();
  ASSERT_EQ(rig.command.tau[3], 2.5);
  for (const double bad : {kNaN, kInfinity, 1e39}) {
    rig.twin.reals("tau_command")[3] = bad;
    ASSERT_TRUE(rig.period());
    EXPECT_EQ(rig.command.tau[3], 2.5);
  }
  EXPECT_EQ(rig.twin.integer("refused"), 3);
}

TEST(FriLwrSafety, HoldsAPoseThatIsNoneAndItsSpeedLimit) {
  Rig rig(Protocol::kLwr, "cartesian_impedance");
  rig.extra = M::kCommandedPose | M::kInterpolatorPose | M::kMeasuredPose;
  for (Pose* X : {&rig.m.X_measured, &rig.m.X_commanded, &rig.m.X_interpolator}) X->p = {0.5, 0, 0.6};
  std::ranges::copy(std::array{0.5, 0.0, 0.6}, rig.twin.reals("p_command").begin());
  rig.begin();
  rig.settle();
  const double step = 0.25 * 0.002;  // v_command_max, m
  Eigen::Vector3d before = rig.command.X.p;
  for (int k = 0; k < 40; ++k) {
    rig.twin.reals("p_command")[1] = k % 10 == 5 ? kNaN : 0.1;
    rig.twin.reals("quat_command")[0] = k % 10 == 7 ? kNaN : k % 10 == 8 ? 0 : 1;
    ASSERT_TRUE(rig.period());
    ASSERT_TRUE(rig.command.X.p.allFinite() && rig.command.X.R.allFinite());
    ASSERT_LE((rig.command.X.p - before).norm(), step * 1.001 + 1e-7);
    ASSERT_LT((rig.command.X.R - Eigen::Matrix3d::Identity()).norm(), 1e-6);
    before = rig.command.X.p;
  }
  EXPECT_NEAR(before.y(), 40 * step, 2 * step);
  EXPECT_EQ(rig.twin.integer("refused"), 12);
}

TEST_P(FriSafety, SeesARestartOfTheRobotWithinTheTimeoutWithoutASpike) {
  Rig rig(GetParam());
  rig.begin();
  rig.m.counter += 40'000;
  rig.m.counter &= 0xffff;
  for (int k = 0; k < 30; ++k) rig.period();
  const int restarts = rig.twin.integer("restarts");
  std::array<double, 7> moved = kQ;
  for (double& q : moved) q -= 0.6;
  rig.put(moved);
  rig.m.counter = 0;
  rig.m.time = 0;
  rig.m.state = SessionState::kMonitoringReady;
  double fastest = 0;
  for (int k = 0; k < 50; ++k) {
    rig.period();
    for (const char* name : {"dq", "ddq"}) {
      for (const double value : rig.twin.reals(name)) fastest = std::max(fastest, std::abs(value));
    }
    for (std::size_t i = 0; i < 7 && k > 2 && rig.command.has(fri::Command::kPosition); ++i) {
      ASSERT_NEAR(rig.command.q[i], moved[i], rig.rounding()) << "mirrored";
    }
  }
  EXPECT_LT(fastest, 1e-3) << "a restart is no motion";
  EXPECT_EQ(rig.twin.integer("restarts"), restarts + 1);
  EXPECT_EQ(rig.twin.integer("losses"), 0);
  EXPECT_NEAR(rig.twin.real("q"), moved[0], rig.rounding());
}

TEST_P(FriSafety, SeesARestartByTheClockAloneOrByMoreMessagesThanThereWasTimeFor) {
  for (const bool by_clock : {true, false}) {
    Rig rig(GetParam());
    rig.begin();
    for (int k = 0; k < 30; ++k) rig.period();
    std::array<double, 7> moved = kQ;
    for (double& q : moved) q += 1;
    rig.put(moved);
    if (by_clock) {
      rig.m.time = 0;  // the counter happens to go on
    } else {
      rig.m.counter += 20'000;  // 40 s of messages
      rig.without = M::kTime;
      if (GetParam() == Protocol::kLwr) rig.m.time += 20'000 * std::int64_t{2'000'000};
    }
    double fastest = 0;
    for (int k = 0; k < 5; ++k) {
      rig.period();
      fastest = std::max(fastest, std::abs(rig.twin.real("dq")));
    }
    EXPECT_LT(fastest, 1e-3) << by_clock;
    EXPECT_EQ(rig.twin.integer("restarts"), 1) << by_clock;
    EXPECT_EQ(rig.twin.integer("lost"), 0) << "the counters of another session are no loss";
  }
}

TEST_P(FriSafety, RejectsMessagesWithNumbersThatAreNotFinite) {
  Rig rig(GetParam());
  rig.extra = M::kMeasuredPose | M::kCommandedPose | M::kExternalWrench | M::kCommandedTorque;
  rig.begin();
  for (int k = 0; k < 5; ++k) rig.period();
  const int rejected = rig.twin.integer("rejected");
  int sent = 0;
  const M good = rig.m;
  const auto try_message = [&](auto&& spoil) {
    for (const double bad : {kNaN, kInfinity, -kInfinity, 1e30}) {
      const std::uint32_t counter = rig.m.counter;
      const std::int64_t time = rig.m.time;
      rig.m = good;
      rig.m.counter = counter;
      rig.m.time = time;
      spoil(rig.m, bad);
      EXPECT_FALSE(rig.period());
      EXPECT_FALSE(rig.twin.boolean("fresh"));
      ++sent;
    }
  };
  try_message([](M& m, double bad) { m.q_measured[6] = bad; });
  try_message([](M& m, double bad) { m.q_interpolator[0] = bad; });
  try_message([](M& m, double bad) { m.tau_measured[1] = bad; });
  try_message([](M& m, double bad) { m.tau_external[5] = bad; });
  if (GetParam() < Protocol::kSunrise2_5) try_message([](M& m, double bad) { m.q_commanded[3] = bad; });
  if (GetParam() == Protocol::kLwr || GetParam() == Protocol::kSunrise2_7) {
    try_message([](M& m, double bad) { m.F_external[4] = bad; });
  }
  if (GetParam() == Protocol::kLwr) {
    try_message([](M& m, double bad) { m.X_measured.p.y() = bad; });
    try_message([](M& m, double bad) { m.X_measured.R(1, 2) = bad; });
    try_message([](M& m, double bad) { m.X_commanded.p.x() = bad; });
  }
  EXPECT_EQ(rig.twin.integer("rejected") - rejected, sent);
  rig.m.counter -= 1;
  const std::uint32_t counter = rig.m.counter;
  const std::int64_t time = rig.m.time;
  rig.m = good;
  rig.m.counter = counter + 1;
  rig.m.time = time;
  EXPECT_TRUE(rig.period()) << "and goes on";
}

TEST(FriLwrSafety, KeepsVariablesOfTheRobotsProgramThatAreNotFinite) {
  Rig rig(Protocol::kLwr);
  rig.m.krl.real[3] = 2.5f;
  rig.twin.reals("krl_command_real")[4] = 1.5;
  rig.begin();
  rig.m.krl.real[3] = std::numeric_limits<float>::quiet_NaN();
  rig.twin.reals("krl_command_real")[4] = kNaN;
  rig.twin.reals("krl_command_real")[5] = 1e300;
  ASSERT_TRUE(rig.period()) << "a variable of the program does not end the session";
  EXPECT_EQ(rig.twin.real("krl_real", 3), 2.5);
  EXPECT_EQ(rig.command.krl.real[4], 1.5f);
  EXPECT_EQ(rig.command.krl.real[5], 0.0f);
}

TEST(FriLwrSafety, KeepsThePoseWhenTheMatrixIsNoRotation) {
  Rig rig(Protocol::kLwr);
  rig.m.X_measured.p = {0.5, 0, 0.6};
  rig.begin();
  rig.m.X_measured.R.setZero();
  rig.m.X_measured.p = {0.7, 0, 0.6};
  ASSERT_TRUE(rig.period());
  EXPECT_NEAR(rig.twin.real("p"), 0.5, 1e-6);
  EXPECT_EQ(rig.twin.real("quat"), 1.0);
}

TEST(FriSunriseSafety, RejectsMessagesWithoutAMeasuredPosition) {
  for (const Protocol p : {Protocol::kSunrise1_15, Protocol::kSunrise2_5, Protocol::kSunrise2_7}) {
    Rig rig(p);
    rig.begin();
    rig.without = M::kMeasuredPosition;
    const int rejected = rig.twin.integer("rejected");
    for (int k = 0; k < 10; ++k) EXPECT_FALSE(rig.period());
    EXPECT_EQ(rig.twin.integer("rejected"), rejected + 10);
    EXPECT_EQ(rig.twin.real("q", 3), kQ[3]);
    EXPECT_EQ(rig.twin.real("dq", 3), 0);
  }
}

TEST(FriSunriseSafety, RejectsACommandingStateWithoutAPositionToBeginAt) {
  Rig rig(Protocol::kSunrise2_5);
  rig.start();
  for (int k = 0; k < 5; ++k) rig.period();
  rig.without = M::kInterpolatorPosition;
  rig.m.state = SessionState::kCommandingWait;
  EXPECT_FALSE(rig.period());
  rig.m.state = SessionState::kCommandingActive;
  EXPECT_FALSE(rig.period());
  EXPECT_EQ(rig.twin.integer("rejected"), 2);
}

TEST_P(FriSafety, RejectsPeriodsThatNoRobotHas) {
  std::vector<double> periods{0, 1.001, 1e6};
  if (GetParam() == Protocol::kLwr) {
    for (const double bad : {4e-4, -0.002, kNaN, kInfinity, 1e30}) periods.push_back(bad);
  }
  for (const double bad : periods) {
    Rig rig(GetParam());
    rig.begin();
    rig.m.send_period = bad;
    const int rejected = rig.twin.integer("rejected");
    const std::int64_t time = rig.m.time;
    const auto bytes = rig.message();
    rig.m.send_period = 0.002;
    rig.m.time = time + 2'000'000;
    rig.send(bytes);
    EXPECT_FALSE(rig.step(1)) << bad;
    EXPECT_EQ(rig.twin.integer("rejected"), rejected + 1) << bad;
    EXPECT_TRUE(rig.period()) << bad;
  }
  if (GetParam() == Protocol::kLwr) return;
  Rig rig(GetParam());
  rig.begin();
  rig.m.receive_multiplier = 4'000'000'000;
  EXPECT_FALSE(rig.period());
  EXPECT_GE(rig.twin.integer("rejected"), 1) << "it would never be answered";
}

// The robot's controller extrapolates the command periods whose messages are lost, at most ten, as where it does not report its set point (Sunrise 2);
// or it does not.
TEST_P(FriSafety, MovesTheCommandByOnePeriodFromWhereTheRobotHasGoneMeanwhile) {
  for (const int gap : {0, 1, 4, 9, 30}) {
    for (const double share : {0.0, 1.0}) {
      Rig rig(GetParam());
      rig.begin();
      rig.settle();
      rig.twin.reals("q_command")[5] = kQ[5] + 1;
      for (int k = 0; k < 20; ++k) {
        rig.period();
        rig.m.q_measured[5] = rig.m.q_commanded[5] = rig.command.q[5];
      }
      const double before = rig.command.q[5], period = kSpeed * 0.002;
      for (int k = 0; k < gap; ++k) {
        if (k < 10) rig.m.q_measured[5] = rig.m.q_commanded[5] += share * period;
        rig.period(false);
      }
      ASSERT_TRUE(rig.period());
      ASSERT_EQ(rig.twin.integer("losses"), 0);
      const bool reports = GetParam() < Protocol::kSunrise2_5;
      const double meanwhile = (reports ? share : 1) * std::min(gap, 10) * period;
      EXPECT_NEAR(rig.command.q[5] - before, meanwhile + period, 4 * rig.rounding()) << gap << ' ' << share;
    }
  }
}

TEST_P(FriSafety, GoesOnAfterAnotherControllerOfAnotherVersionWasThere) {
  Rig rig(GetParam());
  rig.begin();
  // The robot is started anew with another protocol for 0.3 s, and then with this one, at another address.
  const Protocol own = rig.protocol;
  rig.protocol = own == Protocol::kLwr          ? Protocol::kSunrise2_7
                 : own == Protocol::kSunrise2_7 ? Protocol::kSunrise2_5
                                                : Protocol::kLwr;
  for (int k = 0; k < 150; ++k) EXPECT_FALSE(rig.period());
  EXPECT_FALSE(rig.twin.boolean("connected"));
  EXPECT_EQ(rig.twin.integer("rejected"), 150);
  rig.protocol = own;
  rig.robot = net::UdpSocket(net::Endpoint{0x7f000001, 0}, "test");
  std::array<double, 7> moved = kQ;
  for (double& q : moved) q += 0.2;
  rig.put(moved);
  rig.m.fields &= ~std::uint32_t{M::kCommandedPosition};
  rig.m.counter = 7;
  rig.m.state = SessionState::kMonitoringReady;
  for (int k = 0; k < 5; ++k) rig.period();
  EXPECT_TRUE(rig.twin.boolean("connected"));
  EXPECT_EQ(rig.twin.real("dq"), 0);
  EXPECT_NEAR(rig.twin.real("q"), moved[0], rig.rounding());
  EXPECT_EQ(rig.twin.integer("losses"), 1);
}

TEST_P(FriSafety, CountsAnswersThatTheSystemDoesNotSend) {
  Rig rig(GetParam());
  rig.begin();
  // The twin's socket, found by its address, takes nothing more.
  bool found = false;
  for (int file = 3; file < 1024 && !found; ++file) {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    std::array<unsigned char, 6> wanted{};
    const net::Endpoint local = rig.twin.datagrams().local();
    wanted = {static_cast<unsigned char>(local.port >> 8), static_cast<unsigned char>(local.port & 0xff), 127, 0, 0, 1};
    if (getsockname(file, reinterpret_cast<sockaddr*>(&address), &size) != 0 || address.ss_family != AF_INET) continue;
    found = std::equal(wanted.begin(), wanted.end(), reinterpret_cast<unsigned char*>(&address) + 2);
    if (found) (void)shutdown(file, SHUT_WR);
  }
  ASSERT_TRUE(found);
  for (int k = 0; k < 3; ++k) {
    rig.send(rig.message());
    ASSERT_TRUE(rig.twin.has(1));
    ASSERT_EQ(rig.twin.instance.unit->step(Time{rig.n++ * rig.h.ns}, rig.h), StepResult::kDone);
  }
  EXPECT_EQ(rig.twin.integer("unsent"), 3);
  std::vector<std::string> sentences;
  rig.twin.instance.unit->append_notes(sentences);
  EXPECT_THAT(sentences, ::testing::Contains("3 answers to the robot not sent by the system"));
}

TEST(FriSafetyOfSettings, RefusesALoopbackAddressWithARemoteController) {
  Ports twin("robot=lwr4&link=fri&protocol=lwr");
  twin.set("address", "127.0.0.1");
  twin.set("port", "0");
  twin.set("controller", "192.168.0.20");
  EXPECT_EQ(
      testing::error_of([&] { twin.instance.unit->initialise(Time{}); }),
      "unit:io?link=fri: address: 127.0.0.1, which only programs on this machine reach, with the controller 192.168.0.20, "
      "expected this machine's address in the controller's network, or 0.0.0.0");
  twin.set("controller", "127.0.0.2:30200");
  EXPECT_NO_THROW(twin.instance.unit->initialise(Time{}));
}

TEST(FriSafetyOfSettings, IsReachedFromThisMachineOnlyUnlessItsControllerIsNamed) {
  using ::testing::HasSubstr;
  Ports twin("robot=lwr4&link=fri&protocol=lwr");
  twin.set("port", "0");
  const auto start = [&] { return testing::error_of([&] { twin.instance.unit->initialise(Time{}); }); };
  EXPECT_EQ(start(), "");
  EXPECT_EQ(twin.datagrams().local().address, 0x7f000001u);
  EXPECT_EQ(twin.instance.variables.at("warning").strings()[0], "");
  twin.set("address", "0.0.0.0");
  EXPECT_THAT(start(), ::testing::AllOf(HasSubstr("controller: not given"), HasSubstr("0.0.0.0")));
  twin.set("controller", "127.0.0.1");
  EXPECT_EQ(start(), "");
  EXPECT_EQ(twin.instance.variables.at("warning").strings()[0], "");
  twin.set("controller", "192.0.2.7");
  EXPECT_EQ(start(), "");
  EXPECT_THAT(twin.instance.variables.at("warning").strings()[0], HasSubstr("neither authentication nor encryption"));
}

// With --address 127.0.0.2 --port 30200 the emulated controller holds that port. A twin that starts late or again has another address.
TEST(FriSafetyOfSettings, ATwinBindsItsPortBesideAnEmulatedControllerWithTheSameOne) {
  const net::UdpSocket controller(net::Endpoint{0x7f000002, 0}, "test");
  Ports twin("robot=lwr4&link=fri&protocol=sunrise-1.15");
  twin.set("port", std::to_string(controller.local().port));
  for (int times = 0; times < 2; ++times) {
    EXPECT_EQ(testing::error_of([&] { twin.instance.unit->initialise(Time{}); }), "");
  }
}

TEST(FriSafetyOfSettings, SaysWhatCameInsteadOfTheRobot) {
  const auto error_after = [](Protocol expected, std::optional<Protocol> comes, const char* controller = "") {
    Rig rig(expected);
    rig.twin.set("controller", controller);
    rig.start();  // to know the port
    rig.twin.set("wait", "0.3");
    std::vector<std::uint8_t> bytes(100, 1);
    if (comes) {
      rig.protocol = *comes;
      bytes = rig.message();
    }
    std::string error;
    std::thread sender([&] {
      for (int k = 0; k < 50 && *controller != 'x'; ++k) {
        rig.send(bytes);
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      }
    });
    error = testing::error_of([&] { rig.twin.instance.unit->initialise(Time{}); });
    sender.join();
    return error;
  };
  EXPECT_THAT(error_after(Protocol::kLwr, Protocol::kSunrise2_7),
              ::testing::HasSubstr(" datagrams refused, the first from 127.0.0.1:"));
  EXPECT_THAT(error_after(Protocol::kLwr, Protocol::kSunrise2_7),
              ::testing::HasSubstr(
                  "it is no message of this protocol, but fits sunrise-2.7), expected a controller with protocol lwr"));
  EXPECT_THAT(error_after(Protocol::kSunrise1_15, Protocol::kLwr), ::testing::HasSubstr("but fits lwr)"));
  EXPECT_THAT(error_after(Protocol::kLwr, std::nullopt), ::testing::HasSubstr("it is no message of this protocol)"));
  EXPECT_THAT(error_after(Protocol::kLwr, Protocol::kLwr, "127.0.0.9"), ::testing::HasSubstr("it is not from the controller)"));
  Rig rig(Protocol::kLwr);
  rig.twin.set("wait", "0.05");
  EXPECT_THAT(testing::error_of([&] { rig.start(); }), ::testing::HasSubstr("within 0.05 s (nothing came), expected"));
}

TEST_P(FriSafety, RepeatsTheAnswerWhileAClockWaitsForTheNextMessage) {
  Rig rig(GetParam());
  rig.twin.set("timeout", "60");
  rig.begin();
  rig.twin.datagrams().set_waits(true);
  rig.period();
  const fri::Command last = rig.command;
  ASSERT_TRUE(rig.twin.heard()) << "the last message, which the clock has not asked for";
  // The clock waits without steps, as with silence="wait".
  EXPECT_FALSE(rig.twin.datagrams().wait(monotonic_now() + 50'000'000).has_value());
  ASSERT_TRUE(rig.read_command());
  EXPECT_EQ(rig.command.counter, last.counter) << "a duplicate, not a new command";
  EXPECT_EQ(rig.command.reflected, last.reflected);
  std::vector<std::uint8_t> bytes(2048);
  while (rig.robot.receive(bytes)) {
  }
  // At the end once more: the robot may wait for it.
  rig.twin.instance.unit->end();
  for (int k = 0; k < 5; ++k) {
    ASSERT_TRUE(rig.read_command());
    EXPECT_EQ(rig.command.counter, last.counter);
  }
  // A clock that goes on without messages repeats nothing.
  rig.twin.datagrams().set_waits(false);
  EXPECT_FALSE(rig.twin.datagrams().wait(monotonic_now() + 50'000'000).has_value());
  rig.twin.instance.unit->end();
  EXPECT_FALSE(rig.robot.receive(bytes).has_value());
}

TEST_P(FriSafety, RepeatsNoAnswerOfASessionThatHasEndedOrOfARobotThatIsGone) {
  for (const bool idle : {true, false}) {
    if (idle && GetParam() == Protocol::kLwr) continue;  // its messages have no such state
    Rig rig(GetParam());
    rig.twin.set("timeout", "0.05");
    rig.begin();
    rig.twin.datagrams().set_waits(true);
    rig.m.state = idle ? SessionState::kIdle : rig.m.state;
    rig.period();
    ASSERT_TRUE(rig.twin.heard());
    if (!idle) pass(70'000'000);
    EXPECT_FALSE(rig.twin.datagrams().wait(monotonic_now() + 60'000'000).has_value());
    std::vector<std::uint8_t> bytes(2048);
    EXPECT_FALSE(rig.robot.receive(bytes).has_value()) << idle;
  }
}

TEST_P(FriSafety, HearsARobotThatWasRestartedWhileItsClockWaits) {
  for (const bool same_port : {true, false}) {
    for (const int messages : {30, 300}) {
      Rig rig(GetParam());
      rig.twin.set("timeout", "0.05");
      rig.begin();
      rig.twin.datagrams().set_waits(true);
      for (int k = 0; k < messages; ++k) rig.period();
      ASSERT_TRUE(rig.twin.heard());
      const int received = rig.twin.integer("received");
      pass(70'000'000);
      net::UdpSocket other({0x7f000001, 0}, "test");
      rig.m.counter = 1;
      rig.m.time = 1'500'000'000'000;
      rig.m.state = SessionState::kMonitoringReady;
      const auto first = rig.message();
      for (int k = 0; k < 2; ++k) (same_port ? rig.robot : other).send(first, rig.twin.datagrams().local());
      ASSERT_TRUE(rig.twin.heard()) << same_port << ' ' << messages;
      EXPECT_EQ(rig.twin.instance.unit->step(Time{rig.n * rig.h.ns}, rig.h), StepResult::kDone);
      EXPECT_EQ(rig.twin.integer("received"), received + 1) << same_port << ' ' << messages;
      EXPECT_EQ(rig.twin.integer("restarts"), 1) << same_port << ' ' << messages;
      EXPECT_EQ(rig.twin.integer("lost"), 0);
    }
  }
}

TEST_P(FriSafety, CountsAnOutageInWhichTheScenarioStoodStillAsLoss) {
  Rig rig(GetParam());
  rig.twin.set("timeout", "0.05");
  rig.begin();
  for (int k = 0; k < 5; ++k) rig.period();
  for (int k = 0; k < 150; ++k) rig.message();
  pass(300'000'000);
  rig.period();
  EXPECT_EQ(rig.twin.integer("lost"), 150);
  EXPECT_EQ(rig.twin.integer("restarts"), 0);
}

TEST(FriSunriseSafety, HoldsWhenTheRobotDoesNotAskForTheQuantityOfTheMode) {
  using Mode = fri::ClientCommandMode;
  struct Case {
    const char* mode;
    Mode asked;
    bool follows;
  };
  for (const auto& [mode, asked, follows] :
       {Case{"torque", Mode::kPosition, false}, Case{"torque", Mode::kTorque, true}, Case{"wrench", Mode::kTorque, false},
        Case{"position", Mode::kTorque, true}, Case{"position", Mode::kCartesianPose, false}}) {
    Rig rig(Protocol::kSunrise2_7, mode);
    rig.twin.set("tau_e_gated", "true");
    rig.m.command_mode = asked;
    rig.extra = M::kInterpolatorPose;
    rig.m.X_interpolator = {Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.1, 0.2, 0.3)};
    rig.m.tau_external.fill(2);
    for (double& q : rig.twin.reals("q_command")) q += 0.2;
    rig.start();
    for (int k = 0; k < 3; ++k) rig.period();
    rig.m.state = SessionState::kCommandingWait;
    rig.period();
    rig.m.state = SessionState::kCommandingActive;
    for (int k = 0; k < 50; ++k) rig.period();  // until its set point is believed
    rig.settle();
    const std::string name = std::string(mode) + ' ' + std::to_string(static_cast<int>(asked));
    EXPECT_EQ(rig.twin.boolean("commanding"), follows) << name;
    EXPECT_EQ(rig.twin.real("tau_e"), follows ? 2 : 0) << name;
    EXPECT_NEAR(rig.twin.real("q_sent"), kQ[0] + (follows ? 0.13 : 0), follows ? 0.01 : 1e-9) << name;
    const std::string warning = rig.twin.instance.variables.at("warning").strings()[0];
    EXPECT_EQ(warning.find("did not ask for the quantity of mode") != std::string::npos, !follows) << name;
    EXPECT_EQ(warning.find("did not ask"), warning.rfind("did not ask")) << "once";
  }
}

}  // namespace
}  // namespace cotwin::io::safety_test
