#pragma once
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <memory>
#include <optional>
#include <utility>

/// Only for the sources of this folder: headers of Boost take long to compile.
namespace cotwin::gateway::http {

namespace asio = boost::asio;
namespace beast = boost::beast;
using tcp = asio::ip::tcp;
using ErrorCode = boost::system::error_code;

/// A TCP connection with or without TLS as one type, so that what reads and writes HTTP is compiled once.
class AnyStream {
 public:
  using executor_type = tcp::socket::executor_type;
  using next_layer_type = tcp::socket;

  AnyStream(tcp::socket socket, asio::ssl::context* tls) : parts_(std::make_unique<Parts>(std::move(socket), tls)) {}

  executor_type get_executor() { return parts_->socket.get_executor(); }
  tcp::socket& next_layer() { return parts_->socket; }
  const tcp::socket& next_layer() const { return parts_->socket; }
  bool has_tls() const { return parts_->tls.has_value(); }
  auto& tls() { return *parts_->tls; }
  void drop_tls() { parts_->tls.reset(); }

  template <class Buffers, class Done>
  auto async_read_some(const Buffers& buffers, Done&& done) {
    return asio::async_initiate<Done, void(ErrorCode, std::size_t)>(
        [parts = parts_.get()](auto handler, const Buffers& to) {
          if (parts->tls) {
            parts->tls->async_read_some(to, std::move(handler));
          } else {
            parts->socket.async_read_some(to, std::move(handler));
          }
        },
        done, buffers);
  }
  template <class Buffers, class Done>
  auto async_write_some(const Buffers& buffers, Done&& done) {
    return asio::async_initiate<Done, void(ErrorCode, std::size_t)>(
        [parts = parts_.get()](auto handler, const Buffers& from) {
          if (parts->tls) {
            parts->tls->async_write_some(from, std::move(handler));
          } else {
            parts->socket.async_write_some(from, std::move(handler));
          }
        },
        done, buffers);
  }

 private:
  struct Parts {
    Parts(tcp::socket s, asio::ssl::context* context) : socket(std::move(s)) {
      if (context != nullptr) tls.emplace(socket, *context);
    }
    tcp::socket socket;
    std::optional<asio::ssl::stream<tcp::socket&>> tls;
  };
  std::unique_ptr<Parts> parts_;
};

/// The end of a WebSocket: called by Beast.
template <class Done>
void async_teardown(beast::role_type role, AnyStream& stream, Done&& done) {
  if (stream.has_tls()) {
    stream.tls().async_shutdown(std::forward<Done>(done));
  } else {
    beast::websocket::async_teardown(role, stream.next_layer(), std::forward<Done>(done));
  }
}

}  // namespace cotwin::gateway::http
