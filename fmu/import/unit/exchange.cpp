// Exchange of the values of ForeignVariables with the FMU through the C interfaces.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

#include "fmu/description/hex.h"
#include "fmu/import/unit/variables.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

constexpr std::uint8_t kNoByte = 0;

/// Returns the number of type T that is nearest to `value`.
template <class T, class From>
T nearest(From value) {
  if constexpr (std::is_same_v<T, From> || std::is_floating_point_v<T>) {
    return static_cast<T>(value);
  } else if constexpr (std::is_floating_point_v<From>) {
    if (!(value == value)) return 0;
    const From rounded = std::nearbyint(value);
    // The largest 64-bit integers are not exact in double; 2^63 and 2^64 are the first doubles above them.
    if (rounded >= std::ldexp(1.0, std::numeric_limits<T>::digits)) return std::numeric_limits<T>::max();
    if (rounded <= static_cast<From>(std::numeric_limits<T>::min())) return std::numeric_limits<T>::min();
    return static_cast<T>(rounded);
  } else if constexpr (std::is_same_v<From, bool>) {
    return static_cast<T>(value);
  } else {
    if (std::cmp_less(value, std::numeric_limits<T>::min())) return std::numeric_limits<T>::min();
    if (std::cmp_greater(value, std::numeric_limits<T>::max())) return std::numeric_limits<T>::max();
    return static_cast<T>(value);
  }
}

/// Whether double has the number.
template <class T>
bool is_exact(T value) {
  if constexpr (sizeof(T) < 8) return true;
  const std::uint64_t magnitude =
      value < T{0} ? std::uint64_t{0} - static_cast<std::uint64_t>(value) : static_cast<std::uint64_t>(value);
  return std::bit_width(magnitude) - (magnitude == 0 ? 0 : std::countr_zero(magnitude)) <= std::numeric_limits<double>::digits;
}

/// Whether the number that is nearest to `value` is of type T.
template <class T>
bool is_in_range(double value) {
  return value == value && std::nearbyint(value) < std::ldexp(1.0, std::numeric_limits<T>::digits) &&
         std::nearbyint(value) >= static_cast<double>(std::numeric_limits<T>::min());
}

template <class T>
bool same(std::span<const T> a, std::span<const T> b) {
  if constexpr (std::is_same_v<T, std::string>) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end());
  } else {
    return a.size() == b.size() &&
           (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);  // compares bits, so NaN equals NaN
  }
}

bool intersects(std::span<const std::uint32_t> a, std::span<const std::uint32_t> b) {
  return std::any_of(a.begin(), a.end(), [&](std::uint32_t x) { return std::find(b.begin(), b.end(), x) != b.end(); });
}

}  // namespace

std::string ForeignVariables::name_of(const Group& group, std::size_t element) const {
  const std::size_t at = group.first + element;
  for (const Item& item : items_) {
    if (item.kind != group.kind || at < item.first || at >= item.first + item.size) continue;
    return "'" + item.name + "'" + (item.size > 1 ? "[" + std::to_string(at - item.first + 1) + "]" : "");
  }
  return "variable with value reference " + std::to_string(group.references[std::min(element, group.references.size() - 1)]);
}

void* ForeignVariables::wire_of(Group& group) {
  void* wire = nullptr;
  if (group.type == Type::kString) return group.texts.data();
  if (group.type == Type::kBinary) return group.bytes.data();
  with_wire(group.type, [&](auto sample, auto& store) {
    using Wire = decltype(sample);
    using T = std::remove_cvref_t<decltype(store.values[0])>;
    // Without conversion the call accesses the storage directly.
    wire =
        std::is_same_v<Wire, T> && group.factors.empty() ? static_cast<void*>(store.values + group.first) : group.wire.data();
  });
  return wire;
}

