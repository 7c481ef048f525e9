#include "models/numerics/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <vector>

namespace cotwin::numerics::random_test {
namespace {

using Words = std::array<std::uint32_t, 4>;

// The known answers published by Salmon et al. with their generator (Random123, kat_vectors, philox4x32-10).
TEST(Philox, GivesThePublishedWords) {
  EXPECT_EQ(philox({0, 0, 0, 0}, {0, 0}), (Words{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
  EXPECT_EQ(philox({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}),
            (Words{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}));
  EXPECT_EQ(philox({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}),
            (Words{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}));
}

constexpr int kCount = 200000;

std::vector<double> numbers(double (*draw)(const Key&), std::uint32_t Key::*along) {
  std::vector<double> values;
  Key key{42, 1, 2, 3, 4};
  for (int i = 0; i < kCount; ++i) {
    key.*along = static_cast<std::uint32_t>(i);
    values.push_back(draw(key));
  }
  return values;
}

struct Moments {
  double mean = 0, variance = 0, serial = 0;
};
Moments moments(const std::vector<double>& values) {
  Moments m;
  const auto n = static_cast<double>(values.size());
  for (const double x : values) m.mean += x / n;
  for (std::size_t i = 0; i < values.size(); ++i) {
    m.variance += (values[i] - m.mean) * (values[i] - m.mean) / n;
    if (i > 0) m.serial += (values[i] - m.mean) * (values[i - 1] - m.mean) / n;
  }
  m.serial /= m.variance;
  return m;
}

// Five standard deviations of each moment's own scatter over kCount numbers.
TEST(Random, UniformNumbersAreUniformAndUncorrelatedAlongEveryPartOfTheKey) {
  for (const auto along : {&Key::stream, &Key::round, &Key::particle, &Key::draw}) {
    const std::vector<double> values = numbers(uniform, along);
    const Moments m = moments(values);
    EXPECT_NEAR(m.mean, 0.5, 5 * std::sqrt(1.0 / 12 / kCount));
    EXPECT_NEAR(m.variance, 1.0 / 12, 5 * std::sqrt(1.0 / 180 / kCount));
    EXPECT_NEAR(m.serial, 0, 5 / std::sqrt(kCount));
    std::vector<int> bins(100);
    for (const double x : values) {
      ASSERT_GE(x, 0);
      ASSERT_LT(x, 1);
      ++bins[static_cast<std::size_t>(100 * x)];
    }
    double chi_squared = 0;
    for (const int count : bins) chi_squared += (count - kCount / 100.0) * (count - kCount / 100.0) / (kCount / 100.0);
    EXPECT_NEAR(chi_squared, 99, 5 * std::sqrt(2 * 99.0));
  }
}

TEST(Random, NormalNumbersHaveTheMomentsOfTheNormalDistribution) {
  for (const auto along : {&Key::round, &Key::particle, &Key::draw}) {
    const std::vector<double> values = numbers(normal, along);
    const Moments m = moments(values);
    EXPECT_NEAR(m.mean, 0, 5 / std::sqrt(kCount));
    EXPECT_NEAR(m.variance, 1, 5 * std::sqrt(2.0 / kCount));
    EXPECT_NEAR(m.serial, 0, 5 / std::sqrt(kCount));
    double third = 0, fourth = 0;
    for (const double x : values) {
      third += x * x * x / kCount;
      fourth += x * x * x * x / kCount;
    }
    EXPECT_NEAR(third, 0, 5 * std::sqrt(15.0 / kCount));
    EXPECT_NEAR(fourth, 3, 5 * std::sqrt(96.0 / kCount));
  }
}

TEST(Random, EveryPartOfTheKeyMatters) {
  const Key key{1, 2, 3, 4, 5};
  std::set<double> values{uniform(key)};
  Key other = key;
  other.seed = 2;
  values.insert(uniform(other));
  other.seed = key.seed + (std::uint64_t{1} << 32);
  values.insert(uniform(other));
  for (const auto part : {&Key::stream, &Key::round, &Key::particle, &Key::draw}) {
    other = key;
    ++(other.*part);
    values.insert(uniform(other));
  }
  EXPECT_EQ(values.size(), 7u);
  EXPECT_EQ(uniform(key), uniform(Key(key)));  // and no other key does
}

}  // namespace
}  // namespace cotwin::numerics::random_test
