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
using Points = std::vector<double>;  // x, y, z of each

constexpr const char* kBlanks = " \t\r\n";

constexpr int kDeepestNode = 100;            // nodes in nodes
constexpr std::size_t kMostNodes = 100'000;  // a node may be instantiated in several others

class ColladaReader {
 public:
  ColladaReader(const std::string& place, std::size_t most) : place_(place), most_(most) {}

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
      if (const XMLElement* const unit = asset->FirstChildElement("unit")) metre = metres(*unit);
    }
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

  /// Counts what was read or placed. A file with nodes in nodes can ask for much more than it contains.
  void count(const XMLElement& at, std::size_t more) {
    if (more > most_ - counted_) fail(at, "more than " + std::to_string(most_) + " numbers and elements");
    counted_ += more;
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

  static bool is_blank(char c) { return std::string_view(kBlanks).find(c) != std::string_view::npos; }

  /// The text of an element, with what follows a comment.
  std::string text_of(const XMLElement& element) const {
    std::string text;
    for (const tinyxml2::XMLNode* part = element.FirstChild(); part != nullptr; part = part->NextSibling()) {
      if (part->ToElement() != nullptr) fail(*part->ToElement(), std::string("<") + part->Value() + "> among numbers");
      if (part->ToText() == nullptr) continue;
      const std::string_view more = part->Value();
      // tinyxml2 leaves out a text of blanks alone, so that it is unknown whether these are one number.
      if (!text.empty() && !more.empty() && !is_blank(text.back()) && !is_blank(more.front()))
        fail(element, "a comment between '" + text.substr(text.find_last_of(kBlanks) + 1) + "' and '" +
                          std::string(more.substr(0, more.find_first_of(kBlanks))) + "', expected blanks beside it");
      text += more;
    }
    return text;
  }

  template <class Number>
  std::vector<Number> numbers(const XMLElement& element) {
    std::vector<Number> all;
    const std::string text = text_of(element);
    std::string_view rest = text;
    for (std::size_t begin = rest.find_first_not_of(kBlanks); begin != std::string_view::npos;
         begin = rest.find_first_not_of(kBlanks)) {
      rest.remove_prefix(begin);
      const std::string_view word = rest.substr(0, rest.find_first_of(kBlanks));
      rest.remove_prefix(word.size());
      count(element, 1);
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

  long long integer(const XMLElement& element, const char* attribute, long long otherwise) const {
    const char* const text = element.Attribute(attribute);
    if (text == nullptr) return otherwise;
    const std::optional<long long> x = text::parse_integer(text);
    if (!x) fail(element, std::string(attribute) + " '" + text + "' of <" + element.Name() + ">, expected a whole number");
    return *x;
  }
  double metres(const XMLElement& unit) const {
    const char* const text = unit.Attribute("meter");
    if (text == nullptr) return 1;
    const std::optional<double> x = text::parse_real(text);
    if (!x || !(*x > 0 && std::isfinite(*x))) fail(unit, "<unit meter> is '" + std::string(text) + "', expected a length > 0");
    return *x;
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
      count(*e, 1);
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
      } else if (name == "skew" || name == "lookat") {
        fail(*e, "<" + std::string(name) + ">, expected <matrix>, <translate>, <rotate> and <scale>");
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
    const auto [known, is_new] = meshes_.try_emplace(&geometry);
    Mesh& part = known->second;
    if (is_new) part = mesh_of(geometry);
    count(geometry, 3 * (part.vertices.size() + part.triangles.size()));
    const auto first = static_cast<Index>(mesh_.vertices.size());
    for (const Vector3d& p : part.vertices) mesh_.vertices.push_back(X * p);
    const bool is_mirrored = X.linear().determinant() < 0;
    for (std::array<Index, 3> triangle : part.triangles) {
      for (Index& corner : triangle) corner += first;
      if (is_mirrored) std::swap(triangle[1], triangle[2]);
      mesh_.triangles.push_back(triangle);
    }
  }

  /// In the geometry's own coordinates, with the points that its polygons have.
  Mesh mesh_of(const XMLElement& geometry) {
    Mesh part;
    for (const char* const kind : {"convex_mesh", "brep"}) {
      if (const XMLElement* const other = geometry.FirstChildElement(kind))
        fail(*other, std::string("<") + kind + ">, expected <mesh>");
    }
    const XMLElement* const mesh = geometry.FirstChildElement("mesh");
    if (mesh == nullptr) return part;  // a spline
    std::map<const Points*, std::vector<Index>> placed;
    for (const XMLElement* e = mesh->FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
      count(*e, 1);
      const std::string_view name = e->Name();
      if (name == "triangles" || name == "polylist" || name == "polygons") primitives(*e, placed, part);
      if (name == "tristrips" || name == "trifans")
        fail(*e, "<" + std::string(name) + ">, expected <triangles>, <polylist> or <polygons>");
    }
    return part;
  }

  /// The positions that <input semantic="VERTEX"> names.
  const Points& positions(const XMLElement& input) {
    const XMLElement& vertices = find(input, "source");
    for (const XMLElement* e = vertices.FirstChildElement("input"); e != nullptr; e = e->NextSiblingElement("input")) {
      count(*e, 1);
      if (!has_semantic(*e, "POSITION")) continue;
      const XMLElement& source = find(*e, "source");
      const auto [known, is_new] = positions_.try_emplace(&source);
      if (is_new) known->second = points_of(source);
      return known->second;
    }
    fail(vertices, "<vertices> without positions");
  }

  Points points_of(const XMLElement& source) {
    const XMLElement* const array = source.FirstChildElement("float_array");
    if (array == nullptr) fail(source, "<source> without <float_array>");
    const XMLElement* const technique = source.FirstChildElement("technique_common");
    if (const XMLElement* const accessor = technique == nullptr ? nullptr : technique->FirstChildElement("accessor")) {
      const long long stride = integer(*accessor, "stride", 1), offset = integer(*accessor, "offset", 0);
      if (stride != 3 || offset != 0)
        fail(*accessor, "positions with stride " + std::to_string(stride) + " and offset " + std::to_string(offset) +
                            ", expected stride 3 and offset 0");
      if (accessor->Attribute("source") != nullptr && &find(*accessor, "source") != array)
        fail(*accessor, "positions are not in the <float_array> of their <source>");
    }
    Points points = numbers<double>(*array);
    if (points.size() % 3 != 0) fail(*array, "has no multiple of 3 numbers, expected x, y, z");
    return points;
  }

  static bool has_semantic(const XMLElement& input, std::string_view semantic) {
    const char* const own = input.Attribute("semantic");
    return own != nullptr && own == semantic;
  }

  /// Adds the triangles of an element to `mesh`. `placed` has the vertices of the mesh, by point.
  void primitives(const XMLElement& element, std::map<const Points*, std::vector<Index>>& placed_of, Mesh& mesh) {
    const std::string_view kind = element.Name();
    std::size_t stride = 0, offset = 0;
    const XMLElement *vertices = nullptr, *vcount = nullptr;
    std::vector<const XMLElement*> indices;
    for (const XMLElement* e = element.FirstChildElement(); e != nullptr; e = e->NextSiblingElement()) {
      count(*e, 1);
      const std::string_view name = e->Name();
      if (name == "ph") fail(*e, "<ph> (polygons with holes), expected <p>");
      if (name == "p") indices.push_back(e);
      if (name == "vcount") vcount = e;
      if (name != "input") continue;
      const long long at = integer(*e, "offset", 0);
      if (at < 0 || at > 1000) fail(*e, "offset " + std::to_string(at) + ", expected 0 to 1000");
      stride = std::max(stride, static_cast<std::size_t>(at) + 1);
      if (!has_semantic(*e, "VERTEX")) continue;
      vertices = e;
      offset = static_cast<std::size_t>(at);
    }
    if (vertices == nullptr) fail(element, std::string("<") + element.Name() + "> without vertices");
    if (indices.empty()) return;
    const Points& points = positions(*vertices);
    constexpr Index kUnused = ~Index{0};
    const auto [known, is_new] = placed_of.try_emplace(&points);
    std::vector<Index>& placed = known->second;
    if (is_new) {
      count(element, points.size());
      placed.assign(points.size() / 3, kUnused);
    }
    const auto place = [&](Index point) {
      if (point >= placed.size())
        fail(element, "vertex " + std::to_string(point) + ", expected less than " + std::to_string(placed.size()));
      if (placed[point] == kUnused) {
        placed[point] = static_cast<Index>(mesh.vertices.size());
        const double* const p = &points[3 * std::size_t{point}];
        mesh.vertices.emplace_back(p[0], p[1], p[2]);
      }
      return placed[point];
    };
    const auto add = [&](const std::vector<Index>& p, std::size_t begin, std::size_t corners) {
      const auto corner = [&](std::size_t k) { return place(p[(begin + k) * stride + offset]); };
      for (std::size_t k = 2; k < corners; ++k) mesh.triangles.push_back({corner(0), corner(k - 1), corner(k)});
    };
    std::vector<Index> sizes;
    if (kind == "polylist") {
      if (vcount == nullptr) fail(element, "<polylist> with <p> but without <vcount>");
      sizes = numbers<Index>(*vcount);
    }
    for (const XMLElement* const e : indices) {
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
  std::map<const XMLElement*, Points> positions_;  // by <source>
  std::map<const XMLElement*, Mesh> meshes_;       // by <geometry>
  std::size_t most_, nodes_ = 0, counted_ = 0;
  Mesh mesh_;
};

}  // namespace

Mesh parse_collada(std::string_view xml, const std::string& place, std::size_t most) {
  return ColladaReader(place, most).read(xml);
}

}  // namespace cotwin::scene
