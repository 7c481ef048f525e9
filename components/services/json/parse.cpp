// Text to JSON, within bounds and in time that grows with its length.
#include <algorithm>

#include "components/services/json/request.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

constexpr std::size_t kDeepest = 32, kMostMembers = 4096;
constexpr std::size_t kLongestReason = 300, kLongestPointer = 300;

/// Builds a value piece by piece. nlohmann's own way looks each member up among those before it in its object, one after the other.
class Builder final : public nlohmann::json_sax<Json> {
 public:
  explicit Builder(std::size_t most_values) : most_values_(most_values) {}

  bool null() override { return put(nullptr); }
  bool boolean(bool value) override { return put(value); }
  bool number_integer(number_integer_t value) override { return put(value); }
  bool number_unsigned(number_unsigned_t value) override { return put(value); }
  bool number_float(number_float_t value, const string_t&) override { return put(value); }
  bool string(string_t& value) override { return put(std::move(value)); }
  bool binary(binary_t&) override { return false; }  // not in texts
  bool start_object(std::size_t) override { return open(Json::object()); }
  bool start_array(std::size_t) override { return open(Json::array()); }
  bool end_object() override {
    names_.clear();
    for (const auto& [name, value] : levels_.back()->get_ref<const Json::object_t&>()) names_.push_back(name);
    std::ranges::sort(names_);
    if (const auto twice = std::ranges::adjacent_find(names_); twice != names_.end())
      fail(pointer(levels_.size() - 1),
           "has the member '" + start_of(std::string(*twice), kLongestQuote) + "' twice, expected it once");
    levels_.pop_back();
    return true;
  }
  bool end_array() override {
    levels_.pop_back();
    return true;
  }
  bool key(string_t& name) override {
    auto& members = levels_.back()->get_ref<Json::object_t&>();
    if (members.size() == kMostMembers)
      fail(pointer(levels_.size() - 1), "has more than " + std::to_string(kMostMembers) + " members, expected fewer");
    members.emplace_back(std::move(name), nullptr);
    return true;
  }
  bool parse_error(std::size_t, const std::string&, const nlohmann::detail::exception& error) override {
    fail("", "is not JSON: " + start_of(text::reason_of(error), kLongestReason));
  }

  Json take() { return std::move(root_); }

 private:
  [[noreturn]] static void fail(const std::string& pointer, const std::string& detail) { throw RequestError(pointer, detail); }

  /// Of the value that the first `depth` levels have at last, or of one around it where that has a long name.
  std::string pointer(std::size_t depth) const {
    std::string all;
    for (std::size_t k = 0; k < depth; ++k) {
      const Json& value = *levels_[k];
      const std::string part = "/" + (value.is_array() ? std::to_string(value.size() - 1)
                                                       : pointer_part(value.get_ref<const Json::object_t&>().back().first));
      if (all.size() + part.size() > kLongestPointer) break;
      all += part;
    }
    return all;
  }

  Json* place(Json value) {
    Json* at = &root_;
    if (levels_.empty()) {
      root_ = std::move(value);
    } else if (Json& around = *levels_.back(); around.is_array()) {
      around.push_back(std::move(value));
      at = &around.back();
    } else {
      at = &around.get_ref<Json::object_t&>().back().second;
      *at = std::move(value);
    }
    if (++values_ > most_values_)
      fail(pointer(levels_.size()),
           "is value " + std::to_string(values_) + ", expected at most " + std::to_string(most_values_) + " in all");
    return at;
  }

  bool put(Json value) { return place(std::move(value)) != nullptr; }
  bool open(Json value) {
    Json* const at = place(std::move(value));
    if (levels_.size() == kDeepest)
      fail(pointer(levels_.size()), "is nested deeper than " + std::to_string(kDeepest) + ", expected less");
    levels_.push_back(at);
    return true;
  }

  const std::size_t most_values_;
  std::size_t values_ = 0;
  Json root_;
  std::vector<Json*> levels_;  // the arrays and objects that are open, each the last value of the one before: it stays in place
  std::vector<std::string_view> names_;  // of an object that ends
};

}  // namespace

std::string start_of(const std::string& text, std::size_t longest) {
  std::size_t end = std::min(text.size(), longest);
  while (end > 0 && end < text.size() && (static_cast<unsigned char>(text[end]) & 0xC0) == 0x80) --end;
  return end < text.size() ? text.substr(0, end) + "…" : text;
}

Json parse_json(std::string_view text, std::size_t most_values) {
  Builder builder(most_values);
  Json::sax_parse(text, &builder);
  return builder.take();
}

Json parse_object(std::string_view text, std::size_t most_values) {
  Json object = parse_json(text, most_values);
  if (!object.is_object()) throw RequestError("", std::string("is of type ") + object.type_name() + ", expected an object");
  return object;
}

}  // namespace cotwin::services
