#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "models/foundation/net/endpoint.h"

namespace cotwin::net {

/// A TCP connection (IPv4) that never blocks and allocates nothing. Small packages are sent at once (TCP_NODELAY). Only POSIX systems
/// have it; elsewhere no connection comes about.
class TcpStream {
 public:
  enum class State : std::uint8_t { kConnecting, kOpen, kClosed };

  TcpStream() = default;
  ~TcpStream();
  TcpStream(TcpStream&& other) noexcept;
  TcpStream& operator=(TcpStream&& other) noexcept;

  /// Begins to connect; kClosed if the system refuses at once.
  static TcpStream connect(const Endpoint& to);

  /// The present state; asks the system whether a connection has come about.
  State state();
  /// For ppoll; −1 when closed.
  int descriptor() const { return descriptor_; }
  const Endpoint& peer() const { return peer_; }

  /// Bytes that have arrived; 0: none at present. Closes the stream when the other side has, or on an error.
  std::size_t receive(std::span<std::uint8_t> buffer);
  /// How many bytes the system took; 0: none at present. Closes the stream on an error.
  std::size_t send(std::span<const std::uint8_t> bytes);
  void close();

 private:
  friend class TcpListener;
  int descriptor_ = -1;
  State state_ = State::kClosed;
  Endpoint peer_;
};

/// A TCP socket that accepts connections without blocking.
class TcpListener {
 public:
  /// Listens at `local`; port 0: the system chooses one. Throws Error at `place`.
  TcpListener(const Endpoint& local, const std::string& place);
  ~TcpListener();
  TcpListener(TcpListener&& other) noexcept;
  TcpListener& operator=(TcpListener&& other) noexcept;

  const Endpoint& local() const { return local_; }
  int descriptor() const { return descriptor_; }
  /// The next connection; none if nobody has connected.
  std::optional<TcpStream> accept();

 private:
  int descriptor_ = -1;
  Endpoint local_;
};

}  // namespace cotwin::net
