// Both sides of FRI against each other in simulated time, through a network that loses, delays, doubles and reorders datagrams.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "models/foundation/support/error.h"
#include "tests/components/io/fri/exchange.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::session_test {
namespace {

using namespace fri;
using testing::client_settings;
using testing::controller_settings;
using testing::Exchange;
using C = Command;
using M = Monitoring;

constexpr std::int64_t kMs = 1'000'000;
constexpr double kPi = 3.14159265358979323846;

/// The client adds a sine to the position of the interpolator, as KUKA's example does: amplitude in rad, frequency in Hz. Its
/// speed is 2π · amplitude · frequency.
struct SineOverlay {
  double amplitude = 0.1, frequency = 0.5;
  double began = -1;  // s

  void operator()(Exchange& x) {
    if (!x.client.commanding()) {
      began = -1;
      return;
    }
    const double t = static_cast<double>(x.now) * 1e-9;
    if (began < 0) began = t;
    x.wanted.q = x.client.monitoring().q_interpolator;
    for (double& q : x.wanted.q) q += amplitude * std::sin(2 * kPi * frequency * (t - began));
  }
};

std::string name_of(const ::testing::TestParamInfo<Protocol>& information) {
  std::string name = to_text(information.param);
  for (char& c : name) c = c == '-' || c == '.' ? '_' : c;
  return name;
}

/// A controller whose messages have measured positions, without which a client does not use them.
Controller make_controller(const ControllerSettings& settings) {
  Controller controller(settings, "controller");
  controller.robot().fields |= M::kMeasuredPosition;
  return controller;
}

class FriSession : public ::testing::TestWithParam<Protocol> {};
INSTANTIATE_TEST_SUITE_P(AllProtocols, FriSession, ::testing::ValuesIn(kProtocols), name_of);

class FriCounters : public FriSession {};
INSTANTIATE_TEST_SUITE_P(EachKind, FriCounters, ::testing::Values(Protocol::kLwr, Protocol::kSunrise2_7), name_of);

TEST_P(FriSession, PassesItsStatesInOrderAndTheRobotFollowsTheClient) {
  const Protocol p = GetParam();
  for (const std::int64_t period : {kMs, 5 * kMs}) {
    Exchange x(controller_settings(p, period), client_settings(p));
    x.program = [](double t, Joints& q) { q[0] = 0.3 * std::sin(t); };  // the robot moves by itself, too
    SineOverlay sine;
    x.want = [&] { sine(x); };
    std::string states;
    SessionState last = SessionState::kIdle;
    double error = 0;
    x.observe = [&] {
      if (x.controller.state() != last) states += std::to_string(static_cast<int>(x.controller.state()));
      last = x.controller.state();
      if (!x.controller.setpoint(x.now).active || sine.began < 0) return;
      // A command reaches the drives up to two periods after its message, at a speed of up to 0.62 rad/s.
      const double t = static_cast<double>(x.now) * 1e-9;
      const double expected = 0.3 * std::sin(t) + 0.1 * std::sin(2 * kPi * 0.5 * (t - sine.began));
      error = std::max(error, std::abs(x.controller.setpoint(x.now).q[0] - expected));
    };
    x.run(98 * period);
    EXPECT_EQ(x.controller.state(), SessionState::kMonitoringReady);
    EXPECT_LT(x.controller.quality(), Quality::kExcellent);
    x.run(105 * period);
    EXPECT_EQ(x.controller.quality(), Quality::kExcellent);
    x.controller.request(true);
    x.run_seconds(4.0);
    EXPECT_EQ(x.controller.state(), SessionState::kCommandingActive);
    EXPECT_EQ(x.client.state(x.now), SessionState::kCommandingActive);
    EXPECT_LT(error, 0.62 * 2.2e-9 * static_cast<double>(period) + 1e-5);
    x.controller.request(false);
    x.run_seconds(0.5);
    EXPECT_EQ(x.controller.drop(), Drop::kRequest);
    EXPECT_EQ(states, p == Protocol::kLwr ? "1242" : "12342");
    EXPECT_EQ(x.client.statistics().faults.total() + x.controller.statistics().faults.total(), 0u);
    x.controller.close(x.now);
    EXPECT_EQ(x.controller.state(), SessionState::kIdle);
    x.run_seconds(0.001);  // Sunrise tells it; clients of LWR see it by the silence
    EXPECT_EQ(x.client.monitoring().state == SessionState::kIdle, p != Protocol::kLwr);
    EXPECT_TRUE(x.controller.cycle(x.now).empty());
    x.run_seconds(3.0);
    EXPECT_EQ(x.client.state(x.now), SessionState::kIdle);
  }
}

// The set point is continuous over all changes of state, no faster than the limit and near what the client wants, whatever the
// network does.
TEST_P(FriSession, MovesNoJointFasterThanItsLimitAndTracksWithABoundedError) {
  const Protocol p = GetParam();
  for (std::uint32_t seed = 1; seed <= 4; ++seed) {
    ControllerSettings settings = controller_settings(p, seed % 2 == 0 ? 4 * kMs : kMs);
    settings.enter = settings.hold = Quality::kPoor;  // only losses in a row end commanding
    settings.max_lost = 8;
    settings.slack = 4 * kMs;
    Exchange x(settings, client_settings(p), seed);
    x.to_client = {0.1, 0.1, 50'000, seed < 3 ? 0 : 2 * kMs};
    x.to_controller = {0.1, 0.1, 50'000, seed < 3 ? 0 : 2 * kMs};
    SineOverlay sine{0.25, 1.2};  // 1.9 rad/s of 2
    x.want = [&] { sine(x); };
    Joints before{};
    double fastest = 0, error = 0;
    std::uint64_t active = 0;
    x.observe = [&] {
      const Setpoint& s = x.controller.setpoint(x.now);
      if (s.active && sine.began >= 0) {
        const double t = static_cast<double>(x.now) * 1e-9 - sine.began;
        error =
            std::max(error, std::abs(s.q[0] - x.client.monitoring().q_interpolator[0] - 0.25 * std::sin(2 * kPi * 1.2 * t)));
      }
      // Commands of a period of 1 ms are steps.
      const double time = settings.send_period == kMs ? 1e-3 : static_cast<double>(Exchange::kStep) * 1e-9;
      for (std::size_t i = 0; i < 7; ++i) fastest = std::max(fastest, std::abs(s.q[i] - before[i]) / time);
      before = s.q;
      active += s.active ? 1 : 0;
      if (x.controller.drop() != Drop::kNone) x.controller.request(x.now / (400 * kMs) % 2 == 0);
    };
    x.controller.request(true);
    x.run_seconds(6);
    EXPECT_LE(fastest, 2.0 + 1e-6) << seed;
    // The delays, and a gap that is bridged in the wrong direction: twice the way at full speed.
    EXPECT_LE(error, 2 * 2.0 * (static_cast<double>((settings.max_lost + 2) * settings.send_period) * 1e-9 + 4e-3)) << seed;
    EXPECT_GT(active, 1000u) << seed;
    EXPECT_GT(x.controller.statistics().bridged, 10u) << seed;
    for (const double q : before) EXPECT_LT(std::abs(q), 2.9);
  }
}

TEST_P(FriSession, CountsExactlyWhatTheNetworkDid) {
  const Protocol p = GetParam();
  Exchange x(controller_settings(p), client_settings(p), 5);
  x.to_client = {0.05, 0.04, 100'000, 2 * kMs};
  x.to_controller = {0.05, 0.04, 100'000, 2 * kMs};
  x.run_seconds(20);
  x.to_client = x.to_controller = {};  // what was lost at the end becomes visible
  x.run_seconds(0.02);
  x.drain();
  const SequenceTracker& m = x.client.statistics().monitoring;
  const SequenceTracker& c = x.controller.statistics().commands;
  EXPECT_GT(x.monitoring.lost, 900u);
  EXPECT_EQ(m.lost(), x.monitoring.lost);
  EXPECT_EQ(c.lost(), x.commands.lost);
  EXPECT_EQ(m.received(), x.monitoring.sent - x.monitoring.lost);
  EXPECT_EQ(c.received(), x.commands.sent - x.commands.lost);
  EXPECT_EQ(m.duplicates(), x.monitoring.doubled);
  EXPECT_EQ(c.duplicates(), x.commands.doubled);
  EXPECT_GT(m.reordered(), 100u);
  // Every message that arrived was answered, once.
  EXPECT_EQ(x.client.statistics().answers, m.received());
  const ControllerStatistics& s = x.controller.statistics();
  EXPECT_EQ(s.in_time + s.late, c.received());
  EXPECT_EQ(s.sent, x.monitoring.sent);
  // The last period is still open.
  EXPECT_LE(s.sent - (s.in_time + s.late + s.missing), 1u);
  // Unanswered without a gap in the commands.
  EXPECT_NEAR(static_cast<double>(s.missing) - static_cast<double>(s.commands.lost()), static_cast<double>(x.monitoring.lost),
              1);
}

// There and back, each 100 µs and up to 300 µs: latencies from 200 to 800 µs, mean 500 µs; with a triangular distribution of mean
// deviation 100 µs.
TEST_P(FriSession, MeasuresDelayAndJitter) {
  const Protocol p = GetParam();
  Exchange x(controller_settings(p), client_settings(p), 6);
  x.to_client = {0, 0, 100'000, 300'000};
  x.to_controller = {0, 0, 100'000, 300'000};
  x.run_seconds(10);
  const Moments& latency = x.controller.statistics().latency;
  EXPECT_NEAR(latency.mean(), 500e-6, 10e-6);
  EXPECT_GE(latency.minimum(), 199e-6);
  EXPECT_LE(latency.maximum(), 801e-6);
  EXPECT_NEAR(x.controller.statistics().answer_time.quantile(0.5), 500e-6, 50e-6);
  EXPECT_NEAR(x.controller.robot().latency, 500e-6, 50e-6);
  EXPECT_NEAR(x.controller.robot().jitter, 100e-6, 25e-6);
  // From the answer to the next message that reflects it: its way, the rest of the period and the way back.
  EXPECT_NEAR(x.client.statistics().round_trip.mean(), 1e-3, 20e-6);
  EXPECT_NEAR(x.client.statistics().interval.mean(), 1e-3, 1e-6);
  EXPECT_NEAR(x.client.statistics().jitter, 100e-6, 50e-6);
  EXPECT_EQ(x.controller.statistics().late + x.controller.statistics().missing, 0u);
}

TEST_P(FriSession, StopsWithinTheDocumentedTimeWhenTheClientIsGone) {
  const Protocol p = GetParam();
  const ControllerSettings settings = controller_settings(p, 2 * kMs);
  Exchange x(settings, client_settings(p));
  x.run_seconds(0.3);
  x.controller.request(true);
  double speed = 0.8;
  x.want = [&] {
    if (!x.client.commanding()) return;
    x.wanted.q = x.client.sent().q;
    for (double& q : x.wanted.q) q += speed * 2e-3;
  };
  x.run_seconds(0.5);
  ASSERT_EQ(x.controller.state(), SessionState::kCommandingActive);
  x.to_controller.loss = 1;
  const std::int64_t cut = x.now;
  const double q_cut = x.controller.setpoint(x.now).q[3];
  std::int64_t rest = 0;
  Joints before{};
  x.observe = [&] {
    const Setpoint& s = x.controller.setpoint(x.now);
    if (s.q != before) rest = x.now;
    before = s.q;
  };
  x.run_seconds(1);
  EXPECT_EQ(x.controller.drop(), Drop::kLost);
  EXPECT_TRUE(is_monitoring(x.controller.state()));
  EXPECT_LE(rest - cut, (settings.max_lost + 2) * settings.send_period + settings.stop_time);
  EXPECT_GE(rest - cut, settings.max_lost * settings.send_period + settings.stop_time);
  // v (10 … 12 periods) + v · stop time/2.
  EXPECT_NEAR(before[3] - q_cut, 0.8 * (11 * 0.002 + 0.1), 0.8 * 0.004);

  // The client is back: the quality recovers, but the robot waits for its program.
  x.to_controller.loss = 0;
  speed = 0;
  x.run_seconds(0.3);
  EXPECT_EQ(x.controller.state(), SessionState::kMonitoringReady);
  EXPECT_EQ(x.controller.setpoint(x.now).q, before);
  x.controller.request(false);
  x.run_seconds(0.02);
  x.controller.request(true);
  x.run_seconds(0.1);
  EXPECT_EQ(x.controller.state(), SessionState::kCommandingActive);
  EXPECT_NEAR(x.controller.setpoint(x.now).q[3], before[3], 1e-6);  // and goes on from where it stands
}

TEST_P(FriSession, DropsBackWhenTheQualityIsLost) {
  const Protocol p = GetParam();
  ControllerSettings settings = controller_settings(p);
  settings.max_lost = 100;
  Exchange x(settings, client_settings(p), 7);
  x.run_seconds(0.2);
  x.controller.request(true);
  x.run_seconds(0.1);
  ASSERT_EQ(x.controller.state(), SessionState::kCommandingActive);
  x.to_client.loss = 0.15;  // 0.85 of the answers: FAIR
  x.run_seconds(1);
  EXPECT_EQ(x.controller.state(), SessionState::kCommandingActive);
  EXPECT_EQ(x.controller.quality(), Quality::kFair);
  EXPECT_EQ(x.client.monitoring().quality, Quality::kFair);
  x.to_client.loss = 0.5;
  x.run_seconds(1);
  EXPECT_EQ(x.controller.state(), SessionState::kMonitoringWait);
  EXPECT_EQ(x.controller.drop(), Drop::kQuality);
}

// A client that is always late by one to two periods: its answers count as late, and the line through them goes on.
TEST_P(FriSession, RatesLateAnswersAsLate) {
  const Protocol p = GetParam();
  Exchange x(controller_settings(p), client_settings(p));
  x.to_controller.delay = 1'500'000;
  x.run_seconds(1);
  const ControllerStatistics& s = x.controller.statistics();
  EXPECT_EQ(s.in_time, 0u);
  EXPECT_GE(s.late, 997u);
  EXPECT_LE(s.missing, 2u);
  EXPECT_EQ(x.controller.quality(), Quality::kPoor);
  EXPECT_EQ(x.controller.robot().misses, s.late + s.missing);
}

// The caller reads the socket late, but the datagram had arrived in time.
TEST(FriController, RatesByTheTimeOfArrivalNotOfReading) {
  const Protocol p = Protocol::kSunrise1_15;
  Controller controller = make_controller(controller_settings(p));
  Client client(client_settings(p), "client");
  controller.open(0);
  for (std::int64_t k = 0; k < 300; k += 2) {
    const std::int64_t t = k * kMs;
    const auto message = controller.cycle(t);
    if (client.receive(message, {1, 1}, t + 1000) == Client::Reception::kAnswerDue) {
      const auto answer = client.answer({}, t + 2000);
      const testing::Bytes kept(answer.begin(), answer.end());
      const auto late_message = controller.cycle(t + kMs);  // before the answer is read
      controller.receive(kept, {2, 2}, t + 100'000);
      if (client.receive(late_message, {1, 1}, t + kMs + 1000) == Client::Reception::kAnswerDue) {
        controller.receive(client.answer({}, t + kMs + 2000), {2, 2}, t + kMs + 100'000);
      }
    }
  }
  EXPECT_EQ(controller.statistics().in_time, 300u);
  EXPECT_EQ(controller.statistics().missing, 0u);
  EXPECT_EQ(controller.quality(), Quality::kExcellent);
  EXPECT_EQ(controller.statistics().skipped, 0u);
  controller.cycle(310 * kMs + 500'000);  // ten messages too late
  EXPECT_EQ(controller.statistics().skipped, 10u);
  EXPECT_EQ(controller.next(), 311 * kMs);
}

TEST_P(FriSession, DropsBackAndStopsWhenALimitIsExceeded) {
  const Protocol p = GetParam();
  const bool lwr = p == Protocol::kLwr;
  struct Case {
    Drop drop;
    std::function<void(Exchange&)> act;
  };
  const Case cases[] = {
      {Drop::kSpeed, [](Exchange& x) { x.wanted.q[2] += 0.1; }},
      {Drop::kPosition, [](Exchange& x) { x.wanted.q[6] = 2.95; }},
      {Drop::kTorque, [](Exchange& x) { x.wanted.tau[1] = -51; }},
      {Drop::kTorque, [](Exchange& x) { x.wanted.F[1] = 30; }},
      {Drop::kRobot, [](Exchange& x) { x.controller.robot().drives[5] = DriveState::kOff; }},
      {Drop::kRobot, [](Exchange& x) { x.controller.robot().safety = SafetyState::kStopLevel1; }},
  };
  for (const Case& c : cases) {
    ControllerSettings settings = controller_settings(p);
    settings.force_limit = 20;
    const bool wrench = c.drop == Drop::kTorque && &c == &cases[3];
    settings.command_mode = wrench ? ClientCommandMode::kWrench : ClientCommandMode::kTorque;
    settings.control = wrench ? ControlMode::kCartesianImpedance : ControlMode::kJointImpedance;
    Exchange x(settings, client_settings(p));
    x.wanted.fields = C::kPosition | (wrench ? C::kWrench : C::kTorque);
    x.program = [](double, Joints& q) { q.fill(0.2), q[6] = 2.8999; };
    x.want = [&] { x.wanted.q = x.client.monitoring().q_commanded; };
    if (p >= Protocol::kSunrise2_5) {
      x.want = [&] { x.wanted.q = x.client.monitoring().q_interpolator; };
    }
    x.run_seconds(0.2);
    x.controller.request(true);
    x.run_seconds(0.1);
    ASSERT_EQ(x.controller.state(), SessionState::kCommandingActive) << to_text(c.drop);
    const Joints before = x.controller.setpoint(x.now).q;
    const auto want = x.want;
    x.want = [&] {
      want();
      c.act(x);
    };
    x.run_seconds(0.3);
    EXPECT_EQ(x.controller.drop(), c.drop);
    EXPECT_TRUE(is_monitoring(x.controller.state()));
    EXPECT_EQ(x.controller.statistics().drops[static_cast<std::size_t>(c.drop)], 1u);
    for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(x.controller.setpoint(x.now).q[i], before[i], lwr ? 1e-5 : 1e-9);
    EXPECT_EQ(x.controller.setpoint(x.now).tau[1], 0);
  }
}

TEST_P(FriSession, IgnoresValuesThatAreNotFinite) {
  const Protocol p = GetParam();
  Exchange x(controller_settings(p), client_settings(p));
  x.run_seconds(0.2);
  x.controller.request(true);
  x.run_seconds(0.05);
  // Our client sends the last finite value.
  x.wanted.q[1] = std::numeric_limits<double>::quiet_NaN();
  x.run_seconds(0.05);
  EXPECT_EQ(x.controller.state(), SessionState::kCommandingActive);
  EXPECT_EQ(x.controller.statistics().faults.total(), 0u);
  // Another client does not.
  Command command;
  command.joints = 7;
  command.fields = C::kPosition;
  command.counter = x.client.sent().counter + 1;
  command.reflected = x.client.sent().reflected + 1;
  command.q[1] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(x.controller.receive(testing::encoded(p, command), x.client_endpoint, x.now), Fault::kNotFinite);
  EXPECT_EQ(x.controller.statistics().faults.of(Fault::kNotFinite), 1u);
  EXPECT_EQ(x.controller.state(), SessionState::kCommandingActive);
}

// Beside positions: variables of the program, I/O values, transformations, poses.
TEST_P(FriSession, RefusesACommandAsAWholeIfAnyOfItsValuesIsNotFinite) {
  const Protocol p = GetParam();
  const double bad[] = {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()};
  const bool lwr = p == Protocol::kLwr, two = p >= Protocol::kSunrise2_5;
  const std::function<void(Command&, double)> spoil[] = {
      [&](Command& c, double x) { lwr ? void(c.krl.real[15] = static_cast<float>(x)) : void(c.q[6] = x); },
      [&](Command& c, double x) { lwr || p == Protocol::kSunrise1_11 ? void(c.q[0] = x) : void(c.ios.add()->analog = x); },
      [&](Command& c, double x) { lwr ? void(c.q[0] = x) : void(c.transformations.add()->pose.p[1] = x); },
      [&](Command& c, double x) { lwr ? void(c.q[0] = x) : void(c.transformations.add()->pose.p[1] = x); },
      [&](Command& c, double x) {
        if (!lwr && !two) return void(c.tau[6] = x);
        c.fields |= C::kPose;
        c.X.p[2] = x;
      },
      [&](Command& c, double x) {
        c.fields |= C::kWrench;
        c.F[5] = x;
      },
  };
  for (const auto& each : spoil) {
    for (const double value : bad) {
      Controller controller(controller_settings(p), "");
      controller.open(0);
      controller.cycle(0);
      Command command;
      command.joints = 7;
      command.fields = C::kPosition | C::kTorque;
      command.counter = 1;
      command.reflected = 1;
      Command spoilt = command;
      each(spoilt, value);
      for (Io& io : spoilt.ios.values) io.type = Io::Type::kAnalog;
      const auto index = &each - spoil;
      EXPECT_NE(controller.receive(testing::encoded(p, spoilt), {1, 1}, kMs / 2), Fault::kNone) << index;
      EXPECT_EQ(controller.statistics().faults.total(), 1u) << index;
      EXPECT_EQ(controller.statistics().commands.received(), 0u) << index << ": it counts as lost";
      EXPECT_EQ(controller.statistics().in_time, 0u) << index;
      EXPECT_EQ(controller.receive(testing::encoded(p, command), {1, 1}, kMs / 2), Fault::kNone);
    }
  }
}

TEST_P(FriSession, LetsNobodyTakeOverWhileTheRobotFollowsAClient) {
  const Protocol p = GetParam();
  ControllerSettings settings = controller_settings(p, 20 * kMs);
  settings.max_lost = 255;  // 5.1 s
  settings.rating.fair = 0;
  Exchange x(settings, client_settings(p));
  x.run_seconds(2.2);
  x.controller.request(true);
  x.run_seconds(0.3);
  ASSERT_EQ(x.controller.state(), SessionState::kCommandingActive);
  x.to_controller.loss = 1;
  x.run_seconds(1.5);
  ASSERT_EQ(x.controller.state(), SessionState::kCommandingActive);
  Command other;
  other.joints = 7;
  other.fields = C::kPosition;
  other.reflected = x.controller.robot().counter;
  const net::Endpoint stranger{0x0a000001, 30200};
  EXPECT_EQ(x.controller.receive(testing::encoded(p, other), stranger, x.now), Fault::kStranger);
  x.run_seconds(5);
  EXPECT_TRUE(is_monitoring(x.controller.state()));
  other.reflected = x.controller.robot().counter;
  EXPECT_EQ(x.controller.receive(testing::encoded(p, other), stranger, x.now), Fault::kNone);
}

TEST_P(FriSession, IgnoresAndCountsStrangersAndGarbage) {
  const Protocol p = GetParam();
  Exchange x(controller_settings(p), client_settings(p));
  x.run_seconds(0.05);
  const auto message = x.controller.cycle(x.now);
  const testing::Bytes bytes(message.begin(), message.end());
  const net::Endpoint stranger{0x0a000001, 30200}, other_port{0x7f000001, 4711};
  EXPECT_EQ(x.client.receive(bytes, stranger, x.now), Client::Reception::kRefused);
  EXPECT_EQ(x.client.statistics().faults.of(Fault::kStranger), 1u);
  EXPECT_EQ(x.controller.receive({}, stranger, x.now), Fault::kStranger);
  EXPECT_EQ(x.controller.receive({}, other_port, x.now), Fault::kStranger);
  EXPECT_EQ(x.controller.statistics().faults.of(Fault::kStranger), 2u);
  // A monitoring message is no command.
  EXPECT_NE(x.controller.receive(bytes, x.client_endpoint, x.now), Fault::kNone);
  const std::array<std::uint8_t, 3> noise{1, 2, 3};
  EXPECT_EQ(x.client.receive(noise, x.controller_endpoint, x.now), Client::Reception::kRefused);
  EXPECT_EQ(x.client.statistics().faults.total(), 2u);
  // After a second of silence another client may take over; with a given client nobody may.
  Command command;
  command.joints = 7;
  const testing::Bytes other = testing::encoded(p, command);
  EXPECT_EQ(x.controller.receive(other, stranger, x.now + 1001 * kMs), Fault::kNone);
  EXPECT_EQ(x.controller.client(), stranger);
  ControllerSettings settings = controller_settings(p);
  settings.client = x.client_endpoint;
  Controller strict(settings, "");
  strict.open(0);
  EXPECT_EQ(strict.receive(other, stranger, 0), Fault::kStranger);
  EXPECT_EQ(strict.receive(other, x.client_endpoint, 0), Fault::kNone);
}

// 70 s at 1 kHz: the 16 bits of LWR wrap, twice with the second half of the test's counters.
TEST_P(FriCounters, GoOnAfterTheyWrap) {
  const Protocol p = GetParam();
  ControllerSettings settings = controller_settings(p);
  Controller controller = make_controller(settings);
  Client client(client_settings(p), "");
  controller.open(0);
  for (std::int64_t k = 0; k < 70'000; ++k) {
    if (k == 200) controller.request(true);
    const std::int64_t t = k * kMs;
    ASSERT_EQ(client.receive(controller.cycle(t), {1, 1}, t), Client::Reception::kAnswerDue) << k;
    Command wanted;
    wanted.fields = C::kPosition;
    ASSERT_EQ(controller.receive(client.answer(wanted, t), {2, 2}, t), Fault::kNone) << k;
  }
  EXPECT_EQ(controller.state(), SessionState::kCommandingActive);
  EXPECT_EQ(controller.statistics().in_time, 70'000u);
  EXPECT_EQ(controller.statistics().commands.lost() + client.statistics().monitoring.lost(), 0u);
  EXPECT_EQ(client.statistics().unreflected, 0u);
  EXPECT_EQ(client.statistics().round_trip.count(),
            69'999u);  // the last is on its way
}

TEST(FriSunriseSession, AnswersEveryMessageOfTheReceiveMultiplier) {
  for (const Protocol p : {Protocol::kSunrise1_15, Protocol::kSunrise2_7}) {
    ControllerSettings settings = controller_settings(p, 2 * kMs);
    settings.receive_multiplier = 5;
    Exchange x(settings, client_settings(p));
    x.run_seconds(1.2);
    EXPECT_EQ(x.controller.quality(), Quality::kExcellent);
    x.controller.request(true);
    SineOverlay sine;
    x.want = [&] { sine(x); };
    double error = 0;
    x.observe = [&] {
      if (!x.controller.setpoint(x.now).active || sine.began < 0) return;
      const double t = static_cast<double>(x.now) * 1e-9 - sine.began;
      error = std::max(error, std::abs(x.controller.setpoint(x.now).q[1] - 0.1 * std::sin(kPi * t)));
    };
    x.run_seconds(5);
    EXPECT_EQ(x.controller.state(), SessionState::kCommandingActive);
    EXPECT_LE(x.client.statistics().answers, x.client.statistics().monitoring.received() / 5 + 1);
    EXPECT_EQ(x.controller.statistics().missing, 0u);
    EXPECT_LT(error, 0.315 * 2.2 * 0.010);
    EXPECT_EQ(x.controller.statistics().bridged, 0u);
  }
}

TEST(FriSunriseSession, HasIoValuesAndTransformations) {
  const Protocol p = Protocol::kSunrise2_5;
  Exchange x(controller_settings(p), client_settings(p));
  Io input;
  input.name.assign("Gripper.Closed");
  input.digital = 1;
  *x.controller.robot().ios.add() = input;
  Io output;
  output.name.assign("Gripper.Force");
  output.type = Io::Type::kAnalog;
  output.direction = Io::Direction::kOutput;
  output.analog = 12.5;
  *x.wanted.ios.add() = output;
  Transformation base;
  base.name.assign("DynamicFrame");
  base.pose.p << 0.1, 0.2, 0.3;
  *x.wanted.transformations.add() = base;
  x.run_seconds(0.02);
  ASSERT_EQ(x.client.monitoring().ios.count, 1u);
  EXPECT_EQ(x.client.monitoring().ios.values[0], input);
  ASSERT_EQ(x.controller.command().ios.count, 1u);
  EXPECT_EQ(x.controller.command().ios.values[0], output);
  ASSERT_EQ(x.controller.command().transformations.count, 1u);
  EXPECT_NEAR((x.controller.command().transformations.values[0].pose.p - base.pose.p).norm(), 0, 1e-15);
}

TEST(FriLwrSession, HasVariablesOfTheProgramAndImpedances) {
  const Protocol p = Protocol::kLwr;
  ControllerSettings settings = controller_settings(p);
  settings.control = ControlMode::kJointImpedance;
  Exchange x(settings, client_settings(p));
  x.controller.robot().krl.integer[3] = 42;
  x.wanted.krl.real[0] = 0.5f;
  x.wanted.krl.boolean = 0x8000;
  x.wanted.fields = C::kPosition | C::kJointStiffness | C::kJointDamping | C::kTorque;
  x.wanted.joint_stiffness.fill(250);
  x.wanted.joint_damping.fill(0.7);
  x.wanted.tau[4] = 3;
  x.run_seconds(0.2);
  EXPECT_EQ(x.client.monitoring().krl.integer[3], 42);
  EXPECT_EQ(x.client.monitoring().control, ControlMode::kJointImpedance);
  EXPECT_EQ(x.controller.command().krl, x.wanted.krl);
  EXPECT_EQ(x.controller.command().tau[4], 0);  // monitoring: no torque
  EXPECT_EQ(x.controller.setpoint(x.now).fields, 0u);
  x.controller.request(true);
  x.run_seconds(0.05);
  const Setpoint& s = x.controller.setpoint(x.now);
  ASSERT_TRUE(s.active);
  EXPECT_EQ(s.fields, x.wanted.fields);
  EXPECT_EQ(s.tau[4], 3);
  EXPECT_EQ(s.joint_stiffness[6], 250);
  EXPECT_NEAR(s.joint_damping[6], 0.7, 1e-7);
  // Our client keeps the set of quantities in CMD; from another one it is a fault.
  x.wanted.fields = C::kPosition;
  x.run_seconds(0.05);
  EXPECT_EQ(x.controller.state(), SessionState::kCommandingActive);
  Command other = x.client.sent();
  other.fields = C::kPosition;
  ++other.counter;
  other.reflected = x.client.monitoring().counter;
  x.controller.cycle(x.now);
  other.reflected = (other.reflected + 1) & 0xffff;
  x.controller.receive(testing::encoded(p, other), x.client_endpoint, x.now);
  EXPECT_EQ(x.controller.drop(), Drop::kFields);
}

// What a command does not claim to have may be anything.
TEST(FriLwrSession, IgnoresTheQuantitiesWithoutAFlag) {
  const Protocol p = Protocol::kLwr;
  Controller c(controller_settings(p), "");
  c.open(0);
  c.request(true);
  for (std::int64_t k = 0; k < 200; ++k) {
    c.cycle(k * kMs);
    Command command;
    command.joints = 7;
    command.fields = C::kPosition;
    command.tau.fill(std::numeric_limits<double>::quiet_NaN());
    command.F.fill(std::numeric_limits<double>::infinity());
    command.counter = static_cast<std::uint32_t>(k);
    command.reflected = c.robot().counter;
    ASSERT_EQ(c.receive(testing::encoded(p, command), {1, 1}, k * kMs), Fault::kNone);
  }
  const Setpoint& s = c.setpoint(200 * kMs);
  ASSERT_TRUE(s.active);
  EXPECT_EQ(s.tau[3], 0);
  EXPECT_EQ(s.F[3], 0);
}

TEST(FriLwrSession, BeginsNoCommandsWhileTheClientDoesNotMirror) {
  Exchange x(controller_settings(Protocol::kLwr), client_settings(Protocol::kLwr));
  x.program = [](double, Joints& q) { q.fill(0.5); };
  x.run_seconds(0.05);
  Controller& c = x.controller;
  c.request(true);
  for (std::int64_t k = 0; k < 300; ++k, x.now += kMs) {  // another client, with a position of its own
    c.cycle(x.now);
    Command command;
    command.joints = 7;
    command.fields = C::kPosition;
    command.q.fill(0.55);
    command.counter = static_cast<std::uint32_t>(1000 + k);
    command.reflected = c.robot().counter;
    c.receive(testing::encoded(Protocol::kLwr, command), x.client_endpoint, x.now);
  }
  EXPECT_EQ(c.quality(), Quality::kExcellent);
  EXPECT_EQ(c.state(), SessionState::kMonitoringReady);
  x.wanted.q.fill(0.5);
  x.run_seconds(0.05);  // ours mirrors
  EXPECT_EQ(c.state(), SessionState::kCommandingActive);
}

TEST_P(FriSession, GoesOnWithAClientThatWasStartedAnew) {
  const Protocol p = GetParam();
  Exchange x(controller_settings(p), client_settings(p));
  for (const double seconds : {0.05, 0.5, 0.3}) {  // few and many messages before
    x.run_seconds(seconds);
    x.client = Client(client_settings(p), "again");
    x.run_seconds(0.2);
    EXPECT_EQ(x.controller.quality(), Quality::kExcellent) << seconds;
  }
  // And the client with a controller that was started anew.
  x.controller = make_controller(controller_settings(p));
  x.controller.open(x.now);
  x.run_seconds(0.2);
  EXPECT_EQ(x.controller.quality(), Quality::kExcellent);
}

TEST_P(FriSession, LimitsTheSpeedOfTheClientsCommands) {
  const Protocol p = GetParam();
  ClientSettings settings = client_settings(p);
  settings.speed_limit.assign(7, 1.0);
  Exchange x(controller_settings(p), settings, 3);
  x.to_client.loss = 0.03;
  x.wanted.q.fill(0.5);  // far away: a step of 0.5 rad would be refused
  x.run_seconds(0.3);
  x.controller.request(true);
  x.run_seconds(0.45);
  const double q = x.controller.setpoint(x.now).q[0];
  EXPECT_GT(q, 0.3);
  EXPECT_LT(q, 0.45);
  x.run_seconds(0.3);
  EXPECT_EQ(x.controller.drop(), Drop::kNone);
  EXPECT_NEAR(x.controller.setpoint(x.now).q[0], 0.5, 1e-6);
}

TEST_P(FriSession, AllocatesNothing) {
  const Protocol p = GetParam();
  Controller controller = make_controller(controller_settings(p));
  Client client(client_settings(p), "");
  Command wanted;
  wanted.fields = C::kPosition;
  std::uint64_t before = 0;
  controller.open(0);
  std::array<std::uint8_t, kMaxDatagram> noise{};
  for (std::int64_t k = 0; k < 400; ++k) {
    if (k == 2) before = testing::allocations();
    if (k == 200) controller.request(true);
    const std::int64_t t = k * kMs;
    const auto message = controller.cycle(t);
    if (k % 7 != 3 && client.receive(message, {1, 1}, t) == Client::Reception::kAnswerDue) {
      controller.receive(client.answer(wanted, t), {2, 2}, t);
    }
    if (k % 50 == 0) controller.receive(noise, {2, 2}, t);
    controller.setpoint(t + 500'000);
    if (k == 300) controller.request(false);
  }
  EXPECT_EQ(testing::allocations(), before);
}

TEST(FriController, SaysWhichSettingIsWrong) {
  ControllerSettings s = controller_settings(Protocol::kSunrise1_15);
  const auto error = [&] { return testing::error_of([&] { Controller(s, "io"); }); };
  EXPECT_EQ(error(), "");
  s.speed_limit.resize(6);
  EXPECT_EQ(error(), "io: speed_limit has 6 values, expected 7, one per joint");
  s = controller_settings(Protocol::kSunrise1_15, 2'500'000);
  EXPECT_EQ(error(), "io: send_period is 2500000 ns, expected whole milliseconds for Sunrise");
  s = controller_settings(Protocol::kLwr, 101 * kMs);
  EXPECT_EQ(error(), "io: send_period in ms is 101, expected 1 to 100");
  s = controller_settings(Protocol::kLwr);
  s.receive_multiplier = 2;
  EXPECT_EQ(error(), "io: receive_multiplier is 2, expected 1 to 1");
  s = controller_settings(Protocol::kLwr);
  s.rating.good = 0.7;
  EXPECT_EQ(error(), "io: rating.fair is 0.75, expected 0 to 0.7");
  s.rating.good = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(error(), "io: rating.good is nan, expected 0 to 0.99");
  s = controller_settings(Protocol::kSunrise1_16);
  s.command_mode = ClientCommandMode::kCartesianPose;
  EXPECT_EQ(error(),
            "io: the client has to command poses with protocol sunrise-1.16, expected sunrise-2.5 or -2.7: messages of older "
            "versions have no poses");
  s = controller_settings(Protocol::kLwr);
  s.torque_limit[2] = -1;
  EXPECT_THAT(error(), ::testing::HasSubstr("torque_limit is -1, expected 0 to"));
  ClientSettings c = client_settings(Protocol::kLwr);
  c.joints = 6;
  EXPECT_EQ(testing::error_of([&] { Client(c, "io"); }), "io: protocol lwr with 6 joints, expected 7");
}

// LWR with Cartesian impedance: poses, stiffness, damping and a force in place of joint positions.
TEST(FriLwrSession, CommandsPosesInCartesianImpedance) {
  const Protocol p = Protocol::kLwr;
  ControllerSettings settings = controller_settings(p, 4 * kMs);
  settings.control = ControlMode::kCartesianImpedance;
  Exchange x(settings, client_settings(p));
  M& robot = x.controller.robot();
  robot.fields |= M::kInterpolatorPose | M::kCommandedPose | M::kMeasuredPose;
  robot.X_commanded = {rotation_from_rpy(3.0, 0.1, -0.2), {0.5, 0.1, 0.4}};
  robot.X_interpolator = robot.X_commanded;
  x.wanted.fields = C::kPose | C::kCartesianStiffness | C::kCartesianDamping | C::kWrench;
  x.wanted.X = robot.X_commanded;
  x.wanted.cartesian_stiffness << 2000, 1500, 1000, 300, 200, 100;
  x.wanted.F << 0, 0, -10, 0.5, 0, 0;
  x.run_seconds(0.6);
  EXPECT_EQ(x.controller.setpoint(x.now).F, Wrench(Wrench::Zero()));
  x.controller.request(true);
  x.run_seconds(0.1);
  ASSERT_EQ(x.controller.state(), SessionState::kCommandingActive);
  const Setpoint& s = x.controller.setpoint(x.now);
  EXPECT_EQ(s.fields, x.wanted.fields);
  EXPECT_EQ(s.F, x.wanted.F);
  EXPECT_EQ(s.cartesian_stiffness, x.wanted.cartesian_stiffness);
  EXPECT_LT((s.X.p - robot.X_commanded.p).norm(), 1e-6);
  EXPECT_LT((s.X.R - robot.X_commanded.R).norm(), 1e-6);
  // 0.5 m/s, finely interpolated: no step between two samples of 50 µs is longer than the way of that time.
  Eigen::Vector3d before = s.X.p;
  double longest = 0;
  x.want = [&] { x.wanted.X.p.y() += 0.5 * 4e-3; };
  x.observe = [&] {
    const Eigen::Vector3d now = x.controller.setpoint(x.now).X.p;
    longest = std::max(longest, (now - before).norm());
    before = now;
  };
  x.run_seconds(0.2);
  EXPECT_EQ(x.controller.state(), SessionState::kCommandingActive);
  EXPECT_NEAR(before.y(), 0.1 + 0.5 * 0.2 - 0.5 * 1.5 * 4e-3, 0.5 * 4e-3);
  EXPECT_LT(longest, 0.5 * 50e-6 + 2e-7);
  // What is no rotation is not taken; the motion is continued, and stopped.
  x.want = [&] { x.wanted.X.R.setZero(); };
  x.run_seconds(0.4);
  EXPECT_GT(x.controller.statistics().faults.of(Fault::kValue), 5u);
  EXPECT_EQ(x.controller.drop(), Drop::kLost);
  EXPECT_LT(longest, 0.5 * 50e-6 + 2e-7);
}

// A Cartesian pose of 2.x in place of joint positions.
TEST(FriSunriseSession, CommandsPoses) {
  const Protocol p = Protocol::kSunrise2_7;
  ControllerSettings settings = controller_settings(p);
  settings.command_mode = ClientCommandMode::kCartesianPose;
  settings.overlay = OverlayType::kCartesian;
  Exchange x(settings, client_settings(p));
  M& robot = x.controller.robot();
  robot.fields |= M::kInterpolatorPose | M::kInterpolatorRedundancy | M::kMeasuredPose;
  robot.X_interpolator.p << 0.5, 0, 0.4;
  robot.redundancy_interpolator = {0, 0.25};
  x.wanted.fields = C::kPose;
  x.wanted.X = robot.X_interpolator;
  x.run_seconds(0.2);
  x.controller.request(true);
  x.run_seconds(0.1);
  ASSERT_EQ(x.controller.state(), SessionState::kCommandingActive);
  EXPECT_FALSE(x.client.sent().has(C::kPosition));
  EXPECT_EQ(x.controller.command().redundancy.value, 0.25);
  x.want = [&] { x.wanted.X.p.z() += 1e-3; };  // 1 m/s
  x.run_seconds(0.1);
  ASSERT_EQ(x.controller.state(), SessionState::kCommandingActive);
  EXPECT_NEAR(x.controller.setpoint(x.now).X.p.z(), 0.5, 3e-3);
  x.want = [&] { x.wanted.X.p.z() += 5e-3; };  // 5 m/s
  x.run_seconds(0.1);
  EXPECT_EQ(x.controller.drop(), Drop::kSpeed);
}

}  // namespace
}  // namespace cotwin::session_test
