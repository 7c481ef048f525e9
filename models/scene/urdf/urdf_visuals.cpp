#include "models/scene/urdf/urdf_visuals.h"

#include <tinyxml2.h>

#include <algorithm>
#include <map>
#include <string_view>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/scene/urdf/urdf_geometry.h"

namespace cotwin::scene {

namespace fs = std::filesystem;

namespace {

using Eigen::Vector3d;
using tinyxml2::XMLElement;

using Colour = std::array<double, 4>;

/// The colour of a <material>; nothing if it has none.
std::optional<Colour> colour_of(const fs::path& file, const XMLElement& material) {
  const XMLElement* const element = material.FirstChildElement("color");
  const char* const text = element != nullptr ? element->Attribute("rgba") : nullptr;
  if (text == nullptr) return std::nullopt;
  Colour colour{};
  std::size_t count = 0;
  for (const std::string_view word : text::split(text, ' ')) {
    if (text::trim(word).empty()) continue;
    const std::optional<double> x = text::parse_real(word);
    if (!x || !(*x >= 0 && *x <= 1) || count == colour.size()) {
      count = 0;
      break;
    }
    colour[count++] = *x;
  }
  if (count != colour.size())
    throw Error(place_in_urdf(file, *element), "rgba=\"" + std::string(text) + "\", expected four numbers from 0 to 1");
  return colour;
}

Visual geometry_of(const fs::path& file, const XMLElement& visual) {
  const XMLElement* const geometry = visual.FirstChildElement("geometry");
  const XMLElement* const kind = geometry != nullptr ? geometry->FirstChildElement() : nullptr;
  if (kind == nullptr) throw Error(place_in_urdf(file, visual), "<visual> without a geometry");
  const std::string_view name = kind->Name();
  Visual found;
  if (name == "box") {
    found.size = urdf_vector(file, *kind, "size", Vector3d::Zero());
    if (!(found.size.minCoeff() > 0)) throw Error(place_in_urdf(file, *kind), "<box> without edges > 0");
  } else if (name == "sphere") {
    found.type = VisualType::kSphere;
    found.size.x() = urdf_length(file, *kind, "radius");
  } else if (name == "cylinder" || name == "capsule") {
    found.type = name == "cylinder" ? VisualType::kCylinder : VisualType::kCapsule;
    found.size = {urdf_length(file, *kind, "radius"), urdf_length(file, *kind, "length"), 0};
  } else if (name == "mesh") {
    const char* const mesh = kind->Attribute("filename");
    if (mesh == nullptr) throw Error(place_in_urdf(file, *kind), "<mesh> without a filename");
    const std::optional<fs::path> path = find_urdf_mesh(file, mesh);
    if (!path) throw Error(place_in_urdf(file, *kind), "mesh '" + std::string(mesh) + "' not found");
    found.type = VisualType::kMesh;
    found.mesh = *path;
    found.size = urdf_vector(file, *kind, "scale", Vector3d::Ones());
  } else {
    throw Error(place_in_urdf(file, *kind), "<" + std::string(name) + ">, expected box, sphere, cylinder, capsule or mesh");
  }
  return found;
}

}  // namespace

std::vector<std::vector<Visual>> visuals_of_urdf(const fs::path& file, const robot::RobotModel& robot,
                                                 std::vector<std::string>* warnings) {
  tinyxml2::XMLDocument document;
  const std::string xml = text::read_file(file, "a URDF", 16'000'000);
  if (document.Parse(xml.data(), xml.size()) != tinyxml2::XML_SUCCESS)
    throw Error(file.string(), std::string("cannot be read as XML (") + document.ErrorName() + ")");
  const XMLElement* const root = document.RootElement();
  if (root == nullptr) throw Error(file.string(), "no XML element");
  const auto without = [&](const Error& error) {
    if (warnings != nullptr) warnings->push_back(std::string(error.what()) + "; the visual is ignored");
  };
  std::map<std::string, Colour> materials;
  for (const XMLElement* m = root->FirstChildElement("material"); m != nullptr; m = m->NextSiblingElement("material")) {
    try {
      const char* const name = m->Attribute("name");
      if (const std::optional<Colour> colour = colour_of(file, *m); colour && name != nullptr) materials[name] = *colour;
    } catch (const Error& error) {
      without(error);
    }
  }
  std::vector<std::vector<Visual>> visuals(robot.bodies.size() + 1);
  for (const XMLElement* link = root->FirstChildElement("link"); link != nullptr; link = link->NextSiblingElement("link")) {
    const char* const name = link->Attribute("name");
    const auto frame = std::find_if(robot.frames.begin(), robot.frames.end(),
                                    [&](const robot::Frame& f) { return name != nullptr && f.name == name; });
    if (frame == robot.frames.end()) continue;
    for (const XMLElement* v = link->FirstChildElement("visual"); v != nullptr; v = v->NextSiblingElement("visual")) {
      try {
        Visual visual = geometry_of(file, *v);
        visual.X_BS = frame->X_BF * urdf_origin(file, *v);
        if (const XMLElement* material = v->FirstChildElement("material")) {
          visual.colour = colour_of(file, *material);
          const char* const shared = material->Attribute("name");
          if (const auto known = materials.find(shared != nullptr ? shared : ""); !visual.colour && known != materials.end())
            visual.colour = known->second;
        }
        visuals[static_cast<std::size_t>(frame->body + 1)].push_back(std::move(visual));
      } catch (const Error& error) {
        without(error);
      }
    }
  }
  return visuals;
}

}  // namespace cotwin::scene
