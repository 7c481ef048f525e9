#include "models/text/xml.h"

#include <tinyxml2.h>

#include <algorithm>
#include <limits>
#include <map>

#include "models/text/error.h"
#include "models/text/text.h"
#include "models/text/xml_reason.h"

namespace cotwin::xml {

namespace {

using Prefixes = std::map<std::string, std::string>;  // prefix → namespace URI

/// The length of the UTF-8 sequence at the head of `s` if it is a character that XML 1.0 allows (its clause 2.2), else 0.
std::size_t character_length(std::string_view s) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(s[i]); };
  const unsigned first = byte(0);
  if (first < 0x80) return (first >= 0x20 || first == '\t' || first == '\n' || first == '\r') ? 1 : 0;
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || s.size() < length) return 0;
  unsigned code = first & (0xFFU >> (length + 1));
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0U) != 0x80U) return 0;
    code = (code << 6) | (byte(i) & 0x3FU);
  }
  const unsigned least = length == 2 ? 0x80 : length == 3 ? 0x800 : 0x10000;  // shorter spellings are not UTF-8
  const bool allowed =
      code >= least && code <= 0x10FFFF && !(code >= 0xD800 && code <= 0xDFFF) && code != 0xFFFE && code != 0xFFFF;
  return allowed ? length : 0;
}

/// The index of the first byte that is not part of allowed text, or npos.
std::size_t first_not_allowed(std::string_view s) {
  for (std::size_t i = 0; i < s.size();) {
    const std::size_t length = character_length(s.substr(i));
    if (length == 0) return i;
    i += length;
  }
  return std::string_view::npos;
}

struct Name {
  std::string prefix, local;
};

Name split_name(const std::string& qualified, const std::string& place) {
  const std::size_t colon = qualified.find(':');
  if (colon == std::string::npos) return {"", qualified};
  if (colon == 0 || colon + 1 == qualified.size() || qualified.find(':', colon + 1) != std::string::npos) {
    throw Error(place, "malformed name '" + qualified + "'");
  }
  return {qualified.substr(0, colon), qualified.substr(colon + 1)};
}

const std::string& space_of(const Name& name, const Prefixes& prefixes, const std::string& place) {
  const auto found = prefixes.find(name.prefix);
  if (found == prefixes.end())
    throw Error(place, "the prefix '" + name.prefix + "' has no namespace, expected xmlns:" + name.prefix + "=\"…\"");
  return found->second;
}

/// `prefixes` with what the xmlns attributes of `source` add.
Prefixes declared(const tinyxml2::XMLElement& source, Prefixes prefixes) {
  for (const tinyxml2::XMLAttribute* a = source.FirstAttribute(); a != nullptr; a = a->Next()) {
    const std::string name = a->Name();
    if (name == "xmlns") {
      prefixes[""] = a->Value();
    } else if (name.rfind("xmlns:", 0) == 0) {
      prefixes[name.substr(6)] = a->Value();
    }
  }
  return prefixes;
}

// tinyxml2 bounds the nesting (TINYXML2_MAX_ELEMENT_DEPTH), and with it this recursion.
Element converted(const tinyxml2::XMLElement& source, const Prefixes& outer, const std::string& place) {
  bool declares = false;
  for (const tinyxml2::XMLAttribute* a = source.FirstAttribute(); a != nullptr; a = a->Next()) {
    declares = declares || std::string_view(a->Name()).substr(0, 5) == "xmlns";
  }
  const Prefixes inner = declares ? declared(source, outer) : Prefixes{};
  const Prefixes& prefixes = declares ? inner : outer;

  Element element;
  element.place = place + ":" + std::to_string(source.GetLineNum());
  const Name name = split_name(source.Name(), element.place);
  element.space = space_of(name, prefixes, element.place);
  element.name = name.local;
  for (const tinyxml2::XMLAttribute* a = source.FirstAttribute(); a != nullptr; a = a->Next()) {
    const std::string qualified = a->Name();
    if (qualified == "xmlns" || qualified.rfind("xmlns:", 0) == 0) continue;
    const Name split = split_name(qualified, element.place);
    Attribute attribute{split.prefix.empty() ? "" : space_of(split, prefixes, element.place), split.local, a->Value()};
    if (!is_xml_text(attribute.value))
      throw Error(element.place, "attribute '" + qualified + "': a character that XML does not allow");
    for (const Attribute& other : element.attributes) {
      if (other.space == attribute.space && other.name == attribute.name)
        throw Error(element.place, "attribute '" + qualified + "' is given twice");
    }
    element.attributes.push_back(std::move(attribute));
  }
  for (const tinyxml2::XMLElement* c = source.FirstChildElement(); c != nullptr; c = c->NextSiblingElement()) {
    element.children.push_back(converted(*c, prefixes, place));
  }
  if (const char* text = source.GetText(); text != nullptr && element.children.empty()) {
    element.content = text::trim(text);
    if (!is_xml_text(element.content))
      throw Error(element.place, "'" + element.name + "': a character that XML does not allow");
  }
  return element;
}

std::string quoted_list(std::initializer_list<const char*> choices) {
  std::string list;
  for (const char* c : choices) list += (list.empty() ? "'" : ", '") + std::string(c) + "'";
  return list;
}

