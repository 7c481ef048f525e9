#include "components/gateway/http/server.h"

#include <openssl/ssl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/ip/v6_only.hpp>
#include <nlohmann/json.hpp>

#include "components/gateway/access/certificate.h"
#include "components/gateway/access/local_user.h"
#include "components/gateway/http/audited.h"
#include "components/gateway/http/connection.h"
#include "components/gateway/http/server_impl.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::http {

namespace {

constexpr int kBacklog = 128;
constexpr std::size_t kMostRefusing = 256;  // connections that are told at the same time that there are too many
constexpr std::size_t kKeptPlaces = 8;  // for clients that have no connection in use, where that is an eighth of all or less
constexpr std::chrono::milliseconds kPause{100};  // after an accept that failed, as for want of descriptors

asio::ip::address address_of(const std::string& text, const std::string& place) {
  ErrorCode error;
  const asio::ip::address address = asio::ip::make_address(text, error);
  if (error) throw Error(place, "'" + text + "' is no IPv4 or IPv6 address, expected one such as 127.0.0.1 or ::1");
  return address;
}

/// The address by which this machine reaches a server that listens there: the loopback address for 0.0.0.0 and ::.
asio::ip::address reachable(const asio::ip::address& address) {
  if (!address.is_unspecified()) return address;
  return address.is_v6() ? asio::ip::address(asio::ip::address_v6::loopback())
                         : asio::ip::address(asio::ip::address_v4::loopback());
}

std::string text_of(const asio::ip::address& address) {
  return address.is_v6() ? "[" + address.to_string() + "]" : address.to_string();
}

/// Of an IPv6 address its network of 64 bits: a client may have all addresses of one.
std::string client_address(const asio::ip::address& address) {
  if (!address.is_v6() || address.is_loopback()) return address.to_string();
  asio::ip::address_v6::bytes_type bytes = address.to_v6().to_bytes();
  std::fill(bytes.begin() + 8, bytes.end(), 0);
  return asio::ip::address_v6(bytes).to_string() + "/64";
}

FairPool::Options pool_options(const ServerOptions& o) {
  FairPool::Options pool;
  pool.threads = static_cast<std::size_t>(std::max(1, o.threads));
  pool.many = pool.threads + 6;
  pool.most = pool.threads + 14;
  pool.waiting = o.limits.queue_requests;
  pool.owner_waiting = o.limits.owner_requests;
  return pool;
}

}  // namespace

bool is_loopback(const std::string& address, const std::string& place) { return address_of(address, place).is_loopback(); }

Server::Impl::Impl(ServerOptions given, const Router& table)
    : options(std::move(given)),
      router(table),
      token_file_(options.token_file),
      certificate_(options.certificate),
      key_(options.key),
      pool_(pool_options(options)) {
  if (options.certificate.empty() != options.key.empty())
    throw Error(options.place, "certificate and key must be given together, expected both or neither");
  if (!options.authority.hosts.empty()) name = options.authority.hosts.back();
  for (const auto* addresses : {&options.addresses, &options.if_there}) {
    for (const std::string& text : *addresses) {
      const asio::ip::address address = address_of(text, options.place);
      options.authority.hosts.push_back(text_of(reachable(address)));
      if (address.is_loopback() || (!options.certificate.empty() && !options.token_file.empty())) continue;
      throw Error(options.place,
                  "address " + text +
                      " can be reached from other machines, expected a certificate, a key and a file of tokens " +
                      "for it (or 127.0.0.1, which needs none)");
    }
  }
  if (!options.token_file.empty()) {
    tokens = access::Tokens::load(options.token_file);
    if (tokens.empty()) throw Error(options.token_file.string(), "has no token, expected lines such as: operate TOKEN");
  }
  if (!options.certificate.empty()) load_certificate();
}

