// Data growing against closed forms of a slide, brute force, and the second evaluation by assess().
#include "models/optimisation/growth/growth.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::optimisation::growth_test {
namespace {

using ::testing::HasSubstr;

constexpr double kMass = 3, kSpeed = 0.8, kFrom = 0.2, kTo = 0.8;

/// A horizontal slide with a load of 3 kg, without friction and gravity along it.
robot::RobotModel slide() {
  return robot::parse_urdf(R"(<robot name="slide"><link name="base"/><joint name="s" type="prismatic"><parent link="base"/>
    <child link="load"/><axis xyz="1 0 0"/><limit lower="0" upper="1" velocity="0.8" effort="1000"/></joint><link name="load">
    <inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>)",
                           "slide");
}

Problem slide_problem(int degree) {
  Problem p;
  p.robot = slide();
  p.ends = {{kFrom}, {0}, {0}, {kTo}, {0}, {0}};
  p.T_min = 0.5;
  p.T_max = 4;
  p.degree = degree;
  p.bounds = bounds_of(p.robot);
  for (const Quantity q : {Quantity::kTime, Quantity::kTorque, Quantity::kWork, Quantity::kJerk}) p.costs.push_back({q, 1, {}});
  p.samples = 56;
  return p;
}

GrowthOptions between(std::vector<double> from, std::vector<double> to, std::uint32_t motions) {
  GrowthOptions o;
  o.c_max.assign(from.size(), 0.1);
  o.from.list = {std::move(from)};
  o.to.list = {std::move(to)};
  o.motions = motions;
  return o;
}

Problem lwr_problem() {
  Problem p;
  p.robot = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  const std::vector<double> zero(7, 0.0);
  p.ends = {{0, 0.5, 0, -1, 0, 0.6, 0}, zero, zero, {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}, zero, zero};
  p.T_min = 0.8;
  p.T_max = 3;
  p.degree = 9;
  p.bounds = bounds_of(p.robot);
  p.bounds.dddq.assign(7, 500.0);
  for (const Quantity q : {Quantity::kTime, Quantity::kTorque, Quantity::kWork}) p.costs.push_back({q, 1, {}});
  p.samples = 56;
  return p;
}

// The quintic over d in T: largest speed 15/8 d/T, work ½ m (15/8 d/T)², ∫ f² = 120/7 m² d²/T³, ∫ jerk² = 720 d²/T⁵.
TEST(Growth, HasTheClosedFormsOfASlide) {
  const Problem p = slide_problem(5);
  GrowthOptions o = between({kFrom}, {kTo}, 20000);
  std::vector<double> T;
  constexpr double d = kTo - kFrom;
  const double shortest = 15.0 / 8 * d / kSpeed;
  std::uint32_t count = 0;
  o.on_batch = [&](const Round& batch) {
    for (const auto& particle : batch.particles) {
      EXPECT_EQ(particle.number, count++);
      EXPECT_EQ(particle.feasible(), particle.T >= shortest);
      if (!particle.feasible()) continue;
      const double v = 15.0 / 8 * d / particle.T;
      EXPECT_NEAR(particle.costs[1], 120.0 / 7 * kMass * kMass * d * d / std::pow(particle.T, 3), 1e-9 * particle.costs[1]);
      EXPECT_NEAR(particle.costs[2], 0.5 * kMass * v * v, 1e-3 * particle.costs[2]);  // its power has a kink
      EXPECT_NEAR(particle.costs[3], 720 * d * d / std::pow(particle.T, 5), 1e-9 * particle.costs[3]);
      T.push_back(particle.T);
    }
  };
  const Harvest h = grow(p, o);
  EXPECT_EQ(h.motions, o.motions);
  EXPECT_EQ(h.feasible, T.size());
  EXPECT_EQ(h.forbidden[1], o.motions - T.size()) << "speed alone forbids";
  const double share = std::log(p.T_max / shortest) / std::log(p.T_max / p.T_min);
  EXPECT_NEAR(h.feasible / 20000.0, share, 4 * std::sqrt(share * (1 - share) / 20000));
  std::ranges::sort(T);
  EXPECT_EQ(h.costs[0].least(), T.front());
  EXPECT_EQ(h.costs[0].most(), T.back());
  for (const double q : {0.0, 0.01, 0.05, 0.5, 0.9, 1.0}) {
    const double exact = T[std::min(static_cast<std::size_t>(q * static_cast<double>(T.size())), T.size() - 1)];
    EXPECT_NEAR(h.costs[0].quantile(q), exact, 0.004 * exact) << q;
  }
  ASSERT_EQ(h.best.size(), 4u);
  EXPECT_EQ(h.best[0][0].T, T.front());
  for (std::size_t term = 1; term < 4; ++term) EXPECT_EQ(h.best[term][0].T, T.back()) << "slower is cheaper";
}

