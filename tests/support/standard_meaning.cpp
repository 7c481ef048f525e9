// Rules in the texts of FMI 2.0.4, FMI 3.0.2 and SSP 1.0 that are not in their schemas.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <set>

#include "tests/support/standard_node.h"
#include "tests/support/standard_validator.h"

namespace cotwin::testing {

namespace {

using Names = std::set<std::string>;

class Meaning {
 public:
  std::vector<std::string> take() { return std::move(faults_); }

 protected:
  void fault(const Node& node, const std::string& what) { faults_.push_back(place(node) + what); }
  void must_be_new(const Node& node, Names& names, const std::string& name, const std::string& what) {
    if (!names.insert(name).second) fault(node, what + " '" + name + "' is not unique");
  }
  void must_be_among(const Node& node, const Names& names, const std::string& name, const std::string& what) {
    if (names.count(name) == 0) fault(node, what + " '" + name + "' is not there");
  }
  static std::vector<std::string> list(const std::string& text) {
    std::vector<std::string> all;
    std::size_t at = 0;
    while ((at = text.find_first_not_of(" \t\n", at)) != std::string::npos) {
      const std::size_t end = std::min(text.find_first_of(" \t\n", at), text.size());
      all.push_back(text.substr(at, end - at));
      at = end;
    }
    return all;
  }
  static double number(const std::string& text) {
    if (text == "INF") return HUGE_VAL;
    if (text == "-INF") return -HUGE_VAL;
    return std::strtod(text.c_str(), nullptr);
  }

 private:
  std::vector<std::string> faults_;
};

// FMI

/// A variable of either version.
struct ModelVariable {
  const Node* node = nullptr;   // with name and value reference
  const Node* typed = nullptr;  // the element with type, start and unit: a child in FMI 2, the same element in FMI 3
  std::string type, causality, variability, initial;
  bool has_start = false;
};

class FmiMeaning : public Meaning {
 public:
  FmiMeaning(const Node& root, bool two) : root_(root), two_(two) {
    collect_units();
    collect_types();
    collect_variables();
    check_interfaces();
    check_categories();
    for (const ModelVariable& v : variables_) {
      check_combination(v);
      check_start(v);
      check_references(v);
      check_range(v);
      if (!two_) check_of_fmi3(v);
    }
    check_structure();
  }

