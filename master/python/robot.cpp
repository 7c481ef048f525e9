// cotwin.Robot: dynamics on NumPy arrays.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include "master/python/arrays.h"
#include "master/python/bindings.h"
#include "master/python/calls.h"
#include "master/python/faults.h"

namespace cotwin::python {

namespace {

using namespace py::literals;

struct PyRobot {
  explicit PyRobot(const std::filesystem::path& urdf)
      : source(std::filesystem::exists(urdf) ? std::filesystem::absolute(urdf) : urdf), robot(urdf.string()), n(robot.n()) {}

  std::filesystem::path source;  // for pickle
  Robot robot;
  std::size_t n;
  std::mutex mutex;  // of the robot's scratch memory

  py::ssize_t joints() const { return static_cast<py::ssize_t>(n); }
};

constexpr std::size_t kFew = 64;      // states: quicker than to give the GIL away and take it back
constexpr std::size_t kBlock = 2048;  // states between two looks at signals

/// Calls call(part) for blocks of all states. `part(span, width)` is the block's part of an array with `width` values per state.
template <class Call>
void evaluate(PyRobot& r, std::size_t count, Call call) {
  const auto block = [&](std::size_t first, std::size_t size) {
    call([first, size](auto all, std::size_t width) { return all.subspan(first * width, size * width); });
  };
  const Turn turn(r.mutex);
  if (count <= kFew) {
    block(0, count);
    return;
  }
  Signals signals;
  {
    const py::gil_scoped_release no_gil;
    for (std::size_t first = 0; first < count && !signals.pending(); first += kBlock)
      block(first, std::min(kBlock, count - first));
  }
  signals.raise();
}

py::array mass_matrix(PyRobot& r, py::handle q, py::handle out) {
  States states({{"q", q}}, r.n);
  py::array M = states.result(out, "out", {r.joints(), r.joints()});
  const std::span<double> to = write(M);
  evaluate(r, states.count(), [&](auto part) { r.robot.mass_matrix(part(states[0], r.n), part(to, r.n * r.n)); });
  return M;
}

py::array gravity(PyRobot& r, py::handle q, py::handle out) {
  States states({{"q", q}}, r.n);
  py::array g = states.result(out, "out", {r.joints()});
  const std::span<double> to = write(g);
  evaluate(r, states.count(), [&](auto part) { r.robot.gravity(part(states[0], r.n), part(to, r.n)); });
  return g;
}

py::array bias(PyRobot& r, py::handle q, py::handle dq, py::handle out) {
  States states({{"q", q}, {"dq", dq}}, r.n);
  py::array h = states.result(out, "out", {r.joints()});
  const std::span<double> to = write(h);
  evaluate(r, states.count(), [&](auto part) { r.robot.bias(part(states[0], r.n), part(states[1], r.n), part(to, r.n)); });
  return h;
}

py::array coriolis_matrix(PyRobot& r, py::handle q, py::handle dq, py::handle out) {
  States states({{"q", q}, {"dq", dq}}, r.n);
  py::array C = states.result(out, "out", {r.joints(), r.joints()});
  const std::span<double> to = write(C);
  evaluate(r, states.count(),
           [&](auto part) { r.robot.coriolis_matrix(part(states[0], r.n), part(states[1], r.n), part(to, r.n * r.n)); });
  return C;
}

py::array inverse_dynamics(PyRobot& r, py::handle q, py::handle dq, py::handle ddq, py::handle out, bool by_joint) {
  States states({{"q", q}, {"dq", dq}, {"ddq", ddq}}, r.n, by_joint);
  py::array tau = states.result(out, "out", {r.joints()});
  const std::span<double> to = write(tau);
  if (by_joint) {
    const Turn turn(r.mutex);
    const py::gil_scoped_release no_gil;
    r.robot.inverse_dynamics_by_joint(states[0], states[1], states[2], to);
    return tau;
  }
  evaluate(r, states.count(), [&](auto part) {
    r.robot.inverse_dynamics(part(states[0], r.n), part(states[1], r.n), part(states[2], r.n), part(to, r.n));
  });
  return tau;
}

py::array forward_dynamics(PyRobot& r, py::handle q, py::handle dq, py::handle tau, py::handle out) {
  States states({{"q", q}, {"dq", dq}, {"tau", tau}}, r.n);
  py::array ddq = states.result(out, "out", {r.joints()});
  const std::span<double> to = write(ddq);
  evaluate(r, states.count(), [&](auto part) {
    r.robot.forward_dynamics(part(states[0], r.n), part(states[1], r.n), part(states[2], r.n), part(to, r.n));
  });
  return ddq;
}

py::array regressor(PyRobot& r, py::handle q, py::handle dq, py::handle ddq, py::handle out) {
  const std::size_t columns = 10 * r.robot.bodies();
  States states({{"q", q}, {"dq", dq}, {"ddq", ddq}}, r.n);
  py::array Y = states.result(out, "out", {r.joints(), static_cast<py::ssize_t>(columns)});
  const std::span<double> to = write(Y);
  evaluate(r, states.count(), [&](auto part) {
    r.robot.regressor(part(states[0], r.n), part(states[1], r.n), part(states[2], r.n), part(to, r.n * columns));
  });
  return Y;
}

py::tuple forward_kinematics(PyRobot& r, py::handle q, const std::string& frame, py::handle out) {
  py::object out_R = py::none(), out_p = py::none();
  if (!out.is_none()) {
    if (!py::isinstance<py::tuple>(out) || py::len(out) != 2) throw BadValue("out", "is no pair, expected (R, p)");
    out_R = out[py::int_(0)];
    out_p = out[py::int_(1)];
  }
  States states({{"q", q}}, r.n);
  py::array R = states.result(out_R, "out[0]", {3, 3}), p = states.result(out_p, "out[1]", {3});
  const std::span<double> to_R = write(R), to_p = write(p);
  evaluate(r, states.count(),
           [&](auto part) { r.robot.forward_kinematics(part(states[0], r.n), frame, part(to_R, 9), part(to_p, 3)); });
  return py::make_tuple(R, p);
}

py::array jacobian(PyRobot& r, py::handle q, const std::string& frame, py::handle out) {
  States states({{"q", q}}, r.n);
  py::array J = states.result(out, "out", {6, r.joints()});
  const std::span<double> to = write(J);
  evaluate(r, states.count(), [&](auto part) { r.robot.jacobian(part(states[0], r.n), frame, part(to, 6 * r.n)); });
  return J;
}

/// A matrix of `rows` x n of each state, which call(q, to) computes.
template <class Call>
py::array of_positions(PyRobot& r, py::handle q, py::handle out, py::ssize_t rows, Call call) {
  States states({{"q", q}}, r.n);
  py::array result = states.result(out, "out", {rows, r.joints()});
  const std::span<double> to = write(result);
  const std::size_t size = static_cast<std::size_t>(rows) * r.n;
  evaluate(r, states.count(), [&](auto part) { call(part(states[0], r.n), part(to, size)); });
  return result;
}

/// The elements of a vector of three.
std::array<double, 3> direction(py::handle u) {
  const py::array array = real_array(u, "u");
  if (shape_of(array) != Shape{3}) throw BadValue("u", "has the shape " + text_of(shape_of(array)) + ", expected (3,)");
  const std::span<const double> values = read(array);
  return {values[0], values[1], values[2]};
}

Axes axes_of(const std::string& word) {
  if (word == "base") return Axes::kBase;
  if (word == "frame") return Axes::kFrame;
  throw BadValue("axes", "'" + word + "', expected base or frame");
}

/// motor_inertia=None as an empty vector.
py::array optional_array(py::handle value, const char* name) {
  return value.is_none() ? new_array({0}) : real_array(value, name);
}

py::object scalar_or_gradient(PyRobot& r, py::handle q, py::handle u, const std::string& frame, const std::string& axes,
                              py::handle motor_inertia, auto function) {
  const py::array at = real_array(q, "q"), B = optional_array(motor_inertia, "motor_inertia");
  const Turn turn(r.mutex);
  return function(read(at), direction(u), frame, axes_of(axes), read(B));
}

py::dict ellipsoid(const Ellipsoid& e) {
  return py::dict("axes"_a = array_of({e.axes.begin(), e.axes.end()}, {3, 3}),
                  "lengths"_a = array_of({e.lengths.begin(), e.lengths.end()}, {3}),
                  "centre"_a = array_of({e.centre.begin(), e.centre.end()}, {3}), "measure"_a = e.measure);
}

py::dict both(const Manipulability& m) {
  return py::dict("translation"_a = ellipsoid(m.translation), "rotation"_a = ellipsoid(m.rotation));
}

}  // namespace

void bind_robot(py::module_& m) {
  py::class_<JointInfo>(m, "Joint", "A joint of one degree of freedom.")
      .def_readonly("name", &JointInfo::name, "Name of the URDF's joint.")
      .def_readonly("prismatic", &JointInfo::prismatic, "True: q in m, tau in N; False: q in rad, tau in N.m.")
      .def_readonly("q_min", &JointInfo::q_min, "Lower limit of q, rad or m; -inf if there is none.")
      .def_readonly("q_max", &JointInfo::q_max, "Upper limit of q, rad or m; inf if there is none.")
      .def_readonly("dq_max", &JointInfo::dq_max, "Largest speed, rad/s or m/s; inf if there is none.")
      .def_readonly("tau_max", &JointInfo::tau_max, "Largest torque or force, N.m or N; inf if there is none.")
      .def("__repr__", [](const JointInfo& j) { return "<Joint " + j.name + (j.prismatic ? ", prismatic>" : ">"); });

  py::class_<PyRobot>(m, "Robot", R"(Kinematics and dynamics of a robot with rigid joints, M(q) ddq + C(q, dq) dq + g(q) = tau.

n is the number of joints. Arguments are one state, shape (n,), or many, (states, n): C-contiguous float64 arrays are read
without a copy, lists and arrays of integers are converted, and other arrays are an Error. pickle keeps the path or name of the URDF. Units of measure: rad, rad/s, rad/s^2, N.m of revolute
joints; m, m/s, m/s^2, N of prismatic ones. With out=, results are written to that array and nothing is allocated. A NaN in
a state gives NaN in what depends on it. More than 64 states are computed without the GIL.

    arm = cotwin.Robot("lwr4")                    # or the path of a URDF
    tau = arm.inverse_dynamics(q, dq, ddq)
)")
      .def(py::init<const std::filesystem::path&>(), "urdf"_a,
           "Loads a URDF: a path, or the name of a robot that comes with Cotwin (\"lwr4\").")
      .def_property_readonly(
          "n", [](const PyRobot& r) { return r.n; }, "Number of joints.")
      .def_property_readonly(
          "joints", [](const PyRobot& r) { return r.robot.joints(); }, "The n joints, in the order of q.")
      .def_property_readonly(
          "frames", [](const PyRobot& r) { return r.robot.frames(); }, "Names of all frames: the URDF's links.")
      .def_property_readonly(
          "bodies", [](const PyRobot& r) { return r.robot.bodies(); }, "Number of moved bodies: n, and those of mimic joints.")
      .def(
          "inertial_parameters",
          [](const PyRobot& r) {
            const std::vector<double> pi = r.robot.inertial_parameters();
            return array_of(pi, {static_cast<py::ssize_t>(pi.size())});
          },
          "pi, (10 bodies,): per body mass (kg), mass times centre of mass (3, kg.m), inertia xx xy xz yy yz zz about the "
          "origin\n"
          "of its link's frame (kg.m^2). tau = regressor(q, dq, ddq) @ pi.")
      .def("mass_matrix", &mass_matrix, "q"_a, py::kw_only(), "out"_a = py::none(),
           "M(q), (n, n) or (states, n, n), symmetric; kg.m^2, kg between prismatic joints.")
      .def("gravity", &gravity, "q"_a, py::kw_only(), "out"_a = py::none(), "g(q), (n,) or (states, n), N.m or N.")
      .def("bias", &bias, "q"_a, "dq"_a, py::kw_only(), "out"_a = py::none(),
           "C(q, dq) dq + g(q), (n,) or (states, n), N.m or N.")
      .def("coriolis_matrix", &coriolis_matrix, "q"_a, "dq"_a, py::kw_only(), "out"_a = py::none(),
           "C(q, dq), (n, n) or (states, n, n), for which dM/dt - 2 C is skew-symmetric; N.m.s or N.s.")
      .def("inverse_dynamics", &inverse_dynamics, "q"_a, "dq"_a, "ddq"_a, py::kw_only(), "out"_a = py::none(),
           "by_joint"_a = false,
           "tau = M ddq + C dq + g, (n,) or (states, n), N.m or N.\n\n"
           "by_joint=True: all arrays have the shape (n, states), the order in which the processor computes, and the fastest.\n"
           "From 8 states on they are computed in SIMD lanes and agree with single states to rounding.")
      .def("forward_dynamics", &forward_dynamics, "q"_a, "dq"_a, "tau"_a, py::kw_only(), "out"_a = py::none(),
           "ddq = M^-1 (tau - C dq - g), (n,) or (states, n), rad/s^2 or m/s^2.")
      .def("regressor", &regressor, "q"_a, "dq"_a, "ddq"_a, py::kw_only(), "out"_a = py::none(),
           "Y, (n, 10 bodies) or (states, n, 10 bodies), with tau = Y pi of inertial_parameters().")
      .def("forward_kinematics", &forward_kinematics, "q"_a, "frame"_a = "", py::kw_only(), "out"_a = py::none(),
           "Pose of a frame F in the base B: R_BF, (3, 3) or (states, 3, 3), and p_BF, (3,) or (states, 3), m.\n\n"
           "frame: a name of frames; \"\": the end of the longest chain. out: a pair (R, p).")
      .def("jacobian", &jacobian, "q"_a, "frame"_a = "", py::kw_only(), "out"_a = py::none(),
           "J, (6, n) or (states, 6, n), with [v; w] = J dq: velocity of the frame's origin (m/s), then angular velocity "
           "(rad/s),\n"
           "both in the axes of the base.")
      .def(
          "floating_mass_matrix",
          [](PyRobot& r, py::handle q, py::handle out) {
            return of_positions(r, q, out, r.joints(), [&](auto at, auto to) { r.robot.floating_mass_matrix(at, to); });
          },
          "q"_a, py::kw_only(), "out"_a = py::none(),
          "M*(q) = M - F' I_c^-1 F of a robot whose base moves freely, (n, n) or (states, n, n): M* ddq + C* dq = tau without\n"
          "momentum. The base has the mass of the URDF's root link; an Error if it has none.")
      .def(
          "floating_jacobian",
          [](PyRobot& r, py::handle q, const std::string& frame, py::handle out) {
            return of_positions(r, q, out, 6, [&](auto at, auto to) { r.robot.floating_jacobian(at, frame, to); });
          },
          "q"_a, "frame"_a = "", py::kw_only(), "out"_a = py::none(),
          "J*, the generalised Jacobian, (6, n) or (states, 6, n): as jacobian(), relative to an inertial frame, while the\n"
          "base recoils.")
      .def(
          "floating_rotation",
          [](PyRobot& r, py::handle q, py::handle out) {
            return of_positions(r, q, out, 3, [&](auto at, auto to) { r.robot.floating_rotation(at, to); });
          },
          "q"_a, py::kw_only(), "out"_a = py::none(),
          "Z, (3, n) or (states, 3, n): Z dq is the angular velocity of the free base in its own axes, rad/s, without "
          "momentum.")
      .def(
          "effective_mass",
          [](PyRobot& r, py::handle q, py::handle u, const std::string& frame, const std::string& axes, py::handle B) {
            return scalar_or_gradient(r, q, u, frame, axes, B,
                                      [&](auto... all) -> py::object { return py::float_(r.robot.effective_mass(all...)); });
          },
          "q"_a, "u"_a, "frame"_a = "", "axes"_a = "base", "motor_inertia"_a = py::none(),
          "Effective mass of a frame's origin along u (3,), 1/(u' J_v M^-1 J_v' u), kg; inf where the joints cannot move "
          "it.\n\n"
          "axes of u: \"base\" or \"frame\". motor_inertia (n,), kg.m^2 or kg, is added to M's diagonal; inf locks a joint.")
      .def(
          "effective_inertia",
          [](PyRobot& r, py::handle q, py::handle u, const std::string& frame, const std::string& axes, py::handle B) {
            return scalar_or_gradient(r, q, u, frame, axes, B,
                                      [&](auto... all) -> py::object { return py::float_(r.robot.effective_inertia(all...)); });
          },
          "q"_a, "u"_a, "frame"_a = "", "axes"_a = "base", "motor_inertia"_a = py::none(),
          "Effective inertia of a frame about u (3,), 1/(u' J_w M^-1 J_w' u), kg.m^2. Arguments as effective_mass().")
      .def(
          "effective_mass_gradient",
          [](PyRobot& r, py::handle q, py::handle u, const std::string& frame, const std::string& axes, py::handle B) {
            return scalar_or_gradient(r, q, u, frame, axes, B, [&](auto... all) -> py::object {
              return array_of(r.robot.effective_mass_gradient(all...), {r.joints()});
            });
          },
          "q"_a, "u"_a, "frame"_a = "", "axes"_a = "base", "motor_inertia"_a = py::none(),
          "Derivative of effective_mass() by q, (n,), kg/rad or kg/m.")
      .def(
          "manipulability",
          [](PyRobot& r, py::handle q, const std::string& frame) {
            const py::array at = real_array(q, "q");
            const Turn turn(r.mutex);
            return both(r.robot.manipulability(read(at), frame));
          },
          "q"_a, "frame"_a = "",
          "Velocities of a frame for joint speeds of norm 1: {\"translation\": …, \"rotation\": …}, each an ellipsoid with "
          "axes (3, 3),\n"
          "whose columns are directions in the base, lengths (3,), m/s or rad/s, centre (3,), and measure, their product.")
      .def(
          "dynamic_manipulability",
          [](PyRobot& r, py::handle q, py::handle dq, py::handle tau_max, const std::string& frame, py::handle motor_inertia) {
            const py::array at = real_array(q, "q"), speed = real_array(dq, "dq"), most = real_array(tau_max, "tau_max"),
                            B = optional_array(motor_inertia, "motor_inertia");
            const Turn turn(r.mutex);
            return both(r.robot.dynamic_manipulability(read(at), read(speed), read(most), frame, read(B)));
          },
          "q"_a, "dq"_a, "tau_max"_a, "frame"_a = "", "motor_inertia"_a = py::none(),
          "Accelerations of a frame for motor torques whose quotients with tau_max (n,) have the norm 1; as manipulability(), "
          "in\n"
          "m/s^2 and rad/s^2.")
      .def("__repr__",
           [](const PyRobot& r) {
             std::string joints;
             for (const JointInfo& joint : r.robot.joints()) joints += (joints.empty() ? "" : ", ") + joint.name;
             return "<cotwin.Robot '" + r.source.string() + "' with " + std::to_string(r.n) + " joints: " + joints + ">";
           })
      .def(py::pickle([](const PyRobot& r) { return py::make_tuple(r.source.string()); },
                      [](const py::tuple& state) { return std::make_unique<PyRobot>(py::cast<std::string>(state[0])); }));
}

}  // namespace cotwin::python
