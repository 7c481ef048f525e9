// The drive train of the LWR 4+ (7 joints, elastic gears, LuGre friction) follows a motion, with torques that are constant for
// 1 ms: processor time of the thread per simulated millisecond and largest error of q and θ over the run, for each method.
// The peers are CVODE in its simplest form (dense matrix, 35 states) and the classical explicit Runge-Kutta method with the same
// equations. The reference is the structured CVODE at rtol 1e-11. "Stiff LuGre": σ0 x 100, σ1 x 10. "Stiff gears": K = 1e6
// N.m/rad, D = 0.
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "components/drive_train/drive_train.h"
#include "components/unit/unit_table.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/places.h"

namespace cotwin {
namespace {

constexpr int kJoints = 7;
const int kSteps = benchmark::shortened(2000, 80);  // a multiple of kChunk
constexpr Duration kTick{1'000'000};
const std::filesystem::path kModels = std::filesystem::path(cotwin::places::source()) / "models";

struct Desired {
  Eigen::VectorXd q{kJoints}, dq{kJoints}, ddq{kJoints};
};

// Every joint oscillates with an amplitude of 0.1 to 0.5 rad at its own frequency of 0.3 to 0.9 Hz, and reverses several times.
Desired desired(double t) {
  Desired d;
  for (int i = 0; i < kJoints; ++i) {
    const double A = 0.5 - 0.06 * i, w = 2 * std::numbers::pi * (0.3 + 0.1 * i), c = 0.3 - 0.1 * i;
    d.q[i] = c + A * std::cos(w * t);
    d.dq[i] = -A * w * std::sin(w * t);
    d.ddq[i] = -A * w * w * std::cos(w * t);
  }
  return d;
}

// Inverse dynamics of the desired motion with the motors' inertia and friction, and a PD controller on the motors.
class Controller {
 public:
  Controller() : robot_(robot::load_urdf(kModels / "robots/lwr4/robot.urdf")), mechanism_(robot_), data_(mechanism_) {}
  void torque(double t, const double* theta, const double* dtheta, const double* K, const double* B, double* tau_m) {
    const Desired d = desired(t);
    robot::inverse_dynamics(mechanism_, data_, d.q, d.dq, d.ddq, id_);
    for (int i = 0; i < kJoints; ++i) {
      const double theta_d = d.q[i] + id_[i] / K[i];
      const double friction = (i < 2 ? 8.0 : i < 4 ? 5.0 : 2.0) * std::tanh(d.dq[i] / 0.05);
      tau_m[i] = id_[i] + B[i] * d.ddq[i] + friction + B[i] * (900 * (theta_d - theta[i]) + 60 * (d.dq[i] - dtheta[i]));
    }
  }

 private:
  robot::RobotModel robot_;
  robot::Mechanism mechanism_;
  robot::Data data_;
  Eigen::VectorXd id_{kJoints};
};

constexpr int kChunk = 40;  // steps that are timed together: much less than a scheduler's time slice

// Processor time of this thread, s.
double thread_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

enum class Variant { kSoft, kStiffFriction, kStiffGears };

// Seconds between multiples of kChunk steps.
class Stopwatch {
 public:
  explicit Stopwatch(std::vector<double>& laps) : laps_(laps) { laps_.reserve(static_cast<std::size_t>(kSteps / kChunk)); }
  void mark(int step) {
    if (step % kChunk != 0) return;
    const double now = thread_seconds();
    if (step > 0) laps_.push_back(now - last_);
    last_ = now;
  }

