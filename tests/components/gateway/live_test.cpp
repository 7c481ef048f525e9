// The gateway's routes to a running twin, with a client on raw sockets.
#include "components/gateway/live/live.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <atomic>
#include <nlohmann/json.hpp>
#include <thread>

#include "components/gateway/http/server.h"
#include "tests/master/test_units.h"
#include "tests/support/http_client.h"
#include "tests/support/patience.h"

namespace cotwin::gateway::live::live_test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;
using testing::http_call;
using testing::http_request;
using testing::HttpReply;
using testing::RawClient;
using testing::within_patience;

/// A run of y = gain · u and z = ∫y on a thread, with a server that shows it.
class Subject {
 public:
  explicit Subject(bool observed = true, double seconds = 1e6, std::shared_ptr<bus::RunPage> page = nullptr) {
    live.add_routes(router);
    http::ServerOptions options;
    options.addresses = {"127.0.0.1"};
    options.authority.hosts = {"localhost"};
    server.emplace(std::move(options), router);
    if (observed) begin(seconds, std::move(page));
  }
  ~Subject() {
    stop();
    live.end();
    server->stop();
  }
  void begin(double seconds, std::shared_ptr<bus::RunPage> page = nullptr) {
    testing::Build b;
    b.unit("g", "gain?n=3").with("u", 1.0).unit("i", "integrator", 1).unit("m", "mixed").unit("p", "probe");
    b.unit("robot", "gain?n=7").until(seconds);
    b.connect("g.y[1]", "i.u").as_it_is();
    struct Observer final : bus::RunObserver {
      explicit Observer(Live& l) : live(l) {}
      void observe(std::shared_ptr<bus::LiveRun> run) override { live.observe(std::move(run)); }
      Live& live;
    } observer{live};
    master::MasterOptions master_options;
    master_options.types = testing::test_types();
    master_options.observer = &observer;
    master_options.page = std::move(page);
    master.emplace(b.scenario, std::move(master_options));
    master->initialise();
    loop = std::thread([this] {
      while (!done && master->step_tick()) std::this_thread::yield();
      master->finish();
    });
  }
  void stop() {
    done = true;
    if (loop.joinable()) loop.join();
  }
  HttpReply call(const std::string& method, const std::string& target, const std::string& body = "") {
    return http_call(server->port(), method, target, body);
  }
  Json get(const std::string& target) { return Json::parse(call("GET", target).body); }

  Live live;
  http::Router router;
  std::optional<http::Server> server;
  std::optional<master::Master> master;
  std::atomic<bool> done = false;
  std::thread loop;
};

/// The data of the next server-sent event with this name.
Json next_event(RawClient& client, const std::string& name) {
  const std::string begin = "event: " + name + "\n";
  for (;;) {
    if (!client.receive_until(begin)) return nullptr;
    client.received().erase(0, client.received().find(begin));
    if (!client.receive_until("\n\n")) return nullptr;
    const std::string event = client.received().substr(0, client.received().find("\n\n"));
    client.received().erase(0, begin.size());
    const std::size_t data = event.find("data: ");
    if (data != std::string::npos) return Json::parse(event.substr(data + 6));
  }
}

TEST(GatewayLive, RefusesAsLongAsThereIsNoRun) {
  Subject s(false);
  const HttpReply reply = s.call("GET", "/run");
  EXPECT_EQ(reply.status, 503);
  EXPECT_EQ(Json::parse(reply.body)["detail"], "the run has not begun");
  EXPECT_EQ(s.call("PUT", "/run/tunables/g.gain", R"({"value":1})").status, 503);
  EXPECT_EQ(s.call("GET", "/run/stream?names=g.y").status, 503);
}

/// A page that counts how often its content is made.
struct TestPage final : bus::RunPage {
  const std::string& html() const override { return text; }
  std::string content(const bus::LiveRun& run) override {
    ++made;
    return Json{{"format", 1}, {"name", run.facts().scenario}}.dump();
  }
  const std::string text = "<!doctype html><title>page</title>";
  std::atomic<int> made = 0;
};

