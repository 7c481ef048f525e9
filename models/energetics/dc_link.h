#pragma once
#include "models/energetics/cubic.h"

namespace cotwin::energetics {

/// How the drives of a robot are supplied.
enum class Bus {
  kSeparate,  // each drive has its own rectifier: what one joint returns is burnt in its own brake resistor
  kShared,    // one DC link behind a diode rectifier, with a capacitor and a chopper
  kGrid       // one DC link whose front end holds its voltage and feeds back into the grid
};

/// The DC link of Bus::kShared:
///   C U U̇ = P_supply − P − P_chopper
/// with the power P that the drives take. The diode rectifier feeds only: it holds U at V_min when P would lower it further. The
/// chopper holds U at V_max. With C = 0 nothing is stored.
struct DcLink {
  double C = 0;                   // F
  double V_min = 48, V_max = 60;  // V, 0 < V_min ≤ V_max

  double stored(double V) const { return 0.5 * C * V * V; }  // J
};

/// Energies that passed the DC link, J.
struct LinkFlows {
  double supplied = 0;  // by the rectifier or front end into the link
  double returned = 0;  // by the front end into the grid
  double chopped = 0;   // in brake resistors
};

/// Takes the power p (W over the share of an interval of `h` seconds; negative: given to the link) from a link with the voltage V,
/// adds to `flows`, and returns the voltage after the interval. Exact: the interval is divided where p changes its sign; in each
/// part ½ C V² changes in one direction and reaches a bound once.
double draw(const DcLink& link, double V, const Cubic& p, double h, LinkFlows& flows);

}  // namespace cotwin::energetics
