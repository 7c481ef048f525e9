#pragma once
#include <cstdint>
#include <span>
#include <string>

#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

/// The scenes that are used to compare contact engines, for tests and for the benchmarks of other engines.
namespace cotwin::testing {

scene::Body ground(double mu, double restitution = 0);
scene::Body box(const std::string& name, const Eigen::Vector3d& edges, double mass, const Eigen::Vector3d& p_WB, double mu);
scene::Body ball(const std::string& name, double radius, double mass, const Eigen::Vector3d& p_WB, double mu,
                 double restitution = 0);
/// Solid below the plane z = 0 of a frame rotated about y by `angle`: its surface descends along x.
scene::Body slope(double angle, double mu);

/// The LWR 4+ (models/robots/lwr4) at q, without joint limits. Bodies: base, link_1 … link_7; joints in the robot's order.
scene::Scene arm(std::span<const double> q);
/// The same on a floating base of 10 kg, without gravity, moving at dq.
scene::Scene floating_arm(std::span<const double> q, std::span<const double> dq);
/// Torques that hold it against gravity at q (2a), N.m.
void gravity_torques(std::span<const double> q, std::span<double> tau);

/// Stacked cubes of edge 0.1 m and 1 kg on the ground (body 0), μ = 0.5.
scene::Scene stack(int boxes);
inline constexpr double kStackEdge = 0.1;  // m

/// A peg of 20 x 20 x 60 mm and 0.2 kg, half in a slot of two walls at the distance of the peg's width plus `clearance`, on a
/// floor 30 mm below it; μ = 0.3. Bodies: floor, left and right wall (at −x and +x), peg (3).
scene::Scene slot(double clearance);
inline constexpr double kPegWidth = 0.02, kPegLength = 0.06;  // m

/// Cubes of edge 0.1 m and 1 kg in layers with gaps, randomly rotated, above the ground (body 0).
scene::Scene pile(int boxes, std::uint64_t seed);
/// Balls of radius 0.05 m, likewise, in a pen of four walls (bodies 1 … 4).
scene::Scene balls(int count, std::uint64_t seed);

/// A ball of radius 0.1 m on the ground, μ = 0.3, with v and ω such that it first slips perpendicular to the direction of its
/// motion.
scene::Scene pushed_ball();
/// Its position at t and its velocity: v̇ = −μ g ŝ with the direction ŝ of slip, until it rolls at 2 |s₀| / (7 μ g).
Twist pushed_ball_at(double t, Eigen::Vector3d& p_WB);
/// A ball that falls 1 m onto the ground and loses no energy.
scene::Scene bouncing_ball();
/// A box (1) of 0.2 x 0.2 x 0.1 m on a slope of angle (0) with μ = 0.5.
scene::Scene box_on_slope(double angle);
/// A cube of 1 kg (1) between a wall (0) and a plate (2); a force of −50 N along x at the plate's centre holds both.
scene::Scene held_box();
/// A box with three different moments of inertia, rotating about the middle axis and with 0.01 rad/s about another, without
/// gravity.
scene::Scene spinning_box();
/// A box (1) thrown onto the ground, rotating.
scene::Scene tossed_box();

/// Depth of the corners of box `upper` below the top face of box `lower` (both with edges `edges`), m; negative: above.
double depth_on_top(const Pose& X_WU, const Pose& X_WL, const Eigen::Vector3d& edges);
/// Kinetic and potential energy of all dynamic bodies, J.
double energy(const scene::Scene& scene, std::span<const Pose> X_WB, std::span<const Twist> V_WB);
/// Linear momentum, and angular momentum about W's origin, of all dynamic bodies.
Wrench momentum(const scene::Scene& scene, std::span<const Pose> X_WB, std::span<const Twist> V_WB);
/// The largest distance between the anchors of a joint, m.
double joint_gap(const scene::Scene& scene, std::span<const Pose> X_WB);
/// The angle of a revolute joint in (−π, π], rad.
double joint_angle(const scene::Scene& scene, std::size_t joint, std::span<const Pose> X_WB);

}  // namespace cotwin::testing
