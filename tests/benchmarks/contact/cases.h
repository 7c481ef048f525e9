#pragma once
#include <limits>
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
  std::vector<Figure> (*run)(const EngineKind& engine);  // the first figure is the time of a step
  int rounds = 1;                                        // the fastest run counts; all other figures are the same in each
  bool many_contacts = false;                            // false for engines that pivot all contacts of a pile at once
};

/// The scenes of the contact world's issue, and one that shows how the time grows with the number of bodies.
std::vector<Case> scene_cases();
/// The public tests that are used to compare contact engines.
std::vector<Case> public_cases();

}  // namespace cotwin::benchmark
