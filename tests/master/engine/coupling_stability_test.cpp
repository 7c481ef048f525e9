// Which steps of a loop are stable: measured by the master from outside of the units, here from the matrices of linear units.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <random>

#include "master/engine/engine.h"
#include "tests/master/test_units.h"
#include "tests/support/linear_units.h"

namespace cotwin::master::coupling_stability_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::LinearSystem;
using ::cotwin::testing::LinearUnit;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Linear units, unit i with the inputs u1 … and outputs y1 …, and the connections between them.
struct Loop {
  struct Part {
    LinearSystem system;
    bool held = false;
    int stage = 0;
    double most = 0;  // outputs beyond end the run; 0: none
  };
  struct Wire {
    std::size_t from, output, to, input;
  };
  std::vector<Part> parts;
  std::vector<Wire> wires;

  void part(MatrixXd A, MatrixXd B, MatrixXd C, MatrixXd D, bool held, int stage) {
    LinearSystem s{A, B, C, D, VectorXd::Ones(A.rows()), {}, {}};
    for (Eigen::Index i = 1; i <= B.cols(); ++i) s.inputs.push_back({"u" + std::to_string(i), "1", "input", ""});
    for (Eigen::Index i = 1; i <= C.rows(); ++i) s.outputs.push_back({"y" + std::to_string(i), "1", "output", ""});
    parts.push_back({std::move(s), held, stage});
  }
};

/// A linear unit with outputs of bounded size.
class Bounded final : public Unit {
 public:
  explicit Bounded(const Loop::Part& part) : unit_(part.system, {part.held, false}), most_(part.most) {}
  void declare(Variables& v) override {
    unit_.declare(v);
    for (const Variable& variable : v) {
      if (variable.role == Role::kOutput) outputs_.push_back(variable.reals());
    }
  }
  void initialise(Time start) override { unit_.initialise(start); }
  StepResult step(Time now, Duration h) override {
    const StepResult result = unit_.step(now, h);
    for (const std::span<const double> output : outputs_) {
      for (const double y : output) {
        if (most_ > 0 && !(std::abs(y) <= most_)) throw Error("part", "is beyond its bound");
      }
    }
    return result;
  }

 private:
  LinearUnit unit_;
  double most_;
  std::vector<std::span<const double>> outputs_;
};

Loop loop_of_the_test;  // a UnitType has no place for it

std::span<const UnitType> types() {
  static const std::vector<UnitType> kTypes = {{"part", "a part of loop_of_the_test",
                                                [](Settings& s) -> std::unique_ptr<Unit> {
                                                  const Loop::Part& part =
                                                      loop_of_the_test.parts.at(static_cast<std::size_t>(s.integer("i")));
                                                  return std::make_unique<Bounded>(part);
                                                },
                                                [](SettingList& s) { s.integer("i", 0, 0, 100, "number of the part"); }}};
  return kTypes;
}

Build scenario_of(const Loop& loop, double tick, CouplingChoice coupling) {
  loop_of_the_test = loop;
  Build b;
  for (std::size_t i = 0; i < loop.parts.size(); ++i) {
    b.unit("p" + std::to_string(i), "part?i=" + std::to_string(i));
    b.scenario.components.back().stage = loop.parts[i].stage;
  }
  for (const Loop::Wire& w : loop.wires)
    b.connect("p" + std::to_string(w.from) + ".y" + std::to_string(w.output + 1),
              "p" + std::to_string(w.to) + ".u" + std::to_string(w.input + 1));
  b.scenario.tick = Duration::from_seconds(tick);
  b.scenario.coupling = coupling;
  b.until(1e6);
  return b;
}

/// The power series, after halving h until it converges fast.
MatrixXd exponential(MatrixXd A) {
  int squarings = 0;
  for (; A.norm() > 0.1; ++squarings) A /= 2;
  MatrixXd sum = MatrixXd::Identity(A.rows(), A.cols()), term = sum;
  for (int k = 1; k < 16; ++k) sum += term = term * A / k;
  for (; squarings > 0; --squarings) sum = (sum * sum).eval();
  return sum;
}

/// ‖A^k‖^(1/k) for k = 2^40.
double radius(MatrixXd A) {
  double log_norm = 0, k = 1;
  for (int i = 0; i <= 40; ++i, k *= 2) {
    const double norm = A.norm();
    if (norm == 0) return 0;
    log_norm += std::log(norm) / k;
    A /= norm;
    A = (A * A).eval();
  }
  return std::exp(log_norm);
}

