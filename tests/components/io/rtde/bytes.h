#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace cotwin::rtde {

/// "00 0556" → {0, 5, 'V'}
inline std::vector<std::uint8_t> bytes(std::string_view hexadecimal) {
  std::vector<std::uint8_t> result;
  std::string digits;
  for (const char c : hexadecimal) {
    if (c == ' ') continue;
    digits += c;
    if (digits.size() < 2) continue;
    result.push_back(static_cast<std::uint8_t>(std::stoi(digits, nullptr, 16)));
    digits.clear();
  }
  return result;
}

/// The bytes of a text.
inline std::vector<std::uint8_t> letters(std::string_view text) { return {text.begin(), text.end()}; }

/// A package: size, kind, contents.
inline std::vector<std::uint8_t> package(char kind, const std::vector<std::uint8_t>& contents = {}) {
  const std::size_t size = contents.size() + 3;
  std::vector<std::uint8_t> result{static_cast<std::uint8_t>(size >> 8), static_cast<std::uint8_t>(size & 0xff),
                                   static_cast<std::uint8_t>(kind)};
  result.insert(result.end(), contents.begin(), contents.end());
  return result;
}

inline std::vector<std::uint8_t> operator+(std::vector<std::uint8_t> a, const std::vector<std::uint8_t>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

}  // namespace cotwin::rtde