void Server::Impl::load_certificate() {
  const access::Certified certified = access::load_certificate(options.certificate, options.key, clock.now());
  asio::ssl::context made(asio::ssl::context::tls_server);
  SSL_CTX* const ssl = made.native_handle();
  // RFC 9325: TLS 1.2 with forward secrecy and authenticated encryption, or 1.3.
  SSL_CTX_set_min_proto_version(ssl, TLS1_2_VERSION);
  SSL_CTX_set_cipher_list(ssl, "ECDHE+AESGCM:ECDHE+CHACHA20");
  SSL_CTX_set_options(ssl, SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION | SSL_OP_CIPHER_SERVER_PREFERENCE);
  ErrorCode error;
  made.use_certificate_chain(asio::buffer(certified.chain), error);
  if (error) throw Error(options.certificate.string(), "cannot be used as a certificate (PEM): " + error.message());
  made.use_private_key(asio::buffer(certified.key.text), asio::ssl::context::pem, error);
  if (error)
    throw Error(options.key.string(),
                "cannot be used as the key of " + options.certificate.string() + " (PEM): " + error.message());
  tls = std::move(made);
}

std::chrono::seconds Server::Impl::note_wrong_token(const std::string& address) {
  constexpr std::chrono::seconds kLate{1};
  const access::Offences::Verdict verdict = wrong_tokens_.note(address, std::chrono::steady_clock::now());
  if (verdict.told) {
    access::log("wrong token or ticket from " + address +
                (verdict.since_told > 0 ? ", and " + std::to_string(verdict.since_told) + " before" : ""));
  }
  return verdict.late ? kLate : std::chrono::seconds(0);
}

LocalUser Server::Impl::find_local_user(const tcp::socket& socket) const {
  const Scopes without = options.local_writes ? Scopes::all() : Scopes(Scope::kRead);
  ErrorCode error;
  const tcp::endpoint peer = socket.remote_endpoint(error), own = error ? peer : socket.local_endpoint(error);
  if (error) return {"unknown local user", without};
  const std::optional<std::uint32_t> user = access::user_at(*peer.data(), *own.data());
  if (!user) return {"unknown local user", without};
  return {"local user " + std::to_string(*user), *user == ::getuid() || *user == 0 ? Scopes::all() : without};
}

std::array<std::int64_t, 7> Server::Impl::Watched::mark() const {
  struct stat s = {};
  if (file_.empty() || ::stat(file_.c_str(), &s) != 0) return {};
  return {static_cast<std::int64_t>(s.st_dev),
          static_cast<std::int64_t>(s.st_ino),
          s.st_size,
          s.st_mtim.tv_sec,
          s.st_mtim.tv_nsec,
          s.st_ctim.tv_sec,
          s.st_ctim.tv_nsec};
}

bool Server::Impl::Watched::changed() {
  const auto now = mark();
  const bool rests = std::exchange(seen_, now) == now;
  return rests && std::exchange(read_, now) != now;
}

/// What is wrong with a new file is told once, and the old content holds.
void Server::Impl::look_at_files() {
  const auto read_again = [](const auto& read) {
    try {
      access::log("read again: " + read());
    } catch (const Error& error) {
      access::log(std::string("the old content holds: ") + error.what());
    }
  };
  if (token_file_.changed()) {
    read_again([&] {
      tokens = access::Tokens::load(options.token_file);
      return options.token_file.string() + ", " + text::counted(static_cast<std::int64_t>(tokens.size()), "token");
    });
  }
  if (const bool other = certificate_.changed(); key_.changed() || other) {
    read_again([&] {
      load_certificate();
      return options.certificate.string();
    });
  }
}

/// Closes what is done for tokens that are not valid any more.
void Server::Impl::end_bearers() {
  std::vector<std::shared_ptr<Client>> gone;
  for (const auto& [key, client] : clients) {
    if (client->bearer && find_bearer(*client->bearer) == nullptr) gone.push_back(client);
  }
  for (const auto& client : gone) client->abort();
}

void Server::Impl::look() {
  next_look_.expires_after(std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * options.limits.look)));
  next_look_.async_wait([this](const ErrorCode& stopped) {
    if (!stopped) look();
  });
  look_at_files();
  end_bearers();
}