 private:
  std::vector<double>& laps_;
  double last_ = 0;
};

struct Outcome {
  std::vector<double> seconds;  // of each chunk
  std::vector<double> trajectory =
      std::vector<double>(static_cast<std::size_t>(2 * kJoints * kSteps));  // q | θ after each step
  std::vector<double> torques;                                              // τ_m of each step
};

using Values = std::vector<std::pair<std::string, std::string>>;

const Values kTight = {{"rtol", "1e-11"}, {"atol", "1e-13"}, {"atol_speed", "1e-11"}};

Instance make(const std::string& query, const Values& values, Variant variant) {
  Instance drive = make_unit("unit:drive_train?robot=lwr4" + query, {}, {kModels}, unit_types());
  for (const auto& [name, value] : values) assign_text(drive.variables.at(name), value);
  if (variant == Variant::kStiffGears) {
    for (double& k : drive.variables.at("K").reals()) k = 1e6;
    for (double& d : drive.variables.at("D").reals()) d = 0;
  }
  if (variant == Variant::kStiffFriction) {
    for (double& s : drive.variables.at("sigma0").reals()) s *= 100;
    for (double& s : drive.variables.at("sigma1").reals()) s *= 10;
  }
  const Desired start = desired(0);
  std::copy_n(start.q.data(), kJoints, drive.variables.at("q0").reals().data());
  drive.unit->initialise(Time{});
  return drive;
}

// With `torques`: applies them. Without: applies those of the controller.
Outcome run(const std::string& query, const Values& values, Variant variant, const std::vector<double>* torques) {
  Instance drive = make(query, values, variant);
  const Variables& v = drive.variables;
  Controller controller;
  Outcome outcome;
  double* tau_m = v.at("tau_m").reals().data();
  const auto q = v.at("q").reals(), theta = v.at("theta").reals();
  Stopwatch watch(outcome.seconds);
  for (int n = 0; n < kSteps; ++n) {
    const Time now{n * kTick.ns};
    watch.mark(n);
    if (torques != nullptr) {
      std::copy_n(torques->data() + n * kJoints, kJoints, tau_m);
    } else {
      controller.torque(now.seconds(), theta.data(), v.at("dtheta").reals().data(), v.at("K").reals().data(),
                        v.at("B").reals().data(), tau_m);
    }
    if (torques == nullptr) outcome.torques.insert(outcome.torques.end(), tau_m, tau_m + kJoints);
    if (drive.unit->step(now, kTick) != StepResult::kDone) std::abort();
    std::copy(q.begin(), q.end(), outcome.trajectory.begin() + n * 2 * kJoints);
    std::copy(theta.begin(), theta.end(), outcome.trajectory.begin() + n * 2 * kJoints + kJoints);
  }
  watch.mark(kSteps);
  return outcome;
}

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = std::abs(a[i] - b[i]);
    if (!(d <= most)) most = d;  // NaN too
  }
  return most;
}

double error(const Outcome& a, const Outcome& b) { return distance(a.trajectory, b.trajectory); }

// The equations of the drive train and their state at the start, for solvers of other authors.
class Plain {
 protected:
  explicit Plain(Variant variant)
      : drive_(make("", {}, variant)),
        robot_(robot::load_urdf(kModels / "robots/lwr4/robot.urdf")),
        equations_(&robot_, kJoints, drive_train::LinkSide::kInside, drive_train::Transmission::kFlexible,
                   drive_train::Friction::kLugre),
        point_(kJoints),
        x_(5 * kJoints) {
    drive_train::Parameters& p = equations_.parameters();
    const std::pair<const char*, std::vector<double>*> given[] = {{"K", &p.K},
                                                                  {"B", &p.B},
                                                                  {"D", &p.D},
                                                                  {"sigma0", &p.sigma0},
                                                                  {"sigma1", &p.sigma1},
                                                                  {"sigma2", &p.sigma2},
                                                                  {"tau_C", &p.tau_C},
                                                                  {"tau_S", &p.tau_S},
                                                                  {"v_S", &p.v_S},
                                                                  {"delta", &p.delta},
                                                                  {"link_v_R", &p.link_v_R},
                                                                  {"q_min", &p.q_min},
                                                                  {"q_max", &p.q_max},
                                                                  {"stop_restitution", &p.stop_restitution}};
    for (const auto& [name, to] : given) {
      const auto from = drive_.variables.at(name).reals();
      to->assign(from.begin(), from.end());
    }
    equations_.adopt_parameters();
    int part = 0;
    for (const char* name : {"q", "dq", "theta", "dtheta", "z"}) {
      std::copy_n(drive_.variables.at(name).reals().data(), kJoints, x_.data() + kJoints * part++);
    }
  }

  void rates_at(double t, const double* x, double* dx) {
    equations_.evaluate(x, point_);
    equations_.derivative(t, x, point_, dx);
  }
  // After step n.
  void record(int n, Outcome& outcome) {
    std::copy_n(x_.begin(), kJoints, outcome.trajectory.begin() + n * 2 * kJoints);
    std::copy_n(x_.begin() + 2 * kJoints, kJoints, outcome.trajectory.begin() + n * 2 * kJoints + kJoints);
  }

  Instance drive_;
  robot::RobotModel robot_;
  drive_train::Equations equations_;
  drive_train::Point point_;
  std::vector<double> x_;
};

