#include "master/python/faults.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <exception>

namespace cotwin::python {

namespace {

/// Whether the option at `at` belongs to a command that is named in the same clause, as in "cotwin tune: --q-columns".
bool is_of_command(std::string_view message, std::size_t at) {
  const std::size_t command = message.substr(0, at).rfind("cotwin ");
  if (command == std::string_view::npos) return false;
  const std::string_view words = message.substr(command, at - command);
  const std::size_t mark = words.find_first_of(";:,()");
  return mark == std::string_view::npos || (words[mark] == ':' && mark + 2 == words.size());
}

/// Options of the command line that functions in Python have as arguments.
constexpr std::array<std::string_view, 6> kArguments = {"cutoff", "q-columns", "set", "stop", "t-column", "threads"};

/// The value that follows an option at the end of `rest`, "" if prose follows.
std::string_view value_of(std::string_view name, std::string_view rest, bool is_place) {
  if (!rest.starts_with(' ')) return "";
  rest.remove_prefix(1);
  std::string_view value = rest.substr(0, is_place ? rest.find(": ") : rest.find_first_of(" \n"));
  while (!value.empty() && std::string_view(",;:.)").find(value.back()) != std::string_view::npos) value.remove_suffix(1);
  const bool is_prose = std::ranges::any_of(value, [](unsigned char c) { return std::islower(c) != 0; });
  return name != "set" && is_prose ? "" : value;
}

PyObject* define_exception(py::module_& m, const char* name, const py::tuple& bases, const char* doc) {
  // KeyError's own text is the repr of the message.
  py::dict members;
  members["__str__"] = py::module_::import("builtins").attr("BaseException").attr("__str__");
  const std::string full = std::string("cotwin.") + name;
  PyObject* const type = PyErr_NewExceptionWithDoc(full.c_str(), doc, bases.ptr(), members.ptr());
  if (type == nullptr) throw py::error_already_set();
  m.attr(name) = py::reinterpret_borrow<py::object>(type);
  return type;  // never freed, as the types of other exceptions
}

struct Types {
  PyObject *error, *unknown_name, *bad_value, *missing_file;
};
Types types;

/// The type for an error of the library, by its words: places are added to errors on their way, so that a class of its own would be lost.
PyObject* kind_of(std::string_view message) {
  const auto has = [&](std::string_view words) { return message.find(words) != std::string_view::npos; };
  if (has("No such file or directory") || has("is neither a file nor the name of a robot")) return types.missing_file;
  if (has("no frame '") || has("no variable and no setting") || has("is not a variable of a component"))
    return types.unknown_name;
  return types.error;
}

}  // namespace

std::string in_python(std::string_view message) {
  std::string text;
  for (std::size_t k = 0; k < message.size(); ++k) {
    const std::string_view rest = message.substr(k);
    const auto argument = std::ranges::find_if(kArguments, [&](std::string_view name) {
      return rest.starts_with("--") && rest.substr(2).starts_with(name) &&
             (rest.size() == 2 + name.size() ||
              std::string_view(" ,;:.)\n").find(rest[2 + name.size()]) != std::string_view::npos);
    });
    if (argument == kArguments.end() || is_of_command(message, k)) {
      text += message[k];
      continue;
    }
    const std::string_view value = value_of(*argument, rest.substr(2 + argument->size()), k == 0);
    std::string name(*argument);
    std::ranges::replace(name, '-', '_');
    text += name + "=";
    text += *argument == "set" && !value.empty() ? "[\"" + std::string(value) + "\"]" : std::string(value);
    k += 1 + argument->size() + (value.empty() ? 0 : 1 + value.size());
  }
  return text;
}

void bind_faults(py::module_& m) {
  const py::tuple base = py::make_tuple(py::reinterpret_borrow<py::object>(PyExc_RuntimeError));
  types.error = define_exception(m, "Error", base, "What a caller or a file has wrong, with place, fact and expectation.");
  const auto derived = [&](const char* name, PyObject* own, const char* doc) {
    return define_exception(
        m, name, py::make_tuple(py::reinterpret_borrow<py::object>(types.error), py::reinterpret_borrow<py::object>(own)), doc);
  };
  types.unknown_name = derived("UnknownName", PyExc_KeyError, "An Error and a KeyError: nothing has this name.");
  types.bad_value =
      derived("BadValue", PyExc_ValueError, "An Error and a ValueError: an argument of a wrong value, shape or type.");
  types.missing_file = derived("MissingFile", PyExc_FileNotFoundError, "An Error and a FileNotFoundError.");
  py::register_exception_translator([](std::exception_ptr thrown) {
    const auto raise = [](PyObject* type, const Error& error) { PyErr_SetString(type, in_python(error.what()).c_str()); };
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const UnknownName& error) {
      raise(types.unknown_name, error);
    } catch (const BadValue& error) {
      raise(types.bad_value, error);
    } catch (const Error& error) {
      raise(kind_of(error.what()), error);
    }
  });
}

}  // namespace cotwin::python
