#include "components/tuner/memory.h"

#include <bit>
#include <cstdint>

#include "models/support/error.h"

namespace cotwin::tuner {

void write_numbers(std::span<const double> from, char* to) {
  for (const double x : from) {
    std::uint64_t bits = std::bit_cast<std::uint64_t>(x);
    for (std::size_t k = 0; k < kCharacters; ++k, bits >>= 6) *to++ = static_cast<char>('0' + (bits & 63));
  }
}

void read_numbers(const std::string& from, std::span<double> to, const char* place) {
  if (from.size() != kCharacters * to.size())
    throw Error(place,
                "has " + std::to_string(from.size()) + " characters, expected " + std::to_string(kCharacters * to.size()));
  const char* at = from.data();
  for (double& x : to) {
    std::uint64_t bits = 0;
    for (std::size_t k = 0; k < kCharacters; ++k) {
      const int digit = *at++ - '0';
      // 64 bits leave four for the last character
      if (digit < 0 || digit >= (k + 1 == kCharacters ? 16 : 64))
        throw Error(place, "has characters that no tuner wrote, expected the text of a snapshot");
      bits |= static_cast<std::uint64_t>(digit) << (6 * k);
    }
    x = std::bit_cast<double>(bits);
  }
}

}  // namespace cotwin::tuner
