#pragma once
#include <cstddef>
#include <functional>
#include <memory>
#include <string>

namespace cotwin::gateway::http {

/// A message to a client. As server-sent event: fields event, id and data. Over a WebSocket: the text {"event":…,"id":…,"data":…}.
struct Event {
  std::string name, id;  // "": none
  std::string data;      // JSON text
};

/// An open stream to one client: server-sent events, or a WebSocket. Functions may be called from any thread and never wait for the
/// client. What waits for the client is limited (Limits::queue_bytes): a client that reads slower than that loses its connection.
class Stream {
 public:
  virtual ~Stream() = default;
  /// False: the stream is closed, or was closed by this call because too much waits.
  virtual bool send(const Event& event) = 0;
  /// Bytes that wait for the client. Samples of signals are best dropped while it is not 0: then the newest one arrives.
  virtual std::size_t waiting() const = 0;
  virtual bool closed() const = 0;
  /// Closes after what waits was sent.
  virtual void close() = 0;
  /// Calls the function once, when the stream is closed: on the server's thread, or at once if it is closed already.
  virtual void on_close(std::function<void()> function) = 0;
};

}  // namespace cotwin::gateway::http
