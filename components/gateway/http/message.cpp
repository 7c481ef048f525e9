#include "components/gateway/http/message.h"

#include <algorithm>
#include <array>
#include <cctype>

#include "models/foundation/support/text.h"

namespace cotwin::gateway::http {

namespace {

constexpr std::size_t kMostSegments = 16, kMostPairs = 32;

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

std::string lower(std::string_view text) {
  std::string out(text);
  for (char& c : out) c = lower(c);
  return out;
}

int hex(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  c = lower(c);
  return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/// Quality of a range in an Accept field, `*/*;q=0.5`; 1 without one, 0 for one that cannot be read.
double quality(std::string_view range) {
  for (const std::string_view parameter : text::split(range, ';')) {
    const std::string_view p = text::trim(parameter);
    if (p.size() > 2 && lower(p[0]) == 'q' && p[1] == '=') return text::parse_real(p.substr(2)).value_or(0);
  }
  return 1;
}

}  // namespace

const std::string* Request::field(std::string_view name) const {
  for (const Field& f : fields) {
    if (equal_names(f.name, name)) return &f.value;
  }
  return nullptr;
}

const std::string& Request::part(std::string_view name) const {
  static const std::string kNone;
  for (const auto& [key, value] : matched) {
    if (key == name) return value;
  }
  return kNone;
}

const std::string* Request::query_value(std::string_view name) const {
  for (const auto& [key, value] : query) {
    if (key == name) return &value;
  }
  return nullptr;
}

bool equal_names(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char x, char y) { return lower(x) == lower(y); });
}

std::string_view reason_of(int status) {
  static constexpr std::array<std::pair<int, const char*>, 32> kReasons = {{{100, "Continue"},
                                                                            {200, "OK"},
                                                                            {201, "Created"},
                                                                            {202, "Accepted"},
                                                                            {204, "No Content"},
                                                                            {303, "See Other"},
                                                                            {304, "Not Modified"},
                                                                            {400, "Bad Request"},
                                                                            {401, "Unauthorized"},
                                                                            {403, "Forbidden"},
                                                                            {404, "Not Found"},
                                                                            {405, "Method Not Allowed"},
                                                                            {406, "Not Acceptable"},
                                                                            {408, "Request Timeout"},
                                                                            {409, "Conflict"},
                                                                            {410, "Gone"},
                                                                            {412, "Precondition Failed"},
                                                                            {413, "Content Too Large"},
                                                                            {414, "URI Too Long"},
                                                                            {415, "Unsupported Media Type"},
                                                                            {417, "Expectation Failed"},
                                                                            {421, "Misdirected Request"},
                                                                            {422, "Unprocessable Content"},
                                                                            {426, "Upgrade Required"},
                                                                            {428, "Precondition Required"},
                                                                            {429, "Too Many Requests"},
                                                                            {431, "Request Header Fields Too Large"},
                                                                            {500, "Internal Server Error"},
                                                                            {501, "Not Implemented"},
                                                                            {503, "Service Unavailable"},
                                                                            {504, "Gateway Timeout"},
                                                                            {505, "HTTP Version Not Supported"}}};
  for (const auto& [number, reason] : kReasons) {
    if (number == status) return reason;
  }
  return "";
}

std::optional<std::string> decode(std::string_view encoded, bool segment) {
  std::string out;
  for (std::size_t i = 0; i < encoded.size(); ++i) {
    char c = encoded[i];
    if (c == '%') {
      if (i + 2 >= encoded.size() || hex(encoded[i + 1]) < 0 || hex(encoded[i + 2]) < 0) return std::nullopt;
      c = static_cast<char>(16 * hex(encoded[i + 1]) + hex(encoded[i + 2]));
      i += 2;
    } else if (c == '+' && !segment) {
      c = ' ';
    }
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte == 0x7f || (segment && (c == '/' || c == '\\'))) return std::nullopt;
    out += c;
  }
  return out;
}

std::string read_target(std::string_view target, Request& request, std::string& host) {
  host.clear();
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (target.size() < scheme.size() || !equal_names(target.substr(0, scheme.size()), scheme)) continue;
    target.remove_prefix(scheme.size());
    const std::size_t end = std::min(target.find_first_of("/?"), target.size());
    host = target.substr(0, end);
    if (host.empty()) return "the target names no host";
    target.remove_prefix(end);
    if (target.empty()) target = "/";
    break;
  }
  if (target.empty() || target.front() != '/') return "the target is not a path, expected one such as /health";
  const std::size_t mark = target.find('?');
  const std::string_view path = target.substr(0, mark);
  request.path = path;
  request.segments.clear();
  request.query.clear();
  std::string_view rest = path.substr(1);
  if (!rest.empty() && rest.back() == '/') return "the path ends with a slash, expected none";
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('/'), rest.size());
    auto segment = decode(rest.substr(0, end), true);
    if (!segment) return "a segment of the path is not allowed: damaged escapes, control characters and escaped slashes";
    if (segment->empty() || *segment == "." || *segment == "..")
      return "the path has a segment '" + *segment + "', expected a name";
    request.segments.push_back(std::move(*segment));
    if (request.segments.size() > kMostSegments) return "the path has too many segments";
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  if (mark == std::string_view::npos || mark + 1 == target.size()) return "";
  const std::vector<std::string_view> pairs = text::split(target.substr(mark + 1), '&');
  if (pairs.size() > kMostPairs) return "the query has too many values";
  for (const std::string_view pair : pairs) {
    const std::size_t equal = std::min(pair.find('='), pair.size());
    auto key = decode(pair.substr(0, equal), false);
    auto value = decode(equal < pair.size() ? pair.substr(equal + 1) : std::string_view(), false);
    if (!key || !value || key->empty()) return "the query is damaged, expected name=value with %-escapes";
    request.query.emplace_back(std::move(*key), std::move(*value));
  }
  return "";
}

std::string encode_segment(std::string_view segment) {
  static const char* const kDigits = "0123456789ABCDEF";
  std::string out;
  for (const char c : segment) {
    if (std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' || c == '.' || c == '~') {
      out += c;
    } else {
      const auto byte = static_cast<unsigned char>(c);
      out += '%';
      out += kDigits[byte >> 4];
      out += kDigits[byte & 15];
    }
  }
  return out;
}

std::string media_type(std::string_view content_type) {
  return lower(text::trim(content_type.substr(0, content_type.find(';'))));
}

bool accepts(std::string_view accept, std::string_view type) {
  const std::string group = std::string(type.substr(0, type.find('/'))) + "/*";
  for (const std::string_view range : text::split(accept, ',')) {
    const std::string name = media_type(range);
    if ((name == type || name == group || name == "*/*") && quality(range) > 0) return true;
  }
  return false;
}

std::optional<std::string> preference(std::string_view prefer, std::string_view token) {
  for (const std::string_view item : text::split(prefer, ',')) {
    const std::string_view whole = text::trim(item.substr(0, item.find(';')));
    const std::size_t equal = std::min(whole.find('='), whole.size());
    if (!equal_names(text::trim(whole.substr(0, equal)), token)) continue;
    return std::string(equal < whole.size() ? text::trim(whole.substr(equal + 1)) : std::string_view());
  }
  return std::nullopt;
}

}  // namespace cotwin::gateway::http