// The classical explicit Runge-Kutta method of order 4 with sub-steps of equal length.
class RungeKutta : Plain {
 public:
  RungeKutta(Variant variant, int substeps) : Plain(variant), substeps_(substeps) {}
  Outcome run(const std::vector<double>& torques) {
    Outcome outcome;
    Stopwatch watch(outcome.seconds);
    const double h = kTick.seconds() / substeps_;
    std::vector<double> k[4], y(x_.size());
    for (auto& rates : k) rates.resize(x_.size());
    for (int n = 0; n < kSteps; ++n) {
      watch.mark(n);
      std::copy_n(torques.data() + n * kJoints, kJoints, equations_.course().tau_m.data());
      for (int s = 0; s < substeps_; ++s) {
        rates_at(0, x_.data(), k[0].data());
        for (int stage = 1; stage < 4; ++stage) {
          const double share = stage < 3 ? 0.5 * h : h;
          for (std::size_t i = 0; i < x_.size(); ++i) y[i] = x_[i] + share * k[stage - 1][i];
          rates_at(0, y.data(), k[stage].data());
        }
        for (std::size_t i = 0; i < x_.size(); ++i) x_[i] += h / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
      }
      record(n, outcome);
    }
    watch.mark(kSteps);
    return outcome;
  }

 private:
  int substeps_;
};

// CVODE with its dense direct solver.
class Dense : Plain {
 public:
  explicit Dense(Variant variant) : Plain(variant) {
    SUNContext_Create(nullptr, &context_);
    y_ = N_VMake_Serial(5 * kJoints, x_.data(), context_);
    A_ = SUNDenseMatrix(5 * kJoints, 5 * kJoints, context_);
    S_ = SUNLinSol_Dense(y_, A_, context_);
    cvode_ = CVodeCreate(CV_BDF, context_);
    CVodeInit(cvode_, rates, 0, y_);
    CVodeSStolerances(cvode_, 1e-6, 1e-8);
    CVodeSetUserData(cvode_, this);
    CVodeSetLinearSolver(cvode_, S_, A_);
    CVodeSetJacFn(cvode_, jacobian);
  }
  Dense(const Dense&) = delete;
  Dense& operator=(const Dense&) = delete;
  ~Dense() {
    CVodeFree(&cvode_);
    SUNLinSolFree(S_);
    SUNMatDestroy(A_);
    N_VDestroy(y_);
    SUNContext_Free(&context_);
  }

  Outcome run(const std::vector<double>& torques) {
    Outcome outcome;
    Stopwatch watch(outcome.seconds);
    for (int n = 0; n < kSteps; ++n) {
      watch.mark(n);
      std::copy_n(torques.data() + n * kJoints, kJoints, equations_.course().tau_m.data());
      double t = 0;
      CVodeReInit(cvode_, 0, y_);
      CVodeSetStopTime(cvode_, kTick.seconds());
      if (CVode(cvode_, kTick.seconds(), y_, &t, CV_NORMAL) < 0) std::abort();
      record(n, outcome);
    }
    watch.mark(kSteps);
    return outcome;
  }

 private:
  static int rates(realtype t, N_Vector y, N_Vector dy, void* self) {
    static_cast<Dense*>(self)->rates_at(t, N_VGetArrayPointer(y), N_VGetArrayPointer(dy));
    return 0;
  }

  // All but ∂(C q̇ + g), as in the structured solver.
  static int jacobian(realtype, N_Vector y, N_Vector, SUNMatrix A, void* self, N_Vector, N_Vector, N_Vector) {
    Dense& d = *static_cast<Dense*>(self);
    constexpr int n = kJoints;
    d.equations_.evaluate(N_VGetArrayPointer(y), d.point_);
    const drive_train::Point& p = d.point_;
    const drive_train::Parameters& q = d.equations_.parameters();
    const Eigen::Matrix<double, n, n> M_inverse =
        Eigen::Map<const Eigen::Matrix<double, n, n>>(p.M.data()).llt().solve(Eigen::Matrix<double, n, n>::Identity());
    Eigen::Map<Eigen::Matrix<double, 5 * n, 5 * n>> J(SUNDenseMatrix_Data(A));
    J.setZero();
    const auto row = [](const std::vector<double>& v) { return Eigen::Map<const Eigen::Matrix<double, n, 1>>(v.data()); };
    J.block<n, n>(0, n).setIdentity();
    J.block<n, n>(n, 0) = -M_inverse * row(p.kappa).asDiagonal();
    J.block<n, n>(n, n) = -M_inverse * (row(q.D) + row(p.d_l)).asDiagonal();
    J.block<n, n>(n, 2 * n) = M_inverse * row(p.kappa).asDiagonal();
    J.block<n, n>(n, 3 * n) = M_inverse * row(q.D).asDiagonal();
    J.block<n, n>(2 * n, 3 * n).setIdentity();
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const int w = 3 * n + i, z = 4 * n + i;
      J(w, i) = p.kappa[k] / q.B[k];
      J(w, n + i) = q.D[k] / q.B[k];
      J(w, 2 * n + i) = -p.kappa[k] / q.B[k];
      J(w, w) = -(q.D[k] + p.f_w[k]) / q.B[k];
      J(w, z) = -p.f_z[k] / q.B[k];
      J(z, w) = p.z_w[k];
      J(z, z) = p.z_z[k];
    }
    return 0;
  }

  SUNContext context_ = nullptr;
  N_Vector y_ = nullptr;
  SUNMatrix A_ = nullptr;
  SUNLinearSolver S_ = nullptr;
  void* cvode_ = nullptr;
};