 private:
  void collect_units() {
    const Node* units = root_.child("UnitDefinitions");
    if (units == nullptr) return;
    for (const Node& unit : units->children) {
      if (units_.count(unit.text("name")) != 0) fault(unit, "unit '" + unit.text("name") + "' is not unique");
      Names& displayed = units_[unit.text("name")];
      for (const Node& display : unit.children) {
        if (display.name == "DisplayUnit") must_be_new(display, displayed, display.text("name"), "display unit");
      }
    }
  }
  void collect_types() {
    const Node* types = root_.child("TypeDefinitions");
    if (types == nullptr) return;
    for (const Node& type : types->children) {
      std::string kind = type.name;
      if (two_) {
        kind = type.children.empty() ? "" : type.children.front().name;
      } else {
        kind.resize(kind.size() - 4);  // "Float64Type"
      }
      if (!types_.emplace(type.text("name"), kind).second) fault(type, "type '" + type.text("name") + "' is not unique");
      check_unit(two_ && !type.children.empty() ? type.children.front() : type);
      const Node& items = two_ ? type.children.front() : type;
      Names names, values;
      for (const Node& item : items.children) {
        if (item.name != "Item") continue;
        must_be_new(item, names, item.text("name"), "item");
        must_be_new(item, values, item.text("value"), "value of an item");
      }
    }
  }
  void collect_variables() {
    Names names, references, independent;
    for (const Node& node : root_.child("ModelVariables")->children) {
      ModelVariable v;
      v.node = &node;
      v.typed = two_ ? &node.children.front() : &node;
      v.type = v.typed->name;
      v.causality = node.text("causality", "local");
      const bool continuous = two_ || v.type == "Float64" || v.type == "Float32";
      const bool parameter =
          v.causality == "parameter" || v.causality == "structuralParameter" || v.causality == "calculatedParameter";
      v.variability = node.text("variability", two_         ? "continuous"
                                               : parameter  ? "fixed"
                                               : continuous ? "continuous"
                                                            : "discrete");
      v.initial = node.text("initial");
      v.has_start = v.typed->find("start") != nullptr || (!two_ && v.typed->child("Start") != nullptr);
      must_be_new(node, names, node.text("name"), "name");
      if (!two_) must_be_new(node, references, node.text("valueReference"), "value reference");
      if (v.causality == "independent") {
        must_be_new(node, independent, "", "the independent variable");
        if (!continuous || (two_ && v.type != "Real")) fault(node, "the independent variable must be real");
      }
      if (!two_) {
        for (const Node& alias : node.children) {
          if (alias.name == "Alias") must_be_new(alias, names, alias.text("name"), "name");
        }
      }
      by_reference_.emplace(node.text("valueReference"), variables_.size());
      variables_.push_back(std::move(v));
    }
  }
  void check_interfaces() {
    const bool any = root_.child("ModelExchange") || root_.child("CoSimulation") || root_.child("ScheduledExecution");
    if (!any) fault(root_, "offers no interface");
    for (const Node& node : root_.children) {
      const std::string identifier = node.text("modelIdentifier", "x");
      const bool is_c = !identifier.empty() &&
                        identifier.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") ==
                            std::string::npos &&
                        (identifier[0] < '0' || identifier[0] > '9');
      if (!is_c) fault(node, "modelIdentifier '" + identifier + "' is no identifier of C");
      const std::string state = two_ ? "FMUstate" : "FMUState";
      const auto flag = [&](const std::string& name) { return node.text(name) == "true" || node.text(name) == "1"; };
      if (flag("canSerialize" + state) && !flag("canGetAndSet" + state)) fault(node, "serialises states that it cannot get");
    }
    for (const char* kind : {"ModelExchange", "CoSimulation"}) {
      int count = 0;
      for (const Node& node : root_.children) count += node.name == kind ? 1 : 0;
      if (count > 1) fault(root_, std::string(kind) + " stands there twice");
    }
    if (const Node* e = root_.child("DefaultExperiment")) {
      const std::string *start = e->find("startTime"), *stop = e->find("stopTime");
      if (stop != nullptr && number(*stop) < (start != nullptr ? number(*start) : 0)) fault(*e, "ends before it starts");
      for (const char* positive : {"tolerance", "stepSize"}) {
        if (e->find(positive) != nullptr && !(number(e->text(positive)) > 0))
          fault(*e, std::string(positive) + " is not positive");
      }
    }
  }
  void check_categories() {
    const Node* categories = root_.child("LogCategories");
    if (categories == nullptr) return;
    Names names;
    for (const Node& category : categories->children) must_be_new(category, names, category.text("name"), "log category");
  }

