#include "tests/support/standard_node.h"

#include <tinyxml2.h>

#include <map>

namespace cotwin::testing {

namespace {

using Spaces = std::map<std::string, std::string>;

/// "prefix:name" as namespace and name; empty for an unbound prefix.
std::optional<std::pair<std::string, std::string>> resolved(const std::string& name, const Spaces& spaces, bool by_default) {
  const std::size_t colon = name.find(':');
  const std::string prefix = colon == std::string::npos ? "" : name.substr(0, colon);
  if (prefix.empty() && !by_default) return std::pair(std::string(), name);
  if (prefix == "xml") return std::pair(std::string("http://www.w3.org/XML/1998/namespace"), name.substr(colon + 1));
  const auto found = spaces.find(prefix);
  if (found == spaces.end()) return prefix.empty() ? std::optional(std::pair(std::string(), name)) : std::nullopt;
  return std::pair(found->second, colon == std::string::npos ? name : name.substr(colon + 1));
}

bool read(const tinyxml2::XMLElement& element, Spaces spaces, Node& node) {
  for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next()) {
    const std::string name = a->Name();
    if (name == "xmlns") spaces[""] = a->Value();
    if (name.rfind("xmlns:", 0) == 0) spaces[name.substr(6)] = a->Value();
  }
  const auto own = resolved(element.Name(), spaces, true);
  if (!own) return false;
  node.space = own->first;
  node.name = own->second;
  node.line = element.GetLineNum();
  for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next()) {
    const std::string name = a->Name();
    if (name == "xmlns" || name.rfind("xmlns:", 0) == 0) continue;
    const auto attribute = resolved(name, spaces, false);
    if (!attribute) return false;
    const std::string key = attribute->first.empty() ? attribute->second : attribute->first + " " + attribute->second;
    if (node.find(key) != nullptr) return false;
    node.attributes.emplace_back(key, a->Value());
  }
  for (const auto* child = element.FirstChild(); child != nullptr; child = child->NextSibling()) {
    if (child->ToText() != nullptr) node.has_text = true;
    if (child->ToElement() != nullptr && !read(*child->ToElement(), spaces, node.children.emplace_back())) return false;
  }
  return true;
}

}  // namespace

std::string place(const Node& node) { return "line " + std::to_string(node.line) + ", <" + node.name + ">: "; }

std::optional<Node> parse_node(std::string_view xml) {
  tinyxml2::XMLDocument document;
  if (document.Parse(xml.data(), xml.size()) != tinyxml2::XML_SUCCESS || document.RootElement() == nullptr) return std::nullopt;
  Node root;
  if (!read(*document.RootElement(), {}, root)) return std::nullopt;
  return root;
}

}  // namespace cotwin::testing
