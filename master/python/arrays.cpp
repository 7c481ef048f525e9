#include "master/python/arrays.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "master/python/faults.h"

namespace cotwin::python {

namespace {

constexpr const char* kExpected = "expected a C-contiguous array of float64";

/// Why the array cannot be used without a copy; "" if it can.
std::string unsuitable(const py::array& array) {
  if (!py::isinstance<py::array_t<double>>(array)) return "has the dtype " + std::string(py::str(array.dtype()));
  if ((array.flags() & py::array::c_style) == 0) return "is not C-contiguous";
  if ((array.flags() & py::detail::npy_api::NPY_ARRAY_ALIGNED_) == 0) return "is not aligned";
  return "";
}

bool overlap(const py::array& a, const py::array& b) {
  const std::less<const char*> before;
  const auto* const begin_a = static_cast<const char*>(a.data());
  const auto* const begin_b = static_cast<const char*>(b.data());
  return before(begin_a, begin_b + b.nbytes()) && before(begin_b, begin_a + a.nbytes());
}

}  // namespace

void refuse_mask(py::handle array, const char* name) {
  if (!py::hasattr(array, "mask")) return;
  if (py::cast<bool>(py::module_::import("numpy").attr("any")(array.attr("mask"))))
    throw BadValue(name,
                   "has masked elements, expected an array without a mask; " + std::string(name) + ".filled(value) makes one");
}

std::string text_of(const Shape& shape) {
  std::string text = "(";
  for (std::size_t i = 0; i < shape.size(); ++i) text += (i > 0 ? ", " : "") + std::to_string(shape[i]);
  return text + (shape.size() == 1 ? ",)" : ")");
}

Shape shape_of(const py::array& array) { return {array.shape(), array.shape() + array.ndim()}; }

py::array real_array(py::handle value, const char* name) {
  if (py::isinstance<py::array>(value)) {
    auto array = py::reinterpret_borrow<py::array>(value);
    refuse_mask(value, name);
    if (const char kind = array.dtype().kind(); kind == 'i' || kind == 'u') {
      py::array reals = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(array);
      for (py::ssize_t i = 0; i < reals.size(); ++i) {
        if (std::abs(static_cast<const double*>(reals.data())[i]) >= 0x1p53)
          throw BadValue(
              name, "has an integer of 2^53 or more, which floats may not have, expected it as a start value in text (set=)");
      }
      return reals;
    }
    const std::string reason = unsuitable(array);
    if (reason.empty()) return array;
    throw BadValue(name, reason + ", " + kExpected + "; numpy.ascontiguousarray(" + std::string(name) +
                             ", dtype=float) makes a copy of that kind");
  }
  const py::array integers = py::array::ensure(value);
  if (integers && (integers.dtype().kind() == 'i' || integers.dtype().kind() == 'u')) return real_array(integers, name);
  py::array array = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(value);
  if (array) return array;
  throw BadValue(name, "is no array of numbers but " + std::string(py::str(py::type::handle_of(value).attr("__name__"))) +
                           ", " + kExpected);
}

py::array output_array(py::handle value, const char* name, const Shape& shape) {
  if (!py::isinstance<py::array>(value))
    throw BadValue(name, "is " + std::string(py::str(py::type::handle_of(value).attr("__name__"))) + ", " + kExpected);
  auto array = py::reinterpret_borrow<py::array>(value);
  const std::string reason = unsuitable(array);
  if (!reason.empty()) throw BadValue(name, reason + ", " + kExpected);
  if (!array.writeable()) throw BadValue(name, "is read-only, expected a writable array");
  if (shape_of(array) != shape)
    throw BadValue(name, "has the shape " + text_of(shape_of(array)) + ", expected " + text_of(shape));
  return array;
}

py::array new_array(const Shape& shape) { return py::array_t<double>(shape); }

py::array array_of(const std::vector<double>& values, const Shape& shape) {
  py::array array = new_array(shape);
  std::ranges::copy(values, static_cast<double*>(array.mutable_data()));
  return array;
}

States::States(std::initializer_list<std::pair<const char*, py::handle>> arguments, std::size_t n, bool by_joint)
    : by_joint_(by_joint) {
  const auto joints = static_cast<py::ssize_t>(n);
  const std::string expected =
      by_joint ? "(" + std::to_string(n) + ", states)" : "(" + std::to_string(n) + ",) or (states, " + std::to_string(n) + ")";
  Shape first;
  for (const auto& [name, value] : arguments) {
    py::array array = real_array(value, name);
    const Shape shape = shape_of(array);
    const bool fits =
        by_joint ? shape.size() == 2 && shape[0] == joints : (shape.size() == 1 || shape.size() == 2) && shape.back() == joints;
    if (!fits) throw BadValue(name, "has the shape " + text_of(shape) + ", expected " + expected);
    if (arrays_.empty()) {
      first = shape;
      single_ = shape.size() == 1;
      count_ = single_ ? 1 : static_cast<std::size_t>(shape[by_joint ? 1 : 0]);
    } else if (shape != first) {
      throw BadValue(name, "has the shape " + text_of(shape) + ", expected that of " + names_.front() + ", " + text_of(first));
    }
    arrays_.push_back(std::move(array));
    names_.emplace_back(name);
  }
}

py::array States::result(py::handle out, const char* name, const Shape& per_state) {
  Shape shape = per_state;
  if (!single_) shape.insert(by_joint_ ? shape.end() : shape.begin(), static_cast<py::ssize_t>(count_));
  if (out.is_none()) return new_array(shape);
  py::array array = output_array(out, name, shape);
  for (std::size_t i = 0; i < arrays_.size(); ++i) {
    if (overlap(arrays_[i], array)) throw BadValue(name, "overlaps " + names_[i] + " in memory, expected an array of its own");
  }
  arrays_.push_back(array);
  names_.emplace_back(name);
  return array;
}

}  // namespace cotwin::python
