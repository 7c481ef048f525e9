// cotwin.Simulation: a run of a scenario.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cmath>
#include <tuple>
#include <type_traits>

#include "master/python/arrays.h"
#include "master/python/bindings.h"
#include "master/python/calls.h"
#include "master/python/faults.h"

namespace cotwin::python {

namespace {

using namespace py::literals;
namespace fs = std::filesystem;

/// A run, used by one thread at a time and only in the process that made it.
class PySimulation {
 public:
  PySimulation(const fs::path& file, const std::optional<ScenarioText>& text, SimulationOptions options,
               const std::vector<std::tuple<std::string, std::string, py::object>>& units) {
    for (const auto& [name, summary, make] : units) options.program_units.push_back(unit_type(name, summary, make, failure_));
    without_gil([&] {
      if (text)
        simulation_.emplace(*text, options);
      else
        simulation_.emplace(file, options);
    });
  }
  PySimulation(const PySimulation&) = delete;
  PySimulation& operator=(const PySimulation&) = delete;
  ~PySimulation() {
    if (process_ != getpid()) {
      // Its threads are in the other process: there is nothing to wait for, and their memory stays.
      static_cast<void>(new std::optional<Simulation>(std::move(simulation_)));
      return;
    }
    const py::gil_scoped_release no_gil;  // a unit in Python may be in a step beside the loop
    simulation_.reset();
  }

  /// `use(simulation)` without the GIL.
  template <class Use>
  auto call(Use use) -> std::invoke_result_t<Use, Simulation&> {
    return without_gil([&] { return use(*simulation_); });
  }
  /// The same with the GIL, for what is quick and runs no unit.
  template <class Use>
  auto look(Use use) -> std::invoke_result_t<Use, Simulation&> {
    const std::unique_lock turn = lock_turn();
    return use(*simulation_);
  }
  /// The same for a variable: errors are UnknownName if there is no such variable, otherwise BadValue.
  template <class Use>
  auto look_at(const std::string& name, Use use) -> std::invoke_result_t<Use, Simulation&> {
    try {
      return look(use);
    } catch (const Error& error) {
      const std::string whole = name.substr(0, name.find('['));
      for (const VariableInfo& v : look([](Simulation& one) { return one.variables(); }))
        if (v.name == whole) throw BadValue(error.what());
      throw UnknownName(error.what());
    }
  }
  /// Calls advance(simulation) until it returns false, or until a signal's handler raises.
  template <class Advance>
  void run(Advance advance) {
    Signals signals;
    call([&](Simulation& s) {
      while (!signals.pending() && advance(s)) {
      }
    });
    signals.raise();
  }

 private:
  template <class Body>
  auto without_gil(Body body) -> std::invoke_result_t<Body> {
    const std::unique_lock turn = lock_turn();
    failure_.forget();
    try {
      const py::gil_scoped_release no_gil;
      return body();
    } catch (const Error& error) {
      failure_.raise(error.what());
      throw;
    }
  }
  std::unique_lock<std::mutex> lock_turn() {
    if (process_ != getpid())
      throw Error("Simulation", "was made in another process, expected one that is made after the fork");
    std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock.owns_lock())
      throw Error("Simulation",
                  "is in use by another thread, or is used by a unit of its own step, expected one use at a time");
    return lock;
  }

