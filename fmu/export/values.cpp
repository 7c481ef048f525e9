// Reading and writing the values of an exported unit, and their derivatives.
#include <algorithm>
#include <cmath>
#include <type_traits>

#include "fmu/export/export.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

template <class Element>
constexpr const char* kind_name() {
  if constexpr (std::is_same_v<Element, double>) return "real";
  if constexpr (std::is_same_v<Element, std::int32_t>) return "integer";
  if constexpr (std::is_same_v<Element, bool>) return "boolean";
  return "string";
}

}  // namespace

const Exported::ReferencedValue& Exported::slot(unsigned reference) const {
  if (reference < slots_.size()) return slots_[reference];
  throw Error("no variable has the value reference " + std::to_string(reference) + ", expected 0 to " +
              std::to_string(slots_.size() - 1));
}

std::string Exported::name_of(const ReferencedValue& slot) const {
  if (slot.variable == nullptr) return "time";
  if (slot.count == slot.variable->size()) return slot.variable->name;
  return slot.variable->name + "[" + std::to_string(slot.first + 1) + "]";
}

template <class Element>
std::span<Element> Exported::elements(unsigned reference, const ReferencedValue& slot) const {
  if (slot.variable != nullptr) {
    if (const auto* all = std::get_if<std::span<Element>>(&slot.variable->storage)) return all->subspan(slot.first, slot.count);
  }
  throw Error("value reference " + std::to_string(reference) + " is the " +
              std::string(slot.variable != nullptr ? cotwin::name_of(slot.variable->kind()) : "real") + " variable " +
              name_of(slot) + ", expected a " + kind_name<Element>() + " one");
}

template <class Element, class Host>
void Exported::get(std::span<const unsigned> references, std::span<Host> values) {
  std::size_t n = 0;
  const auto check_size = [&](std::size_t more) {
    if (more > values.size() - n) {
      throw Error(std::to_string(values.size()) + " values, expected more for these variables");
    }
  };
  for (const unsigned reference : references) {
    const ReferencedValue& s = slot(reference);
    if constexpr (std::is_same_v<Element, double>) {
      if (s.variable == nullptr) {
        check_size(1);
        values[n++] = memory_.host_time;
        continue;
      }
    }
    const std::span<Element> from = elements<Element>(reference, s);
    const bool computed = s.variable->role == Role::kOutput || s.variable->role == Role::kState;
    if (computed && memory_.state == kInitialising) initialise();
    check_size(from.size());
    for (const Element& value : from) {
      if constexpr (std::is_same_v<Element, std::string>) {
        values[n++] = value.c_str();
      } else {
        values[n++] = static_cast<Host>(value);
      }
    }
  }
  if (n != values.size()) {
    throw Error(std::to_string(values.size()) + " values, expected " + std::to_string(n) + " for these variables");
  }
}

void Exported::check_writable(const ReferencedValue& slot) const {
  const bool before = (memory_.state & (kInstantiated | kInitialising)) != 0;
  if (slot.variable != nullptr) {
    switch (slot.variable->role) {
      case Role::kInput:
      case Role::kTunable:
        return;
      case Role::kParameter:
        if (before) return;
        throw Error(name_of(slot), "is a fixed parameter; it can only be set before the end of Initialization Mode");
      case Role::kState:
        if (before) return;
        throw Error(name_of(slot), "is a state; only its start value can be set");
      case Role::kOutput:
        break;
    }
  }
  throw Error(name_of(slot), "cannot be set, expected an input, a parameter or a state");
}

template <class Element, class Host>
void Exported::set(std::span<const unsigned> references, std::span<const Host> values) {
  std::size_t n = 0;
  for (const unsigned reference : references) {  // checks everything before anything is written
    const ReferencedValue& s = slot(reference);
    if (s.variable == nullptr) check_writable(s);
    const std::span<Element> to = elements<Element>(reference, s);
    check_writable(s);
    if (to.size() > values.size() - n) {
      throw Error(std::to_string(values.size()) + " values, expected more for these variables");
    }
    const Variable& variable = *s.variable;
    for (std::size_t i = 0; i < to.size(); ++i, ++n) {
      if constexpr (std::is_same_v<Element, std::string>) {
        if (values[n] == nullptr) throw Error(name_of(s), "a NULL string");
      } else if constexpr (!std::is_same_v<Element, bool>) {
        const auto value = static_cast<double>(values[n]);
        const bool ranged = variable.role == Role::kParameter || variable.role == Role::kTunable;
        if (ranged && !(value >= variable.min && value <= variable.max)) {
          throw Error(name_of({&variable, s.first + i, 1}) + " = " + text::to_text(value) +
                      (variable.si_of(s.first + i).empty() ? "" : " " + variable.si_of(s.first + i)) + ", expected " +
                      allowed_values(variable));
        }
      }
    }
  }
  if (n != values.size()) {
    throw Error(std::to_string(values.size()) + " values, expected " + std::to_string(n) + " for these variables");
  }
  n = 0;
  for (const unsigned reference : references) {
    for (Element& to : elements<Element>(reference, slots_[reference])) {
      if constexpr (std::is_same_v<Element, bool>) {
        to = values[n++] != 0;
      } else {
        to = values[n++];
      }
    }
  }
  if (!references.empty() && memory_.state == kInitialising) memory_.initialised = false;
}

