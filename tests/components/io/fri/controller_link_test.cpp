// The emulated controller as a unit, with a client of bytes at a socket: components/io/emulators/fri_controller_link.h.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "components/io/emulators/kuka/controller.h"
#include "components/io/link/datagram_queue.h"
#include "components/io/link/robot_kinematics.h"
#include "components/unit/unit_table.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::io::controller_link_test {
namespace {

using fri::Protocol;
using ::testing::Contains;
using ::testing::HasSubstr;
using C = fri::Command;
namespace fs = std::filesystem;

constexpr std::int64_t kPatience = 20'000'000'000;  // ns
constexpr std::array<double, 7> kStart{0.1, 0.4, 0.2, -1.2, -0.1, 0.8, 0.3};

fs::path models() { return fs::path(places::source()) / "models"; }

robot::RobotModel lwr4() { return robot::load_urdf(models() / "robots/lwr4/robot.urdf"); }

/// A controller whose robot follows its commands at once, and a client that answers each message.
struct Controlled {
  explicit Controlled(Protocol p, const std::string& settings = "", const std::string& robot = "robot=lwr4")
      : protocol(p),
        instance(make_unit("unit:io?" + robot + "&link=fri_controller&protocol=" + fri::to_text(p) + settings, {}, {models()},
                           unit_types())),
        socket(net::Endpoint{0x7f000001, 0}, "test") {
    set("address", "127.0.0.1");
    set("port", "0");
    set("period", "0.002");
    set("window", "20");
    set("client", net::to_text(socket.local()));
    q.assign(kStart.begin(), kStart.end());
  }

  void set(const std::string& name, const std::string& value) { assign_text(instance.variables.at(name), value); }
  std::span<double> reals(const std::string& name) { return instance.variables.at(name).reals(); }
  int integer(const std::string& name) { return instance.variables.at(name).integers()[0]; }
  bool boolean(const std::string& name) { return instance.variables.at(name).booleans()[0]; }
  DatagramQueue& datagrams() { return *static_cast<DatagramQueue*>(instance.unit->tick_source()); }
  std::vector<std::string> sentences() {
    std::vector<std::string> all;
    instance.unit->append_notes(all);
    return all;
  }

  void start() {
    std::ranges::copy(q, reals("q").begin());
    instance.unit->initialise(Time{});
  }

  /// Waits for a datagram of the controller.
  bool hear() {
    std::array<std::uint8_t, 2048> bytes{};
    for (const std::int64_t deadline = monotonic_now() + kPatience; monotonic_now() < deadline;) {
      const auto received = socket.receive(bytes);
      if (!received) continue;
      from = received->from;
      return fri::decode(protocol, std::span(bytes).first(received->size), 7, message) == fri::Fault::kNone;
    }
    return false;
  }

  /// What KUKA's clients send by themselves, and what `want` changes.
  void answer() {
    command.joints = 7;
    command.reflected = message.counter;
    ++command.counter;
    const bool poses = message.has(fri::Monitoring::kCommandMode) &&
                       message.command_mode == fri::ClientCommandMode::kCartesianPose && fri::is_commanding(message.state);
    command.q = fri::is_commanding(message.state) && protocol != Protocol::kLwr ? message.q_interpolator : message.q_commanded;
    command.X = protocol == Protocol::kLwr ? message.X_commanded : message.X_interpolator;
    if (protocol != Protocol::kLwr) command.fields = poses ? C::kPose : C::kPosition;
    if (want) want();
    std::array<std::uint8_t, fri::kMaxDatagram> bytes{};
    send(std::span(bytes).first(fri::encode(protocol, command, bytes)));
  }
  void send(std::span<const std::uint8_t> bytes) { ASSERT_TRUE(socket.send(bytes, from)); }

  void period(bool answers = true) {
    std::ranges::copy(q, reals("q").begin());
    ASSERT_EQ(instance.unit->step(Time{n++ * h.ns}, h), StepResult::kDone);
    std::ranges::copy(reals("q_command"), q.begin());
    ASSERT_TRUE(hear());
    const std::size_t before = datagrams().waiting();
    if (!answers) return;
    answer();
    for (const std::int64_t deadline = monotonic_now() + kPatience; monotonic_now() < deadline;) {
      if (datagrams().waiting() > before) return;
    }
    FAIL() << "the answer has not come";
  }
  void periods(int count) {
    for (int k = 0; k < count && !::testing::Test::HasFatalFailure(); ++k) period();
  }
  bool commanding() {
    for (int k = 0; k < 200 && !boolean("active") && !::testing::Test::HasFatalFailure(); ++k) period();
    return boolean("active");
  }

