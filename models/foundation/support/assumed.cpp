#include "models/foundation/support/assumed.h"

#include <algorithm>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin {

void check_assumed(const std::string& place, const std::string& assumed, std::span<const char* const> known) {
  if (assumed == "all" || assumed == "none") return;
  for (const std::string_view part : text::split(assumed, ' ')) {
    const std::string_view name = text::trim(part);
    if (name.empty() || std::ranges::any_of(known, [&](const char* one) { return name == one; })) continue;
    throw Error(place, "'" + std::string(name) + "', expected names of parameters as " + known[0] + " " + known[1] + " " +
                           known[2] + ", or all, or none");
  }
}

bool is_assumed(std::string_view assumed, std::string_view name) {
  if (assumed == "all") return true;
  const auto parts = text::split(assumed, ' ');
  return std::ranges::any_of(parts, [&](std::string_view part) { return text::trim(part) == name; });
}

}  // namespace cotwin
