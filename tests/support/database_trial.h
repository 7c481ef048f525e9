#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "components/bus/state_exchange.h"

namespace cotwin::testing {

/// A direction of a network in simulated time: messages are lost, doubled and delayed by a random number of ticks, so that later
/// ones overtake. Keeps the memory of delivered messages.
class LossyNetwork {
 public:
  LossyNetwork(std::uint64_t seed, double loss, double doubled, int delay)
      : random_(seed), loss_(loss), doubled_(doubled), delay_(delay) {}

  void set_loss(double loss) { loss_ = loss; }
  void tick() { ++now_; }
  void send(std::span<const std::byte> message) {
    const int copies = chance(doubled_) ? 2 : 1;
    for (int i = 0; i < copies; ++i) {
      if (chance(loss_)) continue;
      Packet& p = free_packet();
      p.due = now_ + static_cast<std::int64_t>(random_() % static_cast<std::uint64_t>(delay_ + 1));
      p.order = random_();
      p.size = message.size();
      if (p.bytes.size() < p.size) p.bytes.resize(p.size);
      std::copy(message.begin(), message.end(), p.bytes.begin());
    }
  }
  std::span<const std::byte> receive() {
    Packet* next = nullptr;
    for (Packet& p : packets_) {
      if (p.due >= 0 && p.due <= now_ && (next == nullptr || std::pair(p.due, p.order) < std::pair(next->due, next->order)))
        next = &p;
    }
    if (next == nullptr) return {};
    next->due = -1;
    return std::span(next->bytes).first(next->size);
  }

 private:
  struct Packet {
    std::int64_t due = -1;  // −1: free
    std::uint64_t order = 0;
    std::size_t size = 0;
    std::vector<std::byte> bytes;
  };
  bool chance(double p) { return static_cast<double>(random_() >> 11) * 0x1p-53 < p; }
  Packet& free_packet() {
    for (Packet& p : packets_)
      if (p.due < 0) return p;
    return packets_.emplace_back();
  }

  std::mt19937_64 random_;
  double loss_, doubled_;
  int delay_;
  std::int64_t now_ = 0;
  std::vector<Packet> packets_;
};

/// One end of a pair of networks.
class LossyTransport final : public bus::Transport {
 public:
  LossyTransport(LossyNetwork& out, LossyNetwork& in) : out_(out), in_(in) {}
  bool send(std::span<const std::byte> message) override {
    out_.send(message);
    return true;
  }
  std::span<const std::byte> receive() override { return in_.receive(); }
  bool wait(std::int64_t) override { return true; }
  std::size_t max_bytes() const override { return 1 << 24; }

