#pragma once
#include <cstddef>

#include "components/unit/variables.h"

namespace cotwin {

/// A unit that declares which outputs follow which inputs without delay.
class DeclaredDependencies {
 public:
  virtual ~DeclaredDependencies() = default;
  /// Whether element `row` of a real output is declared to follow element `column` of a real input. False where the unit does not say.
  virtual bool follows(const Variable& output, std::size_t row, const Variable& input, std::size_t column) const = 0;
};

}  // namespace cotwin