// Mean time of a step: for each chunk the median over the repetitions.
double seconds_per_step(const std::vector<std::vector<double>>& repetitions) {
  double sum = 0;
  for (std::size_t chunk = 0; chunk < repetitions[0].size(); ++chunk) {
    std::vector<double> times;
    for (const auto& laps : repetitions) times.push_back(laps[chunk]);
    std::nth_element(times.begin(), times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2), times.end());
    sum += times[times.size() / 2];
  }
  return sum / kSteps;
}

void table(Variant variant, int repetitions) {
  const bool gears = variant == Variant::kStiffGears, friction = variant == Variant::kStiffFriction;
  const std::string suffix = gears ? ", stiff gears" : friction ? ", stiff LuGre" : ", LuGre";
  const Outcome reference = run("&method=cvode", kTight, variant, nullptr);
  struct Method {
    std::string name;
    double goal_us, goal_rad;
    std::function<Outcome()> run;
    std::vector<std::vector<double>> seconds{};
    Outcome last{};
  };
  const auto unit = [&](const std::string& query) {
    return [&reference, variant, query] { return run(query, {}, variant, &reference.torques); };
  };
  const int explicit_substeps = gears ? 64 : 4;  // K = 1e6 N.m/rad needs 20 to be stable
  const std::string peer_name = "explicit Runge-Kutta 4, " + std::to_string(explicit_substeps) + " sub-steps";
  std::vector<Method> methods = {
      {"default (exponential)",
       gears      ? 40.0
       : friction ? 20.0
                  : 5.0,
       friction ? 2e-6 : 1e-6, unit("")},
      {"rosenbrock", 0, 0, unit("&method=rosenbrock")},
      {"cvode, structured", gears ? 0.0 : 50.0, 0, unit("&method=cvode")},
      {"peer: cvode, dense, own Jacobian", 0, 0, [&reference, variant] { return Dense(variant).run(reference.torques); }},
      {peer_name, 0, 0,
       [&reference, variant, explicit_substeps] { return RungeKutta(variant, explicit_substeps).run(reference.torques); }},
  };
  for (int k = 0; k < benchmark::shortened(repetitions, 1); ++k) {
    for (Method& m : methods) {
      m.last = m.run();
      m.seconds.push_back(m.last.seconds);
    }
  }
  const Method& peer = methods.back();
  const double peer_us = seconds_per_step(peer.seconds) * 1e6, peer_error = error(peer.last, reference);
  for (const Method& m : methods) {
    if (&m == &peer || (variant != Variant::kSoft && &m - methods.data() > 1)) continue;  // stiff: default and rosenbrock
    benchmark::print(
        {m.name + suffix + ", per ms", "us", seconds_per_step(m.seconds) * 1e6, peer_name, peer_us, m.goal_us, false});
    benchmark::print(
        {m.name + suffix + ", largest error", "rad", error(m.last, reference), peer_name, peer_error, m.goal_rad, false});
  }
  // Compares the reference with another method at its tightest tolerance, as an estimate of its error.
  const Outcome other =
      run("&method=rosenbrock", {{"rtol", "0"}, {"atol", "1e-13"}, {"atol_speed", "1"}, {"max_substeps", "100000"}}, variant,
          &reference.torques);
  benchmark::print(
      {"reference against rosenbrock with 1e-13 rad" + suffix, "rad", error(other, reference), "", 0, 1e-7, false});
}

}  // namespace
}  // namespace cotwin

int main() {
  cotwin::table(cotwin::Variant::kSoft, 7);
  cotwin::table(cotwin::Variant::kStiffFriction, 7);
  cotwin::table(cotwin::Variant::kStiffGears, 3);
}
