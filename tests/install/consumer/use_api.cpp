// Uses the public API of an installed Cotwin and checks the figures: use_api SCENARIO_OF_EXAMPLE_01 SPRINGS.ssd UNITS FOLDER [FMU.ssd]
#include <cotwin/cotwin.h>

#include <cmath>
#include <fstream>
#include <iostream>

namespace {

int failures = 0;

void expect(bool holds, const std::string& what) {
  if (holds) return;
  ++failures;
  std::cerr << "use_api: failed: " << what << '\n';
}

void expect_near(double value, double expected, double tolerance, const std::string& what) {
  expect(std::abs(value - expected) <= tolerance,
         what + " is " + std::to_string(value) + ", expected " + std::to_string(expected));
}

/// Whether `call` throws cotwin::Error with `part` in its message.
template <class Call>
void expect_error(Call call, const std::string& part) {
  try {
    call();
    expect(false, "no error, expected one with '" + part + "'");
  } catch (const cotwin::Error& error) {
    expect(std::string(error.what()).find(part) != std::string::npos, std::string(error.what()) + ", expected '" + part + "'");
  }
}

// planar2 is a double pendulum of cylinders: M, g, J in closed form. Figures from models/robots/planar2/robot.urdf.
void check_robot() {
  cotwin::Robot arm("planar2");
  expect(arm.n() == 2 && arm.joints()[1].name == "elbow" && arm.joints()[0].tau_max == 150, "joints of planar2");
  constexpr double kTolerance = 1e-12;
  const double q1 = 0.3, q2 = -0.7, m1 = 6, m2 = 4, l1 = 0.4, l2 = 0.35, I1 = 0.08375, I2 = 0.0424333333, g = 9.81;
  const std::vector<double> q = {q1, q2}, dq = {0.4, 1.1}, ddq = {2, -3};

  const cotwin::Matrix M = arm.mass_matrix(q);
  const double coupling = m2 * l1 * (l2 / 2) * std::cos(q2);
  expect_near(M(0, 0), I1 + I2 + m1 * l1 * l1 / 4 + m2 * (l1 * l1 + l2 * l2 / 4) + 2 * coupling, kTolerance, "M11");
  expect_near(M(0, 1), I2 + m2 * l2 * l2 / 4 + coupling, kTolerance, "M12");
  expect_near(M(1, 0), M(0, 1), 0, "M21");
  expect_near(M(1, 1), I2 + m2 * l2 * l2 / 4, kTolerance, "M22");

  const std::vector<double> gravity = arm.gravity(q);
  expect_near(gravity[1], m2 * g * l2 / 2 * std::cos(q1 + q2), 1e-11, "g2");
  expect_near(gravity[0], (m1 * l1 / 2 + m2 * l1) * g * std::cos(q1) + gravity[1], 1e-11, "g1");

  const cotwin::Matrix J = arm.jacobian(q, "tip");
  expect_near(J(0, 0), -l1 * std::sin(q1) - l2 * std::sin(q1 + q2), kTolerance, "dx/dq1");
  expect_near(J(2, 1), l2 * std::cos(q1 + q2), kTolerance, "dz/dq2");
  expect_near(J(4, 0), -1, kTolerance, "w_y of q1");
  expect_near(arm.forward_kinematics(q).p[2], 0.5 + l1 * std::sin(q1) + l2 * std::sin(q1 + q2), kTolerance,
              "height of the tip");

  // A square Jacobian in the plane: M⁻¹ = J⁻¹ Λ⁻¹ J⁻ᵀ, w = l1 l2 |sin q2|, w_d = w tau_1 tau_2 / det M.
  const double det_M = M(0, 0) * M(1, 1) - M(0, 1) * M(0, 1), w = l1 * l2 * std::abs(std::sin(q2));
  const double mobility = (J(0, 0) * J(0, 0) * M(1, 1) - 2 * J(0, 0) * J(0, 1) * M(0, 1) + J(0, 1) * J(0, 1) * M(0, 0)) / det_M;
  expect_near(arm.effective_mass(q, {3, 0, 0}, "tip"), 1 / mobility, 1e-11, "effective mass along x");
  expect(std::isinf(arm.effective_mass(q, {0, 1, 0}, "tip")), "effective mass across the plane");
  expect(std::isinf(arm.effective_mass(q, {0.6, 0, 0.8}, "base")), "effective mass of the base");
  expect_near(arm.effective_inertia(q, {0, 1, 0}, "tip", cotwin::Axes::kFrame), det_M / (M(0, 0) + M(1, 1) - 2 * M(0, 1)),
              1e-11, "effective inertia");
  const std::vector<double> turned = {q1, q2 + 1e-6}, back = {q1, q2 - 1e-6}, held = {1, 2};
  expect_near(arm.effective_mass_gradient(q, {1, 0, 0}, "tip", cotwin::Axes::kFrame, held)[1],
              (arm.effective_mass(turned, {1, 0, 0}, "tip", cotwin::Axes::kFrame, held) -
               arm.effective_mass(back, {1, 0, 0}, "tip", cotwin::Axes::kFrame, held)) /
                  2e-6,
              1e-4, "gradient of the effective mass");
  const auto kinematic = arm.manipulability(q, "tip").translation;
  expect_near(kinematic.lengths[0] * kinematic.lengths[1], w, kTolerance, "manipulability");
  expect_near(kinematic.measure, 0, kTolerance, "measure of three dimensions");
  const std::vector<double> tau_max = {150, 75};
  const auto dynamic = arm.dynamic_manipulability(q, dq, tau_max, "tip").translation;
  expect_near(dynamic.lengths[0] * dynamic.lengths[1], w * 150 * 75 / det_M, 1e-8, "dynamic manipulability");
  expect_error([&] { arm.effective_mass(q, {0, 0, 0}); }, "expected a finite length > 0");
  expect_error([&] { arm.effective_mass(q, {1, 0, 0}, "", cotwin::Axes::kBase, std::vector<double>{1, -2}); }, ">= 0");
  expect_error([&] { arm.dynamic_manipulability(q, dq, std::vector<double>{1, INFINITY}); }, "tau_max");

  const std::vector<double> tau = arm.inverse_dynamics(q, dq, ddq), again = arm.forward_dynamics(q, dq, tau);
  const std::vector<double> h = arm.bias(q, dq);
  for (std::size_t i = 0; i < 2; ++i) {
    expect_near(again[i], ddq[i], 1e-10, "ddq of forward(inverse)");
    expect_near(tau[i], M(i, 0) * ddq[0] + M(i, 1) * ddq[1] + h[i], 1e-10, "tau = M ddq + h");
  }
  expect_error([&] { arm.gravity(std::vector<double>{1}); }, "has 1 elements, expected 2");
  expect_error([] { cotwin::Robot("nonsense"); }, "nonsense");
}

// The unit from outside: x = x0 cos(w t), then around f/k. Set, step, read.
void check_springs(const char* file, const char* units) {
  cotwin::SimulationOptions options;
  options.units = {units};
  options.set = {"spring.m=4"};
  cotwin::Simulation springs(file, options);
  springs.set("spring.x[2]", 0.25);
  expect(springs.run_to(0.4), "the run ends too early");
  expect_near(springs.time(), 0.4, 1e-15, "time");
  const double w = 5;  // sqrt(100/4)
  expect_near(springs.get("spring.position")[0], 0.5 * std::cos(w * 0.4), 1e-12, "x1 at 0.4 s");
  expect_near(springs.get("spring.position[2]")[0], 0.25 * std::cos(w * 0.4), 1e-12, "x2 at 0.4 s");
  const double x = springs.get("spring.x[1]")[0], v = springs.get("spring.v[1]")[0];
  springs.set("spring.f", std::vector<double>{50, 0});
  expect(springs.run().reached == 1, "the end of the run");
  expect_near(springs.get("spring.x")[0], 0.5 + (x - 0.5) * std::cos(w * 0.6) + v / w * std::sin(w * 0.6), 1e-12, "x1 at 1 s");
  expect(!springs.step(), "a step after the end");
  expect_error([&] { springs.set("spring.m", 1); }, "parameter");
  expect_error([&] { springs.set("spring.k", -1); }, "expected");
  expect_error([&] { springs.get("spring.y"); }, "spring.y");
  expect_error([&] { cotwin::Simulation one(file); }, "no such unit");
}

// The same unit as an FMU.
void check_fmu(const char* file) {
  cotwin::Simulation spring(file);
  expect(spring.run().reached == 1, "the end of the run with an FMU");
  expect_near(spring.get("spring.position")[0], 0.5 * std::cos(10.0), 1e-12, "x1 of the FMU at 1 s");
}

// Example 01 to 1 s, twice: the same bits, and what is fed by a connection cannot be set.
void check_example(const char* file, const std::string& folder) {
  const auto run = [&](const std::string& results) {
    cotwin::SimulationOptions options;
    options.stop = 1;
    options.results = results;
    cotwin::Simulation arm(file, options);
    arm.start();
    expect_error([&] { arm.set("drive.tau_m", std::vector<double>{0, 0}); }, "is fed by compliance.tau_m");
    const cotwin::RunResult result = arm.run();
    expect(result.ticks == 1000 && (result.rows > 0) == !results.empty() && !result.figures.empty(),
           "the result of example 01");
    expect(results.empty() || std::filesystem::is_regular_file(result.recording), "its recording");
    return arm.get("drive.tau_J");
  };
  expect(run(folder + "/example") == run(""), "two runs of example 01 differ");
}

// A log that the API itself made, of planar2: tuning finds the robot again.
void check_tuning(const std::string& folder) {
  cotwin::Robot arm("planar2");
  std::ofstream log(folder + "/log.csv");
  log.precision(17);
  log << "t,q1,q2,tau1,tau2\n";
  for (int i = 0; i < 4000; ++i) {
    const double t = i * 5e-3;
    std::vector<double> q(2), dq(2), ddq(2);
    for (int j = 0; j < 2; ++j) {
      for (int k = 1; k <= 3; ++k) {
        const double w = 1.3 * k + 0.37 * j, a = 0.4 / k, phase = 0.9 * k * (j + 1);
        q[j] += a * std::sin(w * t + phase);
        dq[j] += a * w * std::cos(w * t + phase);
        ddq[j] -= a * w * w * std::sin(w * t + phase);
      }
    }
    const std::vector<double> tau = arm.inverse_dynamics(q, dq, ddq);
    log << t << ',' << q[0] << ',' << q[1] << ',' << tau[0] << ',' << tau[1] << '\n';
  }
  log.close();
  cotwin::TuneOptions options;
  options.robot = "planar2";
  options.data = {folder + "/log.csv"};
  options.out = folder + "/tuned";
  options.method = "feasible";
  options.friction = "coulomb";
  options.motor_torques = false;
  const cotwin::TuneResult tuned = cotwin::tune(options);
  expect(tuned.held_out_rms.size() == 2 && tuned.held_out_rms[0] < 0.02 && tuned.held_out_rms[1] < 0.02,
         "held-out errors below 0.02 N.m");
  expect(!tuned.parameters.empty() && cotwin::Robot(tuned.robot.string()).n() == 2, "the tuned robot");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) return 2;
  try {
    check_robot();
    check_springs(argv[2], argv[3]);
    check_example(argv[1], argv[4]);
    check_tuning(argv[4]);
    if (argc > 5) check_fmu(argv[5]);
  } catch (const std::exception& error) {
    std::cerr << "use_api: " << error.what() << '\n';
    return 1;
  }
  std::cout << "cotwin " << cotwin::version() << ": " << failures << " failures\n";
  return failures == 0 ? 0 : 1;
}
