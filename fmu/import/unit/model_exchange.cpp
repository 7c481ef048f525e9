#include "fmu/import/unit/model_exchange.h"

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

constexpr double kDefaultTolerance = 1e-6;     // relative
constexpr double kAbsolutePerNominal = 0.01;   // absolute tolerance / (relative tolerance · nominal value)
constexpr long kMaxInternalSteps = 1'000'000;  // per communication step
constexpr std::size_t kMaxStates = 10'000;     // limit for a dense Jacobian
constexpr int kMaxEventsAtOnce = 1'000;        // at one instant
constexpr double kSteady = 1e-9;               // relative; smaller jumps of inputs are rounding errors

void check(int flag, const char* function) {
  if (flag < 0) throw Error(function, "returned " + std::to_string(flag) + ", expected success");
}

void silent(int, const char*, const char*, char*, void*) {}

bool same_time(double a, double b) { return std::abs(a - b) <= 1e-14 * std::max(1.0, std::abs(b)); }

}  // namespace

// A system without continuous states gets one with zero derivative, so that it needs no code of its own.
struct ModelExchangeUnit::Solver {
  Solver(ModelExchangeUnit& unit, std::size_t states, std::size_t indicators, double tolerance)
      : owner(unit),
        nx(states),
        nz(indicators),
        rtol(tolerance),
        x(std::max<std::size_t>(nx, 1)),
        nominals(x.size(), 1.0),
        atol(x.size()),
        scratch(x.size()),
        columns(x.size()) {
    check(SUNContext_Create(nullptr, &context), "SUNContext_Create");
    const auto n = static_cast<sunindextype>(x.size());
    y = N_VMake_Serial(n, x.data(), context);
    absolute = N_VMake_Serial(n, atol.data(), context);
    matrix = SUNDenseMatrix(n, n, context);
    linear = SUNLinSol_Dense(y, matrix, context);
    memory = CVodeCreate(CV_BDF, context);
    if (y == nullptr || absolute == nullptr || matrix == nullptr || linear == nullptr || memory == nullptr)
      throw Error("CVODE", "cannot be created (out of memory)");
    set_absolute_tolerances();
    check(CVodeInit(memory, right_side, 0, y), "CVodeInit");
    check(CVodeSVtolerances(memory, rtol, absolute), "CVodeSVtolerances");
    check(CVodeSetLinearSolver(memory, linear, matrix), "CVodeSetLinearSolver");
    check(CVodeSetJacFn(memory, jacobian), "CVodeSetJacFn");
    check(CVodeSetUserData(memory, this), "CVodeSetUserData");
    check(CVodeSetErrHandlerFn(memory, silent, nullptr), "CVodeSetErrHandlerFn");
    if (nz > 0) {
      check(CVodeRootInit(memory, static_cast<int>(nz), roots), "CVodeRootInit");
      check(CVodeSetNoInactiveRootWarn(memory), "CVodeSetNoInactiveRootWarn");
    }
  }
  ~Solver() {
    CVodeFree(&memory);
    if (linear != nullptr) SUNLinSolFree(linear);
    if (matrix != nullptr) SUNMatDestroy(matrix);
    if (absolute != nullptr) N_VDestroy(absolute);
    if (y != nullptr) N_VDestroy(y);
    SUNContext_Free(&context);
  }
  Solver(const Solver&) = delete;
  Solver& operator=(const Solver&) = delete;

  std::span<double> states() { return {x.data(), nx}; }
  void set_absolute_tolerances() {
    for (std::size_t i = 0; i < atol.size(); ++i) {
      const double nominal = std::isnormal(nominals[i]) ? std::abs(nominals[i]) : 1;
      atol[i] = kAbsolutePerNominal * rtol * nominal;
    }
  }
  void restart(double t) {
    check(CVodeReInit(memory, t, y), "CVodeReInit");
    check(CVodeSVtolerances(memory, rtol, absolute), "CVodeSVtolerances");
  }

  /// Calls the FMU from a callback of CVODE. An exception is stored and rethrown after CVODE has returned.
  template <class Call>
  int guarded(Call call) noexcept {
    try {
      return call() ? 0 : 1;  // 1: CVODE tries a smaller step
    } catch (...) {
      failure = std::current_exception();
      return -1;
    }
  }
  bool derivatives(double t, const double* at, double* dx) {
    if (nx == 0) {
      dx[0] = 0;
      return true;
    }
    if (owner.ramps_now_) owner.variables_.send_ramped(*owner.instance_, t - owner.step_begin_);
    return owner.instance_->try_derivatives(t, {at, nx}, {dx, nx});
  }

