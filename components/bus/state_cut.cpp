#include "components/bus/state_cut.h"

#include <algorithm>
#include <cstring>

namespace cotwin::bus {

namespace {

constexpr std::size_t kEpoch = sizeof(std::int64_t);
constexpr std::size_t kHead = kEpoch + sizeof(std::uint64_t);  // before an image: epoch and session

std::size_t cut_bytes(const std::vector<StateCut::Database>& databases) {
  std::size_t bytes = kEpoch;
  for (const StateCut::Database& d : databases) bytes += kHead + d.bytes;
  return bytes;
}

std::int64_t epoch_at(std::span<const std::byte> bytes, std::size_t place) {
  std::int64_t epoch;
  std::memcpy(&epoch, bytes.data() + place, sizeof epoch);
  return epoch;
}

}  // namespace

StateCut::StateCut(std::vector<Database> databases, std::size_t depth)
    : depth_(std::max<std::size_t>(depth, 1)), cuts_(cut_bytes(databases)) {
  std::size_t place = kEpoch;
  for (const Database& d : databases) {
    histories_.push_back(
        {d, place, std::vector<std::int64_t>(depth_, kNone), std::vector<std::byte>(depth_ * d.bytes), depth_ - 1, 0});
    place += kHead + d.bytes;
  }
  // What the reader sees before the first cut.
  for (int i = 0; i < 3; ++i) {
    std::memcpy(cuts_.back().data(), &kNone, sizeof kNone);
    cuts_.publish();
    cuts_.take();
  }
}

std::size_t StateCut::find(const History& h, std::int64_t epoch) const {
  for (std::size_t age = 0; age < depth_; ++age) {
    const std::size_t slot = (h.newest + depth_ - age) % depth_;
    if (h.epochs[slot] == kNone) break;
    if (h.epochs[slot] <= epoch) return slot;
  }
  return depth_;
}

/// The newest epoch at which every database has a publication that holds; kNone if there is none in the histories.
std::int64_t StateCut::newest_cut() const {
  std::int64_t epoch = std::numeric_limits<std::int64_t>::max();
  for (std::size_t i = 0; i < histories_.size();) {
    const History& h = histories_[i];
    const std::size_t slot = find(h, epoch);
    if (slot == depth_) return kNone;
    const std::int64_t end = h.epochs[slot] + h.database.period - 1;
    if (end < epoch) {
      epoch = end;  // the ones before may have changed since then
      i = 0;
    } else {
      ++i;
    }
  }
  return epoch;
}

/// Whether the databases of each owner are of the same session.
bool StateCut::one_life() const {
  for (const History& a : histories_) {
    for (const History& b : histories_)
      if (a.database.owner == b.database.owner && a.session != b.session) return false;
  }
  return true;
}

void StateCut::add(std::size_t database, std::uint64_t session, std::int64_t epoch, std::span<const std::byte> image) {
  History& added = histories_[database];
  if (added.session != session) {
    added.session = session;
    std::fill(added.epochs.begin(), added.epochs.end(), kNone);
    last_ = kNone;
  }
  if (added.epochs[added.newest] != epoch) added.newest = (added.newest + 1) % depth_;
  added.epochs[added.newest] = epoch;
  std::memcpy(&added.images[added.newest * added.database.bytes], image.data(), added.database.bytes);
  if (!one_life()) return;
  const std::int64_t cut = newest_cut();
  if (cut == kNone || (last_ != kNone && cut <= last_)) return;
  last_ = cut;
  const std::span<std::byte> to = cuts_.back();
  std::memcpy(to.data(), &cut, sizeof cut);
  for (const History& h : histories_) {
    const std::size_t slot = find(h, cut);
    std::memcpy(&to[h.place], &h.epochs[slot], kEpoch);
    std::memcpy(&to[h.place + kEpoch], &h.session, sizeof h.session);
    std::memcpy(&to[h.place + kHead], &h.images[slot * h.database.bytes], h.database.bytes);
  }
  cuts_.publish();
}

bool StateCut::take() { return cuts_.take(); }

std::int64_t StateCut::epoch() const { return epoch_at(cuts_.front(), 0); }

std::int64_t StateCut::published(std::size_t database) const { return epoch_at(cuts_.front(), histories_[database].place); }

std::uint64_t StateCut::session(std::size_t database) const {
  std::uint64_t session;
  std::memcpy(&session, cuts_.front().data() + histories_[database].place + kEpoch, sizeof session);
  return session;
}

std::span<const std::byte> StateCut::image(std::size_t database) const {
  const History& h = histories_[database];
  return cuts_.front().subspan(h.place + kHead, h.database.bytes);
}

}  // namespace cotwin::bus
