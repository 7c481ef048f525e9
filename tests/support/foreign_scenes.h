#pragma once
#include <cstdint>

#include "models/scene/scene.h"

/// Further scenes for engines, of kinds that nobody asked for: damaged, contradicting, unequal, huge, tiny, fast. As in
/// hard_scenes.h.
namespace cotwin::testing {

/// Slider-crank: crank 0.2, rod 0.5, slider on the x axis; starts in the dead centre at `speed` rad/s of the crank.
scene::Scene slider_crank(double speed);
/// `count` rods of 0.1 m joined by spherical joints to a ring that hangs on its first rod's middle.
scene::Scene necklace(int count);
/// A rope of `links` rods (0.05 m, 10 g) with a weight of `load` kg at its end, horizontal at rest.
scene::Scene loaded_rope(int links, double load);
/// A triangle of three bars and three hinges about y, of which the last does not close by `gap` (m): a damaged, rigid structure,
/// hanging from its first bar's hinge.
scene::Scene open_triangle(double gap);
/// `boxes` cubes of this edge (water) on each other.
scene::Scene stack_of_edge(int boxes, double edge);
/// A small ball of `ratio` times the mass (1 kg) on top of a large one, dropped from 1 m, e = 1, μ = 0, 1 mm between them.
scene::Scene ball_on_ball(double ratio);
/// A rod of 1 m with μ that slides on the ground at 5 m/s, leaning forward by 45 degrees: Painlevé's paradox for μ > 4/3.
scene::Scene painleve_rod(double mu);
/// A disc (cylinder, r = 0.1, 10 mm, 1 kg) spinning on its flat side at `speed` rad/s; μ = 0.2.
scene::Scene spinning_disc(double speed);
/// A ball pressed by its weight into a groove of two boxes whose faces are at ±`half_angle` from the vertical.
scene::Scene wedged_ball(double half_angle, double mu);
/// Two equal cubes at the same place, and one 50 mm deep in the ground.
scene::Scene coincident_boxes();
/// A cube of 0.1 m thrown at `speed` onto the ground, rotating at 100 rad/s.
scene::Scene fast_box(double speed);
/// A rod of 1 m about a hinge at 300 rad/s whose tip hits a plate of 5 mm.
scene::Scene fast_rod();
/// Two balls of 10 mm that fly towards each other at `speed` each.
scene::Scene two_bullets(double speed);
/// `rows` rows of bricks (0.2 × 0.1 × 0.1 m) as a wall; every second row is
/// shifted by 60 mm.
scene::Scene brick_wall(int rows);
/// A pyramid (hull) on its tip, exactly above it, on the ground.
scene::Scene pyramid_on_tip();
/// Plates of 0.2 × 0.2 m and 0.1 mm (8 g) dropped flat, 20 mm apart.
scene::Scene thin_plates(int count);
/// A stack of 11 whose lowest box has contacts of this stiffness (N/m, no damping) on both sides: soft and rigid contacts mixed.
scene::Scene soft_stack(double stiffness);

}  // namespace cotwin::testing
