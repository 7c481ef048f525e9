// Loops of units: error and number of steps of explicit and implicit coupling, with units that are exact by themselves
// (tests/support/linear_units.h), and what the choice coupling="auto" costs where it changes nothing.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "fmu/archive/archive.h"
#include "fmu/export/pack.h"
#include "master/run/master.h"
#include "models/foundation/support/error.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/linear_units.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using namespace cotwin::master;

constexpr double kDiverged = 1e99;  // in place of an error that is not finite, which JSON cannot express

struct Method {
  CouplingChoice coupling = CouplingChoice::kExplicit;
  Duration tick;
  double tolerance = 0;
};

Scenario scenario_of(const Method& method, double stop) {
  Scenario scenario;
  scenario.name = "coupling";
  scenario.stop = Time::from_seconds(stop);
  scenario.tick = method.tick;
  scenario.tolerance = method.tolerance;
  scenario.coupling = method.coupling;
  scenario.threads = 1;
  return scenario;
}

void add(Scenario& scenario, const std::string& name, const std::string& source) {
  ComponentSpec spec;
  spec.name = name;
  spec.source = "unit:" + source;
  scenario.components.push_back(std::move(spec));
}

void connect(Scenario& scenario, const std::string& from, const std::string& from_variable, const std::string& to,
             const std::string& to_variable) {
  scenario.connections.push_back({{from, from_variable, ""}, {to, to_variable, ""}, 1, 0, false, ""});
}

Master make(Scenario scenario) {
  MasterOptions options;
  options.types = testing::linear_types();
  Master master(std::move(scenario), std::move(options));
  master.initialise();
  return master;
}

/// Two bodies that exchange force and motion: sides "<system>_1" and "<system>_2?settings".
Master two_bodies(const std::string& system, const std::string& settings, const Method& method, double stop) {
  Scenario scenario = scenario_of(method, stop);
  add(scenario, "one", system + "_1");
  add(scenario, "two", system + "_2" + settings);
  connect(scenario, "two", "F", "one", "F");
  connect(scenario, "one", "x1", "two", "x1");
  connect(scenario, "one", "v1", "two", "v1");
  return make(std::move(scenario));
}

double value(Master& master, std::size_t member, const char* variable) {
  return master.members()[member].instance.variables.at(variable).reals()[0];
}

/// The calls of step() of the unit with the most of them, also in tries that were not kept.
std::int64_t steps_of(Master& master) {
  std::int64_t steps = 0;
  for (Member& member : master.members()) {
    steps = std::max(steps, dynamic_cast<testing::LinearUnit&>(*member.instance.unit).steps());
  }
  return steps;
}

// --- Two-mass oscillator -------------------------------------------------------------------------------------------------

constexpr Duration kTick{40'000'000};
constexpr int kTicks = 125;  // 5 s

struct Outcome {
  double error = kDiverged;  // m, the largest of x1 at multiples of kTick
  std::int64_t steps = 0;
  double seconds = 0;  // without loading
};

/// `divide`: ticks of kTick / divide.
Outcome oscillate(CouplingChoice coupling, int divide, double tolerance) {
  static const std::vector<double> kExact = [] {
    std::vector<double> x1;
    for (int n = 1; n <= kTicks; ++n)
      x1.push_back(testing::coupled_reference(testing::two_masses(), (Time{} + n * kTick).seconds())[0]);
    return x1;
  }();
  const Duration tick{kTick.ns / divide};
  Outcome outcome;
  try {
    Master master = two_bodies("two_mass", "", {coupling, tick, tolerance}, 10);
    double error = 0;
    const auto begin = std::chrono::steady_clock::now();
    for (const double exact : kExact) {
      for (int i = 0; i < divide; ++i) master.step_tick();
      error = std::max(error, std::abs(value(master, 0, "x1") - exact));
    }
    outcome.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    outcome.steps = steps_of(master);
    if (error < kDiverged) outcome.error = error;
  } catch (const Error&) {  // not finite
  }
  return outcome;
}

/// The run with the fewest steps that a bisection over the tolerance finds with at most `error`.
std::optional<std::pair<double, Outcome>> cheapest(CouplingChoice coupling, double error) {
  std::optional<std::pair<double, Outcome>> best;
  double loose = 1, tight = -6;  // log10
  for (int i = 0; i < 12; ++i) {
    const double middle = (loose + tight) / 2, tolerance = std::pow(10, middle);
    const Outcome outcome = oscillate(coupling, 1, tolerance);
    const bool enough = outcome.error <= error;
    if (enough && (!best || outcome.steps < best->second.steps)) best = {tolerance, outcome};
    (enough ? tight : loose) = middle;
  }
  return best;
}

template <class Setting>
double steps(const std::optional<std::pair<Setting, Outcome>>& found) {
  return found ? static_cast<double>(found->second.steps) : 1e12;  // more than any run here makes
}

std::string short_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

void two_masses() {
  const auto seconds = [](CouplingChoice coupling, double tolerance) {
    std::vector<double> all;
    for (int i = 0; i < 9; ++i) all.push_back(oscillate(coupling, 1, tolerance).seconds);
    std::nth_element(all.begin(), all.begin() + 4, all.end());
    return all[4] * 1e3;
  };
  constexpr double kError = 1.5e-3;
  const std::string name = "two masses, 5 s, error of x1 up to " + short_text(kError) + " m, ";
  const auto ours = cheapest(CouplingChoice::kImplicit, kError), theirs = cheapest(CouplingChoice::kExplicit, kError);
  benchmark::print({name + "steps per unit, implicit, with tolerance", "1", steps(ours), "explicit, with tolerance",
                    steps(theirs), 0, true});
  if (ours && theirs)
    benchmark::print({name + "time, implicit, with tolerance", "ms", seconds(CouplingChoice::kImplicit, ours->first),
                      "explicit, with tolerance", seconds(CouplingChoice::kExplicit, theirs->first), 0, true});
}

