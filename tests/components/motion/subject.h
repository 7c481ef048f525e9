#pragma once
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "components/motion/motion.h"
#include "components/unit/unit_table.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::testing {

constexpr Duration kTick{1'000'000};
using Values = std::vector<std::pair<std::string, std::string>>;

/// A motion unit with its variables by name, used like the master does.
class MotionSubject {
 public:
  explicit MotionSubject(const std::string& query, const Values& values = {}) {
    const UnitType type{"motion", "", [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<motion::Motion>(s); },
                        &motion::Motion::declare_settings};
    instance_ = make_unit("unit:motion?" + query, {}, {std::filesystem::path(places::source()) / "models"}, {&type, 1});
    for (const auto& [name, value] : values) set(name, value);
  }
  void set(const std::string& name, const std::string& value) { assign_text(instance_.variables.at(name), value); }
  void initialise() {
    instance_.variables.check_ranges();
    instance_.unit->initialise(Time{0});
  }
  /// Outputs at t, reached by one step of a tick.
  void to(double t) { ASSERT_EQ(instance_.unit->step(Time::from_seconds(t) + Duration{-kTick.ns}, kTick), StepResult::kDone); }
  double real(const std::string& name, std::size_t element = 0) const { return instance_.variables.at(name).reals()[element]; }
  Eigen::VectorXd joints(const std::string& name) const {
    const auto x = instance_.variables.at(name).reals();
    return Eigen::Map<const Eigen::VectorXd>(x.data(), static_cast<Eigen::Index>(x.size()));
  }
  Eigen::Vector3d vector(const std::string& name) const { return joints(name); }
  Eigen::Quaterniond orientation() const {
    const Eigen::VectorXd Q = joints("quat_d");
    return {Q[0], Q[1], Q[2], Q[3]};
  }
  bool boolean(const std::string& name) const { return instance_.variables.at(name).booleans()[0]; }
  std::string text(const std::string& name) const { return instance_.variables.at(name).strings()[0]; }
  bool has(const std::string& name) const { return instance_.variables.find(name) != nullptr; }
  std::string error_of_initialise() {
    const std::string error = error_of([&] { initialise(); });
    return error.empty() ? "no error" : error;
  }

 private:
  Instance instance_;
};

}  // namespace cotwin::testing
