// The unit shared_states: two units in one process, connected over the loopback device.
#include "components/shared_states/shared_states.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/error_of.h"

namespace cotwin::shared_states::shared_states_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr Duration kTick{1'000'000};

/// An address of the loopback device that no other test process has.
std::string address(int number) {
  const int id = static_cast<int>(getpid());
  return "127." + std::to_string(1 + id / 62'500 % 250) + "." + std::to_string(id / 250 % 250) + "." +
         std::to_string(1 + id % 250) + ":" + std::to_string(30'000 + number);
}

class End {
 public:
  End(const std::string& query, const std::string& listen, const std::string& peer)
      : settings_("shared_states", query, {}, {}), unit_(make(settings_)) {
    unit_->declare(v_);
    v_.at("listen").strings()[0] = listen;
    v_.at("peer").strings()[0] = peer;
  }

  SharedStates& unit() { return *unit_; }
  void start() { unit_->initialise(Time{}); }
  void step() {
    EXPECT_EQ(unit_->step(now_, kTick), StepResult::kDone);
    now_ = now_ + kTick;
  }
  std::span<double> reals(const std::string& name) { return v_.at(name).reals(); }
  double real(const std::string& name) { return v_.at(name).reals()[0]; }
  std::span<std::int32_t> integers(const std::string& name) { return v_.at(name).integers(); }
  std::span<bool> booleans(const std::string& name) { return v_.at(name).booleans(); }
  bool boolean(const std::string& name) { return v_.at(name).booleans()[0]; }
  std::string text(const std::string& name) { return v_.at(name).strings()[0]; }
  void set(const std::string& name, double value) { v_.at(name).reals()[0] = value; }

 private:
  static std::unique_ptr<SharedStates> make(Settings& settings) {
    SettingList list;
    SharedStates::declare_settings(list);
    settings.declare(std::move(list));
    return std::make_unique<SharedStates>(settings);
  }
  Settings settings_;
  std::unique_ptr<SharedStates> unit_;
  Variables v_;
  Time now_;
};

TEST(SharedStates, GivesThePeersStatesBitForBit) {
  const char *to_robot = "q:3:rad,mode:2:integer,on:5:boolean", *to_twin = "tau:2:N.m";
  End a(std::string("publish=") + to_robot + "&subscribe=" + to_twin, address(0), address(1));
  End b(std::string("publish=") + to_twin + "&subscribe=" + to_robot, address(1), address(0));
  a.reals("q")[0] = -0.0;
  a.reals("q")[1] = std::numeric_limits<double>::denorm_min();
  a.reals("q")[2] = 1.0 / 3;
  a.integers("mode")[1] = std::numeric_limits<std::int32_t>::min();
  a.booleans("on")[4] = true;
  b.reals("tau")[0] = std::numeric_limits<double>::infinity();
  b.reals("tau")[1] = 7;
  a.start();
  b.start();
  EXPECT_FALSE(b.boolean("connected"));
  double lost = 0;  // before there was a socket
  for (int i = 0; i < 3; ++i) {
    a.step();
    b.step();
    if (i == 0) lost = a.real("sent_bytes") - b.real("received_bytes");
  }
  EXPECT_TRUE(a.boolean("connected"));
  EXPECT_TRUE(b.boolean("connected"));
  EXPECT_EQ(std::memcmp(a.reals("q").data(), b.reals("q").data(), 24), 0);
  EXPECT_THAT(b.integers("mode"), ElementsAre(0, std::numeric_limits<std::int32_t>::min()));
  EXPECT_THAT(b.booleans("on"), ElementsAre(false, false, false, false, true));
  EXPECT_THAT(a.reals("tau"), ElementsAre(std::numeric_limits<double>::infinity(), 7));
  EXPECT_EQ(b.real("peer_time"), 0.002);
  EXPECT_EQ(b.real("recoveries"), 1);
  EXPECT_EQ(b.real("missed"), 0);
  EXPECT_EQ(a.real("sent_bytes") - b.real("received_bytes"), lost);
}

TEST(SharedStates, HoldsWhatASilentPeerSentLastAndAges) {
  End a("publish=x", address(0), address(1)), b("subscribe=x", address(1), address(0));
  b.set("timeout", 0.005);
  b.set("x", 42);  // the start value
  a.start();
  b.start();
  a.set("x", 3);
  b.step();
  EXPECT_EQ(b.real("x"), 42) << "before the first states";
  for (int i = 0; i < 3; ++i) {
    a.step();
    b.step();
  }
  EXPECT_EQ(b.real("x"), 3);
  EXPECT_EQ(b.real("age"), 0);
  EXPECT_TRUE(b.boolean("fresh"));
  for (int i = 1; i <= 10; ++i) {
    b.step();
    EXPECT_FALSE(b.boolean("fresh"));
    EXPECT_NEAR(b.real("age"), i * 1e-3, 1e-15);
    EXPECT_EQ(b.boolean("connected"), i <= 5) << i;
    EXPECT_EQ(b.real("x"), 3);
  }
  a.set("x", 4);
  a.step();
  b.step();
  EXPECT_TRUE(b.boolean("connected"));
  EXPECT_EQ(b.real("x"), 4);
}

TEST(SharedStates, FollowsAPeerThatWasStartedAgain) {
  auto a = std::make_unique<End>("publish=x", address(0), address(1));
  End b("subscribe=x", address(1), address(0));
  a->start();
  b.start();
  for (int i = 0; i < 100; ++i) {
    a->set("x", i);
    a->step();
    b.step();
  }
  a.reset();
  b.step();
  a = std::make_unique<End>("publish=x", address(0), address(1));
  a->set("x", -1);
  a->start();
  for (int i = 0; i < 3; ++i) {
    a->step();
    b.step();
  }
  EXPECT_EQ(b.real("x"), -1);
  EXPECT_EQ(b.real("peer_time"), 0.002);
  EXPECT_EQ(b.real("recoveries"), 2);
  EXPECT_EQ(b.real("restarts"), 1);
  EXPECT_EQ(b.text("warning"), "");
}

TEST(SharedStates, WarnsOfTwoProgramsThatPublishFromOneAddress) {
  auto one = std::make_unique<bus::UdpTransport>(net::endpoint_of(address(0), 0, "test"),
                                                 net::endpoint_of(address(1), 0, "test"), "test");
  const bus::StateLayout layout = bus::StateLayout::parse("x", "test");
  bus::StateOwner owners[] = {bus::StateOwner(layout, 1), bus::StateOwner(layout, 2)};
  End b("subscribe=x", address(1), address(0));
  b.start();
  for (int i = 0; i < 6; ++i) {
    bus::StateOwner& owner = owners[i % 2];
    ASSERT_TRUE(one->send(owner.publish(i)));
    b.step();  // requests
    bus::StateMessage request;
    const std::span<const std::byte> message = one->receive();
    ASSERT_TRUE(bus::decode(message, 0, 0, request));
    ASSERT_TRUE(one->send(owner.full(request.base)));
    b.step();
    while (!one->receive().empty()) {
    }
  }
  EXPECT_EQ(b.text("warning"),
            "the peer " + address(0) + " came back to an earlier start, expected one program that publishes from this address");
  EXPECT_EQ(b.real("restarts"), 5);
}

TEST(SharedStates, SendsAFewBytesIfLittleChanges) {
  End a("publish=x:1000", address(0), address(1));
  a.start();
  a.step();
  const double before = a.real("sent_bytes");
  a.step();
  const double unchanged = a.real("sent_bytes") - before;
  EXPECT_EQ(unchanged, 16 + 56) << "the headers of the datagram and of the update";
  a.reals("x")[500] = 1;
  a.step();
  EXPECT_EQ(a.real("sent_bytes") - before - unchanged, unchanged + 8 + 8);
}

TEST(SharedStates, RefusesAPeerWithOtherStates) {
  End a("publish=q:7:rad", address(0), address(1)), b("subscribe=q:6:rad", address(1), address(0));
  a.start();
  b.start();
  EXPECT_EQ(testing::error_of([&] {
              for (int i = 0; i < 3; ++i) {
                a.step();
                b.step();
              }
            }),
            "unit:shared_states: the peer " + address(0) + " publishes 'q:7:rad', expected 'q:6:rad' (setting subscribe)");
  a.step();
  EXPECT_EQ(a.text("warning"), "the peer " + address(1) + " expects 'q:6:rad', but 'q:7:rad' is published");
}

TEST(SharedStates, HoldsItsStatesIfAPeerWithOtherStatesComesLater) {
  auto a = std::make_unique<End>("publish=x", address(0), address(1));
  End b("subscribe=x", address(1), address(0));
  a->set("x", 5);
  a->start();
  b.start();
  for (int i = 0; i < 3; ++i) {
    a->step();
    b.step();
  }
  a = nullptr;
  a = std::make_unique<End>("publish=x:2", address(0), address(1));
  a->start();
  for (int i = 0; i < 200; ++i) {
    a->step();
    b.step();
  }
  EXPECT_EQ(b.real("x"), 5);
  EXPECT_FALSE(b.boolean("connected"));
  EXPECT_EQ(b.real("refused"), 201);
}

TEST(SharedStates, WaitsAtTheStartForItsPeer) {
  End a("publish=x", address(0), address(1)), b("subscribe=x", address(1), address(0));
  b.set("wait", 0.02);
  EXPECT_EQ(testing::error_of([&] { b.start(); }), "unit:shared_states: no states of the peer " + address(0) +
                                                       " within 0.02 s, expected a run that publishes 'x:1:1' to " +
                                                       address(1));
  a.set("x", 9);
  b.set("wait", 60);
  std::atomic<bool> done = false;
  std::thread peer([&] {
    a.start();
    while (!done) {
      a.step();
      std::this_thread::yield();
    }
  });
  b.start();
  done = true;
  peer.join();
  EXPECT_EQ(b.real("x"), 9);
  EXPECT_TRUE(b.boolean("connected"));
}

// The master repeats initialise until the values of all units fit together.
TEST(SharedStates, KeepsItsOutputsWhileItIsInitialisedAgainWithoutAStep) {
  End a("publish=x", address(0), address(1)), b("publish=y&subscribe=x", address(1), address(0));
  a.start();
  b.start();
  a.set("x", 1);
  for (int i = 0; i < 3; ++i) {
    a.step();
    b.step();
  }
  b.start();
  a.set("x", 2);
  a.step();
  a.step();
  b.start();
  EXPECT_EQ(b.real("x"), 1);
  for (int i = 0; i < 3; ++i) {
    b.step();
    a.step();
  }
  EXPECT_EQ(b.real("x"), 2);
}

TEST(SharedStates, TicksWithThePeersPublications) {
  End a("publish=x", address(0), address(1)), b("subscribe=x", address(1), address(0));
  EXPECT_EQ(a.unit().tick_source(), nullptr);
  TickSource* const ticks = b.unit().tick_source();
  ASSERT_NE(ticks, nullptr);
  a.start();
  b.start();
  a.step();  // answers the request
  const std::int64_t far = bus::monotonic_ns() + 60'000'000'000;
  ASSERT_TRUE(ticks->wait(far));
  EXPECT_FALSE(ticks->wait(0)) << "a deadline in the past, and nothing has come";
  for (int i = 1; i <= 5; ++i) {
    a.set("x", i);
    const std::int64_t before = bus::monotonic_ns();
    a.step();
    const std::optional<Arrival> arrival = ticks->wait(far);
    ASSERT_TRUE(arrival);
    EXPECT_EQ(arrival->source, i * kTick.ns) << "the peer's time";
    EXPECT_GE(arrival->host, before);
    b.step();
    EXPECT_EQ(b.real("x"), i) << "what has arrived stays for the next step";
    EXPECT_TRUE(b.boolean("fresh"));
  }
  const std::int64_t deadline = bus::monotonic_ns() + 2'000'000;
  EXPECT_FALSE(ticks->wait(deadline));
  EXPECT_GE(bus::monotonic_ns(), deadline);
}

TEST(SharedStates, CountsDatagramsOfOthers) {
  End b("subscribe=x", address(1), address(0));
  b.start();
  net::UdpSocket stranger(net::endpoint_of(address(2), 0, "test"), "test"),
      bad(net::endpoint_of(address(0), 0, "test"), "test");
  const std::vector<std::uint8_t> noise(100, 7);
  ASSERT_TRUE(stranger.send(noise, net::endpoint_of(address(1), 0, "test")));
  ASSERT_TRUE(bad.send(noise, net::endpoint_of(address(1), 0, "test")));
  b.step();
  EXPECT_EQ(b.real("foreign"), 1);
  EXPECT_EQ(b.real("damaged"), 1);
}

TEST(SharedStates, NamesWhatIsWrongInItsSettings) {
  const auto error = [](const std::string& query, const std::string& listen, const std::string& peer) {
    return testing::error_of([&] { End(query, listen, peer).start(); });
  };
  EXPECT_EQ(error("", address(0), address(1)),
            "unit:shared_states: neither publish nor subscribe, expected at least one, as publish=q:7:rad");
  EXPECT_THAT(error("publish=q:7:furlong", address(0), address(1)), HasSubstr("furlong"));
  EXPECT_THAT(error("publish=q:x", address(0), address(1)), HasSubstr("unit:shared_states?publish: 'q:x': size 'x'"));
  EXPECT_EQ(error("publish=q&subscribe=q", address(0), address(1)),
            "unit:shared_states: 'q' is published and subscribed, expected different names");
  EXPECT_THAT(error("subscribe=age", address(0), address(1)), HasSubstr("age: declared twice"));
  EXPECT_THAT(error("publish=q", "here", address(1)), HasSubstr("unit:shared_states.listen: 'here' is no IPv4 address"));
  EXPECT_THAT(error("publish=q", address(0), "there:1"), HasSubstr("unit:shared_states.peer: 'there:1' is no IPv4 address"));
  EXPECT_EQ(error("publish=q:100000", address(0), address(1)),
            "unit:shared_states: states: a full copy has 800070 bytes, expected at most 66432, the largest message");
  End first("publish=q", address(0), address(1));
  first.start();
  EXPECT_THAT(error("publish=q", address(0), address(1)),
              HasSubstr("unit:shared_states.listen: UDP socket at " + address(0) + ": bind: "));
  EXPECT_FALSE(first.unit().restorable());
}

}  // namespace
}  // namespace cotwin::shared_states::shared_states_test