  Protocol protocol;
  Instance instance;
  net::UdpSocket socket;
  net::Endpoint from;
  fri::Monitoring message;
  fri::Command command;
  std::function<void()> want;
  std::vector<double> q;
  Duration h{2'000'000};
  std::int64_t n = 0;
};

/// A port at which a client binds all addresses, as KUKA's do.
struct AnyAddressClient {
  AnyAddressClient() : socket(net::UdpSocket(net::Endpoint{}, "test")), port(socket->local().port) {}
  void restart() {
    socket.reset();
    socket.emplace(net::Endpoint{0, port}, "test");
  }
  std::optional<net::UdpSocket> socket;
  std::uint16_t port;
};

// KUKA's clients bind port 30200 of all addresses, which is free only while no other program has it at any address.
TEST(FriControllerLink, LeavesItsPortToClientsThatStartLateAndAgain) {
  for (const Protocol p : fri::kProtocols) {
    Instance robot = make_unit("unit:io?robot=lwr4&link=fri_controller&protocol=" + std::string(fri::to_text(p)), {},
                               {models()}, unit_types());
    AnyAddressClient client;
    client.socket.reset();
    assign_text(robot.variables.at("client"), "127.0.0.1:" + std::to_string(client.port));
    for (int starts = 0; starts < 2; ++starts) {
      robot.unit->initialise(Time{});
      const net::Endpoint local = static_cast<DatagramQueue*>(robot.unit->tick_source())->local();
      EXPECT_TRUE(local.is_loopback());
      EXPECT_NE(local.port, 30200) << fri::to_text(p);
      for (int times = 0; times < 2; ++times) {
        ASSERT_NO_THROW(client.restart()) << fri::to_text(p);
        ASSERT_EQ(robot.unit->step(Time{}, Duration{5'000'000}), StepResult::kDone);
        std::array<std::uint8_t, 2048> bytes{};
        std::optional<net::UdpSocket::Received> received;
        for (const std::int64_t end = monotonic_now() + kPatience; !received && monotonic_now() < end;)
          received = client.socket->receive(bytes);
        ASSERT_TRUE(received);
        EXPECT_EQ(received->from, local) << "where the client answers";
        robot.unit->initialise(Time{});
      }
      client.socket.reset();
    }
  }
}

TEST(FriControllerLink, SendsFromThePortThatItIsGiven) {
  Controlled c(Protocol::kSunrise1_15);
  c.set("address", "127.0.0.2");
  const AnyAddressClient free;
  const std::uint16_t port = free.port;
  c.set("port", std::to_string(port));
  EXPECT_THAT(testing::error_of([&] { c.start(); }), HasSubstr("UDP socket at 127.0.0.2:" + std::to_string(port)));
}

TEST(FriControllerLink, TellsAClientThatIsConnectedWhereMessagesComeFrom) {
  Controlled c(Protocol::kSunrise1_15);
  c.set("port", "-1");
  c.start();
  EXPECT_THAT(c.sentences(), Contains(HasSubstr("accepts messages from that address and port only")));
}

TEST(FriControllerLink, KeepsTheClientsAnswerInAFloodOfStrangers) {
  Controlled c(Protocol::kSunrise1_15);
  c.start();
  net::UdpSocket stranger(net::Endpoint{0x7f000001, 0}, "test");
  const std::vector<std::uint8_t> noise(20, 0x55);
  for (int k = 0; k < 50; ++k) {
    c.period();
    ASSERT_FALSE(HasFatalFailure());
    for (int i = 0; i < 150; ++i) stranger.send(noise, c.from);  // more than the queue has places, less than the socket has
  }
  c.period();
  EXPECT_EQ(c.integer("in_time"), 50);
  EXPECT_EQ(c.integer("strangers"), 50 * 150);
  EXPECT_EQ(c.integer("rejected"), 50 * 150);
  EXPECT_EQ(c.integer("displaced"), 0);
  EXPECT_THAT(c.sentences(), Contains("7500 datagrams of other senders ignored"));
}

TEST(FriControllerLink, CountsAnswersThatItCouldNotKeep) {
  Controlled c(Protocol::kSunrise1_15);
  c.start();
  c.period();
  for (int i = 0; i < 100; ++i) c.answer();  // one has come already
  c.period();
  EXPECT_EQ(c.integer("displaced"), 101 - 64);
}

TEST(FriControllerLink, ItsClockStopsWaitingAtTheDeadlineInAFlood) {
  Controlled c(Protocol::kSunrise1_15);
  c.start();
  c.period();
  std::atomic<bool> ends{false};
  std::thread flood([&, to = c.from] {
    net::UdpSocket stranger(net::Endpoint{0x7f000001, 0}, "test");
    const std::vector<std::uint8_t> noise(8, 0x55);
    while (!ends) stranger.send(noise, to);
  });
  std::optional<Arrival> arrival = c.datagrams().wait(monotonic_now() + 1'000'000);  // the answer
  for (int k = 0; k < 5 && arrival; ++k) arrival = c.datagrams().wait(monotonic_now() + 1'000'000);
  EXPECT_FALSE(arrival);
  ends = true;
  flood.join();
}

// Two units in lock step would wait for each other for ever when one datagram is lost.
TEST(FriControllerLink, RepeatsItsLastMessageWhileItsClockWaits) {
  for (const Protocol p : {Protocol::kLwr, Protocol::kSunrise2_7}) {
    Controlled c(p);
    c.command.fields = C::kPosition;
    c.start();
    // Before the first step the first message, and again until it is answered.
    EXPECT_FALSE(c.datagrams().wait(monotonic_now() + 70'000'000));
    ASSERT_TRUE(c.hear());
    const std::uint32_t first = c.message.counter;
    ASSERT_TRUE(c.hear());
    EXPECT_EQ(c.message.counter, first);
    c.answer();
    for (std::optional<Arrival> arrival; !arrival;) arrival = c.datagrams().wait(monotonic_now() + 10'000'000);
    ASSERT_EQ(c.instance.unit->step(Time{}, c.h), StepResult::kDone);
    while (c.message.counter == first) {
      ASSERT_TRUE(c.hear());
    }
    const std::uint32_t second = c.message.counter;
    EXPECT_FALSE(c.datagrams().wait(monotonic_now() + 50'000'000));
    ASSERT_TRUE(c.hear());
    EXPECT_EQ(c.message.counter, second) << "the same message, which a client recognises as a duplicate";
    c.answer();
    for (std::optional<Arrival> arrival; !arrival;) arrival = c.datagrams().wait(monotonic_now() + 10'000'000);
    ASSERT_EQ(c.instance.unit->step(Time{c.h.ns}, c.h), StepResult::kDone);
    EXPECT_EQ(c.integer("sent"), 3) << "repetitions are not counted";
  }
}

// In step, a session that is closed and opened again goes on with the answer to its first message, one period after the last tick.
TEST(FriControllerLink, GoesOnInStepAfterItsSessionWasClosed) {
  for (const Protocol p : {Protocol::kLwr, Protocol::kSunrise2_7}) {
    Controlled c(p);
    c.command.fields = C::kPosition;
    c.datagrams().set_waits(true);
    c.start();
    const auto next = [&] {
      std::optional<Arrival> arrival;
      for (const std::int64_t end = monotonic_now() + kPatience; !arrival && monotonic_now() < end;) {
        arrival = c.datagrams().wait(monotonic_now() + 10'000'000);
      }
      return arrival;
    };
    c.periods(5);
    std::optional<Arrival> last = next();
    ASSERT_TRUE(last);
    c.set("open", "false");
    for (int k = 0; k < 50; ++k) {
      const std::optional<Arrival> arrival = next();
      ASSERT_TRUE(arrival);
      EXPECT_EQ(arrival->source - last->source, c.h.ns);
      last = arrival;
      ASSERT_EQ(c.instance.unit->step(Time{c.n++ * c.h.ns}, c.h), StepResult::kDone);
    }
    while (c.message.counter < 6 && p != Protocol::kLwr && c.hear()) {  // that with IDLE
    }
    const std::uint32_t before = c.message.counter;
    c.set("open", "true");
    EXPECT_FALSE(c.datagrams().wait(monotonic_now() + 30'000'000)) << "it waits for the client";
    while (c.message.counter == before && c.hear()) {
    }
    c.answer();
    const std::optional<Arrival> arrival = next();
    ASSERT_TRUE(arrival);
    EXPECT_EQ(arrival->source - last->source, c.h.ns);
  }
}

TEST(FriControllerLink, IsOnTheWallClockWhileItsSessionIsClosedAndNothingWaits) {
  Controlled c(Protocol::kLwr);
  c.start();
  c.set("open", "false");
  const std::int64_t begin = monotonic_now();
  for (int ticks = 0; ticks < 10;) ticks += c.datagrams().wait(monotonic_now() + 50'000'000) ? 1 : 0;
  EXPECT_GE(monotonic_now() - begin, 8 * c.h.ns);
}

TEST(FriControllerLink, RefusesAMultiplierInStep) {
  Controlled c(Protocol::kSunrise1_15);
  c.set("receive_multiplier", "2");
  c.start();
  EXPECT_THAT(testing::error_of([&] { c.datagrams().set_waits(true); }), HasSubstr("expected 1, or another clock"));
  c.datagrams().set_waits(false);
}

TEST(FriControllerLink, RefusesStiffnessAndDampingOutOfRange) {
  struct Case {
    std::uint32_t fields;
    std::function<void(fri::Command&)> spoil;
  };
  const double kNan = std::numeric_limits<double>::quiet_NaN();
  const Case refused[] = {
      {C::kJointStiffness, [](fri::Command& c) { c.joint_stiffness[3] = -1; }},
      {C::kJointStiffness, [](fri::Command& c) { c.joint_stiffness[3] = 1e30; }},
      {C::kJointStiffness, [](fri::Command& c) { c.joint_stiffness[6] = 5001; }},
      {C::kJointDamping, [](fri::Command& c) { c.joint_damping[0] = -0.01; }},
      {C::kJointDamping, [](fri::Command& c) { c.joint_damping[0] = 1.01; }},
      {C::kCartesianStiffness, [](fri::Command& c) { c.cartesian_stiffness[5] = 301; }},
      {C::kCartesianStiffness, [](fri::Command& c) { c.cartesian_stiffness[1] = -1; }},
      {C::kCartesianDamping, [](fri::Command& c) { c.cartesian_damping[2] = 2; }},
  };
  for (const Case& each : refused) {
    Controlled c(Protocol::kLwr);
    c.command.fields = C::kPosition | each.fields;
    c.command.joint_stiffness.fill(0);  // of clients that control torques themselves
    c.command.joint_damping.fill(0);
    c.start();
    ASSERT_TRUE(c.commanding());
    c.periods(5);
    EXPECT_EQ(c.integer("drops"), 0);
    c.want = [&] { each.spoil(c.command); };
    c.periods(3);
    EXPECT_FALSE(c.boolean("active"));
    EXPECT_EQ(c.integer("drop"), static_cast<int>(fri::Drop::kStiffness)) << &each - refused;
    EXPECT_THAT(c.sentences(), Contains(HasSubstr("because of stiffness")));
    for (const double S : c.reals("stiffness_command")) EXPECT_EQ(S, 1000) << "the program's again";
  }
  // What is not a number is refused as a whole and bridged as a lost command.
  Controlled c(Protocol::kLwr);
  c.set("window", "100");
  c.command.fields = C::kPosition | C::kJointStiffness;
  c.command.joint_stiffness.fill(500);
  c.start();
  ASSERT_TRUE(c.commanding());
  c.want = [&] { c.command.joint_stiffness[2] = kNan; };
  c.periods(5);
  EXPECT_TRUE(c.boolean("active"));
  EXPECT_EQ(c.reals("stiffness_command")[2], 500);
  EXPECT_EQ(c.integer("last_fault"), static_cast<int>(fri::Fault::kNotFinite));
  EXPECT_GE(c.integer("bridged"), 3);
  c.periods(10);
  EXPECT_EQ(c.integer("drop"), static_cast<int>(fri::Drop::kLost));
}

TEST(FriControllerLink, LimitsTorquesAndWrenchesByTheEffortOfTheUrdf) {
  const robot::RobotModel robot = lwr4();
  {
    Controlled c(Protocol::kSunrise1_15);
    c.set("client_mode", "torque");
    c.start();
    double tau = 37;
    c.want = [&] {
      c.command.fields |= C::kTorque;
      c.command.tau.fill(0);
      c.command.tau[6] = tau;  // joint 7: 38 N.m
    };
    ASSERT_TRUE(c.commanding());
    c.periods(5);
    EXPECT_EQ(c.reals("tau_command")[6], 37);
    tau = 39;
    c.periods(3);
    EXPECT_EQ(c.integer("drop"), static_cast<int>(fri::Drop::kTorque));
  }
  for (const double force : {500.0, 1e300}) {
    Controlled c(Protocol::kSunrise1_15);
    c.set("client_mode", "wrench");
    c.start();
    double F = 10;
    c.want = [&] {
      c.command.fields |= C::kWrench;
      c.command.F << 0, 0, F, 0, 0, 0;
    };
    ASSERT_TRUE(c.commanding());
    c.periods(5);
    EXPECT_EQ(c.reals("F_command")[2], 10);
    F = force;
    c.periods(3);
    // 500 N at more than 0.4 m is more than the 176 N.m of joint 2.
    EXPECT_EQ(c.integer("drop"), static_cast<int>(fri::Drop::kTorque)) << force;
    for (const double each : c.reals("tau_command")) EXPECT_TRUE(std::isfinite(each));
  }
  Controlled c(Protocol::kSunrise1_15);
  c.set("client_mode", "wrench");
  c.set("moment_max", "3");
  c.start();
  c.want = [&] {
    c.command.fields |= C::kWrench;
    c.command.F << 0, 0, 0, 0, 0, c.message.state == fri::SessionState::kCommandingActive ? 3.1 : 0.0;
  };
  c.periods(60);
  EXPECT_EQ(c.integer("drop"), static_cast<int>(fri::Drop::kTorque));
}

Pose pose_of(std::span<const double> q) {
  static const robot::RobotModel robot = lwr4();
  RobotKinematics k(robot);
  return k.pose(q);
}

double distance(const Pose& a, const Pose& b) {
  return std::max((a.p - b.p).norm(), Eigen::AngleAxisd(Eigen::Matrix3d(a.R.transpose() * b.R)).angle());
}

class FriPoses : public ::testing::TestWithParam<Protocol> {};
INSTANTIATE_TEST_SUITE_P(Protocols, FriPoses, ::testing::Values(Protocol::kLwr, Protocol::kSunrise2_5, Protocol::kSunrise2_7));

TEST_P(FriPoses, AreExecutedByTheRobotAndStopAndBeginWithoutAStep) {
  const Protocol p = GetParam();
  const bool lwr = p == Protocol::kLwr;
  Controlled c(p);
  c.set(lwr ? "control" : "client_mode", lwr ? "cartesian_impedance" : "pose");
  c.set("restart", "0.2");
  c.command.fields = C::kPose;
  c.start();
  const Pose start = pose_of(kStart);
  double t = -1, jump = 0;
  std::vector<Pose> wanted;
  c.want = [&] {
    if (c.message.state != fri::SessionState::kCommandingActive) return;
    if (t < 0) t = 0;
    // A circle of 5 cm that begins at rest, with a turn about an inclined axis; relative to where commanding began.
    static Pose origin;
    if (t == 0) origin = c.command.X;
    const double s = 0.5 - 0.5 * std::cos(std::min(3.0 * t, 3.14159265));
    c.command.X.p = origin.p + Eigen::Vector3d(0.05 * std::sin(6 * s), 0.05 * (1 - std::cos(6 * s)) + jump, 0.03 * s);
    c.command.X.R = origin.R * Eigen::AngleAxisd(0.4 * s, Eigen::Vector3d(1, 2, 2) / 3).toRotationMatrix();
    wanted.push_back(c.command.X);
    t += c.h.seconds();
  };
  ASSERT_TRUE(c.commanding());
  double largest = 0;
  std::vector<double> before = c.q;
  for (int k = 0; k < 600; ++k) {
    c.period();
    ASSERT_FALSE(HasFatalFailure());
    for (std::size_t i = 0; i < 7; ++i) largest = std::max(largest, std::abs(c.q[i] - before[i]));
    before = c.q;
    // q holds the answer to the message before the last one.
    if (wanted.size() > 3) {
      ASSERT_LT(distance(pose_of(c.q), wanted[wanted.size() - 3]), 2.5e-3);
    }
  }
  EXPECT_TRUE(c.boolean("active")) << c.integer("drop");
  c.periods(3);
  EXPECT_LT(distance(pose_of(c.q), wanted.back()), lwr ? 1e-6 : 1e-8) << "at rest at the end of the way";
  EXPECT_GT(distance(pose_of(c.q), start), 0.02);
  EXPECT_LT(largest, 3.142 * c.h.seconds());
  EXPECT_GT(largest, 1e-4);
  // A jump ends commanding; the robot rests where it is, and goes on from there when its program asks again.
  jump = 0.3;
  c.periods(3);
  EXPECT_EQ(c.integer("drop"), static_cast<int>(fri::Drop::kSpeed));
  const Pose rest = pose_of(c.q);
  jump = 0;
  t = -1;
  largest = 0;
  before = c.q;
  int until = 0;
  while (!c.boolean("active") && until++ < 600) {
    c.period();
    ASSERT_FALSE(HasFatalFailure());
    EXPECT_LT(distance(pose_of(c.q), rest), 1e-6);
  }
  for (int k = 0; k < 20; ++k) {
    c.period();
    for (std::size_t i = 0; i < 7; ++i) largest = std::max(largest, std::abs(c.q[i] - before[i]));
    before = c.q;
  }
  EXPECT_TRUE(c.boolean("active"));
  EXPECT_EQ(c.integer("drops"), 1);
  EXPECT_LT(largest, 1e-3) << "from the place where it rested";
}

TEST(FriControllerLink, ExecutesTheRedundancyOfAPose) {
  Controlled c(Protocol::kSunrise2_7);
  c.set("client_mode", "pose");
  c.start();
  double third = kStart[2];
  c.want = [&] {
    if (!fri::is_commanding(c.message.state)) return;
    EXPECT_TRUE(c.message.has(fri::Monitoring::kInterpolatorRedundancy));
    EXPECT_EQ(c.message.redundancy_interpolator, (fri::Redundancy{0, kStart[2]}));
    c.command.fields = C::kPose | C::kRedundancy;
    c.command.redundancy = {0, third};
  };
  ASSERT_TRUE(c.commanding());
  for (int k = 0; k < 200; ++k) {
    third += 0.001;
    c.period();
    ASSERT_FALSE(HasFatalFailure());
    EXPECT_LT(distance(pose_of(c.q), pose_of(kStart)), 1e-5) << "the tool stands";
  }
  c.periods(3);
  EXPECT_TRUE(c.boolean("active"));
  EXPECT_NEAR(c.q[2], kStart[2] + 0.2, 1e-9);
  EXPECT_LT(distance(pose_of(c.q), pose_of(kStart)), 1e-9);
  EXPECT_GT(std::abs(c.q[0] - kStart[0]), 0.01) << "the elbow moves";
}

TEST(FriControllerLink, EndsCommandingAtAPoseOutOfReach) {
  Controlled c(Protocol::kSunrise2_7);
  c.set("client_mode", "pose");
  c.set("v_command_max", "1000");
  c.start();
  ASSERT_TRUE(c.commanding());
  c.want = [&] {
    if (c.message.state == fri::SessionState::kCommandingActive) c.command.X.p.x() += 1.5;
  };
  c.periods(4);
  EXPECT_EQ(c.integer("drop"), static_cast<int>(fri::Drop::kPosture));
  for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(c.q[i], kStart[i], 1e-9);
}

TEST(FriControllerLink, RefusesPosesOfVersionsWithoutThemAndOfRobotsWithoutUrdf) {
  Controlled c(Protocol::kSunrise1_16);
  c.set("client_mode", "pose");
  EXPECT_THAT(testing::error_of([&] { c.start(); }),
              HasSubstr("poses with protocol sunrise-1.16, expected sunrise-2.5 or -2.7"));
  Controlled bare(Protocol::kSunrise2_5, "", "joints=7");
  bare.set("client_mode", "pose");
  EXPECT_THAT(testing::error_of([&] { bare.start(); }), HasSubstr("without a URDF"));
  Controlled any(Protocol::kSunrise2_5);
  any.set("client", "0.0.0.0");
  EXPECT_THAT(testing::error_of([&] { any.start(); }), HasSubstr("expected the address and the port"));
  Controlled rated(Protocol::kSunrise2_5);
  rated.set("good", "0.999");
  EXPECT_THAT(testing::error_of([&] { rated.start(); }), HasSubstr("rating.good is 0.999, expected 0 to 0.99"));
}

// τ_e = Jᵀ F with J by differences of the pose, so that the signs and the frame are those of a force on the tool in the base.
TEST(FriControllerLink, EstimatesTheWrenchAtTheTool) {
  for (const Protocol p : {Protocol::kLwr, Protocol::kSunrise2_7}) {
    Controlled c(p);
    c.command.fields = C::kPosition;
    c.start();
    Wrench F;
    F << 12, -7, 20, 1.5, -0.5, 0.8;
    std::vector<double> q(kStart.begin(), kStart.end());
    const Pose at = pose_of(q);
    for (std::size_t i = 0; i < 7; ++i) {
      constexpr double kStep = 1e-6;
      q[i] = kStart[i] + kStep;
      const Pose after = pose_of(q);
      q[i] = kStart[i];
      const Eigen::AngleAxisd turn(Eigen::Matrix3d(after.R * at.R.transpose()));
      c.reals("tau_e")[i] = (F.head<3>().dot(after.p - at.p) + F.tail<3>().dot(turn.angle() * turn.axis())) / kStep;
    }
    c.periods(2);
    ASSERT_TRUE(c.message.has(fri::Monitoring::kExternalWrench));
    EXPECT_LT((c.message.F_external - F).cwiseAbs().maxCoeff(), 1e-3) << fri::to_text(p) << c.message.F_external.transpose();
  }
}

TEST(RobotKinematics, ItsWrenchStaysBoundedAndContinuousThroughASingularity) {
  RobotKinematics k(lwr4());
  std::array<double, 7> q{0, 0.5, 0, 0.3, 0, 0.4, 0}, tau{1, 2, 3, 4, 3, 2, 1};
  Wrench before = k.wrench_of(tau, q);
  for (q[3] = 0.3; q[3] > -0.3; q[3] -= 1e-4) {  // stretched at 0
    const Wrench F = k.wrench_of(tau, q);
    ASSERT_TRUE(F.allFinite());
    ASSERT_LT(F.norm(), std::sqrt(44.0) / 0.02 * 1.001);
    ASSERT_LT((F - before).norm(), 2) << q[3];
    before = F;
  }
  q.fill(0);
  EXPECT_TRUE(k.wrench_of(tau, q).allFinite());
}

TEST(FriControllerLink, StampsItsMessagesWithPlausibleTimes) {
  for (const Protocol p : {Protocol::kSunrise1_11, Protocol::kSunrise2_7, Protocol::kLwr}) {
    Controlled c(p);
    c.command.fields = C::kPosition;
    c.start();
    c.periods(3);
    const std::int64_t zero = p == Protocol::kLwr ? 0 : 1'700'000'000'000'000'000;
    EXPECT_NEAR(static_cast<double>(c.message.time - zero), 4e6, 1) << "the third message, of t = 4 ms";
    if (p == Protocol::kLwr) continue;
    c.set("start_time", "1800000000.25");
    c.n = 0;
    c.start();
    c.periods(1);
    EXPECT_EQ(c.message.time, 1'800'000'000'250'000'000);
  }
}

TEST(FriControllerLink, StampsItsMessagesWithTheHostsTimeIfItIsAskedTo) {
  Controlled c(Protocol::kSunrise1_15);
  c.set("start_time", "-1");
  c.start();
  std::this_thread::sleep_for(std::chrono::milliseconds(30));  // between initialisation and the first step
  const auto utc = [] {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  };
  const std::int64_t before = utc();
  c.periods(1);
  EXPECT_GE(c.message.time, before);
  EXPECT_LE(c.message.time, utc());
}

TEST(FriControllerLink, RefusesTorquesAndWrenchesOfAnotherMode) {
  for (const std::string mode : {"position", "torque", "wrench"}) {
    for (const std::uint32_t field : std::array<std::uint32_t, 2>{C::kTorque, C::kWrench}) {
      Controlled c(Protocol::kSunrise1_15);
      c.set("client_mode", mode);
      c.start();
      const std::uint32_t own = mode == "torque" ? +C::kTorque : mode == "wrench" ? +C::kWrench : 0u;
      bool other = false;
      c.want = [&] {
        c.command.fields |= own | (other ? std::uint32_t{field} : 0);
        c.command.tau.fill(1);
        c.command.F.setConstant(1);
      };
      ASSERT_TRUE(c.commanding()) << mode;
      c.periods(5);
      ASSERT_EQ(c.integer("drops"), 0);
      other = true;
      c.periods(3);
      EXPECT_EQ(c.integer("drop"), field == own ? 0 : static_cast<int>(fri::Drop::kFields)) << mode;
      for (const double tau : c.reals("tau_command")) EXPECT_LE(std::abs(tau), 10) << mode;
    }
  }
}

TEST(FriControllerLink, ReportsTheControlThatItsModeNeeds) {
  using Control = fri::ControlMode;
  for (const auto& [mode, control] : {std::pair("position", Control::kPosition), std::pair("torque", Control::kJointImpedance),
                                      std::pair("wrench", Control::kCartesianImpedance)}) {
    Controlled c(Protocol::kSunrise1_15);
    c.set("client_mode", mode);
    c.start();
    c.periods(1);
    EXPECT_EQ(c.message.control, control) << mode;
    if (control == Control::kPosition) continue;
    c.set("control", "position");
    EXPECT_THAT(testing::error_of([&] { c.start(); }),
                ::testing::HasSubstr("'position' with client_mode=" + std::string(mode)));
  }
}

TEST(FriControllerLink, AnLwrReportsTheControlOfItsClientsQuantities) {
  using Control = fri::ControlMode;
  struct Case {
    std::uint32_t fields;
    Control control;
  };
  for (const Case& given : {Case{C::kPosition, Control::kPosition}, Case{C::kPosition | C::kTorque, Control::kJointImpedance},
                            Case{C::kPosition | C::kJointStiffness | C::kJointDamping | C::kTorque, Control::kJointImpedance},
                            Case{C::kPosition | C::kWrench, Control::kCartesianImpedance}}) {
    for (const bool forced : {false, true}) {
      Controlled c(Protocol::kLwr);
      if (forced) c.set("control", "position");
      c.command.fields = given.fields;
      c.command.joint_stiffness.fill(1000);
      c.command.joint_damping.fill(0.7);
      c.start();
      const bool accepted = !forced || given.control == Control::kPosition;
      ASSERT_TRUE(c.commanding());
      c.periods(3);
      EXPECT_EQ(c.message.control, forced ? Control::kPosition : given.control) << given.fields;
      EXPECT_EQ(c.boolean("active"), accepted) << given.fields << " a robot in position control takes no impedance";
      EXPECT_EQ(c.integer("drop"), accepted ? 0 : static_cast<int>(fri::Drop::kFields));
    }
  }
}

TEST(FriControllerLink, RequestsTransformations) {
  for (const Protocol p : {Protocol::kSunrise1_15, Protocol::kSunrise2_7}) {
    Controlled c(p);
    c.set("transformations", "PBase, PTool");
    c.start();
    c.periods(2);
    ASSERT_EQ(c.message.transformations.count, 2u);
    EXPECT_EQ(c.message.transformations.values[0].name.view(), "PBase");
    EXPECT_EQ(c.message.transformations.values[1].name.view(), "PTool");
    EXPECT_TRUE(c.message.transformations.values[1].pose.R.isIdentity(1e-12));
    EXPECT_EQ(c.message.transformations.values[1].time, c.message.time);
    c.set("transformations", "a,b,c,d,e,f");
    EXPECT_THAT(testing::error_of([&] { c.start(); }), ::testing::HasSubstr("more than 5 names"));
    c.set("transformations", "a,,b");
    EXPECT_THAT(testing::error_of([&] { c.start(); }), ::testing::HasSubstr("expected a name of 1 to 63 characters"));
  }
}

// 0.94 rad/s within one period of 2 ms are 470 rad/s².
TEST(FriControllerLink, EndsCommandingAtAStepOfSpeed) {
  for (const Protocol p : {Protocol::kLwr, Protocol::kSunrise1_15}) {
    for (const double acceleration : {40.0, 470.0}) {
      Controlled c(p);
      c.command.fields = C::kPosition;
      c.start();
      double way = 0, speed = 0;
      c.want = [&] {
        if (!c.boolean("active")) return;
        speed = std::min(speed + acceleration * 0.002, 0.94);
        c.command.q[2] = kStart[2] + (way += speed * 0.002);
      };
      ASSERT_TRUE(c.commanding());
      c.periods(30);
      EXPECT_EQ(c.integer("drop"), acceleration < 50 ? 0 : static_cast<int>(fri::Drop::kAcceleration)) << fri::to_text(p);
    }
  }
}

TEST(FriControllerLink, SaysWhatItHasSeenOfAClientOfAnotherProtocol) {
  Controlled c(Protocol::kSunrise1_15);
  c.start();
  c.period(false);
  EXPECT_THAT(c.sentences(), Contains(HasSubstr("answered the 1 message (sunrise-1.15, from 127.0.0.1:")));
  fri::Command other;
  other.joints = 7;
  other.fields = C::kPosition;
  std::array<std::uint8_t, fri::kMaxDatagram> bytes{};
  const std::size_t size = fri::encode(Protocol::kSunrise2_7, other, bytes);
  for (int k = 0; k < 20; ++k) {
    c.send(std::span(bytes).first(size));
    while (c.datagrams().waiting() == 0) std::this_thread::yield();
    c.period(false);
  }
  EXPECT_EQ(c.integer("rejected"), 20);
  EXPECT_NE(c.integer("last_fault"), 0);
  EXPECT_THAT(c.sentences(), Contains(HasSubstr("the last one is a command of sunrise-2.7")));
  EXPECT_THAT(c.instance.variables.at("warning").strings()[0], HasSubstr("no commands of the protocol"));
}

TEST(FriControllerLink, WarnsOnceWhenNoClientHasAnsweredForTenSeconds) {
  Controlled c(Protocol::kSunrise1_15);
  c.start();
  const auto warning = [&] { return c.instance.variables.at("warning").strings()[0]; };
  for (int k = 0; k <= 110; ++k) {
    EXPECT_EQ(warning(), k <= 100 ? "" : "no client answered for 10 s") << k;
    ASSERT_EQ(c.instance.unit->step(Time{k * 100'000'000LL}, Duration{100'000'000}), StepResult::kDone);
  }
}

TEST(FriControllerLink, CountsMessagesThatCouldNotBeSentAndWarnsOnce) {
  Controlled c(Protocol::kSunrise1_15);
  c.set("client", "255.255.255.255");  // not permitted without SO_BROADCAST
  c.start();
  for (int k = 0; k < 5; ++k) ASSERT_EQ(c.instance.unit->step(Time{k * c.h.ns}, c.h), StepResult::kDone);
  EXPECT_EQ(c.integer("unsent"), 5);
  EXPECT_THAT(c.instance.variables.at("warning").strings()[0], ::testing::StartsWith("a message could not be sent"));
  EXPECT_THAT(c.instance.variables.at("warning").strings()[0], ::testing::Not(HasSubstr("; ")));
}

// A run on the wall clock that was stopped for 40 ms makes its late steps at once.
TEST(FriControllerLink, SendsNoBurstWhileItsRunCatchesUp) {
  Controlled c(Protocol::kSunrise1_15);
  c.set("spacing", "0.1");
  c.start();
  c.period();
  for (int k = 1; k < 20; ++k) ASSERT_EQ(c.instance.unit->step(Time{k * c.h.ns}, c.h), StepResult::kDone);
  EXPECT_EQ(c.integer("sent"), 1);
  EXPECT_EQ(c.integer("missing"), 0);
  std::this_thread::sleep_for(std::chrono::milliseconds(101));
  c.n = 20;
  const std::uint32_t counter = c.message.counter;
  c.period();
  EXPECT_EQ(c.message.counter, counter + 1) << "the client sees no loss";
  EXPECT_EQ(c.integer("sent"), 2);
  EXPECT_EQ(c.integer("skipped"), 19);
}

TEST(FriControllerLink, TellsHowLongAnswersTook) {
  Controlled c(Protocol::kSunrise2_5);
  c.start();
  c.periods(100);
  const double median = c.reals("latency_median")[0], late = c.reals("latency_99")[0], longest = c.reals("latency_max")[0];
  EXPECT_GT(median, 0);
  EXPECT_LE(median, late);
  EXPECT_LE(late, longest);
  EXPECT_LT(longest, 1.1 * c.h.seconds()) << "times are those of the scenario: an answer before the next step is in time";
  EXPECT_THAT(c.sentences(), Contains(::testing::StartsWith("answers took ")));
}

TEST(FriControllerLink, AllocatesNothingWithPosesOddDatagramsAndWarnings) {
  Controlled c(Protocol::kSunrise2_7);
  c.set("client_mode", "pose");
  c.set("client", net::to_text(c.socket.local()));
  c.start();
  net::UdpSocket stranger(net::Endpoint{0x7f000001, 0}, "test");
  const std::vector<std::uint8_t> noise(1600, 0x55);
  ASSERT_TRUE(c.commanding());
  std::uint64_t allocated = 0;
  for (int k = 0; k < 50; ++k) {
    std::ranges::copy(c.q, c.reals("q").begin());
    const std::uint64_t before = testing::allocations();
    (void)c.instance.unit->step(Time{c.n++ * c.h.ns}, c.h);
    allocated += testing::allocations() - before;
    std::ranges::copy(c.reals("q_command"), c.q.begin());
    ASSERT_TRUE(c.hear());
    c.send(noise);
    stranger.send(noise, c.from);
    c.answer();
  }
  EXPECT_EQ(allocated, 0u);
  EXPECT_TRUE(c.boolean("active"));
  EXPECT_GE(c.integer("rejected"), 98);
}

}  // namespace
}  // namespace cotwin::io::controller_link_test