void* ForeignVariables::to_wire(Group& group) {
  void* wire = wire_of(group);
  if (group.kind == Kind::kString) {
    for (std::size_t i = 0; i < group.size; ++i) {
      const std::string& text = strings_.values[group.first + i];
      if (group.type == Type::kString) {
        group.texts[i] = text.c_str();
      } else {
        from_hex(text, group.binaries[i]);
        group.bytes[i] = group.binaries[i].empty()
                             ? &kNoByte
                             : group.binaries[i].data();  // not nullptr: some FMUs copy from it even if the size is 0
        group.sizes[i] = group.binaries[i].size();
      }
    }
    return wire;
  }
  with_wire(group.type, [&](auto sample, auto& store) {
    using Wire = decltype(sample);
    const auto* values = store.values + group.first;
    if (wire == static_cast<const void*>(values)) return;
    auto* out = static_cast<Wire*>(wire);
    for (std::size_t i = 0; i < group.size; ++i) {
      if constexpr (std::is_floating_point_v<std::remove_cvref_t<decltype(*values)>>) {
        const double value = group.factors.empty() ? values[i] : (values[i] - group.offsets[i]) / group.factors[i];
        if constexpr (std::is_integral_v<Wire> && sizeof(Wire) == 8) {
          const auto exact = exact_.empty() ? exact_.end() : exact_.find(values + i);
          if (exact != exact_.end() && static_cast<double>(static_cast<Wire>(exact->second)) == value) {
            out[i] = static_cast<Wire>(exact->second);
            continue;
          }
          if (!is_in_range<Wire>(value)) [[unlikely]]
            throw Error(name_of(group, i), text::to_text(value) + ", expected a number that " +
                                               (std::is_signed_v<Wire> ? "Int64" : "UInt64") + " has");
        }
        out[i] = nearest<Wire>(value);
      } else {
        out[i] = nearest<Wire>(values[i]);
      }
    }
  });
  return wire;
}

void ForeignVariables::from_wire(Group& group) {
  if (group.kind == Kind::kString) {
    for (std::size_t i = 0; i < group.size; ++i) {
      std::string& text = strings_.values[group.first + i];
      if (group.type == Type::kString) {
        text = group.texts[i] != nullptr ? group.texts[i] : "";
      } else {
        text = group.bytes[i] != nullptr ? to_hex({group.bytes[i], group.sizes[i]}) : "";
      }
    }
    return;
  }
  void* wire = wire_of(group);
  with_wire(group.type, [&](auto sample, auto& store) {
    using Wire = decltype(sample);
    using T = std::remove_cvref_t<decltype(store.values[0])>;
    T* values = store.values + group.first;
    if (wire == static_cast<void*>(values)) return;
    const auto* in = static_cast<const Wire*>(wire);
    for (std::size_t i = 0; i < group.size; ++i) {
      if constexpr (std::is_same_v<T, double>) {
        if constexpr (std::is_integral_v<Wire>) {
          if (!is_exact(in[i])) [[unlikely]]
            throw Error(name_of(group, i),
                        std::to_string(in[i]) +
                            " cannot be recorded exactly, expected an integer up to 2^53 in magnitude or one with as "
                            "many bits; locals=false leaves local variables out");
        }
        const auto value = static_cast<double>(in[i]);
        values[i] = group.factors.empty() ? value : group.factors[i] * value + group.offsets[i];
      } else if constexpr (std::is_same_v<T, bool>) {
        values[i] = in[i] != 0;
      } else {
        if (in[i] < std::numeric_limits<std::int32_t>::min() || in[i] > std::numeric_limits<std::int32_t>::max()) {
          throw Error(name_of(group, i), std::to_string(in[i]) + ", expected a signed 32-bit integer");
        }
        values[i] = static_cast<std::int32_t>(in[i]);
      }
    }
  });
}

void ForeignVariables::set(ForeignInstance& instance, Group& group) {
  const void* wire = to_wire(group);
  instance.set(group.type, group.references, wire, group.size, group.type == Type::kBinary ? group.sizes.data() : nullptr);
}

void ForeignVariables::get(ForeignInstance& instance, Group& group) {
  instance.get(group.type, group.references, wire_of(group), group.size,
               group.type == Type::kBinary ? group.sizes.data() : nullptr);
  from_wire(group);
}

