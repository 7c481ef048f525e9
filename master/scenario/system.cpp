#include "master/scenario/system.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "master/scenario/annotation.h"
#include "master/scenario/uri.h"
#include "models/foundation/formats/parameter_set_xml.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master::ssp {

namespace {

constexpr std::size_t kMaxElements = 100'000;  // needed because references can multiply a few lines to millions of elements
constexpr std::size_t kMaxReferences = 100;    // nested; bounds the recursion over files

// Attributes that SSP allows on every element, and on the root of every file.
const std::vector<std::string> kBase = {"id", "description"};
const std::vector<std::string> kRoot = {"id",      "description", "author",         "fileversion",           "copyright",
                                        "license", "version",     "generationTool", "generationDateAndTime", "name"};

std::vector<std::string> with_base(std::vector<std::string> names) {
  names.insert(names.end(), kBase.begin(), kBase.end());
  return names;
}

void collect_ids(const xml::Element& element, std::map<std::string, const xml::Element*>& ids) {
  const std::string* id = xml::find(element, "id");
  if (id != nullptr && element.space == kSsd && element.name == "System") ids.emplace(*id, &element);
  for (const xml::Element& c : element.children) collect_ids(c, ids);
}

}  // namespace

void check_version(const xml::Element& root, const std::string& format, const xml::Complaint& complain) {
  const std::string* version = xml::find(root, "version");
  if (version == nullptr) {
    complain(root.place, "'" + root.name + "' without the attribute 'version', expected 1.0");
  } else if (version->rfind("1.", 0) != 0) {
    throw Error(root.place, "version '" + *version + "' of " + format + ", expected 1.0");
  }
}

const Connector* Element::find(std::string_view connector) const {
  const auto found = connector_index.find(connector);
  return found == connector_index.end() ? nullptr : &connectors[found->second];
}

const Element* Element::element(std::string_view wanted) const {
  const auto found = element_index.find(wanted);
  return found == element_index.end() ? nullptr : &elements[found->second];
}

Transformation read_transformation(const xml::Element& element, const xml::Complaint& complain) {
  Transformation t;
  t.suppress_unit_conversion = xml::boolean(element, "suppressUnitConversion", false);
  for (const xml::Element& c : element.children) {
    if (c.space != kSsc || c.name == "Annotations") continue;
    if (c.name != "LinearTransformation") {
      throw Error(c.place, c.name == "BooleanMappingTransformation" || c.name == "IntegerMappingTransformation" ||
                                   c.name == "EnumerationMappingTransformation"
                               ? "'" + c.name + "' is not supported, expected 'LinearTransformation' or none"
                               : xml::unknown("a transformation", c.name, {"LinearTransformation"}));
    }
    xml::check_attributes(c, {"factor", "offset"}, complain);
    t.factor = xml::real(c, "factor", 1.0);
    t.offset = xml::real(c, "offset", 0.0);
    if (!std::isfinite(t.factor) || !std::isfinite(t.offset)) throw Error(c.place, "factor or offset is not finite");
  }
  return t;
}

Element Reader::read(const xml::Element& document, const std::filesystem::path& folder, const std::filesystem::path& file,
                     bool confined) {
  folder_ = folder;
  confined_ = confined;
  if (!file.empty()) open_.push_back(std::filesystem::weakly_canonical(file).string());
  Element root = read_root(document, folder, "");
  if (!file.empty()) open_.pop_back();
  return root;
}

