// unit:energy: its books against those of the drive train, closed forms of the DC link, rules of servo and brakes.
#include "components/energy/energy.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "models/energetics/motion_energy.h"
#include "models/energetics/waiting.h"
#include "models/robot/urdf/urdf.h"
#include "models/trajectory/waypoints.h"
#include "tests/components/drive_train/harness.h"
#include "tests/support/error_of.h"

namespace cotwin::energy::energy_test {
namespace {

using cotwin::testing::Drive;
using cotwin::testing::error_of;
using cotwin::testing::excitation;
using ::testing::HasSubstr;

class Meter {
 public:
  explicit Meter(const std::string& query)
      : instance_(make_unit("unit:energy?" + query, {}, {places::source() + "/models"}, unit_types())) {}
  std::span<double> operator[](const std::string& name) { return instance_.variables.at(name).reals(); }
  double real(const std::string& name) { return (*this)[name][0]; }
  double total(const std::string& name) {
    const auto values = (*this)[name];
    return std::accumulate(values.begin(), values.end(), 0.0);
  }
  int integer(const std::string& name) { return instance_.variables.at(name).integers()[0]; }
  std::string& text(const std::string& name) { return instance_.variables.at(name).strings()[0]; }
  Meter& set(const std::string& name, double value) {
    const Variable& v = instance_.variables.at(name);
    if (v.kind() == Kind::kReal) {
      std::ranges::fill(v.reals(), value);
    } else {
      v.integers()[0] = static_cast<std::int32_t>(value);
    }
    return *this;
  }
  void initialise() { instance_.unit->initialise(Time{}); }
  void step(double h) { ASSERT_EQ(instance_.unit->step(Time{}, Duration::from_seconds(h)), StepResult::kDone); }
  /// As the connections of a scenario do.
  void read(Drive& drive) {
    for (const char* name : {"tau_m", "theta", "dtheta"}) std::ranges::copy(drive[name], (*this)[name].begin());
    if (instance_.variables.find("work_m") == nullptr) return;
    for (const char* name :
         {"work_m", "work_e", "work_0", "energy_kinetic", "energy_potential", "energy_elastic", "energy_dissipated"})
      (*this)[name][0] = drive[name][0];
    if (drive.variables().find("energy_bodies") != nullptr) (*this)["energy_bodies"][0] = drive["energy_bodies"][0];
  }
  std::vector<std::string> told() {
    std::vector<std::string> sentences;
    instance_.unit->append_notes(sentences);
    return sentences;
  }

