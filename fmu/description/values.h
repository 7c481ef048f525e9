#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "fmu/description/consistency.h"
#include "fmu/description/model_description.h"
#include "models/foundation/formats/xml.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

/// Reads words, numbers and values from the attributes of a modelDescription.xml. Relations between them are checked elsewhere
/// (consistency.h). All functions throw Error `place:line: …` for a value that the standard does not allow.
namespace cotwin::fmu {

/// Returns the enumerator with the name `word`.
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
    text::append(all, std::string(name_of(static_cast<Enum>(i))));
  }
  throw Error(e.place, std::string(attribute) + " '" + *value + "', expected one of " + all);
}

/// Returns an unsigned 64-bit integer in decimal digits, or nothing.
std::optional<std::uint64_t> read_unsigned(std::string_view word);

std::vector<std::string_view> words(std::string_view list);

[[noreturn]] void bad(const xml::Element& e, std::string_view attribute, std::string_view value, const std::string& expected);

std::optional<double> optional_real(const xml::Element& e, std::string_view attribute);
std::optional<std::uint64_t> optional_unsigned(const xml::Element& e, std::string_view attribute);

/// Returns `word`, a part of `attribute`, as a value reference.
std::uint32_t reference_from(const xml::Element& e, std::string_view attribute, std::string_view word);

/// Reads the start values from the attribute `start` or, for strings and binaries of FMI 3, from the children <Start>.
StartValues read_start(const xml::Element& e, const ModelVariable& v, Version version);
void read_numeric(const xml::Element& e, Numeric& n);
void read_clock(const xml::Element& e, Clock& c);

/// Returns the standard's default of `initial` (tables in FMI 2.0: 2.2.7, FMI 3.0: 2.4.7.5).
std::optional<Initial> standard_initial(Causality causality, Variability variability);

}  // namespace cotwin::fmu