Element Reader::read_root(const xml::Element& root, const std::filesystem::path& folder, const std::string& path) {
  if (root.name == "robot") {
    throw Error(root.place, "is a URDF, expected a scenario (.ssd); cotwin new --robot FILE writes a first one for its robot");
  }
  if (root.name == "sdf")
    throw Error(root.place, "is a scene (SDF), expected a scenario (.ssd) whose components have the setting scene");
  if (root.space != kSsd || root.name != "SystemStructureDescription") {
    throw Error(root.place, "'" + root.name + "' of namespace '" + root.space +
                                "', expected 'SystemStructureDescription' of '" + kSsd + "'");
  }
  check_version(root, "SSD", complain_);
  xml::check_attributes(root, kRoot, complain_);
  xml::check_children(root, kSsd, {"System", "Enumerations", "Units", "DefaultExperiment", "Annotations"}, complain_);
  const xml::Element* top = xml::child(root, kSsd, "System");
  if (top == nullptr) throw Error(root.place, "'SystemStructureDescription' without 'System'");
  Document document{&root, folder, UnitDefinitions(read_unit_definitions(root, complain_)), {}};
  collect_ids(root, document.ids);
  return system(*top, document, path);
}

void Reader::count(const std::string& place) {
  if (++elements_ > kMaxElements) throw Error(place, "more than " + std::to_string(kMaxElements) + " elements");
}

Element Reader::system(const xml::Element& source, const Document& document, const std::string& path) {
  Element e;
  e.kind = Element::Kind::kSystem;
  e.path = path;
  xml::check_attributes(source, with_base({"name"}), complain_);
  xml::check_children(source, kSsd,
                      {"Connectors", "ElementGeometry", "ParameterBindings", "Elements", "Connections", "SignalDictionaries",
                       "SystemGeometry", "GraphicalElements", "Annotations"},
                      complain_);
  read_common(e, source, document);
  if (const xml::Element* list = xml::child(source, kSsd, "SignalDictionaries")) e.dictionaries = dictionaries(*list, document);
  if (const xml::Element* list = xml::child(source, kSsd, "Elements")) {
    xml::check_children(*list, kSsd, {"Component", "System", "SignalDictionaryReference"}, complain_);
    for (const xml::Element& c : list->children) {
      if (c.space != kSsd) continue;
      const std::string child_path = joined(path, xml::text(c, "name"));
      if (c.name == "Component") {
        e.elements.push_back(component(c, document, child_path));
      } else if (c.name == "System") {
        e.elements.push_back(system(c, document, child_path));
      } else if (c.name == "SignalDictionaryReference") {
        e.elements.push_back(reference(c, document, child_path));
      } else {
        continue;
      }
      const std::string& name = e.elements.back().name;
      if (!e.element_index.emplace(name, e.elements.size() - 1).second)
        throw Error(c.place, "a second element '" + name + "' in system '" + e.name + "'");
    }
  }
  if (const xml::Element* list = xml::child(source, kSsd, "Connections")) e.connections = connections(*list);
  return e;
}

Element Reader::component(const xml::Element& source, const Document& document, const std::string& path) {
  Element e;
  e.kind = Element::Kind::kComponent;
  e.path = path;
  xml::check_attributes(source, with_base({"name", "source", "type", "implementation"}), complain_);
  xml::check_children(source, kSsd, {"Connectors", "ElementGeometry", "ParameterBindings", "Annotations"}, complain_);
  read_common(e, source, document);
  e.source = xml::text(source, "source");
  e.type = xml::text(source, "type", "application/x-fmu-sharedlibrary");
  e.implementation = xml::choice(source, "implementation", kImplementationWords, fmu::InterfaceChoice::kAny);
  if (e.type == "application/x-ssp-definition") return referenced_system(source, e, document);
  if (e.type == "application/x-ssp-package") {
    throw Error(e.place, "component '" + path +
                             "' is an SSP package, expected an FMU, a unit or an SSD; unpack it and refer to its .ssd");
  }
  if (scheme_of(e.source) != "unit") {
    const std::filesystem::path file = uri_path(e.source, e.place);
    check_inside(file.is_absolute() ? file : document.folder / file, e.source, e.place);
    e.source =
        (file.is_absolute() ? file : (document.folder.lexically_relative(folder_) / file).lexically_normal()).generic_string();
  }
  return e;
}