  /// FMI 2.0.4, 2.2.7, and FMI 3.0.2, 2.4.7.4: the variabilities that a causality may have.
  void check_combination(const ModelVariable& v) {
    static const std::map<std::string, Names> kAllowed = {
        {"parameter", {"fixed", "tunable"}},
        {"structuralParameter", {"fixed", "tunable"}},
        {"calculatedParameter", {"fixed", "tunable"}},
        {"input", {"discrete", "continuous"}},
        {"output", {"constant", "discrete", "continuous"}},
        {"local", {"constant", "fixed", "tunable", "discrete", "continuous"}},
        {"independent", {"continuous"}},
    };
    if (kAllowed.at(v.causality).count(v.variability) == 0)
      fault(*v.node, "causality " + v.causality + " with variability " + v.variability);
    const bool real = v.type == "Real" || v.type == "Float64" || v.type == "Float32";
    if (v.variability == "continuous" && !real) fault(*v.node, "variability continuous of " + v.type);
  }
  /// The default of `initial`, and the values that it may have.
  std::string initial_of(const ModelVariable& v) {
    const bool parameter = v.causality == "parameter" || v.causality == "structuralParameter";
    if (parameter || v.variability == "constant") return "exact";
    if (v.causality == "input" || v.causality == "independent") return "";
    return v.initial.empty() ? "calculated" : v.initial;
  }
  void check_start(const ModelVariable& v) {
    if (v.type == "Clock") return;
    const std::string initial = initial_of(v);
    if (!v.initial.empty() && (v.causality == "independent" || (two_ && v.causality == "input") || v.initial != initial))
      fault(*v.node, "initial = " + v.initial + " of " + v.causality + ", " + v.variability);
    if (v.causality == "calculatedParameter" && v.initial == "exact")
      fault(*v.node, "a calculated parameter with initial = exact");
    const bool needed = v.causality == "input" || initial == "exact" || initial == "approx";
    if (needed && !v.has_start) fault(*v.node, "has no start value");
    if (!needed && v.has_start) fault(*v.node, "has a start value, but is " + (initial.empty() ? v.causality : initial));
  }
  void check_unit(const Node& node) {
    const std::string* unit = node.find("unit");
    if (unit != nullptr && units_.count(*unit) == 0) fault(node, "unit '" + *unit + "' is not defined");
    check_display(node, unit != nullptr ? *unit : "");
  }
  void check_display(const Node& node, const std::string& unit) {
    const std::string* display = node.find("displayUnit");
    if (display == nullptr) return;
    const auto found = units_.find(unit);
    if (found == units_.end() || found->second.count(*display) == 0)
      fault(node, "displayUnit '" + *display + "' is none of unit '" + unit + "'");
  }
  void check_references(const ModelVariable& v) {
    if (const std::string* declared = v.typed->find("declaredType")) {
      const auto found = types_.find(*declared);
      if (found == types_.end()) {
        fault(*v.node, "declaredType '" + *declared + "' is not defined");
      } else if (found->second != v.type) {
        fault(*v.node, "declaredType '" + *declared + "' is of " + found->second + ", not " + v.type);
      }
    } else {
      check_unit(*v.typed);
    }
    if (const std::string* of = v.typed->find("derivative")) {
      const ModelVariable* other = two_ ? by_index(*of) : by_reference(*of);
      if (other == nullptr || other == &v || other->type != v.type)
        fault(*v.node, "derivative of no other variable of its type");
    }
  }
  void check_range(const ModelVariable& v) {
    const std::string *min = v.typed->find("min"), *max = v.typed->find("max");
    if (min != nullptr && max != nullptr && number(*min) > number(*max)) fault(*v.node, "max is less than min");
    for (const std::string& start : list(v.type == "String" || v.type == "Boolean" ? "" : v.typed->text("start"))) {
      if ((min != nullptr && number(start) < number(*min)) || (max != nullptr && number(start) > number(*max)))
        fault(*v.node, "start " + start + " is out of range");
    }
    const std::string* nominal = v.typed->find("nominal");
    if (nominal != nullptr && number(*nominal) == 0) fault(*v.node, "nominal is 0");
  }
  void check_of_fmi3(const ModelVariable& v) {
    std::size_t size = 1;
    bool sized = true;
    for (const Node& dimension : v.node->children) {
      if (dimension.name != "Dimension") continue;
      const std::string *start = dimension.find("start"), *reference = dimension.find("valueReference");
      if ((start == nullptr) == (reference == nullptr)) {
        fault(dimension, "expected either start or valueReference");
      } else if (start != nullptr) {
        if (*start == "0") fault(dimension, "start is 0");
        size *= std::stoull(*start);
      } else {
        const ModelVariable* other = by_reference(*reference);
        if (other == nullptr || other->causality != "structuralParameter" || other->type != "UInt64") {
          fault(dimension, "valueReference is no structural parameter of type UInt64");
          sized = false;
        } else {
          size *= std::stoull(other->typed->text("start", "0"));
        }
      }
    }
    std::size_t starts = list(v.typed->text("start")).size();
    for (const Node& start : v.node->children) starts += start.name == "Start" ? 1 : 0;
    if (v.has_start && sized && starts != 1 && starts != size)
      fault(*v.node, std::to_string(starts) + " start values for " + std::to_string(size) + " elements");
    for (const std::string& reference : list(v.node->text("clocks"))) {
      const ModelVariable* clock = by_reference(reference);
      if (clock == nullptr || clock->type != "Clock") fault(*v.node, "belongs to a clock that is none");
    }
    if (const std::string* previous = v.node->find("previous")) {
      const ModelVariable* other = by_reference(*previous);
      if (other == nullptr || other->type != v.type) fault(*v.node, "previous of no variable of its type");
    }
    if (v.type == "Clock") {
      const std::string kind = v.node->text("intervalVariability");
      const bool needs = kind == "constant" || kind == "fixed";
      if (needs && v.node->find("intervalDecimal") == nullptr) fault(*v.node, "a " + kind + " clock has no interval");
    }
  }
  const ModelVariable* by_index(const std::string& index) const {
    const unsigned long long i = std::stoull(index);
    return i >= 1 && i <= variables_.size() ? &variables_[i - 1] : nullptr;
  }
  const ModelVariable* by_reference(const std::string& reference) const {
    const auto found = by_reference_.find(reference);
    return found != by_reference_.end() ? &variables_[found->second] : nullptr;
  }

