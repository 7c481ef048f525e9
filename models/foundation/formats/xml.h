#pragma once
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/foundation/formats/xml_text.h"

/// XML as a tree of plain values: namespaces are resolved, and every element has its position in the file.
namespace cotwin::xml {

/// A text shared by many elements: a file name, a namespace.
class Shared {
 public:
  Shared() = default;
  explicit Shared(std::string text) : text_(text.empty() ? nullptr : std::make_shared<const std::string>(std::move(text))) {}
  bool empty() const { return text_ == nullptr; }
  const std::string& text() const;
  operator const std::string&() const { return text(); }  // NOLINT: implicit on purpose

  friend bool operator==(const Shared& a, const Shared& b) { return a.text_ == b.text_ || a.text() == b.text(); }
  friend bool operator==(const Shared& a, std::string_view b) { return a.text() == b; }

 private:
  std::shared_ptr<const std::string> text_;  // nullptr: ""
};

inline std::string operator+(std::string left, const Shared& right) { return std::move(left) += right.text(); }

/// Position of an element: "twin.ssd:17"; without a line number for line 0, which no file has.
class Place {
 public:
  Place() = default;
  Place(Shared file, std::uint64_t line) : file_(std::move(file)), line_(line) {}
  std::string text() const { return line_ == 0 ? file_.text() : file_.text() + ":" + std::to_string(line_); }
  operator std::string() const { return text(); }  // NOLINT: implicit on purpose
  std::uint64_t line() const { return line_; }

 private:
  Shared file_;
  std::uint64_t line_ = 0;
};
inline std::string operator+(const Place& place, std::string_view more) { return place.text() += more; }

struct Attribute {
  Shared space;  // namespace URI, "" for an attribute without prefix
  std::string name;
  std::string value;
};

struct Element {
  Shared space;      // namespace URI, "" for none
  std::string name;  // without prefix
  Place place;
  std::vector<Attribute> attributes;
  std::vector<Element> children;
  std::string content;  // of an element without children: its character data without surrounding blanks
};

/// Called at the end of every element. `around`: its ancestors, the root first, each with its attributes and the children kept
/// so far. Returns whether the element is kept as a child of the last ancestor.
using Take = std::function<bool(std::span<const Element> around, Element& element)>;

/// Reads a document of UTF-8 text; character data between elements is ignored. Throws Error `place:line: …` for malformed XML,
/// unbound prefixes, duplicate attributes, bytes that are not UTF-8, and nesting deeper than 100 elements. Expands only the
/// five predefined entities and character references; entity declarations are errors; nothing outside `text` is read. With
/// `take`, documents that are too large for a tree can be read.
Element parse(std::string_view text, const std::string& place, const Take& take = nullptr);

/// `text` as an attribute value between double quotes. Throws Error if XML 1.0 cannot represent it.
std::string escaped(std::string_view text);

/// Value of the attribute with this name without prefix, nullptr if there is none.
const std::string* find(const Element& element, std::string_view name);

/// The first child with this namespace and name, nullptr if there is none.
const Element* child(const Element& element, std::string_view space, std::string_view name);

/// Value of a required attribute. Throws Error if it is missing.
const std::string& text(const Element& element, std::string_view name);
std::string text(const Element& element, std::string_view name, std::string_view fallback);

/// Value of an attribute as XML Schema's double, int or boolean. Throws Error if it is invalid, or missing without a fallback.
double real(const Element& element, std::string_view name, std::optional<double> fallback = std::nullopt);
std::int32_t integer(const Element& element, std::string_view name, std::optional<std::int32_t> fallback = std::nullopt);
bool boolean(const Element& element, std::string_view name, std::optional<bool> fallback = std::nullopt);
[[noreturn]] void refuse_value(const Element& element, std::string_view name, const std::string& value,
                               const std::string& expected);
/// The value that the attribute's word stands for.
template <class Value, std::size_t N>
Value choice(const Element& element, std::string_view name, const std::pair<const char*, Value> (&words)[N],
             std::optional<std::type_identity_t<Value>> fallback = std::nullopt) {
  if (fallback && find(element, name) == nullptr) return *fallback;
  const std::string& given = text(element, name);
  std::string list;
  for (const auto& [word, value] : words) {
    if (given == word) return value;
    list += (list.empty() ? "'" : ", '") + std::string(word) + "'";
  }
  refuse_value(element, name, given, "one of " + list);
}

/// Reports an unexpected part of a file: throws, or records it and returns.
using Complaint = std::function<void(const std::string& place, const std::string& what)>;
[[noreturn]] void refuse(const std::string& place, const std::string& what);

/// Reports every attribute without prefix that is not in `known`, with the closest known name.
void check_attributes(const Element& element, const std::vector<std::string>& known, const Complaint& complain = refuse);
/// Reports every child in namespace `space` that is not in `known`; children of other namespaces are ignored.
void check_children(const Element& element, std::string_view space, const std::vector<std::string>& known,
                    const Complaint& complain = refuse);
/// Message that `name` is not `what` (for example "an attribute of 'Event'"), with the closest of `known`.
std::string unknown(const std::string& what, const std::string& name, const std::vector<std::string>& known);

}  // namespace cotwin::xml