Element Reader::referenced_system(const xml::Element& source, const Element& component, const Document& document) {
  const bool embedded = component.source.rfind('#', 0) == 0;
  const std::filesystem::path file = embedded ? std::filesystem::path() : resolve(source, component.source, document);
  // The document's place and the id identify an embedded system.
  const std::string key = embedded ? document.root->place + component.source : std::filesystem::weakly_canonical(file).string();
  if (std::find(open_.begin(), open_.end(), key) != open_.end())
    throw Error(source.place, "'" + component.source + "' contains itself");
  open_.push_back(key);
  if (open_.size() > kMaxReferences)
    throw Error(source.place, "more than " + std::to_string(kMaxReferences) + " nested references");
  Element e;
  if (embedded) {
    const auto target = document.ids.find(component.source.substr(1));
    if (target == document.ids.end())
      throw Error(source.place, "no 'System' with the id '" + component.source.substr(1) + "' in this file");
    e = system(*target->second, document, component.path);
  } else {
    const xml::Element root = xml::parse(read_text_file(file, "a system structure (.ssd)"), file.string());
    e = read_root(root, file.parent_path(), component.path);
    e.folder = file.parent_path();
    if (const xml::Element* ours = find_annotation(root)) e.annotation = std::make_shared<const xml::Element>(*ours);
  }
  open_.pop_back();
  e.name = component.name;
  e.place = component.place;
  // Bindings of the component are applied after those of the system and take precedence.
  e.assignments.insert(e.assignments.end(), component.assignments.begin(), component.assignments.end());
  return e;
}

Element Reader::reference(const xml::Element& source, const Document& document, const std::string& path) {
  Element e;
  e.kind = Element::Kind::kDictionaryReference;
  e.path = path;
  xml::check_attributes(source, with_base({"name", "dictionary"}), complain_);
  xml::check_children(source, kSsd, {"Connectors", "ElementGeometry", "ParameterBindings", "Annotations"}, complain_);
  read_common(e, source, document);
  e.dictionary = xml::text(source, "dictionary");
  return e;
}

void Reader::read_common(Element& e, const xml::Element& source, const Document& document) {
  count(source.place);
  e.place = source.place;
  e.name = xml::text(source, "name");
  if (e.name.empty()) throw Error(source.place, "an empty name");
  if (const xml::Element* list = xml::child(source, kSsd, "Connectors")) {
    xml::check_children(*list, kSsd, {"Connector"}, complain_);
    e.connectors = connectors(*list, "Connector", kSsd, document);
    for (std::size_t i = 0; i < e.connectors.size(); ++i) e.connector_index.emplace(e.connectors[i].name, i);
  }
  if (const xml::Element* list = xml::child(source, kSsd, "ParameterBindings")) bindings(e, *list, document);
}

std::vector<Connector> Reader::connectors(const xml::Element& list, const char* item, const char* item_space,
                                          const Document& document) {
  std::vector<Connector> result;
  std::set<std::string> names;
  for (const xml::Element& c : list.children) {
    if (c.space != item_space || c.name != item) continue;
    const bool entry = std::string_view(item) == "DictionaryEntry";
    xml::check_attributes(c, entry ? with_base({"name"}) : with_base({"name", "kind"}), complain_);
    xml::check_children(c, item_space, {"ConnectorGeometry", "Annotations"}, complain_);
    Connector connector{xml::text(c, "name"), ConnectorKind::kInout, "", "", c.place};
    if (!entry) connector.kind = xml::choice(c, "kind", kConnectorWords);
    xml::check_children(c, kSsc, {"Real", "Integer", "Boolean", "String", "Enumeration", "Binary", "Annotations"}, complain_);
    for (const xml::Element& type : c.children) {
      if (type.space != kSsc || type.name == "Annotations") continue;
      if (!connector.type.empty())
        throw Error(type.place, "connector '" + connector.name + "' has a second type '" + type.name + "'");
      connector.type = type.name;
      if (type.name == "Real") connector.unit = unit_of(type, document);
    }
    if (!names.insert(connector.name).second) throw Error(c.place, "a second connector '" + connector.name + "'");
    result.push_back(std::move(connector));
  }
  return result;
}

