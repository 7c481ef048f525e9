// The module cotwin._native: what Python needs of cotwin.h. The package cotwin/ is what users import.
#include "master/python/bindings.h"

PYBIND11_MODULE(_native, m) {
  using namespace cotwin;
  m.doc() = "Bindings of cotwin.h; import cotwin instead.";
  m.def("version", &version, "The version of the library, \"0.1.0\".");
  auto& error = pybind11::register_exception<Error>(m, "Error", PyExc_RuntimeError);
  error.attr("__doc__") = "What a caller or a file has wrong, with place, fact and expectation.";
  error.attr("__module__") = "cotwin";
  python::bind_robot(m);
  python::bind_simulation(m);
  python::bind_tools(m);
}
