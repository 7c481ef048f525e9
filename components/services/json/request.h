#pragma once
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "components/services/json/json.h"
#include "components/services/json/schema_parts.h"

/// Reading of requests, for the sources of this folder.
namespace cotwin::services {

using Json = nlohmann::ordered_json;

inline constexpr std::size_t kLongestQuote = 40;  // bytes of a text in a message

/// The start of a text for a message, whole characters of UTF-8.
std::string start_of(const std::string& text, std::size_t longest);

/// The name as part of a JSON pointer (RFC 6901): '~' and '/' are escaped.
std::string pointer_part(const std::string& name);

/// An object whose members are read one by one; finish() refuses the others. All errors are RequestErrors.
///
/// A reader of a schema describes: each function declares its member there, with its type, range, default and description `what`,
/// has() is true, and the default or nothing is returned. So one list of calls reads a request and gives its JSON Schema. Members
/// without a default are required.
class Reader {
 public:
  /// `pointer`: of the object in the request, "" for the request itself.
  explicit Reader(const Json& object, std::string pointer = "");
  explicit Reader(schemas::Object& schema);
  /// The schema of an object whose members read(reader) reads.
  template <class Read>
  static Json schema_of(Read read) {
    schemas::Object schema;
    Reader r(schema);
    read(r);
    return schema;
  }
  bool describes() const { return schema_ != nullptr; }
  /// In a reader that describes: declares a member of its own kind. Its first declaration counts.
  void declare(const std::string& name, Json type, bool required = false, const char* what = nullptr);
  /// The same for at least one of these members. Does not check requests.
  void declare_one_of(std::initializer_list<const char*> names);
  /// Further members of each of these lists that follow.
  void or_instead(std::initializer_list<const char*> names);

  /// Whether the member is given; it then counts as read.
  bool has(const char* name) { return describes() || find(name, true) != nullptr; }
  /// The same for a member that the request should not have: it does not count as read.
  bool gives(const char* name) const { return object_.contains(name); }
  double number(const char* name, std::optional<double> other = {}, const char* what = nullptr);
  /// A number greater than 0; `other` may be any.
  double positive(const char* name, std::optional<double> other = {}, const char* what = nullptr);
  double not_negative(const char* name, double other, const char* what = nullptr);
  /// A number between 0 and 1, both excluded.
  double share(const char* name, double other);
  /// A duration of a move, kBriefest to kLongest, s.
  double duration(const char* name, double other, const char* what);
  int integer(const char* name, int least, int most, int other, const char* what = nullptr);
  bool boolean(const char* name, bool other, const char* what);
  std::vector<double> numbers(const char* name);
  /// An array of `size` numbers; empty if it is optional and not given.
  std::vector<double> vector(const char* name, std::size_t size, bool optional, const char* what = nullptr);
  std::string text(const char* name, std::optional<std::string> other = {}, const char* what = nullptr);
  /// One of `words`; the first one if it is not given.
  std::string word(const char* name, const std::vector<std::string>& words, const char* what = nullptr);
  /// An array of texts, or one text.
  std::vector<std::string> texts(const char* name, const std::vector<std::string>& other, const char* what);
  /// The member itself, or nullptr. Declares nothing.
  const Json* any(const char* name);
  /// Refuses the member `name` unless `used`: "is given, but has no effect without `without`, expected it only with that".
  void only_if(bool used, const char* name, const std::string& without);
  std::string pointer(const char* name) const { return pointer_ + "/" + pointer_part(name); }
  void finish() const;
  /// The same at the end of a request. False: it was only to be described or, with `context.only_read`, only to be checked.
  [[nodiscard]] bool finish(const Context& context) const;

 private:
  const Json* find(const char* name, bool optional);
  double finite(const Json& value, const std::string& place) const;

  const Json& object_;
  std::string pointer_;
  std::set<std::string> read_;
  schemas::Object* schema_ = nullptr;
};

}  // namespace cotwin::services
