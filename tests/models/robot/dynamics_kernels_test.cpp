// Properties of the kernels besides correctness: their own sine and cosine, agreement of instruction sets, of batch and single
// state, the same bits for any alignment and thread, and no allocation.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <thread>

#include "models/robot/dynamics.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/allocations.h"

namespace cotwin::robot::dynamics_kernels_test {
namespace {

using namespace testing;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// |a − b| in units of the last place of b.
double ulps(double a, double b) {
  if (a == b || (std::isnan(a) && std::isnan(b))) return 0;
  return std::abs(a - b) / (std::nextafter(std::abs(b), std::numeric_limits<double>::infinity()) - std::abs(b));
}

TEST(Kernels, SineAndCosineAreWithinTwoUnitsInTheLastPlace) {
  for (const char* isa : isas()) {
    const Kernels& kernels = choose_kernels(1, true, isa);
    Draw draw(1);
    for (int i = 0; i < 262144; ++i) {
      double q[11], sine[11], cosine[11];
      for (double& x : q) {
        const double scale = std::exp2(draw.number(-40, 24));  // beyond the limit of the kernels' own reduction, 1.6e6
        x = draw.integer(0, 3) ? scale * draw.number(-1, 1)
                               : std::nextafter(draw.integer(-2000000, 2000000) * std::acos(0.0), 0.0);
      }
      const int count = draw.integer(1, 11);
      kernels.sine_cosine(count, q, sine, cosine);
      for (int k = 0; k < count; ++k) {
        ASSERT_LE(ulps(sine[k], std::sin(q[k])), 2) << isa << ", q = " << q[k];
        ASSERT_LE(ulps(cosine[k], std::cos(q[k])), 2) << isa << ", q = " << q[k];
      }
    }
  }
}

TEST(Kernels, SineAndCosineOfUnusualAnglesAreTheLibrarys) {
  const double inf = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
  for (const char* isa : isas())
    for (const double x : {0.0, -0.0, 5e-324, -1e-310, 1e-20, 1.6e6, 1.6000001e6, -1e9, 1e22, 1.7e308, inf, -inf, nan}) {
      double q[3] = {x, 0.3, x}, sine[3], cosine[3];  // together with an ordinary angle
      choose_kernels(1, true, isa).sine_cosine(3, q, sine, cosine);
      for (int k = 0; k < 3; ++k) {
        EXPECT_LE(ulps(sine[k], std::sin(q[k])), 2) << isa << ", q = " << q[k];
        EXPECT_LE(ulps(cosine[k], std::cos(q[k])), 2) << isa << ", q = " << q[k];
      }
    }
}

struct Results {
  VectorXd tau, h, g, ddq;
  MatrixXd M, C, by_q, by_dq, Y, J;
  Twist a;
  Pose X;
  double T = 0, U = 0;
  MatrixXd batch;  // state x joint

  explicit Results(int n)
      : tau(n), h(n), g(n), ddq(n), M(n, n), C(n, n), by_q(n, n), by_dq(n, n), Y(n, 10 * n), J(6, n), batch(5, n) {}

