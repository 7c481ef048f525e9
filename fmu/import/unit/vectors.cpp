// Vectors from scalars, and slopes of outputs, among the variables of an FMU.
#include <algorithm>
#include <limits>
#include <set>
#include <tuple>
#include <unordered_map>

#include "fmu/description/rate.h"
#include "fmu/import/unit/variables.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

/// Combines similar scalars "q[1]" … "q[n]" to the vector "q", in the place of the first.
void ForeignVariables::collect_vectors(std::vector<Item>& items) const {
  struct Family {
    std::size_t count = 0;
    std::vector<std::size_t> members;  // item of each element, the first for "[1]"; kNone: missing
    bool whole = true;
  };
  constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  std::unordered_map<std::string, Family> families;
  /// Calls `take` with each item "name[index]", its family and the index from 0.
  const auto for_each_element = [&](const auto& take) {
    for (std::size_t i = 0; i < items.size(); ++i) {
      const std::string& name = items[i].name;
      const std::size_t bracket = name.rfind('[');
      if (name.back() != ']' || bracket == std::string::npos || bracket == 0) continue;
      const auto index = text::parse_integer(std::string_view(name).substr(bracket + 1, name.size() - bracket - 2));
      if (index && *index >= 1) take(i, families[name.substr(0, bracket)], static_cast<std::size_t>(*index - 1));
    }
  };
  for_each_element([](std::size_t, Family& family, std::size_t) { ++family.count; });
  for_each_element([&](std::size_t i, Family& family, std::size_t at) {
    family.members.resize(family.count, kNone);
    family.whole = family.whole && at < family.count && family.members[at] == kNone;
    if (family.whole) family.members[at] = i;
  });
  for (const Item& item : items) {
    const auto same = families.find(item.name);
    if (same != families.end()) same->second.whole = false;
  }
  std::vector<bool> absorbed(items.size(), false);
  for (const auto& [base, family] : families) {
    if (!family.whole || family.members.size() < 2) continue;
    if (std::find(family.members.begin(), family.members.end(), kNone) != family.members.end()) continue;
    const Item& first = items[family.members.front()];
    const bool alike = std::all_of(family.members.begin(), family.members.end(), [&](std::size_t m) {
      const Item& i = items[m];
      return i.role == first.role && i.type == first.type && i.exchange == first.exchange && i.si.empty() == first.si.empty() &&
             i.factor == first.factor && i.offset == first.offset && i.relative == first.relative && i.min == first.min &&
             i.max == first.max && i.rate_references.size() == first.rate_references.size() && i.settable == first.settable &&
             i.interpolated == first.interpolated && i.derivative_of.size() == first.derivative_of.size() &&
             i.start.index() == first.start.index();
    });
    if (!alike) continue;
    Item vector = first;
    vector.name = base;
    vector.references.clear();
    vector.size = family.members.size();
    if (std::ranges::any_of(family.members, [&](std::size_t m) { return items[m].si != first.si; })) {
      for (const std::size_t m : family.members) vector.element_si.push_back(items[m].si);
    }
    for (const std::size_t m : family.members) {
      vector.references.push_back(items[m].references.front());
      if (m == family.members.front()) continue;
      vector.rate_references.insert(vector.rate_references.end(), items[m].rate_references.begin(),
                                    items[m].rate_references.end());
      if (!vector.derivative_of.empty()) vector.derivative_of.push_back(items[m].derivative_of.front());
      // Of different magnitudes the vector has the smallest: a tolerance is then too small for some elements, never too large.
      if (items[m].nominal > 0 && (vector.nominal == 0 || items[m].nominal < vector.nominal)) vector.nominal = items[m].nominal;
      std::visit(
          [&](auto& list) {
            using List = std::remove_cvref_t<decltype(list)>;
            if constexpr (!std::is_same_v<List, std::monostate>) {
              const auto& more = std::get<List>(items[m].start);
              list.insert(list.end(), more.begin(), more.end());
            }
          },
          vector.start);
    }
    const std::size_t place = *std::min_element(family.members.begin(), family.members.end());
    for (const std::size_t m : family.members) absorbed[m] = m != place;
    items[place] = std::move(vector);
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < items.size(); ++i) {
    if (absorbed[i]) continue;
    if (kept != i) items[kept] = std::move(items[i]);
    ++kept;
  }
  items.resize(kept);
}

void ForeignVariables::collect_slopes() {
  if (description_.generation_tool == kGenerationTool) {
    warnings_.push_back("slopes=true has no effect: FMUs of Cotwin declare all derivatives that they give");
    return;
  }
  std::set<std::string> names;
  std::set<std::vector<std::uint32_t>> with_derivative;
  for (const Item& item : items_) {
    names.insert(item.name);
    with_derivative.insert(item.derivative_of);
  }
  std::vector<Item> slopes;
  for (const Item& of : items_) {
    const bool known = with_derivative.contains(of.references);
    const bool possible =
        of.role == Role::kOutput && of.exchange == Exchange::kResult && of.type == Type::kFloat64 && of.continuous;
    if (!possible || known || !names.insert(rate_name(of.name)).second) continue;
    Item slope;
    slope.name = rate_name(of.name);
    slope.description = store_text("slope of " + of.name + " at the end of the last step; 0 before the first one");
    slope.role = Role::kState;
    slope.exchange = Exchange::kSlope;
    slope.references = of.references;
    slope.size = of.size;
    slope.si = of.si.empty() ? "" : rate_measure(of.si);
    slope.factor = of.factor;
    slope.min = -std::numeric_limits<double>::infinity();
    slope.max = std::numeric_limits<double>::infinity();
    slope.slope_of = of.name;
    slopes.push_back(std::move(slope));
  }
  if (slopes.empty()) warnings_.push_back("slopes=true has no effect: no continuous output of the FMU lacks a derivative");
  items_.insert(items_.end(), slopes.begin(), slopes.end());
}

}  // namespace cotwin::fmu
