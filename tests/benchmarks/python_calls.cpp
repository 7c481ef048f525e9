// Calls of the library from Python beside the same calls from C++, in one process: the interpreter is embedded.
#include <pybind11/embed.h>

#include <filesystem>
#include <random>
#include <span>
#include <vector>

#include "master/api/cotwin.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using benchmark::measure;
using benchmark::print;
namespace py = pybind11;

constexpr std::size_t kStates = 100'000, kJoints = 7;
constexpr int kSteps = 1000;
constexpr double kMicro = 1e6, kNano = 1e9;

constexpr const char* kPrepare = R"(
import numpy as np
import cotwin

arm = cotwin.Robot("lwr4")
random = np.random.default_rng(1)
q, dq, ddq = (random.uniform(-1, 1, (7, states)) for _ in range(3))
rows = [np.ascontiguousarray(a.T) for a in (q, dq, ddq)]
out, out_rows = np.empty((7, states)), np.empty((states, 7))
one = [a[0].copy() for a in rows]
one_out = np.empty(7)

def batch():
    arm.inverse_dynamics(q, dq, ddq, out=out, by_joint=True)

def batch_rows():
    arm.inverse_dynamics(*rows, out=out_rows)

def single():
    for _ in range(steps):
        arm.inverse_dynamics(*one, out=one_out)

def scenario():
    return cotwin.Scenario("light", robot="lwr4", stop=1e6).add("motion", kind="waypoints", points=2,
        values={"waypoint_t": [0, 1], "waypoint_q": [np.zeros(7), np.full(7, 0.1)]}).record("motion.done")

twin = cotwin.Simulation(scenario(), keep=False)
step = twin.step

def run_steps():
    for _ in range(steps):
        step()

get = twin.get
def run_gets():
    for _ in range(steps):
        get("motion.q_d")

class Empty(cotwin.Unit):
    "does nothing"
    def declare(self):
        self.input("u", 7)
        self.output("y", 7)
    def step(self, t, h):
        pass

own = cotwin.Simulation(cotwin.Scenario("own", stop=1e6).add("empty", Empty), keep=False)
def run_own():
    own.run_to(own.time + 1)

xml = scenario().to_ssd()
)";

}  // namespace

int main() {
  const py::scoped_interpreter interpreter;
  py::dict scope;
  py::module_::import("sys").attr("path").attr("insert")(
      0, (std::filesystem::path(places::program()).parent_path().parent_path() / COTWIN_PYTHON_FOLDER).string());
  scope["__builtins__"] = py::module_::import("builtins");
  scope["states"] = kStates;
  scope["steps"] = kSteps;
  py::exec(kPrepare, scope);
  const auto python = [&](const char* name) { return [call = py::object(scope[name])] { call(); }; };

  Robot arm("lwr4");
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> number(-1, 1);
  const auto numbers = [&](std::size_t count) {
    std::vector<double> all(count);
    for (double& x : all) x = number(random);
    return all;
  };
  const std::vector<double> q = numbers(kJoints * kStates), dq = numbers(q.size()), ddq = numbers(q.size());
  std::vector<double> tau(q.size());
  constexpr double kPerState = kNano / static_cast<double>(kStates), kPerCall = kMicro / kSteps;

  const auto by_joint = [&] { arm.inverse_dynamics_by_joint(q, dq, ddq, tau); };
  benchmark::Figures f = measure(python("batch"), by_joint);
  print({"Python: inverse dynamics, 1e5 states by joint", "ns", f.ours * kPerState, "C++", f.peer * kPerState, 1.3});
  f = measure(python("batch_rows"), by_joint);
  print({"Python: inverse dynamics, 1e5 states by rows", "ns", f.ours * kPerState, "C++ by joint", f.peer * kPerState});

  const std::span<const double> q1(q.data(), kJoints), dq1(dq.data(), kJoints), ddq1(ddq.data(), kJoints);
  const std::span<double> tau1(tau.data(), kJoints);
  f = measure(python("single"), [&] {
    for (int i = 0; i < kSteps; ++i) arm.inverse_dynamics(q1, dq1, ddq1, tau1);
  });
  print({"Python: inverse dynamics, one state", "us", f.ours * kPerCall, "C++", f.peer * kPerCall});

  Simulation twin(ScenarioText{py::cast<std::string>(scope["xml"]), "light", {}});
  f = measure(python("run_steps"), [&] {
    for (int i = 0; i < kSteps; ++i) benchmark::keep(twin.step());
  });
  print(
      {"Python: one step(), more than in C++", "us", (f.ours - f.peer) * kPerCall, "C++ step()", f.peer * kPerCall, 2, false});
  f = measure(python("run_gets"), [&] {
    for (int i = 0; i < kSteps; ++i) benchmark::keep(twin.get("motion.q_d"));
  });
  print({"Python: get() of 7 values", "us", f.ours * kPerCall, "C++ get()", f.peer * kPerCall});
  f = measure(python("run_own"), [&] {
    for (int i = 0; i < kSteps; ++i) benchmark::keep(twin.step());
  });
  print({"Python: tick of a run with an empty unit in Python", "us", f.ours * kPerCall, "C++ step()", f.peer * kPerCall});
  scope.clear();
  return 0;
}