  const pid_t process_ = getpid();
  std::mutex mutex_;
  UnitFailure failure_;  // outlives the units
  std::optional<Simulation> simulation_;
};

std::unique_ptr<PySimulation> make(const std::optional<fs::path>& file, const std::optional<std::string>& xml,
                                   const std::string& name, const fs::path& folder, const std::vector<std::string>& set,
                                   std::optional<double> stop, const std::optional<fs::path>& results,
                                   const std::vector<fs::path>& modules, const std::vector<fs::path>& folders,
                                   std::optional<int> threads,
                                   const std::vector<std::tuple<std::string, std::string, py::object>>& units, bool keep_rows) {
  SimulationOptions options;
  options.set = set;
  options.stop = stop;
  options.results = results.value_or(fs::path());
  options.units = modules;
  options.folders = folders;
  options.threads = threads;
  options.keep_rows = keep_rows;
  std::optional<ScenarioText> text;
  if (xml) text = ScenarioText{*xml, name, folder};
  return std::make_unique<PySimulation>(file.value_or(fs::path()), text, std::move(options), units);
}

void set(PySimulation& s, const std::string& name, py::handle value) {
  if (py::isinstance<py::str>(value)) {
    const auto text = py::cast<std::string>(value);
    s.look_at(name, [&](Simulation& one) { one.set_text(name, text); });
    return;
  }
  refuse_mask(value, name.c_str());
  if (py::isinstance<py::array>(value) && py::cast<py::array>(value).dtype().kind() == 'c')
    throw BadValue(name, "has complex numbers, expected real ones");
  const py::array values =
      py::isinstance<py::array>(value) && !py::cast<py::array>(value).dtype().equal(py::dtype::of<double>()) &&
              std::string_view("iu").find(py::cast<py::array>(value).dtype().kind()) == std::string_view::npos
          ? py::array(py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(value))
          : real_array(value, name.c_str());
  if (!values) throw BadValue(name, "expected numbers");
  if (values.ndim() > 1) throw BadValue(name, "has the shape " + text_of(shape_of(values)) + ", expected one dimension");
  s.look_at(name, [&](Simulation& one) { one.set(name, read(values)); });
}

py::object get(PySimulation& s, const std::string& name) {
  const std::vector<double> values = s.look_at(name, [&](Simulation& one) { return one.get(name); });
  return array_of(values, {static_cast<py::ssize_t>(values.size())});
}

/// A read-only array on the memory of a variable, which keeps the simulation alive.
py::array view(const py::object& self, const std::string& name) {
  auto& s = py::cast<PySimulation&>(self);
  const std::span<const double> values = s.look_at(name, [&](Simulation& one) { return one.view(name); });
  py::array array(py::dtype::of<double>(), Shape{static_cast<py::ssize_t>(values.size())}, Shape{}, values.data(), self);
  array.attr("setflags")("write"_a = false);
  return array;
}

}  // namespace

