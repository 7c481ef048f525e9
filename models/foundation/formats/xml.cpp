#include "models/foundation/formats/xml.h"

#include <expat.h>

#include <algorithm>
#include <exception>
#include <limits>
#include <map>
#include <new>
#include <set>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::xml {

namespace {

struct Name {
  std::string_view prefix, local;
};

Name split_name(std::string_view qualified, const Place& place) {
  const std::size_t colon = qualified.find(':');
  if (colon == std::string_view::npos) return {"", qualified};
  if (colon == 0 || colon + 1 == qualified.size() || qualified.find(':', colon + 1) != std::string_view::npos) {
    throw Error(place, "malformed name '" + std::string(qualified) + "'");
  }
  return {qualified.substr(0, colon), qualified.substr(colon + 1)};
}

/// The prefix for which an attribute declares a namespace, "" for the default namespace.
std::optional<std::string_view> declared_prefix(std::string_view attribute) {
  if (attribute == "xmlns") return "";
  if (attribute.starts_with("xmlns:")) return attribute.substr(6);
  return std::nullopt;
}

/// Message for an error of expat.
std::string reason(XML_Error error) {
  switch (error) {
    case XML_ERROR_NO_ELEMENTS:
      return "no element";
    case XML_ERROR_INVALID_TOKEN:
      return "an invalid character";
    case XML_ERROR_UNCLOSED_TOKEN:
      return "an incomplete tag or reference";
    case XML_ERROR_TAG_MISMATCH:
      return "missing or mismatched end tag";
    case XML_ERROR_DUPLICATE_ATTRIBUTE:
      return "an attribute is given twice";
    case XML_ERROR_UNCLOSED_CDATA_SECTION:
      return "a CDATA section without ]]>";
    case XML_ERROR_UNDEFINED_ENTITY:
      return "an entity other than the five of XML";
    case XML_ERROR_MISPLACED_XML_PI:
      return "a declaration <?xml … ?> after the beginning";
    default:
      return XML_ErrorString(error);
  }
}

/// Builds the tree from the events of expat.
class Builder {
 public:
  Builder(std::string_view text, const std::string& place, const Take& take)
      : text_(text), place_(place), file_(place), take_(take) {
    namespaces_[""].emplace_back();
    namespaces_["xml"].emplace_back("http://www.w3.org/XML/1998/namespace");
    namespaces_["xmlns"];
    constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
    if (text_.starts_with(kByteOrderMark)) text_.remove_prefix(kByteOrderMark.size());
    // Skips blanks before the declaration, which are malformed but harmless.
    const std::size_t blanks = std::min(text_.find_first_not_of(" \t\r\n"), text_.size());
    lines_before_ =
        static_cast<std::uint64_t>(std::count(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(blanks), '\n'));
    text_.remove_prefix(blanks);
  }

  Element build() {
    const std::unique_ptr<XML_ParserStruct, decltype(&XML_ParserFree)> parser(XML_ParserCreate("UTF-8"), XML_ParserFree);
    if (parser == nullptr) throw std::bad_alloc();
    parser_ = parser.get();
    XML_SetUserData(parser_, this);
    XML_SetElementHandler(
        parser_,
        [](void* self, const char* name, const char** attributes) {
          static_cast<Builder*>(self)->guarded([&](Builder& b) { b.open(name, attributes); });
        },
        [](void* self, const char*) { static_cast<Builder*>(self)->guarded([](Builder& b) { b.close(); }); });
    XML_SetCharacterDataHandler(parser_, [](void* self, const char* data, int n) {
      static_cast<Builder*>(self)->guarded([&](Builder& b) { b.add_text({data, static_cast<std::size_t>(n)}); });
    });
    XML_SetStartDoctypeDeclHandler(parser_, [](void* self, const char*, const char*, const char*, int has_internal_subset) {
      static_cast<Builder*>(self)->guarded([&](Builder& b) {
        if (has_internal_subset != 0) throw Error(b.here(), "malformed XML: a document type with declarations, expected none");
      });
    });
    XML_SetSkippedEntityHandler(parser_, [](void* self, const char* name, int) {
      static_cast<Builder*>(self)->guarded([&](Builder& b) {
        throw Error(b.here(), "malformed XML: '&" + std::string(name) + ";', an entity other than the five of XML");
      });
    });
    constexpr std::size_t kPart = std::size_t{1} << 20;  // expat counts bytes in an int and copies its input
    do {
      const std::string_view part = text_.substr(0, kPart);
      text_.remove_prefix(part.size());
      if (XML_Parse(parser_, part.data(), static_cast<int>(part.size()), text_.empty() ? 1 : 0) != XML_STATUS_OK) fail();
    } while (!text_.empty());
    return std::move(root_);
  }

 private:
  using Declared = std::vector<std::string>;  // prefixes

  /// Catches exceptions, which must not pass through expat (C).
  template <class Call>
  void guarded(Call call) {
    if (failure_) return;  // expat may report further events after it was stopped
    try {
      call(*this);
    } catch (...) {
      failure_ = std::current_exception();
      XML_StopParser(parser_, XML_FALSE);
    }
  }

  Place here() const { return {file_, lines_before_ + XML_GetCurrentLineNumber(parser_)}; }

