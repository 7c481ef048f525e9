#include "models/scene/urdf/urdf_in_si.h"

#include <tinyxml2.h>

#include <map>
#include <optional>
#include <sstream>
#include <string_view>

#include "models/foundation/formats/xml_reason.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/scene/urdf/urdf_geometry.h"

namespace cotwin::scene {

namespace fs = std::filesystem;

namespace {

using robot::UrdfUnits;
using tinyxml2::XMLElement;

/// Without the last digits, which the product with a factor such as 1e-6 changes.
constexpr int kDigits = 15;

class Converter {
 public:
  Converter(const fs::path& file, const UrdfUnits& units) : file_(file), units_(units), entries_("," + units.text + ",") {
    std::erase(entries_, ' ');
  }

  std::string convert() {
    tinyxml2::XMLDocument document;
    const std::string xml = text::read_file(file_, "a URDF", 16'000'000);
    if (document.Parse(xml.data(), xml.size()) != tinyxml2::XML_SUCCESS) {
      throw Error(file_.string() + ":" + std::to_string(document.ErrorLineNum()),
                  "not well-formed XML: " + xml::reason(document));
    }
    XMLElement* const root = document.RootElement();
    if (root == nullptr) throw Error(file_.string(), "no XML element, expected <robot>");
    for (const XMLElement* joint = root->FirstChildElement("joint"); joint != nullptr;
         joint = joint->NextSiblingElement("joint"))
      slides_[name_of(*joint)] = std::string_view(text_of(*joint, "type")) == "prismatic";
    visit(*root, false);
    if (root->FirstChildElement("si") == nullptr) {
      root->InsertFirstChild(document.NewElement("si"));
    } else if (units_.text != "si") {
      throw Error(place_in_urdf(file_, *root->FirstChildElement("si")),
                  "<si/>: its numbers are in SI already, expected --urdf-units si, or the file as it was before");
    }
    tinyxml2::XMLPrinter printer;
    document.Print(&printer);
    return printer.CStr();
  }

  std::vector<std::string> notes() const {
    std::vector<std::string> all;
    for (const auto& [what, count] : ignored_)
      all.push_back(file_.string() + ": " + what + " (" + text::counted(count, "time") +
                    "), which --urdf-units si takes in SI");
    return all;
  }

 private:
  static const char* text_of(const XMLElement& element, const char* attribute) {
    const char* const text = element.Attribute(attribute);
    return text == nullptr ? "" : text;
  }
  static std::string name_of(const XMLElement& element) { return text_of(element, "name"); }

  void scale(XMLElement& element, const char* attribute, double factor) const {
    const char* const written = element.Attribute(attribute);
    if (written == nullptr || factor == 1) return;
    std::string spelled;
    std::istringstream words(written);
    for (std::string word; words >> word;) {
      const std::optional<double> number = text::parse_real(word);
      if (!number) {
        throw Error(place_in_urdf(file_, element),
                    std::string(attribute) + " '" + word + "' of <" + element.Name() + ">, expected a number");
      }
      text::append(spelled, text::to_text(*number * factor, kDigits), " ");
    }
    element.SetAttribute(attribute, spelled.c_str());
  }

  /// The quantity that a unit of an element is of; "" for elements whose numbers are not converted.
  static std::string quantity_of(std::string_view element, std::string_view unit, bool slides) {
    const bool is_angle = unit.starts_with("rad") || unit.starts_with("deg");
    if (element == "mass" || element == "inertia") return std::string(element);
    if (element == "limit" || element == "mimic")
      return slides ? "length" : unit.find("/s") != std::string_view::npos || unit == "rpm" ? "speed" : "limit";
    if (element == "origin") return is_angle ? "rpy" : "length";
    const bool is_shape =
        element == "box" || element == "sphere" || element == "cylinder" || element == "capsule" || element == "mesh";
    return is_shape ? "length" : "";
  }

