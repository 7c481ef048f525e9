#include "fmu/import/unit/variables.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <tuple>
#include <type_traits>
#include <unordered_map>

#include "components/unit/si.h"
#include "fmu/description/consistency.h"
#include "fmu/description/hex.h"
#include "fmu/description/rate.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Returns whether the type is an integer with a smaller range than its storage, Int32.
bool is_short(Type type) {
  return type == Type::kInt8 || type == Type::kUInt8 || type == Type::kInt16 || type == Type::kUInt16;
}

Kind kind_of(Type type) {
  switch (type) {
    case Type::kInt8:
    case Type::kUInt8:
    case Type::kInt16:
    case Type::kUInt16:
    case Type::kInt32:
    case Type::kEnumeration:
      return Kind::kInteger;
    case Type::kBoolean:
    case Type::kClock:
      return Kind::kBoolean;
    case Type::kString:
    case Type::kBinary:
      return Kind::kString;
    default:
      return Kind::kReal;
  }
}

Role role_of(const ModelVariable& v) {
  switch (v.causality) {
    case Causality::kInput:
      return Role::kInput;
    case Causality::kParameter:
      return v.variability == Variability::kTunable    ? Role::kTunable
             : v.variability == Variability::kConstant ? Role::kOutput
                                                       : Role::kParameter;
    case Causality::kStructuralParameter:
      return Role::kParameter;
    case Causality::kLocal:
      return v.variability == Variability::kConstant ? Role::kOutput : Role::kState;
    default:
      return Role::kOutput;
  }
}

/// Returns whether values of the type are integers that are kept as reals.
bool is_wide(Type type) { return type == Type::kInt64 || type == Type::kUInt64 || type == Type::kUInt32; }

/// Returns whether the importer activates this clock at its times; such clocks are not inputs of the unit.
bool is_time_based(const ModelVariable& v) {
  return v.type == Type::kClock && v.clock.interval_variability != IntervalVariability::kTriggered;
}

Exchange exchange_of(const ModelVariable& v, Role role, bool clocks) {
  if (v.variability == Variability::kConstant) return Exchange::kConstant;
  if (v.type == Type::kClock) return Exchange::kClock;
  if (clocks && !v.clocks.empty() && role == Role::kInput) return Exchange::kClockedInput;
  if (clocks && !v.clocks.empty() && (role == Role::kOutput || role == Role::kState)) return Exchange::kClockedResult;
  switch (role) {
    case Role::kInput:
      return is_float(v.type) && v.variability == Variability::kContinuous ? Exchange::kContinuousInput
                                                                           : Exchange::kDiscreteInput;
    case Role::kTunable:
      return Exchange::kTunable;
    case Role::kParameter:
      return Exchange::kFixed;
    default:
      return Exchange::kResult;
  }
}

/// Returns the SI unit with these exponents of kg, m, s, A, K, mol, cd, rad: "kg.m2/s2".
std::string text_of(const std::array<int, 8>& exponents) {
  static constexpr const char* kBases[] = {"kg", "m", "s", "A", "K", "mol", "cd", "rad"};
  std::string above, below;
  for (std::size_t i = 0; i < exponents.size(); ++i) {
    if (exponents[i] == 0) continue;
    std::string& part = exponents[i] > 0 ? above : below;
    part += (part.empty() ? "" : ".") + std::string(kBases[i]);
    if (std::abs(exponents[i]) != 1) part += std::to_string(std::abs(exponents[i]));
  }
  return (above.empty() ? "1" : above) + (below.empty() ? "" : "/" + below);
}

/// Returns element `i` of the start values as T. A single start value applies to all elements.
template <class T>
T start_element(const StartValues& start, std::size_t i, T fallback) {
  return std::visit(
      [&](const auto& list) -> T {
        using List = std::remove_cvref_t<decltype(list)>;
        if constexpr (std::is_same_v<List, std::monostate>) {
          return fallback;
        } else {
          if (list.empty() || (i >= list.size() && list.size() != 1)) return fallback;
          const auto& value = list[list.size() == 1 ? 0 : i];
          using Value = typename List::value_type;
          if constexpr (std::is_same_v<T, std::string> && std::is_same_v<Value, std::vector<std::uint8_t>>) {
            return to_hex(value);
          } else if constexpr (std::is_same_v<T, Value>) {
            return value;
          } else if constexpr (std::is_arithmetic_v<T> && std::is_arithmetic_v<Value>) {
            return static_cast<T>(value);
          } else {
            return fallback;
          }
        }
      },
      start);
}

}  // namespace