TEST(GatewayLive, AnswersAtItsRootWhatItHasWhereNoRunHasAPage) {
  for (const bool observed : {false, true}) {
    Subject s(observed);
    const HttpReply reply = s.call("GET", "/");
    EXPECT_EQ(reply.status, 200);
    EXPECT_EQ(reply.field("Content-Type"), "text/html; charset=utf-8");
    EXPECT_THAT(reply.body, HasSubstr("no run to show"));
    EXPECT_THAT(reply.body, HasSubstr("href=\"openapi.json\""));
    EXPECT_THAT(reply.body, ::testing::Not(HasSubstr("<script")));
    const HttpReply content = s.call("GET", "/run/page");
    EXPECT_EQ(content.status, observed ? 404 : 503);
    EXPECT_EQ(content.field("Content-Type"), "application/problem+json");
  }
}

TEST(GatewayLive, ServesThePageOfTheRunAndItsContent) {
  const auto page = std::make_shared<TestPage>();
  Subject s(true, 1e6, page);
  const HttpReply reply = s.call("GET", "/");
  EXPECT_EQ(reply.status, 200);
  EXPECT_EQ(reply.body, page->text);
  EXPECT_EQ(reply.field("Content-Security-Policy"), "frame-ancestors 'none'");
  EXPECT_EQ(page->made, 0);  // only for those who ask for it
  EXPECT_EQ(s.get("/run/page")["name"], "test");
  EXPECT_EQ(page->made, 1);
  EXPECT_EQ(s.call("POST", "/").status, 405);
  EXPECT_EQ(http_call(s.server->port(), "GET", "/", "", "Origin: http://evil.example\r\n").status, 403);
  s.stop();
  EXPECT_EQ(s.get("/run/page")["name"], "test");  // also after the end
}

TEST(GatewayLive, ShowsStateSignalsAndValues) {
  Subject s;
  const Json run = s.get("/run");
  EXPECT_EQ(run["phase"], "running");
  EXPECT_EQ(run["scenario"], "test");
  EXPECT_EQ(run["can_pause"], true);
  EXPECT_EQ(run["commands"], true);
  EXPECT_EQ(run["tick_s"], 0.001);
  const Json signals = s.get("/run/signals?component=g")["signals"];
  ASSERT_EQ(signals.size(), 4u);
  EXPECT_EQ(signals[2]["name"], "g.gain");
  EXPECT_EQ(signals[2]["variability"], "tunable");
  EXPECT_EQ(signals[2]["causality"], "parameter");
  EXPECT_EQ(signals[2]["max"], 1e6);
  EXPECT_EQ(signals[2]["settable"], true);
  EXPECT_EQ(signals[0]["unit"], "rad");
  EXPECT_EQ(signals[0]["start"], Json::array({1, 1, 1}));
  const Json values = s.get("/run/values?names=g.u,g.u%5B2%5D,p.odd,p.steps,p.t");
  EXPECT_EQ(values["values"]["g.u"], Json::array({1, 1, 1}));
  EXPECT_EQ(values["values"]["g.u[2]"], 1);
  // All values are of one tick.
  EXPECT_EQ(values["values"]["p.steps"], values["tick"]);
  EXPECT_EQ(values["values"]["p.odd"], values["tick"].get<int>() % 2 == 1);
  EXPECT_NEAR(values["values"]["p.t"].get<double>(), values["time_s"].get<double>(), 1e-9);
  EXPECT_EQ(s.call("GET", "/run/values?names=g.x").status, 422);
  EXPECT_THAT(s.call("GET", "/run/values?names=g.gian").body, HasSubstr("did you mean 'g.gain'?"));
  EXPECT_EQ(s.call("GET", "/run/values").status, 400);
  EXPECT_EQ(s.call("GET", "/run/values?names=,").status, 400);
}

TEST(GatewayLive, SetsTunablesFromTheTickThatItAnswers) {
  Subject s;
  const HttpReply reply = s.call("PUT", "/run/tunables/g.gain", R"({"value": 2.5})");
  ASSERT_EQ(reply.status, 200) << reply.body;
  const Json accepted = Json::parse(reply.body);
  EXPECT_NEAR(accepted["time_s"].get<double>(), 1e-3 * accepted["tick"].get<double>(), 1e-9);
  const Json values = s.get("/run/values?names=g.gain");
  EXPECT_GE(values["tick"], accepted["tick"]);
  EXPECT_EQ(values["values"]["g.gain"], 2.5);
  EXPECT_EQ(
      s.call("POST", "/run/commands", R"({"command":"set","values":{"g.u[2]":7,"m.boolean":true,"m.integer":-3}})").status,
      200);
  const Json after = s.get("/run/values?names=g.u,m.boolean,m.integer")["values"];
  EXPECT_EQ(after["g.u"], Json::array({1, 7, 1}));
  EXPECT_EQ(after["m.boolean"], true);
  EXPECT_EQ(after["m.integer"], -3);
  s.stop();
  EXPECT_EQ(s.master->summary().influence.changes.size(), 4u);
}

