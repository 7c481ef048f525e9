#include "models/scene/urdf_shapes.h"

#include <tinyxml2.h>

#include <algorithm>
#include <cmath>

#include "models/scene/mesh.h"
#include "models/support/error.h"
#include "models/support/file.h"
#include "models/support/text.h"

namespace cotwin::scene {

namespace fs = std::filesystem;

namespace {

constexpr double kLargest = 1e15;  // products of larger numbers may overflow

using Eigen::Vector3d;
using tinyxml2::XMLElement;

class Reader {
 public:
  Reader(const fs::path& file, const robot::RobotModel& robot, std::vector<std::string>* warnings)
      : file_(file), robot_(robot), warnings_(warnings) {}

  std::vector<std::vector<Shape>> read();

 private:
  std::string at(const XMLElement& element) const { return file_.string() + ":" + std::to_string(element.GetLineNum()); }
  void warn(const XMLElement& element, const std::string& what) const {
    if (warnings_ != nullptr) warnings_->push_back(at(element) + ": " + what);
  }
  Vector3d vector(const XMLElement& element, const char* attribute, const Vector3d& fallback) const;
  double length(const XMLElement& element, const char* attribute) const;
  bool read_geometry(const XMLElement& collision, Shape& shape) const;
  bool read_mesh(const XMLElement& mesh, Shape& shape) const;

  const fs::path file_;
  const robot::RobotModel& robot_;
  std::vector<std::string>* const warnings_;
};

Vector3d Reader::vector(const XMLElement& element, const char* attribute, const Vector3d& fallback) const {
  const char* const text = element.Attribute(attribute);
  if (text == nullptr) return fallback;
  std::vector<double> numbers;
  for (const std::string_view word : text::split(text, ' ')) {
    if (text::trim(word).empty()) continue;
    const std::optional<double> x = text::parse_real(word);
    if (!x || !(std::abs(*x) < kLargest)) {
      throw Error(at(element), std::string(attribute) + "=\"" + text + "\", expected three numbers of magnitude below " +
                                   text::to_text(kLargest));
    }
    numbers.push_back(*x);
  }
  if (numbers.size() != 3) throw Error(at(element), std::string(attribute) + "=\"" + text + "\", expected three numbers");
  return {numbers[0], numbers[1], numbers[2]};
}

double Reader::length(const XMLElement& element, const char* attribute) const {
  const char* const text = element.Attribute(attribute);
  const std::optional<double> x = text != nullptr ? text::parse_real(text) : std::nullopt;
  if (!x || !(*x > 0 && *x < kLargest)) {
    throw Error(at(element), std::string("<") + element.Name() + "> with " + attribute + "=\"" + (text != nullptr ? text : "") +
                                 "\", expected a length > 0 and below " + text::to_text(kLargest) + " m");
  }
  return *x;
}

bool Reader::read_mesh(const XMLElement& mesh, Shape& shape) const {
  const char* const name = mesh.Attribute("filename");
  if (name == nullptr) throw Error(at(mesh), "<mesh> without a filename");
  std::string rest = name;
  std::vector<std::string> names{rest};
  for (const std::string_view scheme : {"package://", "model://", "file://"}) {
    if (rest.rfind(scheme, 0) != 0) continue;
    rest = rest.substr(scheme.size());
    names = {rest};
    if (const std::size_t slash = rest.find('/'); scheme != "file://" && slash != std::string::npos)
      names.push_back(rest.substr(slash + 1));
  }
  std::error_code ignored;
  for (fs::path folder = fs::absolute(file_, ignored).parent_path();; folder = folder.parent_path()) {
    for (const std::string& candidate : names) {
      const fs::path found = folder / candidate;
      if (!fs::is_regular_file(found, ignored)) continue;
      try {
        shape.vertices = load_hull(found, vector(mesh, "scale", Vector3d::Ones()));
        shape.type = ShapeType::kHull;
        return true;
      } catch (const Error& e) {
        warn(mesh, "mesh ignored: " + std::string(e.what()));
        return false;
      }
    }
    if (folder == folder.parent_path()) break;
  }
  warn(mesh, "mesh '" + std::string(name) + "' not found; the shape is ignored");
  return false;
}

bool Reader::read_geometry(const XMLElement& collision, Shape& shape) const {
  const XMLElement* const geometry = collision.FirstChildElement("geometry");
  const XMLElement* const kind = geometry != nullptr ? geometry->FirstChildElement() : nullptr;
  if (kind == nullptr) throw Error(at(collision), "<collision> without a geometry");
  const std::string_view name = kind->Name();
  if (name == "box") {
    shape.type = ShapeType::kBox;
    shape.size = vector(*kind, "size", Vector3d::Zero());
    if (!(shape.size.minCoeff() > 0)) throw Error(at(*kind), "<box> without edges > 0");
  } else if (name == "sphere") {
    shape.type = ShapeType::kSphere;
    shape.size = {length(*kind, "radius"), 0, 0};
  } else if (name == "cylinder" || name == "capsule") {
    shape.type = name == "cylinder" ? ShapeType::kCylinder : ShapeType::kCapsule;
    shape.size = {length(*kind, "radius"), length(*kind, "length"), 0};
  } else if (name == "mesh") {
    return read_mesh(*kind, shape);
  } else {
    warn(*kind, "<" + std::string(name) + "> as a shape is ignored, expected box, sphere, cylinder, capsule or mesh");
    return false;
  }
  return true;
}

std::vector<std::vector<Shape>> Reader::read() {
  tinyxml2::XMLDocument document;
  const std::string xml = text::read_file(file_, "a URDF", 16'000'000);
  if (document.Parse(xml.data(), xml.size()) != tinyxml2::XML_SUCCESS) {
    throw Error(file_.string(), std::string("cannot be read as XML (") + document.ErrorName() + ")");
  }
  const XMLElement* const root = document.RootElement();
  if (root == nullptr) throw Error(file_.string(), "no XML element");
  std::vector<std::vector<Shape>> shapes(robot_.bodies.size() + 1);
  for (const XMLElement* link = root->FirstChildElement("link"); link != nullptr; link = link->NextSiblingElement("link")) {
    const char* const name = link->Attribute("name");
    const auto frame = std::find_if(robot_.frames.begin(), robot_.frames.end(),
                                    [&](const robot::Frame& f) { return name != nullptr && f.name == name; });
    if (frame == robot_.frames.end()) continue;
    int count = 0;
    for (const XMLElement* c = link->FirstChildElement("collision"); c != nullptr; c = c->NextSiblingElement("collision")) {
      Shape shape;
      const char* const own = c->Attribute("name");
      ++count;
      shape.name = own != nullptr ? own : frame->name + (count > 1 ? "_" + std::to_string(count) : std::string());
      Pose X_LS;
      if (const XMLElement* origin = c->FirstChildElement("origin")) {
        const Vector3d rpy = vector(*origin, "rpy", Vector3d::Zero());
        X_LS.R = rotation_from_rpy(rpy.x(), rpy.y(), rpy.z());
        X_LS.p = vector(*origin, "xyz", Vector3d::Zero());
      }
      if (!read_geometry(*c, shape)) continue;
      shape.X_BS = frame->X_BF * X_LS;
      shapes[static_cast<std::size_t>(frame->body + 1)].push_back(std::move(shape));
    }
  }
  return shapes;
}

}  // namespace

std::vector<std::vector<Shape>> shapes_of_urdf(const fs::path& file, const robot::RobotModel& robot,
                                               std::vector<std::string>* warnings) {
  return Reader(file, robot, warnings).read();
}

}  // namespace cotwin::scene