std::map<std::size_t, std::size_t> rate_inputs(const ModelDescription& description) {
  std::map<std::size_t, std::size_t> found;
  if (description.version != Version::k3 || description.generation_tool != kGenerationTool) return found;
  const auto is_continuous_input = [](const ModelVariable& v) {
    return v.causality == Causality::kInput && v.type == Type::kFloat64 && v.variability == Variability::kContinuous;
  };
  for (std::size_t i = 0; i < description.variables.size(); ++i) {
    const ModelVariable& v = description.variables[i];
    if (!v.derivative || !is_continuous_input(v)) continue;
    const ModelVariable& of = description.variables[*v.derivative];
    if (is_continuous_input(of) && v.name == rate_name(of.name) && v.dimensions == of.dimensions) found[i] = *v.derivative;
  }
  return found;
}

ForeignVariables::ForeignVariables(const ModelDescription& description, const ForeignVariablesOptions& options)
    : description_(description), ramps_(options.ramps), si_(options.si) {
  collect(options);
  lay_out();
}

void ForeignVariables::collect(const ForeignVariablesOptions& options) {
  const DescriptionIndex index(description_);
  std::map<std::uint32_t, std::uint64_t> chosen;
  for (const auto& [name, value] : options.structural) {
    const ModelVariable* const found = index.variable(name);
    if (found == nullptr || found->causality != Causality::kStructuralParameter) {
      throw Error("'" + name + "'", "the FMU has no structural parameter of that name");
    }
    if (found->type != Type::kUInt64) {
      throw Error("'" + name + "'", "is " + std::string(cotwin::fmu::name_of(found->type)) +
                                        " and not a size (UInt64); give it a start value instead of structural." + name);
    }
    chosen[found->reference] = value;
    structural_references_.push_back(found->reference);
    structural_values_.push_back(value);
  }
  const std::map<std::size_t, std::size_t> rates = rate_inputs(description_);
  std::map<std::string, std::uint32_t> rate_of;  // name of an input → value reference of its slope
  std::set<const ModelVariable*> slopes;
  for (const auto& [slope, input] : rates) {
    rate_of[description_.variables[input].name] = description_.variables[slope].reference;
    slopes.insert(&description_.variables[slope]);
  }
  bool clocks = false;
  std::uint64_t total = 0;
  items_.reserve(description_.variables.size());
  for (const ModelVariable& v : description_.variables) {
    clocks = clocks || (v.type == Type::kClock && v.causality == Causality::kInput);
    if ((v.type == Type::kClock && !options.clocks) || v.causality == Causality::kIndependent) continue;
    if (v.causality == Causality::kLocal && !options.locals) continue;
    if (slopes.count(&v) != 0) continue;
    Item item;
    item.name = v.name;
    item.description = v.description.empty() ? &v.name : &v.description;
    item.role = is_time_based(v) ? Role::kState : role_of(v);
    item.kind = kind_of(v.type);
    item.exchange = exchange_of(v, item.role, options.clocks);
    if (options.clocks) item.clocks = v.clocks;
    if (v.derivative) item.derivative_of = {description_.variables[*v.derivative].reference};
    item.type = v.type;
    item.continuous = v.variability == Variability::kContinuous;
    item.interpolated = v.interpolated && (rates.empty() || rate_of.count(v.name) != 0);
    if (const auto rate = rate_of.find(v.name); rate != rate_of.end()) item.rate_references = {rate->second};
    item.references = {v.reference};
    item.size = index.elements(v, chosen);
    item.start = v.start;
    if (item.size == 0) continue;
    total += item.size;
    if (total > kMaxElements)
      throw Error("the variables have more than " + std::to_string(kMaxElements) + " elements together");
    const Numeric numeric = index.effective(v);
    item.min = numeric.min.value_or(-kInfinity);
    item.max = numeric.max.value_or(kInfinity);
    if (is_short(v.type)) {
      const IntegerRange range = range_of(v.type);
      item.min = std::max(item.min, static_cast<double>(range.min));
      item.max = std::min(item.max, static_cast<double>(range.max));
    }
    if (item.kind == Kind::kReal && is_float(v.type)) {
      measure(item, numeric, index);
      // Of other tools' descriptions: the sign has no meaning, and 0 or infinity is no magnitude.
      const double nominal = std::abs(item.factor * numeric.nominal.value_or(0));
      item.nominal = std::isfinite(nominal) ? nominal : 0;
    }
    const bool starts = v.initial == Initial::kExact || v.initial == Initial::kApprox;
    item.settable = v.variability != Variability::kConstant && v.type != Type::kClock &&
                    (item.role == Role::kInput || item.role == Role::kParameter || item.role == Role::kTunable || starts);
    item.structural = v.causality == Causality::kStructuralParameter;
    if (item.structural && v.type == Type::kUInt64) {
      item.settable = false;
      const auto value = chosen.find(v.reference);
      if (value != chosen.end()) item.start = std::vector<std::uint64_t>{value->second};
      item.min = item.max = start_element<double>(item.start, 0, 0);
    }
    items_.push_back(item);
    if (item.role != Role::kOutput && item.role != Role::kState) continue;
    for (const Alias& alias : v.aliases) {
      item.name = alias.name;
      item.description = alias.description.empty() ? store_text("alias of " + v.name) : &alias.description;
      item.role = Role::kState;
      item.settable = false;
      items_.push_back(item);
    }
  }
  if (description_.version == Version::k2 || description_.generation_tool == kGenerationTool) collect_vectors(items_);
  if (options.slopes) collect_slopes();
  if (clocks && !options.clocks)
    warnings_.push_back(
        "the FMU has input clocks, which tick only in Co-Simulation with event mode: variables that depend on them "
        "keep their values");
}

