#pragma once
#include <set>
#include <string>
#include <vector>

#include "master/engine/wiring/members.h"
#include "master/engine/wiring/wiring.h"
#include "master/scenario/scenario.h"

namespace cotwin::master {

/// A component in a package.
struct PackedComponent {
  std::string source;                 // "resources/drive.fmu"
  std::string values;                 // the ssv:ParameterSet of its start values; "" without any
  bool foreign = false;               // its connectors have no unit of measure; the FMU defines it
  std::set<std::string> valued = {};  // the names in `values`
};

/// The SSP 1.0 system structure of a scenario, flat, with the Cotwin annotation and the step in those of OMSimulator and libcosim. A
/// conversion between two variables is written as a linear transformation of the connection. `components[i]` belongs to
/// `members[i]`, `links[i]` to the scenario's connection i. With `scalars`, each element of a vector has its own connector and
/// connection, "q[1]" …, as SSP 1.0 and FMI 2 require. Connectors are the outputs, and those inputs and parameters that are connected or
/// have a start value. docs/interoperability.md says which tool requires what of this form.
std::string to_ssd(const Scenario& scenario, const std::vector<Member>& members, const std::vector<ResolvedConnection>& links,
                   const std::vector<PackedComponent>& components, bool scalars);

}  // namespace cotwin::master
