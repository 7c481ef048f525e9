#pragma once
#include <pybind11/pybind11.h>

#include <string>
#include <string_view>

#include "models/foundation/support/error.h"

/// Errors that are also one of Python's own kinds: cotwin.UnknownName is an Error and a KeyError, and so on.
namespace cotwin::python {

namespace py = pybind11;

class UnknownName : public Error {  // KeyError
 public:
  using Error::Error;
};
class BadValue : public Error {  // ValueError
 public:
  using Error::Error;
};

/// A message with the options of the command line as a caller in Python gives them, where functions have them: "--set drive.K=3" as set=["drive.K=3"],
/// "--stop SECONDS" as stop=SECONDS. Other options and those of commands, as `cotwin new --robot X`, stay.
std::string in_python(std::string_view message);

/// Defines the exceptions and how they are raised.
void bind_faults(py::module_& m);

}  // namespace cotwin::python
