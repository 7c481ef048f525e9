// Sessions of RTDE without sockets: components/io/emulators/ur/controller.h, client.h, follower.h.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "components/io/emulators/ur/controller.h"
#include "components/io/emulators/ur/follower.h"
#include "components/io/rtde/client.h"
#include "tests/components/io/rtde/bytes.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::rtde::session_test {
namespace {

using Bytes = std::vector<std::uint8_t>;

/// A controller and raw bytes of clients.
struct Rtde {
  Controller controller{ControllerSettings{}};

  int connect() { return controller.connect(); }
  void send(int client, const Bytes& stream) {
    const auto c = static_cast<std::size_t>(client);
    for (std::size_t at = 0; at < stream.size();) {
      const std::span<std::uint8_t> space = controller.space(c);
      const std::size_t size = std::min(space.size(), stream.size() - at);
      if (size == 0) return;
      std::copy_n(stream.begin() + static_cast<std::ptrdiff_t>(at), size, space.begin());
      controller.received(c, size);
      at += size;
    }
  }
  Bytes answer(int client) {
    const auto c = static_cast<std::size_t>(client);
    const Bytes result(controller.waiting(c).begin(), controller.waiting(c).end());
    controller.sent(c, result.size());
    return result;
  }
  Bytes ask(int client, const Bytes& stream) {
    send(client, stream);
    return answer(client);
  }
};

const Bytes k125Hz = bytes("405f400000000000"), k500Hz = bytes("407f400000000000");

TEST(RtdeController, AnswersTheSetUpByteByByte) {
  Rtde r;
  const int c = r.connect();
  EXPECT_EQ(r.ask(c, bytes("0005 56 0002")), bytes("0004 56 01"));
  EXPECT_EQ(r.ask(c, bytes("0003 76")), bytes("0013 76 00000005 0000000e 00000000 00000000"));
  EXPECT_EQ(r.ask(c, package('O', k125Hz + letters("timestamp,actual_q"))),
            package('O', bytes("01") + letters("DOUBLE,VECTOR6D")));
  EXPECT_EQ(r.ask(c, package('I', letters("input_int_register_24,speed_slider_mask"))),
            package('I', bytes("01") + letters("INT32,UINT32")));
  EXPECT_EQ(r.ask(c, package('I', letters("input_double_register_0"))), package('I', bytes("02") + letters("DOUBLE")));
  EXPECT_EQ(r.ask(c, bytes("0003 53")), bytes("0004 53 01"));
  r.controller.at("timestamp") = 2;
  for (std::size_t i = 0; i < 6; ++i) r.controller.at("actual_q", i) = static_cast<double>(i % 2);
  r.controller.cycle();
  const Bytes zero = bytes("0000000000000000"), one = bytes("3ff0000000000000");
  EXPECT_EQ(r.answer(c), package('U', bytes("01 4000000000000000") + zero + one + zero + one + zero + one));
  EXPECT_EQ(r.ask(c, bytes("0003 50")), bytes("0004 50 01"));
  for (int k = 0; k < 10; ++k) r.controller.cycle();
  EXPECT_TRUE(r.answer(c).empty());
}

TEST(RtdeController, SpeaksVersion1WithoutARequest) {
  Rtde r;
  const int c = r.connect();
  EXPECT_EQ(r.ask(c, package('O', letters("runtime_state"))), package('O', letters("UINT32")));
  EXPECT_EQ(r.ask(c, package('I', letters("input_int_register_0"))), package('I', bytes("01") + letters("INT32")));
  EXPECT_EQ(r.ask(c, bytes("0003 53")), bytes("0004 53 01"));
  r.controller.at("runtime_state") = 2;
  // 125 Hz of 500 Hz, without a recipe id.
  std::string sent;
  for (int k = 0; k < 12; ++k) {
    r.controller.cycle();
    sent += r.answer(c) == bytes("0007 55 00000002") ? 'x' : '.';
  }
  EXPECT_EQ(sent, "x...x...x...");
  r.send(c, bytes("0008 55 01 fffffffe"));
  EXPECT_EQ(r.controller.at("input_int_register_0"), -2);
  EXPECT_EQ(r.ask(c, bytes("0005 56 0003")), bytes("0004 56 00"));
}

TEST(RtdeController, RefusesWhatItDoesNotHaveAndStartsNothing) {
  Rtde r;
  const int c = r.connect();
  r.ask(c, bytes("0005 56 0002"));
  EXPECT_EQ(r.ask(c, package('O', k125Hz + letters("timestamp,no_such,actual_qd"))),
            package('O', bytes("00") + letters("DOUBLE,NOT_FOUND,VECTOR6D")));
  EXPECT_EQ(r.ask(c, package('O', k125Hz + letters("speed_slider_mask"))), package('O', bytes("00") + letters("NOT_FOUND")));
  EXPECT_EQ(r.ask(c, package('I', letters("actual_q"))), package('I', bytes("00") + letters("NOT_FOUND")));
  EXPECT_EQ(r.ask(c, package('O', k125Hz)), package('O', bytes("00") + letters("NOT_FOUND")));
  // A start without outputs fails; a message explains it.
  const Bytes answer = r.ask(c, bytes("0003 53"));
  EXPECT_EQ(answer[2], 'M');
  EXPECT_TRUE(std::equal(answer.end() - 4, answer.end(), bytes("0004 53 00").begin()));
  for (const char* frequency : {"0000000000000000", "bff0000000000000", "7ff8000000000000"}) {
    const Bytes reply = r.ask(c, package('O', bytes(frequency) + letters("timestamp")));
    const Bytes expected = package('O', bytes("00") + letters("DOUBLE"));
    EXPECT_EQ(Bytes(reply.end() - static_cast<std::ptrdiff_t>(expected.size()), reply.end()), expected);
  }
}

TEST(RtdeController, GivesAnInputToOneClientUntilItGoes) {
  Rtde r;
  const int a = r.connect(), b = r.connect();
  const Bytes ask = package('I', letters("input_int_register_24,input_int_register_25"));
  EXPECT_EQ(r.ask(a, package('I', letters("input_int_register_24"))), package('I', bytes("01") + letters("INT32")));
  EXPECT_EQ(r.ask(b, ask), package('I', bytes("00") + letters("IN_USE,INT32")));
  EXPECT_EQ(r.ask(b, package('I', letters("input_int_register_25"))), package('I', bytes("01") + letters("INT32")));
  r.controller.disconnect(static_cast<std::size_t>(a));
  EXPECT_EQ(r.ask(b, ask), package('I', bytes("02") + letters("INT32,INT32")));
}

TEST(RtdeController, TakesFourClientsAndAFifthWhenOneHasGone) {
  Rtde r;
  for (int i = 0; i < 4; ++i) EXPECT_EQ(r.connect(), i);
  EXPECT_EQ(r.connect(), -1);
  r.controller.disconnect(2);
  EXPECT_EQ(r.connect(), 2);
  EXPECT_EQ(r.controller.statistics().refused, 1u);
}

TEST(RtdeController, ActsOnMasksOfInputs) {
  Rtde r;
  const int c = r.connect();
  r.ask(c, package('O', letters("timestamp")));
  r.ask(c, package('I', letters("speed_slider_mask,speed_slider_fraction,standard_digital_output_mask,standard_digital_output,"
                                "configurable_digital_output_mask,configurable_digital_output,tool_digital_output_mask,"
                                "tool_digital_output,standard_analog_output_mask,standard_analog_output_type,"
                                "standard_analog_output_0,standard_analog_output_1")));
  const Bytes values = bytes("01 00000001 3fe0000000000000 0f 3a 80 ff 03 01 03 02 3fe0000000000000 3fe0000000000000");
  r.send(c, package('U', values));  // before the start: refused
  EXPECT_EQ(r.controller.statistics().rejected, 1u);
  EXPECT_EQ(r.controller.at("target_speed_fraction"), 0);
  r.ask(c, bytes("0003 53"));
  r.controller.at("actual_digital_output_bits") = 0x0f05;
  r.send(c, package('U', values));
  EXPECT_EQ(r.controller.at("target_speed_fraction"), 0.5);
  // Standard: 0x05 with the bits of 0x0f from 0x3a; configurable: bit 7 on, the others stay; tool: 0b01.
  EXPECT_EQ(r.controller.at("actual_digital_output_bits"), 0x0a + (0x8f << 8) + (1 << 16));
  EXPECT_EQ(r.controller.at("actual_configurable_digital_output_bits"), 0x8f);
  EXPECT_DOUBLE_EQ(r.controller.at("standard_analog_output0"), 0.012);  // A: 4 to 20 mA
  EXPECT_DOUBLE_EQ(r.controller.at("standard_analog_output1"), 5);      // V: 0 to 10 V
  EXPECT_EQ(r.controller.at("analog_io_types"), 8);
}

TEST(RtdeController, DropsDataForASlowClientAndSendsTheNewestLater) {
  Rtde r;
  const int slow = r.connect(), quick = r.connect();
  for (const int c : {slow, quick}) {
    r.ask(c, bytes("0005 56 0002"));
    r.ask(c, package('O', k500Hz + letters("timestamp")));
    r.ask(c, bytes("0003 53"));
  }
  for (int k = 0; k < 1000; ++k) {
    r.controller.at("timestamp") = k;
    r.controller.cycle();
    EXPECT_EQ(r.answer(quick).size(), 12u);
  }
  EXPECT_EQ(r.answer(slow), package('U', bytes("01 0000000000000000")));  // the first, which the socket had not taken
  EXPECT_EQ(r.controller.statistics().dropped, 999u);
  r.controller.at("timestamp") = 1;
  r.controller.cycle();
  EXPECT_EQ(r.answer(slow), package('U', bytes("01 3ff0000000000000")));
  // One that asks and does not read is given up.
  for (int k = 0; k < 10'000 && !r.controller.broken(0); ++k) r.send(slow, bytes("0003 76"));
  EXPECT_TRUE(r.controller.broken(0));
  EXPECT_FALSE(r.controller.broken(1));
}

TEST(RtdeController, AnyFrequencyHasItsMeanRate) {
  for (const auto& [hz, packages] : {std::pair{"4008000000000000", 6},
                                     {"405f400000000000", 250},
                                     {"4059000000000000", 200},
                                     {"407f400000000000", 1000},
                                     {"408f400000000000", 1000},
                                     {"4072c00000000000", 600}}) {
    Rtde r;  // 3, 125, 100, 500, 1000 (limited), 300 Hz
    const int c = r.connect();
    r.ask(c, bytes("0005 56 0002"));
    r.ask(c, package('O', bytes(hz) + letters("timestamp")));
    r.ask(c, bytes("0003 53"));
    int sent = 0;
    for (int k = 0; k < 1000; ++k) {
      r.controller.cycle();
      sent += r.answer(c).empty() ? 0 : 1;
    }
    EXPECT_NEAR(sent, packages, 1) << hz;
  }
}

TEST(RtdeController, KeepsItsStateSaneUnderRandomBytesAndMutatedPackages) {
  std::mt19937 random(7);
  const std::vector<Bytes> good{bytes("0005 56 0002"),
                                package('O', k125Hz + letters("timestamp,actual_q")),
                                package('I', letters("input_double_register_24,speed_slider_mask,speed_slider_fraction")),
                                bytes("0003 53"),
                                package('U', bytes("01 3ff0000000000000 00000001 3fe0000000000000")),
                                bytes("0003 76")};
  Rtde r;
  for (int round = 0; round < 3000; ++round) {
    const int c = r.connect();
    ASSERT_GE(c, 0);
    for (std::size_t k = 0; k < 8; ++k) {
      Bytes piece = good[random() % 4 == 0 ? random() % good.size() : k % good.size()];
      if (random() % 6 == 0) piece[random() % piece.size()] = static_cast<std::uint8_t>(random());
      if (random() % 8 == 0) piece.resize(random() % (piece.size() + 1));
      r.send(c, piece);
      r.controller.cycle();
      if (r.controller.broken(static_cast<std::size_t>(c))) break;
    }
    r.controller.disconnect(static_cast<std::size_t>(c));
    for (const double value : r.controller.values()) ASSERT_TRUE(std::isfinite(value));
    ASSERT_GE(r.controller.at("target_speed_fraction"), 0);
    ASSERT_LE(r.controller.at("target_speed_fraction"), 1);
  }
  EXPECT_GT(r.controller.statistics().received, 100u);
  EXPECT_GT(r.controller.statistics().faults, 100u);
}

/// A client and a controller with the bytes between them.
struct Pair {
  Controller controller{ControllerSettings{}};
  Client client;
  std::size_t number;
  std::int64_t now = 0;

  explicit Pair(const ClientSettings& settings)
      : client(settings, "io"), number(static_cast<std::size_t>(controller.connect())) {
    client.open(0);
  }
  /// Moves all bytes, `piece` at a time.
  void exchange(std::size_t piece = 100'000) {
    for (bool moved = true; moved;) {
      moved = false;
      if (const auto bytes = client.waiting(); !bytes.empty()) {
        const std::span<std::uint8_t> space = controller.space(number);
        const std::size_t size = std::min({piece, bytes.size(), space.size()});
        std::copy_n(bytes.begin(), size, space.begin());
        client.sent(size);
        controller.received(number, size);
        moved = true;
      }
      if (const auto bytes = controller.waiting(number); !bytes.empty()) {
        const std::span<std::uint8_t> space = client.space();
        const std::size_t size = std::min({piece, bytes.size(), space.size()});
        std::copy_n(bytes.begin(), size, space.begin());
        controller.sent(number, size);
        client.received(size);
        moved = size > 0 || moved;
      }
      client.set_up(now);
    }
  }
};

ClientSettings usual() {
  ClientSettings settings;
  settings.outputs = {{"timestamp"}, {"actual_q"}, {"actual_current_as_torque", false}};
  settings.inputs = {{"input_int_register_24"}, {"input_double_register_24"}};
  return settings;
}

TEST(RtdeClient, SetsUpReadsAndWritesHoweverTheBytesArrive) {
  for (const std::size_t piece : {1u, 2u, 7u, 100'000u}) {
    Pair p(usual());
    p.exchange(piece);
    ASSERT_TRUE(p.client.running()) << p.client.reason();
    EXPECT_EQ(p.client.version()[1], 14u);
    p.controller.at("timestamp") = 0.5;
    p.controller.at("actual_q", 5) = -1.25;
    p.controller.cycle();
    p.exchange(piece);
    EXPECT_EQ(p.client.look_ahead(), 0.5);
    EXPECT_FALSE(p.client.look_ahead());
    ASSERT_TRUE(p.client.read(p.now));
    EXPECT_EQ(p.client.value("actual_q", 5), -1.25);
    EXPECT_FALSE(p.client.read(p.now));
    p.client.at("input_int_register_24") = -7;
    p.client.at("input_double_register_24") = 0.125;
    EXPECT_TRUE(p.client.send());
    p.exchange(piece);
    EXPECT_EQ(p.controller.at("input_int_register_24"), -7);
    EXPECT_EQ(p.controller.at("input_double_register_24"), 0.125);
    for (const double wrong : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
      p.client.at("input_double_register_24") = wrong;
      EXPECT_FALSE(p.client.send());
    }
    EXPECT_TRUE(p.client.waiting().empty());
  }
}

/// What a client says to the replies of a controller, given as bytes.
std::string reason_after(Client& client, const std::vector<Bytes>& replies, std::int64_t now = 0) {
  client.open(0);
  for (const Bytes& reply : replies) {
    std::ranges::copy(reply, client.space().begin());
    client.received(reply.size());
    client.set_up(now);
  }
  client.set_up(now);
  return client.state() == Client::State::kFailed ? client.reason() + std::string(" ") + std::string(client.culprit()) : "";
}

TEST(RtdeClient, SaysWhyTheControllerDoesNotServe) {
  Client client(usual(), "io");
  const Bytes hello = bytes("0004 56 01 0013 76 00000003 0000000f 00000000 00000000");
  const Bytes all = package('O', bytes("01") + letters("DOUBLE,VECTOR6D,VECTOR6D"));
  EXPECT_EQ(reason_after(client, {hello, package('O', bytes("00") + letters("DOUBLE,NOT_FOUND,VECTOR6D"))}),
            "the controller does not have actual_q");
  EXPECT_EQ(reason_after(client, {hello, package('O', bytes("01") + letters("DOUBLE,VECTOR3D,VECTOR6D"))}),
            "the controller has another type for actual_q");
  EXPECT_EQ(reason_after(client, {hello, all, package('I', bytes("00") + letters("IN_USE,DOUBLE"))}),
            "another client writes input_int_register_24");
  EXPECT_EQ(reason_after(client, {hello, all, package('I', bytes("01") + letters("INT32,DOUBLE")), bytes("0004 53 00")}),
            "the controller refuses to start ");
  EXPECT_EQ(reason_after(client, {hello, bytes("0001 53")}), "the stream of the controller cannot be read ");
  EXPECT_EQ(reason_after(client, {}, 1'000'000'001), "the controller does not reply ");
  // Without the optional quantity, it asks again and goes on.
  EXPECT_EQ(reason_after(client, {hello, package('O', bytes("00") + letters("DOUBLE,VECTOR6D,NOT_FOUND")),
                                  package('O', bytes("01") + letters("DOUBLE,VECTOR6D")),
                                  package('I', bytes("03") + letters("INT32,DOUBLE")), bytes("0004 53 01")}),
            "");
  EXPECT_TRUE(client.running());
  EXPECT_FALSE(client.has("actual_current_as_torque"));
  // A controller of version 1.
  EXPECT_EQ(reason_after(client, {bytes("0004 56 00 0013 76 00000003 00000001 00000000 00000000"),
                                  package('O', letters("DOUBLE,VECTOR6D,VECTOR6D")),
                                  package('I', bytes("01") + letters("INT32,DOUBLE")), bytes("0004 53 01")}),
            "");
  EXPECT_TRUE(client.running());
  ClientSettings wrong;
  wrong.outputs = {{"actual_Q"}};
  EXPECT_EQ(testing::error_of([&] { Client other(wrong, "io"); }), "io: 'actual_Q' is no output of RTDE");
}

TEST(RtdeClient, IgnoresDataThatCannotBeRead) {
  Pair p(usual());
  p.exchange();
  ASSERT_TRUE(p.client.running());
  const Bytes nan = bytes("7ff8000000000000"), one = bytes("3ff0000000000000");
  for (const Bytes& wrong :
       {package('U', bytes("01") + one), package('U', bytes("02") + one), package('U'),
        package('U', bytes("01") + one + nan + one + one + one + one + one + one + one + one + one + one + one)}) {
    std::ranges::copy(wrong, p.client.space().begin());
    p.client.received(wrong.size());
    EXPECT_FALSE(p.client.read(0));
  }
  EXPECT_EQ(p.client.rejected(), 4u);
  EXPECT_TRUE(p.client.running());
  EXPECT_EQ(p.client.value("actual_q"), 0);
}

TEST(RtdeClient, RefusesNumbersThatNoRobotHas) {
  Pair p(usual());
  p.exchange();
  ASSERT_TRUE(p.client.running());
  const auto takes = [&](const char* name, double value, double stamp = 100) {
    p.controller.at("timestamp") = stamp;
    p.controller.at(name) = value;
    p.controller.cycle();
    p.exchange();
    return p.client.read(p.now);
  };
  EXPECT_TRUE(takes("actual_q", 1e9));
  EXPECT_FALSE(takes("actual_q", 1.001e9));
  EXPECT_EQ(p.client.value("actual_q"), 1e9);
  EXPECT_TRUE(takes("actual_q", 0.5));
  EXPECT_FALSE(takes("timestamp", 1e10));
  EXPECT_TRUE(takes("timestamp", 100.002));
  EXPECT_TRUE(takes("timestamp", 3700));
  EXPECT_FALSE(takes("timestamp", 7301));  // 1 h and 1 s
  EXPECT_EQ(p.client.value("timestamp"), 3700);
  EXPECT_TRUE(takes("timestamp", 7301.002));  // the clock was set
  EXPECT_EQ(p.client.rejected(), 3u);
  // The meaning of a register is that of a program.
  ClientSettings registers;
  registers.outputs = {{"timestamp"}, {"output_double_register_24"}, {"actual_digital_input_bits"}};
  Pair r(registers);
  r.exchange();
  r.controller.at("output_double_register_24") = -1e300;
  r.controller.at("actual_digital_input_bits") = 1e15;
  r.controller.cycle();
  r.exchange();
  ASSERT_TRUE(r.client.read(r.now));
  EXPECT_EQ(r.client.value("output_double_register_24"), -1e300);
}

TEST(RtdeClient, MakesRoomWithoutLosingTheNewestDataAndItsReplies) {
  Pair p(usual());
  p.exchange();
  ASSERT_TRUE(p.client.running());
  for (int k = 1; k <= 500; ++k) {
    p.controller.at("timestamp") = k;
    p.controller.cycle();
    p.exchange();
    EXPECT_EQ(p.client.look_ahead(), k);
    p.client.make_room(p.now);
    ASSERT_GT(p.client.space().size(), 100u);
  }
  double last = 0;
  int count = 0;
  while (p.client.read(p.now)) {
    EXPECT_TRUE(last == 0 || p.client.value("timestamp") == last + 1);
    last = p.client.value("timestamp");
    ++count;
  }
  EXPECT_EQ(last, 500);
  EXPECT_GT(count, 50);
  EXPECT_EQ(p.client.rejected(), 0u);
}

TEST(RtdeSessions, AllocateNothing) {
  Pair p(usual());
  const std::uint64_t before = testing::allocations();
  p.exchange();
  for (int k = 0; k < 100; ++k) {
    p.controller.cycle();
    p.exchange();
    p.client.look_ahead();
    while (p.client.read(0)) p.client.send();
  }
  EXPECT_EQ(testing::allocations(), before);
  EXPECT_GT(p.controller.statistics().received, 90u);
}

FollowerSettings limits() {
  FollowerSettings s;
  s.lower.fill(-3);
  s.upper.fill(3);
  s.speed.fill(2);
  return s;
}

struct Follow {
  Controller controller{ControllerSettings{}};
  Follower follower{limits()};
  int counter = 0;
  Joints last{};
  double largest_speed = 0;
  static constexpr double h = 0.002;

  Follow() {
    controller.at("target_speed_fraction") = 1;
    controller.at("input_int_register_25") = 1;
    follower.start({}, controller);
  }
  /// The request ends and begins again.
  void request() {
    controller.at("input_int_register_25") = 0;
    cycle(last[0]);
    EXPECT_EQ(follower.state(), FollowState::kWaiting);
    controller.at("input_int_register_25") = 1;
  }
  void cycle(double q, bool fresh = true, bool running = true) {
    if (fresh) controller.at("input_int_register_24") = ++counter;
    for (std::size_t i = 0; i < 6; ++i) controller.at("input_double_register_24", i) = q;
    follower.cycle(controller, h, running, nullptr);
    for (std::size_t i = 0; i < 6; ++i) {
      largest_speed = std::max(largest_speed, std::abs(follower.q()[i] - last[i]) / h);
      EXPECT_LE(std::abs(follower.q()[i]), 3);
    }
    last = follower.q();
  }
};

TEST(RtdeFollower, FollowsNearCommandsWithinTheLimits) {
  Follow f;
  for (int k = 0; k < 10; ++k) f.cycle(0);
  EXPECT_EQ(f.follower.state(), FollowState::kHeld) << "the request was there before the program";
  f.request();
  f.cycle(0);
  EXPECT_EQ(f.follower.state(), FollowState::kFollowing);
  for (int k = 1; k <= 2000; ++k) f.cycle(std::min(0.001 * k, 1.0));
  EXPECT_NEAR(f.follower.q()[0], 1, 1e-6);
  for (int k = 0; k < 2000; ++k) f.cycle(50);  // a step far beyond the limits while following
  EXPECT_NEAR(f.follower.q()[0], 3, 1e-6);
  EXPECT_LE(f.largest_speed, 2 + 1e-9);
  EXPECT_EQ(f.controller.at("output_int_register_24"), f.counter);
}

TEST(RtdeFollower, RestsWhenTheFirstCommandIsFar) {
  Follow f;
  f.request();
  for (int k = 0; k < 100; ++k) f.cycle(0.5);
  EXPECT_EQ(f.follower.state(), FollowState::kFar);
  EXPECT_EQ(f.follower.q()[0], 0);
  for (int k = 0; k < 100; ++k) f.cycle(0.05);
  EXPECT_EQ(f.follower.state(), FollowState::kFar) << "not by itself";
  f.request();
  f.cycle(0.05);
  EXPECT_EQ(f.follower.state(), FollowState::kFollowing);
}

TEST(RtdeFollower, StopsWithinItsTimeAfterALossAndGoesOnNearItselfWhenItIsAskedAgain) {
  Follow f;
  f.request();
  double q = 0;
  for (int k = 0; k < 500; ++k) f.cycle(q += 2 * f.h);  // full speed
  ASSERT_NEAR(f.follower.dq()[0], 2, 1e-6);
  int cycles = 0;
  while (f.follower.dq()[0] != 0 || f.follower.state() == FollowState::kFollowing) {
    f.cycle(q, false);
    ASSERT_LT(++cycles, 1000);
  }
  EXPECT_EQ(f.follower.state(), FollowState::kLost);
  EXPECT_EQ(f.follower.losses(), 1u);
  EXPECT_LE(cycles * f.h, 0.1 + 0.2 + 2 * f.h);  // loss_time + stop_time
  const double rest = f.follower.q()[0];
  for (int k = 0; k < 100; ++k) f.cycle(rest + 0.01);
  EXPECT_EQ(f.follower.state(), FollowState::kLost) << "not by itself";
  f.request();
  for (int k = 0; k < 100; ++k) f.cycle(rest + 0.2);
  EXPECT_EQ(f.follower.state(), FollowState::kFar);
  EXPECT_EQ(f.follower.q()[0], rest);
  f.request();
  for (int k = 0; k < 100; ++k) f.cycle(rest + 0.01);
  EXPECT_EQ(f.follower.state(), FollowState::kFollowing);
  EXPECT_NEAR(f.follower.q()[0], rest + 0.01, 1e-3);
}

TEST(RtdeFollower, HoldsTheLastFinitePositionOfItsOwnMotion) {
  Follow f;
  Joints own{};
  const auto moves = [&](double q) {
    own[1] = q;
    for (int k = 0; k < 500; ++k) f.follower.cycle(f.controller, f.h, false, &own);
    return f.follower.q()[1];
  };
  EXPECT_EQ(moves(std::numeric_limits<double>::quiet_NaN()), 0);
  EXPECT_NEAR(moves(0.3), 0.3, 1e-6);
  EXPECT_NEAR(moves(std::numeric_limits<double>::quiet_NaN()), 0.3, 1e-6);
  EXPECT_NEAR(moves(std::numeric_limits<double>::infinity()), 0.3, 1e-6);
  EXPECT_NEAR(moves(-0.1), -0.1, 1e-6);
}

TEST(RtdeFollower, RestsWithoutProgramAndWithoutRequest) {
  Follow f;
  for (int k = 0; k < 10; ++k) f.cycle(0.01, true, false);
  EXPECT_EQ(f.follower.state(), FollowState::kOff);
  f.controller.at("input_int_register_25") = 0;
  for (int k = 0; k < 10; ++k) f.cycle(0.01);
  EXPECT_EQ(f.follower.state(), FollowState::kWaiting);
  EXPECT_EQ(f.follower.q()[0], 0);
  // The slider slows the robot down.
  f.controller.at("input_int_register_25") = 1;
  f.controller.at("target_speed_fraction") = 0.1;
  f.cycle(0.05);
  for (int k = 0; k < 50; ++k) f.cycle(1);
  EXPECT_LE(f.largest_speed, 0.2 + 1e-9);
  EXPECT_GT(f.largest_speed, 0.19);
}

}  // namespace
}  // namespace cotwin::rtde::session_test