  [[noreturn]] void fail() {
    if (failure_) std::rethrow_exception(failure_);
    const XML_Error error = XML_GetErrorCode(parser_);
    if (error == XML_ERROR_JUNK_AFTER_DOC_ELEMENT)
      throw Error(here(), "a second root element, or text, after the end of the first");
    if (error == XML_ERROR_NO_ELEMENTS && open_.empty() && XML_GetCurrentByteCount(parser_) == 0 && !any_)
      throw Error(place_, "malformed XML: " + reason(error));
    const bool not_closed = error == XML_ERROR_TAG_MISMATCH || error == XML_ERROR_NO_ELEMENTS;
    if (not_closed && !open_.empty()) throw Error(open_.back().place, "malformed XML: " + reason(XML_ERROR_TAG_MISMATCH));
    throw Error(here(), "malformed XML: " + reason(error));
  }

  const Shared& space_of(const Name& name, const Place& place) const {
    const auto found = namespaces_.find(name.prefix);
    if (found == namespaces_.end() || found->second.empty()) {
      const std::string prefix(name.prefix);
      throw Error(place, "the prefix '" + prefix + "' has no namespace, expected xmlns:" + prefix + "=\"…\"");
    }
    return found->second.back();
  }

  void open(std::string_view name, const char** attributes) {
    any_ = true;
    Element element;
    element.place = here();
    if (open_.size() >= kDeepest) throw Error(element.place, "malformed XML: elements nested too deeply");
    Declared declared;
    for (const char** a = attributes; *a != nullptr; a += 2) {
      const std::optional<std::string_view> prefix = declared_prefix(a[0]);
      if (!prefix) continue;
      namespaces_[std::string(*prefix)].emplace_back(std::string(a[1]));
      declared.emplace_back(*prefix);
    }
    const Name split = split_name(name, element.place);
    element.space = space_of(split, element.place);
    element.name = split.local;
    read_attributes(attributes, element);
    if (!open_.empty()) {
      has_children_.back() = true;
      open_.back().content.clear();
    }
    open_.push_back(std::move(element));
    has_children_.push_back(false);
    declared_.push_back(std::move(declared));
  }

  void read_attributes(const char** attributes, Element& element) {
    std::set<std::pair<std::string_view, std::string_view>> prefixed;  // namespace and name
    for (const char** a = attributes; *a != nullptr; a += 2) {
      if (declared_prefix(a[0])) continue;
      const Name split = split_name(a[0], element.place);
      const Shared space = split.prefix.empty() ? Shared() : space_of(split, element.place);
      Attribute attribute{space, std::string(split.local), a[1]};
      if (!is_xml_text(attribute.value))
        throw Error(element.place, "attribute '" + std::string(a[0]) + "': a character that XML does not allow");
      // expat checks names without a prefix.
      if (!split.prefix.empty() && !prefixed.emplace(space.text(), split.local).second)
        throw Error(element.place, "attribute '" + std::string(a[0]) + "' is given twice");
      element.attributes.push_back(std::move(attribute));
    }
  }

  void add_text(std::string_view text) {
    if (!open_.empty() && !has_children_.back()) open_.back().content += text;
  }

  void close() {
    Element element = std::move(open_.back());
    open_.pop_back();
    const std::string_view content = text::trim(element.content);
    if (content.size() != element.content.size()) element.content = std::string(content);
    if (!is_xml_text(element.content))
      throw Error(element.place, "'" + element.name + "': a character that XML does not allow");
    for (const std::string& prefix : declared_.back()) namespaces_.find(prefix)->second.pop_back();
    declared_.pop_back();
    has_children_.pop_back();
    if (open_.empty()) {
      root_ = std::move(element);
    } else if (!take_ || take_(open_, element)) {
      kept_ += sizeof(Element) + element.attributes.size() * sizeof(Attribute) + element.content.size();
      for (const Attribute& a : element.attributes) kept_ += a.value.size();
      if (kept_ > kMostKept)
        throw Error(element.place, "the document's tree needs more than " + std::to_string(kMostKept) + " bytes");
      open_.back().children.push_back(std::move(element));
    }
  }

  static constexpr std::size_t kDeepest = 100;
  static constexpr std::size_t kMostKept = std::size_t{640} << 20;

  std::string_view text_;
  const std::string& place_;
  const Shared file_;
  const Take& take_;
  std::uint64_t lines_before_ = 0;
  XML_Parser parser_ = nullptr;
  std::exception_ptr failure_;
  bool any_ = false;
  std::size_t kept_ = 0;       // bytes
  std::vector<Element> open_;  // from the root to the current element
  std::vector<bool> has_children_;
  std::vector<Declared> declared_;
  std::map<std::string, std::vector<Shared>, std::less<>> namespaces_;  // per prefix, the innermost last
  Element root_;
};

}  // namespace

void refuse_value(const Element& element, std::string_view name, const std::string& value, const std::string& expected) {
  throw Error(element.place,
              "attribute '" + std::string(name) + "' of '" + element.name + "': '" + value + "', expected " + expected);
}

const std::string& Shared::text() const {
  static const std::string kEmpty;
  return text_ == nullptr ? kEmpty : *text_;
}

Element parse(std::string_view text, const std::string& place, const Take& take) {
  if (const std::size_t bad = first_not_allowed(text); bad != std::string_view::npos) {
    const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(bad), '\n');
    throw Error(place + ":" + std::to_string(line), why_not_utf8(text, text));
  }
  return Builder(text, place, take).build();
}

std::string escaped(std::string_view text) {
  if (!is_xml_text(text)) throw Error("'" + std::string(text) + "' has a byte that XML cannot represent, expected UTF-8 text");
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
