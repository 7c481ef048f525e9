#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// XML for the validator of the standards, read by tinyxml2: independent of the program's own reader.
namespace cotwin::testing {

struct Node {
  std::string space, name;  // namespace URI and name without prefix
  int line = 0;
  std::vector<std::pair<std::string, std::string>> attributes;  // those with a prefix as "URI name"
  std::vector<Node> children;
  bool has_text = false;

  const std::string* find(std::string_view attribute) const {
    for (const auto& [key, value] : attributes) {
      if (key == attribute) return &value;
    }
    return nullptr;
  }
  std::string text(std::string_view attribute, const std::string& fallback = "") const {
    const std::string* found = find(attribute);
    return found != nullptr ? *found : fallback;
  }
  const Node* child(std::string_view child_name) const {
    for (const Node& node : children) {
      if (node.name == child_name) return &node;
    }
    return nullptr;
  }
};

/// "line 7, <Unit>: "
std::string place(const Node& node);

/// Of a document, or of one inside another.
enum class Standard;
std::vector<std::string> schema_faults(const Node& root, Standard standard);

/// Empty for text that is not well-formed.
std::optional<Node> parse_node(std::string_view xml);

}  // namespace cotwin::testing
