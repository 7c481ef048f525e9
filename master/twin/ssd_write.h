#pragma once
#include <string>
#include <vector>

#include "master/run/members.h"
#include "master/run/wiring.h"
#include "master/ssp/scenario.h"

namespace cotwin::master {

/// A component as it goes into a package.
struct PackedComponent {
  std::string source;    // "resources/drive.fmu"
  std::string values;    // "resources/drive.ssv"; "" if it has no start values of its own
  bool foreign = false;  // its connectors have the units of measure that the FMU itself tells
};

/// The SSP 1.0 system structure of a scenario, flat, with our annotation. Connections say the whole conversion between the two
/// variables as a linear transformation wherever there is one. `components` go with `members`, `links` with the scenario's
/// connections. With `scalars` a vector is as many connectors and connections, "q[1]" …, as SSP 1.0 and FMI 2 want it.
std::string to_ssd(const Scenario& scenario, const std::vector<Member>& members, const std::vector<Link>& links,
                   const std::vector<PackedComponent>& components, bool scalars);

}  // namespace cotwin::master
