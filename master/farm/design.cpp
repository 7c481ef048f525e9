#include "master/farm/design.h"

#include <algorithm>
#include <array>
#include <bit>
#include <boost/math/distributions/lognormal.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/triangular.hpp>
#include <boost/math/distributions/uniform.hpp>
#include <boost/random/sobol.hpp>
#include <cmath>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/random.h"

namespace cotwin::master {

namespace {

/// The place of i in a permutation of 0 … n − 1: rounds of a Feistel network, repeated until the result is below n.
std::uint64_t permuted(std::uint64_t i, std::uint64_t n, std::uint64_t seed, std::uint32_t factor) {
  if (n < 2) return 0;
  const int half = (static_cast<int>(std::bit_width(n - 1)) + 1) / 2;
  const std::uint64_t mask = (std::uint64_t{1} << half) - 1;
  const std::array<std::uint32_t, 2> key = {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)};
  do {
    for (std::uint32_t round = 0; round < 6; ++round) {
      const std::uint64_t left = i >> half, right = i & mask;
      const std::uint64_t word = numerics::philox({static_cast<std::uint32_t>(right), round, factor, 1}, key)[0];
      i = (right << half) | ((left ^ word) & mask);
    }
  } while (i >= n);
  return i;
}

/// Calls each(distribution) with the one of Boost.
template <class Each>
auto with_distribution(const Distribution& d, Each each) {
  const auto& x = d.numbers;
  switch (d.kind) {
    case Distribution::Kind::kNormal:
      return each(boost::math::normal_distribution<>(x[0], x[1]));
    case Distribution::Kind::kLogNormal:
      return each(boost::math::lognormal_distribution<>(x[0], x[1]));
    case Distribution::Kind::kTriangular:
      return each(boost::math::triangular_distribution<>(x[0], x[1], x[2]));
    case Distribution::Kind::kLogUniform:
      return each(boost::math::uniform_distribution<>(std::log(x[0]), std::log(x[1])));
    default:
      return each(boost::math::uniform_distribution<>(x[0], x[1]));
  }
}

/// The smallest and largest possible values.
std::pair<double, double> support_of(const Distribution& d) {
  const bool unbounded = d.kind == Distribution::Kind::kNormal, positive = d.kind == Distribution::Kind::kLogNormal;
  const double infinity = std::numeric_limits<double>::infinity();
  const double low = unbounded ? -infinity : positive ? 0 : d.numbers.front();
  return {std::max(d.min, low), std::min(d.max, unbounded || positive ? infinity : d.numbers.back())};
}

/// The share of the values below x, of a finite one or not.
double share_below(const Distribution& d, double x) {
  const bool logarithmic = d.kind == Distribution::Kind::kLogUniform;
  Distribution whole = d;
  whole.min = -std::numeric_limits<double>::infinity();
  whole.max = -whole.min;
  const auto [low, high] = support_of(whole);
  if (!(x > low)) return 0;
  if (!(x < high)) return 1;
  return with_distribution(d, [&](const auto& all) { return boost::math::cdf(all, logarithmic ? std::log(x) : x); });
}

}  // namespace

std::string Distribution::at(double u) const {
  if (kind == Kind::kValues)
    return values[std::min(values.size() - 1, static_cast<std::size_t>(u * static_cast<double>(values.size())))];
  const double from = share_below(*this, min), to = share_below(*this, max);
  const double share = std::clamp(from + u * (to - from), 0x1p-60, 1 - 0x1p-53);
  const double x = with_distribution(*this, [&](const auto& all) { return boost::math::quantile(all, share); });
  const auto [low, high] = support_of(*this);
  return text::to_text(std::clamp(kind == Kind::kLogUniform ? std::exp(x) : x, low, high));
}

