#pragma once
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "components/drive_train/drive_train.h"
#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "tests/support/places.h"

/// A drive train under test: built from its settings, with its variables by name.
namespace cotwin::testing {

/// One link about a vertical axis: gravity has no effect, and M is its inertia.
inline const std::string kRotor = places::source() + "/tests/components/data/rotor.urdf";
constexpr double kRotorInertia = 0.2;  // kg.m²

class Drive {
 public:
  explicit Drive(const std::string& query)
      : instance_(
            make_unit("unit:drive_train?" + query, {}, {std::filesystem::path(places::source()) / "models"}, unit_types())) {}

  std::span<double> operator[](const std::string& name) { return instance_.variables.at(name).reals(); }
  std::int32_t integer(const std::string& name, std::size_t i = 0) { return instance_.variables.at(name).integers()[i]; }
  Drive& set(const std::string& name, double value) {
    const Variable& v = instance_.variables.at(name);
    if (v.kind() == Kind::kReal) {
      std::fill(v.reals().begin(), v.reals().end(), value);
    } else {
      v.integers()[0] = static_cast<std::int32_t>(value);
    }
    return *this;
  }
  Drive& tolerances(double relative, double angle, double speed) {
    set("rtol", relative).set("atol", angle).set("atol_speed", speed);
    return *this;
  }
  /// No tolerance: exactly `m` sub-steps of equal length (method=rosenbrock).
  Drive& substeps(int m) { return tolerances(0, 1e-14, 1e-14).set("max_substeps", m); }
  void initialise() { instance_.unit->initialise(Time{}); }
  StepResult try_step(double h) {
    const Duration d = Duration::from_seconds(h);
    const StepResult result = instance_.unit->step(now_, d);
    if (result == StepResult::kDone) now_ = now_ + d;
    return result;
  }
  void step(double h) {
    if (try_step(h) != StepResult::kDone) throw Error("drive", "discarded a step");
  }
  double now() const { return now_.seconds(); }
  double energy() { return (*this)["energy_kinetic"][0] + (*this)["energy_potential"][0] + (*this)["energy_elastic"][0]; }
  /// The error of the energy balance: 0 if no energy is lost or created.
  double unbalanced(double energy_at_start) {
    return energy() - energy_at_start - (*this)["work_m"][0] - (*this)["work_e"][0] + (*this)["energy_dissipated"][0] +
           (*this)["work_0"][0];
  }
  Instance& instance() { return instance_; }
  const Variables& variables() const { return instance_.variables; }
  void move_clock_to(const Drive& other) { now_ = other.now_; }

 private:
  Instance instance_;
  Time now_;
};

/// Torques that move the LWR 4+: constant in each step, with jumps, never the same twice.
inline double excitation(int step, std::size_t joint) {
  const double size = joint < 2 ? 20 : joint < 4 ? 12 : 3;
  return size * std::sin(0.011 * step * (1 + 0.3 * static_cast<double>(joint)) + static_cast<double>(joint));
}

}  // namespace cotwin::testing