 private:
  Instance instance_;
};

/// Drives the LWR 4+ with torques that jump (order 0) or ramp (1) for `steps` of 1 ms.
void run(Drive& drive, Meter& meter, int steps, int order) {
  drive.set("input_order", order);
  meter.set("input_order", order);
  const auto excite = [&](int k) {
    for (std::size_t j = 0; j < 7; ++j) drive["tau_m"][j] = excitation(k, j);
  };
  excite(0);
  drive.initialise();
  meter.read(drive);
  meter.initialise();
  for (int k = 1; k <= steps; ++k) {
    excite(k);
    drive.step(1e-3);
    meter.read(drive);
    meter.step(1e-3);
  }
}

TEST(EnergyUnit, WorkOfTheJointsIsThatOfTheDriveTrain) {
  for (const std::string friction : {"lugre", "elasto_plastic", "coulomb", "smooth"}) {
    for (const int order : {0, 1}) {
      Drive drive("robot=lwr4&friction=" + friction);
      Meter meter("robot=lwr4");
      run(drive, meter, 1500, order);
      const double work = meter.total("work_positive") + meter.total("work_negative");
      EXPECT_GT(meter.total("work_positive"), 5) << friction;
      EXPECT_LT(meter.total("work_negative"), -0.1) << friction;
      // Held torques: exact. Ramps: of fourth order in the drive train's sub-steps, here in the step.
      EXPECT_NEAR(work, drive["work_m"][0], (order == 0 ? 1e-12 : 1e-7) * meter.total("work_positive")) << friction << order;
    }
  }
}

TEST(EnergyUnit, BooksCloseWithThoseOfTheDriveTrain) {
  for (const std::string query : {"bus=shared", "bus=none", "bus=grid"}) {
    for (const int order : {0, 1}) {
      Drive drive("robot=lwr4&friction=smooth&method=rosenbrock");
      drive.tolerances(1e-11, 1e-13, 1e-11).set("max_substeps", 4096);
      Meter meter("robot=lwr4&books=true&" + query);
      meter.set("V_0", 0.7).set("k_h", 0.4).set("k_e", 0.2).set("eta_r", 0.8);
      run(drive, meter, 150, order);
      const double drawn = meter.real("drawn");
      EXPECT_GT(drawn, 10);
      // Drawn = rises of energy and losses: two units, two quadratures of the work.
      const double entries = meter.total("copper") + meter.total("converter") + meter.total("iron") + meter.real("idle") +
                             meter.real("chopped") + meter.real("stored") + meter.real("supply_losses") +
                             meter.real("controller_energy") + drive["work_m"][0];
      EXPECT_NEAR(entries, drawn, 1e-11 * drawn) << query;
      EXPECT_NEAR(meter.real("residual"), 0, 1e-9 * drawn) << query << order;
      EXPECT_NEAR(meter.real("friction"), drive["energy_dissipated"][0] + drive["work_0"][0], 1e-12 * drawn);
      EXPECT_THAT(meter.text("warning"), ::testing::Not(HasSubstr("work_m")));
    }
  }
}

TEST(EnergyUnit, ResidualIsTheErrorOfTheDriveTrainsSolver) {
  Drive drive("robot=lwr4");
  Meter meter("robot=lwr4&books=true");
  run(drive, meter, 1000, 0);
  drive.set("tau_m", 0);
  EXPECT_NE(meter.real("residual"), 0);
  EXPECT_LT(std::abs(meter.real("residual")), 1e-3 * meter.real("drawn"));
}

TEST(EnergyUnit, TellsInputsOfAnotherStep) {
  Drive drive("robot=lwr4");
  Meter meter("robot=lwr4&books=true");
  drive.initialise();
  meter.read(drive);
  meter.initialise();
  for (int k = 1; k < 2000; ++k) {
    for (std::size_t j = 0; j < 7; ++j) drive["tau_m"][j] = 3 * excitation(k, j);
    drive.step(1e-3);
    meter.read(drive);
    for (double& tau : meter["tau_m"]) tau *= -1;  // wired with the wrong sign
    meter.step(1e-3);
  }
  EXPECT_THAT(meter.text("warning"), HasSubstr("work_m differs"));
}

TEST(EnergyUnit, MeasuresWhatThePlannedMotionOfTheRigidRobotPredicts) {
  // The main example's motion: its run with elastic joints and LuGre friction does 353.6 J of work (examples/02_free_motion_lwr4).
  const auto robot = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
  Drive drive("robot=lwr4");
  robot::DriveParameters drives(7);
  for (const auto& [name, values] : {std::pair{"B", &drives.B}, {"tau_C", &drives.tau_C}, {"sigma2", &drives.sigma2}})
    values->assign(drive[name].begin(), drive[name].end());
  const std::vector<double> q = {0,    0.3,  0,   -1.2, 0,    0.9,  0,    0.9,  0.8,  0.5, -0.6, 0.7,  0.2,
                                 1.2,  -0.6, 1.2, -0.4, -1.5, -0.8, 1.1,  -0.9, -1.4, 0.5, 0.9,  -1.9, 1.1,
                                 -0.5, 1.6,  0.4, -0.4, 0.6,  -1,   -0.3, 1.2,  -1.3, 1.3, 0.6,  -0.8, -0.4,
                                 0.9,  -0.8, 0.5, 0,    0.3,  0,    -1.2, 0,    0.9,  0};
  const trajectory::Path path = trajectory::make_path({7, {0.5, 3.5, 6.5, 9.5, 13, 16, 18.5}, q, {0, 0, 0, 1, 0, 0, 0}, {}},
                                                      trajectory::Passing::kThrough);
  energetics::Accountant accountant(7, energetics::Bus::kShared);
  const energetics::MotionEnergy e = energetics::energy_of_motion(energetics::RigidRobot(robot, drives), path, accountant, {});
  EXPECT_NEAR(e.books.mechanical(), 353.6, 0.002 * 353.6);
}

/// One joint that is moved by hand: unit:energy with its inputs.
struct Joint {
  explicit Joint(const std::string& query, double R = 0) : meter("joints=1&" + query) {
    meter.text("current") = "dc";
    meter.set("R", R).set("k_t", 1);
  }
  /// Constant torque and speed for t seconds, in steps of 10 ms.
  void hold(double tau, double speed, double t) {
    meter.set("tau_m", tau).set("dtheta", speed);
    for (int k = 0; k < std::lround(t / 0.01); ++k) {
      theta += 0.01 * speed;
      meter.set("theta", theta);
      meter.step(0.01);
    }
  }
  Meter meter;
  double theta = 0;
};

TEST(EnergyUnit, ChargesTheCapacitorAndChopsAboveItsVoltage) {
  Joint joint("bus=shared");
  joint.meter.set("C", 0.01).set("V_min", 48).set("V_max", 60).set("dtheta", 2);
  joint.meter.initialise();
  joint.hold(-2, 2, 1);  // 4 W returned for 1 s
  EXPECT_NEAR(joint.meter.real("V"), std::sqrt(48 * 48 + 2 * 4 / 0.01), 1e-9);
  EXPECT_NEAR(joint.meter.real("stored"), 4, 1e-12);
  joint.hold(-2, 2, 1);
  EXPECT_NEAR(joint.meter.real("V"), 60, 1e-12);
  EXPECT_NEAR(joint.meter.real("chopped"), 8 - 6.48, 1e-12);
  EXPECT_NEAR(joint.meter.real("regenerable"), 8, 1e-12);
  EXPECT_EQ(joint.meter.real("drawn"), 0);
  joint.hold(2, 2, 2);  // 8 J, of which the capacitor gives 6.48 J
  EXPECT_NEAR(joint.meter.real("drawn"), 8 - 6.48, 1e-12);
  EXPECT_NEAR(joint.meter.real("V"), 48, 1e-12);
}

TEST(EnergyUnit, ChargesMainsCostAndCarbonDioxide) {
  Joint joint("bus=grid");
  joint.meter.set("P_0", 20).set("controller", 30).set("efficiency", 0.8).set("eta_r", 0.5);
  joint.meter.set("price_per_kWh", 0.3).set("co2_per_kWh", 0.4).set("dtheta", 1);
  joint.meter.initialise();
  joint.hold(100, 1, 10);
  EXPECT_NEAR(joint.meter.real("drawn"), 10 * (120 / 0.8 + 30), 1e-9);
  EXPECT_NEAR(joint.meter.real("power"), 180, 1e-9);
  EXPECT_NEAR(joint.meter.real("cost"), 1800 / 3.6e6 * 0.3, 1e-15);
  EXPECT_NEAR(joint.meter.real("co2"), 1800 / 3.6e6 * 0.4, 1e-15);
  joint.meter.set("price_per_kWh", 0.6);  // a tariff that changes during the run
  joint.meter.set("dtheta", 1);
  joint.hold(-100, 1, 10);
  EXPECT_NEAR(joint.meter.real("returned"), 800, 0.3);  // the first step still has the ramp of the speed
  EXPECT_NEAR(joint.meter.real("drawn"), 1800 - 0.5 * 800 + 300, 0.5);
  EXPECT_NEAR(joint.meter.real("cost"), (1800 * 0.3 - 100 * 0.6) / 3.6e6, 1e-7);
  EXPECT_EQ(joint.meter.real("chopped"), 0);
}

TEST(EnergyUnit, ClosesTheBrakesAtRestAndOpensThemForTheNextMotion) {
  Joint joint("bus=shared", 0.5);
  joint.meter.set("P_0", 30)
      .set("P_off", 10)
      .set("P_brake", 5)
      .set("E_release", 4)
      .set("t_close", 0.2)
      .set("servo_off_after", 0.8);
  joint.meter.initialise();
  joint.hold(2, 0, 1);  // holds 2 N·m: 2 W of copper until the brakes are closed
  EXPECT_EQ(joint.meter.integer("servo"), 1);
  EXPECT_NEAR(joint.meter.total("copper"), 2, 1e-12);
  joint.hold(2, 0, 3);
  EXPECT_EQ(joint.meter.integer("servo"), 0);
  EXPECT_NEAR(joint.meter.total("copper"), 2, 0.021);
  EXPECT_NEAR(joint.meter.real("idle"), 35 + 3 * 10, 0.3);
  const double before = joint.meter.real("idle");
  joint.hold(0, 1, 0.01);
  EXPECT_EQ(joint.meter.integer("servo"), 1);
  EXPECT_NEAR(joint.meter.real("idle") - before, 35 * 0.01 + 4, 1e-12);
}

TEST(EnergyUnit, HoldsWhileTheBrakesOpenAsTheServicesSay) {
  Joint joint("bus=shared", 0.5);
  const energetics::Standby s{.P_0 = 30, .P_off = 10, .P_brake = 5, .E_release = 4, .t_close = 0.2, .t_release = 0.3};
  joint.meter.set("P_0", s.P_0).set("P_off", s.P_off).set("P_brake", s.P_brake).set("E_release", s.E_release);
  joint.meter.set("t_close", s.t_close).set("t_release", s.t_release).set("servo_off_after", 1e-9);
  joint.meter.initialise();
  const auto taken = [&] { return joint.meter.real("idle") + joint.meter.total("copper"); };
  constexpr double kWait = 4, kStep = 0.01, kMoving = 0.5;
  joint.hold(2, 0, kWait);  // 2 N·m, 2 W of copper
  ASSERT_EQ(joint.meter.integer("servo"), 0);
  joint.hold(2, 1, kMoving);
  const double waited = taken() - kMoving * (s.P_0 + s.P_brake + 2);
  EXPECT_NEAR(waited, energetics::wait(s, 2, kWait).closed, kStep * (s.P_0 + s.P_brake + 2));
  // Of a rest that ended sooner no more than that rest.
  const double before = taken();
  joint.hold(2, 0, 0.3);
  ASSERT_EQ(joint.meter.integer("servo"), 0);
  joint.hold(2, 1, kMoving);
  EXPECT_NEAR(taken() - before - s.E_release, (0.3 + kMoving) * (s.P_0 + s.P_brake + 2), kStep * (s.P_0 + s.P_brake + 2));
}

TEST(EnergyUnit, TakesMeasuredCurrents) {
  Joint joint("measured=true", 2);
  joint.meter.set("i", 3).set("k_t", 10);
  joint.meter.initialise();
  joint.hold(50, 0, 1);  // by τ/k_t it would be 5 A
  EXPECT_NEAR(joint.meter.total("copper"), 2 * 9, 1e-12);
}

TEST(EnergyUnit, ReadsTheValuesBesideTheRobotAndTellsWhatIsAssumed) {
  Meter meter("robot=lwr4");
  EXPECT_EQ(meter["k_t"][0], 14.9);
  EXPECT_EQ(meter["R"][6], 1.4);
  EXPECT_EQ(meter.text("current"), "dc");
  meter.initialise();
  EXPECT_THAT(meter.text("warning"), HasSubstr("assumed drive: all its parameters"));
  EXPECT_EQ(meter.told().size(), 1u);
  meter.text("assumed") = "R C";
  meter.initialise();
  EXPECT_THAT(meter.text("warning"), HasSubstr("assumed values of R C"));
  meter.text("assumed") = "none";
  meter.initialise();
  EXPECT_EQ(meter.text("warning"), "");
  meter.text("assumed") = "R resistance";
  EXPECT_THAT(error_of([&] { meter.initialise(); }), HasSubstr("energy.assumed: 'resistance'"));
  Meter large("robot=kr300_r2500");
  EXPECT_EQ(large["k_t"][5], 123);
  large.initialise();
}

TEST(EnergyUnit, RefusesValuesThatAreNotFiniteOrOutOfRange) {
  const auto refused = [](const std::string& name, double value) {
    Meter meter("robot=lwr4");
    meter.set(name, value);
    return error_of([&] { meter.initialise(); });
  };
  for (const char* name : {"tau_m", "theta", "P_0", "controller", "price_per_kWh", "R"})
    EXPECT_THAT(refused(name, std::nan("")), HasSubstr(name));
  Meter wrong("robot=lwr4");
  wrong.text("current") = "RMS";
  EXPECT_THAT(error_of([&] { wrong.initialise(); }), HasSubstr("energy.current: 'RMS', expected one of dc, peak, rms"));
  EXPECT_THAT(refused("k_t", 0), HasSubstr("k_t[1]: is 0"));
  EXPECT_THAT(refused("V_max", 10), HasSubstr("V_max"));
  EXPECT_THAT(refused("efficiency", 1.2), HasSubstr("efficiency"));
  Meter meter("robot=lwr4");
  meter.initialise();
  meter.set("P_0", -1);
  EXPECT_THAT(error_of([&] { meter.step(1e-3); }), HasSubstr("P_0: is -1"));
}

}  // namespace
}  // namespace cotwin::energy::energy_test
