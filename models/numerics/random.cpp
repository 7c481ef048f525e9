#include "models/numerics/random.h"

#include <cmath>
#include <numbers>

namespace cotwin::numerics {
namespace {

#include "models/numerics/philox.inc"

std::array<std::uint32_t, 4> words(const Key& key) {
  return philox({key.draw, key.particle, key.round, key.stream},
                {static_cast<std::uint32_t>(key.seed), static_cast<std::uint32_t>(key.seed >> 32)});
}

double unit(std::uint32_t high, std::uint32_t low) {
  return static_cast<double>((static_cast<std::uint64_t>(high) << 21) | (low >> 11)) * 0x1p-53;
}

}  // namespace

std::array<std::uint32_t, 4> philox(std::array<std::uint32_t, 4> counter, std::array<std::uint32_t, 2> key) {
  philox_words(counter.data(), key[0], key[1]);
  return counter;
}

double uniform(const Key& key) {
  const auto w = words(key);
  return unit(w[0], w[1]);
}

double normal(const Key& key) {
  const auto w = words(key);
  const double radius = std::sqrt(-2 * std::log(1 - unit(w[0], w[1])));  // 1 − u is never 0
  return radius * std::cos(2 * std::numbers::pi * unit(w[2], w[3]));
}

}  // namespace cotwin::numerics
