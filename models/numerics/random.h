#pragma once
#include <array>
#include <cstdint>

/// Counter-based random numbers: a number is a function of its key alone, so results do not depend on threads or the order of
/// work, and no generator state must be saved.
namespace cotwin::numerics {

/// Philox4x32-10 (Salmon, Moraes, Dror, Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3", SC 2011): four independent words
/// from a counter of four and a key of two.
std::array<std::uint32_t, 4> philox(std::array<std::uint32_t, 4> counter, std::array<std::uint32_t, 2> key);

/// The key of a random number: number `draw` of a particle in a round, in one of several independent streams.
struct Key {
  std::uint64_t seed = 0;
  std::uint32_t stream = 0;  // one per purpose
  std::uint32_t round = 0;
  std::uint32_t particle = 0;
  std::uint32_t draw = 0;
  friend bool operator==(const Key&, const Key&) = default;
};

/// Uniform in [0, 1), of 53 bits.
double uniform(const Key& key);
/// Normal, mean 0 and variance 1 (Box and Muller 1958).
double normal(const Key& key);

}  // namespace cotwin::numerics
