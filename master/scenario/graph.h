#pragma once
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "master/scenario/path.h"
#include "master/scenario/scenario.h"
#include "master/scenario/system.h"

namespace cotwin::master::ssp {

/// All connections of a tree of systems as one directed graph. Nodes are connectors of components and systems, and entries of
/// signal dictionaries. Each node has at most one incoming edge.
class Graph {
 public:
  explicit Graph(const UnitTable& units) : units_(units) {}

  /// Adds the connections of the last of `scopes`, which are nested systems, outermost first. Throws Error for connections to
  /// unknown ends, of the wrong direction, and for a second source of one sink.
  void add(const std::vector<const Element*>& scopes);

  /// Returns the connections between components, in the order in which the last part of each was added. There is none for an
  /// input whose route begins at a connector without a source. Throws Error for a loop without a component and for units of
  /// measure that are not convertible.
  std::vector<ConnectionSpec> connections() const;

  /// Returns the variables of components that a system's connector feeds, each with its path, which continues `path`.
  std::vector<std::pair<Port, Path>> fed_by(const Element& system, const std::string& connector, const Path& path) const;

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  struct Node {
    std::string component;  // flattened name; "" for a system's connector or a dictionary's entry
    std::string connector;
    std::string unit;
    std::string text;              // "cell.robot.q", for messages
    std::size_t incoming = kNone;  // edge
    std::vector<std::size_t> outgoing;
  };
  struct Edge {
    std::size_t from = 0, to = 0;
    Transformation transformation;
    std::string place;
  };
  enum class Flow { kSource, kSink, kEither };
  /// One end of a connection: its element and its possible direction, seen from the connection.
  struct End {
    const Element* owner;
    const Connector* connector;  // nullptr: a component that does not list it
    std::string name;
    Flow flow;
  };
  using Elements = std::map<std::string_view, const Element*>;  // of a system, by name

  static End end(const Element& system, const Elements& elements, const std::string& element, const std::string& connector,
                 const std::string& place);
  static std::string text_of(const End& e);
  void add(const Connection& c, const Elements& elements, const std::vector<const Element*>& scopes);
  void add_edge(std::size_t from, std::size_t to, const Transformation& t, const std::string& place);
  std::size_t node(const End& e, Flow use, const std::vector<const Element*>& scopes);
  std::size_t dictionary_node(const End& e, Flow use, const std::vector<const Element*>& scopes);
  std::pair<std::size_t, bool> make_node(const std::string& owner, const std::string& connector, const std::string& text);
  std::vector<std::size_t> route_to(std::size_t edge) const;
  void pass(Path& path, std::size_t edge) const;

  const UnitTable& units_;
  std::map<std::pair<std::string, std::string>, std::size_t> node_of_;  // by kind and path of the owner, and connector
  std::vector<Node> nodes_;
  std::vector<Edge> edges_;
};

}  // namespace cotwin::master::ssp
