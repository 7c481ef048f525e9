#pragma once
#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "components/gateway/http/message.h"

namespace cotwin::gateway::http {

using Digest = std::array<unsigned char, 32>;  // SHA-256
Digest digest_of(std::string_view text);

/// Bearer tokens (RFC 6750) of a file. Only their hashes are kept, and are compared in constant time.
class Tokens {
 public:
  static constexpr std::size_t kShortest = 16, kLongest = 512, kMost = 1024;

  Tokens() = default;
  /// Reads lines "SCOPE TOKEN" with SCOPE read or operate; # begins a comment line. Throws Error with the line's number, and without the
  /// token, for anything else, for fewer than kShortest characters and for a token that is there twice.
  static Tokens parse(std::string_view text, const std::string& place);
  /// The same from a file. Throws Error if users other than its owner can read or write it.
  static Tokens load(const std::filesystem::path& file);

  bool empty() const { return entries_.empty(); }
  std::size_t size() const { return entries_.size(); }
  /// Takes the same time for every token.
  std::optional<Scope> scope_of(std::string_view token) const;

 private:
  struct Entry {
    Digest digest{};
    Scope scope = Scope::kRead;
  };
  std::vector<Entry> entries_;
};

/// Throws Error if a file that must be secret is not a regular file, or can be read or written by users other than its owner.
void check_secret(const std::filesystem::path& file);

/// Short-lived tickets for browsers, which cannot send a token when they open an event stream or a WebSocket. Each is used once.
class Tickets {
 public:
  static constexpr std::chrono::seconds kLife{30};
  static constexpr std::size_t kMost = 1024;
  using Time = std::chrono::steady_clock::time_point;

  static constexpr std::size_t kMostOfOne = 64;
  struct Grant {
    Scope scope = Scope::kRead;
    std::string client;  // who asked for the ticket: Request::client
  };

  /// `owner`: who asks (Request::owner). Empty, if there are kMost that are not used yet, or kMostOfOne of this owner.
  std::string issue(Grant grant, const std::string& owner, Time now);
  /// What a valid ticket grants; it is not valid any more then.
  std::optional<Grant> redeem(std::string_view ticket, Time now);

 private:
  struct Entry {
    Grant grant;
    std::string owner;
    Time end;
  };
  std::mutex mutex_;
  std::map<Digest, Entry> entries_;
};

/// From which names and pages the gateway may be called: a browser on this machine reaches also servers at the loopback address.
struct Authority {
  std::vector<std::string> hosts;    // allowed in Host, lower case and without port: "localhost", "127.0.0.1", "[::1]"
  std::vector<std::string> origins;  // of pages beside the gateway's own: "https://mes.example:8443"

  /// Whether the value of a Host field is an allowed host, with any port or none.
  bool allows_host(std::string_view host) const;

  enum class Origin { kOwn, kNamed, kRefused };
  /// `host`: the Host field, which is allowed. A page of the gateway's own has the origin "scheme://host".
  Origin check_origin(std::string_view origin, std::string_view scheme, std::string_view host) const;
};

/// The host of "name:port", "name", "[::1]:port" in lower case; nothing if it is none of these.
std::optional<std::string> host_of(std::string_view authority);

/// Throws Error unless `origin` is "scheme://host" or "scheme://host:port".
void check_origin_setting(const std::string& origin, const std::string& place);

}  // namespace cotwin::gateway::http
