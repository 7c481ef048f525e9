#include "models/scene/urdf/urdf_geometry.h"

#include <Eigen/Geometry>
#include <cmath>
#include <string_view>
#include <system_error>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::scene {

namespace fs = std::filesystem;

namespace {

constexpr double kLargestNumber = 1e15;  // products of larger numbers may overflow

using Eigen::Vector3d;
using tinyxml2::XMLElement;

std::vector<double> numbers(const fs::path& file, const XMLElement& element, const char* attribute, std::size_t count) {
  const std::string text = element.Attribute(attribute);
  const auto fail = [&](const std::string& expected) {
    throw Error(place_in_urdf(file, element), attribute + ("=\"" + text) + "\", expected " + expected);
  };
  const std::string words = count == 3 ? "three" : "four";
  std::vector<double> numbers;
  for (const std::string_view word : text::split(text, ' ')) {
    if (text::trim(word).empty()) continue;
    const std::optional<double> x = text::parse_real(word);
    if (!x || !(std::abs(*x) < kLargestNumber)) fail(words + " numbers of magnitude below " + text::to_text(kLargestNumber));
    numbers.push_back(*x);
  }
  if (numbers.size() != count) fail(words + " numbers");
  return numbers;
}

}  // namespace

std::string place_in_urdf(const fs::path& file, const XMLElement& element) {
  return file.string() + ":" + std::to_string(element.GetLineNum());
}

Vector3d urdf_vector(const fs::path& file, const XMLElement& element, const char* attribute, const Vector3d& fallback) {
  return element.Attribute(attribute) == nullptr ? fallback : Vector3d(numbers(file, element, attribute, 3).data());
}

double urdf_length(const fs::path& file, const XMLElement& element, const char* attribute) {
  const char* const text = element.Attribute(attribute);
  const std::optional<double> x = text != nullptr ? text::parse_real(text) : std::nullopt;
  if (!x || !(*x > 0 && *x < kLargestNumber)) {
    throw Error(place_in_urdf(file, element), std::string("<") + element.Name() + "> with " + attribute + "=\"" +
                                                  (text != nullptr ? text : "") + "\", expected a length > 0 and below " +
                                                  text::to_text(kLargestNumber) + " m");
  }
  return *x;
}

Pose urdf_origin(const fs::path& file, const XMLElement& element) {
  const XMLElement* const origin = element.FirstChildElement("origin");
  if (origin == nullptr) return {};
  const Vector3d rpy = urdf_vector(file, *origin, "rpy", Vector3d::Zero());
  if (origin->Attribute("quat_xyzw") != nullptr) {  // URDF 1.2
    const std::vector<double> Q = numbers(file, *origin, "quat_xyzw", 4);
    const Eigen::Quaterniond turned(Q[3], Q[0], Q[1], Q[2]);
    if (!(std::abs(turned.norm() - 1) < 1e-3) || origin->Attribute("rpy") != nullptr)
      throw Error(place_in_urdf(file, *origin), "quat_xyzw, expected a quaternion of length 1, without rpy");
    return {turned.normalized().toRotationMatrix(), urdf_vector(file, *origin, "xyz", Vector3d::Zero())};
  }
  return {rotation_from_rpy(rpy.x(), rpy.y(), rpy.z()), urdf_vector(file, *origin, "xyz", Vector3d::Zero())};
}

std::optional<fs::path> find_urdf_mesh(const fs::path& urdf, const std::string& filename) {
  std::string rest = filename;
  std::vector<std::string> names{rest};
  for (const std::string_view scheme : {"package://", "model://", "file://"}) {
    if (rest.rfind(scheme, 0) != 0) continue;
    rest = rest.substr(scheme.size());
    names = {rest};
    if (const std::size_t slash = rest.find('/'); scheme != "file://" && slash != std::string::npos)
      names.push_back(rest.substr(slash + 1));
  }
  std::error_code ignored;
  for (fs::path folder = fs::absolute(urdf, ignored).parent_path();; folder = folder.parent_path()) {
    for (const std::string& candidate : names) {
      const fs::path found = folder / candidate;
      if (fs::is_regular_file(found, ignored)) return found;
    }
    if (folder == folder.parent_path()) return std::nullopt;
  }
}

}  // namespace cotwin::scene
