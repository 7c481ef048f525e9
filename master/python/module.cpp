// The module cotwin._native: what Python needs of cotwin.h. The package cotwin/ is what users import.
#include "master/python/bindings.h"
#include "master/python/faults.h"

PYBIND11_MODULE(_native, m) {
  using namespace cotwin;
  m.doc() = "Bindings of cotwin.h; import cotwin instead.";
  m.def("version", &version, "The version of the library, \"0.1.0\".");
  python::bind_faults(m);
  python::bind_robot(m);
  python::bind_simulation(m);
  python::bind_tools(m);
}
