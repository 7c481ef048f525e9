#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace cotwin::bag {

/// What is wrong in a message; who reads it knows which one it is.
class Fault : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Reads a message in CDR (OMG DDSI-RTPS 2.3, clause 10; XCDR version 1) of either byte order. Throws Fault instead of reading past the end.
class Cdr {
 public:
  explicit Cdr(std::span<const std::byte> message) {
    if (message.size() < 4) throw Fault("is shorter than the head of CDR");
    const int kind = std::to_integer<int>(message[0]) << 8 | std::to_integer<int>(message[1]);
    if (kind == 0x28B5) throw Fault("is compressed by itself (zstd): ros2 bag convert writes a bag without compression_mode");
    if (kind > 1) throw Fault("is not in plain CDR");
    swap_ = kind == 0;
    bytes_ = message.subspan(4);
  }

  template <class T>
  T number() {
    align(sizeof(T));
    std::array<std::byte, sizeof(T)> raw;
    std::memcpy(raw.data(), take(sizeof(T)), sizeof(T));
    if (swap_) std::ranges::reverse(raw);
    T value;
    std::memcpy(&value, raw.data(), sizeof(T));
    return value;
  }
  /// Number of elements of a sequence, which take at least a byte each.
  std::size_t count() {
    const auto n = number<std::uint32_t>();
    if (n > bytes_.size() - at_) throw Fault("has a sequence that is longer than the message");
    return n;
  }
  std::string_view text() {
    const std::size_t n = count();
    const char* const first = reinterpret_cast<const char*>(take(n));
    return {first, n == 0 ? 0 : n - 1};  // a final 0
  }
  std::size_t at() const { return at_; }
  std::span<const std::byte> from(std::size_t begin) const { return bytes_.subspan(begin, at_ - begin); }
  /// Passes over these bytes if they are next.
  bool skip(std::string_view expected) {
    if (expected.empty() || expected.size() > bytes_.size() - at_ ||
        std::memcmp(bytes_.data() + at_, expected.data(), expected.size()) != 0)
      return false;
    at_ += expected.size();
    return true;
  }

  /// Passes over the bytes before a member of this size.
  void align(std::size_t size) { at_ = std::min(bytes_.size(), (at_ + size - 1) / size * size); }

 private:
  const std::byte* take(std::size_t count) {
    if (count > bytes_.size() - at_) throw Fault("ends within a member");
    at_ += count;
    return bytes_.data() + at_ - count;
  }

  std::span<const std::byte> bytes_;
  std::size_t at_ = 0;
  bool swap_ = false;
};

}  // namespace cotwin::bag