  const ModelVariable* variable_of(const Node& unknown) {
    const ModelVariable* v = two_ ? by_index(unknown.text("index")) : by_reference(unknown.text("valueReference"));
    if (v == nullptr) fault(unknown, "is no variable");
    return v;
  }
  void check_structure() {
    const Node& structure = *root_.child("ModelStructure");
    std::map<std::string, std::vector<const Node*>> lists;
    for (const Node& child : structure.children) {
      if (!two_) {
        lists[child.name].push_back(&child);
      } else {
        for (const Node& unknown : child.children) lists[child.name].push_back(&unknown);
      }
    }
    std::map<std::string, std::set<const ModelVariable*>> listed;
    for (const auto& [name, unknowns] : lists) {
      unsigned long long last = 0;
      for (const Node* unknown : unknowns) {
        const ModelVariable* v = variable_of(*unknown);
        if (v == nullptr) continue;
        if (!listed[name].insert(v).second) fault(*unknown, "stands twice among " + name);
        if (two_ && name != "Derivatives") {  // in ascending order (2.2.8)
          const unsigned long long index = std::stoull(unknown->text("index"));
          if (index < last) fault(*unknown, "is out of order among " + name);
          last = index;
        }
        check_dependencies(*unknown);
        const bool derivative = v->typed->find("derivative") != nullptr;
        if ((name == "Derivatives" || name == "ContinuousStateDerivative") && !derivative)
          fault(*unknown, "is no derivative of a variable");
      }
    }
    const std::string outputs = two_ ? "Outputs" : "Output";
    for (const ModelVariable& v : variables_) {
      const bool is = v.causality == "output", stands = listed[outputs].count(&v) != 0;
      if (is && !stands) fault(*v.node, "is an output that is not among those of ModelStructure");
      if (!is && stands) fault(*v.node, "stands among the outputs of ModelStructure and is none");
    }
  }
  void check_dependencies(const Node& unknown) {
    const std::vector<std::string> known = list(unknown.text("dependencies")), kinds = list(unknown.text("dependenciesKind"));
    for (const std::string& k : known) {
      if ((two_ ? by_index(k) : by_reference(k)) == nullptr) fault(unknown, "depends on " + k + ", which is no variable");
    }
    if (unknown.find("dependenciesKind") == nullptr) return;
    if (unknown.find("dependencies") == nullptr || kinds.size() != known.size())
      fault(unknown, "has " + std::to_string(kinds.size()) + " kinds of " + std::to_string(known.size()) + " dependencies");
  }

  const Node& root_;
  bool two_;
  std::map<std::string, Names> units_;        // and their display units
  std::map<std::string, std::string> types_;  // and their kinds
  std::vector<ModelVariable> variables_;
  std::map<std::string, std::size_t> by_reference_;  // the first of them
};

// SSP

class SspMeaning : public Meaning {
 public:
  explicit SspMeaning(const Node& root) {
    collect(root, "Units", units_, "unit");
    collect(root, "Enumerations", enumerations_, "enumeration");
    if (root.name == "ParameterSet") {
      check_parameters(root);
    } else {
      check_system(*root.child("System"));
      if (const Node* e = root.child("DefaultExperiment")) {
        if (e->find("stopTime") && number(e->text("stopTime")) < number(e->text("startTime", "0")))
          fault(*e, "ends before it starts");
      }
    }
  }

