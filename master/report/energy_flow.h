#pragma once
#include <optional>
#include <string>
#include <vector>

#include "master/results/results.h"

/// Where the energy of a run came from and where it went, from the books of unit:energy.
namespace cotwin::report {

struct FlowEntry {
  std::string name;
  double joules = 0;
};

/// The books of one energy unit. Sources and sinks are positive; by construction of the unit their sums are equal.
struct EnergyFlow {
  std::string component;
  std::vector<FlowEntry> sources, sinks;
  double drawn = 0;                                     // J, from the mains
  double motor_work = 0;                                // J, net
  std::optional<double> friction, residual, cost, co2;  // J, J, of price_per_kWh's currency, kg
};

/// The flows of all energy units of a run: from the values at its end in the summary, otherwise from the last row of the
/// recording. Units whose books were neither are left out.
std::vector<EnergyFlow> energy_flows(const Results& results);

/// Bands from the sources through the DC link to the sinks, as wide as their energy.
std::string flow_svg(const EnergyFlow& flow);

}  // namespace cotwin::report
