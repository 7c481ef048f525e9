#include "components/io/fri/fri.h"

#include <algorithm>

#include "components/io/fri/lwr.h"
#include "components/io/fri/sunrise.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"

namespace cotwin::fri {

namespace {

constexpr std::pair<const char*, Protocol> kWords[] = {
    {"lwr", Protocol::kLwr},
    {"sunrise-1.11", Protocol::kSunrise1_11},
    {"sunrise-1.14", Protocol::kSunrise1_14},
    {"sunrise-1.15", Protocol::kSunrise1_15},
    {"sunrise-1.16", Protocol::kSunrise1_16},
    {"sunrise-2.5", Protocol::kSunrise2_5},
    {"sunrise-2.7", Protocol::kSunrise2_7},
};

}  // namespace

const char* to_text(Protocol protocol) { return text::word_of(protocol, kWords); }

Protocol protocol_of(const std::string& word, const std::string& place) { return text::choose(place, word, kWords); }

void check_joints(Protocol protocol, std::size_t joints, const std::string& place) {
  const bool lwr = protocol == Protocol::kLwr;
  if (lwr ? joints == lwr::kJoints : joints >= 1 && joints <= kMaxJoints) return;
  throw Error(place, std::string("protocol ") + to_text(protocol) + " with " + std::to_string(joints) + " joints, expected " +
                         (lwr ? "7" : "1 to " + std::to_string(kMaxJoints)));
}

const char* to_text(Fault fault) {
  constexpr std::array<const char*, kFaults> kTexts{"none",    "size",  "identifier", "truncated",  "wire_type", "count",
                                                    "missing", "value", "checksum",   "not_finite", "stranger"};
  return kTexts.at(static_cast<std::size_t>(fault));
}

bool Name::assign(std::string_view text) {
  if (text.size() > kMaxName) return false;
  std::copy(text.begin(), text.end(), text_.begin());
  size_ = static_cast<std::uint8_t>(text.size());
  return true;
}

std::size_t encode(Protocol protocol, const Monitoring& message, std::span<std::uint8_t> bytes) {
  return protocol == Protocol::kLwr ? lwr::encode(message, bytes) : sunrise::encode(protocol, message, bytes);
}

std::size_t encode(Protocol protocol, const Command& message, std::span<std::uint8_t> bytes) {
  return protocol == Protocol::kLwr ? lwr::encode(message, bytes) : sunrise::encode(protocol, message, bytes);
}

Fault decode(Protocol protocol, std::span<const std::uint8_t> bytes, std::size_t joints, Monitoring& message) {
  return protocol == Protocol::kLwr ? lwr::decode(bytes, message) : sunrise::decode(protocol, bytes, joints, message);
}

Fault decode(Protocol protocol, std::span<const std::uint8_t> bytes, std::size_t joints, Command& message) {
  return protocol == Protocol::kLwr ? lwr::decode(bytes, message) : sunrise::decode(protocol, bytes, joints, message);
}

}  // namespace cotwin::fri
