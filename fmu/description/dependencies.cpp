#include "fmu/description/dependencies.h"

#include <algorithm>
#include <string>

namespace cotwin::fmu {

bool declares_dependency(const ModelDescription& description, const Variable& output, std::size_t row, const Variable& input,
                         std::size_t column) {
  const auto is_element = [&](std::size_t described, const Variable& v, std::size_t element) {
    const std::string& name = description.variables[described].name;
    return name == v.name || name == v.name + "[" + std::to_string(element + 1) + "]";
  };
  return std::ranges::any_of(description.structure.outputs, [&](const Unknown& unknown) {
    const auto depends_on = [&](std::size_t known) { return is_element(known, input, column); };
    return unknown.dependencies && is_element(unknown.variable, output, row) &&
           std::ranges::any_of(*unknown.dependencies, depends_on);
  });
}

}  // namespace cotwin::fmu