bool ForeignVariables::changed(const Group& group) const {
  if (!group.sent) return true;
  const auto differs = [&](const auto& store) {
    using T = std::remove_cvref_t<decltype(store.values[0])>;
    return !same<T>({store.values + group.first, group.size}, {store.sent + group.first, group.size});
  };
  switch (group.kind) {
    case Kind::kReal:
      return differs(reals_);
    case Kind::kInteger:
      return differs(integers_);
    case Kind::kBoolean:
      return differs(booleans_);
    case Kind::kString:
      return differs(strings_);
  }
  return true;
}

bool ForeignVariables::changed(Exchange exchange) const {
  const auto& groups = groups_[static_cast<std::size_t>(exchange)];
  return std::any_of(groups.begin(), groups.end(), [&](const Group& g) { return changed(g); });
}

bool ForeignVariables::send(ForeignInstance& instance, Exchange exchange) {
  bool any = false;
  for (Group& group : groups_[static_cast<std::size_t>(exchange)]) any = send(instance, group) || any;
  return any;
}

bool ForeignVariables::send(ForeignInstance& instance, Group& group) {
  if (!changed(group)) return false;
  set(instance, group);
  with_store(group.kind, [&](auto& store) { std::copy_n(store.values + group.first, group.size, store.sent + group.first); });
  group.sent = true;
  return true;
}

std::span<bool> ForeignVariables::clock(std::uint32_t reference) {
  for (const Item& item : items_) {
    if (item.type == Type::kClock && item.references.front() == reference) return booleans_.of(item);
  }
  return {};
}

void ForeignVariables::send_clocked(ForeignInstance& instance, std::span<const std::uint32_t> active) {
  for (Group& group : groups_[static_cast<std::size_t>(Exchange::kClockedInput)]) {
    if (intersects(group.clocks, active)) send(instance, group);
  }
}

void ForeignVariables::receive_clocked(ForeignInstance& instance, std::span<const std::uint32_t> active) {
  for (Group& group : groups_[static_cast<std::size_t>(Exchange::kClockedResult)]) {
    if (intersects(group.clocks, active)) get(instance, group);
  }
}

void ForeignVariables::forget() {
  for (auto& groups : groups_) {
    for (Group& group : groups) group.sent = false;
  }
  std::fill(nonzero_rate_.begin(), nonzero_rate_.end(), false);
}

void ForeignVariables::mark_sent(Exchange exchange) {
  for (Group& group : groups_[static_cast<std::size_t>(exchange)]) {
    with_store(group.kind, [&](auto& store) { std::copy_n(store.values + group.first, group.size, store.sent + group.first); });
    group.sent = true;
  }
}

void ForeignVariables::receive(ForeignInstance& instance, Exchange exchange) {
  for (Group& group : groups_[static_cast<std::size_t>(exchange)]) get(instance, group);
}

void ForeignVariables::receive_outputs(ForeignInstance& instance) {
  if (outputs_.empty()) {
    for (const Item& item : items_) {
      const Item* alone = &item;
      if (item.role == Role::kOutput && item.exchange == Exchange::kResult) outputs_.push_back(make_group({&alone, 1}));
    }
  }
  for (Group& group : outputs_) get(instance, group);
}

bool ForeignVariables::needs_full_step() const {
  if (changed(Exchange::kDiscreteInput) || changed(Exchange::kTunable)) return true;
  return any_rate() || std::find(nonzero_rate_.begin(), nonzero_rate_.end(), true) != nonzero_rate_.end();
}

void ForeignVariables::receive_others(ForeignInstance& instance, double h) {
  for (Group& group : groups_[static_cast<std::size_t>(Exchange::kResult)]) {
    const bool plain = group.kind == Kind::kReal && reals_.values + group.first == plain_.get_values.data();
    if (!plain) get(instance, group);
  }
  receive_slopes(instance, h);
}

