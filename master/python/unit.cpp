// Units that are written in Python, as ProgramUnit.
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include "master/python/arrays.h"
#include "master/python/bindings.h"

namespace cotwin::python {

namespace {

/// An object of Python that any thread may destroy.
class Held {
 public:
  Held() = default;
  explicit Held(py::object object) : object_(std::move(object)) {}
  Held(const Held&) = delete;
  Held& operator=(const Held&) = delete;
  ~Held() {
    if (Py_IsInitialized() == 0) {
      object_.release();  // the interpreter is gone, and the object with it
      return;
    }
    const py::gil_scoped_acquire gil;
    object_ = py::object();
  }
  const py::object& operator*() const { return object_; }

 private:
  py::object object_;
};

class PythonUnit final : public ProgramUnit {
 public:
  PythonUnit(const std::string& name, py::object unit, UnitFailure& failure)
      : name_(name),
        failure_(failure),
        initialise_(unit.attr("initialise")),
        step_(unit.attr("step")),
        save_(unit.attr("_save")),
        restore_(unit.attr("_restore")),
        restorable_(py::cast<bool>(unit.attr("restorable"))),
        unit_(std::move(unit)) {}

  std::vector<ProgramVariable> variables() override {
    return guarded([&] {
      std::vector<ProgramVariable> all;
      for (const py::handle one : (*unit_).attr("_declared")()) {
        auto array = py::cast<py::array>(one.attr("storage"));
        ProgramVariable v;
        v.role = py::cast<std::string>(one.attr("role"));
        v.name = py::cast<std::string>(one.attr("name"));
        v.values = write(array);  // the unit keeps the array
        v.si = py::cast<std::string>(one.attr("si"));
        v.description = py::cast<std::string>(one.attr("description"));
        v.min = py::cast<double>(one.attr("min"));
        v.max = py::cast<double>(one.attr("max"));
        all.push_back(std::move(v));
      }
      return all;
    });
  }
  void initialise(double t) override {
    guarded([&] { (*initialise_)(t); });
  }
  bool step(double t, double h) override {
    return guarded([&] {
      const py::object result = (*step_)(t, h);
      if (result.is_none()) return true;
      if (!PyBool_Check(result.ptr())) {
        throw Error("step() of " + name_,
                    "returned " + std::string(py::repr(result)) + ", expected None, True (go on) or False (the run ends)");
      }
      return result.ptr() == Py_True;
    });
  }
  void save(std::string& bytes) override {
    guarded([&] { bytes = py::cast<std::string>((*save_)()); });
  }
  void restore(const std::string& bytes) override {
    guarded([&] { (*restore_)(py::bytes(bytes)); });
  }
  bool restorable() const override { return restorable_; }

 private:
  /// `call` with the GIL. An exception of Python is kept and becomes an Error.
  template <class Call>
  auto guarded(Call call) -> decltype(call()) {
    const py::gil_scoped_acquire gil;
    try {
      return call();
    } catch (py::error_already_set& error) {
      std::string what = py::cast<std::string>(error.type().attr("__name__"));
      const std::string message = py::str(error.value());
      if (!message.empty()) what += ": " + message;
      failure_.keep(std::move(error));
      throw Error("unit " + name_ + " in Python", what);
    }
  }

  std::string name_;
  UnitFailure& failure_;
  Held initialise_, step_, save_, restore_;
  bool restorable_;
  Held unit_;
};

}  // namespace

void UnitFailure::raise(const char* message) {
  if (!error_) return;
  py::error_already_set error = std::move(*error_);
  error_.reset();
  if (!error.matches(PyExc_Exception)) throw error;
  py::raise_from(error, py::module_::import("cotwin._native").attr("Error").ptr(), message);
  throw py::error_already_set();
}

ProgramUnitType unit_type(const std::string& name, const std::string& summary, py::object make, UnitFailure& failure) {
  const auto held = std::make_shared<Held>(std::move(make));
  return {name, summary, [name, held, &failure]() -> std::unique_ptr<ProgramUnit> {
            const py::gil_scoped_acquire gil;
            try {
              py::object unit = (**held)();
              if (!py::isinstance(unit, py::module_::import("cotwin.unit").attr("Unit"))) {
                throw Error("unit '" + name + "'", "is made as " + std::string(py::repr(py::type::of(unit))) +
                                                       ", expected an object of a class derived from cotwin.Unit");
              }
              return std::make_unique<PythonUnit>(name, std::move(unit), failure);
            } catch (py::error_already_set& error) {
              const std::string what = error.what();
              failure.keep(std::move(error));
              throw Error("unit " + name + " in Python", what.substr(0, what.find('\n')));
            }
          }};
}

}  // namespace cotwin::python
