// The gateway's HTTP server in process, with a client on raw sockets that can send anything.
#include "components/gateway/http/server.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <future>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "models/foundation/support/error.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/http_client.h"
#include "tests/support/patience.h"

namespace cotwin::gateway::http::server_test {
namespace {

using ::testing::HasSubstr;
using testing::http_call;
using testing::http_request;
using testing::HttpReply;
using testing::RawClient;
using testing::within_patience;

Route route(const std::string& method, const std::string& pattern) {
  Route r;
  r.method = method;
  r.pattern = pattern;
  return r;
}

/// A server with routes for the tests.
struct Subject {
  explicit Subject(ServerOptions options = {}) {
    Route hello = route("GET", "/hello");
    hello.parameters = {{"name", "query", "who is greeted"}};
    router.add(hello, [](const Request& r) {
      Response response;
      response.body =
          "{\"hello\":\"" + (r.query_value("name") == nullptr ? std::string("you") : *r.query_value("name")) + "\"}";
      return response;
    });
    Route echo = route("POST", "/echo");
    echo.takes = "Any";
    echo.slow = true;
    router.add(echo, [](const Request& r) {
      Response response;
      response.body = r.body;
      return response;
    });
    Route change = route("PUT", "/things/{id}");
    change.takes = "Any";
    change.scope = Scope::kTune;
    router.add(change, [](const Request& r) {
      Response response;
      response.body = nlohmann::json{{"id", r.part("id")}}.dump();
      return response;
    });
    Route fails = route("GET", "/fails");
    router.add(fails, [](const Request&) -> Response { throw Error("/q", "is 7, expected 8"); });
    Route events = route("GET", "/events");
    events.gives = "text/event-stream";
    events.ticket = true;
    router.add(events, [this](const Request&) {
      Response response;
      response.stream = [this](const std::shared_ptr<Stream>& stream) {
        stream->on_close([this] { ++closed; });
        const std::lock_guard lock(mutex);
        streams.push_back(stream);
      };
      return response;
    });
    Route silent = route("GET", "/silent");
    router.add_later(silent, [](const Request&, const Reply&) {});
    Route big = route("GET", "/big");
    router.add(big, [](const Request&) {
      Response response;
      response.body.assign(64 << 20, 'x');
      return response;
    });
    if (options.addresses.empty()) options.addresses = {"127.0.0.1"};
    options.authority.hosts.push_back("localhost");
    server.emplace(std::move(options), router);
  }
  ~Subject() { server->stop(); }

  std::uint16_t port() const { return server->port(); }
  std::shared_ptr<Stream> stream(std::size_t i) {
    const std::lock_guard lock(mutex);
    return i < streams.size() ? streams[i] : nullptr;
  }

