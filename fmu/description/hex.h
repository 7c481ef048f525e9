#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"

/// Conversion between binary values and the hexadecimal digits of modelDescription.xml.
namespace cotwin::fmu {

inline std::string to_hex(std::span<const std::uint8_t> bytes) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text(2 * bytes.size(), '0');
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    text[2 * i] = kDigits[bytes[i] >> 4];
    text[2 * i + 1] = kDigits[bytes[i] & 15];
  }
  return text;
}

inline void from_hex(const std::string& text, std::vector<std::uint8_t>& bytes) {
  const auto digit = [&](char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    throw Error("'" + text.substr(0, 40) + "'", "expected the hexadecimal digits of a binary value");
  };
  if (text.size() % 2 != 0) throw Error("'" + text.substr(0, 40) + "'", "expected an even number of hexadecimal digits");
  bytes.resize(text.size() / 2);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<std::uint8_t>(16 * digit(text[2 * i]) + digit(text[2 * i + 1]));
  }
}

}  // namespace cotwin::fmu
