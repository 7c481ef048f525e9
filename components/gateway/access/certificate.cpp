#include "components/gateway/access/certificate.h"

#include <openssl/err.h>
#include <openssl/objects.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <memory>
#include <optional>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"

namespace cotwin::gateway::access {

namespace {

constexpr std::uint64_t kMostOfChain = 1 << 20;  // bytes
constexpr int kLeastRsa = 2048, kLeastStrength = 128;
constexpr int kLeastSignature = 80;  // bits of security; SHA-1 has 63 and SHA-224 112

struct Free {
  void operator()(BIO* bio) const { BIO_free(bio); }
  void operator()(X509* certificate) const { X509_free(certificate); }
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
};
template <class T>
using Owned = std::unique_ptr<T, Free>;

Owned<BIO> reader_of(const std::string& text) {
  return Owned<BIO>(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
}

/// In place of a question for the password at the terminal.
int no_password(char*, int, int, void*) { return -1; }

std::string time_text(const ASN1_TIME* time) {
  std::tm tm{};
  if (ASN1_TIME_to_tm(time, &tm) != 1) return "an unknown time";
  return to_text(UtcTime(std::chrono::seconds(timegm(&tm))));
}

void check(X509* x, const std::string& what, std::time_t now, const std::string& place) {
  const auto refuse = [&](const std::string& fact, const char* expectation) {
    throw Error(place, what + " " + fact + ", expected one " + expectation);
  };
  if (X509_cmp_time(X509_get0_notBefore(x), &now) > 0)
    refuse("is not valid before " + time_text(X509_get0_notBefore(x)), "that is valid now");
  if (X509_cmp_time(X509_get0_notAfter(x), &now) < 0)
    refuse("expired at " + time_text(X509_get0_notAfter(x)), "that is valid now");
  int hash = NID_undef, strength = 0;
  const bool is_root = X509_check_issued(x, x) == X509_V_OK;
  if (X509_get_signature_info(x, &hash, nullptr, &strength, nullptr) != 1)
    refuse("has a signature of an unknown kind", "that is signed with SHA-256");
  if (strength < kLeastSignature && !(is_root && what != "the certificate"))
    refuse("is signed with " + std::string(OBJ_nid2sn(hash)), "that is signed with SHA-256 or a stronger hash");
  EVP_PKEY* const key = X509_get0_pubkey(x);
  const bool is_rsa = key != nullptr && (EVP_PKEY_is_a(key, "RSA") == 1 || EVP_PKEY_is_a(key, "RSA-PSS") == 1);
  const bool is_curve = key != nullptr && (EVP_PKEY_is_a(key, "EC") == 1 || EVP_PKEY_is_a(key, "ED25519") == 1 ||
                                           EVP_PKEY_is_a(key, "ED448") == 1);
  if (!is_rsa && !is_curve) refuse("has a key that is neither RSA nor of an elliptic curve", "with RSA, ECDSA or Ed25519");
  if (is_rsa && EVP_PKEY_get_bits(key) < kLeastRsa)
    refuse("has an RSA key of " + std::to_string(EVP_PKEY_get_bits(key)) + " bits", "with 2048 bits or more");
  if (is_curve && EVP_PKEY_get_security_bits(key) < kLeastStrength)
    refuse("has a key of an elliptic curve of " + std::to_string(EVP_PKEY_get_bits(key)) + " bits",
           "with P-256 or a stronger curve");
}

}  // namespace

Certified load_certificate(const std::filesystem::path& certificate, const std::filesystem::path& key, UtcTime now) {
  Certified all{text::read_file(certificate, "a certificate (PEM)", kMostOfChain), {read_secret(key, "a key (PEM)")}};
  const auto seconds = static_cast<std::time_t>(std::chrono::floor<std::chrono::seconds>(now.time_since_epoch()).count());
  const Owned<BIO> chain = reader_of(all.chain);
  Owned<X509> first;
  for (int number = 0;; ++number) {
    Owned<X509> next(PEM_read_bio_X509(chain.get(), nullptr, no_password, nullptr));
    if (!next) break;
    check(next.get(), number == 0 ? "the certificate" : "number " + std::to_string(number + 1) + " of its chain", seconds,
          certificate.string());
    if (number == 0) first = std::move(next);
  }
  const bool ended = ERR_GET_REASON(ERR_peek_last_error()) == PEM_R_NO_START_LINE;
  ERR_clear_error();
  if (!first || !ended)
    throw Error(certificate.string(), "cannot be used as a certificate, expected PEM: -----BEGIN CERTIFICATE----- and so on");
  const Owned<BIO> secret = reader_of(all.key.text);
  const Owned<EVP_PKEY> own(PEM_read_bio_PrivateKey(secret.get(), nullptr, no_password, nullptr));
  ERR_clear_error();
  if (!own)
    throw Error(key.string(), "cannot be used as the key of " + certificate.string() +
                                  ", expected PEM without a password: -----BEGIN PRIVATE KEY----- and so on");
  if (X509_check_private_key(first.get(), own.get()) != 1) {
    ERR_clear_error();
    throw Error(key.string(), "is not the key of " + certificate.string() + ", expected the one that it was made for");
  }
  return all;
}

}  // namespace cotwin::gateway::access