// --- Contact -------------------------------------------------------------------------------------------------------------

/// Relative error of x1 after 0.1 s.
double touch(CouplingChoice coupling, Duration tick) {
  const double exact = testing::coupled_reference(testing::contact(1e6), 0.1)[0];
  try {
    Master master = two_bodies("contact", "?kc=1e6", {coupling, tick, 0}, 1);
    while (master.now() < Time::from_seconds(0.1)) master.step_tick();
    const double error = std::abs(value(master, 0, "x1") / exact - 1);
    return error < kDiverged ? error : kDiverged;
  } catch (const Error&) {  // not finite
    return kDiverged;
  }
}

void contact() {
  const std::pair<std::int64_t, double> goals[] = {{1'000'000, 0.22}, {200'000, 8.3e-3}};
  for (const auto& [ns, goal] : goals) {
    benchmark::print({"contact of 1e6 N/m, tick of " + short_text(static_cast<double>(ns) / 1e6) +
                          " ms, relative error of x1 after 0.1 s, implicit",
                      "1", touch(CouplingChoice::kImplicit, {ns}), "explicit", touch(CouplingChoice::kExplicit, {ns}), goal,
                      false});
  }
}

// --- Cost of the choice --------------------------------------------------------------------------------------------------

constexpr double kForever = 4e9;  // s, longer than any measurement

Master ring(CouplingChoice coupling) {
  Scenario scenario = scenario_of({coupling, Duration{100'000}, 0}, kForever);
  const auto name = [](int i) { return "u" + std::to_string(i % 10); };
  for (int i = 0; i < 10; ++i) add(scenario, name(i), "lag");
  for (int i = 0; i < 10; ++i) connect(scenario, name(i), "y", name(i + 1), "u");
  return make(std::move(scenario));
}

Master oscillator(CouplingChoice coupling) {
  Scenario scenario = scenario_of({coupling, Duration{100'000}, 0}, kForever);
  add(scenario, "mass", "lc_mass");
  add(scenario, "spring", "lc_spring");
  connect(scenario, "mass", "v", "spring", "v");
  connect(scenario, "spring", "F", "mass", "F");
  return make(std::move(scenario));
}

void cost_of_choice(const std::string& name, Master (*make_loop)(CouplingChoice)) {
  Master ours = make_loop(CouplingChoice::kAuto), theirs = make_loop(CouplingChoice::kExplicit);
  constexpr int kMany = 100;
  const auto run = [](Master& master) {
    for (int i = 0; i < kMany; ++i) master.step_tick();
  };
  const auto figures = benchmark::measure([&] { run(ours); }, [&] { run(theirs); }, 101, 4e-3);
  benchmark::print({name + ", tick of 0.1 ms, time per tick, coupling=auto", "ns", figures.ours * 1e9 / kMany,
                    "coupling=explicit", figures.peer * 1e9 / kMany, 1.02, true});
}

// --- FMUs ----------------------------------------------------------------------------------------------------------------

/// Steps of units per tick so far.
double calls_per_tick(Master& master) {
  return static_cast<double>(master.summary().loops.at(0).counts.evaluations) / static_cast<double>(master.tick());
}

/// The oscillator of two FMUs in the process of the master, compared with the units that are in them.
void loop_of_fmus(fmu::Version version) {
  const fmu::TemporaryFolder folder;
  Scenario scenario = scenario_of({CouplingChoice::kImplicit, Duration{100'000}, 0}, kForever);
  add(scenario, "mass", "lc_mass");
  add(scenario, "spring", "lc_spring");
  connect(scenario, "mass", "v", "spring", "v");
  connect(scenario, "spring", "F", "mass", "F");
  Master units = make(scenario);
  for (ComponentSpec& spec : scenario.components) {
    const std::filesystem::path file = folder.path() / (spec.name + ".fmu");
    fmu::PackRequest request;
    request.source = spec.source;
    request.types = testing::linear_types();
    request.version = version;
    request.libraries = places::linear_libraries();
    fmu::pack_unit(request, file);
    spec.source = file.string() + "?process=shared";
  }
  Master fmus = make(scenario);
  constexpr int kMany = 100;
  const auto run = [](Master& master) {
    for (int i = 0; i < kMany; ++i) master.step_tick();
  };
  const std::string name =
      std::string("mass and spring, implicit, tick of 0.1 ms, two FMUs of FMI ") + (version == fmu::Version::k2 ? "2" : "3");
  for (Master* master : {&fmus, &units}) run(*master);
  benchmark::print({name + ", steps of units per tick", "1", calls_per_tick(fmus), "units of the program",
                    calls_per_tick(units), 2.5, false});
  const auto figures = benchmark::measure([&] { run(fmus); }, [&] { run(units); }, 101, 4e-3, benchmark::thread_seconds);
  benchmark::print({name + ", time per tick", "ns", figures.ours * 1e9 / kMany, "units of the program",
                    figures.peer * 1e9 / kMany, 1500, false});
}

}  // namespace

/// `coupling [fmus]`: all rows, or those of FMUs alone.
int main(int argc, char** argv) {
  if (argc < 2 || std::string(argv[1]) != "fmus") {
    two_masses();
    contact();
    cost_of_choice("ring of ten lags", ring);
    cost_of_choice("mass and spring", oscillator);
  }
  for (const fmu::Version version : {fmu::Version::k2, fmu::Version::k3}) loop_of_fmus(version);
}
