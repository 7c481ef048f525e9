#include "models/scene/sdf/sdf_link.h"

#include <Eigen/Geometry>
#include <charconv>
#include <cmath>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/scene/mesh.h"
#include "models/scene/shapes.h"

namespace cotwin::scene::sdf {

namespace fs = std::filesystem;
using Eigen::Vector3d;

namespace {

constexpr double kDensity = 1000;  // kg/m³, SDF's default for <inertial auto="true">

/// Torsional friction of a disc of Hertz's pressure: the moment is 3π/16 × coefficient × patch radius × normal force.
void read_torsional(const xml::Element& torsional, Material& material, const Warn& warn) {
  check_children(torsional, {"coefficient", "use_patch_radius", "patch_radius", "surface_radius"}, {}, {}, warn);
  material.torsion = 3 * M_PI / 16 * number(torsional, "coefficient", 1);
  material.patch_radius = boolean(torsional, "use_patch_radius", true) ? number(torsional, "patch_radius", 0) : 0;
  material.surface_radius = number(torsional, "surface_radius", 0);
  if (material.patch_radius == 0 && material.surface_radius == 0) material.torsion = 0;
}

void read_friction(const xml::Element& friction, const Pose& X_BC, Material& material, const Warn& warn) {
  check_children(friction, {"ode", "torsional"}, {}, {}, warn);
  if (const xml::Element* torsional = only(friction, "torsional")) read_torsional(*torsional, material, warn);
  const xml::Element* ode = only(friction, "ode");
  if (ode == nullptr) return;
  check_children(*ode, {"mu", "mu2", "fdir1"}, {}, {}, warn);
  material.mu = number(*ode, "mu", 1);
  const double second = number(*ode, "mu2", material.mu);
  if (second == material.mu) return;
  const xml::Element* direction = only(*ode, "fdir1");
  Vector3d along = direction != nullptr ? vector(*direction) : Vector3d::Zero();
  if (along.norm() < 1e-9) {
    warn(ode->place, "<mu2> differs from <mu> without an <fdir1>: <mu> acts along x of the collision's frame");
    along = Vector3d::UnitX();
  }
  material.mu2 = second;
  material.first_direction = (X_BC.R * along).normalized();
}

/// A child of cotwin's namespace, or `fallback`.
double own_number(const xml::Element& parent, const char* name, double fallback) {
  const xml::Element* found = only(parent, name, kSpace);
  return found != nullptr ? number(*found) : fallback;
}

/// <cotwin:foundation>: of an area (young_modulus, thickness, yield_stress), or of the whole contact (stiffness, yield_force).
void read_foundation(const xml::Element& foundation, Material& material, const Warn& warn) {
  check_children(foundation, {}, {},
                 {"young_modulus", "thickness", "stiffness", "damping", "yield_stress", "yield_force", "breakthrough"}, warn);
  const xml::Element* whole = only(foundation, "stiffness", kSpace);
  material.whole = whole != nullptr;
  for (const char* name : {"young_modulus", "thickness", "yield_stress"}) {
    const xml::Element* other = only(foundation, name, kSpace);
    if (whole != nullptr && other != nullptr)
      throw Error(other->place, "<" + other->name + "> besides <stiffness>, expected <yield_force>, or a <young_modulus>");
  }
  if (whole != nullptr) {
    material.foundation = number(*whole);
  } else {
    if (const xml::Element* force = only(foundation, "yield_force", kSpace))
      throw Error(force->place, "<yield_force> without <stiffness>, expected <yield_stress>");
    const double thickness = number(required(foundation, "thickness", kSpace));
    if (!(thickness > 0)) throw Error(foundation.place, "<thickness> " + text::to_text(thickness, 6) + " m, expected > 0");
    material.foundation = number(required(foundation, "young_modulus", kSpace)) / thickness;
  }
  if (!(material.foundation > 0)) {
    throw Error(foundation.place, std::string("<") + (material.whole ? "stiffness" : "young_modulus") +
                                      "> in <foundation>: " + text::to_text(material.foundation, 6) + ", expected > 0");
  }
  material.foundation_damping = own_number(foundation, "damping", 0);
  material.yield = own_number(foundation, material.whole ? "yield_force" : "yield_stress", kInfinity);
  material.breakthrough = own_number(foundation, "breakthrough", kInfinity);
}

/// A number of 32 bits, decimal or as 0x3F.
std::uint32_t read_mask(const xml::Element& element) {
  const bool hexadecimal = element.content.starts_with("0x");
  const std::string digits = element.content.substr(hexadecimal ? 2 : 0);
  std::uint32_t value = 0;
  const auto [end, fault] = std::from_chars(digits.data(), digits.data() + digits.size(), value, hexadecimal ? 16 : 10);
  if (fault != std::errc() || end != digits.data() + digits.size())
    throw Error(element.place, "<" + element.name + ">: '" + element.content + "', expected a whole number of 32 bits");
  return value;
}

/// SDF's defaults: <mu> 1, <kp> 10¹² (treated as rigid). `mask`: the bits of collide_bitmask.
Material read_surface(const xml::Element* surface, const Pose& X_BC, std::uint32_t& mask, const Warn& warn) {
  Material material;
  material.mu = 1;
  if (surface == nullptr) return material;
  check_children(*surface, {"friction", "bounce", "contact"}, {}, {}, warn);
  if (const xml::Element* friction = only(*surface, "friction")) read_friction(*friction, X_BC, material, warn);
  if (const xml::Element* bounce = only(*surface, "bounce")) {
    check_children(*bounce, {"restitution_coefficient"}, {}, {}, warn);
    material.restitution = number(*bounce, "restitution_coefficient", 0);
  }
  if (const xml::Element* contact = only(*surface, "contact")) {
    check_children(*contact, {"ode", "collide_bitmask", "collide_without_contact", "category_bitmask"}, {}, {"foundation"},
                   warn);
    if (const xml::Element* bits = only(*contact, "collide_bitmask")) mask = read_mask(*bits);
    if (const xml::Element* bits = only(*contact, "category_bitmask"); bits != nullptr && read_mask(*bits) != kAllBits)
      throw Error(bits->place, "<category_bitmask> is not supported, expected <collide_bitmask>");
    if (const xml::Element* without = only(*contact, "collide_without_contact"); without != nullptr && boolean(*without))
      throw Error(without->place, "<collide_without_contact> is not supported, expected a <collide_bitmask> of 0");
    if (const xml::Element* foundation = only(*contact, "foundation", kSpace)) read_foundation(*foundation, material, warn);
    if (const xml::Element* ode = only(*contact, "ode")) {
      check_children(*ode, {"kp", "kd"}, {}, {}, warn);
      const double kp = number(*ode, "kp", 1e12);
      if (kp < 1e12 && material.foundation > 0) throw Error(ode->place, "<kp> besides <foundation>, expected one of them");
      if (kp < 1e12) {
        material.stiffness = kp;
        material.damping = number(*ode, "kd", 1);
      }
    }
  }
  return material;
}

/// Shapes of a <geometry>, and the inertia of a solid of 1 kg/m³ where it is not that of the shapes.
struct Geometry {
  std::vector<Shape> shapes;
  std::optional<Inertia> unit;
};

Geometry read_geometry(const xml::Element& geometry, bool is_static, const fs::path& folder, const Warn& warn) {
  const xml::Element* kind = nullptr;
  for (const xml::Element& c : geometry.children) {
    if (c.space != "" && c.space != kSpace) continue;
    if (kind != nullptr) throw Error(c.place, "<" + c.name + "> besides <" + kind->name + "> in <geometry>");
    kind = &c;
  }
  if (kind == nullptr) throw Error(geometry.place, "<geometry> without a shape");
  Shape shape;
  const auto of = [&](const char* name) { return number(required(*kind, name)); };
  const bool ours = kind->space == kSpace;
  if (ours && kind->name == "round_hole") {
    check_children(*kind, {}, {}, {"radius", "depth", "size", "chamfer", "facets"}, warn);
    RoundHole hole;
    hole.radius = number(required(*kind, "radius", kSpace));
    hole.depth = number(required(*kind, "depth", kSpace));
    const std::vector<double> size = numbers(required(*kind, "size", kSpace), 2);
    hole.width = size[0];
    hole.length = size[1];
    if (const xml::Element* chamfer = only(*kind, "chamfer", kSpace)) hole.chamfer = number(*chamfer);
    if (const xml::Element* facets = only(*kind, "facets", kSpace)) {
      const double count = number(*facets);
      if (count != std::floor(count) || std::abs(count) > 1e6)
        throw Error(facets->place, "<facets>: " + facets->content + ", expected a whole number");
      hole.facets = static_cast<int>(count);
    }
    try {
      return {round_hole(hole), {}};
    } catch (const Error& e) {
      throw Error(kind->place, e.what());
    }
  }
  if (!ours && kind->name == "box") {
    check_children(*kind, {"size"}, {}, {}, warn);
    shape.type = ShapeType::kBox;
    shape.size = vector(required(*kind, "size"));
  } else if (!ours && kind->name == "sphere") {
    check_children(*kind, {"radius"}, {}, {}, warn);
    shape.type = ShapeType::kSphere;
    shape.size = {of("radius"), 0, 0};
  } else if (!ours && (kind->name == "cylinder" || kind->name == "capsule")) {
    check_children(*kind, {"radius", "length"}, {}, {}, warn);
    shape.type = kind->name == "cylinder" ? ShapeType::kCylinder : ShapeType::kCapsule;
    shape.size = {of("radius"), of("length"), 0};
  } else if (!ours && kind->name == "ellipsoid") {
    check_children(*kind, {"radii"}, {}, {}, warn);
    shape.type = ShapeType::kEllipsoid;
    shape.size = vector(required(*kind, "radii"));
  } else if (!ours && kind->name == "cone") {
    check_children(*kind, {"radius", "length"}, {}, {}, warn);
    shape.type = ShapeType::kHull;
    try {
      shape.vertices = cone(of("radius"), of("length"));
    } catch (const Error& e) {
      throw Error(kind->place, e.what());
    }
  } else if (!ours && kind->name == "plane") {
    check_children(*kind, {"normal"}, {"size"}, {}, warn);
    shape.type = ShapeType::kPlane;
    const xml::Element* normal = only(*kind, "normal");
    const Vector3d n = normal != nullptr ? vector(*normal) : Vector3d(0, 0, 1);
    if (!(n.norm() > 1e-6))
      throw Error(normal->place, "<normal> of length " + text::to_text(n.norm(), 6) + ", expected a direction");
    shape.X_BS.R = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), n).toRotationMatrix();
  } else if (!ours && kind->name == "mesh") {
    check_children(*kind, {"uri", "scale", "submesh"}, {}, {}, warn);
    if (const xml::Element* part = only(*kind, "submesh"))
      throw Error(part->place, "<submesh> is not supported, expected a separate file");
    const xml::Element* scale = only(*kind, "scale");
    const xml::Element& uri = required(*kind, "uri");
    const fs::path file = find_file(uri, folder);
    std::string place = uri.place;
    try {
      Mesh mesh = load_mesh(file, scale != nullptr ? vector(*scale) : Vector3d::Ones());
      place += ": " + file.string();
      MeshSurface surface = surface_of(std::move(mesh), is_static);
      for (const std::string& remark : surface.remarks) warn(uri.place, file.filename().string() + ": " + remark);
      return {std::move(surface.shapes), surface.unit};
    } catch (const Error& e) {
      throw Error(place, e.what());
    }
  } else if (!ours && kind->name == "heightmap") {
    throw Error(kind->place,
                "<heightmap> as a shape, expected a mesh: convert it, for example with Blender (a grid with the modifiers "
                "Displace and Decimate, exported as STL), or use a plane");
  } else {
    throw Error(kind->place, "<" + kind->name +
                                 "> as a shape, expected box, sphere, cylinder, capsule, ellipsoid, cone, plane, mesh "
                                 "or cotwin:round_hole");
  }
  return {{shape}, {}};
}

