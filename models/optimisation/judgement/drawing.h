#pragma once
#include <cstdint>
#include <vector>

#include "models/optimisation/evaluation/evaluation.h"

namespace cotwin::optimisation {

/// Postures of which each motion takes one: those of a list in turn, or without a list any one of a box.
struct PostureSet {
  std::vector<std::vector<double>> list;  // n each
  std::vector<double> low, high;          // n each
};

/// How motions are drawn at random: motion k is a function of the problem and of these alone.
struct Drawing {
  PostureSet from, to;  // in place of those of Problem::ends
  std::vector<double>
      c_max;  // n, rad or m: c_r = r · c_max · u, r uniform in [0, 1], each u in [−1, 1]: as many near the quintic as far
  std::uint64_t seed = 1;
};

/// Motions without content for draw().
Motions room_for(const Problem& problem);
/// Sets motion `number` in one lane; ln T is uniform from ln T_min to ln T_max.
void draw(const Problem& problem, const Drawing& drawing, std::uint32_t number, Motions& motions, std::size_t lane);

}  // namespace cotwin::optimisation
