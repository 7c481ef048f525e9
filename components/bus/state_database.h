#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "components/bus/state_layout.h"
#include "components/bus/state_message.h"

/// State databases (V-D): one owner writes its states, others hold replicas. Only differences travel. A replica applies an update
/// only if the base version of the update is its own version. It keeps updates that come too early for a while, and otherwise
/// requests a full copy: after a loss, and when it joins late. It follows a restarted owner, whose session is another one, only with
/// a full copy that answers a request sent since it follows the present one: datagrams of an earlier life that come late cannot
/// bring back its states. Nothing here allocates after the constructors, except the text of a foreign layout.
namespace cotwin::bus {

/// A number, not 0, that differs from that of an earlier or other owner, also if the wall clock was set back: a hash of the clock, the
/// process, a counter and a random number of the system.
std::uint64_t new_session();

class StateOwner {
 public:
  explicit StateOwner(StateLayout layout, std::uint64_t session = new_session());

  const StateLayout& layout() const { return layout_; }
  /// The states, which the owner writes between two publications.
  std::span<std::byte> image() { return image_; }
  /// Finds what changed since the last publication. Returns the update, valid until the next call: nothing but a header if nothing
  /// changed. Its size is at most kStateHeader + kRunHeader + layout().bytes(). `epoch` must not decrease.
  std::span<const std::byte> publish(std::int64_t epoch);
  /// The full copy of the last publication, valid until the next call; empty before the first one. `request`: number of the request
  /// that it answers (StateMessage::base).
  std::span<const std::byte> full(std::uint64_t request);

  std::uint64_t session() const { return session_; }
  std::uint64_t version() const { return version_; }
  std::int64_t epoch() const { return epoch_; }
  /// The image of the last publication.
  std::span<const std::byte> published() const { return shadow_; }

 private:
  StateMessage header(StateMessage::Kind kind) const;

  StateLayout layout_;
  std::uint64_t session_;
  std::uint64_t version_ = 0;
  std::int64_t epoch_ = 0;
  std::vector<std::byte> image_, shadow_, update_, full_;
};

/// What a replica did with a message.
enum class Reception : std::uint8_t {
  kUpdated,      // applied an update, or a newer epoch without changes
  kCopied,       // took over a full copy
  kOld,          // of an earlier version, repeated, or a full copy of another session that answers no request of this replica
  kEarly,        // kept an update until those before it come
  kGap,          // an update of another base: requests a full copy
  kOtherLayout,  // of a program with another layout, see StateReplica::other_layout()
  kOtherFormat,  // of a program with another wire format
  kDamaged
};

class StateReplica {
 public:
  explicit StateReplica(StateLayout layout);

  const StateLayout& layout() const { return layout_; }
  /// Takes a message of the owner: an update or a full copy.
  Reception receive(std::span<const std::byte> message);
  /// Whether it has ever had the states.
  bool complete() const { return version_ > 0; }
  /// Whether it lacks a newer state, so that request() must be sent to the owner, and again until a full copy arrives.
  bool behind() const { return !complete() || wanted_session_ != session_ || version_ < newest_; }
  /// The message, with a new number; valid until the next call.
  std::span<const std::byte> request();
  /// Number of the last request.
  std::uint64_t requested() const { return requested_; }

  std::span<const std::byte> image() const { return image_; }
  std::uint64_t session() const { return session_; }
  std::uint64_t version() const { return version_; }
  std::int64_t epoch() const { return epoch_; }
  /// Number of changes that were missed and replaced by full copies.
  std::uint64_t missed() const { return missed_; }
  /// Number of other sessions that were followed after the first one: restarts of the owner.
  std::uint64_t restarts() const { return restarts_; }
  /// How many of these were sessions that had been left before: two owners send to this replica.
  std::uint64_t returns() const { return returns_; }
  /// The layout of the owner if its last full copy had another one; else empty.
  const std::string& other_layout() const { return other_layout_; }

 private:
  struct Early {
    std::uint64_t version = 0;  // 0: none
    std::int64_t epoch = 0;
    std::vector<std::byte> runs;  // the first `size` of them
    std::size_t size = 0;
  };
  void apply(const StateMessage& m);
  void apply_early();
  Reception update(const StateMessage& m);
  Reception copy(const StateMessage& m);
  void follow(std::uint64_t session);

  StateLayout layout_;
  std::uint64_t session_ = 0, version_ = 0;
  std::uint64_t wanted_session_ = 0;  // of the last message
  std::uint64_t newest_ = 0;          // version of wanted_session_ of which a message has been seen
  std::int64_t epoch_ = 0;
  std::uint64_t missed_ = 0, restarts_ = 0, returns_ = 0;
  std::uint64_t requested_, answered_;     // the last request; the last one before the present session was followed
  std::array<std::uint64_t, 4> former_{};  // sessions that were left last; 0: none
  std::vector<std::byte> image_, request_;
  std::vector<Early> early_;  // of session_; the one of a version has the place version modulo size
  std::string other_layout_;
};

}  // namespace cotwin::bus
