#pragma once
#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::text {

/// Splits text, which outlives it, into lines of words between blanks.
class Lines {
 public:
  /// `place`: its name in messages. Throws Error for UTF-16.
  Lines(std::string_view bytes, const std::string& place) : after_(bytes), place_(place) {
    if (bytes.starts_with("\xFF\xFE") || bytes.starts_with("\xFE\xFF"))
      throw Error(place, "is UTF-16 text, expected ASCII or UTF-8");
    if (bytes.starts_with("\xEF\xBB\xBF")) after_.remove_prefix(3);
  }
  /// Goes to the next line; false at the end.
  bool next() {
    if (after_.empty()) return false;
    ++number_;
    line_ = after_.substr(0, after_.find('\n'));
    after_.remove_prefix(std::min(line_.size() + 1, after_.size()));
    rest_ = line_ = trim(line_);
    return true;
  }
  /// The next word of the line; "" at its end.
  std::string_view word() {
    constexpr std::string_view kBlanks = " \t\r";
    rest_.remove_prefix(std::min(rest_.find_first_not_of(kBlanks), rest_.size()));
    const std::string_view word = rest_.substr(0, rest_.find_first_of(kBlanks));
    rest_.remove_prefix(word.size());
    return word;
  }
  std::string_view line() const { return line_; }
  /// What is after the line.
  std::string_view after() const { return after_; }
  const std::string& place() const { return place_; }
  [[noreturn]] void fail(std::string_view what, const std::string& expected) const {
    throw Error(place_ + ":" + std::to_string(number_), "'" + std::string(what.substr(0, 60)) + "', expected " + expected);
  }

 private:
  std::string_view after_, line_, rest_;
  const std::string& place_;
  std::size_t number_ = 0;
};

}  // namespace cotwin::text
