// The gateway at an MQTT broker. The broker is Mosquitto, the client at the other side of tests/support.
#include "components/gateway/mqtt/plant.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/mosquitto.h"
#include "tests/support/mqtt_client.h"

namespace cotwin::gateway::mqtt::mqtt_test {
namespace {

using Json = nlohmann::json;
using testing::error_of;
using testing::Mosquitto;
using testing::within_patience;

std::string unique_name() {
  static std::atomic<int> next = 0;
  return "test-" + std::to_string(::getpid()) + "-" + std::to_string(++next);
}

/// A program of the plant that listens to everything.
struct Listener : testing::MqttClient {
  explicit Listener(const Mosquitto& broker) : MqttClient(broker.port(), unique_name()) {}
};

class GatewayMqtt : public ::testing::Test {
 protected:
  void SetUp() override {
    if (testing::mosquitto_program().empty()) GTEST_SKIP() << "Mosquitto is not installed";
  }
  PlantOptions options(const std::string& url) {
    PlantOptions o;
    o.broker.url = url;
    o.broker.client_id = unique_name();
    o.prefix = "cotwin/cell";
    o.first_delay_s = 0.02;
    o.longest_delay_s = 0.2;
    return o;
  }
  std::filesystem::path file(const std::string& name, const std::string& content, mode_t mode = 0600) {
    const std::filesystem::path path = folder_.path() / name;
    std::ofstream(path) << content;
    ::chmod(path.c_str(), mode);
    return path;
  }
  testing::TemporaryFolder folder_{"gateway_mqtt"};
};

PlantReply echo(const std::string& payload) { return {200, Json{{"got", payload}}.dump()}; }

TEST_F(GatewayMqtt, SaysThatItIsThereAndThatItHasLeft) {
  Mosquitto broker(folder_.path());
  ASSERT_TRUE(broker.start());
  Listener listener(broker);
  {
    Plant plant(options(broker.url()), echo, echo);
    ASSERT_TRUE(listener.next("cotwin/cell/status", "true"));
    EXPECT_TRUE(within_patience([&] { return plant.connected(); }));
    EXPECT_EQ(plant.trouble(), "");
  }
  const auto left = listener.next("cotwin/cell/status", "false");
  ASSERT_TRUE(left);
  // Retained: who comes later is told, too.
  Listener late(broker);
  const auto kept = late.next("cotwin/cell/status");
  ASSERT_TRUE(kept);
  EXPECT_TRUE(kept->retained);
  EXPECT_EQ(kept->payload, R"({"online":false})");
}

TEST_F(GatewayMqtt, AnswersCommandsAndRequestsAtTheirResponseTopics) {
  Mosquitto broker(folder_.path());
  ASSERT_TRUE(broker.start());
  Listener listener(broker);
  Plant plant(options(broker.url()), echo, [](const std::string&) -> PlantReply { throw Error("/robot", "is unknown"); });
  ASSERT_TRUE(listener.next("cotwin/cell/status", "true"));
  EXPECT_TRUE(within_patience([&] {  // until the subscription is there
    listener.send("cotwin/cell/commands", "{}", "mes/reply");
    return listener.count("mes/reply") > 0;
  }));
  listener.send("cotwin/cell/commands", R"({"command":"pause"})", "mes/reply", false, "order 7");
  const auto reply = listener.next("mes/reply", "pause");
  ASSERT_TRUE(reply);
  EXPECT_EQ(reply->correlation, "order 7");
  EXPECT_FALSE(reply->retained);
  EXPECT_EQ(Json::parse(reply->payload)["reply"]["got"], R"({"command":"pause"})");
  EXPECT_EQ(Json::parse(reply->payload)["status"], 200);
  listener.send("cotwin/cell/requests", "{}", "mes/reply");
  const auto failed = listener.next("mes/reply", "unknown");
  ASSERT_TRUE(failed);
  EXPECT_EQ(Json::parse(failed->payload)["status"], 500);
  // A response topic that would be a command again is not used.
  const std::uint64_t before = plant.counts().received;
  listener.send("cotwin/cell/commands", "{}", "cotwin/cell/commands");
  listener.send("cotwin/cell/commands", "last", "mes/reply");
  ASSERT_TRUE(listener.next("mes/reply", "last"));
  EXPECT_EQ(plant.counts().received, before + 2);
}

TEST_F(GatewayMqtt, IgnoresRetainedCommands) {
  Mosquitto broker(folder_.path());
  ASSERT_TRUE(broker.start());
  Listener listener(broker);
  listener.send("cotwin/cell/commands", "ghost", "mes/reply", true);
  std::atomic<int> ghosts = 0;
  Plant plant(
      options(broker.url()),
      [&](const std::string& payload) {
        ghosts += payload == "ghost";
        return echo(payload);
      },
      echo);
  EXPECT_TRUE(within_patience([&] { return plant.counts().ignored == 1; }));
  EXPECT_TRUE(listener.next("mes/reply", "with the retain flag"));
  listener.send("cotwin/cell/commands", "present", "mes/reply");
  ASSERT_TRUE(listener.next("mes/reply", "present"));
  // One that comes while the session lasts would be carried out again after the next connection.
  listener.send("cotwin/cell/commands", "ghost", "mes/reply", true, "order 8");
  const auto reply = listener.next("mes/reply", "with the retain flag");
  ASSERT_TRUE(reply);
  EXPECT_EQ(reply->correlation, "order 8");
  EXPECT_EQ(Json::parse(reply->payload)["status"], 422);
  EXPECT_EQ(plant.counts().ignored, 2u);
  EXPECT_EQ(ghosts, 0);
}

TEST_F(GatewayMqtt, DeliversEventsThatCameBeforeTheBroker) {
  Mosquitto broker(folder_.path());
  Plant plant(options(broker.url()), echo, echo);
  for (int i = 0; i < 50; ++i) plant.event("jobs/7", Json{{"i", i}}.dump());
  EXPECT_TRUE(within_patience([&] { return plant.counts().lost >= 3; }));  // it tries again
  EXPECT_FALSE(plant.connected());
  EXPECT_NE(plant.trouble(), "");
  ASSERT_TRUE(broker.start());
  // The events come at once with the connection, so this listens to what the broker keeps for a session that was there before.
  Listener listener(broker);
  EXPECT_TRUE(within_patience([&] { return plant.counts().delivered >= 51; }));
  EXPECT_TRUE(plant.connected());
  EXPECT_EQ(plant.counts().dropped, 0u);
}

TEST_F(GatewayMqtt, LosesNoEventWhenTheBrokerIsKilledAndStartedAgain) {
  Mosquitto broker(folder_.path());
  ASSERT_TRUE(broker.start());
  Plant plant(options(broker.url()), echo, echo);
  std::set<int> seen;
  int sent = 0;
  for (int round = 0; round < 3; ++round) {
    Listener listener(broker);
    ASSERT_TRUE(listener.next("cotwin/cell/status", "true"));
    for (int i = 0; i < 20; ++i) plant.event("jobs/7", Json{{"i", sent++}}.dump());
    for (int i = sent - 20; i < sent; ++i)
      ASSERT_TRUE(listener.next("cotwin/cell/jobs/7", "\"i\":" + std::to_string(i) + "}")) << i;
    broker.kill();
    EXPECT_TRUE(within_patience([&] { return !plant.connected(); }));
    ASSERT_TRUE(broker.start());
  }
  EXPECT_TRUE(within_patience([&] { return plant.counts().connections >= 4; }));
}

TEST_F(GatewayMqtt, KeepsABoundedBacklogForABrokerThatDoesNotRead) {
  Mosquitto broker(folder_.path());
  ASSERT_TRUE(broker.start());
  PlantOptions o = options(broker.url());
  o.backlog = 100;
  Plant plant(o, echo, echo);
  EXPECT_TRUE(within_patience([&] { return plant.connected(); }));
  broker.freeze();
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 5000; ++i) plant.event("jobs/7", std::string(1000, 'x'));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));  // nobody waits for the broker
  EXPECT_GE(plant.counts().dropped, 4800u);
  broker.resume();
  EXPECT_TRUE(within_patience([&] { return plant.counts().delivered >= 100; }));
}

