#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <initializer_list>
#include <span>
#include <string>
#include <utility>
#include <vector>

/// NumPy arrays as arguments, without copies.
namespace cotwin::python {

namespace py = pybind11;
using Shape = std::vector<py::ssize_t>;

/// "(2, 7)", "(7,)"
std::string text_of(const Shape& shape);
Shape shape_of(const py::array& array);

/// The argument `name` as C-contiguous float64 array. An array of that kind is used as it is; numbers, lists, tuples and arrays of integers are
/// converted. Throws BadValue for other arrays, so that no copy is made unnoticed, for masked elements, and for what is no array of numbers.
py::array real_array(py::handle value, const char* name);
/// Throws BadValue for an array of numpy.ma with masked elements, whose values are not meant.
void refuse_mask(py::handle array, const char* name);
/// The array that a caller gave for results. Throws Error unless it is a writable C-contiguous float64 array of this shape.
py::array output_array(py::handle value, const char* name, const Shape& shape);
/// A new array.
py::array new_array(const Shape& shape);

inline std::span<const double> read(const py::array& array) {
  return {static_cast<const double*>(array.data()), static_cast<std::size_t>(array.size())};
}
inline std::span<double> write(py::array& array) {
  return {static_cast<double*>(array.mutable_data()), static_cast<std::size_t>(array.size())};
}
/// An array that owns `values`.
py::array array_of(const std::vector<double>& values, const Shape& shape);

/// Arguments that are one state (n) or many (states, n), and the results of the same number of states.
class States {
 public:
  /// Throws Error for other shapes and for shapes that differ. `by_joint`: (n, states).
  States(std::initializer_list<std::pair<const char*, py::handle>> arguments, std::size_t n, bool by_joint = false);

  std::span<const double> operator[](std::size_t argument) const { return read(arrays_[argument]); }
  std::size_t count() const { return count_; }
  /// The array for a result of `per_state` shape: `out` if it is given, else a new one. Throws Error if `out` does not fit or
  /// overlaps an argument or an earlier result.
  py::array result(py::handle out, const char* name, const Shape& per_state);

 private:
  std::size_t count_ = 1;
  bool single_ = true, by_joint_;
  std::vector<py::array> arrays_;   // arguments, then results
  std::vector<std::string> names_;  // of them
};

}  // namespace cotwin::python
