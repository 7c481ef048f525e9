// A drive train and the contact world that moves its links, coupled as one solved loop: in process and as FMUs.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "components/unit/unit_table.h"
#include "fmu/export/pack.h"
#include "fmu/import/load.h"
#include "master/twin/pack_twin.h"
#include "master/twin/package.h"
#include "tests/fmu/foreign.h"
#include "tests/master/test_units.h"
#include "tests/support/places.h"

namespace cotwin::master::contact_loop_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::value;

const std::string kData = places::source() + "/tests/components/data/";

/// An arm of two links falls on a floor and stays there; its gears carry 21 and 2 N.m. Without K and D in the world explicit steps diverge above 7 us.
Build fall(CouplingChoice coupling, Duration tick = Duration{1'000'000}) {
  Build b;
  const std::string robot = "robot=" + kData + "pusher.urdf&link_side=outside", q0 = "-0.4 -0.6";
  b.unit("world", "contact_world?" + robot + "&scene=" + kData + "floor.sdf", 0).with("q0", q0);
  b.unit("robot", "drive_train?" + robot, 1).with("q0", q0).with("tau_m", "21 2");
  b.with("K", 1e4).with("D", 20.0).with("B", 0.5).with("sigma2", 20.0).with("link_order", std::int64_t{1});
  b.connect("world.q", "robot.q").connect("world.dq", "robot.dq").connect("robot.tau_J", "world.tau_J").until(1);
  b.scenario.tick = tick;
  b.scenario.coupling = coupling;
  return b;
}

class ContactLoop : public ::testing::Test {
 protected:
  static Master load(const Scenario& scenario) {
    MasterOptions options;
    options.types = unit_types();
    return Master(scenario, std::move(options));
  }
  /// Replaces both units of a scenario by FMUs of them.
  Build as_fmus(Build b, fmu::Version version, const std::string& query) const {
    for (ComponentSpec& spec : b.scenario.components) {
      const std::filesystem::path file = folder_.path() / (spec.name + std::to_string(static_cast<int>(version)) + ".fmu");
      fmu::PackRequest request;
      request.source = spec.source;
      request.types = unit_types();
      request.version = version;
      if (!exists(file)) fmu::pack_unit(request, file);
      spec.source = file.string() + query;
    }
    return b;
  }
  /// Compares the outputs of two runs after each of `ticks` ticks, and how the loop was stepped.
  static void expect_same(const Scenario& units, const Scenario& fmus, int ticks) {
    Master a = load(units), b = load(fmus);
    a.initialise();
    b.initialise();
    for (int n = 0; n < ticks; ++n) {
      ASSERT_TRUE(a.step_tick());
      ASSERT_TRUE(b.step_tick());
      for (std::size_t m = 0; m < 2; ++m) {
        for (const Variable& v : a.members()[m].variables()) {
          if (v.role != Role::kOutput || v.kind() != Kind::kReal) continue;
          const std::span<const double> of_fmu = b.members()[m].variables().at(v.name).reals();
          for (std::size_t i = 0; i < v.size(); ++i) ASSERT_EQ(v.reals()[i], of_fmu[i]) << v.name << " in tick " << n;
        }
      }
    }
    EXPECT_GT(value(a, "world.force"), 1);  // the arm lies on the floor
    const LoopReport one = a.summary().loops.at(0), other = b.summary().loops.at(0);
    EXPECT_EQ(one.solved, other.solved);
    EXPECT_EQ(one.counts.evaluations, other.counts.evaluations);
    EXPECT_TRUE(one.solved);
  }

  fmu::TemporaryFolder folder_;
};

TEST_F(ContactLoop, HasTheBitsOfTheUnitsAsFmus) {
  for (const CouplingChoice coupling : {CouplingChoice::kImplicit, CouplingChoice::kAuto}) {
    for (const fmu::Version version : {fmu::Version::k2, fmu::Version::k3}) {
      SCOPED_TRACE("FMI " + std::to_string(static_cast<int>(version)) + ", coupling " +
                   std::to_string(static_cast<int>(coupling)));
      const Build units = fall(coupling);
      expect_same(units.scenario, as_fmus(units, version, "").scenario, 320);
    }
  }
  const Build units = fall(CouplingChoice::kImplicit, Duration{10'000'000});
  expect_same(units.scenario, as_fmus(units, fmu::Version::k3, "?process=own").scenario, 32);
}

// The units of a package go back as cheaply as those of the scenario, so auto decides alike.
TEST_F(ContactLoop, HasTheBitsOfTheScenarioInItsPackage) {
  const Build b = fall(CouplingChoice::kAuto);
  PackageOptions options;
  options.types = unit_types();
  for (const fmu::Version version : {fmu::Version::k2, fmu::Version::k3}) {
    SCOPED_TRACE("FMI " + std::to_string(static_cast<int>(version)));
    options.version = version;
    pack_scenario(b.scenario, options, folder_.path() / "fall.ssp");
    expect_same(b.scenario, load_scenario(folder_.path() / "fall.ssp"), 320);
  }
}

TEST_F(ContactLoop, IsSteppedExplicitlyWhereTheSourceSaysThatItsFmuDoesNotGoBack) {
  for (const char* process : {"", "&process=own"}) {
    Master master =
        load(as_fmus(fall(CouplingChoice::kAuto), fmu::Version::k3, std::string("?rollback=false") + process).scenario);
    master.initialise();
    EXPECT_FALSE(master.summary().loops.at(0).solved);
    EXPECT_TRUE(master.summary().loops.at(0).unmeasurable);
  }
}

// At rest M q̈ = 0: τ_m + Jᵀ f = g(q), two equations for the force (f_x, 0, f_z) at the point of the tip's ball that touches the floor.
TEST_F(ContactLoop, RestsWhereTheForceOfTheFloorCarriesTheArm) {
  for (const int ms : {1, 4, 10}) {
    SCOPED_TRACE(ms);
    Master master = load(as_fmus(fall(CouplingChoice::kImplicit, Duration{ms * 1'000'000}), fmu::Version::k3, "").scenario);
    master.initialise();
    while (master.step_tick()) {
    }
    const double q1 = value(master, "world.q[1]"), q12 = q1 + value(master, "world.q[2]");
    const double x_elbow = 0.4 * std::cos(q1), z_elbow = 0.5 + 0.4 * std::sin(q1);
    const double x = x_elbow + 0.35 * std::cos(q12), z = z_elbow + 0.35 * std::sin(q12) - 0.02;
    EXPECT_NEAR(z, 0, 1e-6);
    EXPECT_NEAR(value(master, "world.dq[1]"), 0, 1e-6);
    const double g2 = 9.81 * 4 * 0.175 * std::cos(q12), g1 = 9.81 * (6 * 0.2 + 4 * 0.4) * std::cos(q1) + g2;
    const double r1 = g1 - 21, r2 = g2 - 2, a = 0.5 - z, b = x, c = z_elbow - z, d = x - x_elbow, det = a * d - b * c;
    EXPECT_NEAR(value(master, "world.f_c[1]"), (r1 * d - r2 * b) / det, 1e-3);
    EXPECT_NEAR(value(master, "world.f_c[3]"), (r2 * a - r1 * c) / det, 1e-3);
  }
}

}  // namespace
}  // namespace cotwin::master::contact_loop_test