template void Exported::get<double, double>(std::span<const unsigned>, std::span<double>);
template void Exported::get<std::int32_t, std::int32_t>(std::span<const unsigned>, std::span<std::int32_t>);
template void Exported::get<bool, int>(std::span<const unsigned>, std::span<int>);
template void Exported::get<bool, bool>(std::span<const unsigned>, std::span<bool>);
template void Exported::get<std::string, const char*>(std::span<const unsigned>, std::span<const char*>);
template void Exported::set<double, double>(std::span<const unsigned>, std::span<const double>);
template void Exported::set<std::int32_t, std::int32_t>(std::span<const unsigned>, std::span<const std::int32_t>);
template void Exported::set<bool, int>(std::span<const unsigned>, std::span<const int>);
template void Exported::set<bool, bool>(std::span<const unsigned>, std::span<const bool>);
template void Exported::set<std::string, const char*>(std::span<const unsigned>, std::span<const char* const>);

Status Exported::set_rates(std::span<const unsigned> references, std::span<const int> orders, std::span<const double> values) {
  for (std::size_t i = 0; i < references.size(); ++i) {
    const ReferencedValue& s = slot(references[i]);
    const bool input = s.variable != nullptr && s.variable->role == Role::kInput && s.variable->kind() == Kind::kReal;
    if (!input) throw Error(name_of(s), "expected a real input");
    if (orders[i] < 1) throw Error(name_of(s), "derivative of order " + std::to_string(orders[i]) + ", expected 1");
  }
  std::string held;
  for (std::size_t i = 0; i < references.size(); ++i) {
    const ReferencedValue& s = slots_[references[i]];
    if (orders[i] == 1 && !s.variable->rate.empty()) {
      s.variable->rate[s.first] = values[i];
    } else if (held.empty() && values[i] != 0) {
      held = orders[i] == 1 ? name_of(s) + " is constant over a step: its derivative is ignored"
                            : name_of(s) + " is extrapolated linearly: its derivative of order " + std::to_string(orders[i]) +
                                  " is ignored";
    }
  }
  if (held.empty()) return Status::kOk;
  if (!warned_of_held_inputs_) report(Status::kWarning, held);
  warned_of_held_inputs_ = true;
  return Status::kWarning;
}

void Exported::output_derivatives(std::span<const unsigned> references, std::span<const int> orders, std::span<double> values) {
  std::size_t n = 0;
  for (std::size_t i = 0; i < references.size(); ++i) {
    const ReferencedValue& s = slot(references[i]);
    if (orders[i] != 1) throw Error(name_of(s), "derivative of order " + std::to_string(orders[i]) + ", expected 1");
    const auto derivative = std::find_if(variables_.begin(), variables_.end(), [&](const Variable& v) {
      return s.variable != nullptr && v.derivative_of == s.variable->name;
    });
    if (derivative == variables_.end()) throw Error(name_of(s), "has no declared derivative");
    if (s.count > values.size() - n) throw Error(std::to_string(values.size()) + " values, expected more");
    for (const double value : derivative->reals().subspan(s.first, s.count)) values[n++] = value;
  }
  if (n != values.size()) throw Error(std::to_string(values.size()) + " values, expected " + std::to_string(n));
}

/// Returns the total number of elements. Throws Error for a variable that is not real.
std::size_t Exported::check_reals(std::span<const unsigned> references) const {
  std::size_t n = 0;
  for (const unsigned reference : references) n += elements<double>(reference, slot(reference)).size();
  return n;
}

void Exported::directional(std::span<const unsigned> unknowns, std::span<const unsigned> knowns, std::span<const double> seed,
                           std::span<double> sensitivity, bool adjoint) {
  const std::size_t rows = check_reals(unknowns), columns = check_reals(knowns);
  const std::size_t in = adjoint ? rows : columns, out = adjoint ? columns : rows;
  if (seed.size() != in || sensitivity.size() != out) {
    throw Error("a seed of " + std::to_string(seed.size()) + " and a sensitivity of " + std::to_string(sensitivity.size()) +
                " values, expected " + std::to_string(in) + " and " + std::to_string(out));
  }
  for (const unsigned reference : unknowns) {
    const ReferencedValue& s = slots_[reference];
    if (s.variable->role != Role::kOutput) throw Error(name_of(s), "is not an output, expected one as an unknown");
  }
  for (const unsigned reference : knowns) {
    const ReferencedValue& s = slots_[reference];
    const bool of_a_block = std::any_of(blocks_.begin(), blocks_.end(), [&](const Block& b) { return b.known == s.variable; });
    if (s.variable->role != Role::kInput && !of_a_block)
      throw Error(name_of(s), "is neither input nor state, expected one as a known");
  }
  if (memory_.state == kInitialising) initialise();
  in_unit([&] { unit().evaluate_partials(partials_); });
  std::fill(sensitivity.begin(), sensitivity.end(), 0.0);
  std::size_t row = 0;
  for (const unsigned u : unknowns) {
    const ReferencedValue& unknown = slots_[u];
    std::size_t column = 0;
    for (const unsigned k : knowns) {
      const ReferencedValue& known = slots_[k];
      for (const Block& b : blocks_) {
        if (b.unknown != unknown.variable || b.known != known.variable) continue;
        for (std::size_t i = 0; i < unknown.count; ++i) {
          for (std::size_t j = 0; j < known.count; ++j) {
            const std::size_t at_i = unknown.first + i, at_j = known.first + j;
            if (b.elementwise && at_i != at_j) continue;
            const double slope = partials_[b.first + (b.elementwise ? at_i : at_i * known.variable->size() + at_j)];
            if (adjoint) {
              sensitivity[column + j] += slope * seed[row + i];
            } else {
              sensitivity[row + i] += slope * seed[column + j];
            }
          }
        }
      }
      column += known.count;
    }
    row += unknown.count;
  }
}

}  // namespace cotwin::fmu
