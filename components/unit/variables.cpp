#include "components/unit/variables.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>

#include "components/unit/si.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin {

namespace {

bool is_identifier(std::string_view name) {
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  return !name.empty() && letter(name.front()) &&
         std::all_of(name.begin(), name.end(), [&](char c) { return letter(c) || digit(c) || c == '.'; });
}

bool is_foreign_name(std::string_view name) {
  return !name.empty() &&
         std::none_of(name.begin(), name.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

std::string element_name(const Variable& variable, std::size_t element) {
  return variable.size() == 1 ? variable.name : variable.name + "[" + std::to_string(element + 1) + "]";
}

/// FNV-1a, 64 bits.
class Hash {
 public:
  void add(std::string_view text) {
    for (const char c : text) add_byte(static_cast<unsigned char>(c));
    add_byte(0xff);  // not in UTF-8: separates "ab","c" from "a","bc"
  }
  void add(double value) {
    unsigned char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    for (const unsigned char b : bytes) add_byte(b);
  }
  std::uint64_t value() const { return value_; }

 private:
  void add_byte(unsigned char byte) { value_ = (value_ ^ byte) * 0x100000001b3u; }
  std::uint64_t value_ = 0xcbf29ce484222325u;
};

double read_element(const Variable& variable, std::string_view text, double) {
  const auto value = text::parse_real(text);
  if (!value)
    throw Error(variable.name,
                "'" + std::string(text) + "', expected a number" + (variable.si.empty() ? "" : " in " + variable.si));
  return *value;
}
std::int32_t read_element(const Variable& variable, std::string_view text, std::int32_t) {
  const auto value = text::parse_integer(text);
  if (!value || *value < std::numeric_limits<std::int32_t>::min() || *value > std::numeric_limits<std::int32_t>::max()) {
    throw Error(variable.name, "'" + std::string(text) + "', expected an integer of 32 bits");
  }
  return static_cast<std::int32_t>(*value);
}
bool read_element(const Variable& variable, std::string_view text, bool) {
  const auto value = text::parse_boolean(text);
  if (!value) throw Error(variable.name, "'" + std::string(text) + "', expected true or false");
  return *value;
}
std::string read_element(const Variable&, std::string_view text, const std::string&) { return std::string(text); }

/// Sets an element. A 64-bit integer keeps the digits that double does not have.
template <class Element, class Value>
void assign(const Variable&, Element& element, std::string_view, const Value& value) {
  element = static_cast<Element>(value);
}
void assign(const Variable& variable, double& element, std::string_view text, double value) {
  element = value;
  if (variable.exact == nullptr) return;
  variable.exact->erase(&element);
  text = text::trim(text);
  if (text.find_first_not_of("+-0123456789") != std::string_view::npos) {
    if (value == std::nearbyint(value)) return;
    throw Error(variable.name, std::string(text) + ", expected an integer");
  }
  std::array<char, 400> digits;
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value, std::chars_format::fixed, 0).ptr;
  const std::string_view plain = text.substr(std::min(text.find_first_not_of("+"), text.size()));
  if (plain == std::string_view(digits.data(), end)) return;
  if (const auto integer = text::parse_integer(text)) {
    variable.exact->emplace(&element, static_cast<std::uint64_t>(*integer));
  } else if (std::uint64_t bits = 0; std::from_chars(plain.data(), plain.data() + plain.size(), bits).ec == std::errc{}) {
    variable.exact->emplace(&element, bits);
  } else {
    throw Error(variable.name, std::string(text) + ", expected an integer of 64 bits");
  }
}

/// The words of a list separated by commas, blanks or both.
std::vector<std::string_view> words(std::string_view list) {
  std::vector<std::string_view> found;
  for (const std::string_view part : text::split(list, ',')) {
    bool any = false;
    for (const std::string_view word : text::split(text::trim(part), ' ')) {
      if (text::trim(word).empty()) continue;
      found.push_back(text::trim(word));
      any = true;
    }
    if (!any) found.push_back({});
  }
  return found;
}

}  // namespace

std::string_view name_of(Kind kind) {
  switch (kind) {
    case Kind::kReal:
      return "real";
    case Kind::kInteger:
      return "integer";
    case Kind::kBoolean:
      return "boolean";
    case Kind::kString:
      return "string";
  }
  return "";
}

std::string_view name_of(Role role) {
  switch (role) {
    case Role::kInput:
      return "input";
    case Role::kOutput:
      return "output";
    case Role::kParameter:
      return "parameter";
    case Role::kTunable:
      return "tunable";
    case Role::kState:
      return "state";
  }
  return "";
}

Variables::Declared& Variables::Declared::range(double min, double max) {
  list_.list_[index_].min = min;
  list_.list_[index_].max = max;
  list_.fingerprint_ = 0;
  return *this;
}

Variables::Declared& Variables::Declared::set_rate(Variable::Storage storage) {
  Variable& variable = list_.list_[index_];
  const auto* rate = std::get_if<std::span<double>>(&storage);
  if (rate == nullptr || variable.kind() != Kind::kReal || rate->size() != variable.size() || variable.role != Role::kInput) {
    throw Error(variable.name, "a rate is only for real inputs and must have the size of the input");
  }
  variable.rate = *rate;
  list_.fingerprint_ = 0;
  return *this;
}

Variables::Declared& Variables::Declared::start() {
  Variable& variable = list_.list_[index_];
  if (variable.role != Role::kOutput) throw Error(variable.name, "start() is only for outputs");
  variable.has_start = true;
  return *this;
}

Variables::Declared& Variables::Declared::initially_from(std::vector<std::string> inputs) {
  Variable& variable = list_.list_[index_];
  if (variable.role != Role::kOutput) throw Error(variable.name, "initially_from() is only for outputs");
  variable.initial_inputs = std::move(inputs);
  return *this;
}

Variables::Declared& Variables::Declared::relative() {
  list_.list_[index_].relative = true;
  return *this;
}

Variables::Declared& Variables::Declared::discrete() {
  Variable& variable = list_.list_[index_];
  if (variable.role != Role::kOutput || variable.kind() != Kind::kReal) {
    throw Error(variable.name, "discrete() is only for real outputs");
  }
  variable.discrete = true;
  return *this;
}

Variables::Declared& Variables::Declared::essential() {
  Variable& variable = list_.list_[index_];
  if (variable.role == Role::kOutput) throw Error(variable.name, "an output cannot be essential");
  variable.essential = true;
  return *this;
}

Variables::Declared& Variables::Declared::may_be_lost() {
  Variable& variable = list_.list_[index_];
  if (variable.role != Role::kInput || variable.kind() != Kind::kReal)
    throw Error(variable.name, "may_be_lost() is only for real inputs");
  variable.may_be_lost = true;
  return *this;
}

Variables::Declared& Variables::Declared::required() {
  essential();
  list_.list_[index_].required = true;
  return *this;
}

Variables::Declared& Variables::Declared::nominal(double magnitude) {
  Variable& variable = list_.list_[index_];
  if (variable.kind() != Kind::kReal) throw Error(variable.name, "nominal() is only for reals");
  if (!(magnitude > 0) || !std::isfinite(magnitude)) {
    throw Error(variable.name, "nominal value " + text::to_text(magnitude) + ", expected a positive and finite number");
  }
  variable.nominal = magnitude;
  return *this;
}

Variables::Declared& Variables::Declared::exact(ExactIntegers& storage) {
  list_.list_[index_].exact = &storage;
  return *this;
}

Variables::Declared& Variables::Declared::elements(std::shared_ptr<const Elements> elements) {
  Variable& variable = list_.list_[index_];
  if (elements == nullptr) return *this;
  for (const std::vector<std::string>* list : {&elements->names, &elements->si}) {
    if (!list->empty() && list->size() != variable.size())
      throw Error(variable.name,
                  std::to_string(list->size()) + " names or units of measure, expected " + std::to_string(variable.size()));
  }
  if (!elements->si.empty()) variable.si.clear();
  variable.elements = std::move(elements);
  list_.fingerprint_ = 0;
  return *this;
}

Variables::Declared& Variables::Declared::derivative_of(std::string name) {
  Variable& variable = list_.list_[index_];
  const Variable* of = list_.find(name);
  if (of == nullptr || of->kind() != Kind::kReal || variable.kind() != Kind::kReal || of->size() != variable.size()) {
    throw Error(variable.name, "cannot be the derivative of '" + name + "', expected reals of the same size declared before");
  }
  for (std::size_t i = 0; i < variable.size() && (i == 0 || variable.mixed() || of->mixed()); ++i) {
    if (!si::is_rate(variable.si_of(i), of->si_of(i)))
      throw Error(variable.name, "in " + variable.si_of(i) + " cannot be the derivative of '" + name + "' in " + of->si_of(i));
  }
  variable.derivative_of = std::move(name);
  return *this;
}

Variables::Declared Variables::add(std::string name, Role role, Variable::Storage storage, std::string si,
                                   std::string description) {
  Variable variable;
  variable.name = std::move(name);
  variable.role = role;
  variable.storage = storage;
  variable.si = std::move(si);
  variable.description = std::move(description);
  if (foreign_ && !is_foreign_name(variable.name))
    throw Error("variable '" + variable.name + "'", "expected a name without control characters");
  if (!foreign_ && !is_identifier(variable.name))
    throw Error("variable '" + variable.name + "'", "expected a name of letters, digits, '_' and '.'");
  if (index_.contains(variable.name)) {
    throw Error(variable.name,
                "declared twice, expected names that differ in letters and digits: in names of variables others become _");
  }
  if (variable.description.empty()) throw Error(variable.name, "declared without a description");
  if (variable.kind() == Kind::kReal && !(foreign_ && variable.si.empty())) {
    if (variable.si.empty()) throw Error(variable.name, "declared without a unit of measure; a pure number has \"1\"");
    if (std::ranges::find(known_si_, variable.si) == known_si_.end()) {
      const si::Measure measure = si::parse(variable.si);
      if (measure.factor != 1 || measure.offset != 0)
        throw Error(variable.name, "declared in " + variable.si + ", expected SI");
      known_si_.push_back(variable.si);
    }
  }
  index_.emplace(variable.name, list_.size());
  list_.push_back(std::move(variable));
  fingerprint_ = 0;
  return {*this, list_.size() - 1};
}

const Variable* Variables::find(std::string_view name) const {
  const auto found = index_.find(name);
  return found == index_.end() ? nullptr : &list_[found->second];
}

const Variable& Variables::at(std::string_view name) const {
  if (const Variable* found = find(name)) return *found;
  std::vector<std::string> names;
  for (const Variable& v : list_) names.push_back(v.name);
  const std::string closest = text::closest(name, names);
  throw Error("no variable '" + std::string(name) + "'" + (closest.empty() ? "" : "; did you mean '" + closest + "'?"));
}

void Variables::check_ranges() const {
  for (const Variable& variable : list_) {
    if (variable.role == Role::kOutput || variable.role == Role::kState) continue;
    const auto check = [&](std::size_t element, double value) {
      if (value >= variable.min && value <= variable.max) return;
      throw Error(element_name(variable, element) + " = " + text::to_text(value) +
                  (variable.si_of(element).empty() ? "" : " " + variable.si_of(element)) + ", expected " +
                  allowed_values(variable));
    };
    if (variable.kind() == Kind::kReal) {
      for (std::size_t i = 0; i < variable.size(); ++i) check(i, variable.reals()[i]);
    } else if (variable.kind() == Kind::kInteger) {
      for (std::size_t i = 0; i < variable.size(); ++i) check(i, variable.integers()[i]);
    }
  }
}

std::string Variables::first_not_finite() const {
  for (const Variable& variable : list_) {
    if (variable.kind() != Kind::kReal || (variable.role != Role::kOutput && variable.role != Role::kState)) continue;
    for (std::size_t i = 0; i < variable.size(); ++i) {
      if (!std::isfinite(variable.reals()[i])) return element_name(variable, i);
    }
  }
  return {};
}

std::uint64_t Variables::fingerprint() const {
  if (fingerprint_ != 0) return fingerprint_;
  Hash hash;
  for (const Variable& variable : list_) {
    hash.add(variable.name);
    hash.add(name_of(variable.role));
    hash.add(name_of(variable.kind()));
    hash.add(static_cast<double>(variable.size()));
    hash.add(static_cast<double>(variable.rate.size()));
    hash.add(variable.si);
    for (std::size_t i = 0; variable.mixed() && i < variable.size(); ++i) hash.add(variable.si_of(i));
    hash.add(variable.min);
    hash.add(variable.max);
  }
  fingerprint_ = hash.value() != 0 ? hash.value() : 1;
  return fingerprint_;
}

void assign_text(const Variable& variable, std::string_view value) {
  std::visit(
      [&](auto storage) {
        using Element = typename decltype(storage)::value_type;
        if constexpr (std::is_same_v<Element, std::string>) {
          if (storage.size() == 1) {  // commas and blanks are part of a text
            storage[0] = std::string(value);
            return;
          }
        }
        const std::vector<std::string_view> parts = words(value);
        if (parts.size() != 1 && parts.size() != storage.size()) {
          throw Error(variable.name, std::to_string(parts.size()) + " values, expected 1 or " + std::to_string(storage.size()));
        }
        std::vector<std::conditional_t<std::is_same_v<Element, bool>, char, Element>> read;
        for (const std::string_view part : parts) read.push_back(read_element(variable, part, Element{}));
        for (std::size_t i = 0; i < storage.size(); ++i) {
          const std::size_t from = parts.size() == 1 ? 0 : i;
          assign(variable, storage[i], parts[from], read[from]);
        }
      },
      variable.storage);
}

void assign_text(const Variable& variable, std::size_t element, std::string_view value) {
  if (element >= variable.size()) {
    throw Error(variable.name + "[" + std::to_string(element + 1) + "]",
                "no such element, expected 1 to " + std::to_string(variable.size()));
  }
  std::visit(
      [&](auto storage) {
        assign(variable, storage[element], value, read_element(variable, value, typename decltype(storage)::value_type{}));
      },
      variable.storage);
}

std::string allowed_values(const Variable& variable) {
  const bool low = std::isfinite(variable.min), high = std::isfinite(variable.max);
  if (low && high) return text::to_text(variable.min) + " to " + text::to_text(variable.max);
  if (low) return ">= " + text::to_text(variable.min);
  return high ? "<= " + text::to_text(variable.max) : "a number";
}

ElementName parse_element_name(std::string_view text) {
  const std::size_t bracket = text.find('[');
  if (bracket == std::string_view::npos) {
    if (text.empty()) throw Error("'' is no name of a variable");
    return {std::string(text), -1};
  }
  const std::string_view inside = text.substr(bracket + 1, text.size() - bracket - 2);
  const auto index = text.back() == ']' && text.size() > bracket + 2 ? text::parse_integer(inside) : std::nullopt;
  if (bracket == 0 || !index || *index < 1) {
    throw Error("'" + std::string(text) + "'", "expected a name, or a name and an element counted from 1, as in q[2]");
  }
  return {std::string(text.substr(0, bracket)), static_cast<std::ptrdiff_t>(*index - 1)};
}

FoundElement find_element(const Variables& variables, std::string_view text) {
  if (const Variable* whole = variables.find(text)) return {whole, -1};
  if (text.empty() || text.back() != ']') return {};
  const std::size_t bracket = text.rfind('[');
  if (bracket == std::string_view::npos || bracket == 0) return {};
  const auto index = text::parse_integer(text.substr(bracket + 1, text.size() - bracket - 2));
  const Variable* variable = variables.find(text.substr(0, bracket));
  if (variable == nullptr || !index || *index < 1) return {};
  return {variable, static_cast<std::ptrdiff_t>(*index - 1)};
}

}  // namespace cotwin