[[noreturn]] void refuse_value(const Element& element, std::string_view name, const std::string& value,
                               const std::string& expected) {
  throw Error(element.place,
              "attribute '" + std::string(name) + "' of '" + element.name + "': '" + value + "', expected " + expected);
}

}  // namespace

Element parse(std::string_view text, const std::string& place) {
  if (const std::size_t bad = first_not_allowed(text); bad != std::string_view::npos) {
    const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(bad), '\n');
    throw Error(place + ":" + std::to_string(line), "a byte that is not UTF-8 text, expected XML in UTF-8");
  }
  tinyxml2::XMLDocument document;
  if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS) {
    const int line = document.ErrorLineNum();
    throw Error(line > 0 ? place + ":" + std::to_string(line) : place, "malformed XML: " + reason(document));
  }
  const tinyxml2::XMLElement* root = document.RootElement();
  if (root == nullptr) throw Error(place, "no XML element");
  if (const tinyxml2::XMLElement* second = root->NextSiblingElement()) {
    throw Error(place + ":" + std::to_string(second->GetLineNum()),
                "a second root element '" + std::string(second->Name()) + "'");
  }
  return converted(*root, {{"", ""}, {"xml", "http://www.w3.org/XML/1998/namespace"}}, place);
}

bool is_xml_text(std::string_view text) { return first_not_allowed(text) == std::string_view::npos; }

std::string escaped(std::string_view text) {
  if (!is_xml_text(text)) throw Error("'" + std::string(text) + "' has a byte that XML cannot carry, expected UTF-8 text");
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\t':
        out += "&#9;";
        break;
      case '\n':
        out += "&#10;";
        break;
      case '\r':
        out += "&#13;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

const std::string* find(const Element& element, std::string_view name) {
  for (const Attribute& a : element.attributes) {
    if (a.space.empty() && a.name == name) return &a.value;
  }
  return nullptr;
}

const Element* child(const Element& element, std::string_view space, std::string_view name) {
  for (const Element& c : element.children) {
    if (c.name == name && c.space == space) return &c;
  }
  return nullptr;
}

const std::string& text(const Element& element, std::string_view name) {
  if (const std::string* value = find(element, name)) return *value;
  throw Error(element.place, "'" + element.name + "' without the attribute '" + std::string(name) + "'");
}

std::string text(const Element& element, std::string_view name, std::string_view fallback) {
  const std::string* value = find(element, name);
  return value != nullptr ? *value : std::string(fallback);
}

double real(const Element& element, std::string_view name, std::optional<double> fallback) {
  if (fallback && find(element, name) == nullptr) return *fallback;
  const std::string& value = text(element, name);
  const std::optional<double> number = text::parse_real(value);
  if (!number) refuse_value(element, name, value, "a number");
  return *number;
}

std::int32_t integer(const Element& element, std::string_view name, std::optional<std::int32_t> fallback) {
  if (fallback && find(element, name) == nullptr) return *fallback;
  const std::string& value = text(element, name);
  const std::optional<long long> number = text::parse_integer(value);
  using Limits = std::numeric_limits<std::int32_t>;
  if (!number || *number < Limits::min() || *number > Limits::max())
    refuse_value(element, name, value, "an integer of 32 bits");
  return static_cast<std::int32_t>(*number);
}

bool boolean(const Element& element, std::string_view name, std::optional<bool> fallback) {
  if (fallback && find(element, name) == nullptr) return *fallback;
  const std::string& value = text(element, name);
  const std::optional<bool> truth = text::parse_boolean(value);
  if (!truth) refuse_value(element, name, value, "'true' or 'false'");
  return *truth;
}

std::string choice(const Element& element, std::string_view name, std::initializer_list<const char*> choices,
                   std::optional<std::string> fallback) {
  if (fallback && find(element, name) == nullptr) return *fallback;
  const std::string& value = text(element, name);
  if (std::find(choices.begin(), choices.end(), value) == choices.end())
    refuse_value(element, name, value, "one of " + quoted_list(choices));
  return value;
}

void refuse(const std::string& place, const std::string& what) { throw Error(place, what); }

std::string unknown(const std::string& what, const std::string& name, const std::vector<std::string>& known) {
  const std::string near = text::closest(name, known);
  return "'" + name + "' is not " + what + (near.empty() ? "" : ", did you mean '" + near + "'?");
}

void check_attributes(const Element& element, const std::vector<std::string>& known, const Complaint& complain) {
  for (const Attribute& a : element.attributes) {
    if (!a.space.empty() || std::find(known.begin(), known.end(), a.name) != known.end()) continue;
    complain(element.place, unknown("an attribute of '" + element.name + "'", a.name, known));
  }
}

void check_children(const Element& element, std::string_view space, const std::vector<std::string>& known,
                    const Complaint& complain) {
  for (const Element& c : element.children) {
    if (c.space != space || std::find(known.begin(), known.end(), c.name) != known.end()) continue;
    complain(c.place, unknown("an element of '" + element.name + "'", c.name, known));
  }
}

}  // namespace cotwin::xml
