#pragma once
#include <string>

#include "components/unit/variables.h"

/// Linear extrapolation of inputs over a step (Variable::rate) in FMI 3.0, which has no fmi2SetRealInputDerivatives. The slope
/// of the input "u" is a further input "der(u)" after all other variables; its attribute `derivative` refers to u. A slope
/// stays valid until it is set again. If the host never sets it, it is 0 and the input is constant over a step.
namespace cotwin::fmu {

/// The attribute generationTool of our model descriptions.
inline constexpr const char* kGenerationTool = "Cotwin";

inline std::string rate_name(const std::string& input) { return "der(" + input + ")"; }

/// "N.m" → "N.m/s", "rad/s" → "rad/(s.s)".
inline std::string rate_measure(const std::string& si) {
  const std::size_t slash = si.find('/');
  if (slash == std::string::npos) return si + "/s";
  const std::string below = si.substr(slash + 1);
  const bool bracketed = below.front() == '(';
  return si.substr(0, slash) + "/(" + (bracketed ? below.substr(1, below.size() - 2) : below) + ".s)";
}

/// Returns the variable "der(u)" of an input with a rate.
inline Variable rate_variable(const Variable& input) {
  Variable rate;
  rate.name = rate_name(input.name);
  rate.role = Role::kInput;
  rate.storage = input.rate;
  rate.si = input.mixed() ? "" : rate_measure(input.si);
  if (input.mixed()) {
    auto elements = std::make_shared<Elements>();
    for (const std::string& si : input.elements->si) elements->si.push_back(rate_measure(si));
    rate.elements = std::move(elements);
  }
  rate.description = "slope of " + input.name + " over the next step; 0: " + input.name + " is held";
  return rate;
}

}  // namespace cotwin::fmu
