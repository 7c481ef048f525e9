#include <set>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf_document.h"

namespace cotwin::robot {

void check_urdf_tree(const UrdfDocument& document) {
  const auto place_of = [&](const std::string& link) {
    return document.at(document.links.at(link).line) + ": link '" + link + "'";
  };
  std::vector<const UrdfDocument::Joint*> in_order(document.joints.size());
  for (const auto& [name, joint] : document.joints) in_order[joint.order] = &joint;
  std::map<std::string, const UrdfDocument::Joint*> joint_of;  // by child
  for (const UrdfDocument::Joint* joint : in_order) {
    const std::string place = document.at(joint->line) + ": joint '" + joint->name + "'";
    for (const std::string& link : {joint->parent, joint->child}) {
      if (document.links.count(link) != 0) continue;
      const std::string close = text::closest(link, document.links_in_order);
      throw Error(place, "no link '" + link + "'" + (close.empty() ? std::string() : ", did you mean '" + close + "'?"));
    }
    const auto [other, is_new] = joint_of.emplace(joint->child, joint);
    if (!is_new) {
      throw Error(place, "link '" + joint->child + "' is already the child of joint '" + other->second->name + "' (line " +
                             std::to_string(other->second->line) + ")");
    }
  }
  std::string root;
  for (const std::string& name : document.links_in_order) {
    if (joint_of.count(name) != 0) continue;
    if (!root.empty()) throw Error(place_of(name), "second root besides '" + root + "', expected one");
    root = name;
  }
  std::multimap<std::string, std::string> children;
  for (const auto& [name, joint] : document.joints) children.emplace(joint.parent, joint.child);
  std::set<std::string> reached;
  std::vector<std::string> next;
  if (!root.empty()) next.push_back(root);
  while (!next.empty()) {
    const std::string link = std::move(next.back());
    next.pop_back();
    const auto [begin, end] = children.equal_range(link);
    for (auto i = begin; i != end; ++i) next.push_back(i->second);
    reached.insert(link);
  }
  for (const std::string& name : document.links_in_order) {
    if (reached.count(name) == 0) throw Error(place_of(name), "is part of a cycle of joints, expected a tree with one root");
  }
}

}  // namespace cotwin::robot
