#include "components/gateway/access/access.h"

#include <fcntl.h>
#include <openssl/crypto.h>
#include <openssl/rand.h>
#include <openssl/sha.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::access {

namespace {

constexpr std::size_t kMostOfSecret = 1 << 20;  // bytes

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

/// Part of a token's hash: enough to tell clients apart, and no secret.
std::string short_name(const Digest& digest) {
  static const char* const kDigits = "0123456789abcdef";
  std::string name;
  for (std::size_t i = 0; i < 8; ++i) {
    name += kDigits[digest[i] >> 4];
    name += kDigits[digest[i] & 15];
  }
  return name;
}

/// The words of a line.
std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  while (!(line = text::trim(line)).empty()) {
    const std::size_t end = std::min(line.find_first_of(" \t"), line.size());
    words.push_back(line.substr(0, end));
    line.remove_prefix(end);
  }
  return words;
}

/// "read,tune"; each scope includes read.
Scopes read_scopes(std::string_view list, const std::string& at) {
  Scopes scopes = Scope::kRead;
  for (const std::string_view word : text::split(list, ',')) {
    const auto found = std::ranges::find_if(kScopeWords, [&](const auto& known) { return word == known.first; });
    if (word == "operate") {
      scopes = Scopes::all();
    } else if (found != std::end(kScopeWords)) {
      scopes = scopes | found->second;
    } else {
      throw Error(at, "does not begin with read or operate, nor with scopes among " + Scopes::all().words(", ") +
                          ", separated by commas, expected such as: read,tune TOKEN");
    }
  }
  return scopes;
}

/// Names stand in logs beside other words: printable ASCII without blanks, quotes and line ends.
std::string read_name(std::string_view name, const std::string& at) {
  const bool good = std::ranges::all_of(name, [](char c) { return is_alphanumeric(c) || std::strchr("-._@+", c) != nullptr; });
  if (!good || name.empty() || name.size() > Tokens::kLongestName || name == kBrokerName)
    throw Error(at, "name= is followed by no name, expected 1 to " + std::to_string(Tokens::kLongestName) +
                        " letters, digits and - . _ @ +, and not " + kBrokerName + ", which names the broker");
  return std::string(name);
}

Bearer read_bearer(std::string_view line, const std::string& at) {
  const std::vector<std::string_view> words = words_of(line);
  Bearer bearer;
  bearer.scopes = read_scopes(words[0], at);
  const std::string_view token = words.size() > 1 ? words[1] : std::string_view();
  if (token.size() < Tokens::kShortest || token.size() > Tokens::kLongest)
    throw Error(at, "the token has " + std::to_string(token.size()) + " characters, expected " +
                        std::to_string(Tokens::kShortest) + " to " + std::to_string(Tokens::kLongest) +
                        ", as from: openssl rand -hex 32");
  if (!is_token(token)) throw Error(at, "the token has characters other than letters, digits and - . _ ~ + / =");
  bearer.digest = digest_of(token);
  for (std::size_t i = 2; i < words.size(); ++i) {
    constexpr std::string_view kName = "name=", kUntil = "until=";
    if (words[i].starts_with(kName) && bearer.name.empty()) {
      bearer.name = read_name(words[i].substr(kName.size()), at);
    } else if (words[i].starts_with(kUntil) && !bearer.until) {
      bearer.until = time_of(words[i].substr(kUntil.size()));
      if (!bearer.until) throw Error(at, "until= is followed by no time, expected one such as until=2026-12-31T00:00:00Z");
    } else {
      throw Error(at, "has more than a token after its scopes, expected name=NAME and until=TIME, each once at most");
    }
  }
  bearer.client = short_name(bearer.digest);
  if (bearer.name.empty()) bearer.name = "token " + bearer.client;
  return bearer;
}

}  // namespace

Digest digest_of(std::string_view text) {
  Digest digest;
  SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data());
  return digest;
}

Cleansed::~Cleansed() { OPENSSL_cleanse(text.data(), text.size()); }

Tokens Tokens::parse(std::string_view text, const std::string& place) {
  Tokens tokens;
  int number = 0;
  for (const std::string_view whole : text::split(text, '\n')) {
    const std::string at = place + ":" + std::to_string(++number);
    const std::string_view line = text::trim(whole);
    if (line.empty() || line.front() == '#') continue;
    Bearer bearer = read_bearer(line, at);
    for (const Bearer& other : tokens.bearers_) {
      if (other.digest == bearer.digest) throw Error(at, "the token is there twice");
    }
    tokens.bearers_.push_back(std::move(bearer));
    if (tokens.size() > kMost) throw Error(at, "more than " + std::to_string(kMost) + " tokens");
  }
  return tokens;
}

Tokens Tokens::load(const std::filesystem::path& file) {
  const Cleansed content{read_secret(file, "a file of tokens")};
  return parse(content.text, file.string());
}

const Bearer* Tokens::find(const Digest& token, UtcTime now) const {
  const Bearer* found = nullptr;
  for (const Bearer& bearer : bearers_) {
    if (CRYPTO_memcmp(bearer.digest.data(), token.data(), token.size()) == 0) found = &bearer;
  }
  return found != nullptr && found->until && now >= *found->until ? nullptr : found;
}

std::string read_secret(const std::filesystem::path& file, const std::string& expected) {
  const text::File opened = text::open_file(file, expected);  // a regular file
  struct stat status = {};
  if (::fstat(::fileno(opened.get()), &status) != 0)
    throw Error(file.string(), std::string("cannot be read: ") + std::strerror(errno));
  if ((status.st_mode & (S_IRWXG | S_IRWXO)) != 0)
    throw Error(file.string(), "can be used by other users than its owner, expected mode 600: chmod 600 " + file.string());
  std::string content;
  std::array<char, 4096> part{};
  for (std::size_t n = 0; (n = std::fread(part.data(), 1, part.size(), opened.get())) > 0;) {
    content.append(part.data(), n);
    if (content.size() > kMostOfSecret)
      throw Error(file.string(), "has more than " + std::to_string(kMostOfSecret) + " bytes, expected " + expected);
  }
  OPENSSL_cleanse(part.data(), part.size());
  return content;
}

std::string Tickets::issue(const Digest& bearer, const std::string& owner, Time now) {
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
  entries_[digest_of(ticket)] = {bearer, owner, now + kLife};
  return ticket;
}

std::optional<Digest> Tickets::redeem(std::string_view ticket, Time now) {
  const Digest digest = digest_of(ticket);
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(digest);  // of hashes: their order tells nothing about tickets
  if (found == entries_.end()) return std::nullopt;
  const Entry entry = std::move(found->second);
  entries_.erase(found);
  if (entry.end <= now) return std::nullopt;
  return entry.bearer;
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

}  // namespace cotwin::gateway::access