bool Server::Impl::listen(const std::string& text, bool must) {
  const asio::ip::address address = address_of(text, options.place);
  auto listener = std::make_unique<Listener>(context);
  tcp::acceptor& acceptor = listener->acceptor;
  const tcp::endpoint endpoint(address, port);
  ErrorCode error;
  const auto failed = [&](const char* what) {
    if (!error) return false;
    if (!must) return true;
    throw Error(options.place, "cannot listen at " + text_of(address) + ":" + std::to_string(endpoint.port()) + ": " + what +
                                   ": " + error.message());
  };
  acceptor.open(endpoint.protocol(), error);
  if (failed("socket")) return false;
  acceptor.set_option(tcp::acceptor::reuse_address(true), error);
  if (address.is_v6()) acceptor.set_option(asio::ip::v6_only(true), error);
  acceptor.bind(endpoint, error);
  if (failed("bind")) return false;
  acceptor.listen(kBacklog, error);
  if (failed("listen")) return false;
  if (port == 0) port = acceptor.local_endpoint().port();
  listeners_.push_back(std::move(listener));
  return true;
}

void Server::Impl::open() {
  port = options.port;
  for (const std::string& address : options.addresses) listen(address, true);
  for (const std::string& address : options.if_there) listen(address, false);
  if (listeners_.empty()) throw Error(options.place, "no address to listen at");
}

void Server::Impl::start() {
  for (const auto& listener : listeners_) accept(*listener);
  if (!options.token_file.empty() || !options.certificate.empty()) look();
  thread_ = std::thread([this] {
    const auto work = asio::make_work_guard(context);
    for (;;) {
      try {
        context.run();
        return;
      } catch (const std::exception&) {
        // Want of memory in one connection: the others go on, and its deadline ends it.
      }
    }
  });
}

void Server::Impl::accept(Listener& listener) {
  listener.acceptor.async_accept(context, [this, &listener](const ErrorCode& error, tcp::socket socket) {
    if (error == asio::error::operation_aborted) return;
    if (error) {
      listener.pause.expires_after(kPause);
      listener.pause.async_wait([this, &listener](const ErrorCode& stopped) {
        if (!stopped) accept(listener);
      });
      return;
    }
    admit(std::move(socket));
    accept(listener);
  });
}

/// A token's requests say so themselves.
const std::string& Server::Impl::holder_of(Client& client) const {
  if (!client.holder.empty()) return client.holder;
  ErrorCode gone;
  const bool local = client.socket().remote_endpoint(gone).address().is_loopback();
  client.holder = !gone && local ? find_local_user(client.socket()).name : "address " + client.address;
  return client.holder;
}

std::size_t Server::Impl::places(const std::string& address, bool idle_ones) const {
  return static_cast<std::size_t>(std::ranges::count_if(clients, [&](const auto& entry) {
    const Client& c = *entry.first;
    return !c.address.empty() && (address.empty() || c.address == address) && (idle_ones || !c.idle());
  }));
}

/// Closes the connection that is idle for longest, of whoever has most of those that have idle ones. False: there is none.
bool Server::Impl::make_room(const std::string& address) {
  struct Holder {
    std::size_t places = 0;
    Client* oldest = nullptr;
  };
  std::map<std::string, Holder> holders;
  for (const auto& [client, owned] : clients) {
    if (client->address.empty() || (!address.empty() && client->address != address)) continue;
    Holder& holder = holders[holder_of(*client)];
    ++holder.places;
    if (client->idle() && (holder.oldest == nullptr || client->idle_since < holder.oldest->idle_since)) holder.oldest = client;
  }
  const Holder* most = nullptr;
  for (const auto& [name, holder] : holders) {
    if (holder.oldest != nullptr && (most == nullptr || holder.places > most->places)) most = &holder;
  }
  if (most != nullptr) most->oldest->abort();
  return most != nullptr;
}

std::optional<Problem> Server::Impl::deny_place(Client& client) {
  const auto is_full = [&](std::size_t most, const std::string& address) {
    const std::size_t kept = std::min(kKeptPlaces, most / 8);
    return clients.size() > most - kept && places(address, false) >= most - kept;
  };
  if (!is_full(options.limits.connections, "") && !is_full(options.limits.address_connections, client.address))
    return std::nullopt;
  const bool has_others = std::ranges::any_of(clients, [&](const auto& entry) {
    Client& c = *entry.first;
    return &c != &client && !c.address.empty() && !c.idle() && holder_of(c) == holder_of(client);
  });
  if (!has_others) return std::nullopt;
  return Problem{429, "too many connections of this client are in use, expected fewer: the last places are kept for others", "",
                 ""};
}

