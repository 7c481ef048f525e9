#pragma once
#include <atomic>
#include <cstdint>
#include <deque>
#include <mutex>
#include <vector>

#include "components/gateway/http/stream.h"

namespace cotwin::gateway::http {

/// The queue of a stream between its senders and its connection.
class Channel final : public Stream {
 public:
  enum class Kind { kEvents, kWebSocket };

  /// `wake` is called by senders when there is something to take, and must not call the channel.
  Channel(Kind kind, std::size_t limit, std::function<void()> wake, std::atomic<std::uint64_t>& dropped)
      : kind_(kind), limit_(limit), wake_(std::move(wake)), dropped_(dropped) {}

  bool send(const Event& event) override;
  std::size_t waiting() const override;
  bool closed() const override;
  void close() override;
  void on_close(std::function<void()> function) override;

  // By the connection.

  /// The next text. False: there is none. Bytes count as waiting until written().
  bool take(std::string& text);
  void written();
  /// Whether the connection should close: at once, or because all is sent.
  enum class Wish { kStay, kCloseInOrder, kAbort };
  Wish wish() const;
  /// The connection is closed. Calls the functions of on_close.
  void end();

 private:
  bool push(std::string text);

  const Kind kind_;
  const std::size_t limit_;
  mutable std::mutex mutex_;
  std::function<void()> wake_;
  std::atomic<std::uint64_t>& dropped_;  // used only before end()
  std::deque<std::string> texts_;
  std::size_t bytes_ = 0, taken_ = 0;
  bool closing_ = false, aborted_ = false, ended_ = false;
  std::vector<std::function<void()>> at_close_;
};

}  // namespace cotwin::gateway::http
