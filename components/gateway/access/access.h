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

#include "components/gateway/access/scope.h"
#include "components/gateway/access/utc.h"

/// Who may do what at the gateway, and who did it.
namespace cotwin::gateway::access {

inline constexpr const char* kBrokerName = "mqtt";  // in logs, for all who command over the broker

using Digest = std::array<unsigned char, 32>;  // SHA-256
Digest digest_of(std::string_view text);

/// Who may use a token.
struct Bearer {
  Digest digest{};  // of the token
  Scopes scopes;
  std::string client;            // part of the digest: enough to tell tokens apart, and no secret
  std::string name;              // as lines of the log call it: given, or "token " and `client`
  std::optional<UtcTime> until;  // from then on the token is not valid
};

/// Bearer tokens (RFC 6750) of a file. Only their hashes are kept, and are compared in constant time.
class Tokens {
 public:
  static constexpr std::size_t kShortest = 16, kLongest = 512, kMost = 1024, kLongestName = 64;

  Tokens() = default;
  /// Reads lines "SCOPE[,SCOPE] TOKEN [name=NAME] [until=TIME]" with the words of kScopeWords, or operate for all of them; each scope
  /// includes read; # begins a comment line. Throws Error with the line's number, and without the token, for anything else, for fewer
  /// than kShortest characters and for a token that is there twice.
  static Tokens parse(std::string_view text, const std::string& place);
  /// The same from a secret file, see read_secret().
  static Tokens load(const std::filesystem::path& file);

  bool empty() const { return bearers_.empty(); }
  std::size_t size() const { return bearers_.size(); }
  /// The bearer of a token that is valid at this time; else nullptr. Takes the same time for every token.
  const Bearer* find(const Digest& token, UtcTime now) const;

 private:
  std::vector<Bearer> bearers_;
};

/// Reads a file that must be secret. Throws Error if it is not a regular file, or can be read or written by users other than its owner. A
/// link is followed: what it leads to must be all that.
std::string read_secret(const std::filesystem::path& file, const std::string& expected);

/// Short-lived tickets for browsers, which cannot send a token when they open an event stream or a WebSocket. Each is used once.
class Tickets {
 public:
  static constexpr std::chrono::seconds kLife{30};
  static constexpr std::size_t kMost = 1024;
  using Time = std::chrono::steady_clock::time_point;

  static constexpr std::size_t kMostOfOne = 64;

  /// `bearer`: the token in whose place the ticket is. `owner`: who asks (Request::owner). Empty, if there are kMost that are not used yet,
  /// or kMostOfOne of this owner.
  std::string issue(const Digest& bearer, const std::string& owner, Time now);
  /// The token of a valid ticket, which is not valid any more then.
  std::optional<Digest> redeem(std::string_view ticket, Time now);

 private:
  struct Entry {
    Digest bearer{};
    std::string owner;
    Time end;
  };
  std::mutex mutex_;
  std::map<Digest, Entry> entries_;
};

/// Erases secrets that are no longer used. A plain memset could be optimised away.
struct Cleansed {
  std::string text;
  ~Cleansed();
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

}  // namespace cotwin::gateway::access
