#pragma once
#include <string>
#include <string_view>
#include <utility>

#include "models/foundation/support/text.h"

namespace cotwin::distance {

/// The names in "link_5:table", of which each may have colons itself: those that are known, otherwise those beside the first colon. The second one
/// is empty without a colon.
template <class IsKnown>
std::pair<std::string, std::string> two_names(std::string_view pair, const IsKnown& is_known) {
  std::pair<std::string, std::string> first{text::trim(pair), ""};
  for (std::size_t colon = pair.find(':'); colon != std::string_view::npos; colon = pair.find(':', colon + 1)) {
    std::pair<std::string, std::string> names{text::trim(pair.substr(0, colon)), text::trim(pair.substr(colon + 1))};
    if (is_known(names.first) && is_known(names.second)) return names;
    if (first.second.empty()) first = names;
  }
  return first;
}

}  // namespace cotwin::distance