TEST_F(GatewayMqtt, KeepsABacklogThatIsBoundedInBytes) {
  PlantOptions o = options("mqtt://127.0.0.1:" + std::to_string(testing::free_tcp_port()));
  o.backlog_bytes = 10'000;
  Plant plant(o, echo, echo);
  for (int i = 0; i < 100; ++i) plant.event("jobs/7", std::string(1000, 'x'));
  EXPECT_GE(plant.counts().dropped, 90u);
  EXPECT_LT(plant.counts().dropped, 100u);
}

TEST_F(GatewayMqtt, GetsNoMessageThatIsTooLarge) {
  Mosquitto broker(folder_.path());
  ASSERT_TRUE(broker.start());
  Listener listener(broker);
  Plant plant(options(broker.url()), echo, echo);
  EXPECT_TRUE(within_patience([&] {  // until the subscription is there
    listener.send("cotwin/cell/commands", "{}", "mes/reply");
    return listener.count("mes/reply") > 0;
  }));
  // Messages keep their order: after this reply all of the commands above have been counted, however slow the machine is.
  listener.send("cotwin/cell/commands", "first", "mes/reply");
  ASSERT_TRUE(listener.next("mes/reply", "first"));
  const std::uint64_t before = plant.counts().received;
  listener.send("cotwin/cell/commands", std::string(2 << 20, 'x'), "mes/reply");
  listener.send("cotwin/cell/commands", "last", "mes/reply");
  ASSERT_TRUE(listener.next("mes/reply", "last"));
  EXPECT_EQ(plant.counts().received, before + 1);
}

