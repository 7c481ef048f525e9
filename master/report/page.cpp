#include "master/report/page.h"

#include <algorithm>
#include <cmath>

#include "master/report/style.h"
#include "models/foundation/formats/xml_text.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";  // U+FFFD

void append_escaped(std::string& out, std::string_view text) {
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
      case '\'':
        out += "&#39;";
        break;
      case '\n':
      case '\r':
      case '\t':
        out += ' ';
        break;
      default:
        out += c;
    }
  }
}

/// "sha256-…" of a Content Security Policy from hexadecimal digits.
std::string base64_of_hexadecimal(std::string_view digits) {
  constexpr char kSymbols[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const auto value = [](char c) { return static_cast<unsigned>(c <= '9' ? c - '0' : c - 'a' + 10); };
  std::string bytes, out;
  for (std::size_t i = 0; i + 1 < digits.size(); i += 2)
    bytes += static_cast<char>(16 * value(digits[i]) + value(digits[i + 1]));
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    unsigned three = 0;
    for (std::size_t k = 0; k < 3; ++k)
      three = 256 * three + (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += i + k > bytes.size() ? '=' : kSymbols[(three >> (18 - 6 * k)) & 63u];
  }
  return out;
}

}  // namespace

std::string escaped(std::string_view text, std::size_t most) {
  const bool cut = text.size() > most;
  if (cut) {
    text = text.substr(0, most);
    while (!text.empty() && (static_cast<unsigned char>(text.back()) & 0xC0u) == 0x80u) text.remove_suffix(1);
    if (!text.empty() && (static_cast<unsigned char>(text.back()) & 0x80u) != 0) text.remove_suffix(1);
  }
  std::string out;
  while (!text.empty()) {
    const std::size_t bad = xml::first_not_allowed(text);
    append_escaped(out, text.substr(0, bad));
    if (bad == std::string_view::npos) break;
    out += kReplacement;
    text.remove_prefix(bad + 1);
  }
  return cut ? out + "…" : out;
}

std::string code(std::string_view text) { return "<code>" + escaped(text) + "</code>"; }

std::string number(double value, int digits) {
  if (std::isnan(value)) return "–";
  if (std::isinf(value)) return value > 0 ? "∞" : "−∞";
  std::string text = text::to_text(value, digits);
  for (std::size_t at = text.find('-'); at != std::string::npos; at = text.find('-', at)) text.replace(at, 1, "−");
  return text;
}

std::string with_unit(const std::string& name, const std::string& unit) {
  return unit.empty() || unit == "1" ? name : name + " [" + unit + "]";
}

Table::Table(std::vector<std::string> heads, std::size_t text_columns, bool last_is_text)
    : heads_(std::move(heads)), text_columns_(text_columns), last_is_text_(last_is_text) {}

std::string Table::cell(const char* element, std::size_t column, const std::string& html, bool is_number) const {
  const bool left = column < text_columns_ || (last_is_text_ && column + 1 == heads_.size());
  const std::string kind = left ? " class=\"l\"" : is_number ? " class=\"n\"" : "";
  return std::string("<") + element + kind + ">" + html + "</" + element + ">";
}

void Table::row(std::vector<Cell> cells) {
  body_ += "<tr>";
  for (std::size_t i = 0; i < heads_.size(); ++i) {
    const bool there = i < cells.size();
    body_ += cell("td", i, there ? cells[i].html : "", there && cells[i].is_number);
  }
  body_ += "</tr>\n";
  ++rows_;
}

std::string Table::html(const std::string& caption) const {
  std::string out = "<div class=\"wide\"><table>";
  if (!caption.empty()) out += "<caption>" + escaped(caption) + "</caption>";
  if (std::ranges::any_of(heads_, [](const std::string& head) { return !head.empty(); })) {
    out += "<thead><tr>";
    for (std::size_t i = 0; i < heads_.size(); ++i) out += cell("th", i, escaped(heads_[i]), false);
    out += "</tr></thead>\n";
  }
  return out + "<tbody>\n" + body_ + "</tbody></table></div>\n";
}

void Page::heading(int level, const std::string& text, bool new_page) {
  const std::string name = "h" + std::to_string(level), id = "s" + std::to_string(contents_.size() + 1);
  body_ += "<" + name;
  if (level <= 3) {
    contents_.push_back({level, id, text});
    body_ += " id=\"" + id + "\"";
  }
  body_ += std::string(new_page ? " class=\"new-page\"" : "") + ">" + escaped(text, 300) + "</" + name + ">\n";
}

void Page::figure(const std::string& svg, const std::string& caption_html, const std::string& below_html) {
  body_ += "<figure>";
  if (!caption_html.empty()) body_ += "<figcaption>" + caption_html + "</figcaption>";
  body_ += svg + below_html + "</figure>\n";
}

std::string Page::html(const std::string& footer_html) const {
  std::string out =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'sha256-" +
      base64_of_hexadecimal(kStyleSha256) +
      "'; base-uri 'none'; form-action 'none'\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
      escaped(title_, 300) + "</title>\n<style>" + kStyle + "</style>\n</head>\n<body>\n<h1>" + escaped(title_, 300) +
      "</h1>\n";
  if (contents_.size() > 2) {
    out += "<nav aria-label=\"Contents\"><ul>\n";
    for (const Entry& entry : contents_) {
      out += std::string(entry.level > 2 ? "<li class=\"deep\">" : "<li>") + "<a href=\"#" + entry.id + "\">" +
             escaped(entry.text, 120) + "</a></li>\n";
    }
    out += "</ul></nav>\n";
  }
  return out + "<main>\n" + body_ + "</main>\n<footer>" + footer_html + "</footer>\n</body>\n</html>\n";
}

}  // namespace cotwin::report