/// An explicit step of the master, written as a matrix: of the states, the inputs at the end of the last step, and the outputs.
class ExplicitMatrix {
 public:
  ExplicitMatrix(const Loop& loop, double h) : loop_(loop), h_(h) {
    for (const Loop::Part& part : loop.parts) {
      const LinearSystem& s = part.system;
      const Eigen::Index n = s.A.rows(), m = s.B.cols();
      MatrixXd all = MatrixXd::Zero(n + 2 * m, n + 2 * m);
      all.topLeftCorner(n, n) = s.A * h;
      all.block(0, n, n, m) = s.B * h;
      all.block(n, n + m, m, m) = MatrixXd::Identity(m, m) * h;
      flows_.push_back(exponential(all).topRows(n));
      offsets_.push_back(size_);
      size_ += n + m + s.C.rows();
    }
  }
  double radius() const {
    MatrixXd matrix(size_, size_);
    for (Eigen::Index j = 0; j < size_; ++j) matrix.col(j) = step(VectorXd::Unit(size_, j));
    return coupling_stability_test::radius(matrix);
  }

 private:
  Eigen::Index inputs_at(std::size_t i) const { return offsets_[i] + loop_.parts[i].system.A.rows(); }
  Eigen::Index outputs_at(std::size_t i) const { return inputs_at(i) + loop_.parts[i].system.B.cols(); }

  VectorXd step(const VectorXd& before) const {
    VectorXd after = before;
    for (int stage = 0; stage < 2; ++stage) {
      const VectorXd seen = after;  // outputs of earlier stages are new
      for (std::size_t i = 0; i < loop_.parts.size(); ++i) {
        const Loop::Part& part = loop_.parts[i];
        const LinearSystem& s = part.system;
        if (part.stage != stage) continue;
        const Eigen::Index n = s.A.rows(), m = s.B.cols();
        VectorXd begin(m), rate = VectorXd::Zero(m), kept(m);
        for (const Loop::Wire& w : loop_.wires) {
          if (w.to != i) continue;
          const auto k = static_cast<Eigen::Index>(w.input);
          const double value = seen[outputs_at(w.from) + static_cast<Eigen::Index>(w.output)], last = before[inputs_at(i) + k];
          const bool interpolates = loop_.parts[w.from].stage < stage;
          begin[k] = part.held || !interpolates ? value : last;
          if (!part.held) rate[k] = (value - last) / h_;
          kept[k] = value;
        }
        VectorXd state(n + 2 * m);
        state << before.segment(offsets_[i], n), begin, rate;
        const VectorXd x = flows_[i] * state;
        after.segment(offsets_[i], n) = x;
        after.segment(inputs_at(i), m) = kept;
        after.segment(outputs_at(i), s.C.rows()) = s.C * x + s.D * (begin + h_ * rate);
      }
    }
    return after;
  }

  const Loop& loop_;
  double h_;
  std::vector<MatrixXd> flows_;
  std::vector<Eigen::Index> offsets_;
  Eigen::Index size_ = 0;
};

bool is_stable(const Loop& loop, double h) { return ExplicitMatrix(loop, h).radius() <= 1 + 1e-9; }

/// The first step from which on the radius is above 1, up to 1024 ticks; infinity if there is none.
double true_border(const Loop& loop, double tick) {
  double stable = tick / 1024;
  if (!is_stable(loop, stable)) return 0;
  while (is_stable(loop, 1.04 * stable)) {
    stable *= 1.04;
    if (stable > 1024 * tick) return std::numeric_limits<double>::infinity();
  }
  double unstable = 1.04 * stable;
  while (unstable > 1.001 * stable) {
    const double middle = (stable + unstable) / 2;
    (is_stable(loop, middle) ? stable : unstable) = middle;
  }
  return unstable;
}

double measured_border(const Loop& loop, double tick) {
  const Build b = scenario_of(loop, tick, CouplingChoice::kExplicit);
  std::vector<Member> members = load_members(b.scenario, types(), {});
  Engine engine(b.scenario, members, 1, false);
  engine.initialise(b.scenario.start);
  return engine.measure_loops(b.scenario.start, 200).at(0).border;
}

