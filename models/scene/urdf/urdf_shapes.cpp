#include "models/scene/urdf/urdf_shapes.h"

#include <tinyxml2.h>

#include <algorithm>
#include <initializer_list>
#include <optional>
#include <set>
#include <sstream>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"
#include "models/robot/urdf/urdf_words.h"
#include "models/scene/mesh.h"
#include "models/scene/urdf/urdf_geometry.h"

namespace cotwin::scene {

namespace fs = std::filesystem;

namespace {

using Eigen::Vector3d;
using tinyxml2::XMLElement;

class ShapeReader {
 public:
  ShapeReader(const fs::path& file, const robot::RobotModel& robot, std::vector<std::string>* warnings)
      : file_(file), robot_(robot), warnings_(warnings) {}

  /// Adds the shapes of the links that are not in `known`, and the names of those with a <collision> to `known`.
  void read(std::vector<std::vector<Shape>>& shapes, std::set<std::string>& known) const;

 private:
  std::string at(const XMLElement& element) const { return place_in_urdf(file_, element); }
  void warn(const XMLElement& element, const std::string& what) const {
    if (warnings_ != nullptr) warnings_->push_back(at(element) + ": " + what);
  }
  void check_attributes(const XMLElement& element, std::initializer_list<std::string_view> read) const;
  bool read_geometry(const XMLElement& collision, Shape& shape) const;
  bool read_mesh(const XMLElement& mesh, Shape& shape) const;

