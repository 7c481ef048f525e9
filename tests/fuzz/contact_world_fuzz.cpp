// A scene drawn from the input's bytes, stepped by each method with disturbances: no NaN, no crash, no endless loop.

#include <cmath>
#include <cstdlib>
#include <span>

#include "components/contact_world/engine/world.h"
#include "tests/support/random_scene.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin;
  using contact_world::Method;
  for (const Method method : {Method::kTree, Method::kPgs, Method::kDantzig}) {
    testing::RandomScene random(std::span(data, size));
    contact_world::Options options;
    options.method = method;
    contact_world::World world(random.scene(), options);
    for (int k = 0; k < 5; ++k) {
      random.disturb(world);
      world.step(1e-3);
      for (const Pose& X_WB : world.poses()) {
        if (!X_WB.p.allFinite() || !X_WB.R.allFinite()) std::abort();
      }
      for (const Twist& V_WB : world.twists()) {
        if (!V_WB.allFinite()) std::abort();
      }
    }
  }
  return 0;
}
