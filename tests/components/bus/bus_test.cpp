// Queues, wake-ups and requests between threads (components/bus/queue.h, wake.h, service.h).
#include "components/bus/queue.h"
#include "components/bus/service.h"
#include "components/bus/wake.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <deque>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "tests/components/bus/local_transport.h"
#include "tests/support/error_of.h"

namespace cotwin::bus::bus_test {
namespace {

constexpr std::int64_t kLong = 60'000'000'000;  // ns; no test waits that long

/// Words that belong together: torn if they are of different messages.
struct Message {
  std::uint64_t publisher = 0, number = 0, sum = 0;
  std::uint64_t more[5] = {};
};

Message message_of(std::uint64_t publisher, std::uint64_t number) {
  Message m{publisher, number, publisher * 31 + number * 7, {}};
  for (std::uint64_t& word : m.more) word = m.sum;
  return m;
}

bool whole(const Message& m) {
  bool same = m.sum == m.publisher * 31 + m.number * 7;
  for (const std::uint64_t word : m.more) same = same && word == m.sum;
  return same;
}

TEST(SpscQueue, GivesWhatADequeGives) {
  std::mt19937 random(1);
  for (const std::size_t capacity : {1u, 2u, 5u, 64u}) {
    SpscQueue<int> queue(capacity);
    std::deque<int> expected;
    for (int i = 0; i < 20'000; ++i) {
      if (random() % 2 == 0) {
        const bool room = expected.size() < queue.capacity();
        ASSERT_EQ(queue.push(i), room);
        if (room) expected.push_back(i);
      } else {
        int value = -1;
        ASSERT_EQ(queue.pop(value), !expected.empty());
        if (expected.empty()) continue;
        ASSERT_EQ(value, expected.front());
        expected.pop_front();
      }
    }
  }
}

TEST(MpscQueue, GivesWhatADequeGives) {
  std::mt19937 random(2);
  for (const std::size_t capacity : {1u, 2u, 5u, 64u}) {
    MpscQueue<int> queue(capacity);
    std::deque<int> expected;
    for (int i = 0; i < 20'000; ++i) {
      if (random() % 2 == 0) {
        const bool room = expected.size() < queue.capacity();
        ASSERT_EQ(queue.push(i), room);
        if (room) expected.push_back(i);
      } else {
        int value = -1;
        ASSERT_EQ(queue.pop(value), !expected.empty());
        if (expected.empty()) continue;
        ASSERT_EQ(value, expected.front());
        expected.pop_front();
      }
    }
  }
}

TEST(ByteQueue, GivesWhatADequeGives) {
  std::mt19937 random(3);
  for (const std::size_t capacity : {1u, 200u, 4096u}) {
    ByteQueue queue(capacity);
    const std::size_t room = std::bit_ceil(std::max<std::size_t>(capacity, 64));
    std::deque<std::string> expected;
    std::size_t refused = 0;
    for (int i = 0; i < 50'000; ++i) {
      if (random() % 2 == 0) {
        const std::string text(random() % (room / 2 - 7), static_cast<char>('a' + i % 26));
        if (queue.push(std::as_bytes(std::span(text)))) {
          expected.push_back(text);
        } else {
          ++refused;
          ASSERT_FALSE(expected.empty()) << "an empty queue takes a message of " << text.size() << " of " << room << " bytes";
        }
      } else {
        const std::span<const std::byte> front = queue.front();
        ASSERT_EQ(front.data() == nullptr, expected.empty());
        if (expected.empty()) continue;
        ASSERT_EQ(std::string(reinterpret_cast<const char*>(front.data()), front.size()), expected.front());
        expected.pop_front();
        queue.drop();
      }
    }
    EXPECT_GT(refused, 0u);
    const std::string huge(room + 1, 'x');
    EXPECT_FALSE(queue.push(std::as_bytes(std::span(huge))));
  }
}

TEST(BusThread, ASpscQueueCarriesEverythingInOrder) {
  SpscQueue<Message> queue(16);
  constexpr std::uint64_t kCount = 20'000;
  std::thread writer([&] {
    for (std::uint64_t i = 1; i <= kCount; ++i)
      while (!queue.push(message_of(1, i))) std::this_thread::yield();
  });
  Message m;
  for (std::uint64_t i = 1; i <= kCount; ++i) {
    while (!queue.pop(m)) std::this_thread::yield();
    ASSERT_EQ(m.number, i);
    ASSERT_TRUE(whole(m));
  }
  writer.join();
}

TEST(BusThread, AnMpscQueueKeepsTheOrderOfEachWriterAndRefusesWhatDoesNotFit) {
  MpscQueue<Message> queue(32);
  Wake wake;
  constexpr std::uint64_t kCount = 5'000, kWriters = 4;
  std::atomic<std::uint64_t> accepted = 0;
  std::vector<std::thread> writers;
  for (std::uint64_t p = 0; p < kWriters; ++p) {
    writers.emplace_back([&, p] {
      const auto push = [&](std::uint64_t number) {
        const bool pushed = queue.push(message_of(p, number));
        if (pushed) ++accepted;
        wake.notify();
        return pushed;
      };
      for (std::uint64_t i = 1; i <= kCount; ++i) push(i);
      while (!push(kCount + 1)) std::this_thread::yield();
    });
  }
  std::vector<std::uint64_t> last(kWriters);
  std::uint64_t taken = 0, finished = 0;
  Message m;
  while (finished < kWriters) {
    ASSERT_TRUE(wake.wait([&] { return !queue.empty(); }, monotonic_ns() + kLong));
    while (queue.pop(m)) {
      ++taken;
      ASSERT_TRUE(whole(m));
      ASSERT_GT(m.number, last[m.publisher]);
      last[m.publisher] = m.number;
      if (m.number == kCount + 1) ++finished;
    }
  }
  for (std::thread& writer : writers) writer.join();
  EXPECT_EQ(taken, accepted);
}

TEST(BusThread, ATripleBufferShowsWholePublications) {
  TripleBuffer buffer(64 * sizeof(std::uint64_t));
  constexpr std::uint64_t kCount = 20'000;
  std::thread writer([&] {
    for (std::uint64_t i = 1; i <= kCount; ++i) {
      for (std::size_t w = 0; w < 64; ++w) std::memcpy(&buffer.back()[w * sizeof i], &i, sizeof i);
      buffer.publish();
    }
  });
  std::uint64_t seen = 0, words[64];
  while (seen < kCount) {
    if (!buffer.take()) {
      std::this_thread::yield();
      continue;
    }
    std::memcpy(words, buffer.front().data(), sizeof words);
    ASSERT_GT(words[0], seen);
    for (const std::uint64_t word : words) ASSERT_EQ(word, words[0]);
    seen = words[0];
  }
  writer.join();
}

// A notification that came between the check and the wait would leave the waiting thread asleep, and the test would end at the
// deadline.
TEST(BusThread, NoWakeUpIsLost) {
  for (const Wake::Kind kind : {Wake::Kind::kBest, Wake::Kind::kPipe}) {
    SpscQueue<int> ping(4), pong(1);
    Wake at_pong(kind), at_ping(kind);
    constexpr int kRounds = 2'000;
    std::thread other([&] {
      int value = 0;
      for (int i = 0; i < kRounds; ++i) {
        ASSERT_TRUE(at_pong.wait([&] { return !ping.empty(); }, monotonic_ns() + kLong));
        ASSERT_TRUE(ping.pop(value));
        ASSERT_TRUE(pong.push(value + 1));
        at_ping.notify();
      }
    });
    int value = 0;
    for (int i = 0; i < kRounds; ++i) {
      ASSERT_TRUE(ping.push(value));
      at_pong.notify();
      ASSERT_TRUE(at_ping.wait([&] { return !pong.empty(); }, monotonic_ns() + kLong));
      ASSERT_TRUE(pong.pop(value));
    }
    other.join();
    EXPECT_EQ(value, kRounds);
  }
}

TEST(BusThread, OneThreadWaitsForSeveralQueues) {
  SpscQueue<int> a(2000), b(2000);
  Wake wake;
  const auto fill = [&](SpscQueue<int>& queue) {
    for (int i = 1; i <= 1000; ++i) {
      EXPECT_TRUE(queue.push(i));
      wake.notify();
    }
  };
  std::thread first([&] { fill(a); }), second([&] { fill(b); });
  int sum = 0, value = 0;
  while (sum < 1'001'000) {  // 2 · (1 + … + 1000)
    ASSERT_TRUE(wake.wait([&] { return !a.empty() || !b.empty(); }, monotonic_ns() + kLong));
    while (a.pop(value)) sum += value;
    while (b.pop(value)) sum += value;
  }
  first.join();
  second.join();
  EXPECT_EQ(sum, 1'001'000);
}

TEST(BusThread, EachClientGetsTheAnswersToItsOwnRequests) {
  Service<int, int> service(8);
  constexpr int kClients = 3, kRequests = 1'000;
  std::vector<Service<int, int>::Client*> clients;
  for (int c = 0; c < kClients; ++c) clients.push_back(&service.add_client(4));
  std::thread server([&] {
    Service<int, int>::Call call;
    for (int done = 0; done < kClients * kRequests; ++done) {
      ASSERT_TRUE(service.wait(monotonic_ns() + kLong));
      ASSERT_TRUE(service.take(call));
      service.reply(call, call.request * call.request);
    }
  });
  std::vector<std::thread> running;
  for (int c = 0; c < kClients; ++c) {
    running.emplace_back([&, c] {
      std::deque<std::pair<std::uint64_t, int>> open;
      Service<int, int>::Answer answer;
      int asked = 0, answered = 0;
      while (answered < kRequests) {
        if (asked < kRequests) {
          const int request = c * kRequests + asked;
          if (const auto number = clients[static_cast<std::size_t>(c)]->ask(request)) {
            open.emplace_back(*number, request);
            ++asked;
            continue;
          }
        }
        if (open.empty()) {  // the queue of the server is full of others' requests
          std::this_thread::yield();
          continue;
        }
        ASSERT_TRUE(clients[static_cast<std::size_t>(c)]->wait(monotonic_ns() + kLong));
        while (clients[static_cast<std::size_t>(c)]->take(answer)) {
          ASSERT_EQ(answer.number, open.front().first);
          ASSERT_EQ(answer.reply, open.front().second * open.front().second);
          open.pop_front();
          ++answered;
        }
      }
    });
  }
  for (std::thread& thread : running) thread.join();
  server.join();
}

TEST(Bus, WaitingEndsAtTheDeadline) {
  SpscQueue<int> queue(4);
  Wake wake;
  const auto filled = [&] { return !queue.empty(); };
  const std::int64_t deadline = monotonic_ns() + 2'000'000;
  EXPECT_FALSE(wake.wait(filled, deadline));
  EXPECT_GE(monotonic_ns(), deadline);
  EXPECT_FALSE(wake.wait(filled, 0)) << "a deadline in the past";
  queue.push(1);
  EXPECT_TRUE(wake.wait(filled, 0)) << "there is a value";
}

}  // namespace
}  // namespace cotwin::bus::bus_test