  const fs::path file_;
  const robot::RobotModel& robot_;
  std::vector<std::string>* const warnings_;
};

/// Throws Error for attributes that are not read and would move or scale a shape; tells of others.
void ShapeReader::check_attributes(const XMLElement& element, std::initializer_list<std::string_view> read) const {
  for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next()) {
    const std::string name = a->Name();
    if (std::ranges::find(read, name) != read.end() || name.find(':') != std::string::npos) continue;
    const std::string what = "'" + name + "' as an attribute of <" + element.Name() + "> is not read";
    if (const std::string why = robot::words::why_refused(element, name, true); !why.empty())
      throw Error(at(element), what + why);
    warn(element, what);
  }
}

bool ShapeReader::read_mesh(const XMLElement& mesh, Shape& shape) const {
  const char* const name = mesh.Attribute("filename");
  if (name == nullptr) throw Error(at(mesh), "<mesh> without a filename");
  const std::optional<fs::path> found = find_urdf_mesh(file_, name);
  if (!found) {
    warn(mesh, "mesh '" + std::string(name) + "' not found; the shape is ignored");
    return false;
  }
  try {
    shape.vertices = load_hull(*found, urdf_vector(file_, mesh, "scale", Vector3d::Ones()));
    shape.type = ShapeType::kHull;
    return true;
  } catch (const Error& e) {
    warn(mesh, "mesh ignored: " + std::string(e.what()));
    return false;
  }
}

/// Whether a length of a shape is 0, as in URDFs in which a shape stands for a point or for nothing.
bool is_empty(const XMLElement& shape) {
  for (const char* attribute : {"size", "radius", "length"}) {
    const char* const text = shape.Attribute(attribute);
    if (text == nullptr) continue;
    std::istringstream words(text);
    for (std::string word; words >> word;)
      if (text::parse_real(word) == 0.0) return true;
  }
  return false;
}

bool ShapeReader::read_geometry(const XMLElement& collision, Shape& shape) const {
  const XMLElement* const geometry = collision.FirstChildElement("geometry");
  const XMLElement* const kind = geometry != nullptr ? geometry->FirstChildElement() : nullptr;
  if (kind == nullptr) throw Error(at(collision), "<collision> without a geometry");
  const std::string_view name = kind->Name();
  check_attributes(*kind, {"size", "radius", "length", "filename", "scale"});
  if (name != "mesh" && is_empty(*kind)) {
    warn(*kind, "<" + std::string(name) + "> of length 0 is ignored");
    return false;
  }
  if (name == "box") {
    shape.type = ShapeType::kBox;
    shape.size = urdf_vector(file_, *kind, "size", Vector3d::Zero());
    if (!(shape.size.minCoeff() > 0)) throw Error(at(*kind), "<box> without edges > 0");
  } else if (name == "sphere") {
    shape.type = ShapeType::kSphere;
    shape.size = {urdf_length(file_, *kind, "radius"), 0, 0};
  } else if (name == "cylinder" || name == "capsule") {
    shape.type = name == "cylinder" ? ShapeType::kCylinder : ShapeType::kCapsule;
    shape.size = {urdf_length(file_, *kind, "radius"), urdf_length(file_, *kind, "length"), 0};
  } else if (name == "mesh") {
    return read_mesh(*kind, shape);
  } else {
    warn(*kind, "<" + std::string(name) + "> as a shape is ignored, expected box, sphere, cylinder, capsule or mesh");
    return false;
  }
  return true;
}

void ShapeReader::read(std::vector<std::vector<Shape>>& shapes, std::set<std::string>& known) const {
  tinyxml2::XMLDocument document;
  const std::string xml = text::read_file(file_, "a URDF", 16'000'000);
  if (document.Parse(xml.data(), xml.size()) != tinyxml2::XML_SUCCESS) {
    throw Error(file_.string(), std::string("cannot be read as XML (") + document.ErrorName() + ")");
  }
  const XMLElement* const root = document.RootElement();
  if (root == nullptr) throw Error(file_.string(), "no XML element");
  const std::set<std::string> before = known;
  for (const XMLElement* link = root->FirstChildElement("link"); link != nullptr; link = link->NextSiblingElement("link")) {
    const char* const name = link->Attribute("name");
    const auto frame = std::find_if(robot_.frames.begin(), robot_.frames.end(),
                                    [&](const robot::Frame& f) { return name != nullptr && f.name == name; });
    if (frame == robot_.frames.end() || before.contains(frame->name)) continue;
    int count = 0;
    for (const XMLElement* c = link->FirstChildElement("collision"); c != nullptr; c = c->NextSiblingElement("collision")) {
      Shape shape;
      const char* const own = c->Attribute("name");
      ++count;
      known.insert(frame->name);
      shape.name = own != nullptr ? own : frame->name + (count > 1 ? "_" + std::to_string(count) : std::string());
      if (const XMLElement* const origin = c->FirstChildElement("origin"))
        check_attributes(*origin, {"xyz", "rpy", "quat_xyzw", "R"});
      const Pose X_LS = urdf_origin(file_, *c);
      if (!read_geometry(*c, shape)) continue;
      shape.X_BS = frame->X_BF * X_LS;
      shapes[static_cast<std::size_t>(frame->body + 1)].push_back(std::move(shape));
    }
  }
}

std::vector<std::vector<Shape>> shapes_of(std::initializer_list<fs::path> files, const robot::RobotModel& robot,
                                          std::vector<std::string>* warnings) {
  std::vector<std::vector<Shape>> shapes(robot.bodies.size() + 1);
  std::set<std::string> known;
  for (const fs::path& file : files) ShapeReader(file, robot, warnings).read(shapes, known);
  return shapes;
}

}  // namespace

std::vector<std::vector<Shape>> shapes_of_urdf(const fs::path& file, const robot::RobotModel& robot,
                                               std::vector<std::string>* warnings) {
  return shapes_of({file}, robot, warnings);
}

std::vector<std::vector<Shape>> hulls_of_urdf(const fs::path& file, const robot::RobotModel& robot,
                                              std::vector<std::string>* warnings) {
  const fs::path hulls =
      file.parent_path() / (file.filename() == "robot.urdf" ? "hulls.urdf" : file.stem().string() + "_hulls.urdf");
  return fs::exists(hulls) ? shapes_of({hulls, file}, robot, warnings) : shapes_of({file}, robot, warnings);
}

std::vector<Shape> shapes_of_tool(const fs::path& file, const Pose& X_BA, std::vector<std::string>* warnings) {
  const robot::RobotModel tool = robot::load_urdf(file);
  if (!tool.bodies.empty()) throw Error(file.string(), "has joints that move, expected a tool whose joints are fixed");
  std::vector<Shape> shapes = shapes_of_urdf(file, tool, warnings).front();
  for (Shape& shape : shapes) shape.X_BS = X_BA * shape.X_BS;
  return shapes;
}

}  // namespace cotwin::scene