  /// Removes the units that are those of `units_`: the numbers are in them no more.
  void remove_unit(XMLElement& element, bool slides) {
    for (const char* attribute : {"unit", "units"}) {
      const std::string unit(text::trim(text_of(element, attribute)));
      const std::string quantity = quantity_of(element.Name(), unit, slides);
      if (unit.empty() || quantity.empty()) continue;
      const bool is_si_word = robot::is_si_unit(unit);
      const std::string what = std::string("<") + element.Name() + "> has " + attribute + "=\"" + unit + "\"";
      if (is_si_word && !robot::is_si(units_, quantity))
        throw Error(place_in_urdf(file_, element), what + ", expected " + quantity + " in SI in --urdf-units " + units_.text);
      if (units_.text == "si" && !is_si_word) ++ignored_[what];
      if (units_.text == "si" || entries_.find("," + quantity + "=" + unit + ",") != std::string::npos)
        element.DeleteAttribute(attribute);
    }
  }

  void visit(XMLElement& element, bool slides) {
    const std::string_view name = element.Name();
    if (name == "joint") slides = slides_[name_of(element)];
    remove_unit(element, slides);
    if (name == "origin") {
      scale(element, "xyz", units_.length);
      scale(element, "rpy", units_.rpy);
    } else if (name == "box") {
      scale(element, "size", units_.length);
    } else if (name == "sphere" || name == "cylinder" || name == "capsule") {
      scale(element, "radius", units_.length);
      scale(element, "length", units_.length);
    } else if (name == "mesh") {
      mesh(element);
    } else if (name == "mass") {
      scale(element, "value", units_.mass);
    } else if (name == "inertia") {
      for (const char* moment : {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}) scale(element, moment, units_.inertia);
    } else if (name == "joint") {
      joint(element);
    }
    for (XMLElement* inner = element.FirstChildElement(); inner != nullptr; inner = inner->NextSiblingElement())
      visit(*inner, slides);
  }

  void mesh(XMLElement& element) const {
    if (element.Attribute("scale") == nullptr) element.SetAttribute("scale", "1 1 1");
    scale(element, "scale", units_.length);
    const auto found = find_urdf_mesh(file_, text_of(element, "filename"));
    if (found) element.SetAttribute("filename", fs::absolute(*found).lexically_normal().c_str());
  }

  void joint(XMLElement& element) const {
    const bool slides = std::string_view(text_of(element, "type")) == "prismatic";
    const double position = slides ? units_.length : units_.limit;
    if (XMLElement* const limit = element.FirstChildElement("limit")) {
      scale(*limit, "lower", position);
      scale(*limit, "upper", position);
      for (const char* rate : {"velocity", "acceleration", "deceleration", "jerk"})
        scale(*limit, rate, slides ? units_.length : units_.speed);
    }
    if (XMLElement* const mimic = element.FirstChildElement("mimic")) {
      const auto leader = slides_.find(text_of(*mimic, "joint"));
      const bool leader_slides = leader != slides_.end() && leader->second;
      scale(*mimic, "offset", position);
      if (leader_slides == slides) return;
      if (mimic->Attribute("multiplier") == nullptr) mimic->SetAttribute("multiplier", "1");  // of other units, too
      scale(*mimic, "multiplier", position / (leader_slides ? units_.length : units_.limit));
    }
  }

  const fs::path& file_;
  const UrdfUnits& units_;
  std::string entries_;                          // of `units_`, each between commas
  std::map<std::string, bool> slides_;           // joints, whether prismatic
  std::map<std::string, std::int64_t> ignored_;  // units of the file that "si" takes as SI
};

}  // namespace

std::string urdf_in_si(const fs::path& file, const UrdfUnits& units, std::vector<std::string>* notes) {
  Converter converter(file, units);
  std::string converted = converter.convert();
  if (notes != nullptr) *notes = converter.notes();
  return converted;
}

}  // namespace cotwin::scene
