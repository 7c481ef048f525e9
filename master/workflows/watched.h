#pragma once
#include <span>
#include <string>

#include "master/engine/wiring/members.h"

/// Variables of a run that are looked at after each tick, and conditions on them.
namespace cotwin::master {

/// "component.variable", true or not 0, or a comparison of it with a number: "component.variable>0.1"
struct Condition {
  /// `place`: for messages. Throws Error for another text.
  Condition(const std::string& text, std::string place);
  bool holds(double value) const {
    if (sign == '>') return or_equal ? value >= limit : value > limit;
    if (sign == '<') return or_equal ? value <= limit : value < limit;
    return value != 0;
  }
  std::string place, name;
  char sign = 0;
  bool or_equal = false;
  double limit = 0;
};

/// A variable as numbers; booleans are 0 or 1.
class Watched {
 public:
  /// Throws Error at `place` for a name that is not there, and for a text.
  Watched(std::span<const Member> members, const std::string& name, const std::string& place);
  std::size_t size() const { return signal_.count; }
  double at(std::size_t element) const {
    const Variable& v = *signal_.variable;
    const std::size_t k = signal_.first + element;
    if (v.kind() == Kind::kReal) return v.reals()[k];
    return v.kind() == Kind::kInteger ? v.integers()[k] : static_cast<double>(v.booleans()[k]);
  }
  double largest() const;
  const Signal& signal() const { return signal_; }

 private:
  Signal signal_;
};

/// The text without its numbers, by which warnings of runs with different values are compared.
std::string without_numbers(const std::string& text);

}  // namespace cotwin::master
