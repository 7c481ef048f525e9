#include "components/services/json/request.h"

#include <cmath>

namespace cotwin::services {

namespace {

constexpr double kLargestNumber = 1e15;  // sums and products of larger numbers may overflow
const Json kNothing = Json::object();

std::string type_of(const Json& value) { return std::string("is of type ") + value.type_name(); }

std::string quoted(const std::string& text) { return "'" + start_of(text, kLongestQuote) + "'"; }

}  // namespace

std::string pointer_part(const std::string& name) {
  std::string part;
  for (const char c : name) part += c == '~' ? std::string("~0") : c == '/' ? std::string("~1") : std::string(1, c);
  return part;
}

Reader::Reader(const Json& object, std::string pointer) : object_(object), pointer_(std::move(pointer)) {
  if (!object.is_object()) throw RequestError(pointer_, type_of(object) + ", expected an object");
}

Reader::Reader(schemas::Object& schema) : object_(kNothing), schema_(&schema) {}

void Reader::declare(const std::string& name, Json type, bool required, const char* what) {
  if (!describes() || schema_->members.contains(name)) return;
  if (what) type["description"] = what;
  schema_->may(name.c_str(), std::move(type));
  if (required) schema_->required.push_back(name);
}

void Reader::declare_one_of(std::initializer_list<const char*> names) {
  if (describes()) schema_->one_of(names);
}

void Reader::or_instead(std::initializer_list<const char*> names) {
  if (describes()) schema_->instead = names;
}

double Reader::number(const char* name, std::optional<double> other, const char* what) {
  if (describes()) declare(name, schemas::kNumber, !other, what);
  const Json* const value = find(name, describes() || other.has_value());
  if (!value) return other.value_or(0);
  const double x = finite(*value, pointer(name));
  if (std::abs(x) > kLargestNumber)
    throw RequestError(pointer(name),
                       "is " + Json(x).dump() + ", expected a magnitude of at most " + Json(kLargestNumber).dump());
  return x;
}

double Reader::positive(const char* name, std::optional<double> other, const char* what) {
  if (describes()) declare(name, schemas::positive(), !other, what);
  const double x = number(name, other);
  if (!(x > 0) && any(name)) throw RequestError(pointer(name), "is " + Json(x).dump() + ", expected a number greater than 0");
  return x;
}

double Reader::not_negative(const char* name, double other, const char* what) {
  if (describes()) declare(name, schemas::at_least_zero(), false, what);
  const double x = number(name, other);
  if (x < 0 && any(name)) throw RequestError(pointer(name), "is negative, expected 0 or more");
  return x;
}

double Reader::share(const char* name, double other) {
  if (describes()) declare(name, {{"type", "number"}, {"exclusiveMinimum", 0}, {"exclusiveMaximum", 1}, {"default", other}});
  const double x = positive(name, other);
  if (x >= 1) throw RequestError(pointer(name), "is 1 or more, expected less than 1");
  return x;
}

double Reader::duration(const char* name, double other, const char* what) {
  if (describes()) declare(name, {{"type", "number"}, {"minimum", kBriefest}, {"maximum", kLongest}}, false, what);
  const Json* const value = find(name, true);
  const bool long_one = value && value->is_number() && value->get<double>() > kLongest;
  const double T = long_one ? value->get<double>() : positive(name, other);
  if (any(name) && (T < kBriefest || T > kLongest))
    throw RequestError(pointer(name), "is " + Json(T).dump() + ", expected 0.0001 to 10000 s");
  return T;
}

int Reader::integer(const char* name, int least, int most, int other, const char* what) {
  if (describes()) declare(name, {{"type", "integer"}, {"minimum", least}, {"maximum", most}, {"default", other}}, false, what);
  const Json* value = find(name, true);
  if (!value) return other;
  if (!value->is_number_integer() || *value < least || *value > most)
    throw RequestError(pointer(name), (value->is_number() ? "is " + value->dump() : type_of(*value)) +
                                          ", expected a whole number from " + std::to_string(least) + " to " +
                                          std::to_string(most));
  return value->get<int>();
}

bool Reader::boolean(const char* name, bool other, const char* what) {
  if (describes()) declare(name, {{"type", "boolean"}, {"default", other}}, false, what);
  const Json* value = find(name, true);
  if (!value) return other;
  if (!value->is_boolean()) throw RequestError(pointer(name), type_of(*value) + ", expected true or false");
  return value->get<bool>();
}

std::vector<double> Reader::numbers(const char* name) {
  const Json* value = find(name, false);
  if (!value->is_array()) throw RequestError(pointer(name), type_of(*value) + ", expected an array of numbers");
  std::vector<double> all;
  for (std::size_t i = 0; i < value->size(); ++i) all.push_back(finite((*value)[i], pointer(name) + "/" + std::to_string(i)));
  return all;
}

std::vector<double> Reader::vector(const char* name, std::size_t size, bool optional, const char* what) {
  if (describes()) {
    declare(name, {{"type", "array"}, {"items", schemas::kNumber}, {"minItems", size}, {"maxItems", size}}, !optional, what);
    return {};
  }
  if (optional && !has(name)) return {};
  std::vector<double> x = numbers(name);
  if (x.size() != size)
    throw RequestError(pointer(name), "has " + std::to_string(x.size()) + " values, expected " + std::to_string(size));
  return x;
}

std::string Reader::text(const char* name, std::optional<std::string> other, const char* what) {
  if (describes()) declare(name, schemas::kText, !other, what);
  const Json* value = find(name, describes() || other.has_value());
  if (!value) return other.value_or("");
  if (!value->is_string()) throw RequestError(pointer(name), type_of(*value) + ", expected a string");
  return value->get<std::string>();
}

std::string Reader::word(const char* name, const std::vector<std::string>& words, const char* what) {
  if (describes()) declare(name, {{"type", "string"}, {"enum", words}, {"default", words.front()}}, false, what);
  const std::string given = text(name, words.front());
  std::string expected;
  for (const std::string& word : words) {
    if (word == given) return given;
    text::append(expected, word);
  }
  throw RequestError(pointer(name), "is " + quoted(given) + ", expected one of " + expected);
}

std::vector<std::string> Reader::texts(const char* name, const std::vector<std::string>& other, const char* what) {
  if (describes()) declare(name, {{"type", {"array", "string"}}, {"items", schemas::kText}}, false, what);
  const Json* value = find(name, true);
  if (!value) return other;
  if (value->is_string()) return {value->get<std::string>()};
  if (!value->is_array()) throw RequestError(pointer(name), type_of(*value) + ", expected an array of strings");
  std::vector<std::string> all;
  for (std::size_t i = 0; i < value->size(); ++i) {
    if (!(*value)[i].is_string())
      throw RequestError(pointer(name) + "/" + std::to_string(i), type_of((*value)[i]) + ", expected a string");
    all.push_back((*value)[i].get<std::string>());
  }
  return all;
}

const Json* Reader::any(const char* name) { return find(name, true); }

void Reader::only_if(bool used, const char* name, const std::string& without) {
  if (find(name, true) && !used)
    throw RequestError(pointer(name), "is given, but has no effect without " + without + ", expected it only with that");
}

void Reader::finish() const {
  for (const auto& [name, value] : object_.items()) {
    if (read_.contains(name)) continue;
    const std::string at = pointer(name.substr(0, kLongestQuote).c_str());
    if (at == "/base" || at == "/momentum")
      throw RequestError(
          at, "is given, but this service knows fixed bases only; `reaction` and `reactionless` answer for a free base");
    throw RequestError(at, "is an unknown member, expected one of " + text::joined({read_.begin(), read_.end()}));
  }
}

bool Reader::finish(const Context& context) const {
  finish();
  return !describes() && !context.only_read;
}

const Json* Reader::find(const char* name, bool optional) {
  read_.insert(name);
  const auto at = object_.find(name);
  if (at != object_.end()) return &*at;
  if (!optional) throw RequestError(pointer(name), "is missing, expected it in the request");
  return nullptr;
}

double Reader::finite(const Json& value, const std::string& place) const {
  if (!value.is_number()) throw RequestError(place, type_of(value) + ", expected a number");
  const double x = value.get<double>();
  if (!std::isfinite(x)) throw RequestError(place, "is not finite, expected a finite number");
  return x;
}

}  // namespace cotwin::services
