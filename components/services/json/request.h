#pragma once
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "components/services/json/json.h"

/// Reading of requests, for the sources of this folder.
namespace cotwin::services {

using Json = nlohmann::ordered_json;

/// The name as part of a JSON pointer (RFC 6901): '~' and '/' are escaped.
std::string pointer_part(const std::string& name);

/// An object whose members are read one by one; finish() refuses those that nobody read. All errors are RequestErrors.
class Reader {
 public:
  /// `pointer`: of the object in the request, "" for the request itself.
  explicit Reader(const Json& object, std::string pointer = "");

  /// Whether the member is given; it then counts as read.
  bool has(const char* name) { return find(name, true) != nullptr; }
  /// The same for a member that the request should not have: it does not count as read.
  bool gives(const char* name) const { return object_.contains(name); }
  double number(const char* name, std::optional<double> other = {});
  /// A number greater than 0.
  double positive(const char* name, std::optional<double> other = {});
  int integer(const char* name, int least, int most, int other);
  bool boolean(const char* name, bool other);
  std::vector<double> numbers(const char* name, bool optional = false);
  std::string text(const char* name, std::optional<std::string> other = {});
  /// One of `words`; the first one if it is not given.
  std::string word(const char* name, const std::vector<std::string>& words);
  /// An array of texts, or one text.
  std::vector<std::string> texts(const char* name, const std::vector<std::string>& other);
  /// The member itself, or nullptr.
  const Json* any(const char* name);
  /// Refuses the member `name` unless `used`: "is given, but has no effect without `without`, expected it only with that".
  void only_if(bool used, const char* name, const std::string& without);
  std::string pointer(const char* name) const { return pointer_ + "/" + pointer_part(name); }
  void finish() const;

 private:
  const Json* find(const char* name, bool optional);
  double finite(const Json& value, const std::string& place) const;

  const Json& object_;
  std::string pointer_;
  std::set<std::string> read_;
};

}  // namespace cotwin::services
