#include "fmu/description/values.h"

#include <algorithm>
#include <limits>

#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

/// Reads a double of XML Schema, which includes INF, -INF and NaN.
std::optional<double> read_double(std::string_view word) {
  if (word == "INF" || word == "+INF") return std::numeric_limits<double>::infinity();
  if (word == "-INF") return -std::numeric_limits<double>::infinity();
  if (word == "NaN") return std::numeric_limits<double>::quiet_NaN();
  return text::parse_real(word);
}

std::vector<std::uint8_t> read_hex(const xml::Element& e, std::string_view digits) {
  const auto value = [&](char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    bad(e, "value", digits, "hexadecimal digits");
  };
  if (digits.size() % 2 != 0) bad(e, "value", digits, "an even number of hexadecimal digits");
  std::vector<std::uint8_t> bytes;
  bytes.reserve(digits.size() / 2);
  for (std::size_t i = 0; i < digits.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(16 * value(digits[i]) + value(digits[i + 1])));
  }
  return bytes;
}

template <class T, class Read>
std::vector<T> read_list(const xml::Element& e, std::string_view list, const std::string& expected, Read read) {
  std::vector<T> values;
  for (const std::string_view word : words(list)) {
    const auto value = read(word);
    if (!value) bad(e, "start", word, expected);
    values.push_back(static_cast<T>(*value));
  }
  return values;
}

}  // namespace

std::optional<std::uint64_t> read_unsigned(std::string_view word) {
  word = text::trim(word);
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  if (word.empty() || word.size() > 20) return std::nullopt;
  std::uint64_t value = 0;
  for (const char c : word) {
    if (c < '0' || c > '9') return std::nullopt;
    const auto digit = static_cast<std::uint64_t>(c - '0');
    if (value > (std::numeric_limits<std::uint64_t>::max() - digit) / 10) return std::nullopt;
    value = 10 * value + digit;
  }
  return value;
}

std::vector<std::string_view> words(std::string_view list) {
  std::vector<std::string_view> found;
  constexpr std::string_view kBlank = " \t\r\n";
  for (std::size_t begin = list.find_first_not_of(kBlank); begin != std::string_view::npos;) {
    const std::size_t end = std::min(list.find_first_of(kBlank, begin), list.size());
    found.push_back(list.substr(begin, end - begin));
    begin = list.find_first_not_of(kBlank, end);
  }
  return found;
}

[[noreturn]] void bad(const xml::Element& e, std::string_view attribute, std::string_view value, const std::string& expected) {
  const std::string shown(value.substr(0, 60));
  throw Error(e.place, std::string(attribute) + " '" + shown + (value.size() > 60 ? "…" : "") + "', expected " + expected);
}

std::optional<double> optional_real(const xml::Element& e, std::string_view attribute) {
  const std::string* value = xml::find(e, attribute);
  if (value == nullptr) return std::nullopt;
  const std::optional<double> number = read_double(*value);
  if (!number) bad(e, attribute, *value, "a number");
  return number;
}

std::optional<std::uint64_t> optional_unsigned(const xml::Element& e, std::string_view attribute) {
  const std::string* value = xml::find(e, attribute);
  if (value == nullptr) return std::nullopt;
  const std::optional<std::uint64_t> number = read_unsigned(*value);
  if (!number) bad(e, attribute, *value, "a non-negative integer");
  return number;
}

std::uint32_t reference_from(const xml::Element& e, std::string_view attribute, std::string_view word) {
  const std::optional<std::uint64_t> number = read_unsigned(word);
  if (!number || *number > std::numeric_limits<std::uint32_t>::max()) bad(e, attribute, word, "a value reference");
  return static_cast<std::uint32_t>(*number);
}

StartValues read_start(const xml::Element& e, const ModelVariable& v, Version version) {
  const std::string* start = xml::find(e, "start");
  const bool scalar2 = version == Version::k2;
  if (v.type == Type::kString || v.type == Type::kBinary) {
    std::vector<std::string> texts;
    if (scalar2) {
      if (start == nullptr) return {};
      texts.push_back(*start);
    } else {
      for (const xml::Element& child : e.children) {
        if (child.name == "Start") texts.push_back(xml::text(child, "value"));
      }
      if (texts.empty()) return {};
    }
    if (v.type == Type::kString) return texts;
    std::vector<std::vector<std::uint8_t>> binaries;
    for (const std::string& text : texts) binaries.push_back(read_hex(e, text));
    return binaries;
  }
  if (start == nullptr || v.type == Type::kClock) return {};
  if (is_float(v.type)) return read_list<double>(e, *start, "numbers", read_double);
  if (v.type == Type::kBoolean) {
    return read_list<bool>(e, *start, "true or false", [](std::string_view w) { return text::parse_boolean(w); });
  }
  if (v.type == Type::kUInt64) return read_list<std::uint64_t>(e, *start, "non-negative integers", read_unsigned);
  const IntegerRange range = range_of(scalar2 ? Type::kInt32 : v.type);
  return read_list<std::int64_t>(e, *start, "integers in the range of " + std::string(name_of(v.type)),
                                 [&](std::string_view w) -> std::optional<std::int64_t> {
                                   const auto n = text::parse_integer(w);
                                   if (!n || *n < range.min || *n > range.max) return std::nullopt;
                                   return static_cast<std::int64_t>(*n);
                                 });
}

void read_numeric(const xml::Element& e, Numeric& n) {
  n.quantity = xml::text(e, "quantity", "");
  n.unit = xml::text(e, "unit", "");
  n.display_unit = xml::text(e, "displayUnit", "");
  n.relative_quantity = xml::boolean(e, "relativeQuantity", false);
  n.unbounded = xml::boolean(e, "unbounded", false);
  n.min = optional_real(e, "min");
  n.max = optional_real(e, "max");
  n.nominal = optional_real(e, "nominal");
  at(e.place, [&] { check_range(n); });
}

void read_clock(const xml::Element& e, Clock& c) {
  c.can_be_deactivated = xml::boolean(e, "canBeDeactivated", false);
  if (const auto priority = optional_unsigned(e, "priority")) c.priority = static_cast<std::uint32_t>(*priority);
  c.interval_variability =
      word_of(e, "intervalVariability", IntervalVariability::kTriggered).value_or(IntervalVariability::kTriggered);
  c.interval = optional_real(e, "intervalDecimal");
  c.shift = optional_real(e, "shiftDecimal").value_or(0);
  c.supports_fraction = xml::boolean(e, "supportsFraction", false);
  c.resolution = optional_unsigned(e, "resolution");
  c.interval_counter = optional_unsigned(e, "intervalCounter");
  c.shift_counter = optional_unsigned(e, "shiftCounter").value_or(0);
}

std::optional<Initial> standard_initial(Causality causality, Variability variability) {
  switch (causality) {
    case Causality::kParameter:
    case Causality::kStructuralParameter:
      return Initial::kExact;
    case Causality::kInput:
      return Initial::kExact;
    case Causality::kIndependent:
      return std::nullopt;
    default:
      return variability == Variability::kConstant ? Initial::kExact : Initial::kCalculated;
  }
}

}  // namespace cotwin::fmu