/// Determines the conversion of the FMU's values to SI.
void ForeignVariables::measure(Item& item, const Numeric& numeric, const DescriptionIndex& index) {
  if (numeric.unit.empty() || !si_) return;
  const MeasurementUnit* const defined = index.unit(numeric.unit);
  si::Measure m;
  bool readable = true;
  si::Measure by_name;
  try {
    by_name = si::parse(numeric.unit);
  } catch (const Error&) {
    readable = false;
  }
  if (defined != nullptr && defined->definition) {
    m = si::from(*defined->definition);
  } else if (readable) {
    m = by_name;
  } else {
    if (unknown_units_.insert(numeric.unit).second)
      warnings_.push_back("unit '" + numeric.unit + "' is not defined: its values are not converted");
    return;
  }
  item.relative = numeric.relative_quantity;
  if (item.relative) m.offset = 0;
  const bool keeps_name = readable && by_name.exponents == m.exponents && by_name.factor == 1 && by_name.offset == 0 &&
                          m.factor == 1 && m.offset == 0;
  item.si = keeps_name ? numeric.unit : text_of(m.exponents);
  item.factor = m.factor;
  item.offset = m.offset;
  item.min = m.factor * item.min + m.offset;
  item.max = m.factor * item.max + m.offset;
  if (m.factor < 0) std::swap(item.min, item.max);
}

