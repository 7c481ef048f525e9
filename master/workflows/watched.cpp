#include "master/workflows/watched.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

Condition::Condition(const std::string& text, std::string where) : place(std::move(where)) {
  const std::size_t at = text.find_first_of("<>");
  name = std::string(text::trim(std::string_view(text).substr(0, at)));
  if (at == std::string::npos) return;
  sign = text[at];
  or_equal = at + 1 < text.size() && text[at + 1] == '=';
  const auto number = text::parse_real(text::trim(std::string_view(text).substr(at + (or_equal ? 2 : 1))));
  if (!number || std::isnan(*number))
    throw Error(place, "expected a variable, or a comparison of one with a number, as world.x>0.1");
  limit = *number;
}

Watched::Watched(std::span<const Member> members, const std::string& name, const std::string& place)
    : signal_(find_signal(members, name, place)) {
  if (signal_.variable->kind() == Kind::kString) throw Error(place, name + " is a text, expected numbers");
}

double Watched::largest() const {
  double most = 0;
  for (std::size_t k = 0; k < size(); ++k) most = std::max(most, std::abs(at(k)));
  return most;
}

std::string without_numbers(const std::string& text) {
  std::string rest;
  for (std::size_t k = 0; k < text.size(); ++k) {
    const auto is_digit = [&](std::size_t at) { return at < text.size() && text[at] >= '0' && text[at] <= '9'; };
    const bool is_part = text[k] == '.' || text[k] == 'e' || text[k] == '-' || text[k] == '+';
    if (!is_digit(k) && !(is_part && (is_digit(k + 1) || (k > 0 && is_digit(k - 1))))) rest += text[k];
  }
  return rest;
}

}  // namespace cotwin::master
