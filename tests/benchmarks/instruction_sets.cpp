// Time of each kernel with each instruction set: the measurements behind the tables in models/robot/kernels/kernels.cpp and
// models/numerics/kernels/kernels.cpp. Each row compares the default of this machine with the fastest level, in processor time
// of the thread, and lists the times of all levels in its name.

#include <algorithm>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "models/numerics/kernels/kernels.h"
#include "models/robot/dynamics.h"
#include "models/robot/kernels/kernels.h"
#include "tests/benchmarks/measure.h"
#include "tests/models/robot/random_robots.h"

namespace {

using namespace cotwin;
using namespace cotwin::robot;
using benchmark::keep;

constexpr int kStates = 64;     // in turn, so that branch prediction cannot learn a single one
constexpr double kSlack = 1.2;  // the place of the arrays in memory alone changes times by 15 %

struct Variant {
  std::string name;
  std::function<void()> function;
  std::vector<double> seconds;
  int calls = 1;
};

double seconds_of_calls(const Variant& variant) {
  const double begin = benchmark::thread_seconds();
  for (int i = 0; i < variant.calls; ++i) variant.function();
  return benchmark::thread_seconds() - begin;
}

/// Runs the variants in turn; the first is the default.
void print_row(const std::string& what, std::vector<Variant> variants) {
  for (Variant& v : variants)
    while (!benchmark::quick() && seconds_of_calls(v) < 1e-3) v.calls *= 2;
  const int rounds = benchmark::shortened(41, 1), middle = rounds / 2;
  for (int round = 0; round < rounds; ++round)
    for (Variant& v : variants) v.seconds.push_back(seconds_of_calls(v) / v.calls);
  std::vector<double> times;
  for (Variant& v : variants) {
    std::nth_element(v.seconds.begin(), v.seconds.begin() + middle, v.seconds.end());
    times.push_back(1e9 * v.seconds[static_cast<std::size_t>(middle)]);
  }
  std::string all;
  std::size_t best = 1;
  for (std::size_t k = 1; k < variants.size(); ++k) {
    all += (k == 1 ? ": " : ", ") + variants[k].name + " " + std::to_string(std::lround(times[k]));
    if (times[k] < times[best]) best = k;
  }
  benchmark::print({what + all + ", default " + variants[0].name, "ns", times[0], variants[best].name, times[best], kSlack});
}

std::vector<const char*> levels() {
  std::vector<const char*> names{nullptr};
  for (const char* name : {"x86-64-v2", "x86-64-v3", "x86-64-v4"}) {
    const char* isa = choose_kernels(1, true, name).isa;
    if (isa == std::string(name)) names.push_back(isa);
  }
  return names;
}

struct Arm {
  const char* isa;
  Mechanism mechanism;
  Data data;
  Arm(const RobotModel& robot, const char* level) : isa(level), mechanism(robot, level), data(mechanism) {}
};

void measure_robot(const std::string& shape, const RobotModel& robot) {
  const int n = robot.n();
  testing::Draw draw(1);
  std::vector<Eigen::VectorXd> q, dq, ddq, tau;
  for (int s = 0; s < kStates; ++s) {
    q.push_back(draw.numbers(n, -3, 3));
    dq.push_back(draw.numbers(n, -2, 2));
    ddq.push_back(draw.numbers(n, -4, 4));
    tau.push_back(draw.numbers(n, -50, 50));
  }
  std::vector<Arm> arms;
  for (const char* level : levels()) arms.emplace_back(robot, level);
  const FrameOnBody tool = on_body(robot.end_effector());
  Eigen::VectorXd out(n);
  Eigen::MatrixXd M(n, n), A(n, n), J(6, n), Y(n, 10 * n);
  const Eigen::MatrixXd states = draw.numbers(kStates * n, -3, 3).reshaped(kStates, n);
  Eigen::MatrixXd taus(kStates, n);
  Eigen::Matrix<double, 6, 6> Lambda;
  Twist a;
  const auto row = [&](const std::string& what, auto function) {
    std::vector<Variant> variants;
    for (Arm& arm : arms) {
      std::size_t state = 0;
      variants.push_back({arm.isa ? arm.isa : kernel_isa(), [&, state]() mutable { function(arm, state++ % kStates); }, {}});
    }
    print_row(what + ", " + shape, std::move(variants));
  };
  row("inverse dynamics", [&](Arm& arm, std::size_t s) {
    inverse_dynamics(arm.mechanism, arm.data, q[s], dq[s], ddq[s], out);
    keep(out);
  });
  row("inverse dynamics, 64 states", [&](Arm& arm, std::size_t) {
    inverse_dynamics_batch(arm.mechanism, arm.data, kStates, states.data(), states.data(), states.data(), taus.data());
    keep(taus);
  });
  row("mass matrix", [&](Arm& arm, std::size_t s) {
    mass_matrix(arm.mechanism, arm.data, q[s], M);
    keep(M);
  });
  row("mass matrix and bias", [&](Arm& arm, std::size_t s) {
    mass_matrix_and_bias(arm.mechanism, arm.data, q[s], dq[s], M, out);
    keep(M);
  });
  row("Coriolis matrix", [&](Arm& arm, std::size_t s) {
    coriolis_matrix(arm.mechanism, arm.data, q[s], dq[s], M);
    keep(M);
  });
  row("forward dynamics", [&](Arm& arm, std::size_t s) {
    forward_dynamics(arm.mechanism, arm.data, q[s], dq[s], tau[s], out);
    keep(out);
  });
  row("derivatives", [&](Arm& arm, std::size_t s) {
    inverse_dynamics_derivatives(arm.mechanism, arm.data, q[s], dq[s], ddq[s], M, A);
    keep(M);
  });
  row("regressor", [&](Arm& arm, std::size_t s) {
    regressor(arm.mechanism, arm.data, q[s], dq[s], ddq[s], Y);
    keep(Y);
  });
  row("kinematics and Jacobian", [&](Arm& arm, std::size_t s) {
    keep(jacobian(arm.mechanism, arm.data, q[s], tool, J));
    keep(J);
  });
  row("J' dq", [&](Arm& arm, std::size_t s) {
    jacobian_dot_times_dq(arm.mechanism, arm.data, q[s], dq[s], tool, a);
    keep(a);
  });
  row("J M^-1 J^T", [&](Arm& arm, std::size_t s) {
    operational_inertia_inverse(arm.mechanism, arm.data, q[s], tool, Lambda);
    keep(Lambda);
  });
  row("potential energy", [&](Arm& arm, std::size_t s) { keep(potential_energy(arm.mechanism, arm.data, q[s])); });
}

void measure_numerics() {
  constexpr std::size_t kColumns = 50, kParticles = 256;
  std::mt19937_64 engine(1);
  const auto numbers = [&](std::size_t count) {
    std::vector<double> v(count);
    for (double& x : v) x = static_cast<double>(engine() >> 11) * 0x1p-53 - 0.5;
    return v;
  };
  const std::vector<double> rows = numbers(64 * kColumns), A = numbers(56 * kColumns), x = numbers(8 * kColumns);
  std::vector<double> R(kColumns * kColumns), block, y(8 * 56);
  const std::vector<std::size_t> first(7, 0);
  const std::vector<double> lower(kColumns, -1), upper(kColumns, 1), best = numbers(kColumns * kParticles);
  const std::vector<std::uint32_t> informant(kParticles, 3);
  std::vector<double> position = numbers(kColumns * kParticles), speed = numbers(kColumns * kParticles);
  const numerics::Move move{
      kColumns,         kParticles,      0,           1, 0, 0.7, 1.2, 1.2, lower.data(), upper.data(), best.data(),
      informant.data(), position.data(), speed.data()};
  const auto row = [&](const std::string& what, auto function) {
    std::vector<Variant> variants;
    for (const char* level : levels()) {
      const numerics::NumericsKernels& kernels = level ? numerics::kernels(level) : numerics::kernels();
      variants.push_back({kernels.isa, [&] { function(kernels); }, {}});
    }
    print_row(what, std::move(variants));
  };
  row("64 rows into a triangle of 50 columns", [&](const numerics::NumericsKernels& kernels) {
    block = rows;
    kernels.absorb(kColumns, R.data(), block.data());
    keep(R);
  });
  row("50 x 50 matrix times eight vectors", [&](const numerics::NumericsKernels& kernels) {
    kernels.times(kColumns, kColumns, A.data(), first.data(), x.data(), 8, y.data());
    keep(y);
  });
  row("move of a block of particles, 50 dimensions", [&](const numerics::NumericsKernels& kernels) {
    kernels.move(move);
    keep(position);
  });
}

}  // namespace

int main() {
  testing::Draw draw(5);
  measure_robot("chain of 6", draw.robot(testing::Kind::kChain, 6));
  measure_robot("chain of 7", draw.robot(testing::Kind::kChain, 7));
  measure_robot("chain of 12", draw.robot(testing::Kind::kChain, 12));
  for (const int n : {12, 30}) {
    RobotModel tree = draw.robot(testing::Kind::kTree, n);
    draw.order_depth_first(tree);
    measure_robot("tree of " + std::to_string(n), tree);
  }
  measure_numerics();
  return 0;
}
