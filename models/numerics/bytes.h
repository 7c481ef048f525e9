#pragma once
#include <bit>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "models/support/error.h"

/// Numbers as little-endian bytes and back, for states that go into files.
namespace cotwin::numerics {

class ByteWriter {
 public:
  void number(std::uint64_t n) {
    for (int i = 0; i < 8; ++i) bytes_.push_back(static_cast<unsigned char>(n >> (8 * i)));
  }
  void numbers(std::span<const double> v) {
    number(v.size());
    for (const double x : v) number(std::bit_cast<std::uint64_t>(x));
  }
  std::vector<unsigned char> take() { return std::move(bytes_); }

 private:
  std::vector<unsigned char> bytes_;
};

class ByteReader {
 public:
  /// `place`: for messages.
  ByteReader(std::span<const unsigned char> bytes, std::string place) : bytes_(bytes), place_(std::move(place)) {}

  /// Throws Error where the bytes end.
  std::uint64_t number() {
    if (bytes_.size() - at_ < 8) throw Error(place_, "ends after " + std::to_string(bytes_.size()) + " bytes, expected more");
    std::uint64_t n = 0;
    for (int i = 0; i < 8; ++i) n |= std::uint64_t{bytes_[at_++]} << (8 * i);
    return n;
  }
  std::vector<double> numbers() {
    const std::uint64_t count = number();
    if (count > (bytes_.size() - at_) / 8)
      throw Error(place_,
                  "has " + std::to_string((bytes_.size() - at_) / 8) + " numbers left, expected " + std::to_string(count));
    std::vector<double> v(count);
    for (double& x : v) x = std::bit_cast<double>(number());
    return v;
  }
  /// What is left, for another reader.
  std::span<const unsigned char> rest() const { return bytes_.subspan(at_); }
  /// Throws Error if bytes are left.
  void end() const {
    if (at_ != bytes_.size()) throw Error(place_, std::to_string(bytes_.size() - at_) + " bytes more than expected");
  }

 private:
  std::span<const unsigned char> bytes_;
  std::string place_;
  std::size_t at_ = 0;
};

}  // namespace cotwin::numerics
