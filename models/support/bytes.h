#pragma once
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>

#include "models/support/error.h"

/// Byte strings for exchange between processes: little-endian values without padding, strings preceded by their length. Only
/// little-endian machines are supported (asserted in snapshot.cpp).
namespace cotwin {

class ByteWriter {
 public:
  template <class T>
  void value(const T& v) {
    static_assert(std::is_arithmetic_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&v), sizeof v);
  }
  void text(const std::string& s) {
    value(static_cast<std::uint64_t>(s.size()));
    bytes_ += s;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

/// Reads the output of ByteWriter. Throws Error `place: …` instead of reading past the end.
class ByteReader {
 public:
  ByteReader(std::span<const std::byte> bytes, std::string place) : bytes_(bytes), place_(std::move(place)) {}

  template <class T>
  T value() {
    static_assert(std::is_arithmetic_v<T>);
    T v;
    std::memcpy(&v, take(sizeof v), sizeof v);
    return v;
  }
  std::string text() {
    const std::size_t n = count(1);
    return std::string(reinterpret_cast<const char*>(take(n)), n);
  }
  /// Reads a number of elements of at least `size` bytes each. Throws Error if the remaining bytes cannot contain them.
  std::size_t count(std::size_t size) {
    const auto n = value<std::uint64_t>();
    if (n > bytes_.size() / size) fail("is damaged or cut short");
    return static_cast<std::size_t>(n);
  }
  std::span<const std::byte> rest() const { return bytes_; }
  void expect_end() const {
    if (!bytes_.empty()) fail("has bytes after its end");
  }
  [[noreturn]] void fail(const std::string& what) const { throw Error(place_, what); }

 private:
  const std::byte* take(std::size_t n) {
    if (n > bytes_.size()) fail("is cut short");
    const std::byte* begin = bytes_.data();
    bytes_ = bytes_.subspan(n);
    return begin;
  }
  std::span<const std::byte> bytes_;
  std::string place_;
};

/// FNV-1a, 64 bits. `seed` combines several byte strings into one hash or selects another hash of the same bytes.
inline std::uint64_t hash_of(std::string_view bytes, std::uint64_t seed = 0xcbf29ce484222325u) {
  for (const char c : bytes) seed = (seed ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  return seed;
}

inline std::span<const std::byte> as_bytes(std::string_view text) {
  return {reinterpret_cast<const std::byte*>(text.data()), text.size()};
}

}  // namespace cotwin
