#pragma once
#include <string_view>

#include "master/scenario/scenario.h"

namespace cotwin::master {

/// Adds the events of `--event 't=TIME COMPONENT.VARIABLE=VALUE …'`: changes of one or more variables at that time, at once or with
/// `ramp=TIME`. Times are as in an Event; a vector's values follow one another with blanks. Throws Error for a malformed text and an
/// unknown component.
void add_event(Scenario& scenario, std::string_view text);

}  // namespace cotwin::master
