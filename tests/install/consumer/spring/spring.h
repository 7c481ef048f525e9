#pragma once
#include <vector>

#include "components/unit/settings.h"
#include "components/unit/unit.h"

namespace cotwin::spring {

/// Masses on springs, m x" + k x = f, without damping. The force is held over a step, so each step is exact.
class Spring final : public Unit {
 public:
  static void declare_settings(SettingList& s);
  explicit Spring(Settings& settings);

  void declare(Variables& v) override;
  void initialise(Time start) override;
  StepResult step(Time now, Duration h) override;

 private:
  double m_ = 1, k_ = 1;           // kg, N/m
  std::vector<double> f_, x_, v_;  // n: N, m, m/s
  std::vector<double> position_;   // n: m
};

}  // namespace cotwin::spring