/// Lays out the storage so that the values of one call are contiguous, and writes the start values.
void ForeignVariables::lay_out() {
  std::vector<Item*> order;
  for (Item& item : items_) order.push_back(&item);
  std::stable_sort(order.begin(), order.end(), [](const Item* a, const Item* b) {
    return std::tie(a->exchange, a->type, a->clocks) < std::tie(b->exchange, b->type, b->clocks);
  });
  std::array<std::size_t, 4> sizes{};
  for (Item* item : order) {
    std::size_t& size = sizes[static_cast<std::size_t>(item->kind)];
    item->first = size;
    size += item->size;
  }
  reals_.allocate(sizes[0]);
  integers_.allocate(sizes[1]);
  booleans_.allocate(sizes[2]);
  strings_.allocate(sizes[3]);
  for (std::size_t i = 0; i < order.size();) {
    std::size_t end = i;
    while (end < order.size() && order[end]->exchange == order[i]->exchange && order[end]->type == order[i]->type &&
           order[end]->clocks == order[i]->clocks)
      ++end;
    groups_[static_cast<std::size_t>(order[i]->exchange)].push_back(
        make_group(std::span<const Item* const>(order).subspan(i, end - i)));
    i = end;
  }
  const auto of = [&](Exchange exchange) -> std::vector<Group>& { return groups_[static_cast<std::size_t>(exchange)]; };
  const auto is_plain = [](const Group& g) { return g.type == Type::kFloat64 && g.factors.empty(); };
  std::vector<Group>&inputs = of(Exchange::kContinuousInput), &results = of(Exchange::kResult);
  if (inputs.size() == 1 && is_plain(inputs.front())) {
    plain_inputs_ = &inputs.front();
    plain_sent_ = reals_.sent + plain_inputs_->first;
    plain_.set_references = plain_inputs_->references;
    plain_.set_values = {reals_.values + plain_inputs_->first, plain_inputs_->size};
  }
  has_other_inputs_ = plain_inputs_ == nullptr && !inputs.empty();
  const auto plain = std::find_if(results.begin(), results.end(), is_plain);
  if (plain != results.end()) {
    plain_.get_references = plain->references;
    plain_.get_values = {reals_.values + plain->first, plain->size};
  }
  const std::vector<Group>& slopes = of(Exchange::kSlope);
  if (!slopes.empty()) slope_orders_.assign(slopes.front().references.size(), 1);
  has_other_results_ = results.size() > (plain != results.end() ? 1u : 0u) || !slopes.empty();
  has_discrete_inputs_ = !of(Exchange::kDiscreteInput).empty() || !of(Exchange::kTunable).empty();
  for (Item& item : items_) {
    with_store(item.kind, [&](auto& store) {
      using T = std::remove_cvref_t<decltype(store.values[0])>;
      for (std::size_t i = 0; i < item.size; ++i) {
        T value = start_element<T>(item.start, i, T{});
        if constexpr (std::is_same_v<T, double>) {
          value = item.factor * value + item.offset;
          // A start value of the FMU outside its own range is accepted; the range is then ignored.
          if (value < item.min || value > item.max) {
            const bool given = !std::holds_alternative<std::monostate>(item.start);
            if (given && item.settable)
              warnings_.push_back("'" + item.name + "': the start value is outside the range; the range is ignored");
            item.min = -kInfinity;
            item.max = kInfinity;
          }
        } else if constexpr (std::is_same_v<T, std::int32_t>) {
          if (value < item.min || value > item.max) {
            item.min = -kInfinity;
            item.max = kInfinity;
          }
        }
        if constexpr (std::is_same_v<T, double>) keep_exact(item, i);
        store.values[item.first + i] = store.starts[item.first + i] = store.given[item.first + i] = value;
      }
    });
    item.start = {};  // saves memory: there can be a million variables
  }
  if (ramps_) {
    for (const Group& group : groups_[static_cast<std::size_t>(Exchange::kContinuousInput)]) {
      if (group.type == Type::kFloat64) rates_.resize(group.size);
    }
    rate_scratch_.resize(rates_.size());
    orders_.assign(rates_.size(), 1);
    rate_references_.resize(rates_.size());
    nonzero_rate_.assign(rates_.size(), false);
    for (const Item& item : items_) {
      if (!item.rate_references.empty()) rated_items_.push_back(&item);
    }
  }
}

/// Keeps a start value that double may not have.
void ForeignVariables::keep_exact(const Item& item, std::size_t i) {
  if (!is_wide(item.type) || std::abs(start_element<double>(item.start, i, 0)) < 0x1p53) return;
  const bool is_signed = item.type == Type::kInt64;
  exact_[reals_.values + item.first + i] = is_signed ? static_cast<std::uint64_t>(start_element<std::int64_t>(item.start, i, 0))
                                                     : start_element<std::uint64_t>(item.start, i, 0);
}

