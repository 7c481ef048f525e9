#pragma once
#include <algorithm>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/text.h"
#include "models/optimisation/evaluation/problem.h"

/// The values of an energy.ssv that the cost "energy" uses.
namespace cotwin::optimisation::testing {

inline Electrical load_electrical(const std::filesystem::path& file, std::size_t joints) {
  Electrical e;
  e.losses = energetics::DriveLosses(joints);
  for (const ParameterValue& v : load_parameter_set(file).values) {
    if (v.name == "current") e.current = energetics::parse_current(v.place, std::get<std::string>(v.value));
    const auto list = [&](const char* name, std::vector<double>& values) {
      if (v.name != name) return;
      if (const double* one = std::get_if<double>(&v.value)) {
        std::fill(values.begin(), values.end(), *one);
        return;
      }
      values.clear();
      for (const auto part : text::split(std::get<std::string>(v.value), ' ')) values.push_back(*text::parse_real(part));
    };
    const auto one = [&](const char* name, double& value) {
      if (v.name == name) value = std::get<double>(v.value);
    };
    list("R", e.losses.R);
    list("k_t", e.losses.k_t);
    list("V_0", e.losses.V_0);
    list("k_h", e.losses.k_h);
    list("k_e", e.losses.k_e);
    one("P_0", e.standby.P_0);
    one("P_brake", e.standby.P_brake);
    one("controller", e.standby.controller);
    one("C", e.link.C);
    one("V_min", e.link.V_min);
    one("V_max", e.link.V_max);
    one("efficiency", e.supply.efficiency);
    one("eta_r", e.supply.eta_r);
  }
  return e;
}

}  // namespace cotwin::optimisation::testing