std::vector<std::string> Distribution::extremes() const {
  if (kind == Kind::kValues) {
    std::vector<std::pair<double, std::string>> numbers_of;
    for (const std::string& value : values) {
      const auto number = text::parse_real(value);
      if (!number) return {values.begin(), values.begin() + std::min<std::ptrdiff_t>(std::ssize(values), 100)};
      numbers_of.emplace_back(*number, value);
    }
    const auto [least, most] = std::ranges::minmax_element(numbers_of);
    return {least->second, most->second};
  }
  const auto [low, high] = support_of(*this);
  std::vector<std::string> ends;
  for (const double end : {low, high}) {
    if (std::isfinite(end)) ends.push_back(text::to_text(end));
  }
  return ends;
}

void Distribution::check(const std::string& place) const {
  const auto expect = [&](bool right, const char* expected) {
    if (!right) throw Error(place, std::string(text::word_of(kind, kDistributionWords)) + ": expected " + expected);
  };
  if (kind == Kind::kValues) return expect(!values.empty(), "one value at least");
  expect(std::ranges::all_of(numbers, [](double x) { return std::isfinite(x); }), "finite numbers");
  if (kind == Kind::kTriangular)
    return expect(numbers.size() == 3 && numbers[0] <= numbers[1] && numbers[1] <= numbers[2] && numbers[0] < numbers[2],
                  "[low, mode, high] in this order");
  expect(numbers.size() == 2, "two numbers");
  if (kind == Kind::kNormal || kind == Kind::kLogNormal)
    expect(numbers[1] > 0, "[mean, standard deviation] with a deviation > 0");
  if (kind == Kind::kUniform)
    expect(numbers[0] < numbers[1] && std::isfinite(numbers[1] - numbers[0]), "[low, high] with low < high");
  if (kind == Kind::kLogUniform) expect(0 < numbers[0] && numbers[0] < numbers[1], "[low, high] with 0 < low < high");
  expect(share_below(*this, max) - share_below(*this, min) > 1e-12, "values between min and max");
}

std::vector<std::string> Design::typical() const {
  if (kind == DesignKind::kTable) return rows.front();
  std::vector<std::string> all;
  for (const Factor& factor : factors) all.push_back(factor.distribution.at(0.5));
  return all;
}

std::vector<Design::Extreme> Design::extremes() const {
  std::vector<Extreme> all;
  for (std::size_t k = 0; k < factors.size(); ++k) {
    for (const std::string& value : factors[k].distribution.extremes()) {
      std::vector<std::string> point = typical();
      if (kind == DesignKind::kTable) {
        point = *std::ranges::find_if(rows, [&](const std::vector<std::string>& row) { return row[k] == value; });
      } else {
        point[k] = value;
      }
      all.push_back({factors[k].name + "=" + value, std::move(point)});
    }
  }
  return all;
}

std::vector<std::string> Design::point(std::int64_t run) const {
  const auto index = static_cast<std::uint64_t>(run - 1), n = static_cast<std::uint64_t>(runs);
  if (kind == DesignKind::kTable) return rows[index];
  std::vector<std::string> all(factors.size());
  if (kind == DesignKind::kGrid) {
    std::uint64_t rest = index;
    for (std::size_t k = factors.size(); k-- > 0;) {
      const std::vector<std::string>& values = factors[k].distribution.values;
      all[k] = values[rest % values.size()];
      rest /= values.size();
    }
    return all;
  }
  boost::random::sobol sequence(std::max<std::size_t>(factors.size(), 1));
  if (kind == DesignKind::kSobol) sequence.seed(index);
  for (std::size_t k = 0; k < factors.size(); ++k) {
    const auto number = static_cast<std::uint32_t>(index), factor = static_cast<std::uint32_t>(k);
    double u = kind == DesignKind::kSobol ? static_cast<double>(sequence()) * 0x1p-64
                                          : numerics::uniform({.seed = seed, .particle = number, .draw = factor});
    if (kind == DesignKind::kLatinHypercube)  // kept from the borders of the stratum, which rounding could cross
      u = (static_cast<double>(permuted(index, n, seed, factor)) + 0x1p-20 + u * (1 - 0x1p-19)) / static_cast<double>(n);
    all[k] = factors[k].distribution.at(u);
  }
  return all;
}

}  // namespace cotwin::master
