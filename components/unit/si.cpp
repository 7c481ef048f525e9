#include "components/unit/si.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::si {

namespace {

// Index into Measure::exponents.
enum Base { kKg, kM, kS, kA, kK, kMol, kCd, kRad };

/// A factor as numerator · 10^decade / denominator, so that 1 mm³ becomes the double nearest to 1e-9 m³, which
/// 1e-3 · 1e-3 · 1e-3 is not.
struct Scaled {
  std::array<int, 8> exponents{};
  double numerator = 1, denominator = 1;
  int decade = 0;
  double offset = 0;
};

struct Symbol {
  std::string_view name;
  std::array<int, 8> exponents;  // kg, m, s, A, K, mol, cd, rad
  double numerator, denominator;
  int decade;
  double offset;
  bool prefixed;  // takes SI prefixes
};

// SI Brochure, 9th edition: tables 2 (base), 4 (derived), 8 (non-SI units accepted for use), 7 (prefixes); °F from its
// definition.
constexpr double kPi = std::numbers::pi;
constexpr Symbol kSymbols[] = {
    {"g", {1}, 1, 1, -3, 0, true},
    {"t", {1}, 1, 1, 3, 0, false},
    {"m", {0, 1}, 1, 1, 0, 0, true},
    {"s", {0, 0, 1}, 1, 1, 0, 0, true},
    {"A", {0, 0, 0, 1}, 1, 1, 0, 0, true},
    {"K", {0, 0, 0, 0, 1}, 1, 1, 0, 0, true},
    {"mol", {0, 0, 0, 0, 0, 1}, 1, 1, 0, 0, true},
    {"cd", {0, 0, 0, 0, 0, 0, 1}, 1, 1, 0, 0, true},
    {"rad", {0, 0, 0, 0, 0, 0, 0, 1}, 1, 1, 0, 0, true},
    {"sr", {0, 0, 0, 0, 0, 0, 0, 2}, 1, 1, 0, 0, true},
    {"N", {1, 1, -2}, 1, 1, 0, 0, true},
    {"J", {1, 2, -2}, 1, 1, 0, 0, true},
    {"W", {1, 2, -3}, 1, 1, 0, 0, true},
    {"Pa", {1, -1, -2}, 1, 1, 0, 0, true},
    {"bar", {1, -1, -2}, 1, 1, 5, 0, true},
    {"Hz", {0, 0, -1}, 1, 1, 0, 0, true},
    {"C", {0, 0, 1, 1}, 1, 1, 0, 0, true},
    {"V", {1, 2, -3, -1}, 1, 1, 0, 0, true},
    {"Ohm", {1, 2, -3, -2}, 1, 1, 0, 0, true},
    {"ohm", {1, 2, -3, -2}, 1, 1, 0, 0, true},
    {"Ω", {1, 2, -3, -2}, 1, 1, 0, 0, true},  // U+03A9
    {"Ω", {1, 2, -3, -2}, 1, 1, 0, 0, true},  // U+2126
    {"S", {-1, -2, 3, 2}, 1, 1, 0, 0, true},
    {"F", {-1, -2, 4, 2}, 1, 1, 0, 0, true},
    {"H", {1, 2, -2, -2}, 1, 1, 0, 0, true},
    {"Wb", {1, 2, -2, -1}, 1, 1, 0, 0, true},
    {"T", {1, 0, -2, -1}, 1, 1, 0, 0, true},
    {"lm", {0, 0, 0, 0, 0, 0, 1, 2}, 1, 1, 0, 0, true},
    {"lx", {0, -2, 0, 0, 0, 0, 1, 2}, 1, 1, 0, 0, true},
    {"L", {0, 3}, 1, 1, -3, 0, true},
    {"l", {0, 3}, 1, 1, -3, 0, true},
    {"min", {0, 0, 1}, 60, 1, 0, 0, false},
    {"h", {0, 0, 1}, 3600, 1, 0, 0, false},
    {"d", {0, 0, 1}, 86400, 1, 0, 0, false},
    {"deg", {0, 0, 0, 0, 0, 0, 0, 1}, kPi, 180, 0, 0, true},
    {"°", {0, 0, 0, 0, 0, 0, 0, 1}, kPi, 180, 0, 0, false},
    {"rev", {0, 0, 0, 0, 0, 0, 0, 1}, 2 * kPi, 1, 0, 0, false},
    {"r", {0, 0, 0, 0, 0, 0, 0, 1}, 2 * kPi, 1, 0, 0, false},
    {"rpm", {0, 0, -1, 0, 0, 0, 0, 1}, 2 * kPi, 60, 0, 0, false},
    {"degC", {0, 0, 0, 0, 1}, 1, 1, 0, 273.15, false},
    {"°C", {0, 0, 0, 0, 1}, 1, 1, 0, 273.15, false},
    {"℃", {0, 0, 0, 0, 1}, 1, 1, 0, 273.15, false},
    {"degF", {0, 0, 0, 0, 1}, 5, 9, 0, 459.67 * 5 / 9, false},
    {"°F", {0, 0, 0, 0, 1}, 5, 9, 0, 459.67 * 5 / 9, false},
    {"%", {}, 1, 1, -2, 0, false},
    {"percent", {}, 1, 1, -2, 0, false},
    {"ppm", {}, 1, 1, -6, 0, false},
};

struct Prefix {
  std::string_view name;
  int decade;
};
constexpr Prefix kPrefixes[] = {
    {"da", 1}, {"µ", -6}, {"μ", -6},  // U+00B5, U+03BC
    {"Y", 24}, {"Z", 21}, {"E", 18}, {"P", 15}, {"T", 12},  {"G", 9},   {"M", 6},   {"k", 3},   {"h", 2},   {"d", -1},
    {"c", -2}, {"m", -3}, {"u", -6}, {"n", -9}, {"p", -12}, {"f", -15}, {"a", -18}, {"z", -21}, {"y", -24},
};

/// Products that tools write without a multiplication sign, and their meaning.
struct Compound {
  std::string_view name, first, rest;
};
constexpr Compound kCompounds[] = {{"Nm", "N", "m"}, {"Nms", "N", "m.s"}, {"kgm", "kg", "m"},
                                   {"Ws", "W", "s"}, {"Wh", "W", "h"},    {"As", "A", "s"},
                                   {"Ah", "A", "h"}, {"Vs", "V", "s"},    {"VA", "V", "A"}};

constexpr int kMaxExponent = 99;
constexpr std::size_t kMaxLength = 200;

/// Removes the prefix `head` from `s`. Returns whether `s` had it.
bool take(std::string_view& s, std::string_view head) {
  if (s.substr(0, head.size()) != head) return false;
  s.remove_prefix(head.size());
  return true;
}

class Parser {
 public:
  explicit Parser(std::string_view text) : all_(text), rest_(text) {}

