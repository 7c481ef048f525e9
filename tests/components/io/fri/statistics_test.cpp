// Statistics, rating and set points of FRI, each against its definition.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <set>
#include <vector>

#include "components/io/emulators/kuka/interpolator.h"
#include "components/io/emulators/kuka/pose_interpolator.h"
#include "components/io/emulators/kuka/rating.h"
#include "components/io/fri/statistics.h"

namespace cotwin::fri::statistics_test {
namespace {

using Arrival = SequenceTracker::Arrival;

TEST(FriStatistics, HaveTheMomentsOfTheirValues) {
  std::mt19937 random(1);
  std::vector<double> values;
  Moments moments;
  for (int i = 0; i < 1000; ++i) {
    values.push_back(std::normal_distribution(1e6, 2.0)(random));
    moments.add(values.back());
  }
  double sum = 0, squares = 0;
  for (const double v : values) sum += v;
  const double mean = sum / 1000;
  for (const double v : values) squares += (v - mean) * (v - mean);
  EXPECT_NEAR(moments.mean(), mean, 1e-8);
  EXPECT_NEAR(moments.deviation(), std::sqrt(squares / 999), 1e-8);
  EXPECT_EQ(moments.minimum(), *std::min_element(values.begin(), values.end()));
  EXPECT_EQ(moments.maximum(), *std::max_element(values.begin(), values.end()));
}

TEST(FriStatistics, HaveQuantilesWithinABinOfTheSortedTimes) {
  std::mt19937 random(2);
  std::vector<std::int64_t> times;
  TimeHistogram histogram;
  EXPECT_EQ(histogram.quantile(0.5), 0);
  for (int i = 0; i < 10'000; ++i) {
    times.push_back(static_cast<std::int64_t>(std::lognormal_distribution(11.0, 1.0)(random)));
    histogram.add(times.back());
  }
  std::sort(times.begin(), times.end());
  for (const double share : {0.01, 0.5, 0.9, 0.99, 0.999}) {
    const double exact = 1e-9 * static_cast<double>(times[static_cast<std::size_t>(std::lround(share * 10'000)) - 1]);
    EXPECT_GE(histogram.quantile(share) * 1.001, exact) << share;
    EXPECT_LE(histogram.quantile(share), exact * 1.10) << share;
  }
  for (const std::int64_t extreme : {std::int64_t{-5}, std::int64_t{0}, std::int64_t{1} << 62}) histogram.add(extreme);
  EXPECT_EQ(histogram.count(), 10'003u);
}

/// The definition of each figure, for a stream that begins with packet 0.
struct Definition {
  std::set<std::int64_t> seen;
  std::int64_t newest = -1;
  std::uint64_t reordered = 0, duplicates = 0;

  Arrival add(std::int64_t p) {
    if (!seen.insert(p).second) return ++duplicates, Arrival::kDuplicate;
    if (p < newest) return ++reordered, Arrival::kReordered;
    newest = p;
    return Arrival::kNew;
  }
  std::uint64_t lost() const { return static_cast<std::uint64_t>(newest + 1) - seen.size(); }
};

// Loss, duplicates and delays of up to 40 packets, over several wraps of a counter of 16 bits, and from any first number.
TEST(SequenceTracker, CountsLossReorderingAndDuplicatesOverTheWrapOfTheCounter) {
  for (const unsigned bits : {16u, 32u}) {
    for (std::uint32_t seed = 0; seed < 4; ++seed) {
      std::mt19937 random(seed);
      std::vector<std::pair<double, std::int64_t>> arrivals;  // time, packet
      for (std::int64_t p = 0; p < 70'000; ++p) {
        if (p > 0 && random() % 20 == 0) continue;
        const int copies = random() % 10 == 0 ? 2 : 1;
        for (int i = 0; i < copies; ++i) {
          const double delay = p == 0 ? 0 : std::uniform_real_distribution(0.0, random() % 8 == 0 ? 40.0 : 0.9)(random);
          arrivals.emplace_back(static_cast<double>(p) + delay, p);
        }
      }
      std::stable_sort(arrivals.begin(), arrivals.end());
      const std::uint32_t start = seed == 0 ? 0 : static_cast<std::uint32_t>(random());
      const std::uint32_t mask = bits == 16 ? 0xffff : 0xffffffff;
      SequenceTracker tracker(bits);
      Definition expected;
      for (const auto& [time, p] : arrivals) {
        ASSERT_EQ(tracker.add((start + static_cast<std::uint32_t>(p)) & mask), expected.add(p)) << seed << " " << p;
        ASSERT_EQ(tracker.position() - tracker.newest(), p - expected.newest);
      }
      EXPECT_EQ(tracker.received(), expected.seen.size());
      EXPECT_EQ(tracker.lost(), expected.lost());
      EXPECT_EQ(tracker.reordered(), expected.reordered);
      EXPECT_EQ(tracker.duplicates(), expected.duplicates);
      EXPECT_EQ(tracker.stale() + tracker.restarts(), 0u);
    }
  }
}

TEST(SequenceTracker, CountsALongGapAsLoss) {
  SequenceTracker tracker(16);
  tracker.add(65'000);
  EXPECT_EQ(tracker.add(20'000), Arrival::kNew);  // 65000 + 20536 modulo 65536
  EXPECT_EQ(tracker.lost(), 20'535u);
}

TEST(SequenceTracker, SeesThatTheSenderHasBegunAnew) {
  // Far behind: the second packet in a row shows it. One alone is ignored.
  SequenceTracker tracker(32);
  for (std::uint32_t n = 0; n < 5000; ++n) tracker.add(n);
  EXPECT_EQ(tracker.add(17), Arrival::kStale);
  EXPECT_EQ(tracker.add(5000), Arrival::kNew);
  EXPECT_EQ(tracker.add(0), Arrival::kStale);
  EXPECT_EQ(tracker.add(1), Arrival::kNew);
  EXPECT_EQ(tracker.add(2), Arrival::kNew);
  EXPECT_EQ(tracker.restarts(), 1u);
  EXPECT_EQ(tracker.lost(), 0u);
  // A few packets behind, where they could be duplicates: the eighth in a row.
  SequenceTracker young(32);
  for (std::uint32_t n = 0; n < 100; ++n) young.add(n);
  for (std::uint32_t n = 0; n < 7; ++n) EXPECT_EQ(young.add(n), Arrival::kDuplicate);
  EXPECT_EQ(young.add(7), Arrival::kNew);
  EXPECT_EQ(young.add(8), Arrival::kNew);
  EXPECT_EQ(young.restarts(), 1u);
}

// A sender that waits for an answer repeats its newest packet. However many copies a late reader finds, and however old they are, it is no new sender.
TEST(SequenceTracker, TakesCopiesOfTheNewestPacketForNoNewSender) {
  for (const bool silent : {false, true}) {
    SequenceTracker tracker(16);
    for (std::uint32_t k = 0; k < 300; ++k) tracker.add(k);
    for (int copy = 0; copy < 100; ++copy) EXPECT_EQ(tracker.add(299, silent), SequenceTracker::Arrival::kDuplicate) << copy;
    EXPECT_EQ(tracker.add(300), SequenceTracker::Arrival::kNew);
    EXPECT_EQ(tracker.restarts(), 0u);
    EXPECT_EQ(tracker.duplicates(), 100u);
    // An old one that comes twice after a silence is the first of a new sender.
    tracker.add(1, true);
    EXPECT_EQ(tracker.add(1, true), SequenceTracker::Arrival::kNew);
    EXPECT_EQ(tracker.restarts(), 1u);
  }
}

TEST(FriRating, HasItsQualitiesAtTheirThresholds) {
  RatingSettings settings;
  Rating rating(settings, 5'000'000);
  EXPECT_EQ(rating.quality(), Quality::kPoor);
  std::vector<int> first;  // periods at which each quality is reached, all answers in time
  Quality last = Quality::kPoor;
  for (int i = 1; i <= 120; ++i) {
    rating.close_period(true);
    rating.add_latency(1'000'000);
    if (rating.quality() != last) first.push_back(i);
    last = rating.quality();
  }
  EXPECT_EQ(first, (std::vector<int>{75, 95, 99}));
  EXPECT_EQ(rating.answer_rate(), 1);
  EXPECT_NEAR(rating.latency(), 1e-3, 1e-15);
  rating.close_period(false);
  rating.close_period(false);
  EXPECT_EQ(rating.quality(), Quality::kGood);
  rating.correct(1);  // one of them had arrived
  EXPECT_EQ(rating.quality(), Quality::kExcellent);
  rating.correct(1);  // again: no change
  EXPECT_NEAR(rating.answer_rate(), 0.99, 1e-15);
  for (int i = 0; i < 100; ++i) rating.add_latency(i % 2 == 0 ? 2'000'000 : 4'000'000);
  EXPECT_EQ(rating.quality(), Quality::kGood);  // latency 3 ms of 5 ms
  EXPECT_NEAR(rating.jitter(), 1e-3, 1e-15);
}

constexpr std::int64_t kMs = 1'000'000;

InterpolatorSettings settings_of(std::int64_t period, double speed = 1e3) {
  return {std::vector<double>(2, speed), {}, {}, period, 1, 100 * kMs};
}

// Commands on a line with one lost: the set points are on the line, one period after the command is applied.
TEST(FriInterpolator, ContinuesTheLineThroughTheLastTwoCommands) {
  Interpolator ipo(settings_of(4 * kMs));
  Joints q{}, dq{};
  ipo.start(q, 0);
  const auto line = [](std::int64_t k) { return Joints{0.01 * static_cast<double>(k), -0.02 * static_cast<double>(k)}; };
  std::int64_t newest = 0;
  for (std::int64_t k = 1; k <= 20; ++k) {  // message k; the answer to k − 1 came before, but 6, 7 and 13 are lost
    const std::int64_t answered = k - 1;
    const bool lost = answered == 6 || answered == 7 || answered == 13;
    if (answered > 0 && !lost) ipo.command(line(answered), newest = answered);
    ipo.begin_period(4 * kMs * k, answered - newest);
    ipo.at(4 * kMs * k + 2 * kMs, q, dq);
    if (k < 3) continue;
    EXPECT_NEAR(q[0], 0.01 * (static_cast<double>(k) - 1.5), 1e-15) << k;  // half way from k − 2 to k − 1
    EXPECT_NEAR(q[1], -0.02 * (static_cast<double>(k) - 1.5), 1e-15) << k;
    EXPECT_NEAR(dq[0], 0.01 / 0.004, 1e-12) << k;
  }
}

TEST(FriInterpolator, StopsWithConstantDeceleration) {
  Interpolator ipo(settings_of(5 * kMs));
  Joints q{}, dq{};
  ipo.start(q, 0);
  ipo.command({0.01, 0}, 1);
  ipo.begin_period(10 * kMs, 0);
  ipo.at(15 * kMs, q, dq);
  const double v = 0.01 / 0.005;
  ipo.stop(14 * kMs);
  ipo.at(14 * kMs, q, dq);
  const double q0 = q[0];
  EXPECT_NEAR(q0, 0.008, 1e-15);
  EXPECT_NEAR(dq[0], v, 1e-12);
  EXPECT_FALSE(ipo.at_rest(113 * kMs));
  ipo.at(64 * kMs, q, dq);  // half of the time: three quarters of the way v t/2
  EXPECT_NEAR(dq[0], v / 2, 1e-12);
  EXPECT_NEAR(q[0], q0 + 0.75 * v * 0.1 / 2, 1e-12);
  for (const std::int64_t t : {114 * kMs, 5000 * kMs}) {
    EXPECT_TRUE(ipo.at_rest(t));
    ipo.at(t, q, dq);
    EXPECT_NEAR(q[0], q0 + v * 0.1 / 2, 1e-12);
    EXPECT_EQ(dq[0], 0);
  }
  ipo.command({9, 9}, 7);  // not any more
  ipo.begin_period(6000 * kMs, 0);
  ipo.at(7000 * kMs, q, dq);
  EXPECT_NEAR(q[0], q0 + v * 0.1 / 2, 1e-12);
}

TEST(FriInterpolator, StepsThroughCommandsOfOneMillisecondAndKeepsTheLimits) {
  Interpolator fast(settings_of(kMs));
  Joints q{}, dq{};
  fast.start(q, 0);
  fast.command({0.5, 0}, 1);
  fast.begin_period(2 * kMs, 0);
  fast.at(2 * kMs, q, dq);
  EXPECT_EQ(q[0], 0.5);

  InterpolatorSettings s = settings_of(5 * kMs, 2.0);
  s.lower.assign(2, -0.05);
  s.upper.assign(2, 0.05);
  Interpolator limited(s);
  limited.start(Joints{}, 0);
  EXPECT_FALSE(limited.is_jump({0.01, 0}, 1));
  EXPECT_TRUE(limited.is_jump({0.0101, 0}, 1));
  EXPECT_FALSE(limited.is_jump({0.0101, 0}, 2));
  EXPECT_TRUE(limited.is_jump({std::nan(""), 0}, 1));
  limited.command({0.04, -0.04}, 4);  // not checked: the set point takes four periods
  double before = 0;
  for (std::int64_t k = 5; k < 30; ++k) {
    limited.begin_period(5 * kMs * k, k - 1 - 4);  // lost for ever: the line ends at the limits
    limited.at(5 * kMs * (k + 1), q, dq);
    EXPECT_LE(std::abs(q[0] - before), 0.01 + 1e-12);
    before = q[0];
  }
  EXPECT_EQ(q[0], 0.05);
  EXPECT_EQ(q[1], -0.05);
}

// A screw: constant speed along z and about it, as seen from the base. Two commands in three are lost.
// Commands that come late, after a continuation that was wrong, are caught up without a step of speed.
TEST(FriInterpolator, CatchesUpWithinTheAccelerationLimit) {
  InterpolatorSettings settings{{1.5}, {}, {}, 5'000'000, 1, 200'000'000, 0, 12, 20};
  Interpolator interpolator(settings);
  interpolator.start({}, 0);
  double speed = 0, q = 0, dq_before = 0, largest = 0;
  for (std::int64_t k = 1; k < 400; ++k) {
    // 0.3 rad/s, reached with 10 rad/s²; from message 100 to 108 nothing comes, and the client has turned back meanwhile.
    const double wanted = k < 100 ? 0.3 : -0.3;
    speed += std::clamp(wanted - speed, -0.05, 0.05);
    q += speed * 5e-3;
    const bool lost = k >= 100 && k < 108;
    if (!lost) {
      Joints command{};
      command[0] = q;
      EXPECT_FALSE(interpolator.is_jerk(command, k)) << k;
      interpolator.command(command, k);
    }
    interpolator.begin_period(k * 5'000'000, lost ? k - 99 : 0);
    Joints at{}, dq{};
    interpolator.at(k * 5'000'000 + 1, at, dq);
    largest = std::max(largest, std::abs(dq[0] - dq_before));
    dq_before = dq[0];
  }
  EXPECT_LE(largest, 20 * 5e-3 * (1 + 1e-9));
  Joints at{}, dq{};
  interpolator.at(400 * 5'000'000, at, dq);
  EXPECT_NEAR(at[0], q, 1e-9) << "without delay afterwards";
}

TEST(FriPoseInterpolator, ContinuesAScrewMotion) {
  PoseInterpolatorSettings settings{10, 100, 4 * kMs, 1, 100 * kMs, 0};
  PoseInterpolator frame(settings);
  const auto screw = [](double k) { return Pose{rotation_from_rpy(0, 0, 0.2 * k), {0.5, 0, 0.01 * k}}; };
  frame.start(screw(0), 0);
  std::int64_t newest = 0;
  for (std::int64_t k = 1; k <= 40; ++k) {  // 8 rad: more than a turn
    const std::int64_t answered = k - 1;
    if (answered > 0 && (answered < 3 || answered % 3 == 0))
      frame.command(screw(static_cast<double>(answered)), newest = answered);
    frame.begin_period(4 * kMs * k, answered - newest);
    if (k < 3) continue;
    for (const double share : {0.0, 0.25, 1.0}) {
      const Pose at = frame.at(4 * kMs * k + static_cast<std::int64_t>(share * 4 * kMs));
      const Pose expected = screw(static_cast<double>(k) - 2 + share);
      EXPECT_LT((at.R - expected.R).cwiseAbs().maxCoeff(), 1e-12) << k;
      EXPECT_LT((at.p - expected.p).norm(), 1e-12) << k;
    }
  }
  // The stop takes half of the way that the speed would make in the stop time: 25 periods.
  const Pose before = frame.at(41 * 4 * kMs);
  frame.stop(41 * 4 * kMs);
  const Pose after = frame.at(41 * 4 * kMs + 200 * kMs);
  EXPECT_NEAR((before.R.transpose() * after.R - rotation_from_rpy(0, 0, 0.2 * 12.5)).norm(), 0, 1e-12);
  EXPECT_NEAR(after.p.z() - before.p.z(), 0.01 * 12.5, 1e-12);
}

TEST(FriPoseInterpolator, KeepsTheSpeedLimits) {
  PoseInterpolatorSettings settings{2, 4, 5 * kMs, 1, 100 * kMs, 0};
  PoseInterpolator frame(settings);
  const Pose origin;
  const auto at = [](double z, double angle) { return Pose{rotation_from_rpy(angle, 0, 0), {0, 0, z}}; };
  frame.start(origin, 10);
  EXPECT_FALSE(frame.is_jump(at(0.0099, 0.0199), 11));
  EXPECT_TRUE(frame.is_jump(at(0.0101, 0), 11));
  EXPECT_TRUE(frame.is_jump(at(0, -0.0201), 11));
  EXPECT_FALSE(frame.is_jump(at(0.0101, -0.0201), 12));
  EXPECT_TRUE(frame.is_jump(at(std::nan(""), 0), 12));
  frame.command(at(1, 3), 11);  // not checked: the set point moves at the limits
  frame.begin_period(0, 0);
  const Pose next = frame.at(5 * kMs);
  EXPECT_NEAR(next.p.z(), 0.01, 1e-15);
  EXPECT_NEAR((next.R - rotation_from_rpy(0.02, 0, 0)).norm(), 0, 1e-12);
}

}  // namespace
}  // namespace cotwin::fri::statistics_test
