#pragma once
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {

/// One figure of a run; smaller is better.
struct Figure {
  std::string name, unit;
  double value = 0;
  double goal = 0;  // upper bound for Cotwin; 0: none
};

struct Case {
  std::string name;
  std::function<std::vector<Figure>(const EngineKind&)> run;  // the first figure is the time of a step
  int rounds = 1;                                             // the fastest run counts; all other figures are the same in each
  bool many_contacts = false;                                 // false for engines that pivot all contacts of a pile at once
};

/// The larger of the worst value so far and a new one; not a number stays.
inline double worst(double so_far, double now) { return now <= so_far || std::isnan(so_far) ? so_far : now; }

/// Arms, stacks, a peg in a slot, and piles that show how the time grows with the number of bodies.
std::vector<Case> scene_cases();
/// The public tests that are used to compare contact engines.
std::vector<Case> public_cases();

}  // namespace cotwin::benchmark
