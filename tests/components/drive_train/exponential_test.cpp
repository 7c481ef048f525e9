// The drive train's exponential method: its order, and the motion and torque of stiff, undamped gears against closed forms, CVODE
// and energy.
#include <gtest/gtest.h>

#include <fstream>
#include <functional>

#include "components/drive_train/exponential.h"
#include "models/robot/urdf/urdf.h"
#include "tests/components/drive_train/harness.h"

namespace cotwin::testing::exponential_test {
namespace {

TEST(DriveTrainExponential, IsOfOrderThree) {
  // The LWR 4 in gravity with viscous friction, smooth, over 16 ms, in equal sub-steps.
  const robot::RobotModel model = robot::load_urdf(std::filesystem::path(places::source()) / "models/robots/lwr4/robot.urdf");
  drive_train::Equations equations(&model, 7, drive_train::LinkSide::kInside, drive_train::Transmission::kFlexible,
                                   drive_train::Friction::kSmooth);
  drive_train::Parameters& p = equations.parameters();
  std::fill(p.K.begin(), p.K.end(), 1e5);
  std::fill(p.sigma2.begin(), p.sigma2.end(), 3.0);
  std::fill(p.tau_C.begin(), p.tau_C.end(), 2.0);
  std::fill(p.v_R.begin(), p.v_R.end(), 0.5);
  equations.adopt_parameters();
  const auto end = [&](int steps) {
    drive_train::Exponential method(equations);
    drive_train::Point p0(7), p1(7);
    std::vector<double> x(35), x1(35);
    for (std::size_t i = 0; i < 7; ++i) {
      x[i] = x[14 + i] = 0.2 + 0.1 * static_cast<double>(i);
      x[7 + i] = x[21 + i] = 1 - 0.2 * static_cast<double>(i);
      equations.course().tau_m[i] = 3;
      equations.course().dtau_e[i] = 200;
    }
    equations.evaluate(x.data(), p0);
    for (int k = 0; k < steps; ++k) {
      double length = 16e-3 / steps;
      method.linearise(p0);
      method.attempt(k * length, length, x.data(), {.angle = 1e-13, .speed = 1e-10}, p0, x1.data(), p1, false);
      std::swap(x, x1);
      std::swap(p0, p1);
    }
    return x;
  };
  const std::vector<double> reference = end(1024);
  std::vector<double> errors;
  for (const int steps : {16, 32, 64}) {
    const std::vector<double> x = end(steps);
    double most = 0;
    for (std::size_t i = 0; i < 28; ++i) most = std::max(most, std::abs(x[i] - reference[i]));
    errors.push_back(most);
  }
  EXPECT_GT(errors[0] / errors[1], 6.5);
  EXPECT_GT(errors[1] / errors[2], 6.5);
  EXPECT_LT(errors[2], 1e-6);
}

TEST(DriveTrainExponential, RingsInOneSubstepAsTheTwoMassOscillatorDoesWithAnyStiffness) {
  // Up to 500 rad of oscillation in a step of 1 ms, undamped and damped, for thousands of oscillations.
  const double B = 0.8, I = kRotorInertia;
  for (const double h : {0.1e-3, 1e-3, 4e-3}) {
    for (const double K : {1e4, 1e6, 1e8, 4e10}) {
      for (const double ratio : {0.0, 1e-5, 1e-2}) {
        const double m = 1 / (1 / B + 1 / I), D = 2 * ratio * std::sqrt(K * m), twist = 10 / K;
        Drive drive("robot=" + kRotor);
        drive.set("K", K).set("B", B).set("D", D).set("tau_e", -K * twist);
        drive.tolerances(0, 1e-9 * twist + 1e-14, 1e-9 * twist * std::sqrt(K / m) + 1e-14);
        drive.initialise();
        drive.set("tau_e", 0);
        const double delta = D / (2 * m), omega = std::sqrt(K / m - delta * delta);
        if (omega * h > 1e4) continue;  // beyond the work that a step may take
        for (int n = 1; n <= 100; ++n) {
          drive.step(h);
          ASSERT_EQ(drive.integer("substeps"), 1) << K << " " << D;
          const double t = drive.now();
          const double phi = twist * std::exp(-delta * t) * (std::cos(omega * t) + delta / omega * std::sin(omega * t));
          const double dphi = -twist * std::exp(-delta * t) * K / m / omega * std::sin(omega * t);
          // 10 N.m at first, to 1e-6 N.m and the rounding of the phase
          ASSERT_NEAR(drive["tau_J"][0], K * phi + D * dphi, 1e-6 + 1e-13 * omega * t * 10) << K << " " << D << " " << h;
        }
      }
    }
  }
}

// Gears, inputs and robots under which the solution must stay within a microradian of CVODE's, with torques to 1e-3 of the
// largest, without a forced sub-step.
struct Scene {
  std::string name, query;
  std::function<void(Drive&)> prepare;
  std::function<void(Drive&, int)> input;
  double h = 1e-3;
  int steps = 100;
  double share = 1e-3;  // of the largest torque
};

void jump(Drive& drive, int n) {
  for (std::size_t i = 0; i < drive["tau_m"].size(); ++i) drive["tau_m"][i] = excitation(n, i % 7);
}

void push(Drive& drive, int n) {
  jump(drive, n);
  for (std::size_t i = 0; i < drive["tau_e"].size(); ++i)
    drive["tau_e"][i] = n % 50 == 25 ? 5 : 0.1 * excitation(n / 20 * 20 + 100, i % 7);
}

void move_links(Drive& drive, int n) {
  jump(drive, n);
  for (std::size_t i = 0; i < drive["q"].size(); ++i) {
    drive["q"][i] = 0.1 * std::sin(0.02 * n + static_cast<double>(i));
    drive["dq"][i] = 2 * std::cos(0.02 * n + static_cast<double>(i));
  }
}

std::function<void(Drive&)> gears(double K, double D) {
  return [=](Drive& drive) { drive.set("K", K).set("D", D); };
}

// 33 joints: a trunk of five and four limbs of seven, of links that become lighter.
std::string tree() {
  const std::string file = ::testing::TempDir() + "drive_train_tree.urdf";
  std::ofstream out(file);
  out << "<robot name=\"tree\"><link name=\"base\"/>\n";
  for (int i = 0; i < 33; ++i) {
    const int parent = i == 0 ? -1 : i < 5 ? i - 1 : (i - 5) % 7 == 0 ? 4 : i - 1;
    const double mass = i < 5 ? 8 : 4.0 / (1 + (i - 5) % 7), size = 0.02 * mass;
    const char* axes[] = {"0 0 1", "0 1 0", "1 0 0"};
    out << "<joint name=\"j" << i << "\" type=\"revolute\"><parent link=\""
        << (parent < 0 ? "base" : "l" + std::to_string(parent)) << "\"/><child link=\"l" << i << "\"/><axis xyz=\""
        << axes[i % 3] << "\"/><origin xyz=\"0.05 " << 0.03 * ((i - 5) / 7) << " 0.15\"/>"
        << "<limit lower=\"-3\" upper=\"3\" effort=\"100\" velocity=\"5\"/></joint>\n<link name=\"l" << i
        << "\"><inertial><origin xyz=\"0.01 0 0.07\"/><mass value=\"" << mass << "\"/><inertia ixx=\"" << size << "\" iyy=\""
        << size << "\" izz=\"" << 0.5 * size << "\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>\n";
  }
  out << "</robot>\n";
  return file;
}

std::vector<Scene> scenes() {
  const auto light = [](Drive& d) { d.set("B", 1e-3).set("D", 0).set("tau_C", 0).set("tau_S", 0); };
  const auto unequal = [](Drive& d) {
    const double K[] = {1e7, 1e3, 1e5, 1e4, 1e6, 1e3, 1e7};
    std::copy_n(K, 7, d["K"].begin());
    d.set("D", 0);
  };
  const auto locked = [](Drive& d) {
    d.set("tau_C", 1e4).set("tau_S", 1.2e4).set("sigma0", 1e7).set("sigma1", 1e3).set("K", 1e6).set("D", 0);
  };
  const auto ramp = [](Drive& d) { d.set("K", 1e6).set("D", 0).set("input_order", 1); };
  const auto stops = [](Drive& d) {
    d.set("K", 1e5).set("D", 0).set("stop_stiffness", 1e5).set("q_min", -0.05).set("q_max", 0.04);
  };
  return {
      {"stiffness 1e5", "robot=lwr4", gears(1e5, 0), jump},
      {"stiffness 1e6", "robot=lwr4", gears(1e6, 0), jump},
      {"stiffness 1e7", "robot=lwr4", gears(1e7, 0), jump, 1e-3, 50, 2e-3},
      {"stiffness 1e6, little damping, pushed", "robot=lwr4", gears(1e6, 0.1), push},
      {"stiffness 1e6, ramps", "robot=lwr4", ramp, jump},
      {"stiffness 1e6, ticks of 0.1 ms", "robot=lwr4", gears(1e6, 0), push, 1e-4},
      {"stiffness 1e6, ticks of 4 ms", "robot=lwr4", gears(1e6, 0), jump, 4e-3, 25, 2e-3},
      {"unequal stiffness", "robot=lwr4", unequal, push, 1e-3, 50, 1e-2},
      {"light motors", "robot=lwr4", light, jump},
      {"locked by friction", "robot=lwr4", locked, push, 1e-3, 50},
      {"elasto-plastic friction", "robot=lwr4&friction=elasto_plastic", gears(1e6, 0), push, 1e-3, 60, 2e-3},
      {"smooth friction", "robot=lwr4&friction=smooth", gears(1e6, 0), push, 1e-3, 60, 2e-3},
      {"stick-slip", "robot=lwr4&friction=coulomb", gears(1e6, 0), push, 1e-3, 60, 5e-3},
      {"stops", "robot=lwr4", stops, push},
      {"one joint", "robot=" + kRotor, gears(1e7, 1), jump},
      {"KR 300", "robot=kr300_r2500", gears(1e6, 0), push},
      {"33 joints", "robot=" + tree(), gears(1e5, 0), jump, 1e-3, 30},
      {"links outside", "link_side=outside&joints=3", gears(1e7, 0), move_links},
      {"links outside on cubics", "link_side=outside&robot=lwr4", ramp, move_links},
  };
}

class DriveTrainStiffGears : public ::testing::TestWithParam<Scene> {};

TEST_P(DriveTrainStiffGears, MoveAsWithATightCvodeWithoutAForcedSubstep) {
  const Scene& scene = GetParam();
  Drive drive(scene.query), tight(scene.query + "&method=cvode");
  tight.tolerances(1e-11, 1e-13, 1e-11);
  for (Drive* d : {&drive, &tight}) {
    scene.prepare(*d);
    tight.tolerances(1e-11, 1e-13, 1e-11);
    scene.input(*d, 0);
    d->initialise();
  }
  double largest = 0, torque = 0, angle = 0;
  for (int n = 0; n < scene.steps; ++n) {
    for (Drive* d : {&drive, &tight}) {
      scene.input(*d, n);
      d->step(scene.h);
    }
    for (std::size_t i = 0; i < drive["theta"].size(); ++i) {
      largest = std::max(largest, std::abs(tight["tau_J"][i]));
      torque = std::max(torque, std::abs(drive["tau_J"][i] - tight["tau_J"][i]));
      angle = std::max({angle, std::abs(drive["theta"][i] - tight["theta"][i]), std::abs(drive["q"][i] - tight["q"][i])});
    }
  }
  EXPECT_EQ(drive.integer("forced_steps"), 0);
  EXPECT_EQ(drive.variables().at("warning").strings()[0], "");
  EXPECT_LT(angle, 1e-6);
  EXPECT_LT(torque, scene.share * largest) << "of " << largest << " N.m";
}

INSTANTIATE_TEST_SUITE_P(Scenes, DriveTrainStiffGears, ::testing::ValuesIn(scenes()), [](const auto& scene) {
  std::string name;
  for (const char c : scene.param.name) name += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
  return name;
});

TEST(DriveTrainExponential, KeepsTheEnergyOfStiffUndampedGearsInFreeFall) {
  // The KR 300 falls with free motors, which are light against its links: they swing by milliradians at 150 to 1500 Hz.
  for (const double K : {1e6, 1e8}) {
    Drive drive("robot=kr300_r2500");
    drive.set("K", K).set("D", 0);
    drive.initialise();
    const double start = drive.energy();
    double most = 0;
    for (int n = 0; n < 200; ++n) {
      drive.step(1e-3);
      most = std::max(most, drive["energy_kinetic"][0]);
      ASSERT_NEAR(drive.energy(), start, 1e-4) << n << " " << K;
    }
    EXPECT_GT(most, 100);
    EXPECT_EQ(drive["energy_dissipated"][0], 0);
    EXPECT_EQ(drive.integer("forced_steps"), 0);
  }
}

TEST(DriveTrainExponential, BalancesTheWorkOfALinkOutsideThatShakesAStiffGear) {
  for (const double K : {1e4, 1e6, 1e7}) {
    Drive drive("link_side=outside&joints=3");
    drive.set("K", K).set("D", 0).set("input_order", 1);
    move_links(drive, 0);
    drive.initialise();
    const double start = drive.energy();
    double most = 0;
    for (int n = 0; n < 200; ++n) {
      move_links(drive, n);
      drive.step(1e-3);
      most = std::max(most, drive.energy());
      ASSERT_NEAR(drive.unbalanced(start), 0, 1e-4 * std::max(most, 1.0)) << n << " " << K;
    }
  }
}

TEST(DriveTrainExponential, AtTheCapCountsTheStepsAndWarnsOfThem) {
  Drive drive("robot=lwr4");
  drive.set("K", 1e6).set("D", 0).set("backlash", 1e-4).set("max_substeps", 8);
  drive.initialise();
  int steps = 0;
  double worst = 0;
  for (int n = 0; n < 100; ++n) {
    push(drive, n);
    drive.step(1e-3);
    steps += drive.integer("forced_substeps") > 0;
    worst = std::max(worst, drive["error_estimate"][0]);
  }
  EXPECT_GT(steps, 0);
  EXPECT_EQ(drive.integer("forced_steps"), steps);
  EXPECT_EQ(drive["worst_error"][0], worst);
  EXPECT_EQ(drive.variables().at("warning").strings()[0].rfind(std::to_string(steps) + " steps ended at max_substeps", 0), 0u);
  drive.initialise();
  EXPECT_EQ(drive.integer("forced_steps"), 0);
  EXPECT_EQ(drive.variables().at("warning").strings()[0], "");
}

TEST(DriveTrainExponential, LeavesBristlesThatAreTooFastToTheRosenbrockMethod) {
  // Bristles of 8e7 N.m/rad relax within microseconds: a Taylor series would need thousands of terms.
  Drive drive("robot=lwr4"), rosenbrock("robot=lwr4&method=rosenbrock");
  for (Drive* d : {&drive, &rosenbrock}) {
    for (double& s : (*d)["sigma0"]) s *= 1e4;
    for (double& s : (*d)["sigma1"]) s *= 1e2;
    d->initialise();
    for (int n = 0; n < 300; ++n) {
      jump(*d, n);
      d->step(1e-3);
    }
  }
  for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(drive["theta"][i], rosenbrock["theta"][i], 2e-6);
  EXPECT_EQ(drive.integer("forced_steps"), 0);
}

}  // namespace
}  // namespace cotwin::testing::exponential_test
