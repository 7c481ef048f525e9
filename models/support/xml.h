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

/// XML as a tree of plain values: namespaces resolved, every element with its place in the file.
namespace cotwin::xml {

/// A text that many elements have in common: a file's name, a namespace.
class Shared {
 public:
  Shared() = default;
  explicit Shared(std::string text) : text_(text.empty() ? nullptr : std::make_shared<const std::string>(std::move(text))) {}
  bool empty() const { return text_ == nullptr; }
  const std::string& text() const;
  operator const std::string&() const { return text(); }  // NOLINT: used as the text that it is

  friend bool operator==(const Shared& a, const Shared& b) { return a.text_ == b.text_ || a.text() == b.text(); }
  friend bool operator==(const Shared& a, std::string_view b) { return a.text() == b; }

 private:
  std::shared_ptr<const std::string> text_;  // nullptr: ""
};

inline std::string operator+(std::string left, const Shared& right) { return std::move(left) += right.text(); }

/// Where an element stands: "twin.ssd:17".
class Place {
 public:
  Place() = default;
  Place(Shared file, std::uint64_t line) : file_(std::move(file)), line_(line) {}
  std::string text() const { return file_.text() + ":" + std::to_string(line_); }
  operator std::string() const { return text(); }  // NOLINT: used as the text that it is
  std::uint64_t line() const { return line_; }

 private:
  Shared file_;
  std::uint64_t line_ = 0;
};
inline std::string operator+(const Place& place, std::string_view more) { return place.text() += more; }

struct Attribute {
  Shared space;  // namespace URI, "" for the usual attribute without prefix
  std::string name;
  std::string value;
};

struct Element {
  Shared space;      // namespace URI, "" for none
  std::string name;  // without prefix
  Place place;
  std::vector<Attribute> attributes;
  std::vector<Element> children;
  std::string content;  // of an element without children: its character data, without the blanks around it
};

/// Hears of every element at its end: `around` are the elements that it lies in, the root first, each with its attributes and
/// the children kept so far. Returns whether the element is kept as a child of the last of them.
using Take = std::function<bool(std::span<const Element> around, Element& element)>;

/// Reads a document of UTF-8 text; character data between elements is left out. Throws Error `place:line: …` for malformed XML,
/// unbound prefixes, doubled attributes, bytes that are not UTF-8, and nesting deeper than 100 elements. No entity but the five
/// of XML and character references is expanded, none may be declared, and nothing outside `text` is read. With `take` a
/// document can be read that is too large for a tree.
Element parse(std::string_view text, const std::string& place, const Take& take = nullptr);

/// Whether `text` is UTF-8 made of characters that XML 1.0 allows.
bool is_xml_text(std::string_view text);

/// `text` as the value of an attribute between double quotes. Throws Error if XML 1.0 has no way to write it.
std::string escaped(std::string_view text);

/// The value of the attribute of that name without prefix, nullptr if there is none.
const std::string* find(const Element& element, std::string_view name);

/// The first child of that namespace and name, nullptr if there is none.
const Element* child(const Element& element, std::string_view space, std::string_view name);

/// The value of a required attribute, or Error naming the element.
const std::string& text(const Element& element, std::string_view name);
std::string text(const Element& element, std::string_view name, std::string_view fallback);

/// The value of an attribute as XML Schema's double, int or boolean. Throws Error where it is anything else; without a fallback
/// also where it is missing.
double real(const Element& element, std::string_view name, std::optional<double> fallback = std::nullopt);
std::int32_t integer(const Element& element, std::string_view name, std::optional<std::int32_t> fallback = std::nullopt);
bool boolean(const Element& element, std::string_view name, std::optional<bool> fallback = std::nullopt);
/// One of `choices`.
std::string choice(const Element& element, std::string_view name, std::initializer_list<const char*> choices,
                   std::optional<std::string> fallback = std::nullopt);

/// What to do about something that a file should not have: throw, or note it and go on.
using Complaint = std::function<void(const std::string& place, const std::string& what)>;
[[noreturn]] void refuse(const std::string& place, const std::string& what);

/// Complains of every attribute without prefix that is not among `known`, and proposes the closest.
void check_attributes(const Element& element, const std::vector<std::string>& known, const Complaint& complain = refuse);
/// Complains of every child in namespace `space` that is not among `known`; children of other namespaces are foreign and let
/// be.
void check_children(const Element& element, std::string_view space, const std::vector<std::string>& known,
                    const Complaint& complain = refuse);
/// Complains of `name`, `what` it is not (e.g. "an attribute of 'Event'"), and proposes the closest of `known`.
std::string unknown(const std::string& what, const std::string& name, const std::vector<std::string>& known);

}  // namespace cotwin::xml
