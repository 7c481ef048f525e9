#pragma once
#include <string>
#include <vector>

#include "master/engine/wiring/members.h"
#include "master/engine/wiring/wiring.h"
#include "master/scenario/scenario.h"

namespace cotwin::master {

/// A component in a package.
struct PackedComponent {
  std::string source;    // "resources/drive.fmu"
  std::string values;    // "resources/drive.ssv"; "" without start values
  bool foreign = false;  // its connectors have no unit of measure; the FMU defines it
};

/// The SSP 1.0 system structure of a scenario, flat, with the Cotwin annotation. A conversion between two variables is written
/// as a linear transformation of the connection. `components[i]` belongs to `members[i]`, `links[i]` to the scenario's
/// connection i. With `scalars`, each element of a vector has its own connector and connection, "q[1]" …, as SSP 1.0 and FMI 2
/// require.
std::string to_ssd(const Scenario& scenario, const std::vector<Member>& members, const std::vector<ResolvedConnection>& links,
                   const std::vector<PackedComponent>& components, bool scalars);

}  // namespace cotwin::master
