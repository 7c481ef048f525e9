#include "components/drive_train/cvode_solver.h"

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sundials/sundials_linearsolver.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "components/drive_train/events.h"
#include "models/foundation/support/error.h"

namespace cotwin::drive_train {
namespace {

constexpr double kNoTolerance = 1e30;       // of rows without influence on the step size
constexpr double kContinuous = 1e-9;        // relative jump of an input; smaller jumps are rounding
constexpr double kAtRoot = 1e-9;            // rad/s, N.m or rad: smaller event functions are at their zero
constexpr long kMostInternalSteps = 20000;  // per communication step; then the step fails

void check(int flag, const char* function) {
  if (flag < 0) throw Error(function, "returned " + std::to_string(flag) + ", expected success");
}

void silent(int, const char*, const char*, char*, void*) {}

// Two vector operations that take half of SUNDIALS' time for vectors this short, as loops that the compiler can vectorise.
void linear_sum(realtype a, N_Vector x, realtype b, N_Vector y, N_Vector z) {
  const double *px = NV_DATA_S(x), *py = NV_DATA_S(y);
  double* pz = NV_DATA_S(z);
  const auto n = static_cast<std::size_t>(NV_LENGTH_S(x));
  for (std::size_t i = 0; i < n; ++i) pz[i] = a * px[i] + b * py[i];
}

realtype weighted_rms(N_Vector x, N_Vector w) {
  const double *px = NV_DATA_S(x), *pw = NV_DATA_S(w);
  const auto n = static_cast<std::size_t>(NV_LENGTH_S(x));
  double sums[4] = {};
  std::size_t i = 0;
  for (; i + 4 <= n; i += 4) {
    for (std::size_t k = 0; k < 4; ++k) sums[k] += px[i + k] * pw[i + k] * (px[i + k] * pw[i + k]);
  }
  for (; i < n; ++i) sums[0] += px[i] * pw[i] * (px[i] * pw[i]);
  return std::sqrt((sums[0] + sums[1] + (sums[2] + sums[3])) / static_cast<double>(n));
}

}  // namespace

// Two rows after x: the dissipated energy, and the work −∫ τ_J q̇ dt of a link outside.
struct CvodeSolver::Memory {
  explicit Memory(Equations& e)
      : equations(e), y_storage(e.size() + 2), x(e.size()), k(e.size()), point(e.n()), absolute_storage(e.size() + 2) {
    check(SUNContext_Create(nullptr, &context), "SUNContext_Create");
    const auto length = static_cast<sunindextype>(y_storage.size());
    y = N_VMake_Serial(length, y_storage.data(), context);
    y->ops->nvlinearsum = linear_sum;
    y->ops->nvwrmsnorm = weighted_rms;
    absolute = N_VMake_Serial(length, absolute_storage.data(), context);
    std::fill(absolute_storage.begin(), absolute_storage.end(), 1.0);
    linear = SUNLinSolNewEmpty(context);
    linear->content = this;
    linear->ops->gettype = [](SUNLinearSolver) { return SUNLINEARSOLVER_MATRIX_EMBEDDED; };
    linear->ops->solve = [](SUNLinearSolver S, SUNMatrix, N_Vector v, N_Vector b, realtype) {
      return static_cast<Memory*>(S->content)->solve(N_VGetArrayPointer(b), N_VGetArrayPointer(v));
    };
    solver = CVodeCreate(CV_BDF, context);
    check(CVodeInit(solver, right_side, 0, y), "CVodeInit");
    check(CVodeSVtolerances(solver, 1e-6, absolute), "CVodeSVtolerances");
    check(CVodeSetUserData(solver, this), "CVodeSetUserData");
    check(CVodeSetErrHandlerFn(solver, silent, nullptr), "CVodeSetErrHandlerFn");
    check(CVodeSetLinearSolver(solver, linear, nullptr), "CVodeSetLinearSolver");
    check(CVodeSetMaxNumSteps(solver, kMostInternalSteps), "CVodeSetMaxNumSteps");
  }
  ~Memory() {
    CVodeFree(&solver);
    SUNLinSolFreeEmpty(linear);
    N_VDestroy(absolute);
    N_VDestroy(y);
    SUNContext_Free(&context);
  }

  // Evaluates the forces at (time, state) into `point`.
  const double* evaluate(double time, const double* state) {
    if (!equations.inside()) {
      std::copy_n(state, equations.size(), x.data());
      equations.prescribe(time - step_start, x.data());
      state = x.data();
    }
    equations.evaluate(state, point);
    return state;
  }