struct Collision {
  std::vector<Shape> shapes;
  std::optional<Inertia> unit;  // in the link's frame, at 1 kg/m³; absent: that of the shapes
  double density;
  std::uint32_t mask = kAllBits;
};

Collision read_collision(const xml::Element& element, double density, bool is_static, const fs::path& folder,
                         const Warn& warn) {
  check_children(element, {"pose", "geometry", "surface", "density"}, {"laser_retro", "max_contacts"}, {}, warn);
  const std::string& name = xml::text(element, "name");
  const Pose X_BC = own_pose(element);
  std::uint32_t mask = kAllBits;
  const Material material = read_surface(only(element, "surface"), X_BC, mask, warn);
  Geometry geometry = read_geometry(required(element, "geometry"), is_static, folder, warn);
  Collision collision{std::move(geometry.shapes), {}, number(element, "density", density), mask};
  if (geometry.unit) collision.unit = geometry.unit->seen_from(X_BC);
  for (Shape& shape : collision.shapes) {
    shape.name = shape.name.empty() ? name : name + "." + shape.name;
    shape.X_BS = X_BC * shape.X_BS;
    shape.material = material;
  }
  return collision;
}

Inertia read_inertial(const xml::Element& element, const Warn& warn) {
  check_children(element, {"mass", "pose", "inertia", "density"}, {}, {}, warn);
  Inertia inertia;
  inertia.mass = number(required(element, "mass"));
  const xml::Element& m = required(element, "inertia");
  const auto off = [&](const char* name) { return number(m, name, 0); };
  const auto on = [&](const char* name) { return number(required(m, name)); };
  const double xx = on("ixx"), yy = on("iyy"), zz = on("izz"), xy = off("ixy"), xz = off("ixz"), yz = off("iyz");
  inertia.I_CC << xx, xy, xz, xy, yy, yz, xz, yz, zz;
  inertia = inertia.seen_from(own_pose(element));
  const std::string why = inertia.unphysical();
  if (!why.empty()) throw Error(element.place, why);
  return inertia;
}

}  // namespace

