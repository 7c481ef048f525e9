#include "models/foundation/support/text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <numeric>

namespace cotwin::text {

namespace {

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, substituted});
    }
  }
  return row[b.size()];
}

template <class Number>
std::optional<Number> parse_number(std::string_view s) {
  s = trim(s);
  if (!s.empty() && s.front() == '+') s.remove_prefix(1);
  if (s.empty() || s.front() == '+') return std::nullopt;
  Number value{};
  const auto [end, error] = std::from_chars(s.data(), s.data() + s.size(), value);
  if (error != std::errc{} || end != s.data() + s.size()) return std::nullopt;
  return value;
}

}  // namespace

std::optional<double> parse_real(std::string_view s) { return parse_number<double>(s); }

std::optional<long long> parse_integer(std::string_view s) { return parse_number<long long>(s); }

std::optional<bool> parse_boolean(std::string_view s) {
  s = trim(s);
  if (s == "true" || s == "1") return true;
  if (s == "false" || s == "0") return false;
  return std::nullopt;
}

std::string to_text(double value) {
  std::array<char, 32> buffer;
  const auto result = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return std::string(buffer.data(), result.ptr);
}

std::string to_text(double value, int digits) {
  std::array<char, 64> buffer;
  const auto result = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, std::chars_format::general, digits);
  return std::string(buffer.data(), result.ptr);
}

std::string_view trim(std::string_view s) {
  const std::string_view blanks = " \t\r\n";
  const std::size_t first = s.find_first_not_of(blanks);
  if (first == std::string_view::npos) return {};
  return s.substr(first, s.find_last_not_of(blanks) - first + 1);
}

void append(std::string& list, std::string_view word, std::string_view separator) {
  if (!list.empty()) list += separator;
  list += word;
}

std::string joined(const std::vector<std::string>& words, std::string_view separator) {
  std::string all;
  for (std::size_t i = 0; i < words.size(); ++i) all.append(i == 0 ? "" : separator).append(words[i]);
  return all;
}

std::string joined(std::span<const double> numbers) {
  std::string all;
  for (const double x : numbers) append(all, to_text(x), " ");
  return all;
}

std::vector<std::string_view> split(std::string_view s, char separator) {
  std::vector<std::string_view> parts;
  for (std::size_t begin = 0;;) {
    const std::size_t end = s.find(separator, begin);
    parts.push_back(s.substr(begin, end - begin));
    if (end == std::string_view::npos) return parts;
    begin = end + 1;
  }
}

std::string closest(std::string_view wanted, const std::vector<std::string>& candidates) {
  std::string best;
  std::size_t least = wanted.size() / 3 + 1;  // a larger distance is not a typing error
  constexpr std::size_t kLongest = 200;       // the search costs the product of the lengths
  if (wanted.size() > kLongest) return best;
  const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  const auto same =
      std::ranges::find_if(candidates, [&](const std::string& c) { return std::ranges::equal(c, wanted, {}, lower, lower); });
  if (same != candidates.end()) return *same;
  const std::string first_part = std::string(wanted) + "_";
  const auto whole = std::ranges::find_if(candidates, [&](const std::string& c) { return c.starts_with(first_part); });
  if (whole != candidates.end()) return *whole;
  const bool is_element = wanted.ends_with(']');
  for (const std::string& full : candidates) {
    // Of a vector without its element: "tauJ" is nearer to tau_J[1] than to q[1].
    const std::string_view candidate =
        std::string_view(full).substr(0, is_element || !full.ends_with(']') ? full.size() : full.rfind('['));
    const std::size_t longer = std::max(candidate.size(), wanted.size()), shorter = std::min(candidate.size(), wanted.size());
    if (longer - shorter > least) continue;  // lower bound of the distance
    const std::size_t distance = edit_distance(wanted, candidate);
    if (distance < least || (distance == least && best.empty())) {
      least = distance;
      best = full;
    }
  }
  return best;
}

std::string for_a_shell(std::string_view word) {
  const bool is_plain = !word.empty() && std::ranges::all_of(word, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || static_cast<unsigned char>(c) > 127 ||
           std::string_view("/._-+,").find(c) != std::string_view::npos;
  });
  if (is_plain) return std::string(word);
  std::string quoted = "'";
  for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

std::string counted(std::int64_t number, const std::string& one) {
  return std::to_string(number) + " " + one + (number == 1 ? "" : "s");
}

std::string reason_of(const std::exception& error) {
  const std::string what = error.what();
  const std::size_t end = what.starts_with("[json.") ? what.find("] ") : std::string::npos;
  return end == std::string::npos ? what : what.substr(end + 2);
}

std::string identifier(const std::string& name) {
  std::string id = name;
  for (char& c : id) {
    const bool fits = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '.';
    if (!fits) c = '_';
  }
  if (id.empty() || (id.front() >= '0' && id.front() <= '9')) id.insert(0, "_");
  return id;
}

}  // namespace cotwin::text
