#include "components/services/json/request.h"

#include <cmath>

namespace cotwin::services {

namespace {

constexpr int kDeepest = 32;
constexpr std::size_t kLongestQuote = 40;

std::string type_of(const Json& value) { return std::string("is of type ") + value.type_name(); }

/// The start of a text for a message, whole characters of UTF-8.
std::string quoted(const std::string& text) {
  std::size_t end = std::min(text.size(), kLongestQuote);
  while (end > 0 && end < text.size() && (static_cast<unsigned char>(text[end]) & 0xC0) == 0x80) --end;
  return "'" + text.substr(0, end) + (end < text.size() ? "…'" : "'");
}

}  // namespace

Json parse_json(std::string_view text) {
  std::vector<std::set<std::string>> names;  // of the objects around the place, arrays have none
  const auto check = [&](int depth, Json::parse_event_t event, Json& value) {
    using Event = Json::parse_event_t;
    if (event == Event::object_start || event == Event::array_start) {
      if (depth >= kDeepest) throw RequestError("", "is nested deeper than " + std::to_string(kDeepest) + ", expected less");
      names.emplace_back();
    } else if (event == Event::object_end || event == Event::array_end) {
      names.pop_back();
    } else if (event == Event::key && !names.back().insert(value.get<std::string>()).second) {
      throw RequestError("", "has the member " + quoted(value.get<std::string>()) + " twice, expected it once");
    }
    return true;
  };
  try {
    return Json::parse(text, check);
  } catch (const nlohmann::json::exception& e) {
    throw RequestError("", std::string("is not JSON: ") + e.what());
  }
}

Json parse_object(std::string_view text) {
  Json object = parse_json(text);
  if (!object.is_object()) throw RequestError("", type_of(object) + ", expected an object");
  return object;
}

std::string pointer_part(const std::string& name) {
  std::string part;
  for (const char c : name) part += c == '~' ? std::string("~0") : c == '/' ? std::string("~1") : std::string(1, c);
  return part;
}

Reader::Reader(const Json& object, std::string pointer) : object_(object), pointer_(std::move(pointer)) {
  if (!object.is_object()) throw RequestError(pointer_, type_of(object) + ", expected an object");
}

double Reader::number(const char* name, std::optional<double> other) {
  if (const Json* value = find(name, other.has_value())) return finite(*value, pointer(name));
  return *other;
}

double Reader::positive(const char* name, std::optional<double> other) {
  const double x = number(name, other);
  if (!(x > 0)) throw RequestError(pointer(name), "is " + Json(x).dump() + ", expected a number greater than 0");
  return x;
}

int Reader::integer(const char* name, int least, int most, int other) {
  const Json* value = find(name, true);
  if (!value) return other;
  if (!value->is_number_integer() || *value < least || *value > most)
    throw RequestError(pointer(name), (value->is_number() ? "is " + value->dump() : type_of(*value)) +
                                          ", expected a whole number from " + std::to_string(least) + " to " +
                                          std::to_string(most));
  return value->get<int>();
}

bool Reader::boolean(const char* name, bool other) {
  const Json* value = find(name, true);
  if (!value) return other;
  if (!value->is_boolean()) throw RequestError(pointer(name), type_of(*value) + ", expected true or false");
  return value->get<bool>();
}

std::vector<double> Reader::numbers(const char* name, bool optional) {
  const Json* value = find(name, optional);
  if (!value) return {};
  if (!value->is_array()) throw RequestError(pointer(name), type_of(*value) + ", expected an array of numbers");
  std::vector<double> all;
  for (std::size_t i = 0; i < value->size(); ++i) all.push_back(finite((*value)[i], pointer(name) + "/" + std::to_string(i)));
  return all;
}

std::string Reader::text(const char* name, std::optional<std::string> other) {
  const Json* value = find(name, other.has_value());
  if (!value) return *other;
  if (!value->is_string()) throw RequestError(pointer(name), type_of(*value) + ", expected a string");
  return value->get<std::string>();
}

std::string Reader::word(const char* name, const std::vector<std::string>& words) {
  const std::string given = text(name, words.front());
  std::string expected;
  for (const std::string& word : words) {
    if (word == given) return given;
    text::append(expected, word);
  }
  throw RequestError(pointer(name), "is " + quoted(given) + ", expected one of " + expected);
}

std::vector<std::string> Reader::texts(const char* name, const std::vector<std::string>& other) {
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
    const std::string known = text::joined({read_.begin(), read_.end()});
    throw RequestError(pointer(name.substr(0, kLongestQuote).c_str()), "is an unknown member, expected one of " + known);
  }
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
