#include "models/foundation/net/endpoint.h"

#include <charconv>

#include "models/foundation/support/error.h"

namespace cotwin::net {

namespace {

/// A decimal number up to `most` at the beginning of `text`, which is removed. False if there is none.
bool read_number(std::string_view& text, std::uint32_t most, std::uint32_t& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{} || number > most) return false;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return true;
}

bool take(std::string_view& text, char c) {
  if (text.empty() || text.front() != c) return false;
  text.remove_prefix(1);
  return true;
}

bool parse(std::string_view text, Endpoint& endpoint) {
  std::uint32_t number = 0;
  for (int i = 0; i < 4; ++i) {
    if ((i > 0 && !take(text, '.')) || !read_number(text, 255, number)) return false;
    endpoint.address = endpoint.address << 8 | number;
  }
  if (text.empty()) return true;
  if (!take(text, ':') || !read_number(text, 65535, number) || !text.empty()) return false;
  endpoint.port = static_cast<std::uint16_t>(number);
  return true;
}

}  // namespace

Endpoint endpoint_of(const std::string& text, std::uint16_t default_port, const std::string& place) {
  Endpoint endpoint{0, default_port};
  if (parse(text, endpoint)) return endpoint;
  throw Error(place, "'" + text + "' is no IPv4 address, expected one like 192.168.0.20 or 192.168.0.20:30200");
}

std::string to_text(const Endpoint& e) {
  std::string text;
  for (int shift = 24; shift >= 0; shift -= 8) text += std::to_string(e.address >> shift & 255) + (shift > 0 ? "." : ":");
  return text + std::to_string(e.port);
}

}  // namespace cotwin::net
