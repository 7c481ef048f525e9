#include "components/shared_states/field_values.h"

#include <cstring>
#include <utility>

namespace cotwin::shared_states {

using bus::StateField;

FieldValues::FieldValues(bus::StateLayout layout) : layout_(std::move(layout)) {
  std::size_t reals = 0, integers = 0, booleans = 0;
  for (const StateField& f : layout_.fields()) {
    std::size_t& end = f.kind == StateField::Kind::kReal ? reals : f.kind == StateField::Kind::kInteger ? integers : booleans;
    places_.push_back(end);
    end += f.size;
  }
  reals_.resize(reals);
  integers_.resize(integers);
  booleans_ = std::make_unique<bool[]>(booleans);
}

/// Calls action(field, span of its values).
template <class Action>
void FieldValues::for_each_field(const Action& action) {
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const StateField& f = layout_.fields()[i];
    if (f.kind == StateField::Kind::kReal) {
      action(f, std::span(reals_).subspan(places_[i], f.size));
    } else if (f.kind == StateField::Kind::kInteger) {
      action(f, std::span(integers_).subspan(places_[i], f.size));
    } else {
      action(f, std::span(booleans_.get() + places_[i], f.size));
    }
  }
}

void FieldValues::declare_inputs(Variables& v) {
  const std::string description = "state that is sent to the peer";
  for_each_field([&]<class T>(const StateField& f, std::span<T> values) {
    if constexpr (std::is_same_v<T, double>) {
      v.input(f.name, values, f.si, description);
    } else {
      v.input(f.name, values, description);
    }
  });
}

void FieldValues::declare_outputs(Variables& v) {
  const std::string description = "state of the peer; before the first one: its start value";
  for_each_field([&]<class T>(const StateField& f, std::span<T> values) {
    if constexpr (std::is_same_v<T, double>) {
      v.output(f.name, values, f.si, description).start().discrete();
    } else {
      v.output(f.name, values, description).start();
    }
  });
}

void FieldValues::write_to(std::span<std::byte> image) const {
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const StateField& f = layout_.fields()[i];
    std::byte* const to = image.data() + layout_.offset(i);
    if (f.kind == StateField::Kind::kReal) {
      std::memcpy(to, reals_.data() + places_[i], f.size * sizeof(double));
    } else if (f.kind == StateField::Kind::kInteger) {
      std::memcpy(to, integers_.data() + places_[i], f.size * sizeof(std::int32_t));
    } else {
      for (std::size_t k = 0; k < f.size; ++k) to[k] = booleans_[places_[i] + k] ? std::byte{1} : std::byte{0};
    }
  }
}

void FieldValues::read_from(std::span<const std::byte> image) {
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const StateField& f = layout_.fields()[i];
    const std::byte* const from = image.data() + layout_.offset(i);
    if (f.kind == StateField::Kind::kReal) {
      std::memcpy(reals_.data() + places_[i], from, f.size * sizeof(double));
    } else if (f.kind == StateField::Kind::kInteger) {
      std::memcpy(integers_.data() + places_[i], from, f.size * sizeof(std::int32_t));
    } else {
      for (std::size_t k = 0; k < f.size; ++k) booleans_[places_[i] + k] = from[k] != std::byte{0};
    }
  }
}

}  // namespace cotwin::shared_states
