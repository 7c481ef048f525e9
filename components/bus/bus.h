#pragma once
#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "components/bus/queue.h"
#include "components/bus/wake.h"
#include "models/foundation/support/error.h"

/// Messages between threads: topics that are published and subscribed. Publishing never blocks and never allocates; waiting never
/// polls. Signals whose readers come and go: feed.h. Requests with replies: service.h.
namespace cotwin::bus {

/// What a subscriber gets that reads more slowly than messages come.
enum class Policy : std::uint8_t {
  kLatest,  // the latest message; earlier ones are replaced
  kQueue    // the messages in their order, up to the capacity of its queue; later ones are dropped (Feed drops the oldest)
};

/// Who calls publish(): one thread, or up to LatestValue::kMaxWriters at the same time.
enum class Publishers : std::uint8_t { kOne, kSeveral };

/// A subscriber's end of a topic. All functions are for one thread, except lost().
template <class T>
class Subscription {
 public:
  Subscription(Publishers publishers, Policy policy, std::size_t capacity, std::shared_ptr<Wake> wake)
      : wake_(std::move(wake)) {
    if (policy == Policy::kLatest) {
      latest_.emplace(publishers == Publishers::kOne ? 1 : LatestValue<T>::kMaxWriters);
    } else if (publishers == Publishers::kOne) {
      spsc_.emplace(capacity);
    } else {
      mpsc_.emplace(capacity);
    }
  }

  /// False: there is no message.
  bool take(T& message) { return latest_ ? latest_->take(message) : spsc_ ? spsc_->pop(message) : mpsc_->pop(message); }
  bool empty() const { return latest_ ? latest_->empty() : spsc_ ? spsc_->empty() : mpsc_->empty(); }
  /// Waits for a message until CLOCK_MONOTONIC reaches `deadline`, ns. False: there is none.
  bool wait(std::int64_t deadline = kNever) {
    return wake_->wait([this] { return !empty(); }, deadline);
  }
  Wake& wake() { return *wake_; }
  /// Messages that this subscriber did not get: dropped (kQueue) or replaced (kLatest).
  std::uint64_t lost() const { return lost_.load(std::memory_order_relaxed); }

  /// By the topic. False: the message was dropped.
  bool put(const T& message) {
    bool taken = true, all = true;
    if (latest_) {
      all = !latest_->set(message);
    } else {
      all = taken = spsc_ ? spsc_->push(message) : mpsc_->push(message);
    }
    if (!all) lost_.fetch_add(1, std::memory_order_relaxed);
    wake_->notify();
    return taken;
  }

 private:
  std::optional<LatestValue<T>> latest_;
  std::optional<SpscQueue<T>> spsc_;
  std::optional<MpscQueue<T>> mpsc_;
  std::shared_ptr<Wake> wake_;
  alignas(64) std::atomic<std::uint64_t> lost_ = 0;
};

/// Carries messages of type T from its publishers to its subscribers.
template <class T>
class Topic {
 public:
  static constexpr std::size_t kMaxSubscribers = 32;

  explicit Topic(Publishers publishers = Publishers::kOne) : publishers_(publishers) {}

  /// Adds a subscriber, which gets the messages published from now on and lives as long as the topic. Also while others publish.
  /// `capacity`: messages of Policy::kQueue; `wake`: shared by the subscriptions of a thread that waits for several topics. Throws
  /// Error if there are kMaxSubscribers. Allocates.
  Subscription<T>& subscribe(Policy policy, std::size_t capacity = 64, std::shared_ptr<Wake> wake = nullptr) {
    const std::lock_guard lock(adding_);
    const std::size_t n = count_.load(std::memory_order_relaxed);
    if (n == kMaxSubscribers) throw Error("bus", "a topic has " + std::to_string(n) + " subscribers, expected no more");
    if (!wake) wake = std::make_shared<Wake>();
    subscribers_[n] = std::make_unique<Subscription<T>>(publishers_, policy, capacity, std::move(wake));
    count_.store(n + 1, std::memory_order_release);
    return *subscribers_[n];
  }

  /// Returns the number of subscribers that dropped the message because their queue was full.
  std::size_t publish(const T& message) {
    std::size_t dropped = 0;
    const std::size_t n = count_.load(std::memory_order_acquire);
    for (std::size_t i = 0; i < n; ++i) dropped += subscribers_[i]->put(message) ? 0 : 1;
    return dropped;
  }

 private:
  const Publishers publishers_;
  std::mutex adding_;
  std::array<std::unique_ptr<Subscription<T>>, kMaxSubscribers> subscribers_;
  std::atomic<std::size_t> count_ = 0;
};

}  // namespace cotwin::bus
