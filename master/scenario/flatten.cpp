#include "master/scenario/flatten.h"

#include <map>
#include <string_view>

#include "master/scenario/graph.h"
#include "models/foundation/support/error.h"

namespace cotwin::master::ssp {

namespace {

constexpr std::size_t kMaxStored = 1'000'000;  // limits start values: one parameter can set many components

class Flattener {
 public:
  Flattener(const UnitTable& units, const xml::Complaint& complain, Scenario& scenario)
      : units_(units), complain_(complain), scenario_(scenario), graph_(units) {}

  void run(const Element& root) {
    scopes_.push_back(&root);
    add_system(root);
    scenario_.connections = graph_.connections();
    assign_all(root);
  }

 private:
  void add_system(const Element& system) {
    for (const Element& e : system.elements) {
      if (e.kind == Element::Kind::kComponent) add_component(e);
      if (e.kind != Element::Kind::kSystem) continue;
      scopes_.push_back(&e);
      add_system(e);
      scopes_.pop_back();
    }
    graph_.add(scopes_);
  }

  void add_component(const Element& e) {
    const auto [known, is_new] = index_.emplace(e.path, scenario_.components.size());
    if (!is_new) {
      throw Error(e.place, "component '" + e.path + "' has the same flattened name as the one at " +
                               scenario_.components[known->second].place + ", expected different names");
    }
    ComponentSpec spec;
    spec.name = e.path;
    spec.source = e.source;
    spec.type = e.type;
    spec.implementation = e.implementation;
    spec.place = e.place;
    for (const Connector& c : e.connectors) spec.connectors.push_back({c.name, c.kind, c.type, c.unit, c.place});
    scenario_.components.push_back(std::move(spec));
  }

  // Applies bindings, innermost first. Later values replace earlier ones, so outer bindings take precedence (clause
  // "ParameterBindings").
  void assign_all(const Element& e) {
    for (const Element& c : e.elements) assign_all(c);
    for (const Assignment& a : e.assignments) {
      Path path(units_, Path::Start::kValue, a.value.unit);
      if (assign(e, a.value.name, a, path, a.transformation) == 0) report_unknown(e, a);
    }
  }

  /// Assigns the value to everything with the hierarchical name `name` in `e`. Returns how many were found.
  int assign(const Element& e, std::string_view name, const Assignment& a, const Path& path, const Transformation& t) {
    if (e.kind == Element::Kind::kDictionaryReference || name.empty()) return 0;
    if (e.kind == Element::Kind::kComponent) {
      const Connector* connector = e.find(name);
      Path last = path;
      last.pass(t, connector != nullptr ? connector->unit : "", true, a.value.place);
      store(e.path, name, a, last);
      return 1;
    }
    int found = 0;
    if (const Connector* own = e.find(name)) {
      ++found;
      Path inside = path;
      inside.pass(t, own->unit, false, a.value.place);
      for (const auto& [port, route] : graph_.fed_by(e, own->name, inside)) store(port.component, port.variable, a, route);
    }
    for (std::size_t dot = name.find('.'); dot != std::string_view::npos; dot = name.find('.', dot + 1)) {
      if (const Element* c = e.element(name.substr(0, dot))) found += assign(*c, name.substr(dot + 1), a, path, t);
    }
    return found;
  }

  void store(const std::string& component, std::string_view variable, const Assignment& a, const Path& path) {
    ParameterValue value = path.applied(a.value);
    value.name = variable;
    scenario_.components[index_.at(component)].start_values.push_back(std::move(value));
    if (++stored_ > kMaxStored) throw Error(a.value.place, "more than " + std::to_string(kMaxStored) + " start values");
  }

  /// Collects hierarchical names in `e` for "did you mean": connectors, and `variable` of every component, as components need
  /// not list their variables.
  static void collect_names(const Element& e, const std::string& prefix, const std::string& variable,
                            std::vector<std::string>& names) {
    for (const Connector& c : e.connectors) names.push_back(prefix + c.name);
    if (e.kind == Element::Kind::kComponent) names.push_back(prefix + variable);
    for (const Element& c : e.elements) collect_names(c, prefix + c.name + ".", variable, names);
  }

  void report_unknown(const Element& e, const Assignment& a) {
    std::vector<std::string> names;
    const std::string& wanted = a.value.name;
    // The search for similar names is slow, so it is made only for the first 20 unknown parameters.
    if (++unknown_ <= 20) collect_names(e, "", wanted.substr(wanted.rfind('.') + 1), names);
    complain_(a.value.place, xml::unknown("a parameter of '" + (e.path.empty() ? e.name : e.path) + "'", wanted, names));
  }

  const UnitTable& units_;
  const xml::Complaint& complain_;
  Scenario& scenario_;
  std::vector<const Element*> scopes_;        // the current system and those around it, outermost first
  std::map<std::string, std::size_t> index_;  // of components by name
  Graph graph_;
  std::size_t stored_ = 0, unknown_ = 0;
};

}  // namespace

void flatten(const Element& root, const UnitTable& units, const xml::Complaint& complain, Scenario& scenario) {
  Flattener(units, complain, scenario).run(root);
}

}  // namespace cotwin::master::ssp