  void compute(const Mechanism& m, Data& data, const FrameOnBody& frame, const VectorIn& q, const VectorIn& dq,
               const VectorIn& ddq_in, const MatrixXd& states) {
    inverse_dynamics(m, data, q, dq, ddq_in, tau);
    bias(m, data, q, dq, h);
    gravity(m, data, q, g);
    mass_matrix(m, data, q, M);
    mass_matrix_and_bias(m, data, q, dq, M, h);
    coriolis_matrix(m, data, q, dq, C);
    forward_dynamics(m, data, q, dq, tau, ddq);
    inverse_dynamics_derivatives(m, data, q, dq, ddq_in, by_q, by_dq);
    regressor(m, data, q, dq, ddq_in, Y);
    X = forward_kinematics(m, data, q, frame);
    X = jacobian(m, data, q, frame, J);
    jacobian_dot_times_dq(m, data, q, dq, frame, a);
    T = kinetic_energy(m, data, q, dq);
    U = potential_energy(m, data, q);
    inverse_dynamics_batch(m, data, 5, states.data(), states.data(), states.data(), batch.data());
  }
  /// All of them, one after the other.
  VectorXd all() const {
    std::vector<double> v;
    const auto add = [&v](const auto& part) { v.insert(v.end(), part.data(), part.data() + part.size()); };
    add(tau), add(h), add(g), add(ddq), add(M), add(C), add(by_q), add(by_dq), add(Y), add(J);
    add(a), add(X.R), add(X.p), add(batch);
    v.push_back(T), v.push_back(U);
    return Eigen::Map<VectorXd>(v.data(), static_cast<Eigen::Index>(v.size()));
  }
};

template <class F>
void sweep(int count, F f) {
  Draw draw(2);
  for (int i = 0; i < count; ++i) {
    const int n = i % 5 == 0 ? 7 : i % 5 == 1 ? 6 : draw.integer(1, 14);
    SCOPED_TRACE("robot " + std::to_string(i) + ": kind " + std::to_string(i % 3) + ", " + std::to_string(n) + " joints");
    const RobotModel robot = draw.robot(static_cast<Kind>(i % 3), n);
    f(robot, draw.numbers(n, -3, 3), draw.numbers(n, -2, 2), draw.numbers(n, -4, 4),
      MatrixXd(draw.numbers(5 * n, -3, 3).reshaped(5, n)));
    if (::testing::Test::HasFailure()) return;
  }
}

TEST(Kernels, InstructionSetsAgreeToRounding) {
  sweep(1000, [](const RobotModel& robot, const VectorXd& q, const VectorXd& dq, const VectorXd& ddq, const MatrixXd& states) {
    std::vector<VectorXd> all;
    for (const char* isa : isas()) {
      const Mechanism mechanism(robot, isa);
      Data data(mechanism);
      Results results(robot.n());
      results.compute(mechanism, data, on_body(robot.frames.back()), q, dq, ddq, states);
      all.push_back(results.all());
    }
    // Fused multiply-add changes rounding only; forward dynamics and Λ⁻¹ amplify it by M's condition number.
    for (const VectorXd& other : all)
      for (Eigen::Index i = 0; i < other.size(); ++i)
        EXPECT_NEAR(other[i], all[0][i], 1e-9 * (1 + all[0].cwiseAbs().maxCoeff()));
  });
}

TEST(Kernels, BatchAgreesWithSingleStatesForEveryCount) {
  for (const char* isa : isas()) {
    Draw draw(3);
    for (const Kind kind : {Kind::kChain, Kind::kMixedChain, Kind::kTree})
      for (const int n : {1, 2, 6, 7, 8, 11}) {
        const RobotModel robot = draw.robot(kind, n);
        const Mechanism mechanism(robot, isa);
        Data data(mechanism);
        for (Eigen::Index count = 0; count <= 40; ++count) {
          const MatrixXd q = draw.numbers(static_cast<int>(count) * n, -3, 3).reshaped(count, n);
          const MatrixXd dq = draw.numbers(static_cast<int>(count) * n, -2, 2).reshaped(count, n);
          const MatrixXd ddq = draw.numbers(static_cast<int>(count) * n, -4, 4).reshaped(count, n);
          VectorXd guarded = VectorXd::Constant(count * n + 16, 12345.0);  // nothing is written beyond the result
          inverse_dynamics_batch(mechanism, data, static_cast<std::size_t>(count), q.data(), dq.data(), ddq.data(),
                                 guarded.data() + 8);
          EXPECT_TRUE((guarded.head(8).array() == 12345.0).all() && (guarded.tail(8).array() == 12345.0).all());
          const MatrixXd batch = guarded.segment(8, count * n).reshaped(count, n);
          VectorXd tau(n);
          for (Eigen::Index s = 0; s < count; ++s) {
            inverse_dynamics(mechanism, data, VectorXd(q.row(s)), VectorXd(dq.row(s)), VectorXd(ddq.row(s)), tau);
            ASSERT_LT((batch.row(s).transpose() - tau).norm(), 1e-12 * (1 + tau.norm()))
                << isa << ", " << n << " joints, state " << s << " of " << count;
          }
        }
      }
  }
}

TEST(Kernels, ResultsAreTheSameBitsOnAnyThreadAndAlignment) {
  sweep(60, [](const RobotModel& robot, const VectorXd& q, const VectorXd& dq, const VectorXd& ddq, const MatrixXd& states) {
    for (const char* isa : isas()) {
      const Mechanism mechanism(robot, isa);
      const int n = robot.n();
      const FrameOnBody frame = on_body(robot.frames.back());
      Data data(mechanism);
      Results first(n);
      first.compute(mechanism, data, frame, q, dq, ddq, states);
      for (int shift = 0; shift < 8; ++shift) {  // in doubles
        std::thread thread([&] {
          Data own(mechanism);
          VectorXd memory(3 * n + 16);
          const auto moved = [&](int which, const VectorXd& v) {
            Eigen::Map<VectorXd> map(memory.data() + shift + which * n, n);
            map = v;
            return map;
          };
          Results again(n);
          again.compute(mechanism, own, frame, moved(0, q), moved(1, dq), moved(2, ddq), states);
          const VectorXd a = first.all(), b = again.all();
          EXPECT_EQ(std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())), 0)
              << isa << ", shift " << shift;
        });
        thread.join();
      }
    }
  });
}

