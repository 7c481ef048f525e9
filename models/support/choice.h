#pragma once
#include <string>
#include <utility>
#include <vector>

#include "models/support/error.h"

namespace cotwin::text {

/// The value of the word `given`. Throws Error at `place` with the list of words.
template <class Value>
Value choose(const std::string& place, const std::string& given, const std::vector<std::pair<const char*, Value>>& words) {
  std::string list;
  for (const auto& [word, value] : words) {
    if (given == word) return value;
    list += (list.empty() ? "" : ", ") + std::string(*word == '\0' ? "''" : word);
  }
  throw Error(place, "'" + given + "', expected one of " + list);
}

}  // namespace cotwin::text
