#pragma once
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <concepts>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "components/unit/unit_table.h"
#include "models/foundation/support/error.h"
#include "tests/support/places.h"

namespace cotwin::testing {

/// A unit under test with its variables by name, used like the master does.
class UnitSubject {
 public:
  /// `source`: "unit:drive_train?robot=lwr4"; `values`: variables and what a parameter file would give them.
  explicit UnitSubject(const std::string& source, const std::vector<std::pair<std::string, std::string>>& values = {})
      : instance_(make_unit(source, {}, {places::source() + "/models", places::source()}, unit_types())) {
    for (const auto& [name, value] : values) set(name, value);
  }

  std::span<double> operator[](const std::string& name) const { return variables().at(name).reals(); }
  double real(const std::string& name, std::size_t i = 0) const { return (*this)[name][i]; }
  std::vector<double> values(const std::string& name) const { return {(*this)[name].begin(), (*this)[name].end()}; }
  Eigen::VectorXd joints(const std::string& name) const {
    return Eigen::VectorXd::Map((*this)[name].data(), static_cast<Eigen::Index>((*this)[name].size()));
  }
  Eigen::Vector3d vector(const std::string& name) const { return Eigen::Vector3d::Map((*this)[name].data()); }
  std::int32_t integer(const std::string& name, std::size_t i = 0) const { return variables().at(name).integers()[i]; }
  bool boolean(const std::string& name) const { return variables().at(name).booleans()[0]; }
  std::string& text(const std::string& name) const { return variables().at(name).strings()[0]; }

  template <std::convertible_to<std::string> Text>
  UnitSubject& set(const std::string& name, const Text& value) {
    assign_text(variables().at(name), value);
    return *this;
  }
  UnitSubject& set(const std::string& name, const std::vector<double>& values) {
    EXPECT_EQ(values.size(), (*this)[name].size()) << name;
    std::ranges::copy(values, (*this)[name].begin());
    return *this;
  }
  template <std::same_as<int> Integer>
  UnitSubject& set(const std::string& name, Integer value) {
    variables().at(name).integers()[0] = value;
    return *this;
  }
  UnitSubject& fill(const std::string& name, double value) {
    std::ranges::fill((*this)[name], value);
    return *this;
  }

  void initialise() {
    variables().check_ranges();
    start();
  }
  /// The same without the checks that a master makes before.
  void start() {
    now_ = Time{};
    instance_.unit->initialise(now_);
  }
  /// What initialise() refuses; "no error" otherwise.
  std::string error_of_initialise() {
    try {
      initialise();
    } catch (const Error& e) {
      return e.what();
    }
    return "no error";
  }
  void step(Duration h = Duration{1'000'000}) {
    ASSERT_EQ(instance_.unit->step(now_, h), StepResult::kDone);
    now_ = now_ + h;
  }
  void step(double seconds) { step(Duration::from_seconds(seconds)); }
  /// Outputs at t, reached by one step of a millisecond, whatever was before.
  void at(double t) {
    now_ = Time::from_seconds(t) + Duration{-1'000'000};
    step();
  }

  double now() const { return now_.seconds(); }
  const Variables& variables() const { return instance_.variables; }
  Instance& instance() { return instance_; }
  Unit& unit() { return *instance_.unit; }

 protected:
  Instance instance_;
  Time now_;
};

}  // namespace cotwin::testing
