#include "fmu/archive/uri.h"

#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace {

int hexadecimal(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

bool is_alphanumeric(char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }

/// Removes `head` from the front of `text`; returns whether it was there.
bool consume(std::string_view& text, std::string_view head) {
  if (text.substr(0, head.size()) != head) return false;
  text.remove_prefix(head.size());
  return true;
}

/// Returns whether `text` begins with a Windows drive: "/C:".
bool has_drive(std::string_view text) {
  return text.size() >= 3 && text[0] == '/' && is_alphanumeric(text[1]) && text[2] == ':';
}

}  // namespace

std::filesystem::path path_from_uri(std::string_view uri) {
  std::string_view rest = uri;
  if (!consume(rest, "file:")) {
    if (rest.find("://") != std::string_view::npos) throw Error(std::string(uri), "expected a URI that begins with file:");
    return std::filesystem::path(std::string(rest));
  }
  if (consume(rest, "//")) {
    const std::string_view host = rest.substr(0, rest.find('/'));
    if (!host.empty() && host != "localhost") throw Error(std::string(uri), "names another host, expected file:///…");
    rest.remove_prefix(host.size());
  }
  std::string path;
  for (std::size_t i = 0; i < rest.size(); ++i) {
    if (rest[i] != '%') {
      path += rest[i];
      continue;
    }
    const int high = i + 2 < rest.size() ? hexadecimal(rest[i + 1]) : -1;
    const int low = i + 2 < rest.size() ? hexadecimal(rest[i + 2]) : -1;
    if (high < 0 || low < 0 || high + low == 0)
      throw Error(std::string(uri), "has a '%' that is not followed by two hexadecimal digits of a character");
    path += static_cast<char>(high * 16 + low);
    i += 2;
  }
  if (has_drive(path)) path.erase(0, 1);
  return std::filesystem::path(path);
}

std::string uri_from_path(const std::filesystem::path& path) {
  static constexpr char kDigits[] = "0123456789ABCDEF";
  const std::string text = path.generic_string();
  std::string uri = text.starts_with('/') ? "file://" : "file:///";
  for (const char c : text) {
    if (is_alphanumeric(c) || std::string_view("/-._~:").find(c) != std::string_view::npos) {
      uri += c;
    } else {
      uri += '%';
      uri += kDigits[static_cast<unsigned char>(c) >> 4];
      uri += kDigits[static_cast<unsigned char>(c) & 15];
    }
  }
  return uri;
}

}  // namespace cotwin::fmu