MatrixXd matrix(std::initializer_list<std::initializer_list<double>> rows) {
  MatrixXd m(static_cast<Eigen::Index>(rows.size()), static_cast<Eigen::Index>(rows.begin()->size()));
  Eigen::Index i = 0;
  for (const auto& row : rows) {
    Eigen::Index j = 0;
    for (const double value : row) m(i, j++) = value;
    ++i;
  }
  return m;
}

struct Bodies {
  double m1 = 1, c1 = 10, d1 = 2, m2 = 2, c2 = 20, d2 = 2, ck = 1000, dk = 5;
};

/// Body 1 gets the force, body 2 displacement and speed of body 1.
Loop force_displacement(const Bodies& b, bool held, bool in_turn) {
  Loop loop;
  const MatrixXd none = MatrixXd::Zero(2, 1);
  loop.part(matrix({{0, 1}, {-b.c1 / b.m1, -b.d1 / b.m1}}), matrix({{0}, {1 / b.m1}}), MatrixXd::Identity(2, 2), none, held, 0);
  loop.part(matrix({{0, 1}, {-(b.c2 + b.ck) / b.m2, -(b.d2 + b.dk) / b.m2}}), matrix({{0, 0}, {b.ck / b.m2, b.dk / b.m2}}),
            matrix({{b.ck, b.dk}}), matrix({{-b.ck, -b.dk}}), held, in_turn ? 1 : 0);
  loop.wires = {{1, 0, 0, 0}, {0, 0, 1, 0}, {0, 1, 1, 1}};
  return loop;
}

/// Each body gets displacement and speed of the other.
Loop displacement_displacement(const Bodies& b, bool held, bool in_turn) {
  Loop loop;
  const auto body = [&](double m, double c, double d, int stage) {
    loop.part(matrix({{0, 1}, {-(c + b.ck) / m, -(d + b.dk) / m}}), matrix({{0, 0}, {b.ck / m, b.dk / m}}),
              MatrixXd::Identity(2, 2), MatrixXd::Zero(2, 2), held, stage);
  };
  body(b.m1, b.c1, b.d1, 0);
  body(b.m2, b.c2, b.d2, in_turn ? 1 : 0);
  loop.wires = {{0, 0, 1, 0}, {0, 1, 1, 1}, {1, 0, 0, 0}, {1, 1, 0, 1}};
  return loop;
}

/// Pairs of bodies and rings of three to five oscillators, inputs held or not.
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double between(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine_); }
  double scale(double low, double high) { return low * std::pow(high / low, between(0, 1)); }
  bool either() { return between(0, 1) < 0.5; }

  Loop loop(bool only_held) {
    const int kind = static_cast<int>(between(0, 3));
    const bool held = only_held || either(), in_turn = either();
    if (kind == 2) return ring(only_held, in_turn);
    Bodies b;
    const auto damping = [&](double m, double c) { return 2 * between(0.03, 0.5) * std::sqrt(m * c); };
    b.m1 = scale(0.3, 3), b.c1 = scale(3, 300), b.d1 = damping(b.m1, b.c1);
    b.m2 = scale(0.3, 3), b.c2 = scale(3, 300), b.d2 = damping(b.m2, b.c2);
    b.ck = scale(10, 3000), b.dk = damping(b.m1, b.ck);
    return kind == 0 ? force_displacement(b, held, in_turn) : displacement_displacement(b, held, in_turn);
  }

 private:
  Loop ring(bool only_held, bool in_turn) {
    Loop loop;
    const auto n = static_cast<std::size_t>(between(3, 5.99));
    for (std::size_t i = 0; i < n; ++i) {
      const double omega = scale(2, 30), zeta = between(0.2, 1), gain = (either() ? 1 : -1) * between(0.3, 0.95);
      loop.part(matrix({{0, 1}, {-omega * omega, -2 * zeta * omega}}), matrix({{0}, {gain * omega * omega}}), matrix({{1, 0}}),
                matrix({{0}}), only_held || either(), in_turn && i % 2 == 1 ? 1 : 0);
      loop.wires.push_back({i, 0, (i + 1) % n, 0});
    }
    return loop;
  }
  std::mt19937 engine_;
};

