#pragma once
#include <gtest/gtest.h>

#include <string>
#include <utility>

#include "components/contact_world/engine/world.h"
#include "tests/support/contact_scenes.h"

/// Tests that run with every method of the contact world.
namespace cotwin::testing {

class EachMethod : public ::testing::TestWithParam<contact_world::Method> {
 protected:
  static contact_world::World world(scene::Scene scene, int iterations = contact_world::Options().iterations) {
    contact_world::Options options;
    options.method = GetParam();
    options.iterations = iterations;
    options.contacts = 4096;
    return {std::move(scene), options};
  }
  static double energy(const contact_world::World& w) { return testing::energy(w.scene(), w.poses(), w.twists()); }
  static Wrench momentum(const contact_world::World& w) { return testing::momentum(w.scene(), w.poses(), w.twists()); }
};

inline const auto kMethods =
    ::testing::Values(contact_world::Method::kTree, contact_world::Method::kPgs, contact_world::Method::kDantzig);

inline std::string name_of_method(const ::testing::TestParamInfo<contact_world::Method>& info) {
  using contact_world::Method;
  return info.param == Method::kTree ? "tree" : info.param == Method::kPgs ? "pgs" : "dantzig";
}

}  // namespace cotwin::testing