fs::path find_file(const xml::Element& uri, const fs::path& folder) {
  std::string name = uri.content;
  std::vector<fs::path> places{folder};
  for (const std::string_view scheme : {"model://", "file://", "package://"}) {
    if (name.rfind(scheme, 0) != 0) continue;
    name = name.substr(scheme.size());
    if (scheme == "model://") places.push_back(folder.parent_path());
    break;
  }
  if (name.empty()) throw Error(uri.place, "<uri> without a name");
  if (name.find("://") != std::string::npos) throw Error(uri.place, "'" + name + "', expected a file beside this one");
  std::string looked;
  for (const fs::path& place : places) {
    fs::path found = (place / name).lexically_normal();
    std::error_code ignored;
    if (fs::is_directory(found, ignored)) {
      for (const char* inside : {"model.sdf", "scene.sdf"}) {
        if (fs::is_regular_file(found / inside, ignored)) return found / inside;
      }
    } else if (fs::is_regular_file(found, ignored)) {
      return found;
    }
    text::append(looked, found.string());
  }
  throw Error(uri.place, "no file '" + name + "', looked for " + looked);
}

Body read_link(const xml::Element& element, bool is_static, const fs::path& folder, std::uint32_t& mask, const Warn& warn) {
  check_children(element, {"pose", "inertial", "collision", "kinematic", "gravity"},
                 {"visual", "light", "sensor", "projector", "audio_sink", "audio_source", "battery", "particle_emitter",
                  "must_be_base_link"},
                 {"velocity"}, warn);
  Body body;
  const bool driven = boolean(element, "kinematic", false);
  body.motion = is_static ? Motion::kStatic : driven ? Motion::kDriven : Motion::kDynamic;
  if (const xml::Element* gravity = only(element, "gravity");
      gravity != nullptr && !boolean(*gravity) && body.motion == Motion::kDynamic)
    throw Error(gravity->place,
                "<gravity> false of a single link is not supported, expected <gravity>0 0 0</gravity> of the world");
  const xml::Element* inertial = only(element, "inertial");
  const bool automatic = inertial != nullptr && xml::boolean(*inertial, "auto", false);
  const double density = automatic ? number(*inertial, "density", kDensity) : kDensity;
  Inertia solid;
  for (const xml::Element& c : element.children) {
    if (c.name != "collision" || !c.space.empty()) continue;
    Collision collision = read_collision(c, density, body.motion == Motion::kStatic, folder, warn);
    if (!body.shapes.empty() && collision.mask != mask)
      throw Error(c.place, "collisions of one link have different bits of <collide_bitmask>, expected the same ones");
    mask = collision.mask;
    if (automatic && body.motion == Motion::kDynamic && collision.unit) {
      if (!(collision.density > 0))
        throw Error(c.place, "density " + text::to_text(collision.density, 6) + " kg/m3, expected > 0");
      Inertia inertia = *collision.unit;
      inertia.mass *= collision.density;
      inertia.I_CC *= collision.density;
      solid = solid + inertia;
    }
    for (Shape& shape : collision.shapes) {
      if (!collision.unit && automatic && body.motion == Motion::kDynamic) {
        try {
          solid = solid + solid_inertia(shape, collision.density);
        } catch (const Error& e) {
          throw Error(c.place, e.what());
        }
      }
      body.shapes.push_back(std::move(shape));
    }
  }
  if (body.motion == Motion::kDynamic) {
    if (inertial == nullptr)
      throw Error(element.place, "a dynamic link without <inertial>, expected its mass and inertia, or auto=\"true\"");
    body.inertia = automatic ? solid : read_inertial(*inertial, warn);
  }
  if (const xml::Element* velocity = only(element, "velocity", kSpace)) {
    body.V_WB = Eigen::Map<const Twist>(numbers(*velocity, 6).data());
  }
  return body;
}

}  // namespace cotwin::scene::sdf
