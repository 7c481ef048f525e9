#include "models/numerics/random.h"

#include <cmath>
#include <numbers>

namespace cotwin::numerics {
namespace {

std::array<std::uint32_t, 4> words(const Key& key) {
  return philox({key.draw, key.particle, key.round, key.stream},
                {static_cast<std::uint32_t>(key.seed), static_cast<std::uint32_t>(key.seed >> 32)});
}

double unit(std::uint32_t high, std::uint32_t low) {
  return static_cast<double>((static_cast<std::uint64_t>(high) << 21) | (low >> 11)) * 0x1p-53;
}

}  // namespace

std::array<std::uint32_t, 4> philox(std::array<std::uint32_t, 4> counter, std::array<std::uint32_t, 2> key) {
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t a = std::uint64_t{0xD2511F53} * counter[0];
    const std::uint64_t b = std::uint64_t{0xCD9E8D57} * counter[2];
    counter = {static_cast<std::uint32_t>(b >> 32) ^ counter[1] ^ key[0], static_cast<std::uint32_t>(b),
               static_cast<std::uint32_t>(a >> 32) ^ counter[3] ^ key[1], static_cast<std::uint32_t>(a)};
    key[0] += 0x9E3779B9;
    key[1] += 0xBB67AE85;
  }
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