void bind_simulation(py::module_& m) {
  py::class_<VariableInfo>(m, "Variable", "A variable of a component.")
      .def_readonly("name", &VariableInfo::name, "\"drive.tau_J\"")
      .def_readonly("role", &VariableInfo::role, "\"input\", \"output\", \"parameter\", \"tunable\" or \"state\"")
      .def_readonly("kind", &VariableInfo::kind, "\"real\", \"integer\", \"boolean\" or \"string\"")
      .def_readonly("si", &VariableInfo::si, "Unit of measure of a real variable, \"N.m\".")
      .def_readonly("size", &VariableInfo::size, "Number of elements.")
      .def_readonly("description", &VariableInfo::description, "Meaning, in a sentence.")
      .def_readonly("units", &VariableInfo::units, "Units of measure of elements that differ; else empty.")
      .def("__repr__", [](const VariableInfo& v) {
        std::string si = v.si;
        for (const std::string& unit : v.units) si += (si.empty() ? "" : ", ") + unit;
        return "<" + v.role + " " + v.name + "[" + std::to_string(v.size) + "], " + si + ": " + v.description + ">";
      });
  py::class_<Figure>(m, "Figure", "RMS and largest magnitude of a signal, over all ticks of a run.")
      .def_readonly("name", &Figure::name, "Name in the scenario's report.")
      .def_readonly("signal", &Figure::signal, "\"drive.tau_J\", \"drive.q - motion.q_d\"")
      .def_readonly("si", &Figure::si, "Unit of measure.")
      .def_property_readonly(
          "rms", [](const Figure& f) { return array_of(f.rms, {static_cast<py::ssize_t>(f.rms.size())}); },
          "RMS of each element.")
      .def_property_readonly(
          "max", [](const Figure& f) { return array_of(f.max, {static_cast<py::ssize_t>(f.max.size())}); },
          "Largest magnitude of each element.")
      .def_readonly("total_rms", &Figure::total_rms, "RMS of all elements together; nan where their units of measure differ.")
      .def_readonly("total_max", &Figure::total_max,
                    "Largest magnitude of all elements; nan where their units of measure differ.")
      .def_readonly("units", &Figure::units, "Units of measure of elements that differ; else empty.")
      .def("__repr__", [](const Figure& f) {
        if (!f.units.empty()) return "<" + f.name + ": of elements in different units of measure>";
        return "<" + f.name + ": RMS " + std::to_string(f.total_rms) + " " + f.si + ", max " + std::to_string(f.total_max) +
               ">";
      });
  py::class_<RunResult>(m, "RunResult", "What a run was like.")
      .def_readonly("start", &RunResult::start, "Start time, s.")
      .def_readonly("reached", &RunResult::reached, "Time at which the run ended, s.")
      .def_readonly("stop", &RunResult::stop, "Stop time of the scenario, s.")
      .def_readonly("ticks", &RunResult::ticks, "Steps of the master.")
      .def_readonly("wall_seconds", &RunResult::wall_seconds, "Duration of the run, s.")
      .def_readonly("figures", &RunResult::figures, "What the scenario reports.")
      .def_readonly("warnings", &RunResult::warnings, "Sentences, each once.")
      .def_property_readonly(
          "recording_file",
          [](const RunResult& r) { return r.recording.empty() ? py::none() : py::object(py::cast(r.recording)); },
          "signals.csv, or None.")
      .def_readonly("rows", &RunResult::rows, "Rows of signals.csv.")
      .def("__repr__", [](const RunResult& r) {
        return "<run to " + std::to_string(r.reached) + " s in " + std::to_string(r.ticks) + " ticks>";
      });

  py::class_<PySimulation>(m, "Simulation")
      .def(py::init(&make), py::kw_only(), "file"_a, "xml"_a, "name"_a, "folder"_a, "set"_a, "stop"_a, "results"_a, "modules"_a,
           "folders"_a, "threads"_a, "units"_a, "keep_rows"_a)
      .def(
          "variables", [](PySimulation& s) { return s.look([](Simulation& one) { return one.variables(); }); },
          "All variables of all components.")
      .def(
          "set", &set, "name"_a, "value"_a,
          "Sets a variable, \"drive.tau_e\", or one element, \"drive.tau_e[2]\", counted from 1, in its unit of measure.\n\n"
          "value: a number, a vector with one number per element, or a text. Before start(): parameters, tunables, inputs and\n"
          "states that have a start value. Later: tunables, and inputs that no connection feeds; it holds from the next step "
          "on.")
      .def("get", &get, "name"_a,
           "Values of a real, integer or boolean variable, or of one element, as a new array (size,) of float64.")
      .def(
          "get_text",
          [](PySimulation& s, const std::string& name) {
            return s.look_at(name, [&](Simulation& one) { return one.get_text(name); });
          },
          "name"_a, "The value of a string variable of size 1.")
      .def("view", &view, "name"_a,
           "A read-only array (size,) on the memory of a real variable: after each step it has the present values, without a\n"
           "look-up and a copy.")
      .def(
          "start", [](PySimulation& s) { s.call([](Simulation& one) { one.start(); }); },
          "Initialises all components and opens the recording. step(), run_to() and run() do it if need be.")
      .def(
          "step", [](PySimulation& s) { return s.call([](Simulation& one) { return one.step(); }); },
          "Steps by one tick. False, and nothing is done, at the end of the run.\n\n"
          "With a clock it waits for its tick; after 0.1 s or a signal it returns True without one.")
      .def(
          "run_to",
          [](PySimulation& s, double t) {
            if (!std::isfinite(t)) throw Error("run_to", "t is not finite, expected a time in seconds");
            bool goes_on = true;
            s.run([&](Simulation& one) { return one.time() < t && (goes_on = one.step()); });
            return goes_on;
          },
          "t"_a, "Steps until time is t (s) or, between two ticks, the next tick. False if the run ended before.")
      .def(
          "_run", [](PySimulation& s) { s.run([](Simulation& one) { return one.step(); }); }, "Steps to the end of the run.")
      .def(
          "finish", [](PySimulation& s) { s.call([](Simulation& one) { one.finish(); }); },
          "Ends the run at the present time and closes the recording. Later steps do nothing.")
      .def(
          "result", [](PySimulation& s) { return s.call([](Simulation& one) { return one.result(); }); }, "The run so far.")
      .def("_recording", [](PySimulation& s) { return s.call([](Simulation& one) { return one.recording(); }); })
      .def_property_readonly(
          "time", [](PySimulation& s) { return s.look([](Simulation& one) { return one.time(); }); }, "Present time, s.")
      .def_property_readonly(
          "stop", [](PySimulation& s) { return s.look([](Simulation& one) { return one.stop(); }); },
          "Stop time of the scenario, s.");
}

}  // namespace cotwin::python