  static int right_side(realtype time, N_Vector y, N_Vector dy, void* user) {
    Memory& self = *static_cast<Memory*>(user);
    Equations& e = self.equations;
    const double* state = self.evaluate(time, N_VGetArrayPointer(y));
    double* rates = N_VGetArrayPointer(dy);
    e.derivative(time - self.step_start, state, self.point, rates);
    double* account = rates + e.size();
    account[0] = e.dissipation(state, self.point);
    account[1] = 0;
    for (std::size_t i = 0; i < e.n() && !e.inside(); ++i) account[1] -= self.point.tau_J[i] * state[e.n() + i];
    return std::isfinite(account[0]) ? 0 : 1;  // 1: recoverable, with a shorter step
  }

  static int root_functions(realtype time, N_Vector y, realtype* values, void* user) {
    Memory& self = *static_cast<Memory*>(user);
    const Equations& e = self.equations;
    event_values(e, time - self.step_start, N_VGetArrayPointer(y), values);
    return 0;
  }

  // Solves (I − γ J) v = b. In Newton's first iteration of a step, `point` still holds the forces at the predicted state: W is
  // factorised there once per step and used for the other iterations.
  int solve(const double* b, double* v) {
    const std::size_t n = equations.n(), size = equations.size();
    realtype time = 0, gamma = 0, rl1 = 0;
    N_Vector a1 = nullptr, a2 = nullptr, a3 = nullptr, a4 = nullptr;
    void* user = nullptr;
    if (CVodeGetNonlinearSystemData(solver, &time, &a1, &a2, &a3, &gamma, &rl1, &a4, &user) != 0) return -1;
    if (time != factored_time || gamma != factored_gamma) {
      equations.factorise(point, gamma);
      factor_point_M = point.M;
      factored_time = time;
      factored_gamma = gamma;
    }
    std::copy_n(b, size, k.data());
    if (equations.inside()) equations.times_M(factor_point_M.data(), b + n, k.data() + n);
    for (std::size_t i = 0; i < n; ++i) k[3 * n + i] *= equations.parameters().B[i];
    equations.solve(k.data(), v);
    if (!equations.inside()) std::fill_n(v, 2 * n, 0.0);
    v[size] = b[size];
    v[size + 1] = b[size + 1];
    return 0;
  }