// No motion of a slide needs less work than ½ m (d/T)², that of a constant speed.
TEST(Growth, ComesNearTheLeastWorkOfASlideFromAbove) {
  Problem p = slide_problem(9);
  p.T_min = p.T_max = 2;
  GrowthOptions o = between({kFrom}, {kTo}, 50000);
  o.c_max = {0.2};
  const Harvest h = grow(p, o);
  const double least = 0.5 * kMass * std::pow((kTo - kFrom) / 2, 2), quintic = least * std::pow(15.0 / 8, 2);
  EXPECT_GT(h.costs[2].least(), least);
  EXPECT_LT(h.costs[2].least(), 0.8 * quintic);
  EXPECT_EQ(h.costs[0].least(), 2);
  EXPECT_EQ(h.costs[0].most(), 2);
}

TEST(Growth, FindsWhatBruteForceFindsOnAnyNumberOfThreads) {
  const Problem p = lwr_problem();
  GrowthOptions o = between(p.ends.q_from, p.ends.q_to, 9001);  // more than a batch, and no whole block
  o.c_max.assign(7, 0.15);
  o.best = 5;
  std::vector<Round::Particle> all;
  const auto run = [&](numerics::Threads* threads) {
    all.clear();
    o.on_batch = [&](const Round& batch) { all.insert(all.end(), batch.particles.begin(), batch.particles.end()); };
    return grow(p, o, threads);
  };
  const Harvest one = run(nullptr);
  ASSERT_EQ(all.size(), 9001u);
  const std::vector<Round::Particle> first = all;
  for (const int count : {2, 3}) {
    numerics::Threads threads(count);
    const Harvest other = run(&threads);
    EXPECT_EQ(other.forbidden, one.forbidden);
    for (std::size_t term = 0; term < 3; ++term) {
      EXPECT_EQ(other.costs[term].mean(), one.costs[term].mean());
      ASSERT_EQ(other.best[term].size(), one.best[term].size());
      for (std::size_t k = 0; k < 5; ++k) EXPECT_EQ(other.best[term][k].c, one.best[term][k].c);
    }
    ASSERT_EQ(other.front.size(), one.front.size());
    for (std::size_t k = 0; k < one.front.size(); ++k) EXPECT_EQ(other.front[k].costs, one.front[k].costs);
    for (std::size_t k = 0; k < all.size(); ++k)
      if (all[k].feasible()) {
        EXPECT_EQ(all[k].costs, first[k].costs);
      }
  }
  // A motion depends on its number alone.
  o.motions = 3;
  EXPECT_EQ(grown(p, o, 8999).c, first[8999].c);
  std::uint64_t feasible = 0;
  std::vector<double> least(3, 1e300);
  const auto better = [&](const Round::Particle& a, const Round::Particle& b) {
    return a.costs != b.costs && a.costs[0] <= b.costs[0] && a.costs[1] <= b.costs[1] && a.costs[2] <= b.costs[2];
  };
  std::vector<std::uint64_t> front;
  for (const auto& particle : first) {
    if (!particle.feasible()) continue;
    ++feasible;
    for (std::size_t term = 0; term < 3; ++term) least[term] = std::min(least[term], particle.costs[term]);
    if (std::ranges::none_of(first, [&](const auto& other) { return other.feasible() && better(other, particle); }))
      front.push_back(particle.number);
  }
  EXPECT_GT(feasible, 500u);
  EXPECT_EQ(feasible, one.feasible);
  std::uint64_t forbidden = 0;
  for (const std::uint32_t count : one.forbidden) forbidden += count;
  EXPECT_EQ(forbidden + feasible, 9001u);
  for (std::size_t term = 0; term < 3; ++term) {
    EXPECT_EQ(one.costs[term].least(), least[term]);
    const Solution exact = assess(p, one.best[term][0].c, p.ends.q_to, one.best[term][0].T);
    EXPECT_EQ(exact.status, Status::kFeasible);
    EXPECT_NEAR(one.best[term][0].costs[term], least[term], 1e-3 * least[term]);
  }
  // Where samples and the exact evaluation agree on who is better, the front is the whole one.
  std::vector<std::uint64_t> found;
  for (const auto& particle : one.front) found.push_back(particle.number);
  std::size_t missing = 0;
  for (const std::uint64_t number : front) missing += std::ranges::find(found, number) == found.end() ? 1 : 0;
  EXPECT_LE(missing, front.size() / 10 + 1);
}

