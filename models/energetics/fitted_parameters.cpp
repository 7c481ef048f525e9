#include "models/energetics/fitted_parameters.h"

#include <algorithm>
#include <filesystem>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::energetics {
namespace {

/// Values of the parameters prefix_1, prefix_2, … and whether the log told all of them.
struct PerJoint {
  std::vector<double> values;
  std::vector<bool> told;
  bool all_told() const { return std::ranges::find(told, false) == told.end(); }
};

PerJoint collect(const PowerFit& fit, const std::string& prefix) {
  PerJoint found;
  for (const PowerParameter& p : fit.parameters) {
    if (p.joint == 0 || p.name.substr(0, prefix.size()) != prefix) continue;
    found.values.push_back(p.value);
    found.told.push_back(p.told == Told::kValue || p.told == Told::kAtZero);
  }
  return found;
}

std::string listed(const std::vector<double>& values) {
  std::string list;
  for (const double value : values) text::append(list, text::to_text(value, 8), " ");
  return list;
}

}  // namespace

ParameterSet fitted_parameters(const PowerFit& fit, const PowerLog& log) {
  ParameterSet set;
  set.name = "energy";
  std::string assumed;
  const auto add = [&](const std::string& name, std::variant<double, std::int64_t, bool, std::string> value,
                       const std::string& unit = {}) {
    set.values.push_back({name, std::move(value), unit, {}});
  };
  const auto assume = [&](const std::string& name) { text::append(assumed, name, " "); };
  const auto add_joints = [&](const std::string& name, const PerJoint& joints) {
    add(name, listed(joints.values));
    if (!joints.all_told()) assume(name);
  };
  add("current", std::string("dc"));
  const std::vector<double> zeros(log.joints()), ones(log.joints(), 1.0);
  if (fit.model == PowerModel::kCurrent) {
    PerJoint k = collect(fit, "k_");
    double sum = 0;
    int count = 0;
    for (std::size_t j = 0; j < k.values.size(); ++j) {
      k.told[j] = k.told[j] && k.values[j] > 0;
      if (k.told[j]) {
        sum += k.values[j];
        ++count;
      }
    }
    if (count == 0) throw Error(log.place(), "tells no torque constant, expected motions of at least one joint");
    for (std::size_t j = 0; j < k.values.size(); ++j)
      if (!k.told[j]) k.values[j] = sum / count;
    add_joints("R", collect(fit, "r_"));
    add_joints("k_t", k);
  } else {
    if (fit.model != PowerModel::kConstant && fit.value("a") != 1)
      throw Error(log.place(), "the fit has the gain a = " + text::to_text(fit.value("a"), 4) + ", expected 1");
    if (fit.model == PowerModel::kHeat) {
      add_joints("R", collect(fit, "r_"));
    } else {
      add("R", listed(zeros));
    }
    add("k_t", listed(ones));
    if (fit.model == PowerModel::kSpeed) add("k_h", fit.value("c"), "N.m");
    if (fit.model == PowerModel::kMotion || fit.model == PowerModel::kHeat) {
      add_joints("k_h", collect(fit, "c_"));
      add_joints("k_e", collect(fit, "d_"));
    }
  }
  add("P_0", fit.value("P_0"), "W");
  if (fit.parameters.front().told == Told::kDependent) assume("P_0");
  for (const char* name :
       {"P_off", "P_brake", "E_release", "t_close", "controller", "C", "V_min", "V_max", "efficiency", "eta_r"})
    assume(name);
  std::vector<std::string> names;
  for (const std::string& file : log.files) names.push_back(std::filesystem::path(file).filename().string());
  add("sources", "fitted to " + text::joined(names) + " (model " + name_of(fit.model) +
                     ", boundary of its wattmeter; P_0 with brakes open" +
                     (fit.model == PowerModel::kMotion || fit.model == PowerModel::kHeat
                          ? "; k_h, k_e with all that the log's torques do not contain, usually friction"
                          : "") +
                     ")");
  add("assumed", assumed);
  return set;
}

}  // namespace cotwin::energetics
