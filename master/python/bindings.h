#pragma once
#include <pybind11/pybind11.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "master/api/cotwin.h"

/// The parts of the module cotwin._native.
namespace cotwin::python {

namespace py = pybind11;

void bind_robot(py::module_& m);
void bind_simulation(py::module_& m);
void bind_tools(py::module_& m);  // recordings, tune, excite, services

/// The first exception that a unit in Python raised during a call.
class UnitFailure {
 public:
  /// With the GIL.
  void keep(py::error_already_set&& error) {
    if (!error_) error_.emplace(std::move(error));
  }
  void forget() { error_.reset(); }
  /// With the GIL: throws cotwin.Error(message) from the kept exception, or KeyboardInterrupt and the like as they are. Returns if
  /// there is none.
  void raise(const char* message);

 private:
  std::optional<py::error_already_set> error_;
};

/// A kind of units that a Python callable makes. `failure` must outlive the units.
ProgramUnitType unit_type(const std::string& name, const std::string& summary, py::object make, UnitFailure& failure);

}  // namespace cotwin::python
