#pragma once
#include <filesystem>
#include <string>

#include "components/gateway/access/access.h"
#include "components/gateway/access/utc.h"

namespace cotwin::gateway::access {

/// A certificate with its chain, and its key: PEM.
struct Certified {
  std::string chain;
  Cleansed key;
};

/// Reads both. Throws Error with the file and the reason if one cannot be read, if the key is not secret, is encrypted or is not that of
/// the certificate, and for a certificate that has expired, is not valid yet, is signed with SHA-1 or weaker, or has a key below RSA 2048
/// or P-256 (RFC 9325, 4.5); the same holds for the others of the chain, but not for the signature of a root.
Certified load_certificate(const std::filesystem::path& certificate, const std::filesystem::path& key, UtcTime now);

}  // namespace cotwin::gateway::access