  Equations& equations;
  SUNContext context = nullptr;
  std::vector<double> y_storage, x, k;
  Point point;
  std::vector<double> absolute_storage;
  std::vector<double> factor_point_M;
  double factored_time = NAN, factored_gamma = NAN;
  double now = 0;         // s since the last restart
  double step_start = 0;  // s, at which the course has t = 0
  N_Vector y = nullptr, absolute = nullptr;
  SUNLinearSolver linear = nullptr;
  void* solver = nullptr;
};

CvodeSolver::Log::Log(std::size_t n) : x(5 * n), modes(n), steps(kLogLength * (1 + 8 * n)) {}

CvodeSolver::CvodeSolver(Equations& equations)
    : equations_(equations),
      log_(equations.n()),
      end_(equations.n()),
      begin_(equations.n()),
      x_before_(equations.size()),
      x_replayed_(equations.size()),
      events_(2 * equations.n()),
      memory_(std::make_unique<Memory>(equations)) {
  memory_->factor_point_M.resize(equations.n() * equations.n());
}

CvodeSolver::~CvodeSolver() = default;

void CvodeSolver::configure(const Tolerances& t) {
  const std::size_t n = equations_.n();
  double* a = memory_->absolute_storage.data();
  std::fill_n(a, 5 * n, kNoTolerance);
  if (equations_.inside()) {
    std::fill_n(a, n, t.angle);
    std::fill_n(a + n, n, t.speed);
  }
  if (equations_.flexible()) {
    std::fill_n(a + 2 * n, n, t.angle);
    std::fill_n(a + 3 * n, n, t.speed);
  }
  std::fill_n(a + 5 * n, 2, kNoTolerance);
  const int events = static_cast<int>(event_count(equations_));
  check(CVodeRootInit(memory_->solver, events, events > 0 ? Memory::root_functions : nullptr), "CVodeRootInit");
  check(CVodeSVtolerances(memory_->solver, t.relative, memory_->absolute), "CVodeSVtolerances");
}

void CvodeSolver::restart(const double* x) {
  Memory& m = *memory_;
  std::copy_n(x, equations_.size(), m.y_storage.data());
  m.y_storage[equations_.size()] = m.y_storage[equations_.size() + 1] = 0;
  m.factored_time = NAN;
  check(CVodeReInit(m.solver, m.now, m.y), "CVodeReInit");
}

// Returns whether the course begins at the end of the last course in the log.
bool CvodeSolver::continues() const {
  if (log_.count == 0 || static_cast<std::size_t>(log_.count) == kLogLength) return false;
  const std::size_t n = equations_.n();
  const double* last = log_.steps.data() + static_cast<std::size_t>(log_.count - 1) * (1 + 8 * n);
  const double h = last[0];
  const Course& c = equations_.course();
  const auto near = [](double a, double b) { return std::abs(a - b) <= kContinuous * (1 + std::abs(a)); };
  for (std::size_t i = 0; i < n; ++i) {
    const double *u = last + 1 + i, *link = last + 1 + 4 * n + i;
    if (!near(c.tau_m[i], u[0] + u[n] * h) || !near(c.tau_e[i], u[2 * n] + u[3 * n] * h)) return false;
    if (!equations_.inside()) {
      if (!near(c.link[i], link[0] + h * (link[n] + h * (link[2 * n] + h * link[3 * n])))) return false;
      if (!near(c.link[n + i], link[n] + h * (2 * link[2 * n] + h * 3 * link[3 * n]))) return false;
    }
  }
  return true;
}

bool CvodeSolver::step(double h, double* x, StepAccount& account) {
  const std::size_t n = equations_.n();
  equations_.prescribe(0, x);
  if (!continues()) {
    std::copy_n(x, equations_.size(), log_.x.data());
    log_.modes = equations_.modes();
    log_.count = 0;
    memory_->now = 0;
  }
  double* entry = log_.steps.data() + static_cast<std::size_t>(log_.count) * (1 + 8 * n);
  const Course& c = equations_.course();
  *entry++ = h;
  for (const auto* part : {&c.tau_m, &c.dtau_m, &c.tau_e, &c.dtau_e, &c.link})
    entry = std::copy(part->begin(), part->end(), entry);
  const bool first = log_.count++ == 0;
  if (first) restart(x);
  if (advance(h, x, account)) return true;
  log_.count = 0;
  return false;
}

void CvodeSolver::replay() {
  if (log_.count == 0) return;
  if (log_.count < 0 || static_cast<std::size_t>(log_.count) > kLogLength) {
    throw Error("log_count", "is " + std::to_string(log_.count) + ", expected 0 to " + std::to_string(kLogLength));
  }
  const std::size_t n = equations_.n();
  double* x = x_replayed_.data();
  std::copy(log_.x.begin(), log_.x.end(), x);
  equations_.modes() = log_.modes;
  memory_->now = 0;
  restart(x);
  StepAccount ignored;
  Course& c = equations_.course();
  for (std::size_t s = 0; s < static_cast<std::size_t>(log_.count); ++s) {
    const double* entry = log_.steps.data() + s * (1 + 8 * n);
    const double h = *entry++;
    for (auto* part : {&c.tau_m, &c.dtau_m, &c.tau_e, &c.dtau_e, &c.link}) {
      std::copy_n(entry, part->size(), part->begin());
      entry += part->size();
    }
    if (!advance(h, x, ignored))
      throw Error("drive_train", "the steps of the snapshot cannot be replayed, expected a snapshot of this build");
  }
}

bool CvodeSolver::advance(double h, double* x, StepAccount& account) {
  Memory& m = *memory_;
  const std::size_t size = equations_.size();
  m.step_start = m.now;
  const double goal = m.now + h;
  // The solver has its own copy of the state; x is that copy with the link motion of the course.
  const auto show = [&](double time) {
    std::copy_n(m.y_storage.data(), size, x);
    equations_.prescribe(time - m.step_start, x);
  };
  if (settle_modes(equations_, x, false)) restart(x);
  check(CVodeSetStopTime(m.solver, goal), "CVodeSetStopTime");
  double dissipated = m.y_storage[size], work_e = m.y_storage[size + 1];
  for (long steps = 0; m.now < goal; ++steps) {
    if (steps >= kMostInternalSteps) return false;
    std::copy_n(x, size, x_before_.data());
    double time = m.now;
    const int flag = CVode(m.solver, goal, m.y, &time, CV_ONE_STEP);
    if (flag < 0) return false;
    show(time);
    add_torque_work(equations_, m.now - m.step_start, time - m.now, x_before_.data(), x, account);
    account.dissipated += m.y_storage[size] - dissipated;
    account.work_e += m.y_storage[size + 1] - work_e;
    m.now = time;
    ++account.substeps;
    // The found roots are the event functions that are no longer positive. This also finds a mode that began at its zero and
    // became negative, without a change of sign.
    bool event = false;
    const std::size_t count = event_count(equations_);
    if (count > 0) event_values(equations_, time - m.step_start, x, events_.data());
    const bool root = flag == CV_ROOT_RETURN;
    for (std::size_t i = 0; i < count; ++i) {
      if (events_[i] > (root ? kAtRoot : -kAtRoot)) continue;
      apply_event(equations_, i, time - m.step_start, x);
      event = true;
      ++account.events;
    }
    if (event) {
      restart(x);
      if (m.now < goal) check(CVodeSetStopTime(m.solver, goal), "CVodeSetStopTime");
    }
    dissipated = m.y_storage[size];
    work_e = m.y_storage[size + 1];
  }
  m.now = goal;
  m.evaluate(m.now, m.y_storage.data());
  std::swap(m.point, end_);
  m.factored_time = NAN;  // `point` was swapped
  return true;
}

}  // namespace cotwin::drive_train