  Router router;
  std::mutex mutex;
  std::vector<std::shared_ptr<Stream>> streams;
  std::atomic<int> closed = 0;
  std::optional<Server> server;
};

TEST(GatewayServer, AnswersRequestsOnOneConnectionInTheirOrder) {
  Subject subject;
  RawClient client(subject.port());
  // Pipelined: both are sent before the first answer is read.
  ASSERT_TRUE(client.send(http_request("GET", "/hello?name=a%20b") + http_request("POST", "/echo", "[1]") +
                          http_request("GET", "/hello")));
  const HttpReply first = client.reply(), second = client.reply(), third = client.reply();
  EXPECT_EQ(first.status, 200);
  EXPECT_EQ(first.body, R"({"hello":"a b"})");
  EXPECT_EQ(first.field("Content-Type"), "application/json");
  EXPECT_EQ(second.body, "[1]");
  EXPECT_EQ(third.body, R"({"hello":"you"})");
}

// What is read of a long body also has the beginning of the next request.
TEST(GatewayServer, AnswersLongBodiesOnOneConnectionInTheirOrder) {
  Subject subject;
  RawClient client(subject.port());
  std::string all;
  std::vector<std::string> bodies;
  for (const std::size_t size : {40'000, 70'000, 3, 49'000, 300'000, 48'500, 66'000, 1'000'000, 1, 47'000}) {
    bodies.push_back("\"" + std::string(size, static_cast<char>('a' + bodies.size())) + "\"");
    all += http_request("POST", "/echo", bodies.back());
  }
  std::thread sends([&] { client.send(all); });
  for (const std::string& body : bodies) {
    const HttpReply reply = client.reply();
    EXPECT_EQ(reply.status, 200);
    EXPECT_EQ(reply.body, body) << body.size();
  }
  sends.join();
}

TEST(GatewayServer, SendsEventsToAllWhoListen) {
  Subject subject;
  RawClient a(subject.port()), b(subject.port());
  a.send(http_request("GET", "/events"));
  b.send(http_request("GET", "/events"));
  ASSERT_TRUE(within_patience([&] { return subject.stream(1) != nullptr; }));
  for (std::size_t i = 0; i < 2; ++i) EXPECT_TRUE(subject.stream(i)->send({"job", "7", "{\"state\":\n3}"}));
  for (RawClient* client : {&a, &b}) {
    ASSERT_TRUE(client->receive_until("\n\n"));
    EXPECT_THAT(client->received(), HasSubstr("Content-Type: text/event-stream\r\n"));
    EXPECT_THAT(client->received(), HasSubstr("event: job\nid: 7\ndata: {\"state\":\ndata: 3}\n\n"));
  }
}

TEST(GatewayServer, SendsOnlyTheHeaderOfAStreamToOneWhoAsksForTheHeader) {
  Subject subject;
  RawClient client(subject.port());
  client.send(http_request("HEAD", "/events"));
  ASSERT_TRUE(client.ended());
  EXPECT_THAT(client.received(), HasSubstr("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(client.received(), HasSubstr("Content-Type: text/event-stream\r\n"));
  EXPECT_TRUE(client.received().ends_with("\r\n\r\n")) << client.received();
  EXPECT_EQ(subject.stream(0), nullptr);
  EXPECT_EQ(subject.server->counts().streams, 0u);
}

TEST(GatewayServer, NamesWhatIsWrongWithARequest) {
  ServerOptions options;
  options.limits.body_bytes = 1000;
  options.limits.header_bytes = 2000;
  Subject subject(std::move(options));
  const std::string host = "Host: localhost\r\n", json = "Content-Type: application/json\r\n";
  struct Case {
    std::string request;
    int status;
    const char* what;
  };
  const std::vector<Case> cases = {
      {"GET /hello HTTP/1.0\r\n" + host + "\r\n", 505, "not HTTP/1.1"},
      {"GET /hello HTTP/1.1\r\n\r\n", 400, "0 fields Host"},
      {"GET /hello HTTP/1.1\r\n" + host + host + "\r\n", 400, "2 fields Host"},
      {"GET /hello HTTP/1.1\r\nHost: evil.example\r\n\r\n", 421,
       "a name of cotwin serve --host (parameter hosts of unit:gateway)"},
      {"GET http://evil.example/hello HTTP/1.1\r\n" + host + "\r\n", 421, "not one of this gateway's names"},
      {"GET /hello HTTP/1.1\r\n" + host + "Origin: https://evil.example\r\n\r\n", 403,
       "expected one of cotwin serve --origin (parameter origins of unit:gateway)"},
      {"GET /hello HTTP/1.1\r\n" + host + "Origin: null\r\n\r\n", 403, "origin"},
      {"GET /../etc/passwd HTTP/1.1\r\n" + host + "\r\n", 400, "'..'"},
      {"GET /%2e%2e/etc HTTP/1.1\r\n" + host + "\r\n", 400, "'..'"},
      {"GET /things/..%2fetc HTTP/1.1\r\n" + host + "\r\n", 400, "not allowed"},
      {"GET /things/..%2Fetc HTTP/1.1\r\n" + host + "\r\n", 400, "not allowed"},
      {"GET /things/a%00b HTTP/1.1\r\n" + host + "\r\n", 400, "not allowed"},
      {"GET //hello HTTP/1.1\r\n" + host + "\r\n", 400, "segment ''"},
      {"GET hello HTTP/1.1\r\n" + host + "\r\n", 400, "not a path"},
      {"GET /hello?a=%f HTTP/1.1\r\n" + host + "\r\n", 400, "query is damaged"},
      {"GET /hello?nam=a HTTP/1.1\r\n" + host + "\r\n", 400, "the query has 'nam', expected name"},
      {"GET /hello?name=a&name=b HTTP/1.1\r\n" + host + "\r\n", 400, "the query has 'name' twice"},
      {"GET /fails?x HTTP/1.1\r\n" + host + "\r\n", 400, "expected no query"},
      {"GET /nothing HTTP/1.1\r\n" + host + "\r\n", 404, "/nothing"},
      {"DELETE /hello HTTP/1.1\r\n" + host + "\r\n", 405, "expected GET, HEAD"},
      {"BREW /hello HTTP/1.1\r\n" + host + "\r\n", 501, "method"},
      {"OPTIONS /hello HTTP/1.1\r\n" + host + "\r\n", 405, "named origins"},
      {"GET /hello HTTP/1.1\r\n" + host + "Accept: text/html\r\n\r\n", 406, "application/json"},
      {"POST /echo HTTP/1.1\r\n" + host + "Content-Length: 2\r\n\r\n{}", 415, "Content-Type"},
      {"POST /echo HTTP/1.1\r\n" + host + "Content-Type: text/plain\r\nContent-Length: 2\r\n\r\n{}", 415, "Content-Type"},
      {"POST /echo HTTP/1.1\r\n" + host + json + "Content-Encoding: gzip\r\nContent-Length: 2\r\n\r\n{}", 415,
       "Content-Encoding"},
      {"GET /hello HTTP/1.1\r\n" + host + "Content-Length: 2\r\n\r\n{}", 415, "no body"},
      {"POST /echo HTTP/1.1\r\n" + host + json + "Content-Length: 100000000\r\n\r\n", 413, "body is longer"},
      {"POST /echo HTTP/1.1\r\n" + host + json + "Content-Length: 99999999999999999999999\r\n\r\n", 400, "not HTTP/1.1"},
      {"POST /echo HTTP/1.1\r\n" + host + json + "Content-Length: -1\r\n\r\n", 400, "not HTTP/1.1"},
      {"POST /echo HTTP/1.1\r\n" + host + json + "Content-Length: 2\r\nContent-Length: 3\r\n\r\n{}", 400, "not HTTP/1.1"},
      {"POST /echo HTTP/1.1\r\n" + host + json + "Content-Length: 2\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 400,
       "not HTTP/1.1"},
      {"POST /echo HTTP/1.1\r\n" + host + json + "Transfer-Encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFFF\r\n", 400,
       "not HTTP/1.1"},
      {"POST /echo HTTP/1.1\r\n" + host + json + "Transfer-Encoding: chunked\r\n\r\n400\r\n" + std::string(0x400, 'x') +
           "\r\n0\r\n\r\n",
       413, "body is longer"},
      {"POST /echo HTTP/1.1\r\n" + host + json + "Expect: wonders\r\nContent-Length: 2\r\n\r\n{}", 417, "100-continue"},
      {"GET /hello HTTP/1.1\r\n" + host + "X: " + std::string(3000, 'x') + "\r\n\r\n", 431, "header is longer"},
      {"GET /" + std::string(1 << 17, 'x') + " HTTP/1.1\r\n" + host + "\r\n", 431, "header is longer"},
      {std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", 15), 400, "not HTTP/1.1"},
      {"GET /fails HTTP/1.1\r\n" + host + "\r\n", 422, "/q: is 7, expected 8"},
      {"GET /silent HTTP/1.1\r\n" + host + "\r\n", 500, "was not answered"},
  };
  for (const Case& c : cases) {
    RawClient client(subject.port());
    client.send(c.request);
    const HttpReply reply = client.reply();
    EXPECT_EQ(reply.status, c.status) << c.request.substr(0, 200) << reply.body;
    EXPECT_EQ(reply.field("Content-Type"), "application/problem+json") << c.request.substr(0, 200);
    EXPECT_THAT(reply.body, HasSubstr(c.what)) << c.request.substr(0, 200);
    EXPECT_EQ(nlohmann::json::parse(reply.body, nullptr, false).value("status", 0), c.status) << reply.body;
  }
  EXPECT_EQ(http_call(subject.port(), "GET", "/hello").status, 200) << "the server is still there";
}

TEST(GatewayServer, AcceptsChunksAndWaitsForTheBodyThatItPromised) {
  Subject subject;
  RawClient client(subject.port());
  const std::string head = "POST /echo HTTP/1.1\r\nHost: 127.0.0.1:9\r\nContent-Type: application/json; charset=utf-8\r\n";
  client.send(head + "Expect: 100-continue\r\nContent-Length: 3\r\n\r\n");
  ASSERT_TRUE(client.receive_until("HTTP/1.1 100 Continue\r\n\r\n"));
  client.received().clear();
  client.send("[1]");
  EXPECT_EQ(client.reply().body, "[1]");
  client.send(head + "Transfer-Encoding: chunked\r\n\r\n2;a=b\r\n[2\r\n1\r\n]\r\n0\r\nTrailer: x\r\n\r\n");
  EXPECT_EQ(client.reply().body, "[2]");
  client.send(http_request("HEAD", "/hello"));
  const HttpReply head_reply = client.reply(true);
  EXPECT_EQ(head_reply.status, 200);
  EXPECT_EQ(head_reply.field("Content-Length"), "15");
  client.send(http_request("PUT", "/things/a%20b", "{}"));
  EXPECT_EQ(client.reply().body, R"({"id":"a b"})");
}

TEST(GatewayServer, ClosesConnectionsThatAreTooSlow) {
  ServerOptions options;
  options.limits.request = 0.2;
  options.limits.idle = 0.3;
  Subject subject(std::move(options));
  RawClient slow(subject.port()), half(subject.port()), idle(subject.port());
  slow.send("GET /hello HTTP/1.1\r\nHost: lo");
  EXPECT_EQ(slow.reply().status, 408);
  half.send("POST /echo HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 10\r\n\r\n[");
  EXPECT_EQ(half.reply().status, 408);
  EXPECT_TRUE(idle.ended());
  EXPECT_EQ(idle.received(), "");
}

TEST(GatewayServer, RefusesMoreConnectionsThanAllowedAndServesAgainLater) {
  ServerOptions options;
  options.limits.connections = 4;
  Subject subject(std::move(options));
  std::vector<std::unique_ptr<RawClient>> clients;
  for (int i = 0; i < 4; ++i) {
    clients.push_back(std::make_unique<RawClient>(subject.port()));
    clients.back()->send(http_request("GET", "/events"));
    ASSERT_EQ(clients.back()->reply(true).status, 200);
  }
  RawClient more(subject.port());
  const HttpReply busy = more.reply();
  EXPECT_EQ(busy.status, 503);
  EXPECT_EQ(busy.field("Retry-After"), "1");
  EXPECT_EQ(nlohmann::json::parse(busy.body)["detail"], "too many connections");
  clients.clear();
  ASSERT_TRUE(within_patience([&] { return subject.server->counts().open == 0; }));
  EXPECT_EQ(http_call(subject.port(), "GET", "/hello").status, 200);
}

TEST(GatewayServer, DropsAWatcherThatDoesNotReadAndKeepsTheOthers) {
  ServerOptions options;
  options.limits.queue_bytes = 64 << 10;
  Subject subject(std::move(options));
  RawClient lazy(subject.port(), 4096), eager(subject.port());
  lazy.send(http_request("GET", "/events"));
  ASSERT_TRUE(within_patience([&] { return subject.stream(0) != nullptr; }));
  eager.send(http_request("GET", "/events"));
  ASSERT_TRUE(within_patience([&] { return subject.stream(1) != nullptr; }));
  const std::string data = "\"" + std::string(8000, 'x') + "\"";
  int sent = 0;
  while (subject.stream(0)->send({"big", "", data}) && sent < 100'000) {
    ++sent;
    EXPECT_LE(subject.stream(0)->waiting(), 64u << 10);
  }
  EXPECT_LT(sent, 100'000) << "what waits for a client is bounded";
  EXPECT_TRUE(subject.stream(0)->closed());
  ASSERT_TRUE(within_patience([&] { return subject.closed == 1; }));
  EXPECT_EQ(subject.server->counts().dropped, 1u);
  EXPECT_TRUE(subject.stream(1)->send({"small", "1", "{}"}));
  EXPECT_TRUE(eager.receive_until("event: small\nid: 1\ndata: {}\n\n"));
}

TEST(GatewayServer, EndsAResponseThatNobodyReads) {
  ServerOptions options;
  options.limits.response = 0.2;
  Subject subject(std::move(options));
  RawClient lazy(subject.port(), 4096);
  lazy.send(http_request("GET", "/big"));
  ASSERT_TRUE(within_patience([&] { return subject.server->counts().requests == 1; }));
  EXPECT_TRUE(within_patience([&] { return subject.server->counts().open == 0; }));
}

TEST(GatewayServer, SendsHeartbeatsAndNoticesThatAWatcherHasGone) {
  ServerOptions options;
  options.limits.heartbeat = 0.05;
  Subject subject(std::move(options));
  {
    RawClient client(subject.port());
    client.send(http_request("GET", "/events"));
    ASSERT_TRUE(client.receive_until("event: heartbeat\ndata: {}\n\nevent: heartbeat\n"));
  }
  EXPECT_TRUE(within_patience([&] { return subject.closed == 1; }));
  EXPECT_FALSE(subject.stream(0)->send({"late", "", "{}"}));
}

TEST(GatewayServer, StopsWhileClientsWaitWatchAndSendHalfARequest) {
  auto subject = std::make_unique<Subject>();
  RawClient watching(subject->port()), half(subject->port()), idle(subject->port());
  watching.send(http_request("GET", "/events"));
  half.send("GET /he");
  ASSERT_TRUE(within_patience([&] { return subject->stream(0) != nullptr; }));
  const std::shared_ptr<Stream> stream = subject->stream(0);
  subject->server->stop();
  EXPECT_FALSE(stream->send({"late", "", "{}"}));
  subject.reset();
  EXPECT_TRUE(watching.ended());
  EXPECT_TRUE(half.ended());
  EXPECT_TRUE(idle.ended());
  EXPECT_FALSE(stream->send({"later", "", "{}"})) << "also when the server is gone";
}

TEST(GatewayServer, AnswersWhatItIsDoingBeforeItStops) {
  std::promise<void> begun, go;
  Route slow = route("POST", "/slow");
  slow.takes = "Any";
  slow.slow = true;
  Router router;
  router.add(slow, [&](const Request&) {
    begun.set_value();
    go.get_future().wait();
    return Response{};
  });
  ServerOptions options;
  options.addresses = {"127.0.0.1"};
  options.authority.hosts.push_back("localhost");
  Server server(std::move(options), router);
  RawClient client(server.port());
  client.send(http_request("POST", "/slow", "1"));
  begun.get_future().wait();
  std::thread stops([&] { server.stop(); });
  std::this_thread::sleep_for(std::chrono::milliseconds(50));  // so that it has begun; if not, the test passes, too
  go.set_value();
  EXPECT_EQ(client.reply().status, 200);
  stops.join();
}

TEST(GatewayAccess, AnswersPagesOfNamedOriginsOnly) {
  ServerOptions options;
  options.authority.origins = {"https://mes.example:8443"};
  Subject subject(std::move(options));
  const HttpReply named = http_call(subject.port(), "GET", "/hello", "", "Origin: https://mes.example:8443\r\n");
  EXPECT_EQ(named.status, 200);
  EXPECT_EQ(named.field("Access-Control-Allow-Origin"), "https://mes.example:8443");
  const HttpReply own = http_call(subject.port(), "GET", "/hello", "", "Origin: http://localhost\r\n");
  EXPECT_EQ(own.status, 200);
  EXPECT_EQ(own.field("Access-Control-Allow-Origin"), "");
  EXPECT_EQ(http_call(subject.port(), "GET", "/hello", "", "Origin: http://localhost:3000\r\n").status, 403);
  EXPECT_EQ(http_call(subject.port(), "GET", "/hello", "", "Origin: https://mes.example\r\n").status, 403);
  const HttpReply asked = http_call(subject.port(), "OPTIONS", "/things/1", "",
                                    "Origin: https://mes.example:8443\r\nAccess-Control-Request-Method: PUT\r\n");
  EXPECT_EQ(asked.status, 204);
  EXPECT_THAT(asked.field("Access-Control-Allow-Headers"), HasSubstr("Authorization"));
}

TEST(GatewayAccess, ReadsHostsStrictly) {
  using access::host_of;
  EXPECT_EQ(host_of("LocalHost:8080"), "localhost");
  EXPECT_EQ(host_of("[::1]:80"), "[::1]");
  EXPECT_EQ(host_of("127.0.0.1"), "127.0.0.1");
  for (const char* wrong : {"", ":80", "a:b", "a:", "a:123456", "a b", "a/b", "user@a", "[::1", "[::1]x", "a,b", "[::1]:70000"})
    EXPECT_FALSE(host_of(wrong)) << wrong;
}

TEST(GatewayServer, StartsBeyondLoopbackOnlyWithTlsAndTokens) {
  Router router;
  const auto error = [&](ServerOptions options) {
    options.place = "unit:gateway";
    return testing::error_of([&] { const Server server(std::move(options), router); });
  };
  ServerOptions open;
  open.addresses = {"0.0.0.0"};
  EXPECT_THAT(error(open),
              HasSubstr("unit:gateway: address 0.0.0.0 can be reached from other machines, expected a certificate, a key and"));
  const testing::SecretFile tokens("read aaaaaaaaaaaaaaaaaaaa");
  open.token_file = tokens.path();
  EXPECT_THAT(error(open), HasSubstr("can be reached from other machines"));
  ServerOptions half;
  half.addresses = {"127.0.0.1"};
  half.certificate = "cert.pem";
  EXPECT_THAT(error(half), HasSubstr("expected both or neither"));
  ServerOptions name;
  name.addresses = {"example.org"};
  EXPECT_THAT(error(name), HasSubstr("'example.org' is no IPv4 or IPv6 address"));
  Subject subject;
  ServerOptions taken;
  taken.addresses = {"127.0.0.1"};
  taken.port = subject.port();
  EXPECT_THAT(error(taken),
              HasSubstr("cannot listen at 127.0.0.1:" + std::to_string(subject.port()) + ": bind: Address already in use"));
}

TEST(GatewayRouter, PrefersNamesToParts) {
  Router router;
  const auto text = [](const std::string& body) {
    return [body](const Request&) {
      Response response;
      response.body = body;
      return response;
    };
  };
  router.add("GET", "/a/{x}", text("part"));
  router.add("GET", "/a/b", text("name"));
  router.add("PUT", "/a/{y}", text("put"));
  Request request;
  std::string host;
  request.method = "GET";
  ASSERT_EQ(read_target("/a/b", request, host), "");
  EXPECT_EQ(std::get<0>(router.find(request))->route.pattern, "/a/b");
  ASSERT_EQ(read_target("/a/c%C3%A9?x=1+2&y", request, host), "");
  EXPECT_EQ(std::get<0>(router.find(request))->route.pattern, "/a/{x}");
  EXPECT_EQ(request.part("x"), "c\xC3\xA9");
  EXPECT_EQ(*request.query_value("x"), "1 2");
  EXPECT_EQ(*request.query_value("y"), "");
  request.method = "DELETE";
  EXPECT_EQ(std::get<1>(router.find(request)).fields.front().value, "GET, HEAD, PUT");
  for (const char* wrong : {"", "a", "/a//b", "/a/{", "/{}", "/a b", "/.."})
    EXPECT_NE(testing::error_of([&] { router.add("GET", wrong, text("")); }), "") << wrong;
  EXPECT_THAT(testing::error_of([&] { router.add("GET", "/a/{z}", text("")); }), HasSubstr("is there already"));
}

TEST(GatewayMessage, ReadsAcceptAndPrefer) {
  EXPECT_TRUE(accepts("text/html, application/*;q=0.8", "application/json"));
  EXPECT_TRUE(accepts("*/*", "text/event-stream"));
  EXPECT_FALSE(accepts("application/json;q=0", "application/json"));
  EXPECT_FALSE(accepts("", "application/json"));
  EXPECT_EQ(preference("respond-async, wait=5", "wait"), "5");
  EXPECT_EQ(preference("Respond-Async", "respond-async"), "");
  EXPECT_FALSE(preference("return=minimal", "wait"));
}

}  // namespace
}  // namespace cotwin::gateway::http::server_test
