#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "models/scene/scene.h"

namespace cotwin::scene {

/// Reads an SDF file (sdformat.org, versions 1.5 to 1.12) with one world or one model. Supported:
///   world      gravity, model, include, frame, joint
///   model      static, pose, self_collide (false, as in SDF: links of one model do not collide), link, joint, frame,
///              nested models, include
///   include    uri (a file, or a folder with model.sdf or scene.sdf, relative to the including file; model://name: in its
///              folder or in the parent of that), name, pose, static; errors: merge="true", placement_frame
///   physics    gravity, where the world has none (SDF 1.5)
///   link       pose, inertial (also auto="true" with density), kinematic (prescribed motion: Motion::kDriven), collision; an error:
///              gravity false;
///              cotwin:velocity: initial [v; w] of the link's frame, expressed in the world
///   collision  pose, density, geometry (box, sphere, cylinder, capsule, ellipsoid, cone, plane, mesh,
///              cotwin:round_hole), surface:
///              friction/ode/mu, mu2, fdir1, friction/torsional, bounce/restitution_coefficient, contact/ode/kp and kd (kp absent
///              or 10¹²: rigid), contact/collide_bitmask (one per link; bodies without a common bit do not touch),
///              contact/cotwin:foundation; errors: category_bitmask, collide_without_contact. Convex meshes become hulls, concave ones triangles (mesh.h), with a warning;
///   joint      revolute, continuous, prismatic, ball, fixed, screw (screw_thread_pitch, thread_pitch), universal and revolute2
///              (two hinges `name`, `name.axis2` and a light body `name.cross`), gearbox (a gear between two hinges on its
///              reference body); pose, parent, child, axis, axis2: xyz, use_parent_model_frame (until 1.6), limit (±inf and ±10¹⁶:
///              none), dynamics (damping, friction, spring_stiffness, spring_reference), mimic (a gear)
///   poses      relative_to, degrees, rotation_format
/// The namespace of cotwin: is urn:cotwin:scene:1; cotwin:round_hole has radius, depth, size (two edges), chamfer, facets.
/// cotwin:foundation has young_modulus (Pa) and thickness (m), which give the pressure per depth, damping (Pa.s/m) and yield_stress
/// (Pa); or, of the whole contact whatever its area, stiffness (N/m), damping (N.s/m) and yield_force (N). Besides breakthrough
/// (m): where the contact is deeper, the surface is pierced and carries nothing.
/// Visuals, lights, sensors and windows are ignored. Other elements and attributes are ignored with a warning, or are errors where ignoring
/// them would change the scene. The link of a model with a single link gets the model's name, other links get model.link. The name of the
/// scene is that of its world or model. The result is checked (scene.h). Throws Error `file:line: …`.
Scene load(const std::filesystem::path& file, std::vector<std::string>* warnings = nullptr);

/// As load() from text; `place`: the file's name, to whose folder includes and meshes are relative.
Scene parse_sdf(std::string_view xml, const std::filesystem::path& place, std::vector<std::string>* warnings = nullptr);

}  // namespace cotwin::scene
