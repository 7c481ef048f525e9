#include "models/foundation/formats/xml_text.h"

#include <algorithm>
#include <string>

namespace cotwin::xml {

namespace {

/// Length of the UTF-8 sequence at the start of `s` if it is a character that XML 1.0 allows (clause 2.2), otherwise 0.
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
  const unsigned least = length == 2 ? 0x80 : length == 3 ? 0x800 : 0x10000;  // shorter encodings are not UTF-8
  const bool allowed =
      code >= least && code <= 0x10FFFF && !(code >= 0xD800 && code <= 0xDFFF) && code != 0xFFFE && code != 0xFFFF;
  return allowed ? length : 0;
}

/// The encoding of more than a byte a character, by the byte order mark or by zeros beside the first character; "" for others.
std::string wide_encoding(std::string_view text) {
  using namespace std::string_view_literals;
  if (text.starts_with("\xFF\xFE\0\0"sv) || text.starts_with("\0\0\xFE\xFF"sv)) return "UTF-32";
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF")) return "UTF-16";
  std::string zeros;
  for (const char c : text.substr(0, 4)) zeros += c == '\0' ? '0' : '1';
  if (zeros == "0001") return "UTF-32BE";
  if (zeros == "1000") return "UTF-32LE";
  return zeros.starts_with("01") ? "UTF-16BE" : zeros.starts_with("10") ? "UTF-16LE" : "";
}

/// Whether a word can be the name of an encoding (XML 1.0, clause 4.3.3), and so stand in a command.
bool is_encoding_name(std::string_view word) {
  const auto is_letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
  return !word.empty() && word.size() < 30 && is_letter(word[0]) && std::ranges::all_of(word, [&](char c) {
    return is_letter(c) || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
  });
}

}  // namespace

std::size_t first_not_allowed(std::string_view s) {
  for (std::size_t i = 0; i < s.size();) {
    const std::size_t length = character_length(s.substr(i));
    if (length == 0) return i;
    i += length;
  }
  return std::string_view::npos;
}

std::string why_not_utf8(std::string_view text, std::string_view document) {
  const auto convert = [](const std::string& from) { return ", expected UTF-8: iconv -f " + from + " -t UTF-8"; };
  if (const std::string wide = wide_encoding(text); !wide.empty()) return wide.substr(0, 6) + " text" + convert(wide);
  std::size_t bad = first_not_allowed(text);
  if (bad == std::string_view::npos) return "";
  const auto byte = static_cast<unsigned char>(text[bad]);
  constexpr std::string_view kDigits = "0123456789ABCDEF";
  const std::string shown = std::string("byte 0x") + kDigits[byte >> 4U] + kDigits[byte & 15U];
  if (byte < 0x80) return shown + ", a character that XML cannot have, expected text";
  const std::string_view declaration = document.substr(0, document.find("?>"));
  const std::size_t at = declaration.starts_with("<?xml") ? declaration.find("encoding=") : std::string_view::npos;
  const std::string_view rest = at == std::string_view::npos ? "" : declaration.substr(at + 9);
  const std::string declared(rest.size() > 1 ? rest.substr(1, rest.find(rest[0], 1) - 1) : "");
  const bool named = is_encoding_name(declared) && declared != "UTF-8" && declared != "utf-8";
  return shown + " is not UTF-8" + (named ? " but " + declared + convert(declared) : convert("ISO-8859-1") + ", if it is that");
}

bool is_xml_text(std::string_view text) { return first_not_allowed(text) == std::string_view::npos; }

std::size_t first_tag_with_more_attributes(std::string_view text, std::size_t most) {
  constexpr std::size_t kNone = std::string_view::npos;
  for (std::size_t tag = text.find('<'); tag != kNone;) {
    const std::string_view rest = text.substr(tag);
    const std::string_view end = rest.starts_with("<!--") ? "-->" : rest.starts_with("<![CDATA[") ? "]]>" : "";
    std::size_t at = tag;
    if (!end.empty()) {
      at = text.find(end, tag);
    } else {
      std::size_t values = 0;
      for (at = text.find_first_of("\"'<>", tag + 1); at != kNone && text[at] != '<' && text[at] != '>';) {
        if (++values > most) return tag;
        at = text.find(text[at], at + 1);
        if (at != kNone) at = text.find_first_of("\"'<>", at + 1);
      }
    }
    if (at == kNone) return kNone;
    tag = text.find('<', at);
  }
  return kNone;
}

}  // namespace cotwin::xml