ForeignVariables::Group ForeignVariables::make_group(std::span<const Item* const> items) const {
  Group group;
  group.type = items.front()->type;
  group.kind = items.front()->kind;
  group.clocks = items.front()->clocks;
  group.first = items.front()->first;
  bool converts = false;
  for (const Item* item : items) {
    group.references.insert(group.references.end(), item->references.begin(), item->references.end());
    group.size += item->size;
    group.factors.insert(group.factors.end(), item->size, item->factor);
    group.offsets.insert(group.offsets.end(), item->size, item->offset);
    converts = converts || item->factor != 1 || item->offset != 0;
  }
  if (!converts) {
    group.factors.clear();
    group.offsets.clear();
  }
  if (group.kind == Kind::kString) {
    group.texts.resize(group.size);
    group.bytes.resize(group.size);
    group.sizes.resize(group.size);
    if (group.type == Type::kBinary) group.binaries.resize(group.size);
  } else {
    group.wire.resize(group.size * sizeof(double));  // the widest type
  }
  return group;
}

/// Returns the variable of which `item` is the time derivative, if it is declared before and has the same size and a fitting
/// unit; else nullptr.
const ForeignVariables::Item* ForeignVariables::antiderivative(const Item& item, const FirstOfReference& first) const {
  if (item.derivative_of.empty() || item.kind != Kind::kReal || item.si.empty()) return nullptr;
  const auto found = first.find(item.derivative_of.front());
  if (found == first.end()) return nullptr;
  const Item& of = *found->second;
  if (of.references != item.derivative_of || &of >= &item || of.size != item.size || of.si.empty()) return nullptr;
  const std::size_t measures = item.element_si.empty() && of.element_si.empty() ? 1 : item.size;
  for (std::size_t i = 0; i < measures; ++i) {
    if (!si::is_rate(item.si_of(i), of.si_of(i))) return nullptr;
  }
  return &of;
}

void ForeignVariables::declare(Variables& variables) {
  variables.foreign();
  FirstOfReference first;
  const bool any = std::any_of(items_.begin(), items_.end(), [](const Item& i) { return !i.derivative_of.empty(); });
  for (const Item& item : items_) {
    if (any) first.emplace(item.references.front(), &item);
  }
  std::size_t rate = 0;
  for (Item& item : items_) {
    with_store(item.kind, [&](auto& store) {
      const auto values = store.of(item);
      const auto add = [&]() {
        switch (item.role) {
          case Role::kInput:
            return variables.input(item.name, values, item.si, *item.description);
          case Role::kOutput:
            return variables.output(item.name, values, item.si, *item.description);
          case Role::kParameter:
            return variables.parameter(item.name, values, item.si, *item.description);
          case Role::kTunable:
            return variables.tunable(item.name, values, item.si, *item.description);
          default:
            return variables.state(item.name, values, item.si, *item.description);
        }
      };
      Variables::Declared declared = add();
      declared.range(item.min, item.max);
      if (!item.element_si.empty()) declared.elements(std::make_shared<const Elements>(Elements{{}, item.element_si}));
      if (is_wide(item.type)) declared.exact(exact_);
      if (item.nominal > 0) declared.nominal(item.nominal);
      if (item.relative) declared.relative();
      if (item.role == Role::kOutput && item.settable) declared.start();
      if (item.role == Role::kOutput && item.kind == Kind::kReal && !item.continuous) declared.discrete();
      if (const Item* of = antiderivative(item, first)) declared.derivative_of(of->name);
      if (!item.slope_of.empty()) declared.derivative_of(item.slope_of);
      if (!rates_.empty() && item.exchange == Exchange::kContinuousInput && item.type == Type::kFloat64) {
        rate = item.first - groups_[static_cast<std::size_t>(Exchange::kContinuousInput)].back().first;
        std::span<double> part(rates_.data() + rate, item.size);
        if (item.interpolated) declared.rate(part);
      }
    });
  }
}

}  // namespace cotwin::fmu
