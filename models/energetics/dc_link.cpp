#include "models/energetics/dc_link.h"

#include <algorithm>
#include <cmath>

namespace cotwin::energetics {

double draw(const DcLink& link, double V, const Cubic& p, double h, LinkFlows& flows) {
  const double least = link.stored(link.V_min), most = link.stored(link.V_max);
  double stored = link.stored(V), before = 0;
  const Crossings zeros = crossings(p);
  for (std::size_t k = 0; k <= zeros.count; ++k) {
    const double upto = integral(p, k < zeros.count ? zeros.s[k] : 1);
    stored -= h * (upto - before);
    before = upto;
    if (stored < least) {
      flows.supplied += least - stored;
      stored = least;
    } else if (stored > most) {
      flows.chopped += stored - most;
      stored = most;
    }
  }
  return link.C > 0 ? std::sqrt(2 * stored / link.C) : link.V_min;
}

}  // namespace cotwin::energetics
