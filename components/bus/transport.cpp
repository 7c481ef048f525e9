#include "components/bus/transport.h"

namespace cotwin::bus {

std::pair<std::unique_ptr<LocalTransport>, std::unique_ptr<LocalTransport>> LocalTransport::make_pair(std::size_t capacity) {
  const auto there = std::make_shared<Direction>(capacity), back = std::make_shared<Direction>(capacity);
  return {std::unique_ptr<LocalTransport>(new LocalTransport(there, back)),
          std::unique_ptr<LocalTransport>(new LocalTransport(back, there))};
}

bool LocalTransport::send(std::span<const std::byte> message) {
  const bool taken = out_->queue.push(message);
  if (!taken) ++dropped_;
  out_->wake.notify();
  return taken;
}

std::span<const std::byte> LocalTransport::receive() {
  if (held_) in_->queue.drop();
  const std::span<const std::byte> message = in_->queue.front();
  held_ = !message.empty();
  return message;
}

bool LocalTransport::wait(std::int64_t deadline) {
  if (held_) in_->queue.drop();
  held_ = false;
  return in_->wake.wait([this] { return !in_->queue.empty(); }, deadline);
}

}  // namespace cotwin::bus
