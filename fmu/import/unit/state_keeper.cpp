#include "fmu/import/unit/state_keeper.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

Time StateKeeper::time_of(const std::string& bytes) {
  if (bytes.empty()) throw Error("the snapshot has no state of this FMU");
  return {ByteReader(as_bytes(bytes), "state of the FMU").value<std::int64_t>()};
}

void StateKeeper::save(ForeignInstance& instance, Time time, std::string_view extra, std::string& bytes) {
  std::uint64_t number = 0;
  if (serialises_) {
    Kept& kept = kept_.front();
    instance.save(kept.state);
    instance.serialise(kept.state, scratch_);
  } else {
    Kept& kept = place_for(bytes);
    kept.number = 0;
    instance.save(kept.state);
    kept.number = number = next_++;
  }
  ByteWriter out;
  out.value(time.ns);
  out.value(static_cast<std::uint8_t>(serialises_));
  out.text(std::string(extra));
  if (serialises_) {
    out.text(scratch_);
  } else {
    out.value(number);
  }
  bytes = out.bytes();
}

/// Where to keep a state that replaces the one in `bytes`: in its place, otherwise in that of the oldest.
StateKeeper::Kept& StateKeeper::place_for(const std::string& bytes) {
  if (!bytes.empty() && !holds_state(bytes)) {
    ByteReader in(as_bytes(bytes), "state of the FMU");
    static_cast<void>(in.value<std::int64_t>());  // time_of()
    static_cast<void>(in.value<std::uint8_t>());
    static_cast<void>(in.text());
    const auto old = std::ranges::find(kept_, in.value<std::uint64_t>(), &Kept::number);
    if (old != kept_.end()) return *old;
  }
  return *std::ranges::min_element(kept_, {}, &Kept::number);
}

std::string StateKeeper::restore(ForeignInstance& instance, const std::string& bytes) {
  if (bytes.empty()) throw Error("the snapshot has no state of this FMU");
  ByteReader in(as_bytes(bytes), "state of the FMU");
  static_cast<void>(in.value<std::int64_t>());  // time_of()
  if (in.value<std::uint8_t>() != static_cast<std::uint8_t>(serialises_)) in.fail("is the state of another FMU");
  const std::string extra = in.text();
  if (serialises_) {
    const std::string serialised = in.text();
    in.expect_end();
    void* state = instance.deserialise(serialised);
    try {
      instance.restore(state);
    } catch (...) {
      instance.free(state);
      throw;
    }
    instance.free(state);
  } else {
    const auto number = in.value<std::uint64_t>();
    in.expect_end();
    const auto kept = std::ranges::find(kept_, number, &Kept::number);
    if (number == 0 || kept == kept_.end()) {
      in.fail("is no longer kept: this FMU cannot serialise its states, and only its last " + std::to_string(kKept) +
              " are kept");
    }
    instance.restore(kept->state);
  }
  return extra;
}

bool holds_state(std::string_view saved) {
  constexpr std::size_t kFlag = sizeof(std::int64_t);  // offset of the flag, after the time
  return saved.size() > kFlag && saved[kFlag] == 1;
}

void StateKeeper::clear(ForeignInstance& instance) noexcept {
  for (Kept& kept : kept_) {
    instance.free(kept.state);
    kept.number = 0;
  }
}

}  // namespace cotwin::fmu
