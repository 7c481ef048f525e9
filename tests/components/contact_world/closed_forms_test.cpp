// Scenes with closed forms (tests/support/closed_forms.h) at several steps and sizes, with each method.
#include "tests/support/closed_forms.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"

namespace cotwin::contact_world::closed_forms_test {
namespace {

using cotwin::testing::ClosedForm, cotwin::testing::Setting;

constexpr std::size_t kFewBodies = 25;                   // with more the other methods take too long for a test
constexpr long kMostSteps = 1000;                        // of figures that are the largest value so far
constexpr double kGapLimit = 0.01, kEnergyLimit = 0.25;  // m, 1: the defaults of the unit

struct Result {
  double value = 0;
  std::string fault;
};

Result watch(const ClosedForm& form, Method method, const Setting& setting) {
  const scene::Scene unscaled = form.make();
  const double time = std::sqrt(setting.scale), force = std::pow(setting.scale, 3);
  Options options;
  options.method = method;
  options.contacts = 1024;
  World world(cotwin::testing::scaled(unscaled, setting.scale), options);
  std::vector<Pose> start, X(unscaled.bodies.size());
  std::vector<Twist> V(unscaled.bodies.size());
  for (const scene::Body& body : unscaled.bodies) start.push_back(body.X_WB);
  Result result;
  const bool shortened = form.least == 0 && form.most > 0 && form.unit != "rad";
  long steps = std::lround(form.duration * time / setting.h);
  if (shortened) steps = std::min(steps, kMostSteps);
  for (long k = 1; k <= steps; ++k) {
    for (std::size_t b = 0; form.load != nullptr && b < X.size(); ++b) {
      if (unscaled.bodies[b].motion != scene::Motion::kDynamic) continue;
      world.apply(b, form.load(b) * force);  // the origins of loaded bodies are their centres of mass
    }
    world.step(setting.h);
    result.fault = world.fault(kGapLimit, kEnergyLimit);
    if (!result.fault.empty()) return result;
    for (std::size_t b = 0; b < X.size(); ++b) {
      X[b] = {world.poses()[b].R, world.poses()[b].p / setting.scale};
      V[b] << world.twists()[b].head<3>() / setting.scale * time, world.twists()[b].tail<3>() * time;
    }
    const double before = result.value;
    result.value = form.value(unscaled, {start, X, V, static_cast<double>(k) * setting.h / time}, result.value);
    if (form.least > 0 && result.value >= form.least) break;       // it has fallen
    if (form.most == 0 && before > 0 && result.value == 0) break;  // all dominoes lie
  }
  return result;
}

class ClosedForms : public ::testing::TestWithParam<std::size_t> {};

TEST_P(ClosedForms, HoldAtEveryStepAndSizeOrTheRunEndsWithAnError) {
  const ClosedForm form = cotwin::testing::closed_forms()[GetParam()];
  const bool few = form.make().bodies.size() <= kFewBodies;
  int right = 0;
  for (const Setting& setting : cotwin::testing::kSettings) {
    for (const Method method : {Method::kTree, Method::kPgs, Method::kDantzig}) {
      if (!few && method != Method::kTree) continue;
      const Result result = watch(form, method, setting);
      const bool is_right = result.fault.empty() && form.is_right(result.value, setting);
      right += is_right;
      EXPECT_TRUE(is_right || !result.fault.empty())
          << form.scene << ": " << form.figure << " " << result.value << " " << form.unit << " at " << setting.h << " s, size "
          << setting.scale << ", method " << static_cast<int>(method);
    }
  }
  // The rods of the rope swing under its load faster than 1 ms resolves: joints part, and the run ends.
  const int cells = few ? 15 : 5;
  EXPECT_EQ(right, form.scene.starts_with("rope") ? cells / 5 * 2 : cells) << form.scene;
}

INSTANTIATE_TEST_SUITE_P(All, ClosedForms, ::testing::Range<std::size_t>(0, cotwin::testing::closed_forms().size()));

}  // namespace
}  // namespace cotwin::contact_world::closed_forms_test
