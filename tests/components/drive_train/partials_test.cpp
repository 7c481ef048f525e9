// Compares the analytic Jacobian with differences of the unit's own steps. Steps of 1 ns and 2 ns from a state that is changed
// slightly in both directions are extrapolated to 0 ns and give the outputs of that state.
#include <gtest/gtest.h>

#include <map>

#include "tests/components/drive_train/harness.h"
#include "tests/support/allocations.h"

namespace cotwin::testing::partials_test {
namespace {

class DriveTrainPartials : public ::testing::TestWithParam<std::string> {
 protected:
  /// A moving robot with all elements that have a derivative.
  static Drive moving(const std::string& query) {
    Drive drive(query);
    drive.set("D", 1).set("link_sigma2", 3).set("link_tau_C", 1.5).set("link_A", 2).set("link_alpha", 5).set("link_s", 0.1);
    drive.initialise();
    for (int step = 0; step < 150; ++step) {
      for (const char* input : {"tau_m", "tau_e"}) {
        if (drive.variables().find(input) == nullptr) continue;
        for (std::size_t i = 0; i < drive[input].size(); ++i)
          drive[input][i] = (input == std::string("tau_m") ? 1 : 0.2) * excitation(step, i);
      }
      if (drive.variables().at("q").role == Role::kInput) {
        for (std::size_t i = 0; i < drive["q"].size(); ++i) {
          const double phase = 1e-3 * step + static_cast<double>(i);
          drive["q"][i] = 0.1 * std::sin(3 * phase);
          drive["dq"][i] = 0.3 * std::cos(3 * phase);
        }
      }
      drive.step(1e-3);
    }
    return drive;
  }

