#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "fmu/description/consistency.h"
#include "fmu/description/model_description.h"
#include "models/support/error.h"
#include "models/support/xml.h"

/// What stands in the attributes of a modelDescription.xml: words, numbers and values, as they are read before anybody asks how
/// they fit together. Everything throws Error `place:line: …` for what is not written as the standards want it.
namespace cotwin::fmu {

/// The enumerator that `word` is the name of.
template <class Enum>
std::optional<Enum> read_word(std::string_view word, Enum last) {
  for (int i = 0; i <= static_cast<int>(last); ++i) {
    if (name_of(static_cast<Enum>(i)) == word) return static_cast<Enum>(i);
  }
  return std::nullopt;
}

template <class Enum>
std::optional<Enum> word_of(const xml::Element& e, std::string_view attribute, Enum last) {
  const std::string* value = xml::find(e, attribute);
  if (value == nullptr) return std::nullopt;
  const std::optional<Enum> word = read_word(*value, last);
  if (word) return word;
  std::string all;
  for (int i = 0; i <= static_cast<int>(last); ++i) {
    all += (all.empty() ? "" : ", ") + std::string(name_of(static_cast<Enum>(i)));
  }
  throw Error(e.place, std::string(attribute) + " '" + *value + "', expected one of " + all);
}

/// An integer in decimal digits that fits 64 bits without a sign, or nothing.
std::optional<std::uint64_t> read_unsigned(std::string_view word);

/// The words of a list separated by blanks.
std::vector<std::string_view> words(std::string_view list);

[[noreturn]] void bad(const xml::Element& e, std::string_view attribute, std::string_view value, const std::string& expected);

/// Attributes that may be missing.
std::optional<double> optional_real(const xml::Element& e, std::string_view attribute);
std::optional<std::uint64_t> optional_unsigned(const xml::Element& e, std::string_view attribute);

/// `word` as the value reference that `attribute` gives.
std::uint32_t reference_from(const xml::Element& e, std::string_view attribute, std::string_view word);

/// The start values that the attribute `start`, or for strings and binaries of FMI 3 the children <Start>, give.
StartValues read_start(const xml::Element& e, const ModelVariable& v, Version version);
void read_numeric(const xml::Element& e, Numeric& n);
void read_clock(const xml::Element& e, Clock& c);

/// The table of the standards (FMI 2.0: 2.2.7, FMI 3.0: 2.4.7.5) that tells `initial` where a variable does not.
std::optional<Initial> standard_initial(Causality causality, Variability variability);

}  // namespace cotwin::fmu