TEST_F(GatewayMqtt, ARequestThatTakesItsTimeDelaysNoCommand) {
  Mosquitto broker(folder_.path());
  ASSERT_TRUE(broker.start());
  Listener listener(broker);
  std::atomic<bool> working = false, done = false;
  Plant plant(options(broker.url()), echo, [&](const std::string& payload) {
    working = true;
    within_patience([&] { return done.load(); });
    return echo(payload);
  });
  EXPECT_TRUE(within_patience([&] {  // until the subscription is there
    listener.send("cotwin/cell/requests", "{}", "mes/reply");
    return working.load();
  }));
  listener.send("cotwin/cell/commands", "stop", "mes/reply");
  EXPECT_TRUE(listener.next("mes/reply", "stop"));
  EXPECT_FALSE(done.exchange(true));
}

TEST_F(GatewayMqtt, ConnectsAgainAfterARefusedSubscription) {
  // A broker of three lines, as Mosquitto refuses no subscription: it refuses those of the first connection.
  const int listening = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  ASSERT_EQ(::bind(listening, reinterpret_cast<sockaddr*>(&address), size), 0);
  ASSERT_EQ(::listen(listening, 4), 0);
  ASSERT_EQ(::getsockname(listening, reinterpret_cast<sockaddr*>(&address), &size), 0);
  std::atomic<int> connections = 0, subscriptions = 0;
  std::thread broker([&] {
    for (int client = 0; (client = ::accept(listening, nullptr, nullptr)) >= 0; ::close(client)) {
      ++connections;
      const auto read = [&](unsigned char* to, std::size_t n) { return ::recv(client, to, n, MSG_WAITALL) == ssize_t(n); };
      for (unsigned char head[2]; read(head, 2);) {
        std::vector<unsigned char> rest(head[1] & 0x7f);  // MQTT 5, 2.1: type, length
        if (head[1] >= 0x80) {
          unsigned char high = 0;
          if (!read(&high, 1)) break;
          rest.resize(rest.size() + 128 * high);
        }
        if (!rest.empty() && !read(rest.data(), rest.size())) break;
        std::vector<unsigned char> reply;
        if (head[0] >> 4 == 1) reply = {0x20, 3, 0, 0, 0};
        if (head[0] >> 4 == 3) reply = {0x40, 2, rest[2 + rest[1]], rest[3 + rest[1]]};
        if (head[0] >> 4 == 8) {
          ++subscriptions;
          const unsigned char code = connections == 1 ? 0x87 : 1;  // not authorized; granted
          reply = {0x90, 4, rest[0], rest[1], 0, code};
        }
        if (!reply.empty()) (void)::send(client, reply.data(), reply.size(), MSG_NOSIGNAL);
      }
    }
  });
  {
    Plant plant(options("mqtt://127.0.0.1:" + std::to_string(ntohs(address.sin_port))), echo, echo);
    EXPECT_TRUE(within_patience([&] { return connections == 2 && plant.connected(); }));
    EXPECT_TRUE(within_patience([&] { return subscriptions >= 3; })) << "of both topics in the second session";
    EXPECT_EQ(plant.counts().lost, 1u);
  }
  ::shutdown(listening, SHUT_RDWR);
  broker.join();
  ::close(listening);
}

