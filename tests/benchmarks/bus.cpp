// The bus: latency from publish to the awake subscriber, with real-time threads where permitted, beside a queue with std::mutex and
// std::condition_variable; cost of a message; bytes and time of a tick of a state database against full copies; and what a run costs that is
// watched (live_run.cpp).
#include <pthread.h>
#include <sched.h>
#include <time.h>

#include <algorithm>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <deque>
#include <mutex>
#include <optional>
#include <random>
#include <thread>
#include <vector>

#include "components/bus/queue.h"
#include "components/bus/state_database.h"
#include "components/bus/udp_transport.h"
#include "components/bus/wake.h"
#include "tests/benchmarks/live_run.h"
#include "tests/benchmarks/measure.h"

namespace {

using namespace cotwin;
using namespace cotwin::bus;
using benchmark::keep;
using benchmark::measure;
using benchmark::print;

constexpr int kMessages = 2'000;                  // of a round
const int kRounds = benchmark::shortened(10, 1);  // the queues in turn, so that the load of the machine is the same for all
constexpr std::int64_t kApart = 100'000;          // ns between two messages, so that the subscriber sleeps

/// The peer: a queue with a lock.
class LockedQueue {
 public:
  void push(std::int64_t value) {
    {
      const std::lock_guard lock(mutex_);
      queue_.push_back(value);
    }
    filled_.notify_one();
  }
  std::int64_t pop() {
    std::unique_lock lock(mutex_);
    filled_.wait(lock, [this] { return !queue_.empty(); });
    const std::int64_t value = queue_.front();
    queue_.pop_front();
    return value;
  }

 private:
  std::mutex mutex_;
  std::condition_variable filled_;
  std::deque<std::int64_t> queue_;
};

/// Gives the calling thread a real-time priority, as the control part of a twin has it, or takes it away. False: not permitted.
bool set_real_time(bool on) {
  sched_param parameters{};
  parameters.sched_priority = on ? 50 : 0;
  return pthread_setschedparam(pthread_self(), on ? SCHED_FIFO : SCHED_OTHER, &parameters) == 0;
}

/// Latencies of messages, in µs.
class Latencies {
 public:
  /// `send` publishes a time, `receive` waits for the next one in another thread.
  template <class Send, class Receive>
  void measure(const Send& send, const Receive& receive) {
    std::thread subscriber([&] {
      set_real_time(true);
      for (int i = 0; i < kMessages; ++i) {
        const std::int64_t sent = receive();
        us_.push_back(1e-3 * static_cast<double>(monotonic_ns() - sent));
      }
    });
    set_real_time(true);
    std::int64_t next = monotonic_ns();
    for (int i = 0; i < kMessages; ++i) {
      next += kApart;
      const timespec t{next / 1'000'000'000, next % 1'000'000'000};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
      send(monotonic_ns());
    }
    subscriber.join();
    set_real_time(false);
  }
  double at(double share) {
    const auto place = us_.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(us_.size() - 1));
    std::nth_element(us_.begin(), place, us_.end());
    return *place;
  }

 private:
  std::vector<double> us_;
};

void print_latency(const std::string& name, Latencies& ours, const std::string& peer, Latencies& theirs, bool goals) {
  print({name + ", p50", "us", ours.at(0.5), peer, theirs.at(0.5), goals ? 20.0 : 0.0, false});
  print({name + ", p99", "us", ours.at(0.99), peer, theirs.at(0.99), goals ? 100.0 : 0.0, false});
}

void latencies() {
  SpscQueue<std::int64_t> queue(1024);
  Wake wake;
  LockedQueue locked;
  const net::Endpoint any{0x7f000001, 0};
  UdpTransport a(any, {}, "bus"), b(any, a.local(), "bus");
  a.set_peer(b.local());
  const auto take = [&] {
    std::int64_t sent = 0;
    wake.wait([&] { return !queue.empty(); });
    queue.pop(sent);
    return sent;
  };
  const auto receive = [&] {
    std::int64_t sent = 0;
    for (;;) {
      const std::span<const std::byte> message = b.receive();
      if (message.size() == sizeof sent) {
        std::memcpy(&sent, message.data(), sizeof sent);
        return sent;
      }
      b.wait(kNever);
    }
  };
  Latencies ours, peer, udp;
  for (int round = 0; round < kRounds; ++round) {
    ours.measure(
        [&](std::int64_t t) {
          queue.push(t);
          wake.notify();
        },
        take);
    peer.measure([&](std::int64_t t) { locked.push(t); }, [&] { return locked.pop(); });
    udp.measure([&](std::int64_t t) { a.send(std::as_bytes(std::span(&t, 1))); }, receive);
  }
  const std::string threads = set_real_time(true) ? "SCHED_FIFO" : "no real-time priority";
  set_real_time(false);
  print_latency("publish to wake, in process, " + threads, ours, "mutex and condition variable", peer, true);
  print_latency("publish to wake, UDP on loopback, " + threads, udp, "mutex and condition variable in process", peer, false);
}

void message_costs() {
  SpscQueue<std::int64_t> spsc(64);
  MpscQueue<std::int64_t> mpsc(64);
  Wake wake;
  LockedQueue locked;
  std::int64_t value = 0;
  const auto lock = [&] {
    locked.push(1);
    keep(locked.pop());
  };
  const auto ours = [&](auto& queue) {
    return [&] {
      queue.push(1);
      wake.notify();
      queue.pop(value);
      keep(value);
    };
  };
  const auto a = measure(ours(spsc), lock, 31, 2e-3, benchmark::thread_seconds);
  const auto b = measure(ours(mpsc), lock, 31, 2e-3, benchmark::thread_seconds);
  print({"publish and take, one publisher", "ns", a.ours * 1e9, "mutex and condition variable", a.peer * 1e9});
  print({"publish and take, several publishers", "ns", b.ours * 1e9, "mutex and condition variable", b.peer * 1e9});
}

void database_costs() {
  constexpr std::size_t kWords = 1000;
  const auto layout = [] { return StateLayout({{"x", StateField::Kind::kReal, kWords, "1"}}); };
  for (const std::size_t changed : {std::size_t{100}}) {
    StateOwner owner(layout(), 1);
    StateReplica replica(layout());
    (void)owner.publish(0);
    (void)replica.request();
    replica.receive(owner.full(replica.requested()));
    const auto full = static_cast<double>(owner.full(1).size());
    std::mt19937_64 random(1);
    std::int64_t tick = 0;
    double bytes = 0;
    const auto change = [&] {
      for (std::size_t i = 0; i < changed; ++i) {
        const std::uint64_t word = random();
        std::memcpy(&owner.image()[i * (kWords / changed) * 8], &word, 8);
      }
    };
    const auto figures = measure(
        [&] {
          change();
          const auto update = owner.publish(++tick);
          bytes = static_cast<double>(update.size());
          replica.receive(update);
        },
        [&] {
          change();
          (void)owner.publish(++tick);
          (void)replica.request();
          replica.receive(owner.full(replica.requested()));
        },
        31, 2e-3, benchmark::thread_seconds);
    const std::string name = std::to_string(changed) + " of " + std::to_string(kWords) + " words changed";
    print({"state database, bytes per tick, " + name, "B", bytes, "full copy", full});
    print({"state database, publish and apply, " + name, "ns", figures.ours * 1e9, "full copy", figures.peer * 1e9});
  }
}

}  // namespace

int main() {
  latencies();
  message_costs();
  database_costs();
  live_run_costs();
}
