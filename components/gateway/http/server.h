#pragma once
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "components/gateway/access/access.h"
#include "components/gateway/access/audit.h"
#include "components/gateway/http/router.h"
#include "components/gateway/http/stream.h"

namespace cotwin::gateway::http {

/// Bounds on what clients can take from the server: memory is at most about connections · (header + body + queue). At the bounds of
/// connections idle ones give way, and the last eighth, at most 8, is for clients that have none in use.
struct Limits {
  std::size_t connections = 256;
  std::size_t address_connections = 128;  // of one address, or one IPv6 network of 64 bits
  std::size_t header_bytes = 16 << 10;
  std::size_t body_bytes = 1 << 20;
  std::size_t message_bytes = 64 << 10;  // of a WebSocket's message from the client
  std::size_t queue_bytes = 256 << 10;   // that wait for a client of a stream
  std::size_t stream_bytes = 1 << 20;    // that a client of a stream may send in 10 s; what it sends is not read
  std::size_t queue_requests = 256;      // that wait for a thread of the pool
  std::size_t owner_requests = 128;      // of them, of one owner (Request::owner)
  double handshake = 10;                 // s, TLS
  double request = 10;                   // s, from the first byte of a request to its last
  double answer = 60;                    // s, until a handler has answered
  double idle = 60;                      // s, until the first byte
  double response = 30;                  // s, to write a response or what waits in a stream
  double look = 0.4;                     // s, between looks at files of tokens and certificates, and for tokens that are over
  double heartbeat = 15;                 // s, between events "heartbeat" of a stream without others
};

struct ServerOptions {
  std::vector<std::string> addresses;      // IPv4 or IPv6; the first one that cannot be used is an error
  std::vector<std::string> if_there;       // the same, but left out where this machine does not have them
  std::uint16_t port = 0;                  // 0: a free one, the same for all addresses
  std::filesystem::path certificate, key;  // PEM, with the chain; both or neither. Neither: no TLS
  std::filesystem::path token_file;        // empty: no tokens; then see local_writes
  std::shared_ptr<access::Audit> audit;    // of what changes something; nullptr: none
  std::shared_ptr<access::Tickets> tickets = std::make_shared<access::Tickets>();
  /// Whether all users of this machine may change something without a token, not only the one who runs this, and root.
  bool local_writes = false;
  access::Authority authority;  // the addresses are added to its hosts, for 0.0.0.0 and :: the loopback address
  Limits limits;
  int threads = 2;                // of the pool for slow routes; up to 14 more while requests take long (FairPool)
  std::string place = "gateway";  // in messages
};

/// HTTP/1.1 server with server-sent events and WebSockets, on one thread of its own and a pool for slow routes. Its callers never wait for
/// clients.
class Server {
 public:
  /// Opens the sockets and starts the threads. `router` outlives the server. Throws Error: an address that cannot be used, a certificate
  /// or tokens that cannot be used (access::load_certificate, access::Tokens); an address other than loopback without TLS and tokens.
  /// Changed files of tokens, certificate and key are read again; one that cannot be used is told in the log, and the old one holds.
  Server(ServerOptions options, const Router& router);
  /// stop()
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  std::uint16_t port() const;
  /// "http://127.0.0.1:8080" for the first address; in place of 0.0.0.0 and :: the last of the given hosts, which a certificate may name.
  std::string url() const;
  /// Closes all connections and waits for handlers that run. No handler and no stream function is called afterwards.
  void stop() noexcept;

  struct Counts {
    std::atomic<std::uint64_t> connections = 0;  // accepted
    std::atomic<std::uint64_t> open = 0;         // at present
    std::atomic<std::uint64_t> requests = 0;     // answered, with every status
    std::atomic<std::uint64_t> refused = 0;      // of them with status 400 and above, and connections beyond the limit
    std::atomic<std::uint64_t> streams = 0;      // open at present
    std::atomic<std::uint64_t> dropped = 0;      // streams closed because their client was too slow
  };
  const Counts& counts() const;

  struct Impl;

 private:
  std::unique_ptr<Impl> impl_;
};

/// Whether an address reaches this machine only: 127.0.0.0/8 or ::1. Throws Error if it is no IPv4 or IPv6 address.
bool is_loopback(const std::string& address, const std::string& place);

}  // namespace cotwin::gateway::http
