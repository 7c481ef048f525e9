#include "master/scenario/graph.h"

#include <algorithm>
#include <set>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"

namespace cotwin::master::ssp {

namespace {

template <class List>
std::vector<std::string> names_of(const List& list) {
  std::vector<std::string> names;
  for (const auto& item : list) names.push_back(item.name);
  return names;
}

/// Returns the signal dictionary of a reference: the innermost with its name (clause "SignalDictionaries").
std::pair<const Element*, const Dictionary*> find_dictionary(const Element& reference,
                                                             const std::vector<const Element*>& scopes) {
  for (auto scope = scopes.rbegin(); scope != scopes.rend(); ++scope) {
    for (const Dictionary& d : (*scope)->dictionaries) {
      if (d.name == reference.dictionary) return {*scope, &d};
    }
  }
  throw Error(reference.place, "no signal dictionary '" + reference.dictionary + "' in this system or one around it");
}

}  // namespace

void Graph::add(const std::vector<const Element*>& scopes) {
  const Element& system = *scopes.back();
  if (system.connections.empty()) return;
  Elements elements;
  for (const Element& e : system.elements) elements.emplace(e.name, &e);
  for (const Connection& c : system.connections) add(c, elements, scopes);
}

void Graph::add(const Connection& c, const Elements& elements, const std::vector<const Element*>& scopes) {
  End start = end(*scopes.back(), elements, c.start_element, c.start_connector, c.place);
  End finish = end(*scopes.back(), elements, c.end_element, c.end_connector, c.place);
  if (start.flow != Flow::kEither && start.flow == finish.flow) {
    throw Error(c.place, text_of(start) + " and " + text_of(finish) +
                             (start.flow == Flow::kSource ? " are both sources" : " are both sinks") +
                             ", expected one of each");
  }
  if (start.flow == Flow::kSink || finish.flow == Flow::kSource) std::swap(start, finish);
  const std::size_t from = node(start, Flow::kSource, scopes), to = node(finish, Flow::kSink, scopes);
  add_edge(from, to, c.transformation, c.place);
}

Graph::End Graph::end(const Element& system, const Elements& elements, const std::string& element, const std::string& connector,
                      const std::string& place) {
  const Element* owner = &system;
  if (!element.empty()) {
    const auto found = elements.find(element);
    if (found == elements.end()) {
      throw Error(place, xml::unknown("an element of system '" + system.name + "'", element, names_of(system.elements)));
    }
    owner = found->second;
  }
  if (connector.empty()) throw Error(place, "a connection without the name of a connector");
  const Connector* listed = owner->find(connector);
  if (listed == nullptr && owner->kind != Element::Kind::kComponent) {
    throw Error(place, xml::unknown("a connector of '" + owner->name + "'", connector, names_of(owner->connectors)));
  }
  if (listed == nullptr || listed->kind == ConnectorKind::kInout) return {owner, listed, connector, Flow::kEither};
  const bool outward = listed->kind == ConnectorKind::kOutput || listed->kind == ConnectorKind::kCalculatedParameter;
  const bool within = element.empty();  // the system's own connectors are seen from inside: its input is a source
  return {owner, listed, connector, outward != within ? Flow::kSource : Flow::kSink};
}

std::string Graph::text_of(const End& e) {
  return "'" + joined(e.owner->path, e.name) + "'" +
         (e.connector != nullptr ? " (" + std::string(text::word_of(e.connector->kind, kConnectorWords)) + ")" : "");
}

void Graph::add_edge(std::size_t from, std::size_t to, const Transformation& t, const std::string& place) {
  Node& target = nodes_[to];
  if (target.incoming != kNone) {
    throw Error(place, "'" + target.text + "' has two sources, the first at " + edges_[target.incoming].place);
  }
  target.incoming = edges_.size();
  nodes_[from].outgoing.push_back(edges_.size());
  edges_.push_back({from, to, t, place});
}

std::size_t Graph::node(const End& e, Flow use, const std::vector<const Element*>& scopes) {
  if (e.owner->kind == Element::Kind::kDictionaryReference) return dictionary_node(e, use, scopes);
  const bool component = e.owner->kind == Element::Kind::kComponent;
  const auto [id, is_new] =
      make_node((component ? "component " : "system ") + e.owner->path, e.name, joined(e.owner->path, e.name));
  if (is_new) {
    if (component) nodes_[id].component = e.owner->path;
    if (e.connector != nullptr) nodes_[id].unit = e.connector->unit;
  }
  return id;
}

// A dictionary entry is one node for all references. Each reference's connector is a further node, because it can have another
// unit of measure.
std::size_t Graph::dictionary_node(const End& e, Flow use, const std::vector<const Element*>& scopes) {
  const auto [holder, dictionary] = find_dictionary(*e.owner, scopes);
  const auto found = dictionary->index.find(e.name);
  if (found == dictionary->index.end()) {
    throw Error(e.connector->place, xml::unknown("an entry of signal dictionary '" + dictionary->name + "'", e.name,
                                                 names_of(dictionary->entries)));
  }
  const Connector* const entry = &dictionary->entries[found->second];
  const std::string path = joined(holder->path, dictionary->name);
  const auto [shared, shared_is_new] = make_node("dictionary " + path, e.name, joined(path, e.name));
  if (shared_is_new) nodes_[shared].unit = entry->unit;
  const bool out = use == Flow::kSource;
  const auto [own, own_is_new] = make_node((out ? "from " : "into ") + e.owner->path, e.name, joined(e.owner->path, e.name));
  if (own_is_new) {
    nodes_[own].unit = e.connector->unit;
    add_edge(out ? shared : own, out ? own : shared, {}, e.owner->place);
  }
  return own;
}

std::pair<std::size_t, bool> Graph::make_node(const std::string& owner, const std::string& connector, const std::string& text) {
  const auto [found, is_new] = node_of_.emplace(std::pair{owner, connector}, nodes_.size());
  if (is_new) {
    Node n;
    n.connector = connector;
    n.text = text;
    nodes_.push_back(std::move(n));
  }
  return {found->second, is_new};
}

/// Returns the edges up to and including `edge`, beginning at a component or at a node without a source.
std::vector<std::size_t> Graph::route_to(std::size_t edge) const {
  std::vector<std::size_t> route;
  for (std::size_t next = edge; next != kNone;) {
    route.push_back(next);
    const Node& from = nodes_[edges_[next].from];
    if (!from.component.empty()) break;
    if (route.size() > edges_.size()) {
      throw Error(edges_[edge].place, "the connections to '" + nodes_[edges_[edge].to].text + "' form a loop");
    }
    next = from.incoming;
  }
  std::reverse(route.begin(), route.end());
  return route;
}

void Graph::pass(Path& path, std::size_t edge) const {
  const Node& to = nodes_[edges_[edge].to];
  path.pass(edges_[edge].transformation, to.unit, !to.component.empty(), edges_[edge].place);
}

std::vector<ConnectionSpec> Graph::connections() const {
  std::vector<ConnectionSpec> result;
  for (std::size_t last = 0; last < edges_.size(); ++last) {
    const Node& sink = nodes_[edges_[last].to];
    if (sink.component.empty()) continue;
    const std::vector<std::size_t> route = route_to(last);
    const Node& source = nodes_[edges_[route.front()].from];
    if (source.component.empty()) continue;  // the input keeps its start value
    Path path(units_, Path::Start::kVariable, source.unit);
    for (const std::size_t edge : route) pass(path, edge);
    const std::string& place = edges_[last].place;
    const Path::Result r = path.result(place);
    result.push_back({{source.component, source.connector, r.from_unit},
                      {sink.component, sink.connector, r.to_unit},
                      r.factor,
                      r.offset,
                      r.suppress_unit_conversion,
                      place});
  }
  return result;
}

std::vector<std::pair<Port, Path>> Graph::fed_by(const Element& system, const std::string& connector, const Path& path) const {
  std::vector<std::pair<Port, Path>> result;
  const auto start = node_of_.find({"system " + system.path, connector});
  if (start == node_of_.end()) return result;
  std::vector<std::pair<std::size_t, Path>> open{{start->second, path}};
  std::set<std::size_t> seen{start->second};
  while (!open.empty()) {
    const auto [at, so_far] = std::move(open.back());
    open.pop_back();
    for (const std::size_t edge : nodes_[at].outgoing) {
      const std::size_t to = edges_[edge].to;
      if (!seen.insert(to).second) continue;
      Path next = so_far;
      pass(next, edge);
      if (nodes_[to].component.empty()) {
        open.emplace_back(to, next);
      } else {
        result.emplace_back(Port{nodes_[to].component, nodes_[to].connector, ""}, next);
      }
    }
  }
  return result;
}

}  // namespace cotwin::master::ssp