  Measure measure() {
    if (text::trim(all_).empty()) fail("nothing, expected e.g. 'N.m' or '1'");
    if (all_.size() > kMaxLength) throw Error("unit of measure '" + std::string(all_.substr(0, 40)) + "…': too long");
    rest_ = text::trim(all_);
    if (rest_ == "-") return {};
    Scaled s = quotient(0);
    if (!rest_.empty()) fail("'" + std::string(rest_) + "' at its end");
    Measure m;
    m.exponents = s.exponents;
    for (const int e : m.exponents) {
      if (std::abs(e) > kMaxExponent) fail("an exponent beyond ±" + std::to_string(kMaxExponent));
    }
    if (s.numerator == 1 && s.denominator == 1) {
      m.factor = power_of_ten(s.decade);  // beyond 10²² a division gives another double
    } else {
      m.factor = s.decade >= 0 ? s.numerator * power_of_ten(s.decade) / s.denominator
                               : s.numerator / (s.denominator * power_of_ten(-s.decade));
    }
    if (!std::isnormal(m.factor)) fail("a factor that no number can hold");
    m.offset = factors_ == 1 ? s.offset : 0;  // degC/s has no offset: a difference of temperatures
    return m;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const { throw Error("unit of measure '" + std::string(all_) + "': " + what); }

  static double power_of_ten(int decade) {
    return text::parse_real("1e" + std::to_string(decade)).value_or(decade > 0 ? std::numeric_limits<double>::infinity() : 0);
  }

  /// product [ '/' product ]
  Scaled quotient(int depth) {
    Scaled s = product(depth);
    skip_blanks();
    if (!take(rest_, "/")) return s;
    const Scaled below = product(depth);
    skip_blanks();
    if (!rest_.empty() && rest_.front() == '/') fail("a second '/', expected parentheses");
    multiply(s, below, -1);
    ++factors_;
    return s;
  }

  /// factor { ('.' | '*' | '·' | blank) factor }
  Scaled product(int depth) {
    Scaled s = factor(depth);
    while (true) {
      const bool blank = skip_blanks();
      const bool sign = take(rest_, "**") ? (fail("'**' without an exponent"), true)
                                          : take(rest_, ".") || take(rest_, "*") || take(rest_, "·") || take(rest_, "⋅");
      if (!sign && (!blank || rest_.empty() || rest_.front() == '/' || rest_.front() == ')')) return s;
      multiply(s, factor(depth), 1);
    }
  }

  /// '1' | symbol [exponent] | '(' quotient ')' [exponent]
  Scaled factor(int depth) {
    skip_blanks();
    if (take(rest_, "(")) {
      if (depth >= 8) fail("parentheses nested too deeply");
      const Scaled inside = quotient(depth + 1);
      skip_blanks();
      if (!take(rest_, ")")) fail("'(' without ')'");
      return power(inside, exponent());
    }
    if (take(rest_, "1") && (rest_.empty() || !is_digit(rest_.front()))) return {};
    const std::string_view word = symbol_word();
    if (word.empty())
      fail(rest_.empty() ? "ends where a symbol is expected" : "'" + std::string(rest_) + "', expected a symbol");
    ++factors_;
    if (const std::optional<Scaled> s = find_symbol(word)) return power(*s, exponent());
    for (const Compound& c : kCompounds) {
      if (!word.ends_with(c.name)) continue;
      const std::string head = std::string(word.substr(0, word.size() - c.name.size())) + std::string(c.first);
      std::optional<Scaled> s = find_symbol(head);
      if (!s) continue;
      ++factors_;
      const std::size_t dot = c.rest.find('.');
      if (dot != std::string_view::npos) multiply(*s, *find_symbol(c.rest.substr(0, dot)), 1);
      const std::string_view last = dot == std::string_view::npos ? c.rest : c.rest.substr(dot + 1);
      multiply(*s, *find_symbol(last), exponent());  // kgm2 is kg.m2: the exponent belongs to the last
      return *s;
    }
    fail("unknown symbol '" + std::string(word) + "'");
  }

  std::optional<Scaled> find_symbol(std::string_view word) const {
    for (const Symbol& s : kSymbols) {
      if (s.name == word) return scaled(s, 0);
    }
    for (const Prefix& p : kPrefixes) {
      if (word.substr(0, p.name.size()) != p.name) continue;
      for (const Symbol& s : kSymbols) {
        if (s.prefixed && s.name == word.substr(p.name.size())) return scaled(s, p.decade);
      }
    }
    return std::nullopt;
  }

  static Scaled scaled(const Symbol& s, int decade) {
    return {s.exponents, s.numerator, s.denominator, s.decade + decade, s.offset};
  }

  /// [ '^' | '**' ] integer, or an integer in superscripts, or in parentheses after '^'; 1 if there is none.
  int exponent() {
    std::string digits;
    const bool caret = take(rest_, "^") || take(rest_, "**");
    const bool parenthesis = caret && take(rest_, "(");
    if (!rest_.empty() && (rest_.front() == '-' || rest_.front() == '+') && rest_.size() > 1 && is_digit(rest_[1])) {
      if (rest_.front() == '-') digits += '-';
      rest_.remove_prefix(1);
    }
    while (!rest_.empty() && is_digit(rest_.front())) {
      digits += rest_.front();
      rest_.remove_prefix(1);
    }
    if (parenthesis && !take(rest_, ")")) fail("'(' without ')'");
    if (digits.empty() && !caret) digits = superscript();
    if (digits.empty()) {
      if (caret) fail("'^' without an integer");
      return 1;
    }
    const std::optional<long long> value = text::parse_integer(digits);
    if (!value || std::llabs(*value) > kMaxExponent)
      fail("exponent '" + digits + "', expected at most ±" + std::to_string(kMaxExponent));
    return static_cast<int>(*value);
  }

  std::string superscript() {
    static constexpr std::string_view kSuperscripts[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
    std::string digits = take(rest_, "⁻") ? "-" : "";
    for (bool more = true; more;) {
      more = false;
      for (std::size_t i = 0; i < 10 && !more; ++i) {
        if (take(rest_, kSuperscripts[i])) {
          digits += static_cast<char>('0' + i);
          more = true;
        }
      }
    }
    return digits;
  }

  std::string_view symbol_word() {
    std::size_t n = 0;
    while (n < rest_.size()) {
      const std::string_view here = rest_.substr(n);
      const auto c = static_cast<unsigned char>(here.front());
      const bool letter = (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '%';
      if (letter) {
        ++n;
        continue;
      }
      // Of the characters beyond ASCII only those that occur in symbols.
      const std::string_view foreign[] = {"°", "µ", "μ", "Ω", "Ω", "℃"};
      const auto found =
          std::find_if(std::begin(foreign), std::end(foreign), [&](std::string_view f) { return here.starts_with(f); });
      if (found == std::end(foreign)) break;
      n += found->size();
    }
    const std::string_view word = rest_.substr(0, n);
    rest_.remove_prefix(n);
    return word;
  }

  void multiply(Scaled& s, const Scaled& by, int exponent) {
    for (std::size_t i = 0; i < s.exponents.size(); ++i) s.exponents[i] += by.exponents[i] * exponent;
    for (const int e : s.exponents) {
      if (std::abs(e) > 100 * kMaxExponent) fail("an exponent beyond ±" + std::to_string(kMaxExponent));
    }
    for (int i = 0; i < std::abs(exponent); ++i) {
      s.numerator *= exponent > 0 ? by.numerator : by.denominator;
      s.denominator *= exponent > 0 ? by.denominator : by.numerator;
    }
    s.decade += by.decade * exponent;
    if (std::abs(s.decade) > 100 * kMaxExponent) fail("a factor that no number can hold");
  }

  Scaled power(const Scaled& base, int exponent) {
    if (exponent == 1) return base;
    ++factors_;
    Scaled s;
    multiply(s, base, exponent);
    return s;
  }

  bool skip_blanks() {
    const std::size_t before = rest_.size();
    while (!rest_.empty() && rest_.front() == ' ') rest_.remove_prefix(1);
    return rest_.size() != before;
  }

  static bool is_digit(char c) { return c >= '0' && c <= '9'; }

  std::string_view all_, rest_;
  int factors_ = 0;  // more than one: offsets are dropped
};

}  // namespace

Measure parse(std::string_view text) { return Parser(text).measure(); }

Measure from(const UnitDefinition& d) { return {{d.kg, d.m, d.s, d.A, d.K, d.mol, d.cd, d.rad}, d.factor, d.offset}; }

void define_units(ParameterSet& set) {
  for (const ParameterValue& v : set.values) {
    const bool defined =
        std::any_of(set.units.begin(), set.units.end(), [&](const UnitDefinition& d) { return d.name == v.unit; });
    if (v.unit.empty() || defined) continue;
    const Measure m = parse(v.unit);
    const auto& e = m.exponents;
    set.units.push_back({v.unit, e[kKg], e[kM], e[kS], e[kA], e[kK], e[kMol], e[kCd], e[kRad], m.factor, m.offset});
  }
}

bool convertible(const Measure& from, const Measure& to) { return from.exponents == to.exponents; }

bool is_rate(const std::string& rate, const std::string& of) {
  if (rate.empty() || of.empty()) return true;
  Measure expected = parse(of);
  expected.exponents[2] -= 1;  // per second
  return convertible(expected, parse(rate));
}

Conversion conversion(const Measure& from, const Measure& to) {
  // Equal measures convert by exactly 1 and 0 (x/x = 1, x − x = 0).
  return {from.factor / to.factor, (from.offset - to.offset) / to.factor};
}

}  // namespace cotwin::si
