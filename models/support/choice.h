#pragma once
#include <string>
#include <utility>
#include <vector>

#include "models/support/error.h"

namespace cotwin::text {

/// What the word `given` stands for. Throws Error at `place` that lists the words.
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
