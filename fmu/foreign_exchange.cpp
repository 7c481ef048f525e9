// How the values of ForeignVariables get through the C interfaces and back.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "fmu/foreign_variables.h"
#include "fmu/hex.h"
#include "models/text/error.h"

namespace cotwin::fmu {

namespace {

constexpr std::uint8_t kNoByte = 0;

/// The number that comes closest to `value` in T.
template <class T, class From>
T nearest(From value) {
  if constexpr (std::is_same_v<T, From> || std::is_floating_point_v<T>) {
    return static_cast<T>(value);
  } else if constexpr (std::is_floating_point_v<From>) {
    if (!(value == value)) return 0;
    const From rounded = std::nearbyint(value);
    // The limits of 64 bits are not doubles: 2^63 and 2^64 are the first ones past them.
    if (rounded >= std::ldexp(1.0, std::numeric_limits<T>::digits)) return std::numeric_limits<T>::max();
    if (rounded <= static_cast<From>(std::numeric_limits<T>::min())) return std::numeric_limits<T>::min();
    return static_cast<T>(rounded);
  } else {
    return static_cast<T>(value);
  }
}

template <class T>
bool same(std::span<const T> a, std::span<const T> b) {
  if constexpr (std::is_same_v<T, std::string>) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end());
  } else {
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);  // bits: NaN is NaN
  }
}

}  // namespace

