// No client delays the others: fair shares of threads, connections and time, and ends for WebSockets that do not read.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <poll.h>

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "components/gateway/http/fair_pool.h"
#include "components/gateway/http/server.h"
#include "tests/support/files.h"
#include "tests/support/http_client.h"
#include "tests/support/patience.h"

namespace cotwin::gateway::http::fairness_test {
namespace {

using ::testing::HasSubstr;
using testing::http_call;
using testing::http_request;
using testing::HttpReply;
using testing::RawClient;
using testing::within_patience;

/// Holds up those who pass until it is opened.
class Barrier {
 public:
  void pass() {
    std::unique_lock lock(mutex_);
    ++waiting_;
    opened_.wait(lock, [&] { return open_; });
  }
  void open() {
    const std::lock_guard lock(mutex_);
    open_ = true;
    opened_.notify_all();
  }
  int waiting() {
    const std::lock_guard lock(mutex_);
    return waiting_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable opened_;
  bool open_ = false;
  int waiting_ = 0;
};

FairPool::Options options_of(std::size_t threads, std::size_t many, std::size_t most) {
  FairPool::Options o;
  o.threads = threads;
  o.many = many;
  o.most = most;
  return o;
}

TEST(FairPool, BeginsATaskOfAnOwnerThatHasNoneWhileThoseOfOthersTakeLong) {
  Barrier barrier;
  std::atomic<bool> done = false;
  FairPool pool(options_of(1, 1, 4));
  for (int i = 0; i < 10; ++i) ASSERT_EQ(pool.post("greedy", [&] { barrier.pass(); }), FairPool::Verdict::kTaken);
  ASSERT_TRUE(within_patience([&] { return barrier.waiting() == 1; }));
  ASSERT_EQ(pool.post("modest", [&] { done = true; }), FairPool::Verdict::kTaken);
  EXPECT_TRUE(within_patience([&] { return done.load(); }));
  EXPECT_EQ(barrier.waiting(), 1) << "the nine others wait for a thread";
  barrier.open();
}

TEST(FairPool, GivesATaskThatHasWaitedAnotherThreadUpToALimit) {
  Barrier barrier;
  FairPool pool(options_of(1, 3, 4));
  for (int i = 0; i < 10; ++i) pool.post("one", [&] { barrier.pass(); });
  EXPECT_TRUE(within_patience([&] { return barrier.waiting() == 3; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(120));  // twice the patience: a fourth one would have begun
  EXPECT_EQ(barrier.waiting(), 3);
  std::atomic<bool> done = false;
  pool.post("other", [&] { done = true; });
  EXPECT_TRUE(within_patience([&] { return done.load(); }));
  barrier.open();
}

TEST(FairPool, TakesTheTasksOfOwnersInTurn) {
  Barrier barrier;
  std::mutex mutex;
  std::string order;
  FairPool pool(options_of(1, 1, 1));
  pool.post("first", [&] { barrier.pass(); });
  ASSERT_TRUE(within_patience([&] { return barrier.waiting() == 1; }));
  const auto note = [&](char name) {
    return [&, name] {
      const std::lock_guard lock(mutex);
      order += name;
    };
  };
  for (int i = 0; i < 3; ++i) pool.post("a", note('a'));
  pool.post("b", note('b'));
  barrier.open();
  EXPECT_TRUE(within_patience([&] {
    const std::lock_guard lock(mutex);
    return order.size() == 4;
  }));
  EXPECT_EQ(order, "abaa");
}

TEST(FairPool, PrefersTheOwnerWithFewerRunningTasks) {
  Barrier barrier;
  Barrier second;
  std::mutex mutex;
  std::string order;
  FairPool pool(options_of(2, 2, 2));
  pool.post("a", [&] { barrier.pass(); });
  pool.post("x", [&] { second.pass(); });
  ASSERT_TRUE(within_patience([&] { return barrier.waiting() == 1 && second.waiting() == 1; }));
  for (const char* owner : {"a", "a", "b", "a"}) {
    pool.post(owner, [&, owner] {
      const std::lock_guard lock(mutex);
      order += owner;
    });
  }
  second.open();
  EXPECT_TRUE(within_patience([&] {
    const std::lock_guard lock(mutex);
    return order.size() == 4;
  }));
  EXPECT_EQ(order, "baaa") << "a has one that runs";
  barrier.open();
}

TEST(FairPool, RefusesBeyondItsLimitsAndDropsWhatWaitsAtItsEnd) {
  Barrier barrier;
  FairPool::Options o = options_of(1, 1, 2);
  o.owner_waiting = 2;
  o.waiting = 3;
  std::optional<FairPool> pool(std::in_place, o);
  const auto held = std::make_shared<int>(7);
  const auto task = [&barrier, held] { barrier.pass(); };
  ASSERT_EQ(pool->post("a", task), FairPool::Verdict::kTaken);
  ASSERT_TRUE(within_patience([&] { return barrier.waiting() == 1; }));
  ASSERT_EQ(pool->post("b", task), FairPool::Verdict::kTaken);
  ASSERT_TRUE(within_patience([&] { return barrier.waiting() == 2; }));
  EXPECT_EQ(pool->post("a", task), FairPool::Verdict::kTaken);
  EXPECT_EQ(pool->post("a", task), FairPool::Verdict::kTaken);
  EXPECT_EQ(pool->post("a", task), FairPool::Verdict::kOwnerFull);
  EXPECT_EQ(pool->post("b", task), FairPool::Verdict::kTaken);
  EXPECT_EQ(pool->post("c", task), FairPool::Verdict::kFull);
  // What waits is dropped before what runs has ended: left are held, task and the two that run.
  std::thread end([&] { pool.reset(); });
  EXPECT_TRUE(within_patience([&] { return held.use_count() == 4; }));
  barrier.open();
  end.join();
  EXPECT_EQ(barrier.waiting(), 2);
  EXPECT_EQ(held.use_count(), 2);
}

/// A server with a route that takes as long as the test wants, and a quick one, both on the pool.
struct Subject {
  explicit Subject(ServerOptions options = {}) {
    const auto slow = [&](const char* pattern, Handler handler) {
      Route r;
      r.method = "GET";
      r.pattern = pattern;
      r.slow = true;
      router.add(r, std::move(handler));
    };
    slow("/long", [this](const Request&) {
      barrier.pass();
      ++finished;
      return Response{};
    });
    Route post;
    post.method = "POST";
    post.pattern = "/long";
    post.takes = "Anything";
    post.slow = true;
    router.add_schema("Anything", "{}");
    router.add(post, [this](const Request&) {
      barrier.pass();
      return Response{};
    });
    slow("/short", [](const Request&) {
      Response response;
      response.body = "{}";
      return response;
    });
    slow("/odd", [](const Request&) -> Response { throw 7; });
    Route events;
    events.method = "GET";
    events.pattern = "/events";
    events.gives = "text/event-stream";
    router.add(events, [this](const Request&) {
      Response response;
      response.stream = [this](const std::shared_ptr<Stream>& opened) {
        opened->on_close([this] { ++closed; });
        const std::lock_guard lock(mutex);
        stream = opened;
      };
      return response;
    });
    Route fails = events;
    fails.pattern = "/fails";
    router.add(fails, [](const Request&) {
      Response response;
      response.stream = [](const std::shared_ptr<Stream>&) { throw std::bad_alloc(); };
      return response;
    });
    options.addresses = {"127.0.0.1"};
    options.authority.hosts.push_back("localhost");
    options.threads = 1;
    server.emplace(std::move(options), router);
  }
  ~Subject() {
    barrier.open();
    server->stop();
  }
  std::uint16_t port() const { return server->port(); }
  std::shared_ptr<Stream> wait_for_stream() {
    std::shared_ptr<Stream> found;
    within_patience([&] {
      const std::lock_guard lock(mutex);
      found = stream;
      return found != nullptr;
    });
    return found;
  }

  Barrier barrier;
  Router router;
  std::mutex mutex;
  std::shared_ptr<Stream> stream;
  std::atomic<int> closed = 0, finished = 0;
  std::optional<Server> server;
};

TEST(GatewayFairness, LongRequestsOfOneClientDoNotDelayShortOnesOfOthers) {
  Subject subject;
  std::vector<std::unique_ptr<RawClient>> greedy;
  for (int i = 0; i < 3; ++i) {
    greedy.push_back(std::make_unique<RawClient>(subject.port()));
    greedy.back()->send(http_request("GET", "/long"));
  }
  ASSERT_TRUE(within_patience([&] { return subject.barrier.waiting() == 3; }));
  for (int i = 0; i < 20; ++i) EXPECT_EQ(http_call(subject.port(), "GET", "/short").status, 200);
  EXPECT_EQ(subject.finished, 0);
}

// Each connection of a local program has a share of its own, but long bodies have one together: many of them leave threads to others.
TEST(GatewayFairness, LongBodiesOfLocalProgramsDoNotTakeAllThreads) {
  Subject subject;
  std::vector<std::unique_ptr<RawClient>> greedy;
  for (int i = 0; i < 20; ++i) {
    greedy.push_back(std::make_unique<RawClient>(subject.port()));
    greedy.back()->send(http_request("POST", "/long", "\"" + std::string(kLongBody, 'x') + "\""));
  }
  ASSERT_TRUE(within_patience([&] { return subject.barrier.waiting() >= 1; }));
  for (int i = 0; i < 20; ++i) EXPECT_EQ(http_call(subject.port(), "GET", "/short").status, 200);
  EXPECT_LE(subject.barrier.waiting(), 7) << "the thread, and 6 more for those who have waited";
  subject.barrier.open();
  for (const auto& client : greedy) EXPECT_EQ(client->reply().status, 200);
}

TEST(GatewayFairness, AClientWithATokenIsOneOwnerOverAllItsConnections) {
  ServerOptions options;
  const testing::SecretFile tokens("read aaaaaaaaaaaaaaaaaaaa\nread bbbbbbbbbbbbbbbbbbbb");
  options.token_file = tokens.path();
  options.limits.owner_requests = 2;
  Subject subject(std::move(options));
  const std::string a = "Authorization: Bearer aaaaaaaaaaaaaaaaaaaa\r\n", b = "Authorization: Bearer bbbbbbbbbbbbbbbbbbbb\r\n";
  std::vector<std::unique_ptr<RawClient>> greedy;
  const auto ask = [&] {
    greedy.push_back(std::make_unique<RawClient>(subject.port()));
    greedy.back()->send(http_request("GET", "/long", "", a));
  };
  // 7 run: the thread and 6 more for those who have waited. 2 wait.
  for (int i = 0; i < 7; ++i) {
    ask();
    ASSERT_TRUE(within_patience([&] { return subject.barrier.waiting() == i + 1; }));
  }
  HttpReply full;
  while (full.status == 0 && greedy.size() < 30) {
    ask();
    pollfd answered = {greedy.back()->descriptor(), POLLIN, 0};
    if (::poll(&answered, 1, 200) > 0) full = greedy.back()->reply();
  }
  EXPECT_EQ(full.status, 429) << full.body;
  EXPECT_EQ(full.field("Retry-After"), "1");
  EXPECT_THAT(full.body, HasSubstr("expected at most 2"));
  EXPECT_EQ(http_call(subject.port(), "GET", "/short", "", b).status, 200) << "the other client has its own share";
}

const std::string kA = "Authorization: Bearer aaaaaaaaaaaaaaaaaaaa\r\n", kB = "Authorization: Bearer bbbbbbbbbbbbbbbbbbbb\r\n",
                  kC = "Authorization: Bearer cccccccccccccccccccc\r\n";

/// Connections to a server, some of them for a token.
class Crowd {
 public:
  explicit Crowd(Subject& subject) : subject_(subject) {}
  /// Connects, and waits until the server has seen it.
  RawClient& join() {
    const std::uint64_t before = subject_.server->counts().connections;
    clients_.push_back(std::make_unique<RawClient>(subject_.port()));
    EXPECT_TRUE(within_patience([&] { return subject_.server->counts().connections > before; }));
    return *clients_.back();
  }
  /// Connects, is answered, and is idle then.
  RawClient& join_and_ask(const std::string& token) {
    RawClient& client = join();
    client.send(http_request("GET", "/short", "", token));
    EXPECT_EQ(client.reply().status, 200);
    return client;
  }
  /// Connects and watches events, which never ends by itself. The status.
  int watch(const std::string& token = "") {
    RawClient& client = join();
    client.send(http_request("GET", "/events", "", token));
    return client.reply(true).status;
  }

 private:
  Subject& subject_;
  std::vector<std::unique_ptr<RawClient>> clients_;
};

bool is_open(const RawClient& client) {
  pollfd readable = {client.descriptor(), POLLIN, 0};
  return ::poll(&readable, 1, 0) == 0;
}

TEST(GatewayFairness, LimitsTheConnectionsOfAnAddressThatAreInUse) {
  ServerOptions options;
  options.limits.address_connections = 2;
  Subject subject(std::move(options));
  std::optional<Crowd> watchers(std::in_place, subject);
  EXPECT_EQ(watchers->watch(), 200);
  EXPECT_EQ(watchers->watch(), 200);
  RawClient third(subject.port());
  third.send(http_request("GET", "/short"));  // does not keep the refusal from being read
  const HttpReply refused = third.reply();
  EXPECT_EQ(refused.status, 429);
  EXPECT_EQ(refused.field("Retry-After"), "1");
  EXPECT_EQ(nlohmann::json::parse(refused.body)["detail"], "too many connections of this address, expected at most 2");
  watchers.reset();
  EXPECT_TRUE(within_patience([&] { return http_call(subject.port(), "GET", "/short").status == 200; }));
}

TEST(GatewayFairness, TellsManyConnectionsAtOnceThatThereAreTooMany) {
  ServerOptions options;
  options.limits.address_connections = 2;
  Subject subject(std::move(options));
  Crowd watchers(subject);
  for (int i = 0; i < 2; ++i) ASSERT_EQ(watchers.watch(), 200);
  std::vector<std::unique_ptr<RawClient>> clients;
  for (int i = 0; i < 98; ++i) clients.push_back(std::make_unique<RawClient>(subject.port()));
  ASSERT_TRUE(within_patience([&] { return subject.server->counts().connections == 100; }));
  int told = 0;
  for (const auto& client : clients) told += client->reply().status == 429;
  EXPECT_EQ(told, 98);
}

// What waits for its client, in whatever state, cannot lock others out.
TEST(GatewayFairness, ClosesTheOldestConnectionThatWaitsForItsClient) {
  ServerOptions options;
  options.limits.address_connections = 6;
  Subject subject(std::move(options));
  Crowd crowd(subject);
  RawClient& silent = crowd.join();
  RawClient& piecewise = crowd.join();
  RawClient& half = crowd.join();
  RawClient& answered = crowd.join_and_ask("");
  piecewise.send("G");
  half.send("GET /short HTTP/1.1\r\nHost: loc");
  EXPECT_EQ(crowd.watch(), 200);
  EXPECT_EQ(crowd.watch(), 200);
  // Everyone is served, and the two that watch stay.
  RawClient* const waiting[] = {&silent, &piecewise, &half, &answered};
  for (int i = 0; i < 4; ++i) {
    for (int k = i; k < 4; ++k) EXPECT_TRUE(is_open(*waiting[k])) << i << " " << k;
    crowd.join_and_ask("");
    EXPECT_TRUE(waiting[i]->ended()) << i;
  }
  for (int i = 0; i < 50; ++i) EXPECT_EQ(http_call(subject.port(), "GET", "/short").status, 200);
  EXPECT_EQ(subject.server->counts().streams, 2u);
}

TEST(GatewayFairness, ClosesAnIdleConnectionOfWhoeverHasMost) {
  ServerOptions options;
  const testing::SecretFile tokens("read aaaaaaaaaaaaaaaaaaaa\nread bbbbbbbbbbbbbbbbbbbb\nread cccccccccccccccccccc");
  options.token_file = tokens.path();
  options.limits.connections = 7;
  Subject subject(std::move(options));
  Crowd crowd(subject);
  RawClient& b = crowd.join_and_ask(kB);  // idle for longest
  RawClient& second_b = crowd.join_and_ask(kB);
  std::vector<RawClient*> a;
  for (int i = 0; i < 4; ++i) a.push_back(&crowd.join_and_ask(kA));
  EXPECT_EQ(crowd.watch(kC), 200);
  crowd.join_and_ask(kC);
  EXPECT_TRUE(a[0]->ended());
  crowd.join();  // without a request it counts for its user
  EXPECT_TRUE(a[1]->ended());
  for (RawClient* open : {&b, &second_b, a[2], a[3]}) EXPECT_TRUE(is_open(*open));
  for (RawClient* used : {&b, a[2]}) {
    used->send(http_request("GET", "/short", "", kB));
    EXPECT_EQ(used->reply().status, 200);
  }
}

TEST(GatewayFairness, KeepsThePlacesThatAreLastForClientsWithoutAny) {
  ServerOptions options;
  const testing::SecretFile tokens("read aaaaaaaaaaaaaaaaaaaa\nread bbbbbbbbbbbbbbbbbbbb\nread cccccccccccccccccccc");
  options.token_file = tokens.path();
  options.limits.connections = 16;  // an eighth of them: 2
  Subject subject(std::move(options));
  Crowd crowd(subject);
  for (int i = 0; i < 14; ++i) ASSERT_EQ(crowd.watch(kA), 200) << i;
  for (int i = 0; i < 20; ++i) EXPECT_EQ(crowd.watch(kA), 429) << i;
  RawClient& more = crowd.join();
  more.send(http_request("GET", "/short", "", kA));
  const HttpReply refused = more.reply();
  EXPECT_EQ(refused.status, 429);
  EXPECT_EQ(refused.field("Retry-After"), "1");
  EXPECT_THAT(refused.body, HasSubstr("the last places are kept for others"));
  EXPECT_EQ(crowd.watch(kB), 200);
  EXPECT_EQ(crowd.watch(kB), 429);
  EXPECT_EQ(crowd.watch(kC), 200);
  RawClient last(subject.port());
  EXPECT_EQ(last.reply().status, 503) << "all are in use";
}

TEST(GatewayFairness, AnswersInTimeThatThereIsNoAnswerAndForgetsRequestsThatWait) {
  ServerOptions options;
  options.limits.answer = 0.2;
  const testing::SecretFile tokens("read aaaaaaaaaaaaaaaaaaaa");
  options.token_file = tokens.path();
  Subject subject(std::move(options));
  const std::string token = "Authorization: Bearer aaaaaaaaaaaaaaaaaaaa\r\n";
  std::vector<std::unique_ptr<RawClient>> clients;
  for (int i = 0; i < 12; ++i) {
    clients.push_back(std::make_unique<RawClient>(subject.port()));
    clients.back()->send(http_request("GET", "/long", "", token));
  }
  for (const auto& client : clients) {
    const HttpReply late = client->reply();
    EXPECT_EQ(late.status, 503);
    EXPECT_EQ(late.field("Retry-After"), "10");
    EXPECT_THAT(late.body, HasSubstr("there was no answer within"));
  }
  // The connections go on, and requests that nobody waits for any more are not begun: 1 thread and 6 more were busy.
  subject.barrier.open();
  clients[0]->send(http_request("GET", "/short", "", token));
  EXPECT_EQ(clients[0]->reply().status, 200);
  EXPECT_TRUE(within_patience([&] { return subject.finished == subject.barrier.waiting(); }));
  EXPECT_LE(subject.barrier.waiting(), 7);
}

TEST(GatewayFairness, SurvivesWhatHandlersThrow) {
  Subject subject;
  EXPECT_EQ(http_call(subject.port(), "GET", "/odd").status, 500);
  RawClient events(subject.port()), socket(subject.port());
  events.send(http_request("GET", "/fails"));
  EXPECT_TRUE(events.ended());
  socket.send(http_request("GET", "/fails", "",
                           "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                           "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"));
  EXPECT_TRUE(socket.ended());
  EXPECT_EQ(http_call(subject.port(), "GET", "/short").status, 200);
}

TEST(GatewayFairness, AnswersAClientThatHasClosedItsSide) {
  Subject subject;
  RawClient half(subject.port());
  half.send(http_request("GET", "/short"));
  ::shutdown(half.descriptor(), SHUT_WR);
  EXPECT_EQ(half.reply().status, 200);
  EXPECT_TRUE(half.ended());
}

/// A WebSocket whose client sends frames of any kind.
struct SocketClient {
  explicit SocketClient(std::uint16_t port) : raw(port, 4096) {
    raw.send(http_request("GET", "/events", "",
                          "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                          "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"));
    (void)raw.receive_until("\r\n\r\n");
  }
  /// A masked frame (RFC 6455, 5.2) with the mask 0. kind: 1 text, 9 ping. False: the connection has ended.
  bool send(int kind, std::size_t size) {
    std::string frame{static_cast<char>(0x80 | kind)};
    if (size < 126) {
      frame += static_cast<char>(0x80 | size);
    } else {
      frame += static_cast<char>(0x80 | 126);
      frame += static_cast<char>(size >> 8);
      frame += static_cast<char>(size & 255);
    }
    return raw.send(frame + std::string(4, '\0') + std::string(size, 'x'));
  }
  RawClient raw;
};

TEST(GatewayWebSocket, EndsAClientThatSendsButDoesNotRead) {
  ServerOptions options;
  options.limits.response = 0.3;
  options.limits.queue_bytes = 64 << 20;
  Subject subject(std::move(options));
  SocketClient client(subject.port());
  const auto stream = subject.wait_for_stream();
  ASSERT_TRUE(stream);
  ASSERT_TRUE(stream->send({"big", "", "\"" + std::string(32 << 20, 'x') + "\""}));  // more than the kernel buffers
  // Little enough that what it sends is no reason to end it.
  EXPECT_TRUE(within_patience([&] {
    client.send(1, 5);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return subject.closed == 1;
  }));
  EXPECT_FALSE(stream->send({"late", "", "{}"}));
  EXPECT_EQ(subject.server->counts().streams, 0u);
}

TEST(GatewayWebSocket, EndsAClientAtOnceForWhichTooMuchWaits) {
  ServerOptions options;
  options.limits.queue_bytes = 16 << 20;
  options.limits.response = 3600;  // not this ends it
  Subject subject(std::move(options));
  SocketClient client(subject.port());
  const auto stream = subject.wait_for_stream();
  ASSERT_TRUE(stream);
  for (int i = 0; i < 64 && stream->send({"big", "", "\"" + std::string(1 << 20, 'x') + "\""}); ++i) {
  }
  EXPECT_TRUE(within_patience([&] { return subject.closed == 1; }));
  EXPECT_EQ(subject.server->counts().dropped, 1u);
}

TEST(GatewayWebSocket, EndsAClientThatSendsTooMuch) {
  for (const int kind : {1, 9}) {
    ServerOptions options;
    options.limits.stream_bytes = 20'000;
    Subject subject(std::move(options));
    SocketClient client(subject.port());
    ASSERT_TRUE(subject.wait_for_stream());
    int sent = 0;
    EXPECT_TRUE(within_patience([&] {
      for (int i = 0; i < 1000; ++i) {
        if (!client.send(kind, 100)) return true;
        ++sent;
      }
      return false;
    }));
    EXPECT_GT(sent, 100) << "some messages are permitted";
    EXPECT_TRUE(within_patience([&] { return subject.closed == 1; }));
  }
}

TEST(GatewayWebSocket, GivesAClientThatReadsWhatItIsSent) {
  Subject subject;
  SocketClient client(subject.port());
  const auto stream = subject.wait_for_stream();
  ASSERT_TRUE(stream);
  client.send(1, 5);
  for (int i = 0; i < 1000; ++i) {
    ASSERT_TRUE(within_patience([&] { return stream->waiting() < 100'000; }) && stream->send({"n", std::to_string(i), "{}"}));
  }
  EXPECT_TRUE(client.raw.receive_until(R"({"event":"n","id":"999","data":{}})"));
  stream->close();
  EXPECT_TRUE(within_patience([&] { return subject.closed == 1; })) << "also if the client does not answer the close frame";
}

TEST(GatewayFairness, EndsAWatcherAtOnceForWhichTooMuchWaits) {
  ServerOptions options;
  options.limits.queue_bytes = 16 << 20;
  options.limits.response = 3600;  // not this ends it
  Subject subject(std::move(options));
  RawClient client(subject.port(), 4096);
  client.send(http_request("GET", "/events"));
  const auto stream = subject.wait_for_stream();
  ASSERT_TRUE(stream);
  for (int i = 0; i < 64 && stream->send({"big", "", "\"" + std::string(1 << 20, 'x') + "\""}); ++i) {
  }
  EXPECT_TRUE(within_patience([&] { return subject.closed == 1; }));
}

}  // namespace
}  // namespace cotwin::gateway::http::fairness_test
