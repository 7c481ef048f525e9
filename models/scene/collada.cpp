#include "models/scene/collada.h"

#include <tinyxml2.h>

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "models/foundation/formats/xml_reason.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::scene {

namespace {

using Eigen::Vector3d;
using tinyxml2::XMLElement;
using Index = std::uint32_t;

constexpr std::size_t kMostColladaNumbers = 60'000'000;  // read, again for each instance of a geometry
constexpr int kDeepestNode = 100;                        // nodes in nodes
constexpr std::size_t kMostNodes = 100'000;              // a node may be instantiated in several others

class ColladaReader {
 public:
  explicit ColladaReader(const std::string& place) : place_(place) {}

  Mesh read(std::string_view xml) {
    tinyxml2::XMLDocument document;
    if (document.Parse(xml.data(), xml.size()) != tinyxml2::XML_SUCCESS)
      throw Error(place_ + ":" + std::to_string(document.ErrorLineNum()), "not well-formed XML: " + xml::reason(document));
    const XMLElement* const root = document.RootElement();
    if (root == nullptr || std::string_view(root->Name()) != "COLLADA")
      throw Error(place_, "no <COLLADA>, expected a COLLADA file");
    index(*root);
    double metre = 1;
    if (const XMLElement* const asset = root->FirstChildElement("asset")) {
      if (const XMLElement* const unit = asset->FirstChildElement("unit")) metre = unit->DoubleAttribute("meter", 1);
    }
    if (!(metre > 0 && std::isfinite(metre))) throw Error(place_, "<unit meter> is no length > 0");
    Eigen::Affine3d X = Eigen::Affine3d::Identity();
    X.linear() *= metre;
    if (const XMLElement* const scene = shown_scene(*root)) children(*scene, X, 0);
    if (mesh_.triangles.empty()) throw Error(place_, "no triangles in the visual scene, expected some");
    return std::move(mesh_);
  }

 private:
  [[noreturn]] void fail(const XMLElement& at, const std::string& what) const {
    throw Error(place_ + ":" + std::to_string(at.GetLineNum()), what);
  }

  /// All elements with an id.
  void index(const XMLElement& element, int depth = 0) {
    if (const char* const id = element.Attribute("id")) by_id_.emplace(id, &element);
    if (depth == kDeepestNode) return;
    for (const XMLElement* inner = element.FirstChildElement(); inner != nullptr; inner = inner->NextSiblingElement())
      index(*inner, depth + 1);
  }
  const XMLElement& find(const XMLElement& at, const char* attribute) const {
    const char* const reference = at.Attribute(attribute);
    const auto found = reference == nullptr || *reference != '#' ? by_id_.end() : by_id_.find(reference + 1);
    if (found == by_id_.end())
      fail(at, std::string(attribute) + " '" + (reference == nullptr ? "" : reference) + "' of <" + at.Name() +
                   ">, expected # and an id of the file");
    return *found->second;
  }

  template <class Number>
  std::vector<Number> numbers(const XMLElement& element) {
    std::vector<Number> all;
    std::string_view rest = element.GetText() == nullptr ? "" : element.GetText();
    constexpr const char* kBlanks = " \t\r\n";
    for (std::size_t begin = rest.find_first_not_of(kBlanks); begin != std::string_view::npos;
         begin = rest.find_first_not_of(kBlanks)) {
      rest.remove_prefix(begin);
      const std::string_view word = rest.substr(0, rest.find_first_of(kBlanks));
      rest.remove_prefix(word.size());
      if (++numbers_ > kMostColladaNumbers) fail(element, "more than " + std::to_string(kMostColladaNumbers) + " numbers");
      if constexpr (std::is_same_v<Number, double>) {
        const std::optional<double> x = text::parse_real(word);
        if (!x || !std::isfinite(*x)) fail(element, "'" + std::string(word) + "', expected a number");
        all.push_back(*x);
      } else {
        const std::optional<long long> x = text::parse_integer(word);
        if (!x || *x < 0 || *x > static_cast<long long>(kMostColladaNumbers))
          fail(element, "'" + std::string(word) + "', expected an index");
        all.push_back(static_cast<Number>(*x));
      }
    }
    return all;
  }
  std::vector<double> exactly(const XMLElement& element, std::size_t count) {
    std::vector<double> all = numbers<double>(element);
    if (all.size() != count)
      fail(element, std::string("<") + element.Name() + "> has " + std::to_string(all.size()) + " numbers, expected " +
                        std::to_string(count));
    return all;
  }

