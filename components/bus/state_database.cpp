#include "components/bus/state_database.h"

#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <random>
#include <utility>

#include "models/foundation/support/bytes.h"

namespace cotwin::bus {

namespace {

constexpr std::size_t kWord = 8, kBlock = 64;      // bytes
constexpr std::size_t kMostEarly = 8;              // updates
constexpr std::size_t kMostEarlyBytes = 1u << 20;  // of all of them

void put_text(std::vector<std::byte>& message, const std::string& text) {
  const auto length = static_cast<std::uint32_t>(text.size());
  std::memcpy(message.data() + kStateHeader, &length, sizeof length);
  std::memcpy(message.data() + kStateHeader + sizeof length, text.data(), text.size());
}

std::size_t text_bytes(const StateLayout& layout) { return kStateHeader + sizeof(std::uint32_t) + layout.text().size(); }

}  // namespace

std::uint64_t new_session() {
  static std::atomic<std::uint64_t> count = 0;
  timespec t{};
  clock_gettime(CLOCK_REALTIME, &t);
  const std::uint64_t now = static_cast<std::uint64_t>(t.tv_sec) * 1'000'000'000u + static_cast<std::uint64_t>(t.tv_nsec);
  const std::uint64_t numbers[] = {now, static_cast<std::uint64_t>(getpid()), ++count, std::random_device()()};
  return hash_of({reinterpret_cast<const char*>(numbers), sizeof numbers}) | 1;
}

StateOwner::StateOwner(StateLayout layout, std::uint64_t session)
    : layout_(std::move(layout)),
      session_(session),
      image_(layout_.bytes()),
      shadow_(layout_.bytes()),
      update_(kStateHeader + kRunHeader + layout_.bytes()),
      full_(text_bytes(layout_) + layout_.bytes()) {
  put_text(full_, layout_.text());
}

StateMessage StateOwner::header(StateMessage::Kind kind) const {
  StateMessage m;
  m.kind = kind;
  m.layout = layout_.hash();
  m.session = session_;
  m.epoch = epoch_;
  m.version = version_;
  return m;
}

// A run goes on over one word without change, which takes no more bytes than a new run would.
std::span<const std::byte> StateOwner::publish(std::int64_t epoch) {
  std::size_t end = kStateHeader, run = 0;  // end of the message; place of the last run's header, 0: none
  std::size_t run_end = 0;                  // in the image
  std::uint32_t runs = 0;
  const auto close = [&] {
    if (run == 0) return;
    std::uint32_t offset = 0;
    std::memcpy(&offset, &update_[run], sizeof offset);
    const std::uint32_t length = static_cast<std::uint32_t>(run_end) - offset;
    std::memcpy(&update_[run + 4], &length, sizeof length);
    std::memcpy(&update_[run + kRunHeader], &image_[offset], length);
    end = run + kRunHeader + length;
  };
  for (std::size_t block = 0; block < image_.size(); block += kBlock) {
    const std::size_t block_end = std::min(block + kBlock, image_.size());
    if (std::memcmp(&image_[block], &shadow_[block], block_end - block) == 0) continue;
    for (std::size_t i = block; i < block_end; i += kWord) {
      if (std::memcmp(&image_[i], &shadow_[i], kWord) == 0) continue;
      if (run == 0 || i > run_end + kWord) {
        close();
        run = end;
        const auto offset = static_cast<std::uint32_t>(i);
        std::memcpy(&update_[run], &offset, sizeof offset);
        ++runs;
      }
      run_end = i + kWord;
    }
    std::memcpy(&shadow_[block], &image_[block], block_end - block);
  }
  close();
  epoch_ = epoch;
  const bool first = version_ == 0;
  if (runs > 0 || first) ++version_;
  StateMessage m = header(StateMessage::Kind::kUpdate);
  m.base = runs > 0 ? version_ - 1 : version_;
  m.runs = runs;
  write_header(update_, m, end - kStateHeader);
  return std::span(update_).first(end);
}

std::span<const std::byte> StateOwner::full(std::uint64_t request) {
  if (version_ == 0) return {};
  std::memcpy(full_.data() + text_bytes(layout_), shadow_.data(), shadow_.size());
  StateMessage m = header(StateMessage::Kind::kFull);
  m.base = request;
  write_header(full_, m, full_.size() - kStateHeader);
  return full_;
}

StateReplica::StateReplica(StateLayout layout)
    : layout_(std::move(layout)),
      requested_(new_session()),
      answered_(requested_),
      image_(layout_.bytes()),
      request_(text_bytes(layout_)) {
  early_.resize(std::min(kMostEarly, kMostEarlyBytes / layout_.bytes()));
  for (Early& e : early_) e.runs.resize(kRunHeader + layout_.bytes());
  put_text(request_, layout_.text());
}

Reception StateReplica::receive(std::span<const std::byte> message) {
  const std::uint8_t format = state_wire_format(message);
  if (format != 0 && format != kStateWireFormat) return Reception::kOtherFormat;
  StateMessage m;
  if (!decode(message, layout_.hash(), image_.size(), m) || m.kind == StateMessage::Kind::kRequest) return Reception::kDamaged;
  if (m.layout != layout_.hash()) {
    if (m.kind == StateMessage::Kind::kFull) other_layout_ = m.text;
    return Reception::kOtherLayout;
  }
  return m.kind == StateMessage::Kind::kUpdate ? update(m) : copy(m);
}

Reception StateReplica::update(const StateMessage& m) {
  newest_ = m.session == wanted_session_ ? std::max(newest_, m.version) : m.version;
  wanted_session_ = m.session;
  if (m.session != session_ || !complete()) return Reception::kGap;
  if (m.version < version_ || (m.version == version_ && (m.base != version_ || m.epoch <= epoch_))) return Reception::kOld;
  if (m.base == version_) {
    apply(m);
    apply_early();
    return Reception::kUpdated;
  }
  if (m.base == m.version || m.version - version_ > early_.size() || m.payload.size() > early_[0].runs.size())
    return Reception::kGap;
  Early& e = early_[m.version % early_.size()];
  e.version = m.version;
  e.epoch = m.epoch;
  e.size = m.payload.size();
  std::memcpy(e.runs.data(), m.payload.data(), e.size);
  return Reception::kEarly;
}

void StateReplica::apply(const StateMessage& m) {
  write_runs(m, image_);
  version_ = m.version;
  epoch_ = m.epoch;
}

void StateReplica::apply_early() {
  for (std::size_t i = 0; i < early_.size(); ++i) {
    const Early& e = early_[(version_ + 1) % early_.size()];
    if (e.version != version_ + 1) return;
    StateMessage m;
    m.version = e.version;
    m.epoch = e.epoch;
    m.payload = std::span(e.runs).first(e.size);
    apply(m);
  }
}

// The versions of a session count from the last full copy: a damaged number is forgotten with it.
Reception StateReplica::copy(const StateMessage& m) {
  const bool same = complete() && m.session == session_;
  if (!same && m.base - answered_ - 1 >= requested_ - answered_) return Reception::kOld;  // modulo 2^64
  newest_ = m.version;
  wanted_session_ = m.session;
  if (same) {
    if (m.version < version_ || (m.version == version_ && m.epoch <= epoch_)) return Reception::kOld;
    missed_ += m.version - version_;
  } else {
    follow(m.session);
  }
  std::memcpy(image_.data(), m.payload.data(), image_.size());
  version_ = m.version;
  epoch_ = m.epoch;
  other_layout_.clear();
  apply_early();
  return Reception::kCopied;
}

void StateReplica::follow(std::uint64_t session) {
  if (complete()) {
    if (std::find(former_.begin(), former_.end(), session) != former_.end()) ++returns_;
    former_[restarts_++ % former_.size()] = session_;
  }
  session_ = session;
  answered_ = requested_;
  for (Early& e : early_) e.version = 0;
}

std::span<const std::byte> StateReplica::request() {
  StateMessage m;
  m.kind = StateMessage::Kind::kRequest;
  m.layout = layout_.hash();
  m.session = wanted_session_;
  m.version = version_;
  m.base = ++requested_;
  write_header(request_, m, request_.size() - kStateHeader);
  return request_;
}

}  // namespace cotwin::bus
