#include "fmu/import/unit/state_keeper.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace {

/// The parts of saved bytes.
struct Saved {
  explicit Saved(const std::string& bytes) : in(as_bytes(bytes), StateKeeper::kPlace) {
    if (bytes.empty()) throw Error("the snapshot has no state of this FMU");
    time.ns = in.value<std::int64_t>();
    is_serialised = in.value<std::uint8_t>() != 0;
    extra = text();
    if (is_serialised) {
      serialised = text();
    } else {
      number = in.value<std::uint64_t>();
    }
    in.expect_end();
  }
  std::string_view text() {
    const std::size_t n = in.count(1);
    const auto* const begin = reinterpret_cast<const char*>(in.rest().data());
    in = ByteReader(in.rest().subspan(n), StateKeeper::kPlace);
    return {begin, n};
  }

  ByteReader in;
  Time time;
  bool is_serialised = false;
  std::string_view extra, serialised;
  std::uint64_t number = 0;
};

ByteWriter begin(std::string& bytes, Time time, bool is_serialised, std::string_view extra) {
  ByteWriter out(std::move(bytes));
  out.value(time.ns);
  out.value(static_cast<std::uint8_t>(is_serialised));
  out.text(extra);
  return out;
}

}  // namespace

Time StateKeeper::time_of(const std::string& bytes) {
  if (bytes.empty()) throw Error("the snapshot has no state of this FMU");
  return {ByteReader(as_bytes(bytes), StateKeeper::kPlace).value<std::int64_t>()};
}

void StateKeeper::save(ForeignInstance& instance, Time time, std::string_view extra, std::string& bytes) {
  if (!serialises_) return save_here(instance, time, extra, bytes);
  instance.save(passing_);
  instance.serialise(passing_, scratch_);
  ByteWriter out = begin(bytes, time, true, extra);
  out.text(scratch_);
  bytes = out.take();
}

void StateKeeper::save_here(ForeignInstance& instance, Time time, std::string_view extra, std::string& bytes) {
  Kept& kept = place_for(bytes);
  kept.number = 0;
  kept.serialised.clear();
  instance.save(kept.state);
  kept.number = next_++;
  ByteWriter out = begin(bytes, time, false, extra);
  out.value(kept.number);
  bytes = out.take();
}

/// Where to keep a state that replaces the one in `bytes`: in its place, otherwise in that of the oldest.
StateKeeper::Kept& StateKeeper::place_for(const std::string& bytes) {
  if (!bytes.empty() && !holds_state(bytes)) {
    const auto old = std::ranges::find(kept_, Saved(bytes).number, &Kept::number);
    if (old != kept_.end()) return *old;
  }
  return *std::ranges::min_element(kept_, {}, &Kept::number);
}

void StateKeeper::restore_serialised(ForeignInstance& instance, std::string_view serialised) {
  void* state = instance.deserialise(serialised);
  try {
    instance.restore(state);
  } catch (...) {
    instance.free(state);
    throw;
  }
  instance.free(state);
}

std::string_view StateKeeper::restore(ForeignInstance& instance, const std::string& bytes) {
  const Saved saved(bytes);
  if (saved.is_serialised) {
    if (!serialises_) saved.in.fail("is the state of another FMU");
    restore_serialised(instance, saved.serialised);
    return saved.extra;
  }
  const auto kept = std::ranges::find(kept_, saved.number, &Kept::number);
  if (saved.number == 0 || kept == kept_.end()) {
    saved.in.fail("is no longer kept: this FMU cannot serialise its states, and only its last " + std::to_string(kKept) +
                  " are kept");
  }
  if (kept->serialised.empty()) {
    instance.restore(kept->state);
  } else {
    restore_serialised(instance, kept->serialised);
  }
  return saved.extra;
}

bool holds_state(std::string_view saved) {
  constexpr std::size_t kFlag = sizeof(std::int64_t);  // offset of the flag, after the time
  return saved.size() > kFlag && saved[kFlag] == 1;
}

void StateKeeper::leave(ForeignInstance& instance) noexcept {
  for (Kept& kept : kept_) {
    if (!serialises_ || kept.number == 0 || kept.state == nullptr) continue;
    try {
      instance.serialise(kept.state, kept.serialised);
    } catch (...) {  // not after a fatal error: the state is lost
      kept.serialised.clear();
    }
  }
  clear(instance);
}

void StateKeeper::clear(ForeignInstance& instance) noexcept {
  for (Kept& kept : kept_) {
    instance.free(kept.state);
    if (kept.serialised.empty()) kept.number = 0;
  }
  instance.free(passing_);
}

}  // namespace cotwin::fmu
