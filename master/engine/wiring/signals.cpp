// Look-up of variables by name. Separate from members.cpp, because an exported scenario (twin/exported.cpp) needs it without
// the code that builds units and loads FMUs.
#include <algorithm>
#include <cmath>

#include "components/unit/settings.h"
#include "fmu/export/package.h"
#include "master/engine/wiring/members.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

std::string in_quotes(std::string_view s) { return "'" + std::string(s) + "'"; }

std::string suggestion(std::string_view wanted, const std::vector<std::string>& candidates) {
  const std::string closest = text::closest(wanted, candidates);
  return closest.empty() ? "" : "; did you mean " + in_quotes(closest) + "?";
}

std::string without_component(const std::string& component, const std::string& what) {
  for (const char* mark : {".", ": "}) {
    if (what.starts_with(component + mark)) return what.substr(component.size() + std::string_view(mark).size());
  }
  return what;
}

void fail(const std::string& place, const std::string& what) {
  if (place.empty()) throw Error(what);
  throw Error(place, what);
}

std::vector<std::shared_ptr<const robot::RobotModel>> robots_of_fmu(const std::filesystem::path& folder) {
  const std::filesystem::path file = folder / "resources" / fmu::kPackageFile;
  std::error_code none;
  if (!std::filesystem::is_regular_file(file, none)) return {};
  constexpr std::uint64_t kLargest = 1'000'000'000;  // bytes
  try {
    const fmu::Package package = fmu::deserialise_package(text::read_file(file, "a packed unit", kLargest), file.string());
    Settings settings(package.unit, package.query, {}, {});
    settings.set_robot(package.robot);
    settings.set_cell(package.cell);
    return settings.robots_used();
  } catch (const Error&) {
    return {};  // of another version or not ours: its robot is unknown
  }
}

bool is_unit(const ComponentSpec& spec) { return spec.source.rfind("unit:", 0) == 0; }

bool is_unit_of(const ComponentSpec& spec, const char* type) {
  return is_unit(spec) && parse_unit_source(spec.source).unit == type;
}

std::string with_article(Role role) {
  const bool vowel = role == Role::kInput || role == Role::kOutput;
  return (vowel ? "an " : "a ") + std::string(name_of(role));
}

si::Measure measure(const Scenario& scenario, const std::string& name) {
  const auto found = std::find_if(scenario.units.begin(), scenario.units.end(), [&](const auto& u) { return u.name == name; });
  return found != scenario.units.end() ? si::from(*found) : si::parse(name);
}

std::optional<double> Member::start_of(const Variable& variable, std::size_t element) const {
  const auto found = std::ranges::find_if(
      given, [&](const GivenStart& start) { return start.element == element && start.variable == variable.name; });
  return found != given.end() ? std::optional(found->value) : std::nullopt;
}

Elements Signal::of_elements() const {
  Elements part;
  if (variable->elements == nullptr) return part;
  const auto slice = [&](const std::vector<std::string>& all) {
    const auto begin = all.begin() + static_cast<std::ptrdiff_t>(all.empty() ? 0 : first);
    return std::vector<std::string>(begin, all.empty() ? begin : begin + static_cast<std::ptrdiff_t>(count));
  };
  part = {slice(variable->elements->names), slice(variable->elements->si)};
  if (std::ranges::adjacent_find(part.si, std::ranges::not_equal_to()) == part.si.end()) part.si.clear();
  return part;
}

std::string element_name(const std::string& member, const Variable& variable, std::size_t element) {
  const std::string name = member + "." + variable.name;
  return variable.size() == 1 ? name : name + "[" + std::to_string(element + 1) + "]";
}

namespace {

/// `member_called`: returns the index of the member of that name, or the number of members.
template <class MemberCalled>
Signal find_with(std::span<const Member> members, std::string_view name, const std::string& place,
                 const MemberCalled& member_called) {
  // Names of nested components contain dots, and names of foreign variables may: every dot may be the separator.
  const Member* with_name = nullptr;
  for (std::size_t dot = name.find('.'); dot != std::string_view::npos; dot = name.find('.', dot + 1)) {
    const std::size_t m = member_called(name.substr(0, dot));
    if (m == members.size()) continue;
    with_name = &members[m];
    FoundElement found;
    try {
      found = find_element(with_name->variables(), name.substr(dot + 1));
    } catch (const Error& error) {
      fail(place, error.what());
    }
    if (!found.variable) continue;
    if (found.element < 0) return {m, found.variable, 0, found.variable->size(), std::string(name)};
    const auto element = static_cast<std::size_t>(found.element);
    if (element >= found.variable->size()) {
      fail(place,
           in_quotes(name) + ": " + found.variable->name + " has " + std::to_string(found.variable->size()) + " elements");
    }
    return {m, found.variable, element, 1, std::string(name)};
  }
  std::vector<std::string> candidates;
  for (const Member& member : members) {
    for (const Variable& v : member.variables()) candidates.push_back(member.name() + "." + v.name);
  }
  fail(place,
       (with_name ? "component " + in_quotes(with_name->name()) + " has no variable " : std::string("there is no variable ")) +
           in_quotes(name) + suggestion(name, candidates));
}

}  // namespace

SignalIndex::SignalIndex(std::span<const Member> members) : members_(members) {
  for (std::size_t m = 0; m < members.size(); ++m) by_name_.emplace(members[m].name(), m);
}

Signal SignalIndex::find(std::string_view name, const std::string& place) const {
  return find_with(members_, name, place, [&](std::string_view member) {
    const auto found = by_name_.find(member);
    return found == by_name_.end() ? members_.size() : found->second;
  });
}

Signal find_signal(std::span<const Member> members, std::string_view name, const std::string& place) {
  return find_with(members, name, place, [&](std::string_view member) {
    const auto found = std::ranges::find(members, member, [](const Member& m) -> const std::string& { return m.name(); });
    return static_cast<std::size_t>(found - members.begin());
  });
}

Signal find_real_signal(std::span<const Member> members, std::string_view name, const std::string& place) {
  Signal signal = find_signal(members, name, place);
  if (signal.variable->kind() != Kind::kReal) {
    fail(place, in_quotes(name) + " is " + std::string(name_of(signal.variable->kind())) + ", expected a real variable");
  }
  return signal;
}

bool glob(std::string_view pattern, std::string_view name) {
  // After a mismatch, the last * takes one more character. Time is at most the product of the lengths; no recursion.
  std::size_t p = 0, n = 0, star = std::string_view::npos, resume = 0;
  while (n < name.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      resume = n;
    } else if (p < pattern.size() && (pattern[p] == '?' || pattern[p] == name[n])) {
      ++p;
      ++n;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      n = ++resume;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', p) == std::string_view::npos;
}

std::string not_finite(const Member& member, const Variable& variable, std::size_t element, double value, double seconds) {
  return element_name(member.name(), variable, element) + " is " + text::to_text(value) + " at t = " + text::to_text(seconds) +
         " s, expected a finite " + std::string(name_of(variable.role));
}

bool has_moderate_inputs(const Member& member) {
  constexpr double kLarge = 1e12;  // in SI
  return std::ranges::all_of(member.variables(), [&](const Variable& v) {
    return v.role != Role::kInput || v.kind() != Kind::kReal ||
           std::ranges::all_of(v.reals(), [&](double x) { return std::abs(x) < kLarge; });
  });
}

}  // namespace cotwin::master
