#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

/// Scenes on which contact engines fail: closed loops at singular poses, several impacts at once, friction-critical statics, round
/// and fast bodies, overlap, soft contacts; and those of SimBenchmark (Hwangbo et al., github.com/leggedrobotics/SimBenchmark). No
/// engine appears here. Numbers are SI; z is up.
namespace cotwin::testing {

// ---- Closed loops. Bars of 1 kg/m without shapes, in the plane x–z, hinged to the world.

/// Four-bar linkage: two cranks of `crank` hinged to the world at the distance `base` on the x axis, and a coupler of the same
/// length `base`. At angle 0 all bars lie on one line (a change point). Starts at rest at `angle` above it.
scene::Scene parallelogram(double base, double crank, double angle);
/// The same with a third crank at the coupler's middle: overconstrained in the plane too.
scene::Scene double_parallelogram(double base, double crank, double angle);
/// Both move like one pendulum: angle of the cranks t seconds after the start, by integration, rad.
double parallelogram_angle(double base, double crank, int cranks, double angle, double t);
/// Bricard's 6R mechanism: five rods of 1 m and 1 kg along edges of a cube and six hinges, overconstrained, one degree of freedom;
/// the benchmark of the IFToMM library. Gravity along −y.
scene::Scene bricard();
/// `links` rods of 0.1 m and 0.1 kg, hinged to each other and to the world, horizontal at rest.
scene::Scene chain(int links);

// ---- Several impacts at once, e = 1, μ = 0

/// Newton's cradle: balls of 0.1 kg and 25 mm radius on rods of 0.3 m without mass, `gap` between them; the first is raised by
/// 0.5 rad.
scene::Scene cradle(int count, double gap);
/// Speed of the first ball when it hits, m/s.
double cradle_speed();
/// A ball that slides at 1 m/s into a row of `count` others on a plane, `gap` between them.
scene::Scene row_of_balls(int count, double gap);
/// A ball that hits a square of n × n touching balls on a plane at 3 m/s along the middle of one side, off centre by 1/10 of a
/// radius.
scene::Scene square_break(int n);

// ---- Friction-critical statics. Each stands in theory.

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

// ---- Shapes, speed, overlap, softness

/// Boxes, cylinders, capsules and balls of 50 to 100 mm in layers above a bin of 0.6 × 0.6 m (bodies 0 … 4).
scene::Scene mixed_pile(int count, std::uint64_t seed);
/// A ball of 10 mm diameter and 4 g that flies along x at `speed` towards a static wall of thickness `thickness` whose front face
/// is at x = 0, from x = −1 m. No gravity. Bodies: wall, ball.
scene::Scene bullet(double speed, double thickness);
/// Two cubes of edge 0.1 m and 1 kg at rest that overlap by `depth` along x. No gravity.
scene::Scene overlapping_boxes(double depth);
/// A ball of 1 kg and 0.1 m that falls 0.0490 m onto a plane (0.981 m/s); contact stiffness in N/m, no damping.
scene::Scene soft_ball(double stiffness);
double soft_ball_peak(double stiffness);  // largest force in theory, N
inline constexpr double kSoftBallSpeed = 0.981, kSoftBallRadius = 0.1;

// ---- SimBenchmark

/// 25 balls (1 kg, r = 0.5 m) on a board (10 kg, 20 × 20 × 1 m) that a force of 150 N pulls along `direction`: μ = 0.4 below,
/// 0.8 above the board. Bodies: ground, board, balls. Gravity 9.8 m/s².
scene::Scene rolling();
inline constexpr double kRollingForce = 150;  // N
/// Accelerations of board and balls in theory, m/s².
double rolling_board_acceleration();
double rolling_ball_acceleration();
/// A ball of 1 kg and 0.5 m radius that falls from 10 m (its centre), e = 1, μ = 0, 9.8 m/s².
scene::Scene falling_ball(double restitution);
/// 6 × 6 × 6 balls (10 kg, r = 0.1 m) 0.21 m apart with a perturbation of 1 mm, lowest centre at 1.101 m. e = 1 has μ = 0.
scene::Scene cube_of_balls(double restitution, double mu);
/// A quadruped of ANYmal's size: trunk of 16 kg, four legs of three joints (abduction, hip, knee) with 0.25 and 0.3 m, balls as
/// feet, 30 kg in total; feet on the ground. Bodies: ground, trunk, then hip, thigh and shank of each leg; joints in this order.
scene::Scene quadruped();
/// The posture that the controller holds, τ = 40 (q₀ − q) − 1 q̇ around the start, per joint: the joints' start is zero.
inline constexpr double kQuadrupedKp = 40, kQuadrupedKd = 1;

}  // namespace cotwin::testing
