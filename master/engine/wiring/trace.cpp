#include "master/engine/wiring/trace.h"

#include <set>
#include <vector>

namespace cotwin::master {

std::string prefix_of(const std::string& name) {
  const std::size_t dot = name.rfind('.');
  return dot == std::string::npos ? "" : name.substr(0, dot + 1);
}
std::string last_part(const std::string& name) { return name.substr(prefix_of(name).size()); }

Trace::Trace(std::span<const Member> members, std::span<const ResolvedConnection> links) : members_(members), links_(links) {
  for (const ResolvedConnection& link : links) {
    if (link.initial) continue;
    for (std::size_t i = 0; i < link.to.count; ++i) into_[{link.to.variable, link.to.first + i}] = &link;
  }
}

const ResolvedConnection* Trace::into(const Variable& input, std::size_t element) const {
  const auto found = into_.find({&input, element});
  return found == into_.end() ? nullptr : found->second;
}

std::optional<OneElement> Trace::source(const Variable& input, std::size_t element) const {
  const ResolvedConnection* link = into(input, element);
  if (link == nullptr) return std::nullopt;
  return OneElement{link->from.member, link->from.variable, link->from.first + element - link->to.first};
}

/// The source of the input that an output of a unit of this program follows.
std::optional<OneElement> Trace::followed(const OneElement& output) const {
  const Member& member = members_[output.member];
  if (!is_unit(member.spec) || is_unit_of(member.spec, "motion")) return std::nullopt;
  const std::string prefix = prefix_of(output.variable->name);
  // Of a sensor, a controller of joints or of a frame, a drive train, and of links in a contact world.
  for (const std::string& name : {last_part(output.variable->name) + "_true", std::string("q_d"), std::string("p_d"),
                                  std::string("tau_m"), std::string("tau_J"), std::string("q")}) {
    const Variable* input = member.variables().find(prefix + name);
    if (input == nullptr || input->role != Role::kInput) continue;
    if (auto before = source(*input, input->size() == output.variable->size() ? output.element : 0)) return before;
  }
  return std::nullopt;
}

OneElement Trace::origin(OneElement output) const {
  std::set<std::pair<const Variable*, std::size_t>> seen;
  while (seen.emplace(output.variable, output.element).second) {
    const std::optional<OneElement> before = followed(output);
    if (!before) break;
    output = *before;
  }
  return output;
}

bool Trace::reaches(std::size_t from, std::size_t to) const {
  std::vector<bool> reached(members_.size(), false);
  std::vector<std::size_t> next{to};
  while (!next.empty()) {
    const std::size_t member = next.back();
    next.pop_back();
    for (const ResolvedConnection& link : links_) {
      if (link.to.member != member || reached[link.from.member]) continue;
      reached[link.from.member] = true;
      next.push_back(link.from.member);
    }
  }
  return reached[from];
}

}  // namespace cotwin::master
