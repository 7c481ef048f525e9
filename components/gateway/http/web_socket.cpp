// A connection that became a WebSocket. What the client sends is read and discarded: no route takes messages.
#include <algorithm>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/websocket.hpp>

#include "components/gateway/http/server_impl.h"

namespace cotwin::gateway::http {

namespace {

namespace ws = beast::websocket;

constexpr double kWindow = 10;  // s, in which the client may send Limits::stream_bytes
constexpr double kClose = 2;    // s, until the client has answered the close frame

class WebSocket final : public Client, public std::enable_shared_from_this<WebSocket> {
 public:
  WebSocket(Server::Impl& server, AnyStream stream)
      : server_(server),
        limits_(server.options.limits),
        socket_(std::move(stream)),
        timer_(server.context),
        buffer_(limits_.message_bytes + 1),
        window_(Clock::now()) {
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
    // Each ping is answered by Beast, and each of these counts as sent by the client.
    socket_.control_callback([this](ws::frame_type, beast::string_view text) {
      if (count(text.size())) return;
      asio::post(server_.context, [to = weak_from_this()] {
        if (const auto s = to.lock()) s->abort();
      });
    });
  }
  ~WebSocket() override {
    --server_.counts.open;
    --server_.counts.streams;
  }

  void start(const beast::http::request<beast::http::string_body>& request,
             std::function<void(const std::shared_ptr<Stream>&)> opened) {
    const auto wake = [loop = server_.loop, to = weak_from_this()] {
      loop->post([to] {
        if (const auto s = to.lock()) s->pump();
      });
    };
    channel_ = std::make_shared<Channel>(Channel::Kind::kWebSocket, limits_.queue_bytes, wake, server_.counts.dropped);
    socket_.async_accept(request, [self = shared_from_this(), opened = std::move(opened)](const ErrorCode& error) {
      if (error || self->finished_) return self->abort();
      self->open_ = true;
      self->read();
      try {
        opened(self->channel_);
      } catch (const std::exception&) {
        return self->abort();
      }
      self->pump();
    });
  }

  const tcp::socket& socket() const override { return socket_.next_layer().next_layer(); }

  void abort() override {
    if (finished_) return;
    finished_ = true;
    const auto self = shared_from_this();
    ErrorCode none;
    timer_.cancel();
    socket_.next_layer().next_layer().close(none);
    channel_->end();
    server_.remove(this);
  }

 private:
  using Clock = std::chrono::steady_clock;

  static Clock::duration seconds(double value) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(value));
  }

  /// Piece by piece, so that a message takes no more memory than a piece of it.
  void read() {
    socket_.async_read_some(buffer_, limits_.message_bytes, [self = shared_from_this()](const ErrorCode& error, std::size_t) {
      if (error) return self->abort();  // a message that is too long was answered with a close code by Beast
      const std::size_t bytes = self->buffer_.size();
      self->buffer_.consume(bytes);
      self->count(bytes) ? self->read() : self->close(ws::close_code::policy_error);
    });
  }

  /// False: the client sends too much. Each piece counts as one byte more than it has.
  bool count(std::size_t bytes) {
    const Clock::time_point now = Clock::now();
    if (now - window_ >= seconds(kWindow)) {
      window_ = now;
      received_ = 0;
    }
    received_ += bytes + 1;
    return received_ <= limits_.stream_bytes;
  }

  /// Ends the connection if the client does not take in time what is written now.
  void arm(double limit) {
    timer_.expires_after(seconds(limit));
    timer_.async_wait([self = weak_from_this()](const ErrorCode& error) {
      if (error) return;
      if (const auto s = self.lock()) s->abort();
    });
  }

  void pump() {
    if (finished_ || !open_) return;
    const Channel::Wish wish = channel_->wish();
    // A write that the client does not take would hold up the close frame, too.
    if (wish == Channel::Wish::kAbort && (writing_ || closing_)) return abort();
    if (writing_ || closing_) return;
    if (wish == Channel::Wish::kAbort) return close(ws::close_code::try_again_later);
    if (wish == Channel::Wish::kCloseInOrder) return close(ws::close_code::normal);
    if (!channel_->take(out_)) return;
    writing_ = true;
    arm(limits_.response);
    socket_.async_write(asio::buffer(out_), [self = shared_from_this()](const ErrorCode& error, std::size_t) {
      self->writing_ = false;
      if (error) return self->abort();
      self->timer_.cancel();
      self->channel_->written();
      self->pump();
    });
  }

  void close(ws::close_code code) {
    if (finished_ || closing_) return;
    closing_ = true;
    arm(std::min(limits_.response, kClose));
    socket_.async_close(code, [self = shared_from_this()](const ErrorCode&) { self->abort(); });
  }

  Server::Impl& server_;
  const Limits& limits_;
  ws::stream<AnyStream, false> socket_;
  asio::steady_timer timer_;
  beast::flat_buffer buffer_;
  Clock::time_point window_;
  std::size_t received_ = 0;  // since window_, see count()
  std::shared_ptr<Channel> channel_;
  std::string out_;
  bool open_ = false, writing_ = false, closing_ = false, finished_ = false;
};

}  // namespace

void upgrade(Server::Impl& server, AnyStream stream, const Client& connection,
             const beast::http::request<beast::http::string_body>& request,
             std::function<void(const std::shared_ptr<Stream>&)> opened) {
  const auto socket = std::make_shared<WebSocket>(server, std::move(stream));
  socket->bearer = connection.bearer;
  socket->address = connection.address;
  socket->holder = connection.holder;
  server.add(socket);
  socket->start(request, std::move(opened));
}

}  // namespace cotwin::gateway::http