  static int right_side(realtype t, N_Vector at, N_Vector dx, void* data) {
    auto* self = static_cast<Solver*>(data);
    return self->guarded([&] { return self->derivatives(t, N_VGetArrayPointer(at), N_VGetArrayPointer(dx)); });
  }
  static int roots(realtype t, N_Vector at, realtype* z, void* data) {
    auto* self = static_cast<Solver*>(data);
    return self->guarded([&] {
      ModelExchangeUnit& unit = self->owner;
      if (unit.ramps_now_) unit.variables_.send_ramped(*unit.instance_, t - unit.step_begin_);
      return unit.instance_->try_event_indicators(t, {N_VGetArrayPointer(at), self->nx}, {z, self->nz});
    });
  }
  // Own difference quotient, because CVODE's allocates memory in every step.
  static int jacobian(realtype t, N_Vector at, N_Vector dx, SUNMatrix J, void* data, N_Vector, N_Vector, N_Vector) {
    auto* self = static_cast<Solver*>(data);
    return self->guarded([&] {
      const double* x0 = N_VGetArrayPointer(at);
      const double* f0 = N_VGetArrayPointer(dx);
      std::copy_n(x0, self->scratch.size(), self->scratch.begin());
      for (std::size_t j = 0; j < self->scratch.size(); ++j) {
        const double scale = std::max(std::abs(x0[j]), std::abs(self->nominals[j]) > 0 ? std::abs(self->nominals[j]) : 1.0);
        self->scratch[j] = x0[j] + std::sqrt(std::numeric_limits<double>::epsilon()) * scale;
        const double d = self->scratch[j] - x0[j];
        if (!self->derivatives(t, self->scratch.data(), self->columns.data())) return false;
        double* column = SM_COLUMN_D(J, static_cast<sunindextype>(j));
        for (std::size_t i = 0; i < self->scratch.size(); ++i) column[i] = (self->columns[i] - f0[i]) / d;
        self->scratch[j] = x0[j];
      }
      return true;
    });
  }

  ModelExchangeUnit& owner;
  std::size_t nx, nz;
  double rtol;
  std::vector<double> x, nominals, atol, scratch, columns;
  SUNContext context = nullptr;
  N_Vector y = nullptr, absolute = nullptr;
  SUNMatrix matrix = nullptr;
  SUNLinearSolver linear = nullptr;
  void* memory = nullptr;
  std::exception_ptr failure;
};

ModelExchangeUnit::ModelExchangeUnit(std::shared_ptr<const ForeignFmu> fmu, UnitOptions options)
    : ForeignUnit(std::move(fmu), std::move(options), InterfaceKind::kModelExchange) {
  instance_ = make();
}

ModelExchangeUnit::~ModelExchangeUnit() = default;

std::unique_ptr<ForeignInstance> ModelExchangeUnit::make() {
  ForeignOptions options;
  options.kind = InterfaceKind::kModelExchange;
  options.instance_name = options_.instance_name;
  options.may_restore = options_.rollback;
  return make_foreign(*fmu_, std::move(options));
}

void ModelExchangeUnit::make_solver() {
  const std::size_t nx = instance_->states(), nz = instance_->event_indicators();
  if (nx > kMaxStates || nz > kMaxElements) {
    throw Error("the FMU has " + std::to_string(nx) + " states and " + std::to_string(nz) +
                " event indicators, expected at most " + std::to_string(kMaxStates) + " and " + std::to_string(kMaxElements));
  }
  if (!solver_ || solver_->nx != nx || solver_->nz != nz) {
    const std::optional<DefaultExperiment>& experiment = description().default_experiment;
    const std::optional<double> given = options_.tolerance ? options_.tolerance
                                        : experiment       ? experiment->tolerance
                                                           : std::nullopt;
    const double tolerance = given.value_or(kDefaultTolerance);
    if (!(tolerance > 0 && tolerance < 1))
      throw Error("tolerance " + text::to_text(tolerance) + ", expected a number between 0 and 1");
    solver_ = std::make_unique<Solver>(*this, nx, nz, tolerance);
  }
  instance_->get_states(solver_->states());
  instance_->get_nominals({solver_->nominals.data(), nx});
  solver_->set_absolute_tolerances();
}

void ModelExchangeUnit::begin(Time start) {
  note(instance_->update_discrete_states());  // the FMU is in event mode (3.2.1)
  instance_->enter_continuous_time_mode();
  make_solver();
  solver_->restart(start.seconds());
  restart_ = false;
  const std::span<const double> values = variables_.continuous_values();
  last_values_.assign(values.begin(), values.end());
  last_rates_.assign(values.size(), 0.0);
  last_h_ = 0;
}

