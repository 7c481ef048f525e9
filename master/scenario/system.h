#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "master/scenario/scenario.h"
#include "master/scenario/units.h"
#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/formats/xml.h"

/// An SSP 1.0 system structure before flattening: the tree of elements with their connectors, connections and parameter
/// bindings, with references to other files resolved. Clauses are those of SSP 1.0.1.
namespace cotwin::master::ssp {

/// "path.name"; "name" in the outermost system.
inline std::string joined(const std::string& path, const std::string& name) { return path.empty() ? name : path + "." + name; }

constexpr const char* kSsd = "http://ssp-standard.org/SSP1/SystemStructureDescription";
constexpr const char* kSsc = "http://ssp-standard.org/SSP1/SystemStructureCommon";
constexpr const char* kSsv = "http://ssp-standard.org/SSP1/SystemStructureParameterValues";
constexpr const char* kSsm = "http://ssp-standard.org/SSP1/SystemStructureParameterMapping";
constexpr const char* kSsb = "http://ssp-standard.org/SSP1/SystemStructureSignalDictionary";

struct Connector {
  std::string name;
  ConnectorKind kind = ConnectorKind::kInout;
  std::string type;  // "Real", …, "" if not given
  std::string unit;  // as in the UnitTable, "" if not given
  std::string place;
};

/// Transformation of a connection or a mapping, after the conversion of units of measure: to = factor · from + offset.
struct Transformation {
  double factor = 1, offset = 0;
  bool suppress_unit_conversion = false;
};

struct Connection {
  std::string start_element, start_connector, end_element, end_connector;  // element "": the system itself
  Transformation transformation;
  std::string place;
};

/// A parameter value after prefix and mapping. Its name is relative to the element with the binding.
struct Assignment {
  ParameterValue value;
  Transformation transformation;
};

struct Dictionary {
  std::string name;
  std::vector<Connector> entries;
  std::string place;
  std::map<std::string, std::size_t, std::less<>> index;  // name → entry
};

struct Element {
  enum class Kind { kComponent, kSystem, kDictionaryReference };
  Kind kind = Kind::kSystem;
  std::string name;  // within its system
  std::string path;  // from the root system, "cell.robot.drive"; "" for the root itself
  std::string place;
  std::vector<Connector> connectors;
  std::vector<Assignment> assignments;  // of all bindings in order: later ones replace earlier ones
  std::string source, type;             // of a component
  fmu::InterfaceChoice implementation = fmu::InterfaceChoice::kAny;
  std::vector<Element> elements;  // of a system
  std::vector<Connection> connections;
  std::vector<Dictionary> dictionaries;
  std::string dictionary;                          // of a reference
  std::shared_ptr<const xml::Element> annotation;  // of a system from another document: its cotwin:Master, if any
  std::filesystem::path folder;                    // of that document
  std::map<std::string, std::size_t, std::less<>> connector_index, element_index;  // name → index

  const Connector* find(std::string_view connector) const;
  const Element* element(std::string_view name) const;
};

/// Reads SSD documents into trees. One reader reads one scenario with all files that it refers to.
class Reader {
 public:
  Reader(UnitTable& units, xml::Complaint complain) : units_(units), complain_(std::move(complain)) {}

  /// Returns the root system of a document. Relative references start in `folder`; `file`, if not empty, is the document's
  /// file. If `confined`, for a document in a package, all referenced files must be inside `folder`. Throws Error for a
  /// document that is not SSD 1.x, duplicate names, references to missing files, and files that contain themselves.
  Element read(const xml::Element& document, const std::filesystem::path& folder, const std::filesystem::path& file,
               bool confined = false);

 private:
  struct Document {
    const xml::Element* root;
    std::filesystem::path folder;
    UnitDefinitions units;
    std::map<std::string, const xml::Element*> ids;  // id → system
  };

  Element read_root(const xml::Element& document, const std::filesystem::path& folder, const std::string& path);
  Element system(const xml::Element& source, const Document& document, const std::string& path);
  Element component(const xml::Element& source, const Document& document, const std::string& path);
  Element reference(const xml::Element& source, const Document& document, const std::string& path);
  Element referenced_system(const xml::Element& source, const Element& component, const Document& document);
  void read_common(Element& element, const xml::Element& source, const Document& document);
  std::vector<Connector> connectors(const xml::Element& list, const char* item, const char* item_space,
                                    const Document& document);
  std::string unit_of(const xml::Element& type, const Document& document);
  std::vector<Connection> connections(const xml::Element& list);
  void bindings(Element& element, const xml::Element& list, const Document& document);
  std::vector<Assignment> mapped(const ParameterSet& set, const std::string& prefix, const xml::Element* mapping,
                                 const Document& document);
  std::vector<Dictionary> dictionaries(const xml::Element& list, const Document& document);
  std::filesystem::path resolve(const xml::Element& element, const std::string& source, const Document& document) const;
  void check_inside(const std::filesystem::path& path, const std::string& source, const std::string& place) const;
  void count(const std::string& place);

  UnitTable& units_;
  xml::Complaint complain_;
  std::filesystem::path folder_;  // of the root document: sources of components are relative to it
  bool confined_ = false;
  std::vector<std::string> open_;  // files and embedded systems that are being read, to detect recursion
  std::size_t elements_ = 0, assignments_ = 0;
};

/// Reads the LinearTransformation, if any, and suppressUnitConversion of a connection or mapping entry. Throws Error for a
/// transformation of discrete values.
Transformation read_transformation(const xml::Element& element, const xml::Complaint& complain);

/// Throws Error for a root element of another version than 1.x. Calls `complain` for one without a version.
void check_version(const xml::Element& root, const std::string& format, const xml::Complaint& complain);

}  // namespace cotwin::master::ssp