std::string Reader::unit_of(const xml::Element& type, const Document& document) {
  const std::string name = xml::text(type, "unit", "");
  xml::check_attributes(type, {"unit"}, complain_);
  if (name.empty()) return "";
  try {
    return units_.intern(document.units, name, type.place);
  } catch (const Error& error) {
    complain_("", error.what());
    return "";  // as if no unit were given: the variable's declared unit applies
  }
}

std::vector<Connection> Reader::connections(const xml::Element& list) {
  std::vector<Connection> result;
  xml::check_children(list, kSsd, {"Connection"}, complain_);
  for (const xml::Element& c : list.children) {
    if (c.space != kSsd || c.name != "Connection") continue;
    xml::check_attributes(
        c, with_base({"startElement", "startConnector", "endElement", "endConnector", "suppressUnitConversion"}), complain_);
    xml::check_children(c, kSsd, {"ConnectionGeometry", "Annotations"}, complain_);
    result.push_back({xml::text(c, "startElement", ""), xml::text(c, "startConnector"), xml::text(c, "endElement", ""),
                      xml::text(c, "endConnector"), read_transformation(c, complain_), c.place});
  }
  return result;
}

std::vector<Dictionary> Reader::dictionaries(const xml::Element& list, const Document& document) {
  std::vector<Dictionary> result;
  std::set<std::string> names;
  xml::check_children(list, kSsd, {"SignalDictionary"}, complain_);
  for (const xml::Element& c : list.children) {
    if (c.space != kSsd || c.name != "SignalDictionary") continue;
    xml::check_attributes(c, with_base({"name", "type", "source"}), complain_);
    Dictionary d{xml::text(c, "name"), {}, c.place, {}};
    const std::string source = xml::text(c, "source", "");
    xml::Element loaded;
    const xml::Element* root = xml::child(c, kSsb, "SignalDictionary");
    if (!source.empty()) {
      const std::filesystem::path file = resolve(c, source, document);
      loaded = xml::parse(read_text_file(file, "a signal dictionary (.ssb)"), file.string());
      root = &loaded;
    }
    if (root == nullptr || root->space != kSsb || root->name != "SignalDictionary") {
      throw Error(root == nullptr ? c.place : root->place,
                  "signal dictionary '" + d.name + "' without 'SignalDictionary' of '" + kSsb + "'");
    }
    check_version(*root, "SSB", complain_);
    xml::check_children(*root, kSsb, {"DictionaryEntry", "Enumerations", "Units", "Annotations"}, complain_);
    const Document own{
        root, document.folder, source.empty() ? document.units : UnitDefinitions(read_unit_definitions(*root, complain_)), {}};
    d.entries = connectors(*root, "DictionaryEntry", kSsb, own);
    for (std::size_t i = 0; i < d.entries.size(); ++i) d.index.emplace(d.entries[i].name, i);
    if (!names.insert(d.name).second) throw Error(c.place, "a second signal dictionary '" + d.name + "'");
    result.push_back(std::move(d));
  }
  return result;
}

std::filesystem::path Reader::resolve(const xml::Element& element, const std::string& source, const Document& document) const {
  if (xml::choice<bool>(element, "sourceBase", {{"SSD", false}, {"component", true}}, false)) {
    throw Error(
        element.place,
        "'" + source + "' is inside the component (sourceBase=component), expected a file relative to the system structure");
  }
  const std::filesystem::path path = document.folder / uri_path(source, element.place);
  check_inside(path, source, element.place);
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored))
    throw Error(element.place, "'" + source + "' is not a file: looked for " + path.string());
  return path.lexically_normal();
}

// Unpacked archives contain no links, so a check of the names suffices.
void Reader::check_inside(const std::filesystem::path& path, const std::string& source, const std::string& place) const {
  if (!confined_) return;
  const std::filesystem::path from_root = path.lexically_normal().lexically_relative(folder_.lexically_normal());
  if (from_root.empty() || *from_root.begin() == "..")
    throw Error(place, "'" + source + "' is outside the package, expected a file in it");
}

}  // namespace cotwin::master::ssp