  /// The real outputs `ns` after `snapshot`, with element `j` of `known` changed by `by`.
  static std::map<std::string, std::vector<double>> outputs(Drive& drive, const Snapshot& snapshot, const std::string& known,
                                                            std::size_t j, double by, int ns) {
    snapshot.restore(drive.variables(), *drive.instance().unit);
    drive[known][j] += by;
    drive.instance().unit->restored();
    const Time now = Time::from_seconds(drive.now());
    if (drive.instance().unit->step(now, Duration{ns}) != StepResult::kDone) throw Error("drive", "discarded a step");
    std::map<std::string, std::vector<double>> all;
    for (const Variable& v : drive.variables()) {
      if (v.role == Role::kOutput && v.kind() == Kind::kReal && v.name != "error_estimate")
        all[v.name].assign(v.reals().begin(), v.reals().end());
    }
    return all;
  }
};

TEST_P(DriveTrainPartials, AreTheCompleteDerivativesOfTheOutputs) {
  Drive drive = moving(GetParam());
  Snapshot snapshot;
  snapshot.take(drive.variables());
  const std::span<const Partial> list = drive.instance().unit->partials();
  std::size_t size = 0;
  const auto size_of = [&](const Partial& p) {
    const std::size_t rows = drive.variables().at(p.unknown).size(), columns = drive.variables().at(p.known).size();
    return p.elementwise ? rows : rows * columns;
  };
  for (const Partial& p : list) size += size_of(p);
  std::vector<double> values(size);
  const std::uint64_t before = allocations();
  drive.instance().unit->evaluate_partials(values);
  EXPECT_EQ(allocations(), before);
  Snapshot after;
  after.take(drive.variables());
  EXPECT_EQ(after, snapshot);  // nothing changed

  int checked = 0;
  for (const char* known : {"tau_m", "tau_e", "q", "dq", "theta", "dtheta", "z"}) {
    if (drive.variables().find(known) == nullptr) continue;
    const bool rigid = GetParam().find("rigid") != std::string::npos;
    if (rigid && (known == std::string("theta") || known == std::string("dtheta")))
      continue;  // where the snapshot has q and dq
    const bool stick = GetParam().find("coulomb") != std::string::npos;
    for (std::size_t j = 0; j < drive[known].size(); ++j) {
      snapshot.restore(drive.variables(), *drive.instance().unit);
      if (stick && (drive.integer("slip", j) == 0 || known == std::string("z")) && known[0] != 't') continue;
      const bool bristle = known == std::string("z");
      const double delta = 1e-6 * std::max(std::abs(drive[known][j]), bristle ? 1e-5 : 1e-2);
      const auto up = outputs(drive, snapshot, known, j, delta, 1), down = outputs(drive, snapshot, known, j, -delta, 1);
      const auto up2 = outputs(drive, snapshot, known, j, delta, 2), down2 = outputs(drive, snapshot, known, j, -delta, 2);
      for (const auto& [unknown, high] : up) {
        const std::vector<double>&low = down.at(unknown), &high2 = up2.at(unknown), &low2 = down2.at(unknown);
        std::size_t at = 0;
        const Partial* block = nullptr;
        for (const Partial& p : list) {
          if (unknown == p.unknown && known == std::string(p.known)) {
            block = &p;
            break;
          }
          at += size_of(p);
        }
        double largest = 0;
        for (std::size_t k = 0; block != nullptr && k < size_of(*block); ++k)
          largest = std::max(largest, std::abs(values[at + k]));
        for (std::size_t i = 0; i < high.size(); ++i) {
          const double slope = (2 * (high[i] - low[i]) - (high2[i] - low2[i])) / (2 * delta);
          double expected = 0;
          if (block != nullptr && !block->elementwise) expected = values[at + i * drive[known].size() + j];
          if (block != nullptr && block->elementwise && i == j) expected = values[at + i];
          const double rounding = 1e-13 * std::max({std::abs(high[i]), std::abs(low[i]), 1.0}) / delta;
          // At steady slip of the bristle the second derivative of the elasto-plastic law jumps, so differences are of first
          // order there.
          EXPECT_NEAR(slope, expected, (bristle ? 5e-4 : 1e-6) * largest + rounding + (bristle ? 1e-3 : 1e-6))
              << "d " << unknown << "[" << i + 1 << "] / d " << known << "[" << j + 1 << "]";
          ++checked;
        }
      }
    }
  }
  EXPECT_GT(checked, 500);
}

// (2a) in numbers: the acceleration of a robot at rest due to one newton metre is a column of M⁻¹.
TEST(DriveTrainPartialsOfARotor, AreOneOverTheInertiaAndTheStiffness) {
  Drive drive("robot=" + kRotor);
  drive.set("K", 5000).set("D", 3).set("B", 0.5);
  drive.initialise();
  const std::span<const Partial> list = drive.instance().unit->partials();
  std::vector<double> values(list.size());  // one joint: one value per block
  drive.instance().unit->evaluate_partials(values);
  const auto value = [&](const std::string& unknown, const std::string& known) {
    for (std::size_t i = 0; i < list.size(); ++i) {
      if (unknown == list[i].unknown && known == list[i].known) return values[i];
    }
    return 0.0;
  };
  EXPECT_DOUBLE_EQ(value("ddq", "tau_e"), 1 / kRotorInertia);
  EXPECT_DOUBLE_EQ(value("ddq", "theta"), 5000 / kRotorInertia);
  EXPECT_DOUBLE_EQ(value("ddq", "q"), -5000 / kRotorInertia);
  EXPECT_DOUBLE_EQ(value("ddq", "dtheta"), 3 / kRotorInertia);
  EXPECT_DOUBLE_EQ(value("ddq", "dq"), -3 / kRotorInertia);
  EXPECT_DOUBLE_EQ(value("tau_J", "theta"), 5000);
  EXPECT_DOUBLE_EQ(value("tau_J", "q"), -5000);
  EXPECT_EQ(value("ddq", "tau_m"), 0);  // it turns the motor first
}

INSTANTIATE_TEST_SUITE_P(Variants, DriveTrainPartials,
                         ::testing::Values("robot=lwr4", "robot=lwr4&friction=elasto_plastic", "robot=lwr4&friction=coulomb",
                                           "robot=lwr4&transmission=rigid", "robot=lwr4&link_side=outside"),
                         [](const auto& query) {
                           std::string name = query.param;
                           for (char& c : name) {
                             if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
                           }
                           return name;
                         });

}  // namespace
}  // namespace cotwin::testing::partials_test
