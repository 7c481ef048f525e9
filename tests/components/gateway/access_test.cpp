// Who may do what: tokens, tickets, certificates, local users, wrong tokens, the audit; without the program.
#include "components/gateway/access/access.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "components/gateway/access/audit.h"
#include "components/gateway/access/certificate.h"
#include "components/gateway/access/local_user.h"
#include "components/gateway/access/offences.h"
#include "components/gateway/http/server.h"
#include "models/foundation/support/error.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/http_client.h"
#include "tests/support/patience.h"

namespace cotwin::gateway::access::access_test {
namespace {

namespace fs = std::filesystem;
using testing::content;
using testing::error_of;
using ::testing::HasSubstr;
using testing::http_call;
using testing::http_request;
using testing::HttpReply;
using ::testing::Not;
using testing::RawClient;
using testing::SecretFile;
using testing::TemporaryFolder;
using testing::within_patience;
using namespace std::chrono_literals;

const std::string kA(20, 'a'), kB(20, 'b'), kC(20, 'c');

UtcTime at(const char* text) { return time_of(text).value(); }

std::string field_of(const std::string& token) { return "Authorization: Bearer " + token + "\r\n"; }

TEST(GatewayTokens, HaveScopesANameAndAnEnd) {
  const Tokens tokens = Tokens::parse("# old and new\nread " + kA + "\noperate " + kB + "\n\ttune,acknowledge \t" + kC +
                                          "  until=2026-12-31T00:00:00Z name=anna@cell-3\r\n",
                                      "tokens");
  ASSERT_EQ(tokens.size(), 3u);
  const UtcTime before = at("2026-12-30T23:59:59.999Z");
  const auto find = [&](const std::string& token, UtcTime now) { return tokens.find(digest_of(token), now); };
  EXPECT_EQ(find(kA, before)->scopes, Scope::kRead);
  EXPECT_THAT(find(kA, before)->name, ::testing::StartsWith("token "));
  EXPECT_EQ(find(kB, before)->scopes, Scopes::all());
  EXPECT_EQ(find(kC, before)->scopes, Scope::kRead | Scope::kTune | Scope::kAcknowledge);
  EXPECT_EQ(find(kC, before)->name, "anna@cell-3");
  EXPECT_EQ(find(kC, before + 1ms), nullptr) << "it is over";
  EXPECT_NE(find(kB, before + 1ms), nullptr);
  EXPECT_EQ(find("", before), nullptr);
  EXPECT_EQ(find(kA.substr(1), before), nullptr);
}

TEST(GatewayTokens, NameWhatIsWrongWithALineAndNeverTheToken) {
  const auto error = [](const std::string& text) { return error_of([&] { Tokens::parse(text, "tokens"); }); };
  EXPECT_THAT(error("\nwrite " + kA), HasSubstr("tokens:2: does not begin with read or operate"));
  EXPECT_THAT(error("read,,tune " + kA), HasSubstr("does not begin with"));
  EXPECT_THAT(error("Read " + kA), HasSubstr("does not begin with"));
  EXPECT_THAT(error("read short"), HasSubstr("the token has 5 characters"));
  EXPECT_THAT(error("read"), HasSubstr("the token has 0 characters"));
  EXPECT_THAT(error("read " + std::string(513, 'a')), HasSubstr("the token has 513 characters"));
  EXPECT_THAT(error("read " + kA + "\nread " + kA), HasSubstr("tokens:2: the token is there twice"));
  EXPECT_THAT(error("read " + kA + " name=a\ntune " + kA + " name=b"), HasSubstr("the token is there twice"));
  EXPECT_THAT(error("read " + kA + " name=a name=b"), HasSubstr("each once at most"));
  EXPECT_THAT(error("read " + kA + " until=2026-12-31T00:00:00Z until=2027-12-31T00:00:00Z"), HasSubstr("each once at most"));
  EXPECT_THAT(error("read " + kA + " anna"), HasSubstr("each once at most"));
  EXPECT_THAT(error("read " + kA + " until=tomorrow"), HasSubstr("until= is followed by no time"));
  for (const std::string& name : {std::string(), std::string("a\"b"), std::string("a\x1b[2J"), std::string("a\rb"),
                                  std::string("mqtt"), std::string(65, 'n'), std::string("\xff")})
    EXPECT_THAT(error("read " + kA + " name=" + name), HasSubstr("tokens:1: name= is followed by no name")) << name;
  for (const std::string& line :
       {"read aaaaaaaaaaaaaaaa\"secret", "secretsecretsecret read", "read short-secret secret=secret"})
    EXPECT_THAT(error(line), Not(HasSubstr("secret"))) << "messages do not contain tokens";
  // As many as are permitted, and one more. Several may have one name: a new token beside the old one.
  std::string many;
  for (int i = 0; i < 1024; ++i) many += "read token-number-" + std::to_string(10000 + i) + " name=planner\n";
  EXPECT_EQ(Tokens::parse(many, "tokens").size(), 1024u);
  EXPECT_NE(Tokens::parse(many, "tokens").find(digest_of("token-number-11023"), {}), nullptr);
  EXPECT_THAT(error(many + "read " + kA), HasSubstr("tokens:1025: more than 1024 tokens"));
}

TEST(GatewayTokens, AreReadFromFilesThatOnlyTheirOwnerCanRead) {
  const TemporaryFolder folder("tokens");
  const fs::path file = folder.write("tokens", "operate " + kA + "\n");
  fs::permissions(file, fs::perms(0640));
  EXPECT_THAT(error_of([&] { Tokens::load(file); }), HasSubstr("expected mode 600"));
  fs::create_symlink(file, folder / "link");
  EXPECT_THAT(error_of([&] { Tokens::load(folder / "link"); }), HasSubstr("expected mode 600"));
  fs::permissions(file, fs::perms(0600));
  EXPECT_EQ(Tokens::load(file).size(), 1u);
  EXPECT_EQ(Tokens::load(folder / "link").size(), 1u);
  EXPECT_EQ(::mkfifo((folder / "pipe").c_str(), 0600), 0);
  EXPECT_NE(error_of([&] { Tokens::load(folder / "pipe"); }), "");
  EXPECT_NE(error_of([&] { Tokens::load(folder.path()); }), "");
  EXPECT_NE(error_of([&] { Tokens::load(folder / "none"); }), "");
  fs::resize_file(file, (1 << 20) + 1);
  EXPECT_THAT(error_of([&] { Tokens::load(file); }), HasSubstr("has more than 1048576 bytes"));
}

TEST(GatewayTokens, ThatAreOverStayOverWhenTheClockIsSetBack) {
  ForwardClock clock;
  const auto start = ForwardClock::Steady() + 1h;
  const UtcTime noon = at("2026-11-29T12:00:00Z");
  EXPECT_EQ(clock.now(noon, start), noon);
  EXPECT_EQ(clock.now(noon + 10s, start + 10s), noon + 10s);
  EXPECT_EQ(clock.now(noon - 24h, start + 20s), noon + 20s) << "set back by a day";
  EXPECT_EQ(clock.now(noon - 24h + 5s, start + 25s), noon + 25s);
  EXPECT_EQ(clock.now(noon + 1h, start + 26s), noon + 1h) << "set right again, and further";
  for (int i = 1; i <= 3000; ++i) clock.now(noon, start + 26s + i * 400us);
  EXPECT_EQ(clock.now(noon, start + 26s + 1200ms), noon + 1h + 1200ms) << "short times add up";
}

TEST(GatewayTickets, StandForATokenOnce) {
  Tickets tickets;
  const auto now = std::chrono::steady_clock::now();
  const Digest bearer = digest_of(kA);
  const std::string ticket = tickets.issue(bearer, "a", now);
  EXPECT_EQ(tickets.redeem(ticket, now), bearer);
  EXPECT_FALSE(tickets.redeem(ticket, now));
  EXPECT_FALSE(tickets.redeem(tickets.issue(bearer, "a", now), now + Tickets::kLife));
  // Unused tickets are limited: of one owner, so that it leaves some for others, and of all.
  std::set<std::string> all;
  for (std::size_t i = 0; i < Tickets::kMostOfOne; ++i) all.insert(tickets.issue(bearer, "0", now));
  EXPECT_EQ(tickets.issue(bearer, "0", now), "");
  for (std::size_t i = Tickets::kMostOfOne; i < Tickets::kMost; ++i)
    all.insert(tickets.issue(bearer, std::to_string(i / Tickets::kMostOfOne), now));
  EXPECT_EQ(all.size(), Tickets::kMost);
  EXPECT_EQ(tickets.issue(bearer, "another", now), "");
  EXPECT_NE(tickets.issue(bearer, "0", now + Tickets::kLife), "");
}

TEST(GatewayOffences, AreLateFromTheFifthInAMinuteOnAndToldOnceASecond) {
  Offences wrong(1);
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 4; ++i) EXPECT_FALSE(wrong.note("a", start + i * 10s).late) << i;
  EXPECT_TRUE(wrong.note("a", start + 59s).late) << "the fifth within a minute";
  EXPECT_FALSE(wrong.note("b", start + 59s).late) << "another address";
  EXPECT_FALSE(wrong.note("a", start + 120s).late);
  // 10⁵ of them, in 100 s.
  std::uint64_t lines = 0, counted = 0;
  for (int i = 0; i < 100'000; ++i) {
    const auto verdict = wrong.note("flood", start + i * 1ms);
    EXPECT_EQ(verdict.late, i >= 4);
    lines += verdict.told;
    counted += verdict.told + verdict.since_told;
  }
  EXPECT_NEAR(static_cast<double>(lines), 100, 1);
  EXPECT_NEAR(static_cast<double>(counted), 100'000, 1001) << "those without a line are counted";
  // Memory is bounded, and who comes from ever new addresses is late, too.
  Offences many(1);
  int late = 0;
  for (int i = 0; i < 100'000; ++i) late += many.note(std::to_string(i), start).late;
  EXPECT_LE(many.size(), Offences::kMost + 1);
  EXPECT_GT(late, 90'000);
  EXPECT_FALSE(many.note("later", start + 61s).late) << "and forgotten";
}

/// Certificates for tests, made here: those that nobody should have cannot be ordered from a tool.
struct Issued {
  std::string certificate, key;
};

using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;
Key rsa(unsigned bits) { return {EVP_RSA_gen(bits), EVP_PKEY_free}; }
Key curve(const char* name) { return {EVP_EC_gen(name), EVP_PKEY_free}; }
Key ed25519() { return {EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519"), EVP_PKEY_free}; }

template <class Write>
std::string pem(const Write& write) {
  const std::unique_ptr<BIO, decltype(&BIO_free)> out(BIO_new(BIO_s_mem()), BIO_free);
  write(out.get());
  char* bytes = nullptr;
  const long size = BIO_get_mem_data(out.get(), &bytes);
  return {bytes, static_cast<std::size_t>(size)};
}

/// `from`, `to`: s from now. `issuer`: who signs; nullptr: itself.
Issued issue(const Key& key, const EVP_MD* hash, long from = -10, long to = 1000, EVP_PKEY* issuer = nullptr) {
  const std::unique_ptr<X509, decltype(&X509_free)> x(X509_new(), X509_free);
  X509_set_version(x.get(), 2);
  ASN1_INTEGER_set(X509_get_serialNumber(x.get()), 1);
  X509_gmtime_adj(X509_getm_notBefore(x.get()), from);
  X509_gmtime_adj(X509_getm_notAfter(x.get()), to);
  X509_set_pubkey(x.get(), key.get());
  const auto name = [](X509_NAME* n, const char* text) {
    X509_NAME_add_entry_by_txt(n, "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char*>(text), -1, -1, 0);
  };
  name(X509_get_subject_name(x.get()), "twin");
  name(X509_get_issuer_name(x.get()), issuer != nullptr ? "authority" : "twin");
  X509_sign(x.get(), issuer != nullptr ? issuer : key.get(), hash);
  return {pem([&](BIO* out) { PEM_write_bio_X509(out, x.get()); }),
          pem([&](BIO* out) { PEM_write_bio_PrivateKey(out, key.get(), nullptr, nullptr, 0, nullptr, nullptr); })};
}

TEST(GatewayCertificate, IsRefusedWithTheReason) {
  const TemporaryFolder folder("certificate");
  const auto check = [&](const std::string& chain, const std::string& key) {
    const fs::path certificate = folder.write("cert.pem", chain), secret = folder.write("key.pem", key);
    fs::permissions(secret, fs::perms(0600));
    return error_of([&] { (void)load_certificate(certificate, secret, utc_now()); });
  };
  const auto verdict = [&](const Issued& issued) { return check(issued.certificate, issued.key); };
  const EVP_MD* const sha256 = EVP_sha256();
  const Key p256 = curve("P-256"), rsa2048 = rsa(2048), rsa1024 = rsa(1024);
  // What is good.
  EXPECT_EQ(verdict(issue(p256, sha256)), "");
  EXPECT_EQ(verdict(issue(curve("P-384"), EVP_sha384())), "");
  EXPECT_EQ(verdict(issue(rsa2048, sha256)), "");
  EXPECT_EQ(verdict(issue(ed25519(), nullptr)), "");
  // What is not.
  EXPECT_THAT(verdict(issue(p256, sha256, -1000, -5)), HasSubstr("cert.pem: the certificate expired at 20"));
  EXPECT_THAT(verdict(issue(p256, sha256, 60, 1000)), HasSubstr("the certificate is not valid before 20"));
  EXPECT_THAT(verdict(issue(p256, EVP_sha1())),
              HasSubstr("the certificate is signed with SHA1, expected one that is signed with SHA-256"));
  EXPECT_THAT(verdict(issue(rsa2048, EVP_md5())), HasSubstr("the certificate is signed with MD5"));
  EXPECT_THAT(verdict(issue(rsa1024, sha256)),
              HasSubstr("the certificate has an RSA key of 1024 bits, expected one with 2048"));
  EXPECT_THAT(verdict(issue(curve("P-224"), sha256)),
              HasSubstr("has a key of an elliptic curve of 224 bits, expected one with P-256"));
  EXPECT_THAT(check(issue(p256, sha256).certificate, issue(curve("P-256"), sha256).key),
              HasSubstr("key.pem: is not the key of"));
  EXPECT_THAT(check(issue(p256, sha256).certificate, issue(rsa2048, sha256).key), HasSubstr("key.pem: is not the key of"));
  // The chain: all of it, but the signature of a root.
  const Issued leaf = issue(p256, sha256, -10, 1000, rsa2048.get());
  EXPECT_EQ(check(leaf.certificate + issue(rsa2048, EVP_sha1()).certificate, leaf.key), "") << "a root";
  EXPECT_THAT(check(leaf.certificate + issue(rsa2048, EVP_sha1(), -10, 1000, rsa1024.get()).certificate, leaf.key),
              HasSubstr("number 2 of its chain is signed with SHA1"));
  EXPECT_THAT(check(leaf.certificate + issue(rsa2048, sha256, -1000, -5).certificate, leaf.key),
              HasSubstr("number 2 of its chain expired"));
  // Damaged files, and a key with a password, for which nobody is asked.
  for (const std::string& wrong : {std::string(), std::string("x"), leaf.key, leaf.certificate.substr(0, 200),
                                   leaf.certificate + leaf.certificate.substr(0, 200), std::string(5000, '\0')})
    EXPECT_THAT(check(wrong, leaf.key), HasSubstr("cert.pem: cannot be used as a certificate")) << wrong;
  const std::string locked = pem([&](BIO* out) {
    PEM_write_bio_PrivateKey(out, p256.get(), EVP_aes_128_cbc(), reinterpret_cast<const unsigned char*>("word"), 4, nullptr,
                             nullptr);
  });
  for (const std::string& wrong : {std::string(), leaf.certificate, leaf.key.substr(0, 60), locked})
    EXPECT_THAT(check(leaf.certificate, wrong), HasSubstr("key.pem: cannot be used as the key of")) << wrong;
  fs::permissions(folder.write("key.pem", leaf.key), fs::perms(0644));
  EXPECT_THAT(
      error_of([&] { (void)load_certificate(folder.write("cert.pem", leaf.certificate), folder / "key.pem", utc_now()); }),
      HasSubstr("expected mode 600"));
}

/// A TCP connection within this machine.
struct Line {
  explicit Line(int family, bool mapped = false) {
    listener = ::socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    bind_loopback(family);
    sockaddr_storage to{};
    socklen_t size = sizeof to;
    ::getsockname(listener, reinterpret_cast<sockaddr*>(&to), &size);
    if (mapped) {
      sockaddr_in v4{};
      std::memcpy(&v4, &to, sizeof v4);
      sockaddr_in6 v6{};
      v6.sin6_family = AF_INET6;
      v6.sin6_port = v4.sin_port;
      ::inet_pton(AF_INET6, "::ffff:127.0.0.1", &v6.sin6_addr);
      std::memcpy(&to, &v6, sizeof v6);
      size = sizeof v6;
    }
    client = ::socket(mapped ? AF_INET6 : family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (::connect(client, reinterpret_cast<const sockaddr*>(&to), size) != 0) return;
    accepted = ::accept(listener, nullptr, nullptr);
    socklen_t length = sizeof peer;
    ::getpeername(accepted, reinterpret_cast<sockaddr*>(&peer), &length);
    length = sizeof own;
    ::getsockname(accepted, reinterpret_cast<sockaddr*>(&own), &length);
  }
  ~Line() {
    for (const int socket : {listener, client, accepted}) ::close(socket);
  }
  void bind_loopback(int family) {
    if (family == AF_INET) {
      sockaddr_in v4{};
      v4.sin_family = AF_INET;
      v4.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
      ::bind(listener, reinterpret_cast<const sockaddr*>(&v4), sizeof v4);
    } else {
      sockaddr_in6 v6{};
      v6.sin6_family = AF_INET6;
      v6.sin6_addr = in6addr_loopback;
      ::bind(listener, reinterpret_cast<const sockaddr*>(&v6), sizeof v6);
    }
    ::listen(listener, 4);
  }
  std::optional<std::uint32_t> user() const { return user_at(as_address(peer), as_address(own)); }
  std::optional<std::uint32_t> user_of_tables() const { return user_in_tables(as_address(peer), as_address(own)); }
  static const sockaddr& as_address(const sockaddr_storage& s) { return reinterpret_cast<const sockaddr&>(s); }

  int listener = -1, client = -1, accepted = -1;
  sockaddr_storage peer{}, own{};
};

TEST(GatewayLocalUser, IsWhoMadeTheSocketAtTheOtherEnd) {
  for (const auto& [family, mapped] : {std::pair(AF_INET, false), std::pair(AF_INET, true), std::pair(AF_INET6, false)}) {
    Line line(family, mapped);
    if (line.accepted < 0) continue;  // a machine without IPv6
    EXPECT_EQ(line.user(), ::getuid()) << family << mapped;
    EXPECT_EQ(line.user_of_tables(), ::getuid()) << family << mapped;
    ::shutdown(line.client, SHUT_WR);
    EXPECT_EQ(line.user(), ::getuid()) << "it still listens";
    // The system calls the user of a socket that no process has any more 0, which is root.
    ::close(std::exchange(line.client, -1));
    EXPECT_EQ(line.user(), std::nullopt) << family << mapped;
    EXPECT_EQ(line.user_of_tables(), std::nullopt) << family << mapped;
  }
  Line a(AF_INET), b(AF_INET);
  EXPECT_EQ(user_at(Line::as_address(a.peer), Line::as_address(b.own)), std::nullopt) << "no such connection";
  sockaddr unknown{};
  unknown.sa_family = AF_UNIX;
  EXPECT_EQ(user_at(unknown, unknown), std::nullopt);
}

TEST(GatewayLocalUser, IsAnotherOneForTheSocketsOfOthers) {
  if (::getuid() != 0) GTEST_SKIP() << "only root can act as another user";
  constexpr uid_t kOther = 12345;
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    if (::setuid(kOther) != 0) ::_exit(1);
    const Line line(AF_INET);
    ::_exit(line.user() == kOther && line.user_of_tables() == kOther ? 0 : 2);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

std::vector<nlohmann::json> lines_of(const fs::path& file, int skipped = 0) {
  std::vector<nlohmann::json> lines;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (skipped-- <= 0) lines.push_back(nlohmann::json::parse(line));
  }
  return lines;
}

TEST(GatewayAudit, TellsWhoDidWhatBeforeAndAfter) {
  const TemporaryFolder folder("audit");
  const fs::path file = folder.path() / Audit::kFile;
  Audit audit;
  const Deed deed{"anna", "10.0.0.7", "PUT /run/tunables/drive.K", "{\"value\":\n1}\xff"};
  const std::uint64_t early = audit.begin(deed);  // before the folder is known
  audit.open(folder.path());
  audit.end(early, deed, 200, "");
  audit.refused({"", "10.0.0.9", "POST /run/commands", ""}, 401, "expected a token");
  const std::vector<nlohmann::json> lines = lines_of(file);
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[0]["by"], "anna");
  EXPECT_EQ(lines[0]["address"], "10.0.0.7");
  EXPECT_EQ(lines[0]["what"], "PUT /run/tunables/drive.K");
  EXPECT_EQ(lines[0]["body"], "{\"value\":\n1}\xEF\xBF\xBD");
  EXPECT_FALSE(lines[0].contains("status"));
  EXPECT_EQ(lines[1]["number"], lines[0]["number"]);
  EXPECT_EQ(lines[1]["status"], 200);
  EXPECT_EQ(lines[2]["status"], 401);
  EXPECT_EQ(lines[2]["why"], "expected a token");
  EXPECT_FALSE(lines[2].contains("by"));
  struct stat status = {};
  ASSERT_EQ(::stat(file.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
  // A flood of refusals is counted.
  for (int i = 0; i < 10'000; ++i) audit.refused({"reader", "10.0.0.9", "POST /run/commands", ""}, 403, "no");
  EXPECT_LT(lines_of(file).size(), 100u);
}

TEST(GatewayAudit, IsAppendedToAndKeepsOneOlderFile) {
  const TemporaryFolder folder("audit");
  const fs::path file = folder.path() / Audit::kFile, earlier = folder.path() / Audit::kEarlier;
  folder.write(Audit::kFile, "{\"of\":\"a run before\",\"body\":\"" + std::string(Audit::kMost - 1'000'000, 'x') + "\"}\n");
  Audit first, second;  // as --view beside a gateway of the scenario
  first.open(folder.path());
  second.open(folder.path());
  const Deed deed{"anna", "", "command", std::string(Audit::kMostOfBody + 1, 'x')};
  first.begin(deed);
  EXPECT_TRUE(content(file).starts_with("{\"of\":\"a run before\""));
  EXPECT_EQ(lines_of(file, 1).back()["body"], std::string(Audit::kMostOfBody, 'x'));
  EXPECT_EQ(lines_of(file, 1).back()["body_bytes"], Audit::kMostOfBody + 1);
  std::uint64_t last = 0;
  for (int i = 0; i < 1000; ++i) last = (i % 2 == 0 ? first : second).begin(deed);
  EXPECT_LE(fs::file_size(file), Audit::kMost);
  EXPECT_LE(fs::file_size(earlier), Audit::kMost);
  EXPECT_GT(fs::file_size(earlier), Audit::kMost - 3000);
  const auto older = lines_of(earlier, 1), newer = lines_of(file);
  EXPECT_EQ(older.back()["number"].get<std::uint64_t>() + 1, newer.front()["number"]) << "without a gap";
  EXPECT_EQ(newer.back()["number"], last);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 2);
}

TEST(GatewayAudit, ItsLogNeverWaitsForWhoeverDoesNotReadIt) {
  int pipe[2] = {};
  ASSERT_EQ(::pipe2(pipe, O_CLOEXEC), 0);
  const int before = ::dup(STDERR_FILENO);
  ::dup2(pipe[1], STDERR_FILENO);
  for (int i = 0; i < 2000; ++i) log(std::string(500, 'x'));
  std::string text(1 << 20, '\0');
  const ssize_t first = ::read(pipe[0], text.data(), text.size());
  log("later");
  const ssize_t second = ::read(pipe[0], text.data(), text.size());
  ::dup2(before, STDERR_FILENO);
  for (const int descriptor : {before, pipe[0], pipe[1]}) ::close(descriptor);
  EXPECT_GT(first, 30'000);
  EXPECT_LT(first, 1'000'000);
  EXPECT_THAT(text.substr(0, static_cast<std::size_t>(std::max<ssize_t>(second, 0))),
              ::testing::MatchesRegex("cotwin: gateway: \\([0-9]+ lines before this were left out\\) later\n"));
}

TEST(GatewayAudit, RefusesWhatCannotBeWritten) {
  const TemporaryFolder folder("audit"), other("audit");
  fs::create_symlink(other.path() / "elsewhere", folder.path() / Audit::kFile);
  Audit misled;
  EXPECT_THAT(error_of([&] { misled.open(folder.path()); }), HasSubstr("audit.jsonl: cannot be appended to"));
  EXPECT_FALSE(fs::exists(other.path() / "elsewhere"));
  // No room: as on a full disk, in the middle of a line.
  Audit audit;
  audit.open(other.path());
  const Deed deed{"anna", "", "command", ""};
  audit.begin(deed);
  const fs::path file = other.path() / Audit::kFile;
  const auto size = fs::file_size(file);
  rlimit before = {};
  ::getrlimit(RLIMIT_FSIZE, &before);
  const auto signal_before = ::signal(SIGXFSZ, SIG_IGN);
  rlimit full = before;
  full.rlim_cur = size + 10;
  ::setrlimit(RLIMIT_FSIZE, &full);
  const std::string error = error_of([&] { audit.begin(deed); });
  audit.end(1, deed, 200, "");  // tells it in the log
  ::setrlimit(RLIMIT_FSIZE, &before);
  ::signal(SIGXFSZ, signal_before);
  EXPECT_THAT(error, HasSubstr("audit.jsonl: cannot be appended to: "));
  EXPECT_EQ(fs::file_size(file), size) << "no half of a line is left";
  audit.begin(deed);
  EXPECT_EQ(lines_of(file).size(), 2u);
}

/// A server with a route for each scope.
struct Subject {
  explicit Subject(http::ServerOptions options) {
    options.limits.look = 0.02;
    const auto add = [&](const char* method, const char* pattern, Scopes scope) {
      http::Route route;
      route.method = method;
      route.pattern = pattern;
      route.scope = scope;
      router.add(route, [this](const http::Request& r) {
        ++done;
        http::Response response;
        response.body = "\"" + r.by + "\"";
        return response;
      });
    };
    add("GET", "/open", {});
    add("GET", "/read", Scope::kRead);
    add("POST", "/jobs", Scope::kJobs);
    add("PUT", "/tune", Scope::kTune);
    add("PUT", "/acknowledge", Scope::kAcknowledge);
    add("POST", "/end", Scope::kEnd);
    add("POST", "/either", Scope::kTune | Scope::kEnd);
    http::Route events;
    events.method = "GET";
    events.pattern = "/events";
    events.gives = "text/event-stream";
    events.ticket = true;
    router.add(events, [this](const http::Request&) {
      http::Response response;
      response.stream = [this](const std::shared_ptr<http::Stream>& stream) {
        stream->on_close([this] { ++closed; });
        ++opened;
        (void)stream->send({"hello", "", "{}"});
      };
      return response;
    });
    options.addresses = {"127.0.0.1"};
    options.authority.hosts.push_back("localhost");
    server.emplace(std::move(options), router);
  }
  ~Subject() { server->stop(); }
  int status(const std::string& method, const std::string& target, const std::string& fields = "") const {
    return http_call(server->port(), method, target, "", fields).status;
  }

  http::Router router;
  std::atomic<int> opened = 0, closed = 0, done = 0;
  std::optional<http::Server> server;
};

TEST(GatewayAccess, GivesEachScopeItsRoutesAndNoMore) {
  const std::vector<std::string> words = {"read", "jobs", "tune", "acknowledge", "end", "operate", "jobs,end"};
  std::string lines;
  for (std::size_t i = 0; i < words.size(); ++i) lines += words[i] + " " + std::string(16, static_cast<char>('a' + i)) + "\n";
  const SecretFile tokens(lines);
  http::ServerOptions options;
  options.token_file = tokens.path();
  const Subject subject(std::move(options));
  const std::vector<std::pair<const char*, const char*>> routes = {
      {"GET", "/read"}, {"POST", "/jobs"}, {"PUT", "/tune"}, {"PUT", "/acknowledge"}, {"POST", "/end"}, {"POST", "/either"}};
  const std::vector<std::string> permitted = {"R.....", "RJ....", "R.T..E", "R..A..", "R...DE", "RJTADE", "RJ..DE"};
  for (std::size_t t = 0; t < words.size(); ++t) {
    const std::string field = field_of(std::string(16, static_cast<char>('a' + t)));
    for (std::size_t r = 0; r < routes.size(); ++r) {
      const auto& [method, target] = routes[r];
      EXPECT_EQ(subject.status(method, target, field), permitted[t][r] == '.' ? 403 : 200) << words[t] << ' ' << target;
    }
    EXPECT_EQ(subject.status("GET", "/open", field), 200);
  }
  for (const auto& [method, target] : routes) EXPECT_EQ(subject.status(method, target), 401) << target;
  EXPECT_EQ(subject.status("GET", "/open"), 200);
  EXPECT_EQ(http_call(subject.server->port(), "PUT", "/tune", "", field_of(std::string(16, 'a'))).field("WWW-Authenticate"),
            "Bearer error=\"insufficient_scope\", scope=\"tune\"");
  EXPECT_EQ(http_call(subject.server->port(), "GET", "/read").field("WWW-Authenticate"), "Bearer");
  for (const std::string& wrong : {std::string("Authorization: Basic YTpi\r\n"), std::string("Authorization: Bearer \r\n")})
    EXPECT_EQ(subject.status("GET", "/read", wrong), 401);
  EXPECT_EQ(subject.status("GET", "/read", field_of(std::string(16, 'a')) + field_of(std::string(16, 'f'))), 400);
  EXPECT_EQ(subject.status("GET", "/events?ticket=aaaaaaaaaaaaaaaa"), 401) << "a token is not accepted in a query";
}

TEST(GatewayAccess, LetsHandshakesThatStopGiveWay) {
  const TemporaryFolder folder("handshakes");
  const Issued made = issue(curve("P-256"), EVP_sha256());
  http::ServerOptions options;
  options.certificate = folder.write("cert.pem", made.certificate);
  options.key = folder.write("key.pem", made.key);
  fs::permissions(options.key, fs::perms::owner_read);
  options.limits.address_connections = 4;
  const Subject subject(std::move(options));
  std::vector<std::unique_ptr<testing::RawClient>> stopped;
  const auto& counts = subject.server->counts();
  for (std::uint64_t i = 0; i < 4; ++i) {
    stopped.push_back(std::make_unique<testing::RawClient>(subject.server->port()));
    stopped.back()->send(std::string("\x16\x03\x01\x02\x00\x01", 6).substr(0, i + 1));
    ASSERT_TRUE(testing::within_patience([&] { return counts.open == i + 1; }));
  }
  const testing::RawClient next(subject.server->port());
  EXPECT_TRUE(stopped[0]->ended());
  EXPECT_EQ(counts.open, 4u);
  EXPECT_EQ(counts.refused, 0u);
}

TEST(GatewayAccess, TakesATicketOnceAndAsLongAsItsTokenHolds) {
  const SecretFile tokens("read " + kA + "\nread " + kB);
  http::ServerOptions options;
  options.token_file = tokens.path();
  const auto tickets = options.tickets;
  const Subject subject(std::move(options));
  const auto now = std::chrono::steady_clock::now();
  const std::string ticket = tickets->issue(digest_of(kA), "a", now);
  EXPECT_EQ(subject.status("GET", "/read?ticket=" + ticket), 401) << "only for streams";
  RawClient client(subject.server->port());
  client.send(http_request("GET", "/events?ticket=" + ticket));
  EXPECT_TRUE(client.receive_until("200 OK"));
  EXPECT_EQ(subject.status("GET", "/events?ticket=" + ticket), 401);
  const std::string unused = tickets->issue(digest_of(kA), "a", now);
  testing::rewrite_secret(tokens.path(), "read " + kB);
  ASSERT_TRUE(within_patience([&] { return subject.status("GET", "/read", field_of(kB)) == 200 && subject.closed == 1; }));
  EXPECT_TRUE(client.ended());
  EXPECT_EQ(subject.status("GET", "/events?ticket=" + unused), 401);
}

TEST(GatewayAccess, ReadsItsTokensAgainAndKeepsThemIfTheNewOnesAreDamaged) {
  const SecretFile tokens("read " + kA + " name=old");
  http::ServerOptions options;
  options.token_file = tokens.path();
  const Subject subject(std::move(options));
  const auto takes = [&](const std::string& token) { return subject.status("GET", "/read", field_of(token)) == 200; };
  RawClient sse(subject.server->port()), socket(subject.server->port()), waiting(subject.server->port());
  sse.send(http_request("GET", "/events", "", field_of(kA)));
  socket.send(
      "GET /events HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
      "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n" +
      field_of(kA) + "\r\n");
  ASSERT_TRUE(within_patience([&] { return subject.opened == 2; }));
  const auto wait = [] { std::this_thread::sleep_for(300ms); };  // many looks
  // Damaged, then open to others, then a link to such a file: what was read before holds.
  testing::rewrite_secret(tokens.path(), "read " + kB + "\nnonsense " + kA);
  wait();
  EXPECT_TRUE(takes(kA));
  testing::rewrite_secret(tokens.path(), "read " + kB);
  fs::permissions(tokens.path(), fs::perms(0644));
  wait();
  EXPECT_TRUE(takes(kA));
  const testing::TemporaryFile open("read " + kB);
  fs::remove(tokens.path());
  fs::create_symlink(open.path(), tokens.path());
  wait();
  EXPECT_TRUE(takes(kA));
  EXPECT_EQ(subject.closed, 0);
  // Whole again: the new one is taken, the old one and its streams end.
  const SecretFile good("tune " + kB + " name=new");
  fs::remove(tokens.path());
  fs::create_symlink(good.path(), tokens.path());
  EXPECT_TRUE(within_patience([&] { return !takes(kA); }));
  EXPECT_TRUE(takes(kB));
  EXPECT_TRUE(within_patience([&] { return subject.closed == 2; }));
  EXPECT_EQ(http_call(subject.server->port(), "PUT", "/tune", "", field_of(kB)).body, "\"new\"");
  // Without a line nobody may ask, and that does not open the gateway.
  testing::rewrite_secret(good.path(), "# all taken back\n");
  EXPECT_TRUE(within_patience([&] { return !takes(kB); }));
  EXPECT_EQ(subject.status("GET", "/read"), 401);
  EXPECT_EQ(subject.status("PUT", "/tune"), 401);
}

TEST(GatewayAccess, EndsStreamsOfATokenThatIsOver) {
  const std::string end = to_text(utc_now() + 1s);
  const SecretFile tokens("read " + kA + " until=" + end + "\nread " + kB);
  http::ServerOptions options;
  options.token_file = tokens.path();
  const Subject subject(std::move(options));
  RawClient brief(subject.server->port()), lasting(subject.server->port());
  lasting.send(http_request("GET", "/events", "", field_of(kB)));
  brief.send(http_request("GET", "/events", "", field_of(kA)));
  EXPECT_TRUE(within_patience([&] { return subject.status("GET", "/read", field_of(kA)) == 401; }));
  EXPECT_TRUE(brief.ended());
  EXPECT_TRUE(within_patience([&] { return subject.opened - subject.closed == 1; }));
}

TEST(GatewayAccess, AnswersWrongTokensLateWithoutHoldingAThread) {
  const SecretFile tokens("read " + kA);
  http::ServerOptions options;
  options.token_file = tokens.path();
  options.threads = 1;
  const Subject subject(std::move(options));
  for (int i = 0; i < 4; ++i) EXPECT_EQ(subject.status("GET", "/read", field_of(kB)), 401);
  const auto start = std::chrono::steady_clock::now();
  std::vector<std::unique_ptr<RawClient>> wrong;
  for (int i = 0; i < 50; ++i) {
    wrong.push_back(std::make_unique<RawClient>(subject.server->port()));
    wrong.back()->send(http_request("GET", "/read", "", field_of(kB)));
  }
  EXPECT_EQ(subject.status("GET", "/read", field_of(kA)), 200) << "the others wait, not this one";
  for (const auto& client : wrong) EXPECT_EQ(client->reply().status, 401);
  EXPECT_GE(std::chrono::steady_clock::now() - start, 1s);
}

TEST(GatewayAccess, WritesWhoAskedAndDoesNothingThatCannotBeWritten) {
  const TemporaryFolder folder("audit");
  const SecretFile tokens("tune " + kA + " name=anna\nread " + kB + " name=bert");
  http::ServerOptions options;
  options.token_file = tokens.path();
  options.audit = std::make_shared<Audit>();
  options.audit->open(folder.path());
  const Subject subject(std::move(options));
  EXPECT_EQ(subject.status("PUT", "/tune", field_of(kA)), 200);
  EXPECT_EQ(subject.status("PUT", "/tune", field_of(kB)), 403);
  EXPECT_EQ(subject.status("PUT", "/tune", field_of(kC)), 401);
  EXPECT_EQ(subject.status("PUT", "/tune"), 401);
  EXPECT_EQ(subject.status("GET", "/read", field_of(kB)), 200);
  const fs::path file = folder.path() / Audit::kFile;
  std::string told;
  for (const nlohmann::json& line : lines_of(file))
    told += line.value("by", "-") + " " + std::to_string(line.value("status", 0)) + "; ";
  EXPECT_EQ(told, "anna 0; anna 200; bert 403; - 401; - 401; ");
  for (const std::string& token : {kA, kB, kC}) EXPECT_THAT(content(file), Not(HasSubstr(token)));
  // The name of the file is a folder's now: no line can be written.
  fs::remove(file);
  fs::create_directory(file);
  const int done = subject.done;
  const HttpReply refused = http_call(subject.server->port(), "PUT", "/tune", "", field_of(kA));
  EXPECT_EQ(refused.status, 503);
  EXPECT_THAT(refused.body, HasSubstr("it cannot be written who does it"));
  EXPECT_EQ(subject.done, done);
  EXPECT_EQ(subject.status("GET", "/read", field_of(kB)), 200) << "reading goes on";
}

}  // namespace
}  // namespace cotwin::gateway::access::access_test