TEST(GatewayLive, RefusesWrongValuesAndCommands) {
  Subject s;
  const auto put = [&](const std::string& name, const std::string& body) {
    return s.call("PUT", "/run/tunables/" + name, body);
  };
  const auto post = [&](const std::string& body) { return s.call("POST", "/run/commands", body); };
  EXPECT_EQ(put("g.gain", R"({"value": 2e6})").status, 422);
  EXPECT_THAT(put("g.gain", R"({"value": 2e6})").body, HasSubstr("expected -1e+06 to 1e+06"));
  EXPECT_EQ(put("g.gain", R"({"value": 1e999})").status, 400);
  EXPECT_EQ(put("g.gain", R"({"value": NaN})").status, 400);
  EXPECT_EQ(put("g.gain", R"({"value": "1"})").status, 422);
  EXPECT_EQ(put("g.gain", R"({"value": []})").status, 422);
  EXPECT_EQ(put("g.gain", R"({"value": {"a":1}})").status, 422);
  EXPECT_EQ(put("g.gain", R"({"valeu": 1})").status, 422);
  EXPECT_EQ(put("g.gain", "[]").status, 400);
  EXPECT_EQ(put("g.gain", R"({"value": 1, "value": 2})").status, 400);
  EXPECT_EQ(put("g.gain", "{").status, 400);
  EXPECT_EQ(put("g.gain", std::string(200, '[')).status, 400);
  EXPECT_EQ(put("g.y", R"({"value": 1})").status, 422);
  EXPECT_EQ(put("i.u", R"({"value": 1})").status, 422);
  EXPECT_EQ(put("g.bias", R"({"value": 1})").status, 422);
  EXPECT_EQ(put("nothing", R"({"value": 1})").status, 404);
  EXPECT_EQ(put("m.integer", R"({"value": 1.5})").status, 422);
  EXPECT_EQ(put("g.gain", R"({"value": 1, "time_s": 2e6})").status, 422);
  EXPECT_EQ(put("g.gain", R"({"value": 1, "time_s": "soon"})").status, 422);
  EXPECT_EQ(put("g.gain", R"({"value": 1, "time_s": 0})").status, 409);  // has passed
  const HttpReply fly = post(R"({"command":"fly"})");
  EXPECT_EQ(fly.status, 422);
  EXPECT_TRUE(Json::parse(fly.body)["detail"].get<std::string>().starts_with("the command: 'fly', expected one of "))
      << fly.body;
  EXPECT_EQ(post(R"({"command":"step"})").status, 422);
  EXPECT_EQ(post(R"({"command":"step","ticks":0})").status, 422);
  EXPECT_EQ(post(R"({"command":"step","ticks":1e300})").status, 422);
  EXPECT_EQ(post(R"({"command":"pause","ticks":1})").status, 422);
  EXPECT_EQ(post(R"({"command":"set","values":{}})").status, 422);
  EXPECT_EQ(post(R"({})").status, 422);
  s.stop();
  EXPECT_EQ(s.master->summary().influence.count(), 0);
}

TEST(GatewayLive, PausesStepsAndStops) {
  Subject s;
  const auto command = [&](const std::string& body) { return Json::parse(s.call("POST", "/run/commands", body).body); };
  const Json paused = command(R"({"command":"pause"})");
  EXPECT_EQ(paused["phase"], "paused");
  EXPECT_EQ(s.get("/run")["tick"], paused["tick"]);
  EXPECT_EQ(s.get("/run/values?names=p.steps")["values"]["p.steps"], paused["tick"]);  // also while it is paused
  const Json stepped = command(R"({"command":"step","ticks":5})");
  EXPECT_EQ(stepped["tick"], paused["tick"].get<std::int64_t>() + 5);
  EXPECT_TRUE(within_patience([&] { return s.get("/run")["phase"] == "paused"; }));
  EXPECT_EQ(s.get("/run")["tick"], stepped["tick"]);
  command(R"({"command":"stop"})");
  EXPECT_TRUE(within_patience([&] { return s.get("/run")["phase"] == "ended"; }));
  EXPECT_EQ(s.call("POST", "/run/commands", R"({"command":"resume"})").status, 409);
  EXPECT_EQ(s.call("GET", "/run/values?names=p.steps").status, 409);
}

