#pragma once
#include <span>

#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

/// Scenes on which contact engines fail: statics that friction decides, a loaded rope, Painlevé's paradox, and balls on a board (SimBenchmark:
/// Hwangbo et al., github.com/leggedrobotics/SimBenchmark). No engine appears here. Numbers are SI; z is up.
namespace cotwin::testing {

/// A card house of `levels`: cards of 100 × 70 × 2 mm and 10 g, leaning by `lean` rad from the vertical; needs μ ≥ tan(lean).
scene::Scene card_house(int levels, double lean, double mu);
/// A semicircular arch of `wedges` voussoirs (hulls): inner radius 0.5, outer 0.65, width 0.2 m, 2000 kg/m³, on the ground.
scene::Scene arch(int wedges, double mu);
/// A ladder (box 2 × 0.3 × 0.02 m, 10 kg) at 60 degrees from the ground against a frictionless wall, with μ on the ground.
/// Bodies: ground, wall, ladder.
scene::Scene ladder(double mu);
double critical_ladder_mu();
/// Distance by which the sliding ladder's centre of mass has moved t seconds after the start, by integration (m).
double ladder_path(double mu, double t);
/// Cubes of edge 0.1 m with these masses, bottom first, on the ground.
scene::Scene stack_of_masses(std::span<const double> masses);
/// Dominoes of 10 × 50 × 100 mm and 50 g, 50 mm apart; the first is pushed.
scene::Scene dominoes(int count);

/// A rope of `links` rods (0.05 m, 10 g) with a weight of `load` kg at its end, horizontal at rest.
scene::Scene loaded_rope(int links, double load);
/// A rod of 1 m with μ that slides on the ground at 5 m/s, leaning forward by 45 degrees: Painlevé's paradox for μ > 4/3.
/// Bodies: ground, rod.
scene::Scene painleve_rod(double mu);

/// 25 balls (1 kg, r = 0.5 m) on a board (10 kg, 20 × 20 × 1 m) that a force of 150 N pulls at its centre: μ = 0.4 below,
/// 0.8 above the board. Bodies: ground, board, balls. Gravity 9.8 m/s².
scene::Scene rolling();
inline constexpr double kRollingForce = 150;  // N
/// Accelerations of board and balls in theory, m/s².
double rolling_board_acceleration();
double rolling_ball_acceleration();

}  // namespace cotwin::testing
