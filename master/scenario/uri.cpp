#include "master/scenario/uri.h"

#include <algorithm>
#include <cctype>
#include <charconv>

#include "models/foundation/support/error.h"

namespace cotwin::master::ssp {

std::string scheme_of(const std::string& reference) {
  const std::size_t colon = reference.find(':');
  if (colon == std::string::npos || colon == 0) return "";
  const auto valid = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '+' || c == '-' || c == '.';
  };
  const std::string scheme = reference.substr(0, colon);
  return std::all_of(scheme.begin(), scheme.end(), valid) ? scheme : "";
}

std::string percent_decoded(const std::string& text, const std::string& place) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i];
      continue;
    }
    unsigned code = 0;
    const char* begin = text.data() + i + 1;
    const char* end = text.data() + std::min(i + 3, text.size());
    if (std::from_chars(begin, end, code, 16).ptr != begin + 2 || code == 0) {
      throw Error(place, "'" + text + "': malformed escape '%'");
    }
    out += static_cast<char>(code);
    i += 2;
  }
  return out;
}

std::filesystem::path uri_path(const std::string& reference, const std::string& place) {
  const std::string scheme = scheme_of(reference);
  std::string rest = reference;
  if (scheme == "file") {
    rest = reference.substr(5);
    if (rest.rfind("//", 0) == 0) {
      const std::size_t slash = rest.find('/', 2);
      const std::string host = rest.substr(2, slash == std::string::npos ? slash : slash - 2);
      if (!host.empty() && host != "localhost") {
        throw Error(place, "'" + reference + "' is on another host, expected a file of this one");
      }
      rest = slash == std::string::npos ? "" : rest.substr(slash);
    }
  } else if (!scheme.empty()) {
    throw Error(place, "'" + reference + "': scheme '" + scheme + "' is not supported, expected a path");
  }
  std::string path = percent_decoded(rest, place);
  if (path.empty()) throw Error(place, "'" + reference + "' names no file");
  return path;
}

}  // namespace cotwin::master::ssp
