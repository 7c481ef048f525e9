// Recordings, tuning, exciting motions and services.
#include <pybind11/functional.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "master/python/arrays.h"
#include "master/python/bindings.h"
#include "master/python/calls.h"

namespace cotwin::python {

namespace {

using namespace py::literals;
namespace fs = std::filesystem;

py::array table(const Recording& r) {
  return array_of(r.values, {static_cast<py::ssize_t>(r.rows), static_cast<py::ssize_t>(r.names.size())});
}

py::array vector_of(const std::vector<double>& values) { return array_of(values, {static_cast<py::ssize_t>(values.size())}); }

/// `call` without the GIL; afterwards throws what a callback or the handler of a signal has raised.
template <class Call>
auto without_gil(Signals& signals, Call call) {
  using Result = decltype(call());
  std::optional<Result> result;
  try {
    const py::gil_scoped_release no_gil;
    result.emplace(call());
  } catch (const Error&) {
    signals.raise();
    throw;
  }
  signals.raise();
  return std::move(*result);
}

/// Calls a callback of Python. False if it returned False or raised; its exception is kept for the end of the call.
template <class... Arguments>
bool ask_on(Signals& signals, const py::object& callback, Arguments&&... arguments) {
  const py::gil_scoped_acquire gil;
  try {
    return callback(std::forward<Arguments>(arguments)...).ptr() != Py_False;
  } catch (py::error_already_set& error) {
    error.restore();
    signals.keep_error();
    return false;
  }
}

TuneResult tune_it(TuneOptions options, const py::object& progress) {
  Signals signals;
  std::atomic<bool> ended{false};
  if (!progress.is_none()) {
    options.progress = [&](const std::string& what, double share) {
      if (!ended && !ask_on(signals, progress, what, share)) ended = true;
    };
  }
  options.stop = [&] { return ended || signals.pending(); };
  return without_gil(signals, [&] { return tune(options); });
}

ExcitingMotion excite_it(ExciteOptions options, const py::object& progress) {
  Signals signals;
  options.progress = [&](int round) { return !signals.pending() && (progress.is_none() || ask_on(signals, progress, round)); };
  return without_gil(signals, [&] { return excite(options); });
}

std::string ask_it(const std::string& request, const std::string& robot, const std::vector<fs::path>& robots, int threads,
                   const py::object& progress) {
  Signals signals;
  AskOptions options;
  options.robot = robot;
  options.robots = robots;
  options.threads = threads;
  options.progress = [&](double share, const std::string& message) {
    return !signals.pending() && (progress.is_none() || ask_on(signals, progress, share, message));
  };
  return without_gil(signals, [&] { return ask(request, options); });
}

}  // namespace

void bind_tools(py::module_& m) {
  py::class_<Recording>(m, "Table")
      .def_readonly("names", &Recording::names)
      .def_readonly("units", &Recording::units)
      .def_readonly("joints", &Recording::joints)
      .def_property_readonly("values", &table)
      .def_readonly("cut", &Recording::cut);
  m.def("load_table", &load_recording, "file"_a, "t_column"_a = "", "t_unit"_a = 1.0, "topic"_a = "",
        py::call_guard<py::gil_scoped_release>());

  py::class_<TuneOptions>(m, "TuneOptions")
      .def(py::init<>())
      .def_readwrite("robot", &TuneOptions::robot)
      .def_readwrite("data", &TuneOptions::data)
      .def_readwrite("held_out", &TuneOptions::held_out)
      .def_readwrite("out", &TuneOptions::out)
      .def_readwrite("method", &TuneOptions::method)
      .def_readwrite("friction", &TuneOptions::friction)
      .def_readwrite("motor_torques", &TuneOptions::motor_torques)
      .def_readwrite("cross_validate", &TuneOptions::cross_validate)
      .def_readwrite("split", &TuneOptions::split)
      .def_readwrite("cutoff", &TuneOptions::cutoff)
      .def_readwrite("prior_weight", &TuneOptions::prior_weight)
      .def_readwrite("seed", &TuneOptions::seed)
      .def_readwrite("rounds", &TuneOptions::rounds)
      .def_readwrite("threads", &TuneOptions::threads)
      .def_readwrite("q_columns", &TuneOptions::q_columns)
      .def_readwrite("dq_columns", &TuneOptions::dq_columns)
      .def_readwrite("tau_columns", &TuneOptions::tau_columns);
  py::class_<TunedParameter>(m, "TunedParameter", "A parameter of unit:drive_train.")
      .def_readonly("name", &TunedParameter::name, "With the joint, counted from 1: \"tau_C[2]\".")
      .def_readonly("value", &TunedParameter::value, "In the unit of measure si.")
      .def_readonly("si", &TunedParameter::si, "Unit of measure, \"N.m\".")
      .def("__repr__", [](const TunedParameter& p) { return p.name + " = " + std::to_string(p.value) + " " + p.si; });
  py::class_<TuneResult>(m, "TuneResult", "What a tuning found.")
      .def_readonly("robot", &TuneResult::robot, "URDF with physically consistent inertias.")
      .def_readonly("drive_train", &TuneResult::drive_train, ".ssv with the parameters of the drives.")
      .def_readonly("report", &TuneResult::report, "report.md")
      .def_readonly("parameters", &TuneResult::parameters, "Parameters of the drives.")
      .def_property_readonly(
          "training_rms", [](const TuneResult& r) { return vector_of(r.training_rms); },
          "(n,), N.m or N: error of the predicted torques on the training part.")
      .def_property_readonly(
          "held_out_rms", [](const TuneResult& r) { return vector_of(r.held_out_rms); },
          "(n,), N.m or N: on the held-out part; empty if there is none.")
      .def_property_readonly(
          "prior_held_out_rms", [](const TuneResult& r) { return vector_of(r.prior_held_out_rms); },
          "(n,), N.m or N: of the URDF as it was given.")
      .def_readonly("warnings", &TuneResult::warnings, "Of robot, logs, motion and result.")
      .def_readonly("verdicts", &TuneResult::verdicts, "A sentence per joint.")
      .def_readonly("alarms", &TuneResult::alarms, "What is wrong with the log, and joints that are predicted badly.")
      .def_readonly("interrupted", &TuneResult::interrupted, "Whether the progress function ended the search.");
  m.def("tune", &tune_it, "options"_a, "progress"_a);

  py::class_<ExciteOptions>(m, "ExciteOptions")
      .def(py::init<>())
      .def_readwrite("robot", &ExciteOptions::robot)
      .def_readwrite("period", &ExciteOptions::period)
      .def_readwrite("periods", &ExciteOptions::periods)
      .def_readwrite("rate", &ExciteOptions::rate)
      .def_readwrite("harmonics", &ExciteOptions::harmonics)
      .def_readwrite("share", &ExciteOptions::share)
      .def_readwrite("ddq_max", &ExciteOptions::ddq_max)
      .def_readwrite("dq_max", &ExciteOptions::dq_max)
      .def_readwrite("q_min", &ExciteOptions::q_min)
      .def_readwrite("q_max", &ExciteOptions::q_max)
      .def_readwrite("criterion", &ExciteOptions::criterion)
      .def_readwrite("seed", &ExciteOptions::seed)
      .def_readwrite("rounds", &ExciteOptions::rounds)
      .def_readwrite("particles", &ExciteOptions::particles)
      .def_readwrite("threads", &ExciteOptions::threads);
  const auto samples = [](std::vector<double> ExcitingMotion::*member) {
    return [member](const ExcitingMotion& e) {
      return array_of(e.*member, {static_cast<py::ssize_t>(e.t.size()), static_cast<py::ssize_t>(e.joints)});
    };
  };
  py::class_<ExcitingMotion>(m, "ExcitingMotion", "A sampled Fourier series, at rest at both ends of each period.")
      .def_property_readonly(
          "t", [](const ExcitingMotion& e) { return vector_of(e.t); }, "(samples,), s.")
      .def_property_readonly("q", samples(&ExcitingMotion::q), "(samples, n), rad or m.")
      .def_property_readonly("dq", samples(&ExcitingMotion::dq), "(samples, n), rad/s or m/s.")
      .def_property_readonly("ddq", samples(&ExcitingMotion::ddq), "(samples, n), rad/s^2 or m/s^2.")
      .def_readonly("condition", &ExcitingMotion::condition,
                    "Condition number of the base regressor with columns of unit length.")
      .def_readonly("excited", &ExcitingMotion::excited, "Number of base parameters that the motion excites.")
      .def_readonly("base", &ExcitingMotion::base, "Number of all base parameters.")
      .def_readonly("warnings", &ExcitingMotion::warnings, "Of the robot.");
  m.def("excite", &excite_it, "options"_a, "progress"_a);

  m.def("service_names", &service_names, "The names of the services.");
  m.def("unit_names", &unit_names, "The names of the units of Cotwin.");
  m.def("service_schema", &service_schema, "service"_a);
  m.def("ask", &ask_it, "request"_a, "robot"_a, "robots"_a, "threads"_a, "progress"_a);
}

}  // namespace cotwin::python
