#pragma once
#include <bit>
#include <cstdint>
#include <cstring>

/// Little-endian values in byte buffers, at any alignment. The caller has checked the size.
namespace cotwin::ethercat {

static_assert(std::endian::native == std::endian::little, "values are copied as they are in memory");

template <class T>
T load(const std::uint8_t* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

template <class T>
void store(std::uint8_t* to, T value) {
  std::memcpy(to, &value, sizeof value);
}

}  // namespace cotwin::ethercat
