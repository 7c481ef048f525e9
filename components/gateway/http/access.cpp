#include "components/gateway/http/access.h"

#include <fcntl.h>
#include <openssl/crypto.h>
#include <openssl/rand.h>
#include <openssl/sha.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::http {

namespace {

constexpr std::uint64_t kMostTokenFile = 1 << 20;  // bytes

bool is_alphanumeric(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9'); }

/// The characters of b64token in RFC 6750.
bool is_token(std::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](char c) { return is_alphanumeric(c) || std::strchr("-._~+/=", c) != nullptr; });
}

std::string lower_text(std::string_view text) {
  std::string out(text);
  for (char& c : out) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return out;
}

bool is_port(std::string_view text) {
  const bool digits = std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
  return digits && text.size() <= 5 && text::parse_integer(text).value_or(0) <= 65535 && !text.empty();
}

/// Erases secrets that are no longer used. A plain memset could be optimised away.
struct Cleansed {
  std::string text;
  ~Cleansed() { OPENSSL_cleanse(text.data(), text.size()); }
};

}  // namespace

Digest digest_of(std::string_view text) {
  Digest digest;
  SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data());
  return digest;
}

Tokens Tokens::parse(std::string_view text, const std::string& place) {
  Tokens tokens;
  int number = 0;
  for (const std::string_view whole : text::split(text, '\n')) {
    const std::string at = place + ":" + std::to_string(++number);
    const std::string_view line = text::trim(whole);
    if (line.empty() || line.front() == '#') continue;
    const std::size_t end = std::min(line.find_first_of(" \t"), line.size());
    const std::string_view scope = line.substr(0, end), token = text::trim(line.substr(end));
    if (scope != "read" && scope != "operate") throw Error(at, "does not begin with read or operate, expected: read TOKEN");
    if (token.size() < kShortest || token.size() > kLongest)
      throw Error(at, "the token has " + std::to_string(token.size()) + " characters, expected " + std::to_string(kShortest) +
                          " to " + std::to_string(kLongest) + ", as from: openssl rand -hex 32");
    if (!is_token(token)) throw Error(at, "the token has characters other than letters, digits and - . _ ~ + / =");
    const Digest digest = digest_of(token);
    for (const Entry& other : tokens.entries_) {
      if (other.digest == digest) throw Error(at, "the token is there twice");
    }
    tokens.entries_.push_back({digest, scope == "read" ? Scope::kRead : Scope::kOperate});
    if (tokens.entries_.size() > kMost) throw Error(at, "more than " + std::to_string(kMost) + " tokens");
  }
  if (tokens.empty()) throw Error(place, "has no token, expected lines such as: operate TOKEN");
  return tokens;
}

Tokens Tokens::load(const std::filesystem::path& file) {
  check_secret(file);
  const Cleansed content{text::read_file(file, "a file of tokens", kMostTokenFile)};
  return parse(content.text, file.string());
}

std::optional<Scope> Tokens::scope_of(std::string_view token) const {
  const Digest digest = digest_of(token);
  int found = -1;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (CRYPTO_memcmp(entries_[i].digest.data(), digest.data(), digest.size()) == 0) found = static_cast<int>(i);
  }
  if (found < 0) return std::nullopt;
  return entries_[static_cast<std::size_t>(found)].scope;
}

void check_secret(const std::filesystem::path& file) {
  struct stat status = {};
  if (::stat(file.c_str(), &status) != 0) throw Error(file.string(), std::string("cannot be read: ") + std::strerror(errno));
  if (!S_ISREG(status.st_mode)) throw Error(file.string(), "is not a regular file");
  if ((status.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
    throw Error(file.string(), "can be used by other users than its owner, expected mode 600: chmod 600 " + file.string());
  }
}

std::string Tickets::issue(Grant grant, const std::string& owner, Time now) {
  std::array<unsigned char, 24> random{};
  if (RAND_bytes(random.data(), static_cast<int>(random.size())) != 1) return "";
  static const char* const kDigits = "0123456789abcdef";
  std::string ticket;
  for (const unsigned char byte : random) {
    ticket += kDigits[byte >> 4];
    ticket += kDigits[byte & 15];
  }
  const std::lock_guard lock(mutex_);
  std::erase_if(entries_, [&](const auto& entry) { return entry.second.end <= now; });
  const auto own = std::count_if(entries_.begin(), entries_.end(), [&](const auto& e) { return e.second.owner == owner; });
  if (entries_.size() >= kMost || static_cast<std::size_t>(own) >= kMostOfOne) return "";
  entries_[digest_of(ticket)] = {std::move(grant), owner, now + kLife};
  return ticket;
}

std::optional<Tickets::Grant> Tickets::redeem(std::string_view ticket, Time now) {
  const Digest digest = digest_of(ticket);
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(digest);  // of hashes: their order tells nothing about tickets
  if (found == entries_.end()) return std::nullopt;
  Entry entry = std::move(found->second);
  entries_.erase(found);
  if (entry.end <= now) return std::nullopt;
  return std::move(entry.grant);
}

std::optional<std::string> host_of(std::string_view authority) {
  if (authority.empty() || authority.size() > 255) return std::nullopt;
  if (authority.front() == '[') {
    const std::size_t end = authority.find(']');
    if (end == std::string_view::npos) return std::nullopt;
    const std::string_view rest = authority.substr(end + 1);
    if (!rest.empty() && (rest.front() != ':' || !is_port(rest.substr(1)))) return std::nullopt;
    return lower_text(authority.substr(0, end + 1));
  }
  const std::size_t colon = std::min(authority.find(':'), authority.size());
  if (colon < authority.size() && !is_port(authority.substr(colon + 1))) return std::nullopt;
  const std::string_view name = authority.substr(0, colon);
  const bool plain =
      std::all_of(name.begin(), name.end(), [](char c) { return is_alphanumeric(c) || c == '-' || c == '.' || c == '_'; });
  if (name.empty() || !plain) return std::nullopt;
  return lower_text(name);
}

bool Authority::allows_host(std::string_view host) const {
  const std::optional<std::string> name = host_of(host);
  return name && std::find(hosts.begin(), hosts.end(), *name) != hosts.end();
}

Authority::Origin Authority::check_origin(std::string_view origin, std::string_view scheme, std::string_view host) const {
  const std::string given = lower_text(origin);
  if (given == lower_text(std::string(scheme) + "://" + std::string(host))) return Origin::kOwn;
  return std::find(origins.begin(), origins.end(), given) != origins.end() ? Origin::kNamed : Origin::kRefused;
}

void check_origin_setting(const std::string& origin, const std::string& place) {
  for (const std::string scheme : {"http://", "https://"}) {
    if (origin.starts_with(scheme) && host_of(std::string_view(origin).substr(scheme.size())) && lower_text(origin) == origin)
      return;
  }
  throw Error(place,
              "'" + origin + "' is no origin, expected one such as https://mes.example:8443, in lower case and without a path");
}

}  // namespace cotwin::gateway::http