TEST(GatewayLive, StreamsTheNewestValuesAndTheEndOfTheRun) {
  Subject s;
  RawClient client(s.server->port());
  client.send(http_request("GET", "/run/stream?names=p.steps,g.gain&rate_hz=100"));
  EXPECT_EQ(next_event(client, "run")["phase"], "running");
  std::int64_t last = -1;
  for (int i = 0; i < 10; ++i) {
    const Json sample = next_event(client, "sample");
    ASSERT_TRUE(sample.is_object());
    EXPECT_EQ(sample["values"]["p.steps"], sample["tick"]);
    EXPECT_GT(sample["tick"].get<std::int64_t>(), last);
    last = sample["tick"];
  }
  s.stop();
  // The last tick comes before the end, at which a client may stop reading; perhaps it was the last one above.
  ASSERT_TRUE(client.receive_until(R"("phase":"ended")"));
  const std::string& all = client.received();
  const std::size_t sample = all.rfind("event: sample");
  if (sample != std::string::npos) {
    EXPECT_LT(sample, all.rfind("event: run"));
    const std::size_t data = all.find("data: ", sample) + 6;
    last = Json::parse(all.substr(data, all.find('\n', data) - data))["tick"];
  }
  EXPECT_EQ(s.get("/run")["tick"], last);
}

TEST(GatewayLive, StreamsAChangeAtOnceAlsoWhereMessagesAreRare) {
  Subject s;
  RawClient client(s.server->port());
  client.send(http_request("GET", "/run/stream?names=g.gain&rate_hz=0.01"));
  ASSERT_TRUE(next_event(client, "sample").is_object());
  ASSERT_EQ(s.call("PUT", "/run/tunables/g.gain", R"({"value": 2.5})").status, 200);
  // The next message would be due after 100 s: the client gives up before.
  const Json sample = next_event(client, "sample");
  ASSERT_TRUE(sample.is_object());
  EXPECT_EQ(sample["values"]["g.gain"], 2.5);
}