  /// The scene that <scene> names, otherwise the first one of the file.
  const XMLElement* shown_scene(const XMLElement& root) const {
    const XMLElement* const scene = root.FirstChildElement("scene");
    const XMLElement* const named = scene == nullptr ? nullptr : scene->FirstChildElement("instance_visual_scene");
    if (named != nullptr) return &find(*named, "url");
    const XMLElement* const library = root.FirstChildElement("library_visual_scenes");
    return library == nullptr ? nullptr : library->FirstChildElement("visual_scene");
  }

  void children(const XMLElement& parent, const Eigen::Affine3d& X, int depth) {
    for (const XMLElement* node = parent.FirstChildElement("node"); node != nullptr; node = node->NextSiblingElement("node"))
      this->node(*node, X, depth);
  }

  void node(const XMLElement& node, Eigen::Affine3d X, int depth) {
    if (depth > kDeepestNode) fail(node, "nodes within more than " + std::to_string(kDeepestNode) + " nodes");
    if (++nodes_ > kMostNodes) fail(node, "more than " + std::to_string(kMostNodes) + " nodes");
    for (const XMLElement* e = node.FirstChildElement(); e != nullptr;
         e = e->NextSiblingElement()) {  // transforms in their order
      const std::string_view name = e->Name();
      if (name == "matrix") {
        const std::vector<double> m = exactly(*e, 16);
        Eigen::Affine3d M;
        M.matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(m.data());
        M.makeAffine();
        X = X * M;
      } else if (name == "translate") {
        const std::vector<double> t = exactly(*e, 3);
        X.translate(Vector3d(t[0], t[1], t[2]));
      } else if (name == "rotate") {
        const std::vector<double> r = exactly(*e, 4);  // axis, degrees
        const Vector3d axis(r[0], r[1], r[2]);
        if (axis.norm() > 0) X.rotate(Eigen::AngleAxisd(r[3] * M_PI / 180, axis.normalized()));
      } else if (name == "scale") {
        const std::vector<double> s = exactly(*e, 3);
        X.scale(Vector3d(s[0], s[1], s[2]));
      } else if (name == "skew") {
        fail(*e, "<skew>, expected <matrix>, <translate>, <rotate> and <scale>");
      }
    }
    for (const XMLElement* e = node.FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
      const std::string_view name = e->Name();
      if (name == "instance_geometry") geometry(find(*e, "url"), X);
      if (name == "instance_node") this->node(find(*e, "url"), X, depth + 1);
      if (name == "instance_controller") fail(*e, "<instance_controller> (a skin), expected <instance_geometry>");
    }
    children(node, X, depth + 1);
  }

  void geometry(const XMLElement& geometry, const Eigen::Affine3d& X) {
    const XMLElement* const mesh = geometry.FirstChildElement("mesh");
    if (mesh == nullptr) return;  // a spline
    for (const XMLElement* e = mesh->FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
      const std::string_view name = e->Name();
      if (name == "triangles" || name == "polylist" || name == "polygons") primitives(*e, X);
      if (name == "tristrips" || name == "trifans")
        fail(*e, "<" + std::string(name) + ">, expected <triangles>, <polylist> or <polygons>");
    }
  }

