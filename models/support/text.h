#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Numbers and words as text, the same in every locale.
namespace cotwin::text {

/// The whole of `s` (blanks around it allowed) as a finite number or ±inf/nan spelled out; nothing if it is anything else.
std::optional<double> parse_real(std::string_view s);
std::optional<long long> parse_integer(std::string_view s);
/// "true", "1", "false", "0".
std::optional<bool> parse_boolean(std::string_view s);

/// The shortest text that reads back to the same bits.
std::string to_text(double value);
/// `value` with `digits` significant digits, for people.
std::string to_text(double value, int digits);

std::string_view trim(std::string_view s);
std::vector<std::string_view> split(std::string_view s, char separator);

/// The `candidates` closest to `wanted` by edit distance, for "did you mean …"; empty if none is close.
std::string closest(std::string_view wanted, const std::vector<std::string>& candidates);

}  // namespace cotwin::text
