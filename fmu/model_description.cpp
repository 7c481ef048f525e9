#include "fmu/model_description.h"

#include <array>

namespace cotwin::fmu {

namespace {

template <std::size_t N, class Enum>
std::string_view word(const std::array<std::string_view, N>& words, Enum value) {
  return words.at(static_cast<std::size_t>(value));
}

}  // namespace

std::string_view name_of(Type type) {
  static constexpr std::array<std::string_view, 15> kWords = {"Float32", "Float64", "Int8",   "UInt8",       "Int16",
                                                              "UInt16",  "Int32",   "UInt32", "Int64",       "UInt64",
                                                              "Boolean", "String",  "Binary", "Enumeration", "Clock"};
  return word(kWords, type);
}

std::string_view name_of(Causality causality) {
  static constexpr std::array<std::string_view, 7> kWords = {"parameter",   "calculatedParameter", "input", "output", "local",
                                                             "independent", "structuralParameter"};
  return word(kWords, causality);
}

std::string_view name_of(Variability variability) {
  static constexpr std::array<std::string_view, 5> kWords = {"constant", "fixed", "tunable", "discrete", "continuous"};
  return word(kWords, variability);
}

std::string_view name_of(Initial initial) {
  static constexpr std::array<std::string_view, 3> kWords = {"exact", "approx", "calculated"};
  return word(kWords, initial);
}

std::string_view name_of(DependencyKind kind) {
  static constexpr std::array<std::string_view, 5> kWords = {"dependent", "constant", "fixed", "tunable", "discrete"};
  return word(kWords, kind);
}

std::string_view name_of(IntervalVariability variability) {
  static constexpr std::array<std::string_view, 6> kWords = {"constant", "fixed",     "tunable",
                                                             "changing", "countdown", "triggered"};
  return word(kWords, variability);
}

}  // namespace cotwin::fmu