TEST_F(GatewayMqtt, LogsInWithUserAndPasswordOfAFile) {
  const std::filesystem::path passwords = file("passwords", "");
  ASSERT_EQ(std::system(("mosquitto_passwd -b '" + passwords.string() + "' twin 'a secret'").c_str()), 0);
  ::chmod(passwords.c_str(), 0644);
  Mosquitto broker(folder_.path(), "allow_anonymous false\npassword_file " + passwords.string() + "\n");
  ASSERT_TRUE(broker.start());
  PlantOptions o = options(broker.url());
  {
    o.broker.login = file("wrong", "twin\nno secret\n");
    Plant plant(o, echo, echo);
    EXPECT_TRUE(within_patience([&] { return plant.counts().lost >= 2; }));
    EXPECT_EQ(plant.trouble().find("secret"), std::string::npos);
  }
  o.broker.login = file("login", "twin\na secret\n");
  Plant plant(o, echo, echo);
  EXPECT_TRUE(within_patience([&] { return plant.connected(); }));
}

TEST_F(GatewayMqtt, RefusesOptionsThatAreNotPermitted) {
  const auto refusal = [&](const auto& change) {
    PlantOptions o = options("mqtt://127.0.0.1:1883");
    change(o);
    return error_of([&] { Plant plant(o, echo, echo); });
  };
  EXPECT_EQ(refusal([](PlantOptions& o) { o.broker.url = "127.0.0.1"; }),
            "gateway: broker '127.0.0.1', expected mqtt://HOST:PORT or mqtts://HOST:PORT");
  EXPECT_EQ(refusal([](PlantOptions& o) { o.broker.url = "mqtt://127.0.0.1:99999"; }),
            "gateway: broker 'mqtt://127.0.0.1:99999', expected mqtt://HOST:PORT");
  EXPECT_EQ(refusal([](PlantOptions& o) { o.broker.url = "mqtt://10.0.0.1:1883"; }),
            "gateway: broker 'mqtt://10.0.0.1:1883' is on another machine, expected TLS for it (mqtts://)");
  EXPECT_EQ(refusal([](PlantOptions& o) { o.prefix = "a/#"; }),
            "gateway: 'a/#' is no prefix of topics, expected such as cotwin/cell_3");
  const std::filesystem::path open = file("open", "a\nb\n", 0644), one = file("one", "a\n");
  EXPECT_EQ(refusal([&](PlantOptions& o) { o.broker.login = open; }),
            open.string() + ": can be used by other users than its owner, expected mode 600: chmod 600 " + open.string());
  EXPECT_EQ(refusal([&](PlantOptions& o) { o.broker.login = one; }),
            one.string() + ": expected two lines: the user and the password");
}

TEST_F(GatewayMqtt, PublishesTheRunsStateAndValuesAtALimitedRate) {
  Mosquitto broker(folder_.path());
  ASSERT_TRUE(broker.start());
  Listener listener(broker);
  bus::LiveSignal signal;
  signal.name = "drive.q";
  signal.component = "drive";
  signal.variable = "q";
  signal.size = 2;
  bus::RunFacts facts;
  facts.stop = Time::from_seconds(100);
  facts.tick = Duration{1'000'000};
  facts.ticks = 100'000;
  const auto run = std::make_shared<bus::LiveRun>(facts, std::vector<bus::LiveSignal>{signal});
  PlantOptions o = options(broker.url());
  o.names = {"drive.q"};
  o.rate_hz = 20;
  Plant plant(o, echo, echo);
  plant.observe(run);
  // In place of a master: a record after each tick in which one is requested.
  std::atomic<bool> done = false;
  std::thread loop([&] {
    bus::LiveRun::Plan plan;
    for (std::int64_t tick = 1; !done; ++tick) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      run->set_tick(tick);
      if (!run->pop_request()) continue;
      run->pop_plan(plan);
      struct {
        bus::LiveRun::RecordHeader header;
        double values[2];
      } record{{tick, plan.number}, {double(tick), -double(tick)}};
      run->publish(std::as_bytes(std::span(&record, 1)));
    }
  });
  EXPECT_TRUE(listener.next("cotwin/cell/run", "running"));
  for (int i = 0; i < 5; ++i) {
    const auto message = listener.next("cotwin/cell/values");
    ASSERT_TRUE(message);
    const Json sample = Json::parse(message->payload);
    EXPECT_EQ(sample["values"]["drive.q"], Json::array({sample["tick"], -sample["tick"].get<double>()}));
    EXPECT_FALSE(message->retained);
  }
  run->set_phase(bus::RunPhase::kEnded);
  EXPECT_TRUE(listener.next("cotwin/cell/run", "ended"));
  done = true;
  loop.join();
}

}  // namespace
}  // namespace cotwin::gateway::mqtt::mqtt_test
