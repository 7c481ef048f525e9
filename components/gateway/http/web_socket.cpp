// A connection that became a WebSocket.
#include <boost/beast/websocket.hpp>

#include "components/gateway/http/server_impl.h"

namespace cotwin::gateway::http {

namespace {

namespace ws = beast::websocket;

class WebSocket final : public Client, public std::enable_shared_from_this<WebSocket> {
 public:
  WebSocket(Server::Impl& server, AnyStream stream)
      : server_(server), limits_(server.options.limits), socket_(std::move(stream)) {
    ++server_.counts.open;
    ++server_.counts.streams;
    ws::stream_base::timeout limit{};
    limit.handshake_timeout = seconds(limits_.handshake);
    limit.idle_timeout = seconds(2 * limits_.heartbeat);
    limit.keep_alive_pings = true;
    socket_.set_option(limit);
    socket_.read_message_max(limits_.message_bytes);
    socket_.auto_fragment(false);
    socket_.text(true);
  }
  ~WebSocket() override {
    --server_.counts.open;
    --server_.counts.streams;
  }

  void start(const beast::http::request<beast::http::string_body>& request,
             std::function<void(const std::shared_ptr<Stream>&)> opened) {
    const auto wake = [gate = server_.gate, to = weak_from_this()] {
      gate->post([to] {
        if (const auto s = to.lock()) s->pump();
      });
    };
    channel_ = std::make_shared<Channel>(Channel::Kind::kWebSocket, limits_.queue_bytes, wake, server_.counts.dropped);
    socket_.async_accept(request, [self = shared_from_this(), opened = std::move(opened)](const ErrorCode& error) {
      if (error) return self->abort();
      self->open_ = true;
      self->read();
      opened(self->channel_);
      self->pump();
    });
  }

  void abort() override {
    if (finished_) return;
    finished_ = true;
    const auto self = shared_from_this();
    ErrorCode none;
    socket_.next_layer().next_layer().close(none);
    channel_->end();
    server_.remove(this);
  }

 private:
  static std::chrono::steady_clock::duration seconds(double value) {
    return std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(value));
  }

  void read() {
    socket_.async_read(buffer_, [self = shared_from_this()](const ErrorCode& error, std::size_t) {
      if (error) return self->abort();  // a message that is too long, or no text, was answered with a close code by Beast
      if (!self->socket_.got_text()) return self->close(ws::close_code::unknown_data);
      self->channel_->receive(beast::buffers_to_string(self->buffer_.data()));
      self->buffer_.consume(self->buffer_.size());
      self->read();
    });
  }

  void pump() {
    if (finished_ || writing_ || closing_ || !open_) return;
    switch (channel_->wish()) {
      case Channel::Wish::kAbort:
        return close(ws::close_code::try_again_later);
      case Channel::Wish::kCloseInOrder:
        return close(ws::close_code::normal);
      default:
        break;
    }
    if (!channel_->take(out_)) return;
    writing_ = true;
    socket_.async_write(asio::buffer(out_), [self = shared_from_this()](const ErrorCode& error, std::size_t) {
      self->writing_ = false;
      if (error) return self->abort();
      self->channel_->written();
      self->pump();
    });
  }

  void close(ws::close_code code) {
    if (finished_ || closing_) return;
    closing_ = true;
    socket_.async_close(code, [self = shared_from_this()](const ErrorCode&) { self->abort(); });
  }

  Server::Impl& server_;
  const Limits& limits_;
  ws::stream<AnyStream, false> socket_;
  beast::flat_buffer buffer_;
  std::shared_ptr<Channel> channel_;
  std::string out_;
  bool open_ = false, writing_ = false, closing_ = false, finished_ = false;
};

}  // namespace

void upgrade(Server::Impl& server, AnyStream stream, const beast::http::request<beast::http::string_body>& request,
             std::function<void(const std::shared_ptr<Stream>&)> opened) {
  const auto socket = std::make_shared<WebSocket>(server, std::move(stream));
  server.add(socket);
  socket->start(request, std::move(opened));
}

}  // namespace cotwin::gateway::http
