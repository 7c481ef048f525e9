#include "models/foundation/net/tcp_socket.h"

#ifndef _WIN32
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#endif

#include <cerrno>
#include <cstring>
#include <utility>

#ifndef _WIN32
#include "models/foundation/net/posix_socket.h"
#endif
#include "models/foundation/support/error.h"

namespace cotwin::net {

TcpStream::~TcpStream() { close(); }

TcpStream::TcpStream(TcpStream&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)),
      state_(std::exchange(other.state_, State::kClosed)),
      peer_(other.peer_) {}

TcpStream& TcpStream::operator=(TcpStream&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(state_, other.state_);
  std::swap(peer_, other.peer_);
  return *this;
}

TcpListener::TcpListener(TcpListener&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), local_(other.local_) {}

TcpListener& TcpListener::operator=(TcpListener&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(local_, other.local_);
  return *this;
}

#ifdef _WIN32

TcpStream TcpStream::connect(const Endpoint&) { return {}; }
TcpStream::State TcpStream::state() { return state_; }
std::size_t TcpStream::receive(std::span<std::uint8_t>) { return 0; }
std::size_t TcpStream::send(std::span<const std::uint8_t>) { return 0; }
void TcpStream::close() { state_ = State::kClosed; }
TcpListener::TcpListener(const Endpoint& local, const std::string& place) {
  throw Error(place, "TCP socket at " + to_text(local) + ": not supported on Windows, expected a POSIX system");
}
TcpListener::~TcpListener() = default;
std::optional<TcpStream> TcpListener::accept() { return std::nullopt; }

#else

using posix::address_of;
using posix::endpoint_of;

namespace {

bool set_options(int descriptor) {
  const int on = 1;
  ::setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
#ifdef SO_NOSIGPIPE
  ::setsockopt(descriptor, SOL_SOCKET, SO_NOSIGPIPE, &on, sizeof on);
#endif
  return ::fcntl(descriptor, F_SETFL, O_NONBLOCK) == 0 && ::fcntl(descriptor, F_SETFD, FD_CLOEXEC) == 0;
}

#ifdef MSG_NOSIGNAL
constexpr int kSendFlags = MSG_NOSIGNAL;
#else
constexpr int kSendFlags = 0;
#endif

bool would_block() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

}  // namespace

TcpStream TcpStream::connect(const Endpoint& to) {
  TcpStream stream;
  stream.peer_ = to;
  stream.descriptor_ = ::socket(AF_INET, SOCK_STREAM, 0);
  if (stream.descriptor_ < 0) return stream;
  stream.state_ = State::kConnecting;
  const sockaddr_in address = address_of(to);
  if (!set_options(stream.descriptor_)) {
    stream.close();
  } else if (::connect(stream.descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
    stream.state_ = State::kOpen;
  } else if (errno != EINPROGRESS && errno != EINTR) {
    stream.close();
  }
  return stream;
}

TcpStream::State TcpStream::state() {
  if (state_ != State::kConnecting) return state_;
  pollfd file{descriptor_, POLLOUT, 0};
  if (::poll(&file, 1, 0) <= 0) return state_;
  int error = 0;
  socklen_t size = sizeof error;
  if (::getsockopt(descriptor_, SOL_SOCKET, SO_ERROR, &error, &size) == 0 && error == 0) {
    state_ = State::kOpen;
  } else {
    close();
  }
  return state_;
}

std::size_t TcpStream::receive(std::span<std::uint8_t> buffer) {
  if (state_ != State::kOpen || buffer.empty()) return 0;
  const ssize_t size = ::recv(descriptor_, buffer.data(), buffer.size(), 0);
  if (size > 0) return static_cast<std::size_t>(size);
  if (size == 0 || !would_block()) close();
  return 0;
}

std::size_t TcpStream::send(std::span<const std::uint8_t> bytes) {
  if (state_ != State::kOpen || bytes.empty()) return 0;
  const ssize_t size = ::send(descriptor_, bytes.data(), bytes.size(), kSendFlags);
  if (size >= 0) return static_cast<std::size_t>(size);
  if (!would_block()) close();
  return 0;
}

void TcpStream::close() {
  if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
  state_ = State::kClosed;
}

TcpListener::TcpListener(const Endpoint& local, const std::string& place) {
  const auto fail = [&](const char* call) {
    const std::string reason = std::strerror(errno);
    if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
    throw Error(place, std::string("TCP socket at ") + to_text(local) + ": " + call + ": " + reason +
                           ", expected an address of this machine and a free port");
  };
  descriptor_ = ::socket(AF_INET, SOCK_STREAM, 0);
  if (descriptor_ < 0) fail("socket");
  const int on = 1;
  ::setsockopt(descriptor_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);  // a controller that starts again has its port
  if (!set_options(descriptor_)) fail("fcntl");
  sockaddr_in address = address_of(local);
  if (::bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) < 0) fail("bind");
  if (::listen(descriptor_, 8) < 0) fail("listen");
  socklen_t size = sizeof address;
  if (::getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &size) < 0) fail("getsockname");
  local_ = endpoint_of(address);
}

TcpListener::~TcpListener() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::optional<TcpStream> TcpListener::accept() {
  sockaddr_in from{};
  socklen_t size = sizeof from;
  const int descriptor = ::accept(descriptor_, reinterpret_cast<sockaddr*>(&from), &size);
  if (descriptor < 0) return std::nullopt;
  TcpStream stream;
  stream.descriptor_ = descriptor;
  stream.state_ = TcpStream::State::kOpen;
  stream.peer_ = endpoint_of(from);
  if (!set_options(descriptor)) return std::nullopt;
  return stream;
}

#endif

}  // namespace cotwin::net
