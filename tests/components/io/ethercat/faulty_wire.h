#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <random>
#include <span>
#include <vector>

#include "components/io/ethercat/frame.h"
#include "components/io/ethercat/master/wire.h"

namespace cotwin::ethercat {

/// A wire that loses, doubles and reorders frames, and on which others send. Rates are shares of the frames.
class FaultyWire final : public Wire {
 public:
  explicit FaultyWire(Wire& wire, unsigned seed = 1) : random_(seed), wire_(wire) {}

  double loss = 0, duplicates = 0, reordering = 0, foreign = 0;
  /// Decide about single frames: true loses it. `sent`: on its way to the slaves; `returned`: on its way back.
  std::function<bool(std::span<const std::uint8_t>)> loses_sent, loses_returned;
  /// Changes a frame that comes back.
  std::function<void(std::span<std::uint8_t>)> changes;
  int lost = 0, doubled = 0, swapped = 0, injected = 0;

  bool send(std::span<const std::uint8_t> frame) override {
    if ((loses_sent && loses_sent(frame)) || happens(loss)) {
      ++lost;
      return true;
    }
    return wire_.send(frame);
  }
  std::size_t receive(std::span<std::uint8_t> buffer, std::int64_t deadline) override {
    for (std::size_t size; (size = wire_.receive(buffer, waiting_.empty() ? deadline : 0)) > 0;) {
      std::vector<std::uint8_t> frame(buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(size));
      if ((loses_returned && loses_returned(frame)) || happens(loss)) {
        ++lost;
        continue;
      }
      if (changes) changes(frame);
      if (happens(foreign)) {
        ++injected;
        waiting_.push_back(stranger());
      }
      if (happens(duplicates)) {
        ++doubled;
        waiting_.push_back(frame);
      }
      if (happens(reordering) && !waiting_.empty()) {
        ++swapped;
        waiting_.push_front(std::move(frame));
      } else if (happens(reordering)) {
        ++swapped;
        late_.push_back(std::move(frame));  // after the next one
        continue;
      } else {
        waiting_.push_back(std::move(frame));
      }
      for (; !late_.empty(); late_.pop_front()) waiting_.push_back(late_.front());
    }
    if (waiting_.empty()) return 0;
    const std::size_t size = waiting_.front().size();
    std::copy(waiting_.front().begin(), waiting_.front().end(), buffer.begin());
    waiting_.pop_front();
    return size;
  }
  std::int64_t now() const override { return wire_.now(); }
  std::int64_t received_at() const override { return wire_.received_at(); }

 private:
  bool happens(double rate) { return rate > 0 && static_cast<double>(random_() % 1'000'000) < 1e6 * rate; }
  /// A frame of another master: any index, and data that would be wrong here.
  std::vector<std::uint8_t> stranger() {
    std::array<std::uint8_t, kLongestFrame> buffer{};
    FrameWriter writer(buffer);
    writer.begin();
    std::vector<std::uint8_t> data(1 + random_() % 60, 0xff);
    constexpr std::array kCommands = {Command::kLrw, Command::kBrd, Command::kFprd, Command::kFrmw, Command::kLwr};
    const Command command = kCommands[random_() % kCommands.size()];
    writer.add(command, static_cast<std::uint8_t>(random_()), static_cast<std::uint32_t>(random_()), data);
    const auto frame = writer.finish();
    return {frame.begin(), frame.end()};
  }

  std::mt19937 random_;
  Wire& wire_;
  std::deque<std::vector<std::uint8_t>> waiting_, late_;
};

}  // namespace cotwin::ethercat