TEST(Growth, NamesTheBoundThatIsExceededMost) {
  Problem p = lwr_problem();
  GrowthOptions o = between(p.ends.q_from, p.ends.q_to, 800);
  o.c_max.assign(7, 0);
  const auto only = [&](const Problem& problem, std::size_t bound, std::size_t joint) {
    const Harvest h = grow(problem, o);
    EXPECT_EQ(h.feasible, 0u);
    EXPECT_EQ(h.forbidden[bound * 7 + joint], 800u) << bound << " " << joint;
    EXPECT_EQ(h.costs[0].count(), 0u);
    EXPECT_TRUE(h.best[0].empty());
    EXPECT_TRUE(h.front.empty());
  };
  Problem own = p;
  own.bounds.dddq[2] = 1e-3;
  only(own, 3, 2);
  own = p;
  own.bounds.ddq[4] = 1e-3;
  only(own, 2, 4);
  own = p;
  own.bounds.dq[0] = 1e-3;
  only(own, 1, 0);
  own = p;
  own.T_min = own.T_max = 3;
  own.bounds.tau[1] = 1e-3;
  only(own, 4, 1);
  own = p;
  own.T_min = own.T_max = 3;
  own.bounds.q_max[6] = -0.1;
  only(own, 0, 6);
}

TEST(Growth, DrawsFromListsAndBoxes) {
  const Problem p = slide_problem(7);
  GrowthOptions o;
  o.c_max = {0.05};
  o.from.list = {{0.1}, {0.2}};
  o.to.list = {{0.5}, {0.6}, {0.7}};
  o.motions = 12;
  for (std::uint32_t k = 0; k < 12; ++k) {
    const Round::Particle particle = grown(p, o, k);
    EXPECT_EQ(particle.q_to, o.to.list[k % 3]);
    EXPECT_EQ(particle.q_from, o.from.list[k / 3 % 2]);
    for (const double c : particle.c) EXPECT_LE(std::abs(c), 0.05);
  }
  const Harvest h = grow(p, o);
  ASSERT_EQ(h.goals.size(), 3u);
  o.to = {{}, {0.4}, {0.9}};
  double low = 1, high = 0, mean = 0, c_mean = 0;
  o.motions = 4000;
  for (std::uint32_t k = 0; k < 4000; ++k) {
    const Round::Particle particle = grown(p, o, k);
    low = std::min(low, particle.q_to[0]);
    high = std::max(high, particle.q_to[0]);
    mean += particle.q_to[0] / 4000;
    c_mean += particle.c[0] / 4000;
  }
  EXPECT_NEAR(low, 0.4, 0.002);
  EXPECT_NEAR(high, 0.9, 0.002);
  EXPECT_NEAR(mean, 0.65, 4 * 0.5 / std::sqrt(12.0 * 4000));
  EXPECT_NEAR(c_mean, 0, 4 * 0.05 / 3 / std::sqrt(4000.0));
  EXPECT_TRUE(grow(p, o).goals.empty());
}