// The borders of m 1, 2 kg; c 10, 20 N/m; d 2, 2 N.s/m, joined by 1000 N/m and 5 N.s/m, from an independent program.
TEST(StabilityBorder, IsThatOfTheStepThatTheMasterMakes) {
  struct Row {
    Loop loop;
    double border;
  };
  const Row rows[] = {
      {force_displacement({}, true, false), 6.848e-3},         {force_displacement({}, false, false), 16.228e-3},
      {force_displacement({}, true, true), 8.027e-3},          {force_displacement({}, false, true), 28.912e-3},
      {displacement_displacement({}, true, false), 28.863e-3}, {displacement_displacement({}, false, false), 33.443e-3},
      {displacement_displacement({}, false, true), 56.504e-3}};
  for (const Row& row : rows) {
    EXPECT_NEAR(true_border(row.loop, 1e-3), row.border, 2e-3 * row.border);
    EXPECT_NEAR(measured_border(row.loop, 1e-3), row.border, 0.03 * row.border);
    EXPECT_NEAR(measured_border(row.loop, 0.1), row.border, 0.03 * row.border);  // from above
  }
}

TEST(StabilityBorder, IsWithin5PercentForRandomLoops) {
  Random random(1);
  int figures = 0, right = 0, all = 0;
  for (int i = 0; i < 200; ++i) {
    const Loop loop = random.loop(false);
    const double tick = 1e-3, border = true_border(loop, tick), measured = measured_border(loop, tick);
    ++all;
    if (std::isfinite(border) == std::isfinite(measured)) ++figures;
    const bool near = std::isfinite(border) ? std::abs(measured - border) <= 0.05 * border : measured == border;
    if (near) {
      ++right;
    } else {
      std::cout << "loop " << i << ": border " << border << " s, measured " << measured << " s, radius there "
                << ExplicitMatrix(loop, measured).radius() << '\n';
    }
  }
  EXPECT_GE(figures, 0.95 * all);
  EXPECT_GE(right, 0.95 * all);
}

// Robots fall, and units have limits: then the run ends where it diverges, and tells no growth.
TEST(StabilityBorder, IsThatOfALoopThatCannotGoOnBeyondIt) {
  Random random(5);
  int right = 0;
  constexpr int kLoops = 40;
  for (int i = 0; i < kLoops; ++i) {
    Loop loop = random.loop(false);
    const double border = measured_border(loop, 1e-3);
    for (Loop::Part& part : loop.parts) part.most = 1e4;
    const double bounded = measured_border(loop, 1e-3);
    right += std::isfinite(border) ? std::abs(bounded - border) <= 0.05 * border : bounded == border;
  }
  EXPECT_GE(right, 0.95 * kLoops);
}

struct Grown {
  double growth = 0;  // of the largest output, from the first 200 ticks to the last 200
  int ticks = 0;      // between them
};

/// 2000 implicit steps, or those until the values have grown so much that the run ends with an error.
Grown growth_of_run(const Loop& loop, double tick) {
  MasterOptions options;
  options.types = types();
  Master master(scenario_of(loop, tick, CouplingChoice::kImplicit).scenario, std::move(options));
  master.initialise();
  std::vector<double> largest;
  try {
    for (int i = 0; i < 2000 && master.step_tick(); ++i) {
      largest.push_back(0);
      for (const Member& member : master.members()) {
        for (const Variable& v : member.variables()) {
          if (v.role != Role::kOutput) continue;
          for (const double y : v.reals()) largest.back() = std::max(largest.back(), std::abs(y));
        }
      }
    }
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("diverge"));
  }
  EXPECT_GE(largest.size(), 400u);
  if (largest.size() < 400) return {};
  const auto begin = largest.begin(), end = largest.end();
  return {*std::max_element(end - 200, end) / *std::max_element(begin, begin + 200), static_cast<int>(largest.size()) - 400};
}

// The rule for held inputs is at least as stable as explicit steps.
TEST(ImplicitCoupling, WithHeldInputsGrowsNoMoreThanExplicitSteps) {
  Random random(2);
  int stable = 0;
  for (int i = 0; i < 500; ++i) {
    const Loop loop = random.loop(true);
    const double tick = random.scale(1e-3, 0.3);
    const double explicit_radius = ExplicitMatrix(loop, tick).radius();
    const Grown run = growth_of_run(loop, tick);
    const double allowed = std::pow(std::max(1.0, explicit_radius), run.ticks + 200);
    EXPECT_LE(run.growth, 1.01 * allowed) << "loop " << i << ", tick " << tick << " s, explicit radius " << explicit_radius;
    if (run.growth <= 1.01) ++stable;
  }
  EXPECT_GE(stable, 490);  // these loops are stable where they are not stepped apart
}

}  // namespace
}  // namespace cotwin::master::coupling_stability_test