bool ForeignVariables::find_unavailable_slope(ForeignInstance& instance) {
  for (; slopes_probed_ < items_.size(); ++slopes_probed_) {
    const Item& slope = items_[slopes_probed_];
    if (slope.exchange != Exchange::kSlope) continue;
    const Item* probed = &slope;
    Group alone = make_group({&probed, 1});
    try {
      instance.get_output_derivatives(alone.references, std::span(slope_orders_).first(alone.references.size()),
                                      {static_cast<double*>(wire_of(alone)), alone.size});
    } catch (const Error& error) {
      const auto of = std::find_if(items_.begin(), items_.end(), [&](const Item& i) { return i.name == slope.slope_of; });
      computed_slopes_.push_back({&slope, &*of, std::vector<double>(of->size)});
      slope_notes_.push_back("the FMU gives no derivative of '" + slope.slope_of + "' (" + error.what() +
                             "); the slope over its last step is used");
      ++slopes_probed_;
      group_available_slopes();
      return true;
    }
  }
  return false;
}

/// Makes one group for each slope that the FMU gives, for their elements need not be contiguous in the storage.
void ForeignVariables::group_available_slopes() {
  std::vector<Group>& groups = groups_[static_cast<std::size_t>(Exchange::kSlope)];
  groups.clear();
  for (const Item& item : items_) {
    const bool computed =
        std::any_of(computed_slopes_.begin(), computed_slopes_.end(), [&](const ComputedSlope& c) { return c.slope == &item; });
    const Item* given = &item;
    if (item.exchange == Exchange::kSlope && !computed) groups.push_back(make_group({&given, 1}));
  }
}

void ForeignVariables::receive_slopes(ForeignInstance& instance, double h) {
  for (Group& group : groups_[static_cast<std::size_t>(Exchange::kSlope)]) {
    instance.get_output_derivatives(group.references, std::span(slope_orders_).first(group.references.size()),
                                    {static_cast<double*>(wire_of(group)), group.size});
    from_wire(group);
  }
  for (ComputedSlope& computed : computed_slopes_) {
    const std::span<const double> now = reals_.of(*computed.of);
    const std::span<double> slope = reals_.of(*computed.slope);
    for (std::size_t i = 0; i < now.size(); ++i) {
      slope[i] = (now[i] - computed.before[i]) / h;
      computed.before[i] = now[i];
    }
  }
}

void ForeignVariables::clear_slopes() {
  for (const Item& item : items_) {
    if (item.exchange == Exchange::kSlope) std::fill_n(reals_.values + item.first, item.size, 0.0);
  }
  restart_slopes();
}

void ForeignVariables::restart_slopes() {
  for (ComputedSlope& c : computed_slopes_) std::ranges::copy(reals_.of(*c.of), c.before.begin());
}

void ForeignVariables::collect_written_starts(ForeignInstance* instance) {
  const auto each = [&](auto call) {
    for (Item& item : items_) {
      if (item.settable && item.exchange == Exchange::kResult) with_store(item.kind, [&](auto& store) { call(item, store); });
    }
  };
  const auto collect = [](const Item& item, auto& store) {
    std::copy_n(store.values + item.first, item.size, store.given + item.first);
  };
  if (instance == nullptr) return each(collect);
  // `sent` is unused for results. It holds the present values while the instance's own results are read for comparison.
  each([](const Item& item, auto& store) { std::copy_n(store.values + item.first, item.size, store.sent + item.first); });
  receive(*instance, Exchange::kResult);
  each([](const Item& item, auto& store) {
    using T = std::remove_cvref_t<decltype(store.values[0])>;
    const bool written = !same<T>({store.values + item.first, item.size}, {store.sent + item.first, item.size});
    if (written) std::copy_n(store.sent + item.first, item.size, store.given + item.first);
  });
}