void Server::Impl::admit(tcp::socket socket) {
  const std::uint64_t number = ++counts.connections;
  ErrorCode none;
  const tcp::endpoint from = socket.remote_endpoint(none);
  if (none) return;  // it has gone again
  socket.set_option(tcp::no_delay(true), none);
  const std::string address = client_address(from.address());
  std::optional<Problem> problem;
  if (places(address, true) >= options.limits.address_connections && !make_room(address)) {
    problem = Problem{
        429, "too many connections of this address, expected at most " + std::to_string(options.limits.address_connections), "",
        ""};
  } else if (places("", true) >= options.limits.connections && !make_room("")) {
    problem = Problem{503, "too many connections", "", ""};
  }
  if (!problem) {
    // At the loopback address all programs of this machine have the same one.
    std::string owner = from.address().is_loopback() ? kLocalOwner + std::to_string(number) : "address " + address;
    return serve(*this, std::move(socket), address, std::move(owner));
  }
  // Without TLS the client could not read it, and a handshake costs more than the refusal saves.
  if (tls || refusing >= kMostRefusing) {
    ++counts.refused;
    return;
  }
  refuse_connection(*this, std::move(socket), to_response(*problem, {{"Retry-After", "1"}}));
}

void Server::Impl::handle(const Router::Entry& entry, std::shared_ptr<Request> request, Reply reply,
                          std::function<bool()> given_up) {
  const auto run = [&entry, request, reply] {
    Reply answer = reply;
    try {
      if (entry.route.changes()) answer = audited(*request, reply);
      entry.handler(*request, answer);
    } catch (const Refusal& refusal) {
      answer(to_response(refusal.problem, refusal.fields));
    } catch (const Error& error) {
      answer(to_response({422, error.what(), "", ""}));
    } catch (const std::bad_alloc&) {
      answer(to_response({503, "not enough memory", "", ""}, {{"Retry-After", "1"}}));
    } catch (...) {
      answer(to_response({500, "the request could not be answered", "", ""}));
    }
  };
  if (!entry.route.slow) return run();
  const auto verdict = pool_.post(request->owner, [run, given_up = std::move(given_up)] {
    if (!given_up()) run();
  });
  if (verdict == FairPool::Verdict::kTaken) return;
  const Problem full = verdict == FairPool::Verdict::kOwnerFull
                           ? Problem{429,
                                     "too many requests of this client wait for an answer, expected at most " +
                                         std::to_string(options.limits.owner_requests),
                                     "", ""}
                           : Problem{503, "too many requests wait for an answer", "", ""};
  const Response refused = to_response(full, {{"Retry-After", "1"}});
  if (entry.route.changes()) audit_refusal(*request, refused);
  reply(refused);
}

void Server::Impl::stop() noexcept {
  if (stopped_) return;
  stopped_ = true;
  pool_.stop();  // before the connections are closed: what is being done is answered, such as the order to stop a run
  if (thread_.joinable()) {
    loop->post([this] {
      ErrorCode none;
      for (const auto& listener : listeners_) {
        listener->acceptor.close(none);
        listener->pause.cancel();
      }
      next_look_.cancel();
      while (!clients.empty()) clients.begin()->second->abort();
      context.stop();
    });
    loop->close();
    thread_.join();
  }
  loop->close();
}

Server::Server(ServerOptions options, const Router& router) : impl_(std::make_unique<Impl>(std::move(options), router)) {
  impl_->open();
  impl_->start();
}

Server::~Server() { stop(); }

std::uint16_t Server::port() const { return impl_->port; }

std::string Server::url() const {
  const ServerOptions& o = impl_->options;
  const asio::ip::address first = address_of(o.addresses.empty() ? o.if_there.front() : o.addresses.front(), o.place);
  return std::string(impl_->tls ? "https" : "http") + "://" + (first.is_unspecified() ? impl_->name : text_of(first)) + ":" +
         std::to_string(impl_->port);
}

void Server::stop() noexcept { impl_->stop(); }

const Server::Counts& Server::counts() const { return impl_->counts; }

}  // namespace cotwin::gateway::http
