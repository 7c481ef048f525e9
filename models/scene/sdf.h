#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "models/scene/scene.h"

namespace cotwin::scene {

/// Reads an SDF file (sdformat.org, versions 1.5 to 1.12) with one world or one model. Understood:
///   world      gravity, model, include, frame, joint
///   model      static, pose, self_collide (false, as in SDF: links of one model do not touch each other), link, joint, frame,
///              nested models, include
///   include    uri (a file, or a folder with model.sdf or scene.sdf, relative to the including file; model://name: beside it or
///              beside its folder), name, pose, static
///   link       pose, inertial (also auto="true" with density), kinematic (moves as it is told: Motion::kDriven), collision;
///              cotwin:velocity, six numbers [v; w] at the start, of the link's frame, expressed in the world
///   collision  pose, density, geometry (box, sphere, cylinder, capsule, plane, mesh as its hull, cotwin:round_hole), surface:
///              friction/ode/mu, bounce/restitution_coefficient, contact/ode/kp and kd (kp absent or 10¹²: rigid)
///   joint      revolute, continuous, prismatic, ball, fixed; pose, parent, child, axis: xyz, limit, dynamics damping and
///              friction
///   poses      relative_to, degrees, rotation_format
/// The namespace of cotwin: is urn:cotwin:scene:1; cotwin:round_hole has radius, depth, size (two edges), chamfer, facets.
/// Visuals, lights and windows go without a word; everything else goes with a warning, or is an error where leaving it out
/// would make another scene. A model with a single link becomes a body of the model's name, other links bodies model.link. The
/// result is checked (scene.h). Throws Error `file:line: …`. The name of the scene is its world's or model's.
Scene load(const std::filesystem::path& file, std::vector<std::string>* warnings = nullptr);

/// The same from text; `place`: the file's name, beside which includes and meshes are looked for.
Scene parse_sdf(std::string_view xml, const std::filesystem::path& place, std::vector<std::string>* warnings = nullptr);

}  // namespace cotwin::scene