void ForeignVariables::set_starts(ForeignInstance& instance) {
  std::vector<const Item*> structural, others;
  for (Item& item : items_) {
    if (!item.settable) continue;
    bool differs = false;
    with_store(item.kind, [&](auto& store) {
      using T = std::remove_cvref_t<decltype(store.values[0])>;
      if (item.exchange == Exchange::kResult) std::copy_n(store.given + item.first, item.size, store.values + item.first);
      differs = !same<T>({store.values + item.first, item.size}, {store.starts + item.first, item.size});
      if constexpr (std::is_same_v<T, double>) {
        for (std::size_t i = 0; i < item.size && !exact_.empty(); ++i)
          differs |= exact_.contains(store.values + item.first + i);
      }
    });
    if (differs) (item.structural ? structural : others).push_back(&item);
  }
  const auto set_each = [&](const std::vector<const Item*>& items) {
    for (const Item* item : items) {
      Group group = make_group({&item, 1});
      try {
        set(instance, group);
      } catch (const Error& error) {
        throw Error("start value of '" + item->name + "'", error.what());
      }
    }
  };
  const std::size_t n = structural_references_.size();
  if (n > 0 || !structural.empty()) {
    instance.configure([&] {
      if (n > 0) instance.set(Type::kUInt64, structural_references_, structural_values_.data(), n, nullptr);
      set_each(structural);
    });
  }
  set_each(others);
}

bool ForeignVariables::any_rate() const {
  return std::any_of(rates_.begin(), rates_.end(), [](double r) { return r != 0; });
}

bool ForeignVariables::send_rate_inputs(ForeignInstance& instance) {
  Group& group = groups_[static_cast<std::size_t>(Exchange::kContinuousInput)].back();
  bool any = false;
  for (const Item* item : rated_items_) {
    const std::size_t first = item->first - group.first;
    bool moves = false, moved = false;
    for (std::size_t i = first; i < first + item->size; ++i) {
      rate_scratch_[i] = rates_[i] / item->factor;
      moves = moves || rates_[i] != 0;
      moved = moved || nonzero_rate_[i];
    }
    if (!moves && !moved) continue;
    instance.set(Type::kFloat64, item->rate_references, rate_scratch_.data() + first, item->size, nullptr);
    for (std::size_t i = first; i < first + item->size; ++i) nonzero_rate_[i] = moves;
    any = true;
  }
  return any;
}

bool ForeignVariables::send_rates(ForeignInstance& instance) {
  if (rates_.empty()) return false;
  if (!rated_items_.empty()) return send_rate_inputs(instance);
  Group& group = groups_[static_cast<std::size_t>(Exchange::kContinuousInput)].back();
  std::size_t n = 0;
  bool any = false;
  // Zero rates are not sent, for an FMU that can interpolate inputs need not be able to do so for all of them.
  for (std::size_t i = 0; i < rates_.size(); ++i) {
    if (rates_[i] == 0 && !nonzero_rate_[i]) continue;
    rate_references_[n] = group.references[i];
    rate_scratch_[n++] = group.factors.empty() ? rates_[i] : rates_[i] / group.factors[i];
    nonzero_rate_[i] = rates_[i] != 0;
    any = any || rates_[i] != 0;
  }
  if (n == 0) return false;
  instance.set_input_derivatives({rate_references_.data(), n}, {orders_.data(), n}, {rate_scratch_.data(), n});
  if (any) group.sent = false;  // the FMU changes their values
  return true;
}

void ForeignVariables::send_ramped(ForeignInstance& instance, double dt) {
  if (!any_rate()) return;
  Group& group = groups_[static_cast<std::size_t>(Exchange::kContinuousInput)].back();
  const double* values = reals_.values + group.first;
  for (std::size_t i = 0; i < rates_.size(); ++i) {
    const double value = values[i] + rates_[i] * dt;
    rate_scratch_[i] = group.factors.empty() ? value : (value - group.offsets[i]) / group.factors[i];
  }
  instance.set(Type::kFloat64, group.references, rate_scratch_.data(), rate_scratch_.size(), nullptr);
  group.sent = false;
}

std::span<const double> ForeignVariables::continuous_values() const {
  for (const Group& group : groups_[static_cast<std::size_t>(Exchange::kContinuousInput)]) {
    if (group.type == Type::kFloat64) return {reals_.values + group.first, group.size};
  }
  return {};
}

std::vector<std::uint32_t> ForeignVariables::continuous_inputs() const {
  for (const Group& group : groups_[static_cast<std::size_t>(Exchange::kContinuousInput)]) {
    if (group.type == Type::kFloat64) return group.references;
  }
  return {};
}

}  // namespace cotwin::fmu
