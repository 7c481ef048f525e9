#pragma once
#include <bit>
#include <cstdint>
#include <cstring>

/// Big-endian values in byte buffers, at any alignment. The caller has checked the size.
namespace cotwin::rtde {

template <class T>
T load(const std::uint8_t* from) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) bits = bits << 8 | from[i];
  if constexpr (sizeof(T) == 8) {
    return std::bit_cast<T>(bits);
  } else {
    return static_cast<T>(bits);
  }
}

template <class T>
void store(std::uint8_t* to, T value) {
  std::uint64_t bits = 0;
  if constexpr (sizeof(T) == 8) {
    bits = std::bit_cast<std::uint64_t>(value);
  } else {
    bits = static_cast<std::uint64_t>(value);
  }
  for (std::size_t i = sizeof(T); i-- > 0; bits >>= 8) to[i] = static_cast<std::uint8_t>(bits);
}

}  // namespace cotwin::rtde
