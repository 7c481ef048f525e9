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
#include "tests/support/unit_subject.h"

namespace cotwin::testing {

constexpr Duration kTick{1'000'000};
using Values = std::vector<std::pair<std::string, std::string>>;

class MotionSubject : public UnitSubject {
 public:
  explicit MotionSubject(const std::string& query, const Values& values = {}) : UnitSubject("unit:motion?" + query, values) {}
  Eigen::Quaterniond orientation() const {
    const Eigen::VectorXd Q = joints("quat_d");
    return {Q[0], Q[1], Q[2], Q[3]};
  }
  bool has(const std::string& name) const { return variables().find(name) != nullptr; }
};

}  // namespace cotwin::testing
