#pragma once
#include <exception>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// Conversion between text and numbers or words, independent of the locale.
namespace cotwin::text {

/// Parses the whole of `s`, with blanks around it allowed, as a finite number, ±inf or nan; nullopt for anything else.
std::optional<double> parse_real(std::string_view s);
std::optional<long long> parse_integer(std::string_view s);
/// Parses "true", "1", "false" or "0".
std::optional<bool> parse_boolean(std::string_view s);

/// The shortest text that reads back to the same bits.
std::string to_text(double value);
/// `value` with `digits` significant digits, for display.
std::string to_text(double value, int digits);

std::string_view trim(std::string_view s);
std::vector<std::string_view> split(std::string_view s, char separator);
/// Adds a word to "a, b".
void append(std::string& list, std::string_view word, std::string_view separator = ", ");
/// "a, b, c"
std::string joined(const std::vector<std::string>& words, std::string_view separator = ", ");
/// "1 2.5 -3", each as to_text writes it.
std::string joined(std::span<const double> numbers);

/// "1 message", "2 messages".
std::string counted(std::int64_t number, const std::string& one);

/// As a word that a shell takes as it is: in quotes where it needs them.
std::string for_a_shell(std::string_view word);

/// what() without a name of an exception of nlohmann's in front, such as "[json.exception.parse_error.101] ".
std::string reason_of(const std::exception& error);

/// Valid name of a variable: replaces every character other than a letter, digit, dot or underscore by an underscore.
std::string identifier(const std::string& name);

/// The candidate for "did you mean …": one that begins with `wanted` and an underscore ("link": "link_side"), else the closest by
/// edit distance; empty if none is close.
std::string closest(std::string_view wanted, const std::vector<std::string>& candidates);

}  // namespace cotwin::text