 private:
  void collect(const Node& root, const char* list_name, Names& names, const std::string& what) {
    if (const Node* all = root.child(list_name)) {
      for (const Node& node : all->children) must_be_new(node, names, node.text("name"), what);
    }
  }
  void check_measures(const Node& node) {
    for (const Node& type : node.children) {
      if (type.name == "Real" && type.find("unit")) must_be_among(type, units_, type.text("unit"), "unit");
      if (type.name == "Enumeration" && type.find("name")) must_be_among(type, enumerations_, type.text("name"), "enumeration");
    }
  }
  void check_parameters(const Node& set) {
    Names names;
    for (const Node& parameter : set.child("Parameters")->children) {
      must_be_new(parameter, names, parameter.text("name"), "parameter");
      check_measures(parameter);
    }
  }
  using Kinds = std::map<std::string, std::string>;
  Kinds check_element(const Node& element) {
    Kinds kinds;
    if (const Node* connectors = element.child("Connectors")) {
      for (const Node& connector : connectors->children) {
        if (!kinds.emplace(connector.text("name"), connector.text("kind")).second)
          fault(connector, "connector '" + connector.text("name") + "' is not unique");
        check_measures(connector);
      }
    }
    if (const Node* bindings = element.child("ParameterBindings")) {
      for (const Node& binding : bindings->children) check_binding(binding);
    }
    return kinds;
  }
  void check_binding(const Node& binding) {
    const Node* values = binding.child("ParameterValues");
    if ((binding.find("source") != nullptr) == (values != nullptr)) fault(binding, "expected either a source or values");
    if (values == nullptr || binding.text("type", "application/x-ssp-parameter-set") != "application/x-ssp-parameter-set")
      return;
    if (values->children.size() != 1) {
      fault(*values, "expected one ParameterSet");
      return;
    }
    const Node& set = values->children.front();
    const std::vector<std::string> inside = schema_faults(set, Standard::kSsv);
    for (const std::string& what : inside) fault(*values, what);
    if (!inside.empty()) return;
    for (const std::string& what : SspMeaning(set).take()) fault(*values, what);
  }
  void check_system(const Node& system) {
    std::map<std::string, Kinds> elements;
    elements[""] = check_element(system);
    if (const Node* all = system.child("Elements")) {
      for (const Node& element : all->children) {
        const Kinds kinds = check_element(element);
        if (!elements.emplace(element.text("name"), kinds).second)
          fault(element, "element '" + element.text("name") + "' is not unique");
        if (element.name == "System") check_system(element);
      }
    }
    const Node* connections = system.child("Connections");
    if (connections == nullptr) return;
    Names fed;
    for (const Node& connection : connections->children) {
      // The direction of an end: 1 is a source, -1 a sink, 0 may be both or does not exist.
      const auto end = [&](const char* element, const char* connector) {
        const auto found = elements.find(connection.text(element));
        if (found == elements.end() || (connection.find(element) != nullptr && connection.text(element).empty())) {
          fault(connection, "element '" + connection.text(element) + "' is not there");
          return 0;
        }
        const auto port = found->second.find(connection.text(connector));
        if (port == found->second.end()) {
          fault(connection, "connector '" + connection.text(element) + "." + connection.text(connector) + "' is not there");
          return 0;
        }
        if (port->second == "inout") return 0;
        // Seen from inside, a system's own input is a source.
        const bool own = found->first.empty(), out = port->second == "output" || port->second == "calculatedParameter";
        return out != own ? 1 : -1;
      };
      const int start = end("startElement", "startConnector"), stop = end("endElement", "endConnector");
      if (start * stop > 0) fault(connection, std::string("connects two connectors that ") + (start > 0 ? "give" : "take"));
      if (start < 0) continue;
      must_be_new(connection, fed, connection.text("endElement") + "." + connection.text("endConnector"), "the connection to");
    }
  }

  Names units_, enumerations_;
};

}  // namespace

std::vector<std::string> meaning_faults(std::string_view xml, Standard standard) {
  const std::optional<Node> root = parse_node(xml);
  if (!root) return {"no well-formed XML"};
  if (standard == Standard::kFmi2 || standard == Standard::kFmi3) return FmiMeaning(*root, standard == Standard::kFmi2).take();
  return SspMeaning(*root).take();
}

}  // namespace cotwin::testing