void ModelExchangeUnit::write_memory(ByteWriter& out) {
  out.value(last_h_);
  for (const double v : last_values_) out.value(v);
  for (const double v : last_rates_) out.value(v);
  restart_ = true;  // as in the unit that reads this, so that both give the same bits
}

void ModelExchangeUnit::read_memory(ByteReader& in) {
  last_h_ = in.value<double>();
  last_values_.resize(variables_.continuous_values().size());
  last_rates_.resize(last_values_.size());
  for (double& v : last_values_) v = in.value<double>();
  for (double& v : last_rates_) v = in.value<double>();
  make_solver();
  restart_ = true;
}

/// Returns whether an input differs from the extrapolation of its last value and rate.
bool ModelExchangeUnit::inputs_jump() const {
  const std::span<const double> values = variables_.continuous_values();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double expected = last_values_[i] + last_rates_[i] * last_h_;
    if (!(std::abs(values[i] - expected) <= kSteady * std::max(std::abs(values[i]), std::abs(expected)))) return true;
  }
  return false;
}

void ModelExchangeUnit::finish_events(double t) {
  const EventOutcome events = instance_->update_discrete_states();
  note(events);
  instance_->enter_continuous_time_mode();
  if (events.states_changed) instance_->get_states(solver_->states());
  if (events.nominals_changed) {
    instance_->get_nominals({solver_->nominals.data(), solver_->nx});
    solver_->set_absolute_tolerances();
  }
  solver_->restart(t);
}

void ModelExchangeUnit::handle_events(double t) {
  instance_->enter_event_mode();
  finish_events(t);
}

bool ModelExchangeUnit::advance(Time now, Duration h) {
  const double begin = now.seconds(), end = (now + h).seconds();
  step_begin_ = begin;
  if (restart_) {  // after a snapshot
    solver_->restart(begin);
    restart_ = false;
  }
  const bool discrete = variables_.changed(Exchange::kDiscreteInput) || variables_.changed(Exchange::kTunable);
  const bool at_event = discrete || inputs_jump();
  if (at_event) instance_->enter_event_mode();
  variables_.send(*instance_, Exchange::kContinuousInput);
  if (at_event) {
    variables_.send(*instance_, Exchange::kDiscreteInput);
    variables_.send(*instance_, Exchange::kTunable);
    finish_events(begin);
  }
  ramps_now_ = variables_.any_rate();
  const std::span<const double> values = variables_.continuous_values(), rates = variables_.rates();
  std::copy(values.begin(), values.end(), last_values_.begin());
  std::copy(rates.begin(), rates.end(), last_rates_.begin());
  last_h_ = h.seconds();

  double t = begin;
  int events_here = 0;
  for (long steps = 0; !finished_; ++steps) {
    while (!finished_ && next_event_ && *next_event_ <= t) {
      if (++events_here > kMaxEventsAtOnce)
        throw Error("more than " + std::to_string(kMaxEventsAtOnce) + " events at " + text::to_text(t) + " s");
      handle_events(t);
    }
    if (finished_ || same_time(t, end) || t >= end) break;
    if (steps > kMaxInternalSteps)
      throw Error("more than " + std::to_string(kMaxInternalSteps) + " internal steps of CVODE after " + text::to_text(begin) +
                  " s");
    const double stop = next_event_ && *next_event_ < end ? *next_event_ : end;
    const double from = t;
    bool root = false;
    if (same_time(t, stop)) {
      t = stop;
    } else {
      check(CVodeSetStopTime(solver_->memory, stop), "CVodeSetStopTime");
      const int flag = CVode(solver_->memory, stop, solver_->y, &t, CV_ONE_STEP);
      if (solver_->failure) std::rethrow_exception(std::exchange(solver_->failure, nullptr));
      if (flag < 0) throw Error("CVODE", "failed at " + text::to_text(t) + " s with code " + std::to_string(flag));
      root = flag == CV_ROOT_RETURN;
    }
    if (same_time(t, stop)) t = stop;
    if (ramps_now_) variables_.send_ramped(*instance_, t - begin);
    instance_->set_time(t);
    instance_->set_states(solver_->states());
    const ForeignInstance::Completed completed = instance_->completed_step();
    commit(t);
    if (completed.terminate) finished_ = true;
    const bool time_event = next_event_ && *next_event_ <= t;
    events_here = t > from ? 0 : events_here + 1;
    if (events_here > kMaxEventsAtOnce)
      throw Error("more than " + std::to_string(kMaxEventsAtOnce) + " events at " + text::to_text(t) + " s");
    if (!finished_ && (root || completed.event || time_event)) handle_events(t);
  }
  return true;
}

}  // namespace cotwin::fmu