TEST(Growth, RefusesWhatDoesNotFit) {
  const Problem p = slide_problem(7);
  const auto refused = [&](const Problem& problem, auto change) {
    GrowthOptions o = between({kFrom}, {kTo}, 10);
    change(o);
    try {
      grow(problem, o);
    } catch (const Error& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_EQ(refused(p, [](GrowthOptions&) {}), "");
  EXPECT_THAT(refused(p, [](GrowthOptions& o) { o.motions = 0; }), HasSubstr("0 motions"));
  EXPECT_THAT(refused(p, [](GrowthOptions& o) { o.c_max = {}; }), HasSubstr("0 ranges"));
  EXPECT_THAT(refused(p, [](GrowthOptions& o) { o.c_max = {NAN}; }), HasSubstr("negative or infinite"));
  EXPECT_THAT(refused(p, [](GrowthOptions& o) { o.from.list[0].push_back(1); }), HasSubstr("2 values"));
  EXPECT_THAT(refused(p, [](GrowthOptions& o) { o.to = {}; }), HasSubstr("neither postures nor a box"));
  EXPECT_THAT(refused(p, [](GrowthOptions& o) { o.to = {{}, {0.5}, {0.4}}; }), HasSubstr("joint s is empty"));
  EXPECT_THAT(refused(p, [](GrowthOptions& o) { o.to = {{}, {NAN}, {0.4}}; }), HasSubstr("joint s is empty"));
  Problem moving = p;
  moving.ends.dq_to = {1};
  EXPECT_THAT(refused(moving, [](GrowthOptions&) {}), HasSubstr("ends in motion"));
}

TEST(Distribution, CountsExactlyAndFindsQuantilesOfAnyNumbers) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  for (const double scale : {1e-6, 1.0, 1e9}) {
    Distribution d;
    std::vector<double> all;
    for (int k = 0; k < 20000; ++k) {
      all.push_back(scale * normal(random));
      d.add(all.back());
    }
    std::ranges::sort(all);
    EXPECT_EQ(d.count(), 20000u);
    EXPECT_EQ(d.least(), all.front());
    EXPECT_EQ(d.most(), all.back());
    for (const double q : {0.001, 0.1, 0.3, 0.7, 0.95}) {
      const auto rank = static_cast<std::size_t>(q * 20000);
      EXPECT_GE(d.quantile(q), all[rank - 1] - 0.004 * std::abs(all[rank - 1])) << scale << " " << q;
      EXPECT_LE(d.quantile(q), all[rank] + 0.004 * std::abs(all[rank])) << scale << " " << q;
    }
    const auto [edges, counts] = d.intervals(24);
    ASSERT_EQ(edges.size(), counts.size() + 1);
    EXPECT_LE(counts.size(), 24u);
    for (std::size_t i = 0; i < counts.size(); ++i) {
      const double low = edges[i], high = edges[i + 1];
      const auto within = std::ranges::count_if(all, [&](double x) { return x >= low && x < high; });
      EXPECT_EQ(counts[i], static_cast<std::uint64_t>(within)) << scale << " " << low;
    }
  }
  Distribution same;
  for (int k = 0; k < 5; ++k) same.add(0);
  EXPECT_EQ(same.quantile(0.5), 0);
  EXPECT_EQ(same.intervals(24).counts, std::vector<std::uint64_t>{5});
  Distribution far;
  for (const double x : {1e-300, 1e300, std::numeric_limits<double>::infinity()}) far.add(x);
  EXPECT_EQ(far.most(), std::numeric_limits<double>::infinity());
  EXPECT_EQ(far.count(), 3u);
}

}  // namespace
}  // namespace cotwin::optimisation::growth_test
