#include "tests/support/standard_validator.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <regex>
#include <set>
#include <stdexcept>

#include "tests/support/standard_grammar.h"
#include "tests/support/standard_node.h"

namespace cotwin::testing {

namespace {

constexpr const char* kSsd = "http://ssp-standard.org/SSP1/SystemStructureDescription";
constexpr const char* kSsc = "http://ssp-standard.org/SSP1/SystemStructureCommon";
constexpr const char* kSsv = "http://ssp-standard.org/SSP1/SystemStructureParameterValues";
constexpr const char* kInstance = "http://www.w3.org/2001/XMLSchema-instance";

// Values

std::string collapsed(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const bool blank = c == ' ' || c == '\t' || c == '\n' || c == '\r';
    if (!blank) {
      out += c;
    } else if (!out.empty() && out.back() != ' ') {
      out += ' ';
    }
  }
  if (!out.empty() && out.back() == ' ') out.pop_back();
  return out;
}

bool matches(const std::string& text, const char* pattern) {
  static std::map<const char*, std::regex> patterns;
  return std::regex_match(text, patterns.try_emplace(pattern, pattern).first->second);
}

bool is_hex(const std::string& text) {
  return text.size() % 2 == 0 && text.find_first_not_of("0123456789abcdefABCDEF") == std::string::npos;
}

/// Whether a <= b, for decimal digits without leading zeros.
bool digits_at_most(const std::string& a, const std::string& b) { return a.size() != b.size() ? a.size() < b.size() : a <= b; }

/// `most`, `least`: digits of the maximum and of the minimum without its sign; nullptr: no bound.
bool is_integer(const std::string& value, const char* most, const char* least, bool sign) {
  if (!matches(value, sign ? "[+-]?[0-9]+" : "[0-9]+")) return false;
  const bool negative = value[0] == '-';
  std::string digits = value.substr(value[0] == '-' || value[0] == '+' ? 1 : 0);
  digits.erase(0, std::min(digits.find_first_not_of('0'), digits.size() - 1));
  const char* bound = negative ? least : most;
  return bound == nullptr || digits_at_most(digits, bound);
}

bool is_date(const std::string& value) {
  std::smatch m;
  static const std::regex shape(
      "-?([0-9]{4,})-([0-9]{2})-([0-9]{2})T([0-9]{2}):([0-9]{2}):([0-9]{2})(\\.[0-9]+)?(Z|[+-]([0-9]{2}):([0-9]{2}))?");
  if (!std::regex_match(value, m, shape)) return false;
  const int year = std::stoi(m[1].str().substr(m[1].length() - 4)), month = std::stoi(m[2]), day = std::stoi(m[3]);
  static constexpr int kDays[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
  if (month < 1 || month > 12 || m[1] == "0000") return false;
  const bool leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
  if (day < 1 || day > kDays[month - 1] + (month == 2 && leap ? 1 : 0)) return false;
  if (std::stoi(m[4]) > 23 || std::stoi(m[5]) > 59 || std::stoi(m[6]) > 59) return false;
  return m[9].length() == 0 || (std::stoi(m[9]) <= 14 && std::stoi(m[10]) <= 59);
}

using Check = bool (*)(const std::string& collapsed);

const std::map<std::string, Check>& types() {
  static const std::map<std::string, Check> all = {
      {"bool", [](const std::string& v) { return v == "true" || v == "false" || v == "1" || v == "0"; }},
      {"byte", [](const std::string& v) { return is_integer(v, "127", "128", true); }},
      {"short", [](const std::string& v) { return is_integer(v, "32767", "32768", true); }},
      {"int", [](const std::string& v) { return is_integer(v, "2147483647", "2147483648", true); }},
      {"long", [](const std::string& v) { return is_integer(v, "9223372036854775807", "9223372036854775808", true); }},
      {"ubyte", [](const std::string& v) { return is_integer(v, "255", "0", false); }},
      {"ushort", [](const std::string& v) { return is_integer(v, "65535", "0", false); }},
      {"uint", [](const std::string& v) { return is_integer(v, "4294967295", "0", false); }},
      {"ulong", [](const std::string& v) { return is_integer(v, "18446744073709551615", "0", false); }},
      {"natural", [](const std::string& v) { return is_integer(v, nullptr, "0", true); }},
      {"double",
       [](const std::string& v) { return matches(v, "[+-]?([0-9]+(\\.[0-9]*)?|\\.[0-9]+)([eE][+-]?[0-9]+)?|-?INF|NaN"); }},
      {"float",
       [](const std::string& v) { return matches(v, "[+-]?([0-9]+(\\.[0-9]*)?|\\.[0-9]+)([eE][+-]?[0-9]+)?|-?INF|NaN"); }},
      {"dateTime", is_date},
      {"hex", is_hex},
      {"id", [](const std::string& v) { return matches(v, "[A-Za-z_][A-Za-z0-9_.\\-]*"); }},
  };
  return all;
}

/// Types whose blanks are significant.
const std::map<std::string, Check>& texts() {
  static const std::map<std::string, Check> all = {
      {"string", [](const std::string&) { return true; }},
      // RFC 3986, clause 4.2: a colon in the first segment ends a scheme.
      {"uri", [](const std::string& v) { return matches(v, "[A-Za-z][A-Za-z0-9+.\\-]*:[^]*|[^:/?#]*([/?#][^]*)?"); }},
      {"nonempty", [](const std::string& v) { return !v.empty(); }},
      {"fmi3version", [](const std::string& v) { return matches(v, "3[.](0|[1-9][0-9]*)([.](0|[1-9][0-9]*))?(-.+)?"); }},
      {"ssp1version", [](const std::string& v) { return matches(v, "1[.][0-9]+(-.*)?"); }},
  };
  return all;
}

std::vector<std::string> words(const std::string& text, char separator) {
  std::vector<std::string> all;
  std::string word;
  for (const char c : text + separator) {
    if (c != separator) {
      word += c;
    } else if (!word.empty()) {
      all.push_back(std::exchange(word, ""));
    }
  }
  return all;
}

bool is_of_type(const std::string& value, const std::string& type) {
  if (type.back() == '*') {
    const std::string item = type.substr(0, type.size() - 1);
    const std::vector<std::string> items = words(collapsed(value), ' ');
    return std::all_of(items.begin(), items.end(), [&](const std::string& i) { return is_of_type(i, item); });
  }
  if (const auto found = types().find(type); found != types().end()) return found->second(collapsed(value));
  if (const auto found = texts().find(type); found != texts().end()) return found->second(value);
  const std::vector<std::string> choices = words(type, '|');
  return std::find(choices.begin(), choices.end(), value) != choices.end();
}

// Content as a regular expression of elements

struct Expression {
  enum class Kind { kElement, kAny, kSequence, kChoice, kRepeat } kind = Kind::kSequence;
  std::string space, name, type;  // kElement
  std::vector<Expression> parts;
  bool may_be_absent = false, may_repeat = false;  // kRepeat
};

using Positions = std::set<std::size_t>;

/// The positions where the expression may end if it begins at one of `from`.
Positions after(const Expression& e, const std::vector<Node>& children, const Positions& from) {
  Positions ends;
  switch (e.kind) {
    case Expression::Kind::kElement:
    case Expression::Kind::kAny:
      for (const std::size_t at : from) {
        const bool is_it = at < children.size() &&
                           (e.kind == Expression::Kind::kAny || (children[at].name == e.name && children[at].space == e.space));
        if (is_it) ends.insert(at + 1);
      }
      return ends;
    case Expression::Kind::kSequence:
      ends = from;
      for (const Expression& part : e.parts) ends = after(part, children, ends);
      return ends;
    case Expression::Kind::kChoice:
      for (const Expression& part : e.parts) ends.merge(after(part, children, from));
      return ends;
    case Expression::Kind::kRepeat: {
      if (e.may_be_absent) ends = from;
      Positions reached = from, seen = from;
      do {
        Positions next = after(e.parts.front(), children, reached);
        reached.clear();
        for (const std::size_t at : next) {
          ends.insert(at);
          if (seen.insert(at).second) reached.insert(at);
        }
      } while (e.may_repeat && !reached.empty());
      return ends;
    }
  }
  return ends;
}

const Expression* find_element(const Expression& e, const Node& node) {
  if (e.kind == Expression::Kind::kElement) return e.name == node.name && e.space == node.space ? &e : nullptr;
  for (const Expression& part : e.parts) {
    if (const Expression* found = find_element(part, node)) return found;
  }
  return nullptr;
}

// The grammar

struct AttributeRule {
  std::string name, type;
  bool required = false;
};
struct ElementRule {
  std::vector<AttributeRule> attributes;
  bool any_attribute = false, text = false, empty = true;
  Expression content;
};

class Grammar {
 public:
  void add(std::string text, const std::string& space, const std::map<std::string, std::string>& shorthands = {}) {
    for (const auto& [name, meaning] : shorthands)
      text = std::regex_replace(text, std::regex("\\b" + name + "\\b"), collapsed(meaning));
    text_ = text;
    at_ = 0;
    space_ = space;
    for (skip(); at_ < text_.size(); skip()) read_rule();
  }
  const ElementRule& rule(const std::string& type) const {
    const auto found = rules_.find(type);
    if (found == rules_.end()) throw std::logic_error("the grammar has no '" + type + "'");
    return found->second;
  }

 private:
  void skip() { at_ = std::min(text_.find_first_not_of(" \n\t", at_), text_.size()); }
  bool take(char c) {
    skip();
    if (at_ >= text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }
  std::string word(const char* end) {
    skip();
    const std::size_t begin = at_;
    at_ = std::min(text_.find_first_of(end, at_), text_.size());
    return text_.substr(begin, at_ - begin);
  }
  void read_rule() {
    const std::string name = word("(");
    ElementRule rule;
    if (!take('(')) throw std::logic_error("grammar: '" + name + "' has no attributes");
    while (!take(')')) {
      std::string attribute = word(" \n)");
      if (attribute == "@any") {
        rule.any_attribute = true;
        continue;
      }
      const bool required = attribute.back() == '!';
      if (required) attribute.pop_back();
      const std::size_t colon = attribute.find(':');
      rule.attributes.push_back({attribute.substr(0, colon), attribute.substr(colon + 1), required});
    }
    if (take('{')) {
      rule.empty = false;
      rule.content = read_choice(rule);
      if (!take('}')) throw std::logic_error("grammar: the content of '" + name + "' has no end");
    }
    rules_[name] = std::move(rule);
  }
  Expression read_choice(ElementRule& rule) {
    Expression choice{Expression::Kind::kChoice, "", "", "", {}, false, false};
    do {
      Expression sequence;
      for (skip(); text_[at_] != '|' && text_[at_] != ')' && text_[at_] != '}'; skip())
        sequence.parts.push_back(read_repeated(rule));
      choice.parts.push_back(std::move(sequence));
    } while (take('|'));
    return choice;
  }
  Expression read_repeated(ElementRule& rule) {
    Expression e;
    if (take('(')) {
      e = read_choice(rule);
      take(')');
    } else {
      e = read_element(rule);
    }
    if (at_ < text_.size() && (text_[at_] == '?' || text_[at_] == '*' || text_[at_] == '+')) {
      const char how = text_[at_++];
      return {Expression::Kind::kRepeat, "", "", "", {std::move(e)}, how != '+', how != '?'};
    }
    return e;
  }
  Expression read_element(ElementRule& rule) {
    std::string name = word(" \n?*+|(){}");
    Expression any{Expression::Kind::kAny, "", "", "", {}, false, false};
    if (name == "any") return any;
    if (name == "text") {
      rule.text = true;
      return {Expression::Kind::kRepeat, "", "", "", {any}, true, true};
    }
    const bool common = name.rfind("c:", 0) == 0;
    if (common) name.erase(0, 2);
    const std::size_t equals = name.find('=');
    const std::string type = equals == std::string::npos ? name : name.substr(equals + 1);
    return {Expression::Kind::kElement, common ? kSsc : space_, name.substr(0, equals), type, {}, false, false};
  }

  std::map<std::string, ElementRule> rules_;
  std::string text_, space_;
  std::size_t at_ = 0;
};

struct Definition {
  Grammar grammar;
  std::string space, root;
};

const Definition& definition(Standard standard) {
  static const std::map<Standard, Definition> all = [] {
    std::map<Standard, Definition> d;
    const std::map<std::string, std::string> base = {{"BASE", kSspBase}, {"TOP", kSspTop}};
    d[Standard::kFmi2].root = d[Standard::kFmi3].root = "fmiModelDescription";
    d[Standard::kFmi2].grammar.add(kFmi2Grammar, "");
    const std::string variable = std::regex_replace(std::string(kFmi3Variable), std::regex("NAMED"), kFmi3Named);
    d[Standard::kFmi3].grammar.add(kFmi3Grammar, "",
                                   {{"VARIABLE", variable}, {"INITIAL", kFmi3Initial}, {"NAMED", kFmi3Named}});
    Definition &ssd = d[Standard::kSsd], &ssv = d[Standard::kSsv];
    ssd.root = "SystemStructureDescription";
    ssd.space = kSsd;
    ssd.grammar.add(kSspCommonGrammar, kSsc, base);
    ssd.grammar.add(kSsdGrammar, kSsd, base);
    ssv.root = "ParameterSet";
    ssv.space = kSsv;
    ssv.grammar.add(kSspCommonGrammar, kSsc, base);
    ssv.grammar.add(kSsvGrammar, kSsv, base);
    return d;
  }();
  return all.at(standard);
}

class Validation {
 public:
  explicit Validation(const Grammar& grammar) : grammar_(grammar) {}

  void check(const Node& node, const std::string& type) {
    const ElementRule& rule = grammar_.rule(type);
    check_attributes(node, rule);
    if (node.has_text && !rule.text) fault(node, "has text, expected none");
    const std::size_t n = node.children.size();
    if (rule.empty ? n > 0 : after(rule.content, node.children, {0}).count(n) == 0) {
      std::string names;
      for (const Node& child : node.children) names += " " + child.name;
      fault(node, "has elements, or an order or a number of them, that it may not have:" + names.substr(0, 200));
    }
    for (const Node& child : node.children) {
      if (const Expression* element = find_element(rule.content, child)) check(child, element->type);
    }
  }
  std::vector<std::string> take() { return std::move(faults_); }
  void fault(const Node& node, const std::string& what) { faults_.push_back(place(node) + what); }

 private:
  void check_attributes(const Node& node, const ElementRule& rule) {
    for (const AttributeRule& attribute : rule.attributes) {
      const std::string* value = node.find(attribute.name);
      if (value == nullptr) {
        if (attribute.required) fault(node, "has no attribute '" + attribute.name + "'");
        continue;
      }
      if (!is_of_type(*value, attribute.type)) fault(node, attribute.name + " = '" + *value + "', expected " + attribute.type);
      if (attribute.type == "id" && !ids_.insert(collapsed(*value)).second) fault(node, "id '" + *value + "' is not unique");
    }
    for (const auto& [name, value] : node.attributes) {
      const bool known = std::any_of(rule.attributes.begin(), rule.attributes.end(),
                                     [&, wanted = &name](const AttributeRule& a) { return a.name == *wanted; });
      const bool of_instance = name.rfind(std::string(kInstance) + " ", 0) == 0;
      if (!known && !rule.any_attribute && !of_instance) fault(node, "may not have the attribute '" + name + "'");
    }
  }

  const Grammar& grammar_;
  std::vector<std::string> faults_;
  std::set<std::string> ids_;
};

}  // namespace

std::vector<std::string> schema_faults(const Node& root, Standard standard) {
  const Definition& d = definition(standard);
  if (root.name != d.root || root.space != d.space) return {place(root) + "is not the root, expected " + d.root};
  Validation validation(d.grammar);
  validation.check(root, d.root);
  return validation.take();
}

std::vector<std::string> schema_faults(std::string_view xml, Standard standard) {
  const std::optional<Node> root = parse_node(xml);
  return root ? schema_faults(*root, standard) : std::vector<std::string>{"no well-formed XML"};
}

std::vector<std::string> faults(std::string_view xml, Standard standard) {
  std::vector<std::string> all = schema_faults(xml, standard);
  return all.empty() ? meaning_faults(xml, standard) : all;
}

}  // namespace cotwin::testing
