#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "components/bus/state_layout.h"
#include "components/unit/variables.h"

namespace cotwin::shared_states {

/// The fields of a state layout as variables of a unit.
class FieldValues {
 public:
  explicit FieldValues(bus::StateLayout layout);

  const bus::StateLayout& layout() const { return layout_; }
  void declare_inputs(Variables& v);
  void declare_outputs(Variables& v);
  /// Copies all values to or from an image of layout().bytes().
  void write_to(std::span<std::byte> image) const;
  void read_from(std::span<const std::byte> image);

 private:
  template <class Action>
  void for_each_field(const Action& action);

  bus::StateLayout layout_;
  std::vector<double> reals_;
  std::vector<std::int32_t> integers_;
  std::unique_ptr<bool[]> booleans_;
  std::vector<std::size_t> places_;  // of each field in the array of its kind
};

}  // namespace cotwin::shared_states
