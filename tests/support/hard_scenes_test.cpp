#include "tests/support/hard_scenes.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <vector>

#include "tests/support/contact_scenes.h"
#include "tests/support/foreign_scenes.h"

namespace cotwin::testing::hard_scenes_test {
namespace {

constexpr double kGravity = 9.81;

std::vector<Pose> poses(const scene::Scene& scene) {
  std::vector<Pose> X_WB;
  for (const scene::Body& body : scene.bodies) X_WB.push_back(body.X_WB);
  return X_WB;
}

TEST(HardScenes, AreValid) {
  const std::array masses{1.0, 1000.0};
  for (const scene::Scene& scene : {parallelogram(1, 0.5, 0.5),
                                    double_parallelogram(1, 0.5, 0.5),
                                    bricard(),
                                    chain(20),
                                    cradle(5, 5e-4),
                                    row_of_balls(5, 0),
                                    square_break(4),
                                    card_house(3, 0.26, 0.35),
                                    arch(9, 0.5),
                                    ladder(0.3),
                                    stack_of_masses(masses),
                                    dominoes(30),
                                    mixed_pile(96, 3),
                                    bullet(300, 0.005),
                                    overlapping_boxes(0.01),
                                    soft_ball(1e6),
                                    rolling(),
                                    falling_ball(1),
                                    cube_of_balls(1, 0),
                                    quadruped()}) {
    EXPECT_NO_THROW(scene::check(scene)) << scene.name;
    EXPECT_LT(joint_gap(scene, poses(scene)), 1e-12) << scene.name;
  }
}

TEST(HardScenes, ForeignScenesAreValid) {
  for (const scene::Scene& scene :
       {slider_crank(10), necklace(20), loaded_rope(20, 100), open_triangle(1e-3), stack_of_edge(5, 1e-3), ball_on_ball(0.01),
        painleve_rod(2), spinning_disc(200), wedged_ball(0.17, 0.5), coincident_boxes(), fast_box(100), fast_rod(),
        two_bullets(300), brick_wall(10), pyramid_on_tip(), thin_plates(10), soft_stack(1e5)}) {
    EXPECT_NO_THROW(scene::check(scene)) << scene.name;
  }
  EXPECT_NEAR(joint_gap(open_triangle(1e-3), poses(open_triangle(1e-3))), 1e-3, 1e-12);
}

// The energy of the scene's bodies, placed by hand at the angle that the integration gives, with its speed.
TEST(HardScenes, ParallelogramsConserveEnergyInTheReference) {
  const double base = 1, crank = 0.5, start = 0.5, t = 0.4, dt = 1e-5;
  const double angle = parallelogram_angle(base, crank, 2, start, t);
  const double speed =
      (parallelogram_angle(base, crank, 2, start, t + dt) - parallelogram_angle(base, crank, 2, start, t - dt)) / (2 * dt);
  const scene::Scene scene = parallelogram(base, crank, start);
  const scene::Scene there = parallelogram(base, crank, angle);
  std::vector<Twist> V_WB(3, Twist::Zero());
  const Eigen::Vector3d along(-std::sin(angle), 0, std::cos(angle));
  for (const std::size_t k : {0u, 1u}) V_WB[k] << 0.5 * crank * speed * along, 0, -speed, 0;
  V_WB[2] << crank * speed * along, 0, 0, 0;
  // The cranks keep their orientation in `there`, where the frames are parallel to W: their moments of inertia about y agree.
  const std::vector<Twist> at_rest(3, Twist::Zero());
  EXPECT_NEAR(energy(there, poses(there), V_WB), energy(scene, poses(scene), at_rest), 1e-6);
}

TEST(HardScenes, WedgesOfTheArchWeighWhatTheirSectionSays) {
  const scene::Scene scene = arch(9, 0.5);
  // Half of sin α times the difference of the squared radii, as the faces are flat.
  const double area = 0.5 * std::sin(M_PI / 9) * (0.65 * 0.65 - 0.5 * 0.5);
  for (std::size_t k = 1; k < scene.bodies.size(); ++k) EXPECT_NEAR(scene.bodies[k].inertia.mass, 2000 * 0.2 * area, 1e-9);
}

TEST(HardScenes, LadderSlidesBelowTheCriticalFrictionAlone) {
  EXPECT_LT(ladder_path(critical_ladder_mu(), 1), 1e-9);
  EXPECT_GT(ladder_path(0.99 * critical_ladder_mu(), 1), 1e-3);
  // Without friction and thickness θ̈ = −3 g cos θ / (2 L) at the start, L = 2 m.
  const double theta = -1.5 * kGravity * 0.5 / 2 * 0.5 * 1e-4;
  EXPECT_NEAR(ladder_path(0, 1e-2), std::abs(theta), 0.02 * std::abs(theta));
}

TEST(HardScenes, RollingAccelerationsSatisfyNewton) {
  const double board = rolling_board_acceleration(), ball = rolling_ball_acceleration();
  EXPECT_NEAR(150 - 0.4 * 35 * 9.8, 10 * board + 25 * ball, 1e-12);  // forces on the board and its 25 balls of 1 kg
  EXPECT_NEAR(board, ball + 2.5 * ball, 1e-12);                      // at the contact, with I = 0.4 m r²
}

TEST(HardScenes, CardHouseHasItsCards) {
  EXPECT_EQ(card_house(2, 0.26, 0.35).bodies.size(), 1u + 7);
  EXPECT_EQ(card_house(3, 0.26, 0.35).bodies.size(), 1u + 15);
}

}  // namespace
}  // namespace cotwin::testing::hard_scenes_test
