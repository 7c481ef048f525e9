#include "components/bus/state_exchange.h"

#include <utility>

#include "models/foundation/support/error.h"

namespace cotwin::bus {

StateExchange::StateExchange(Transport& transport, std::optional<StateLayout> own, std::optional<StateLayout> other)
    : transport_(transport) {
  if (own) owner_.emplace(std::move(*own));
  if (other) replica_.emplace(std::move(*other));
  for (const StateLayout* layout : {owner_ ? &owner_->layout() : nullptr, replica_ ? &replica_->layout() : nullptr}) {
    if (layout == nullptr) continue;
    const std::size_t bytes = kStateHeader + sizeof(std::uint32_t) + layout->text().size() + layout->bytes();
    if (bytes > transport.max_bytes()) {
      throw Error("states", "a full copy has " + std::to_string(bytes) + " bytes, expected at most " +
                                std::to_string(transport.max_bytes()) + ", the largest message");
    }
  }
}

void StateExchange::publish(std::int64_t epoch) {
  const std::span<const std::byte> update = owner_->publish(epoch);
  transport_.send(update);
  ++counts_.published;
  counts_.published_bytes += update.size();
}

void StateExchange::request() {
  transport_.send(replica_->request());
  ++counts_.requests;
  calls_to_request_ = kRequestEvery;
}

bool StateExchange::receive() {
  bool newer = false;
  copy_wanted_ = false;
  const std::uint64_t gaps = counts_.gaps;
  for (std::span<const std::byte> message = transport_.receive(); !message.empty(); message = transport_.receive())
    newer |= take(message);
  // One copy answers all requests that came together.
  if (copy_wanted_) {
    transport_.send(owner_->full(asked_));
    ++counts_.copies_sent;
  }
  if (!replica_ || !replica_->behind()) {
    calls_to_request_ = 0;
    return newer;
  }
  // An owner that has just appeared did not get the requests before.
  if (!replica_->complete() && counts_.gaps > gaps) calls_to_request_ = 0;
  if (--calls_to_request_ < 0) request();
  return newer;
}

// A request with another layout is answered, too, so that the other end can name the difference.
void StateExchange::answer(const StateMessage& request) {
  if (owner_ && owner_->version() > 0) copy_wanted_ = true;
  asked_ = request.base;
  if (!owner_) {
    ++counts_.other_layout;
  } else if (request.layout != owner_->layout().hash()) {
    ++counts_.other_layout;
    if (expected_layout_ != request.text) expected_layout_ = request.text;
  }
}

bool StateExchange::take(std::span<const std::byte> message) {
  StateMessage m;
  if (decode(message, 0, 0, m) && m.kind == StateMessage::Kind::kRequest) {
    answer(m);
    return false;
  }
  if (!replica_) return false;
  switch (replica_->receive(message)) {
    case Reception::kUpdated:
      ++counts_.updates;
      return true;
    case Reception::kCopied:
      ++counts_.copies;
      return true;
    case Reception::kOld:
      ++counts_.old;
      return false;
    case Reception::kEarly:
      ++counts_.early;
      return false;
    case Reception::kGap:
      ++counts_.gaps;
      return false;
    case Reception::kOtherLayout:
      ++counts_.other_layout;
      return false;
    case Reception::kOtherFormat:
      ++counts_.other_format;
      return false;
    case Reception::kDamaged:
      ++counts_.damaged;
      return false;
  }
  return false;
}

}  // namespace cotwin::bus
