#pragma once
#include <cstddef>
#include <string>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

/// Words of files, settings and options, and the values that they stand for: a table of pairs per enumeration.
namespace cotwin::text {

/// The value that the word `given` stands for. Throws Error at `place` that lists the words.
template <class Value, std::size_t N>
Value choose(const std::string& place, const std::string& given, const std::pair<const char*, Value> (&words)[N]) {
  std::string list;
  for (const auto& [word, value] : words) {
    if (given == word) return value;
    text::append(list, *word == '\0' ? "''" : word);
  }
  throw Error(place, "'" + given + "', expected one of " + list);
}

/// The word for `value`, which the table must have.
template <class Value, std::size_t N>
constexpr const char* word_of(Value value, const std::pair<const char*, Value> (&words)[N]) {
  std::size_t i = 0;
  while (i + 1 < N && words[i].second != value) ++i;
  return words[i].first;
}

}  // namespace cotwin::text
