#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "components/bus/state_database.h"
#include "components/bus/transport.h"

namespace cotwin::bus {

/// One end of an exchange of states over a transport: owns states that it publishes, holds a replica of the other end's, or both.
/// Answers the requests of the other end and sends its own. For one thread; nothing blocks or allocates.
class StateExchange {
 public:
  /// Throws Error if the full copy of a layout is larger than the transport's messages.
  StateExchange(Transport& transport, std::optional<StateLayout> own, std::optional<StateLayout> other);

  StateOwner* owner() { return owner_ ? &*owner_ : nullptr; }
  const StateReplica* replica() const { return replica_ ? &*replica_ : nullptr; }

  /// Sends what changed in the owner's image.
  void publish(std::int64_t epoch);
  /// Takes what has arrived, and requests a full copy if the replica is behind: at once, and then in every kRequestEvery-th
  /// call; before the first full copy also whenever an update arrives.
  /// Returns whether the replica has a newer state or epoch.
  bool receive();
  static constexpr int kRequestEvery = 8;
  /// Sends a request for a full copy, even without a reason.
  void request();

  struct Counts {
    std::uint64_t published = 0, published_bytes = 0;  // updates
    std::uint64_t copies_sent = 0;                     // full copies on request
    std::uint64_t updates = 0, copies = 0;             // applied
    std::uint64_t early = 0;                           // updates that were kept
    std::uint64_t old = 0, gaps = 0, damaged = 0;      // messages that were not applied
    std::uint64_t other_layout = 0, other_format = 0;
    std::uint64_t requests = 0;  // sent
  };
  const Counts& counts() const { return counts_; }
  /// The layout that the other end expects of our states if it is another one; else empty.
  const std::string& expected_layout() const { return expected_layout_; }

 private:
  void answer(const StateMessage& request);
  bool take(std::span<const std::byte> message);

  Transport& transport_;
  std::optional<StateOwner> owner_;
  std::optional<StateReplica> replica_;
  int calls_to_request_ = 0;  // without one
  bool copy_wanted_ = false;
  std::uint64_t asked_ = 0;  // number of the last request of the other end
  std::string expected_layout_;
  Counts counts_;
};

}  // namespace cotwin::bus
