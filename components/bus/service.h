#pragma once
#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "components/bus/queue.h"
#include "components/bus/wake.h"
#include "models/foundation/support/error.h"

namespace cotwin::bus {

/// What became of a request.
enum class Outcome : std::uint8_t {
  kAnswered,
  kExpired  // its deadline had passed, or it was cancelled, before the server took it
};

/// Requests from several clients, each used by one thread, to a server thread, and its replies. The server's functions never block or
/// allocate (except wait()), so that the loop of a run can be the server: it takes the requests between two ticks.
template <class Request, class Reply>
class Service {
 public:
  static constexpr std::size_t kMaxClients = 64;

  struct Answer {
    std::uint64_t number = 0;  // of the request
    Outcome outcome = Outcome::kAnswered;
    Reply reply{};
  };
  struct Call {
    std::size_t client = 0;
    std::uint64_t number = 0;
    std::int64_t deadline = kNever;  // CLOCK_MONOTONIC, ns
    Request request{};
  };

  class Client {
   public:
    Client(Service& service, std::size_t index, std::size_t open, std::shared_ptr<Wake> wake)
        : service_(service), index_(index), answers_(open), wake_(std::move(wake)), cancelled_(answers_.capacity()) {
      dropped_.reserve(answers_.capacity());
    }

    /// Sends a request and returns its number. After `deadline` (CLOCK_MONOTONIC, ns) the server does not begin it. Nothing, if the
    /// server's queue is full or as many requests as a client may have are without an answer that was taken.
    std::optional<std::uint64_t> ask(const Request& request, std::int64_t deadline = kNever) {
      if (open_ == answers_.capacity()) return std::nullopt;
      if (!service_.calls_.push({index_, number_ + 1, deadline, request})) return std::nullopt;
      service_.wake_->notify();
      ++open_;
      return ++number_;
    }
    /// The answer to this open request will not be given to take(). The server does not begin the request any more if it has not taken it.
    void cancel(std::uint64_t number) {
      cancelled_[number & (cancelled_.size() - 1)].store(number, std::memory_order_release);
      if (dropped_.size() < dropped_.capacity()) dropped_.push_back(number);
    }
    /// False: there is no answer.
    bool take(Answer& answer) {
      while (answers_.pop(answer)) {
        --open_;
        const auto dropped = std::find(dropped_.begin(), dropped_.end(), answer.number);
        if (dropped == dropped_.end()) return true;
        *dropped = dropped_.back();
        dropped_.pop_back();
      }
      return false;
    }
    /// Waits for answers, also for those of cancelled requests.
    bool wait(std::int64_t deadline = kNever) {
      return wake_->wait([this] { return !answers_.empty(); }, deadline);
    }
    /// Asks and waits for the reply; nothing if there is none before `deadline`, and the request is cancelled then. Drops answers to
    /// other requests of this client.
    std::optional<Reply> call(const Request& request, std::int64_t deadline) {
      Answer answer;
      while (take(answer)) {
      }
      const std::optional<std::uint64_t> number = ask(request, deadline);
      while (number && wait(deadline)) {
        while (take(answer)) {
          if (answer.number != *number) continue;
          return answer.outcome == Outcome::kAnswered ? std::optional(answer.reply) : std::nullopt;
        }
      }
      if (number) cancel(*number);
      return std::nullopt;
    }
    bool empty() const { return answers_.empty(); }
    Wake& wake() { return *wake_; }
    /// Requests without an answer that was taken.
    std::size_t open() const { return open_; }

   private:
    friend Service;
    Service& service_;
    const std::size_t index_;
    SpscQueue<Answer> answers_;
    std::shared_ptr<Wake> wake_;
    std::uint64_t number_ = 0;
    std::size_t open_ = 0;
    std::vector<std::uint64_t> dropped_;                 // cancelled ones that are open
    std::vector<std::atomic<std::uint64_t>> cancelled_;  // the last one with this remainder
  };

  /// `capacity`: requests that wait for the server. `wake`: shared by all that the server waits for.
  explicit Service(std::size_t capacity = 64, std::shared_ptr<Wake> wake = nullptr)
      : calls_(capacity), wake_(wake ? std::move(wake) : std::make_shared<Wake>()) {}

  /// Adds a client with at most `open` requests at once (rounded up to a power of two), which lives as long as the service. Also while
  /// the server runs. `wake`: shared by all that the client's thread waits for. Throws Error if there are kMaxClients. Allocates.
  Client& add_client(std::size_t open = 8, std::shared_ptr<Wake> wake = nullptr) {
    const std::lock_guard lock(adding_);
    if (count_ == kMaxClients)
      throw Error("bus", "a service has " + std::to_string(kMaxClients) + " clients, expected no more");
    clients_[count_] = std::make_unique<Client>(*this, count_, open, wake ? std::move(wake) : std::make_shared<Wake>());
    return *clients_[count_++];
  }

  /// By the server: the next request that is neither cancelled nor too late; false: there is none.
  bool take(Call& call) {
    while (calls_.pop(call)) {
      if (!cancelled(call) && (call.deadline == kNever || monotonic_ns() < call.deadline)) return true;
      answer(call, {call.number, Outcome::kExpired, {}});
    }
    return false;
  }
  /// By the server: whether the client has cancelled the request that was taken.
  bool cancelled(const Call& call) const {
    const auto& marks = clients_[call.client]->cancelled_;
    return marks[call.number & (marks.size() - 1)].load(std::memory_order_acquire) == call.number;
  }
  bool empty() const { return calls_.empty(); }
  bool wait(std::int64_t deadline = kNever) {
    return wake_->wait([this] { return !calls_.empty(); }, deadline);
  }
  Wake& wake() { return *wake_; }
  /// Each request that was taken is answered once. There is always room for the answer.
  void reply(const Call& call, const Reply& reply) { answer(call, {call.number, Outcome::kAnswered, reply}); }

 private:
  void answer(const Call& call, const Answer& answer) {
    Client& client = *clients_[call.client];
    (void)client.answers_.push(answer);
    client.wake_->notify();
  }

  MpscQueue<Call> calls_;
  std::shared_ptr<Wake> wake_;
  std::mutex adding_;
  std::size_t count_ = 0;  // of clients_
  std::array<std::unique_ptr<Client>, kMaxClients> clients_;
};

}  // namespace cotwin::bus