TEST(GatewayLive, StreamsTheSameMessagesOverAWebSocket) {
  Subject s;
  RawClient client(s.server->port());
  // Key and answer of RFC 6455, 1.3.
  client.send(http_request("GET", "/run/stream?names=p.steps&rate_hz=100", "",
                           "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                           "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"));
  ASSERT_TRUE(client.receive_until("\r\n\r\n"));
  EXPECT_THAT(client.received(), HasSubstr("HTTP/1.1 101 "));
  EXPECT_THAT(client.received(), HasSubstr("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="));
  EXPECT_TRUE(client.receive_until(R"({"event":"run")"));
  EXPECT_TRUE(client.receive_until(R"({"event":"sample")"));
  s.stop();
  EXPECT_TRUE(client.receive_until(R"("phase":"ended")"));
}

TEST(GatewayLive, StreamsEveryNthTickWithoutGaps) {
  Subject s;
  RawClient client(s.server->port());
  s.call("POST", "/run/commands", R"({"command":"pause"})");
  client.send(http_request("GET", "/run/stream?names=p.steps&every=5&rate_hz=200"));
  ASSERT_TRUE(next_event(client, "samples").is_object());
  const std::int64_t first = s.get("/run")["tick"];
  s.call("POST", "/run/commands", R"({"command":"step","ticks":50})");
  std::vector<std::int64_t> ticks;
  while (ticks.size() < 10) {
    const Json samples = next_event(client, "samples");
    ASSERT_TRUE(samples.is_object());
    EXPECT_EQ(samples["lost"], 0);
    for (const Json& sample : samples["samples"]) ticks.push_back(sample["tick"]);
  }
  for (std::size_t i = 0; i < ticks.size(); ++i) EXPECT_EQ(ticks[i], (first / 5 + 1 + std::int64_t(i)) * 5);
}

TEST(GatewayLive, ASlowClientGetsTheNewestValuesLaterAndDelaysNobody) {
  Subject s;
  RawClient slow(s.server->port(), 2048);
  slow.send(http_request("GET", "/run/stream?names=g.u,g.y,p.steps,p.t,p.now&rate_hz=200"));
  ASSERT_TRUE(slow.receive_until("event: sample"));
  RawClient quick(s.server->port());
  quick.send(http_request("GET", "/run/stream?names=p.steps&rate_hz=200"));
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(next_event(quick, "sample").is_object());
  const std::int64_t before = s.get("/run")["tick"];
  Json sample;
  do {
    sample = next_event(slow, "sample");
    ASSERT_TRUE(sample.is_object());
  } while (sample["tick"].get<std::int64_t>() < before);
  EXPECT_EQ(sample["values"]["p.steps"], sample["tick"]);
}

TEST(GatewayLive, RefusesWrongStreams) {
  Subject s;
  EXPECT_EQ(s.call("GET", "/run/stream").status, 400);
  EXPECT_EQ(s.call("GET", "/run/stream?names=x").status, 422);
  EXPECT_EQ(s.call("GET", "/run/stream?names=m.string").status, 422);
  EXPECT_EQ(s.call("GET", "/run/stream?names=g.y&rate_hz=1e9").status, 400);
  EXPECT_EQ(s.call("GET", "/run/stream?names=g.y&rate_hz=nan").status, 400);
  EXPECT_EQ(s.call("GET", "/run/stream?names=g.y&every=-1").status, 400);
}

TEST(GatewayLive, TellsWantOfRoomFromWrongRequests) {
  Subject s;
  const auto run = s.live.run();
  std::vector<std::unique_ptr<bus::LiveRun::Control>> controls;
  while (controls.size() < bus::LiveRun::Calls::kMaxClients) controls.push_back(std::make_unique<bus::LiveRun::Control>(run));
  const HttpReply full = s.call("PUT", "/run/tunables/g.gain", R"({"value":1})");
  EXPECT_EQ(full.status, 503) << full.body;
  controls.clear();
  EXPECT_EQ(s.call("PUT", "/run/tunables/g.gain", R"({"value":1})").status, 200);
  // One client leaves room for others: 256 names of seven values are too many.
  std::string names = "robot.y";
  for (int i = 1; i < 256; ++i) names += ",robot.y";
  EXPECT_THAT(s.call("GET", "/run/values?names=" + names).body, HasSubstr("1792 values, expected at most 1024"));
  EXPECT_EQ(s.call("GET", "/run/stream?names=" + names).status, 422);
}

TEST(GatewayLive, LeavesPlacesForOthersWhateverOneClientWatches) {
  Subject s;
  std::string names = "robot.y";
  for (int i = 1; i < 146; ++i) names += ",robot.y";  // 1022 values
  std::vector<std::unique_ptr<RawClient>> greedy;
  for (int i = 0; i < 3; ++i) {
    greedy.push_back(std::make_unique<RawClient>(s.server->port()));
    greedy.back()->send(http_request("GET", "/run/stream?names=" + names));
    ASSERT_EQ(next_event(*greedy.back(), "run")["phase"], "running") << i;
  }
  // Of 4096 places 3066 are taken: a client may have half of the others.
  const HttpReply full = s.call("GET", "/run/stream?names=" + names);
  EXPECT_EQ(full.status, 429) << full.body;
  EXPECT_EQ(full.field("Retry-After"), "1");
  EXPECT_THAT(full.body, HasSubstr("more than the 515 values"));
  EXPECT_EQ(s.call("GET", "/run/values?names=" + names).status, 429);
  RawClient modest(s.server->port());
  modest.send(http_request("GET", "/run/stream?names=robot.y,g.gain"));
  EXPECT_EQ(next_event(modest, "run")["phase"], "running");
  EXPECT_EQ(s.call("GET", "/run/values?names=robot.y").status, 200);
  greedy.clear();
  EXPECT_TRUE(within_patience([&] { return s.call("GET", "/run/values?names=" + names).status == 200; }));
}

TEST(GatewayLive, SharesGiveEachOwnerAtMostHalfOfWhatOthersLeave) {
  std::size_t permitted = 0;
  std::shared_ptr<Shares::Share> late;
  {
    const Shares shares(100);
    auto a = shares.take("a", 30, permitted), more = shares.take("a", 20, permitted);
    ASSERT_TRUE(a && more);
    EXPECT_FALSE(shares.take("a", 1, permitted));
    EXPECT_EQ(permitted, 50u);
    EXPECT_FALSE(shares.take("b", 26, permitted));
    EXPECT_EQ(permitted, 25u);
    const auto b = shares.take("b", 25, permitted);
    ASSERT_TRUE(b);
    EXPECT_TRUE(shares.take("c", 12, permitted)) << "and given back at once";
    EXPECT_TRUE(shares.take("d", 12, permitted));
    a.reset();
    EXPECT_FALSE(shares.take("a", 18, permitted));
    EXPECT_EQ(permitted, 37u);
    late = shares.take("a", 17, permitted);
    EXPECT_TRUE(late);
  }
  late.reset();  // after the end of the shares
}

TEST(GatewayLive, LetsClientsWatchButNotCommandWhereCommandsAreNotPermitted) {
  Subject s;
  s.live.permit_commands(false);
  const HttpReply put = s.call("PUT", "/run/tunables/g.gain", R"({"value": 2.5})");
  EXPECT_EQ(put.status, 403);
  EXPECT_THAT(put.body, HasSubstr("takes no commands"));
  EXPECT_EQ(s.call("POST", "/run/commands", R"({"command":"stop"})").status, 403);
  EXPECT_EQ(s.call("POST", "/run/commands", R"({"command":"set","values":{"g.gain":1}})").status, 403);
  EXPECT_EQ(s.get("/run")["phase"], "running");
  EXPECT_NE(s.get("/run/values?names=g.gain")["values"]["g.gain"], 2.5);
  EXPECT_EQ(s.get("/run")["changes"], 0);
}

TEST(GatewayLive, FillsRequestsToServicesWithThePresentPosture) {
  Subject s;
  ASSERT_EQ(s.call("PUT", "/run/tunables/robot.u", R"({"value":[0,1,2,3,4,5,6]})").status, 200);
  using Ordered = nlohmann::ordered_json;
  Ordered request = Ordered::parse(R"({"service":"energy","from":"run","from_signal":"robot.y","T_s":2})");
  // robot.y holds after the tick that began with the values.
  EXPECT_TRUE(within_patience([&] { return s.get("/run/values?names=robot.y")["values"]["robot.y"][6] == 6; }));
  s.live.fill(request);
  EXPECT_EQ(request.dump(), R"({"service":"energy","from_q_rad":[0.0,1.0,2.0,3.0,4.0,5.0,6.0],"T_s":2})");
  const auto refusal = [&](const char* text) {
    Ordered wrong = Ordered::parse(text);
    try {
      s.live.fill(wrong);
    } catch (const http::Refusal& r) {
      return r.problem.detail;
    }
    return std::string();
  };
  EXPECT_EQ(refusal(R"({"from":"run"})"), "no component of the run has an output q, expected from_signal");
  EXPECT_EQ(refusal(R"({"from":"run","from_signal":"robot.z"})"), "there is no signal 'robot.z'; did you mean 'robot.u'?");
  EXPECT_EQ(refusal(R"({"from":"run","from_q_rad":[1]})"), "is given beside from_q_rad, expected one of the two");
  EXPECT_EQ(refusal(R"({"from_signal":"robot.y"})"), "needs the member \"from\": \"run\"");
  EXPECT_EQ(refusal(R"({"from":"run","from_q":[1]})"), "is given beside from_q, expected one of the two");
  EXPECT_EQ(refusal(R"({"from_q_rad":[1]})"), "");
  // A robot with prismatic joints has another name for it.
  request = Ordered::parse(R"({"from":"run","from_signal":"robot.y[7]"})");
  s.live.fill(request, [](const Ordered&) { return "from_q"; });
  EXPECT_EQ(request.dump(), R"({"from_q":[6.0]})");
}

}  // namespace
}  // namespace cotwin::gateway::live::live_test
