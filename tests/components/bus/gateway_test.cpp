// What a gateway needs of the bus: signals for readers that come and go (feed.h), requests with deadlines and cancellation
// (service.h), and waiting for both in one epoll loop.
#include <gtest/gtest.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <memory>
#include <random>
#include <span>
#include <thread>
#include <vector>

#include "components/bus/feed.h"
#include "components/bus/service.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::bus::gateway_test {
namespace {

constexpr std::int64_t kLong = 60'000'000'000;  // ns; no test waits that long

/// A record of 37 bytes that is torn if they do not fit together.
constexpr std::size_t kBytes = 37;
using Record = std::array<std::byte, kBytes>;

Record record_of(std::uint64_t number) {
  Record r;
  for (std::size_t i = 0; i < kBytes; ++i) r[i] = static_cast<std::byte>((number + i) * 167 >> 2 * (i % 4));
  std::memcpy(r.data(), &number, sizeof number);
  return r;
}

std::uint64_t number_of(const Record& r) {
  std::uint64_t number = 0;
  std::memcpy(&number, r.data(), sizeof number);
  return r == record_of(number) ? number : 0;
}

TEST(Feed, GivesTheOldestRecordThatIsStillThereAndCountsTheOthers) {
  std::mt19937 random(1);
  for (const std::size_t capacity : {1u, 2u, 5u, 64u}) {
    Feed feed(kBytes, capacity);
    Feed::Reader reader(feed);
    std::uint64_t published = 0, next = 1, lost = 0;
    Record r;
    for (int i = 0; i < 20'000; ++i) {
      const std::uint32_t action = random() % 8;
      if (action < 4) {
        feed.publish(record_of(++published));
        continue;
      }
      const std::uint64_t oldest = published < feed.capacity() ? 1 : published - feed.capacity() + 1;
      const std::uint64_t expected = action == 7 ? std::max(published, next) : std::max(oldest, next);
      ASSERT_EQ(action == 7 ? reader.pop_newest(r) : reader.take(r), expected <= published);
      if (expected > published) continue;
      lost += expected - next;
      next = expected + 1;
      ASSERT_EQ(number_of(r), expected);
      ASSERT_EQ(reader.number(), expected);
      ASSERT_EQ(reader.lost(), lost);
    }
    EXPECT_GT(lost, 100u);
  }
}

TEST(Feed, AReaderThatComesLateBeginsWithTheLastRecord) {
  Feed feed(kBytes, 4);
  for (std::uint64_t i = 1; i <= 10; ++i) feed.publish(record_of(i));
  Feed::Reader reader(feed);
  Record r;
  ASSERT_TRUE(reader.wait(0));
  ASSERT_TRUE(reader.take(r));
  EXPECT_EQ(number_of(r), 10u);
  EXPECT_EQ(reader.lost(), 0u);
  EXPECT_FALSE(reader.take(r));
  EXPECT_FALSE(reader.wait(0));
}

TEST(Feed, RefusesTheSixtyFifthReaderUntilOneHasLeft) {
  Feed feed(8, 2);
  std::vector<std::unique_ptr<Feed::Reader>> readers;
  const auto enter = [&] { readers.push_back(std::make_unique<Feed::Reader>(feed)); };
  for (std::size_t i = 0; i < Feed::kMaxReaders; ++i) enter();
  EXPECT_EQ(testing::error_of(enter), "bus: a feed has 64 readers, expected no more");
  readers.erase(readers.begin() + 5);
  enter();
}

TEST(Feed, PublishingAllocatesNothingWhateverTheReadersDo) {
  Feed feed(kBytes, 16);
  Feed::Reader slow(feed), fast(feed);
  Record r;
  const std::uint64_t before = testing::allocations();
  for (std::uint64_t i = 1; i <= 1000; ++i) {
    feed.publish(record_of(i));
    ASSERT_TRUE(fast.take(r));
  }
  EXPECT_EQ(testing::allocations(), before);
  ASSERT_TRUE(slow.take(r));
  EXPECT_EQ(number_of(r), 985u);
  EXPECT_EQ(slow.lost(), 984u);
}

TEST(FeedThread, RecordsAreWholeAndEachIsTakenOrCounted) {
  Feed feed(kBytes, 8);
  constexpr std::uint64_t kCount = 30'000;
  std::vector<std::thread> readers;
  std::atomic<int> ready = 0;
  for (int r = 0; r < 3; ++r) {
    readers.emplace_back([&, r] {
      Feed::Reader reader(feed);
      ++ready;
      Record record;
      std::uint64_t taken = 0, last = 0;
      while (last < kCount) {
        ASSERT_TRUE(reader.wait(monotonic_ns() + kLong));
        while (r == 2 ? reader.pop_newest(record) : reader.take(record)) {
          const std::uint64_t number = number_of(record);
          ASSERT_GT(number, last) << "torn, or not in order";
          ASSERT_EQ(number, reader.number());
          last = number;
          ++taken;
        }
        if (r == 1) std::this_thread::yield();
      }
      EXPECT_EQ(taken + reader.lost(), kCount);
    });
  }
  while (ready < 3) std::this_thread::yield();
  for (std::uint64_t i = 1; i <= kCount; ++i) feed.publish(record_of(i));
  for (std::thread& reader : readers) reader.join();
}

// Long records, of which many are overwritten while they are read.
TEST(FeedThread, NoRecordIsOfTwoPublications) {
  constexpr std::size_t kWords = 1000;
  Feed feed(kWords * 8, 2);
  std::atomic<bool> done = false;
  std::thread publisher([&] {
    std::vector<std::uint64_t> words(kWords);
    for (std::uint64_t i = 1; !done; ++i) {
      std::fill(words.begin(), words.end(), i);
      feed.publish(std::as_bytes(std::span(words)));
    }
  });
  Feed::Reader reader(feed);
  std::vector<std::uint64_t> words(kWords);
  for (int i = 0; i < 2'000; ++i) {
    ASSERT_TRUE(reader.wait(monotonic_ns() + kLong));
    if (!reader.take(std::as_writable_bytes(std::span(words)))) continue;
    for (const std::uint64_t word : words) ASSERT_EQ(word, reader.number());
  }
  done = true;
  publisher.join();
}

// A reader that leaves must not be notified any more, and the others must miss no wake-up.
TEST(FeedThread, ReadersComeAndGoWhileRecordsArePublished) {
  Feed feed(kBytes, 4);
  std::atomic<bool> done = false;
  std::thread publisher([&] {
    for (std::uint64_t i = 1; !done; ++i) {
      feed.publish(record_of(i));
      if (i % 64 == 0) std::this_thread::yield();
    }
  });
  std::vector<std::thread> visitors;
  for (int v = 0; v < 3; ++v) {
    visitors.emplace_back([&] {
      for (int i = 0; i < 300; ++i) {
        Feed::Reader reader(feed);
        Record record;
        for (int k = 0; k < 3; ++k) {
          ASSERT_TRUE(reader.wait(monotonic_ns() + kLong));
          ASSERT_TRUE(reader.take(record));
          ASSERT_NE(number_of(record), 0u);
        }
      }
    });
  }
  for (std::thread& visitor : visitors) visitor.join();
  done = true;
  publisher.join();
}

// One record per round: nothing later wakes a reader that has missed it.
TEST(FeedThread, ARecordWakesAReaderThatEntersMeanwhile) {
  Feed feed(8, 4);
  constexpr std::uint64_t kRounds = 2'000;
  std::atomic<std::uint64_t> round = 0;
  std::thread publisher([&] {
    for (std::uint64_t i = 1; i <= kRounds; ++i) {
      round.wait(i - 1);
      feed.publish(std::as_bytes(std::span(&i, 1)));
    }
  });
  for (std::uint64_t i = 1; i <= kRounds; ++i) {
    round = i;
    round.notify_one();
    Feed::Reader reader(feed);
    std::array<std::byte, 8> record;
    while (reader.number() != i) {
      ASSERT_TRUE(reader.wait(monotonic_ns() + kLong)) << i;
      ASSERT_TRUE(reader.take(record));
    }
  }
  publisher.join();
}

TEST(Service, BeginsNoRequestAfterItsDeadlineOrItsCancellation) {
  Service<int, int> service;
  auto& client = service.add_client(4);
  Service<int, int>::Call call;
  Service<int, int>::Answer answer;
  const auto late = client.ask(1, monotonic_ns() - 1), cancelled = client.ask(2), good = client.ask(3, monotonic_ns() + kLong),
             running = client.ask(4);
  EXPECT_FALSE(client.ask(5)) << "four are open";
  client.cancel(*cancelled);
  ASSERT_TRUE(service.take(call));
  EXPECT_EQ(call.request, 3);
  EXPECT_FALSE(service.cancelled(call));
  service.reply(call, 30);
  ASSERT_TRUE(service.take(call));
  EXPECT_EQ(call.request, 4);
  client.cancel(*running);
  EXPECT_TRUE(service.cancelled(call)) << "a long service can end early";
  service.reply(call, 40);
  EXPECT_FALSE(service.take(call));

  ASSERT_TRUE(client.take(answer));
  EXPECT_EQ(answer.number, *late);
  EXPECT_EQ(answer.outcome, Outcome::kExpired);
  ASSERT_TRUE(client.take(answer));
  EXPECT_EQ(answer.number, *good);
  EXPECT_EQ(answer.outcome, Outcome::kAnswered);
  EXPECT_EQ(answer.reply, 30);
  EXPECT_FALSE(client.take(answer)) << "answers to cancelled requests are dropped";
  EXPECT_EQ(client.open(), 0u);
  EXPECT_TRUE(client.ask(6));
}

TEST(Service, ACallEndsAtItsDeadlineWithoutAServer) {
  Service<int, int> service;
  auto& client = service.add_client(2);
  const std::int64_t deadline = monotonic_ns() + 2'000'000;
  EXPECT_FALSE(client.call(1, deadline));
  EXPECT_GE(monotonic_ns(), deadline);
  EXPECT_FALSE(client.call(2, monotonic_ns() - 1));
  EXPECT_FALSE(client.call(3, monotonic_ns() + kLong)) << "no room for a third one: at once";
  Service<int, int>::Call call;
  EXPECT_FALSE(service.take(call)) << "all have expired";
  Service<int, int>::Answer answer;
  EXPECT_FALSE(client.take(answer));
  EXPECT_EQ(client.open(), 0u);
}

TEST(Service, TheServerAllocatesNothing) {
  Service<int, int> service;
  auto& client = service.add_client(4);
  Service<int, int>::Call call;
  Service<int, int>::Answer answer;
  const std::uint64_t before = testing::allocations();
  for (int i = 0; i < 1000; ++i) {
    const auto number = client.ask(i);
    ASSERT_TRUE(number);
    if (i % 3 == 0) client.cancel(*number);
    if (service.take(call)) service.reply(call, i);
    EXPECT_EQ(client.take(answer), i % 3 != 0);
  }
  EXPECT_EQ(testing::allocations(), before);
}

TEST(ServiceThread, ClientsComeWhileTheServerRuns) {
  Service<int, int> service(4);
  std::atomic<bool> done = false;
  std::thread server([&] {
    Service<int, int>::Call call;
    while (!done) {
      service.wait(monotonic_ns() + 1'000'000);
      while (service.take(call)) service.reply(call, -call.request);
    }
  });
  std::vector<std::thread> clients;
  for (int c = 0; c < 4; ++c) {
    clients.emplace_back([&, c] {
      for (int k = 0; k < 5; ++k) {
        auto& client = service.add_client(1 + static_cast<std::size_t>(c));
        for (int i = 0; i < 200; ++i) {
          const int request = c * 1000 + i;
          std::optional<int> reply = client.call(request, monotonic_ns() + kLong);
          for (; !reply; reply = client.call(request, monotonic_ns() + kLong)) std::this_thread::yield();  // the queue was full
          ASSERT_EQ(*reply, -request);
        }
      }
    });
  }
  for (std::thread& client : clients) client.join();
  done = true;
  server.join();
}

// As in an event loop of asio or epoll: one descriptor for a feed and a service, beside others.
TEST(GatewayThread, OneDescriptorWakesForSignalsAndForAnswers) {
  const auto wake = std::make_shared<Wake>();
  Feed feed(8, 16);
  Service<int, int> service;
  auto& client = service.add_client(8, wake);
  constexpr std::uint64_t kTicks = 2'000;
  std::atomic<bool> watched = false, done = false;
  std::thread loop([&] {
    Service<int, int>::Call call;
    while (!watched) std::this_thread::yield();
    for (std::uint64_t tick = 1; tick <= kTicks || !done; ++tick) {
      while (service.take(call)) service.reply(call, call.request + 1);
      feed.publish(std::as_bytes(std::span(&tick, 1)));
      if (tick % 16 == 0) std::this_thread::yield();
    }
  });
  Feed::Reader reader(feed, wake);
  watched = true;
  std::uint64_t tick = 0;
  int answers = 0, asked = 0;
  while (tick < kTicks || answers < 100) {
    if (asked < 100 && client.ask(asked)) ++asked;
    wake->arm();
    if (reader.empty() && client.empty()) {
      pollfd ready{wake->descriptor(), POLLIN, 0};
      ASSERT_EQ(poll(&ready, 1, 60'000), 1);
    }
    wake->disarm();
    while (reader.take(std::as_writable_bytes(std::span(&tick, 1)))) EXPECT_EQ(tick, reader.number());
    Service<int, int>::Answer answer;
    while (client.take(answer)) EXPECT_EQ(answer.reply, ++answers);
  }
  done = true;
  loop.join();
}

}  // namespace
}  // namespace cotwin::bus::gateway_test