 private:
  LossyNetwork &out_, &in_;
};

struct DatabaseTrialSettings {
  std::int64_t ticks = 100'000;
  std::uint64_t seed = 1;
  double loss = 0.05, doubled = 0.02;
  int delay = 3;             // ticks
  std::size_t replicas = 3;  // the second joins after a third of the ticks, the third after two thirds
  int lives = 5;             // of the owner, of equal length; each begins at epoch 0
  std::size_t words = 256;   // of the state
  double changed = 4;        // words per tick, on average
};

struct DatabaseTrial {
  std::uint64_t wrong = 0;           // replicas that differed from what their owner had at their epoch of its life
  std::uint64_t went_back = 0;       // replicas that took states of an earlier life or epoch than before
  std::uint64_t unequal_at_end = 0;  // replicas that differ after the last tick, when nothing is lost any more
  std::uint64_t updates = 0, copies = 0, missed = 0, old = 0, restarts = 0;
  std::uint64_t update_bytes = 0, changed_words = 0, publications = 0;
  std::int64_t longest_age = 0;  // ticks between an owner and a complete replica
  double mean_age = 0;           // ticks
};

/// An owner and replicas, each behind networks of its own. In every tick the owner changes random words and publishes; every
/// replica is compared with what the owner had at the replica's epoch, byte for byte. Messages of an earlier life of the owner stay
/// in the networks.
inline DatabaseTrial run_database_trial(const DatabaseTrialSettings& s) {
  using namespace bus;
  const auto layout = [&] { return StateLayout({{"x", StateField::Kind::kReal, s.words, "1"}}); };
  struct Reader {
    std::unique_ptr<LossyNetwork> there, back;
    std::unique_ptr<LossyTransport> owner_end, reader_end;
    std::unique_ptr<StateExchange> owner, replica;                // all owners have the same image
    std::vector<std::pair<std::uint64_t, std::int64_t>> lives{};  // of the owner: session and the tick of epoch 0
    std::int64_t seen = 0;                                        // tick of the states that the replica had last
  };
  std::mt19937_64 random(s.seed);
  std::vector<Reader> readers(s.replicas);
  for (std::size_t r = 0; r < readers.size(); ++r) {
    Reader& reader = readers[r];
    reader.there = std::make_unique<LossyNetwork>(random(), s.loss, s.doubled, s.delay);
    reader.back = std::make_unique<LossyNetwork>(random(), s.loss, s.doubled, s.delay);
    reader.owner_end = std::make_unique<LossyTransport>(*reader.there, *reader.back);
    reader.reader_end = std::make_unique<LossyTransport>(*reader.back, *reader.there);
  }
  constexpr std::size_t kHistory = 8192;
  const std::size_t bytes = s.words * 8;
  std::vector<std::byte> image(bytes), history(kHistory * bytes);
  DatabaseTrial result;
  std::uint64_t ages = 0;
  const std::int64_t settle = 20 * (s.delay + StateExchange::kRequestEvery);
  for (std::int64_t tick = 1; tick <= s.ticks + settle; ++tick) {
    if (tick <= s.ticks) {
      const auto most = static_cast<std::uint64_t>(2 * s.changed) + 1;
      const std::uint64_t count = random() % most;
      result.changed_words += count;
      for (std::uint64_t i = 0; i < count; ++i) {
        const std::uint64_t value = random();
        std::memcpy(&image[random() % s.words * 8], &value, 8);
      }
    }
    std::copy(image.begin(), image.end(),
              history.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(tick) % kHistory * bytes));
    for (std::size_t r = 0; r < readers.size(); ++r) {
      Reader& reader = readers[r];
      if (tick <= s.ticks && (tick - 1) % ((s.ticks + s.lives - 1) / s.lives) == 0) {
        reader.owner = std::make_unique<StateExchange>(*reader.owner_end, layout(), std::nullopt);
        reader.lives.emplace_back(reader.owner->owner()->session(), tick);
      }
      if (tick == static_cast<std::int64_t>(r) * s.ticks / static_cast<std::int64_t>(s.replicas) + 1)
        reader.replica = std::make_unique<StateExchange>(*reader.reader_end, std::nullopt, layout());
      if (tick > s.ticks) {
        reader.there->set_loss(0);
        reader.back->set_loss(0);
      }
      reader.there->tick();
      reader.back->tick();
      std::copy(image.begin(), image.end(), reader.owner->owner()->image().begin());
      reader.owner->publish(tick - reader.lives.back().second);
      reader.owner->receive();
      if (!reader.replica) {
        while (!reader.there->receive().empty()) {
        }
        continue;
      }
      reader.replica->receive();
      const StateReplica& replica = *reader.replica->replica();
      if (!replica.complete()) continue;
      const auto life = std::ranges::find(reader.lives, replica.session(), &std::pair<std::uint64_t, std::int64_t>::first);
      if (life == reader.lives.end()) {
        ++result.wrong;
        continue;
      }
      const std::int64_t at = life->second + replica.epoch(), age = tick - at;
      if (at < reader.seen) ++result.went_back;
      reader.seen = at;
      ages += static_cast<std::uint64_t>(age);
      result.longest_age = std::max(result.longest_age, age);
      const std::size_t then = static_cast<std::size_t>(at) % kHistory;
      if (age >= static_cast<std::int64_t>(kHistory) || std::memcmp(replica.image().data(), &history[then * bytes], bytes) != 0)
        ++result.wrong;
    }
  }
  for (Reader& reader : readers) {
    const StateExchange::Counts &owner = reader.owner->counts(), &replica = reader.replica->counts();
    if (std::memcmp(reader.replica->replica()->image().data(), image.data(), bytes) != 0) ++result.unequal_at_end;
    result.updates += replica.updates;
    result.copies += replica.copies;
    result.old += replica.old;
    result.restarts += reader.replica->replica()->restarts();
    result.missed += reader.replica->replica()->missed();
    result.update_bytes += owner.published_bytes;
    result.publications += owner.published;
  }
  result.mean_age = static_cast<double>(ages) / static_cast<double>(s.ticks * static_cast<std::int64_t>(s.replicas));
  return result;
}

}  // namespace cotwin::testing