void* ForeignVariables::wire_of(Group& group) {
  void* wire = nullptr;
  if (group.type == Type::kString) return group.texts.data();
  if (group.type == Type::kBinary) return group.bytes.data();
  with_wire(group.type, [&](auto sample, auto& store) {
    using Wire = decltype(sample);
    using T = std::remove_cvref_t<decltype(store.values[0])>;
    // Without conversion the storage itself goes through the call.
    wire = std::is_same_v<Wire, T> && group.factors.empty() ? static_cast<void*>(store.values.get() + group.first)
                                                            : group.wire.data();
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
        group.bytes[i] = group.binaries[i].empty() ? &kNoByte : group.binaries[i].data();  // FMUs copy from it even so
        group.sizes[i] = group.binaries[i].size();
      }
    }
    return wire;
  }
  with_wire(group.type, [&](auto sample, auto& store) {
    using Wire = decltype(sample);
    const auto* values = store.values.get() + group.first;
    if (wire == static_cast<const void*>(values)) return;
    auto* out = static_cast<Wire*>(wire);
    for (std::size_t i = 0; i < group.size; ++i) {
      if constexpr (std::is_floating_point_v<std::remove_cvref_t<decltype(*values)>>) {
        out[i] = nearest<Wire>(group.factors.empty() ? values[i] : (values[i] - group.offsets[i]) / group.factors[i]);
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
    T* values = store.values.get() + group.first;
    if (wire == static_cast<void*>(values)) return;
    const auto* in = static_cast<const Wire*>(wire);
    for (std::size_t i = 0; i < group.size; ++i) {
      if constexpr (std::is_same_v<T, double>) {
        const auto value = static_cast<double>(in[i]);
        values[i] = group.factors.empty() ? value : group.factors[i] * value + group.offsets[i];
      } else if constexpr (std::is_same_v<T, bool>) {
        values[i] = in[i] != 0;
      } else {
        if (in[i] < std::numeric_limits<std::int32_t>::min() || in[i] > std::numeric_limits<std::int32_t>::max()) {
          throw Error(
              "variable with value reference " + std::to_string(group.references[std::min(i, group.references.size() - 1)]),
              std::to_string(in[i]) + ", expected a value of 32 bits");
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
    return !same<T>({store.values.get() + group.first, group.size}, {store.sent.get() + group.first, group.size});
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
  for (Group& group : groups_[static_cast<std::size_t>(exchange)]) {
    if (!changed(group)) continue;
    set(instance, group);
    with_store(group.kind,
               [&](auto& store) { std::copy_n(store.values.get() + group.first, group.size, store.sent.get() + group.first); });
    group.sent = true;
    any = true;
  }
  return any;
}

void ForeignVariables::forget() {
  for (auto& groups : groups_) {
    for (Group& group : groups) group.sent = false;
  }
  std::fill(rate_known_.begin(), rate_known_.end(), false);
}

void ForeignVariables::settle(Exchange exchange) {
  for (Group& group : groups_[static_cast<std::size_t>(exchange)]) {
    with_store(group.kind,
               [&](auto& store) { std::copy_n(store.values.get() + group.first, group.size, store.sent.get() + group.first); });
    group.sent = true;
  }
}

void ForeignVariables::receive(ForeignInstance& instance, Exchange exchange) {
  for (Group& group : groups_[static_cast<std::size_t>(exchange)]) get(instance, group);
}

void ForeignVariables::adopt_starts(ForeignInstance* instance) {
  const auto each = [&](auto call) {
    for (Item& item : items_) {
      if (item.settable && item.exchange == Exchange::kResult) with_store(item.kind, [&](auto& store) { call(item, store); });
    }
  };
  const auto adopt = [](const Item& item, auto& store) {
    std::copy_n(store.values.get() + item.first, item.size, store.given.get() + item.first);
  };
  if (instance == nullptr) return each(adopt);
  // `sent` of results is free to hold what the variables say now, while the instance tells what it had given them.
  each([](const Item& item, auto& store) {
    std::copy_n(store.values.get() + item.first, item.size, store.sent.get() + item.first);
  });
  receive(*instance, Exchange::kResult);
  each([](const Item& item, auto& store) {
    using T = std::remove_cvref_t<decltype(store.values[0])>;
    const bool written = !same<T>({store.values.get() + item.first, item.size}, {store.sent.get() + item.first, item.size});
    if (written) std::copy_n(store.sent.get() + item.first, item.size, store.given.get() + item.first);
  });
}

void ForeignVariables::set_starts(ForeignInstance& instance) {
  if (!structural_references_.empty()) instance.configure(structural_references_, structural_values_);
  for (Item& item : items_) {
    if (!item.settable) continue;
    bool differs = false;
    with_store(item.kind, [&](auto& store) {
      using T = std::remove_cvref_t<decltype(store.values[0])>;
      if (item.exchange == Exchange::kResult)
        std::copy_n(store.given.get() + item.first, item.size, store.values.get() + item.first);
      differs = !same<T>({store.values.get() + item.first, item.size}, {store.starts.get() + item.first, item.size});
    });
    if (!differs) continue;
    const Item* one[] = {&item};
    Group group = make_group(one);
    try {
      set(instance, group);
    } catch (const Error& error) {
      throw Error("start value of '" + item.name + "'", error.what());
    }
  }
}

bool ForeignVariables::any_rate() const {
  return std::any_of(rates_.begin(), rates_.end(), [](double r) { return r != 0; });
}

bool ForeignVariables::send_rates(ForeignInstance& instance) {
  if (rates_.empty()) return false;
  Group& group = groups_[static_cast<std::size_t>(Exchange::kContinuousInput)].back();
  std::size_t n = 0;
  bool any = false;
  // Those that rest are not spoken of: an FMU that can interpolate inputs need not be able to for all of them.
  for (std::size_t i = 0; i < rates_.size(); ++i) {
    if (rates_[i] == 0 && !rate_known_[i]) continue;
    rate_references_[n] = group.references[i];
    rate_scratch_[n++] = group.factors.empty() ? rates_[i] : rates_[i] / group.factors[i];
    rate_known_[i] = rates_[i] != 0;
    any = any || rates_[i] != 0;
  }
  if (n == 0) return false;
  instance.set_input_derivatives({rate_references_.data(), n}, {orders_.data(), n}, {rate_scratch_.data(), n});
  if (any) group.sent = false;  // the FMU moves them on
  return true;
}

void ForeignVariables::send_ramped(ForeignInstance& instance, double dt) {
  if (!any_rate()) return;
  Group& group = groups_[static_cast<std::size_t>(Exchange::kContinuousInput)].back();
  const double* values = reals_.values.get() + group.first;
  for (std::size_t i = 0; i < rates_.size(); ++i) {
    const double value = values[i] + rates_[i] * dt;
    rate_scratch_[i] = group.factors.empty() ? value : (value - group.offsets[i]) / group.factors[i];
  }
  instance.set(Type::kFloat64, group.references, rate_scratch_.data(), rate_scratch_.size(), nullptr);
  group.sent = false;
}

std::span<const double> ForeignVariables::continuous_values() const {
  for (const Group& group : groups_[static_cast<std::size_t>(Exchange::kContinuousInput)]) {
    if (group.type == Type::kFloat64) return {reals_.values.get() + group.first, group.size};
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