TEST(Kernels, WriteIntoBlocksOfLargerMatricesAndNowhereElse) {
  sweep(200, [](const RobotModel& robot, const VectorXd& q, const VectorXd& dq, const VectorXd& ddq, const MatrixXd&) {
    const int n = robot.n();
    for (const char* isa : isas()) {
      const Mechanism mechanism(robot, isa);
      Data data(mechanism);
      const FrameOnBody frame = on_body(robot.frames.back());
      const auto in_frame = [&](Eigen::Index rows, Eigen::Index columns, auto write) {
        MatrixXd plain(rows, columns);
        write(plain);
        MatrixXd large = MatrixXd::Constant(rows + 9, columns + 2, 12345.0), expected = large;
        write(large.block(4, 1, rows, columns));
        expected.block(4, 1, rows, columns) = plain;
        EXPECT_EQ(large, expected) << isa;
      };
      in_frame(n, n, [&](MatrixOut M) { mass_matrix(mechanism, data, q, M); });
      in_frame(n, n, [&](MatrixOut C) { coriolis_matrix(mechanism, data, q, dq, C); });
      in_frame(n, n, [&](MatrixOut A) {
        MatrixXd B(n, n);
        inverse_dynamics_derivatives(mechanism, data, q, dq, ddq, A, B);
      });
      in_frame(n, n, [&](MatrixOut A) {
        MatrixXd B(n, n);
        inverse_dynamics_derivatives(mechanism, data, q, dq, ddq, B, A);
      });
      in_frame(n, 10 * n, [&](MatrixOut Y) { regressor(mechanism, data, q, dq, ddq, Y); });
      in_frame(6, n, [&](MatrixOut J) { jacobian(mechanism, data, q, frame, J); });
    }
  });
}

TEST(Kernels, NothingAllocates) {
  sweep(60, [](const RobotModel& robot, const VectorXd& q, const VectorXd& dq, const VectorXd& ddq, const MatrixXd& states) {
    for (const char* isa : isas()) {
      Mechanism mechanism(robot, isa);
      Data data(mechanism);
      Results results(robot.n());
      const FrameOnBody frame = on_body(robot.frames.back());
      const std::uint64_t before = cotwin::testing::allocations();
      results.compute(mechanism, data, frame, q, dq, ddq, states);
      mechanism.update(robot);
      EXPECT_EQ(cotwin::testing::allocations(), before) << isa;
    }
  });
  const std::uint64_t before = cotwin::testing::allocations();
  const Data counted(Mechanism(RobotModel{}));
  EXPECT_GT(cotwin::testing::allocations(), before);  // check of the counter
}

TEST(Kernels, AnUnknownInstructionSetSelectsThatOfTheMachine) {
#if defined(__x86_64__)
  const bool mixed = __builtin_cpu_is("intel") && __builtin_cpu_supports("avx512dq");
  const char* own = mixed || isas().size() < 3 ? isas().front() : isas()[1];
#else
  const char* own = "generic";
#endif
  EXPECT_STREQ(choose_kernels(7, true, "x86-64-v9").isa, own);
  EXPECT_STREQ(choose_kernels(7, true, "").isa, own);
  for (const char* isa : isas()) EXPECT_STREQ(choose_kernels(7, true, isa).isa, isa);
}

TEST(Kernels, TheMixtureOfInstructionSetsTakesEachFunctionFromALevel) {
  if (isas().front() != std::string("x86-64-v4-intel")) GTEST_SKIP() << "needs AVX-512";
  for (const auto& [n, chain] : {std::pair{9, false}, {9, true}, {6, true}, {7, true}}) {
    const Kernels &mixed = choose_kernels(n, chain, "x86-64-v4-intel"), &v3 = choose_kernels(n, chain, "x86-64-v3"),
                  &v4 = choose_kernels(n, chain, "x86-64-v4");
    int of_v3 = 0, of_v4 = 0;
    const auto count = [&](auto function) {
      of_v3 += mixed.*function == v3.*function;
      of_v4 += mixed.*function == v4.*function;
    };
    count(&Kernels::sine_cosine), count(&Kernels::inverse_dynamics), count(&Kernels::inverse_dynamics_batch);
    count(&Kernels::mass_matrix), count(&Kernels::mass_matrix_and_bias), count(&Kernels::coriolis_matrix);
    count(&Kernels::forward_dynamics), count(&Kernels::derivatives), count(&Kernels::regressor), count(&Kernels::kinematics);
    count(&Kernels::jacobian_dot_times_dq), count(&Kernels::potential_energy);
    EXPECT_EQ(of_v3 + of_v4, 12);
    EXPECT_GT(of_v3, 0);
    EXPECT_GT(of_v4, 0);
    EXPECT_EQ(&mixed, &choose_kernels(n, chain, "x86-64-v4-intel"));  // the same table in every call
  }
}

}  // namespace
}  // namespace cotwin::robot::dynamics_kernels_test