  /// The positions that <input semantic="VERTEX"> names.
  const std::vector<double>& positions(const XMLElement& input) {
    const XMLElement& vertices = find(input, "source");
    for (const XMLElement* e = vertices.FirstChildElement("input"); e != nullptr; e = e->NextSiblingElement("input")) {
      if (std::string_view(e->Attribute("semantic") == nullptr ? "" : e->Attribute("semantic")) != "POSITION") continue;
      const XMLElement& source = find(*e, "source");
      const auto [known, is_new] = positions_.try_emplace(&source);
      if (is_new) {
        const XMLElement* const array = source.FirstChildElement("float_array");
        if (array == nullptr) fail(source, "<source> without <float_array>");
        known->second = numbers<double>(*array);
        if (known->second.size() % 3 != 0) fail(*array, "has no multiple of 3 numbers, expected x, y, z");
      }
      return known->second;
    }
    fail(vertices, "<vertices> without positions");
  }

  void primitives(const XMLElement& element, const Eigen::Affine3d& X) {
    std::size_t stride = 0, offset = 0;
    const std::vector<double>* points = nullptr;
    for (const XMLElement* e = element.FirstChildElement("input"); e != nullptr; e = e->NextSiblingElement("input")) {
      const int at = e->IntAttribute("offset", 0);
      if (at < 0 || at > 1000) fail(*e, "offset " + std::to_string(at) + ", expected 0 to 1000");
      stride = std::max(stride, static_cast<std::size_t>(at) + 1);
      if (std::string_view(e->Attribute("semantic") == nullptr ? "" : e->Attribute("semantic")) != "VERTEX") continue;
      points = &positions(*e);
      offset = static_cast<std::size_t>(at);
    }
    if (points == nullptr) fail(element, std::string("<") + element.Name() + "> without vertices");
    numbers_ += points->size();
    constexpr Index kUnused = ~Index{0};
    std::vector<Index> placed(points->size() / 3, kUnused);  // vertices of the mesh; files share points between materials
    const auto place = [&](Index point) {
      if (point >= placed.size())
        fail(element, "vertex " + std::to_string(point) + ", expected less than " + std::to_string(placed.size()));
      if (placed[point] == kUnused) {
        placed[point] = static_cast<Index>(mesh_.vertices.size());
        const double* const p = &(*points)[3 * std::size_t{point}];
        mesh_.vertices.push_back(X * Vector3d(p[0], p[1], p[2]));
      }
      return placed[point];
    };
    const bool is_mirrored = X.linear().determinant() < 0;
    const auto add = [&](const std::vector<Index>& p, std::size_t begin, std::size_t corners) {
      const auto corner = [&](std::size_t k) { return place(p[(begin + k) * stride + offset]); };
      for (std::size_t k = 2; k < corners; ++k) {
        std::array<Index, 3> triangle = {corner(0), corner(k - 1), corner(k)};
        if (is_mirrored) std::swap(triangle[1], triangle[2]);
        mesh_.triangles.push_back(triangle);
      }
    };
    const std::string_view kind = element.Name();
    std::vector<Index> sizes;
    if (const XMLElement* const vcount = element.FirstChildElement("vcount"); kind == "polylist" && vcount != nullptr)
      sizes = numbers<Index>(*vcount);
    for (const XMLElement* e = element.FirstChildElement("p"); e != nullptr; e = e->NextSiblingElement("p")) {
      const std::vector<Index> p = numbers<Index>(*e);
      const std::size_t corners = p.size() / stride;
      if (kind == "polygons") sizes = {static_cast<Index>(corners)};
      if (kind == "triangles") sizes.assign(corners / 3, 3);
      std::size_t begin = 0;
      for (const Index size : sizes) {
        if (begin + size > corners) fail(*e, "fewer corners than polygons have");
        add(p, begin, size);
        begin += size;
      }
    }
  }

  const std::string& place_;
  std::map<std::string_view, const XMLElement*> by_id_;
  std::map<const XMLElement*, std::vector<double>> positions_;
  std::size_t nodes_ = 0, numbers_ = 0;
  Mesh mesh_;
};

}  // namespace

Mesh parse_collada(std::string_view xml, const std::string& place) { return ColladaReader(place).read(xml); }

}  // namespace cotwin::scene
