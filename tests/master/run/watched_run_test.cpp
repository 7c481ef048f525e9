// A thread beside the loop watches the signals of a run and sets its tunables over the bus, as a gateway does.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cstring>
#include <thread>

#include "components/bus/feed.h"
#include "components/bus/service.h"
#include "tests/master/test_units.h"
#include "tests/support/allocations.h"

namespace cotwin::master::watched_run_test {
namespace {

struct Change {
  std::size_t signal = 0;
  double value = 0;
};
struct Row {
  std::int64_t tick = 0;
  std::array<double, 2> values{};
};

/// Runs y = gain · u; z = ∫y and publishes a row after each tick; takes changes of the gain between two ticks.
class Loop {
 public:
  Loop() : master_(scenario().load()) {
    master_.initialise();
    gain_ = find_signal(master_.members(), "g.gain", "");
    y_ = find_signal(master_.members(), "g.y", "");
    z_ = find_signal(master_.members(), "i.y", "");
  }
  bool tick() {
    bus::Service<Change, std::int64_t>::Call call;
    while (changes.take(call)) {
      gain_.reals()[0] = call.request.value;
      master_.values_changed();
      changes.reply(call, master_.tick());
    }
    if (!master_.step_tick()) return false;
    const Row row{master_.tick(), {y_.reals()[0], z_.reals()[0]}};
    signals.publish(std::as_bytes(std::span(&row, 1)));
    return true;
  }

  bus::Feed signals{sizeof(Row), 64};
  bus::Service<Change, std::int64_t> changes;

 private:
  static testing::Build scenario() {
    testing::Build b;
    b.unit("g", "gain").with("u", 1.0).unit("i", "integrator", 1).connect("g.y", "i.u").as_it_is().until(1e6);
    return b;
  }
  Master master_;
  Signal gain_, y_, z_;
};

TEST(WatchedRunThread, AGatewayWatchesSignalsAndSetsTunablesBetweenTicks) {
  Loop loop;
  std::atomic<bool> done = false;
  auto& gateway = loop.changes.add_client();
  bus::Feed::Reader reader(loop.signals);
  std::thread thread([&] {
    while (!done) ASSERT_TRUE(loop.tick());
  });
  const std::int64_t limit = bus::monotonic_ns() + 60'000'000'000;
  double gain = 1;
  for (int change = 1; change <= 50; ++change) {
    const std::optional<std::int64_t> from = gateway.call({0, gain + 1}, limit);
    ASSERT_TRUE(from);
    gain += 1;
    // All rows that arrive are of one tick; those of ticks after the change have the new gain.
    for (Row row; row.tick <= *from + 3;) {
      ASSERT_TRUE(reader.wait(limit));
      if (!reader.take(std::as_writable_bytes(std::span(&row, 1)))) continue;
      ASSERT_EQ(row.tick, static_cast<std::int64_t>(reader.number()));
      ASSERT_EQ(row.values[0], row.tick > *from ? gain : gain - 1) << row.tick;
    }
  }
  done = true;
  thread.join();
}

TEST(WatchedRun, ATickAllocatesNothingWhileItIsWatched) {
  Loop loop;
  bus::Feed::Reader reader(loop.signals);
  auto& client = loop.changes.add_client();
  for (int i = 0; i < 300; ++i) loop.tick();
  const std::uint64_t before = testing::allocations();
  for (int i = 0; i < 200; ++i) {
    (void)client.ask({0, 2.0});
    loop.tick();
    bus::Service<Change, std::int64_t>::Answer answer;
    ASSERT_TRUE(client.take(answer));
  }
  EXPECT_EQ(testing::allocations(), before);
}

}  // namespace
}  // namespace cotwin::master::watched_run_test
