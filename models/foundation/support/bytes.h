#pragma once
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "models/foundation/support/error.h"

/// Byte strings for files and other processes: little-endian values without padding, lists and strings preceded by their length.
namespace cotwin {

static_assert(std::endian::native == std::endian::little, "byte strings hold values as they are in memory");

class ByteWriter {
 public:
  ByteWriter() = default;
  /// Writes into `buffer`, whose content is dropped and whose capacity is used.
  explicit ByteWriter(std::string buffer) : bytes_(std::move(buffer)) { bytes_.clear(); }

  template <class T>
  void value(const T& v) {
    static_assert(std::is_arithmetic_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&v), sizeof v);
  }
  void text(std::string_view s) {
    value(static_cast<std::uint64_t>(s.size()));
    bytes_ += s;
  }
  /// The values alone; the reader has their number from elsewhere.
  template <class T>
  void values(std::span<const T> v) {
    static_assert(std::is_arithmetic_v<T>);
    bytes_.append(reinterpret_cast<const char*>(v.data()), v.size_bytes());
  }
  template <class T>
  void list(const std::vector<T>& v) {
    value(static_cast<std::uint64_t>(v.size()));
    values(std::span<const T>(v));
  }
  const std::string& bytes() const { return bytes_; }
  std::string take() { return std::move(bytes_); }

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
  template <class T>
  void values(std::span<T> to) {
    static_assert(std::is_arithmetic_v<T>);
    const std::byte* const from = take(to.size_bytes());
    if (!to.empty()) std::memcpy(to.data(), from, to.size_bytes());
  }
  template <class T>
  std::vector<T> list() {
    std::vector<T> v(count(sizeof(T)));
    values(std::span<T>(v));
    return v;
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
