// Any bytes are a scenario or an Error; in a scenario every name refers to a component. References are resolved to files of the
// test.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "master/scenario/scenario.h"
#include "models/foundation/support/error.h"
#include "tests/support/places.h"

namespace {

bool known(const cotwin::master::Scenario& s, const std::string& component) {
  return std::any_of(s.components.begin(), s.components.end(), [&](const auto& c) { return c.name == component; });
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    cotwin::master::Scenario s =
        cotwin::master::parse_scenario(text, "input", cotwin::places::source() + "/tests/master/data/vehicle");
    for (const auto& c : s.connections) {
      if (!known(s, c.from.component) || !known(s, c.to.component)) std::abort();
    }
    for (const auto& e : s.events) {
      if (!cotwin::master::split_name(s, e.variable)) std::abort();
    }
    if (s.tick.ns < 1 || s.stop < s.start) std::abort();
    // A later part of the input is used as an argument of --set.
    cotwin::master::assign(s, text.substr(size - std::min<std::size_t>(size, 16)));
  } catch (const cotwin::Error&) {
  }
  return 0;
}
