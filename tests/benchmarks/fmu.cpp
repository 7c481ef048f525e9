// The cost of the C interfaces of FMI: Cotwin's drive train as an FMU and as a unit in process, a scenario as one FMU and as a
// run, and a chain of trivial FMUs in the master and in a bare loop.
#include <sys/resource.h>
#include <time.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/export/pack.h"
#include "master/run/master.h"
#include "master/twin/pack_twin.h"
#include "tests/benchmarks/measure.h"
#include "tests/fmu/driver.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using fmu::Version;
using fmu::testing::Driver;
using fmu::testing::LoadedFmu;

namespace fs = std::filesystem;

constexpr double kStep = 1e-3;  // s
constexpr Duration kTick{1'000'000};
constexpr int kSteps = 100;  // per measured call

/// Calls both sides in turn, so that the arm is in the same state on both: the cost of a step depends on its motion.
benchmark::Figures measure_in_step(const std::function<void()>& ours, const std::function<void()>& peer) {
  constexpr int kBatches = 150;
  return benchmark::measure(ours, peer, kBatches, 0);
}

const std::vector<fs::path>& folders() {
  static const std::vector<fs::path> all = {fs::path(cotwin::places::source()) / "models"};
  return all;
}

std::string name_of(Version version) { return version == Version::k2 ? "FMI 2" : "FMI 3"; }

/// An instance whose functions for one step were looked up beforehand, as a host does.
class Stepped {
 public:
  Stepped(const LoadedFmu& fmu, const Driver& driver) : instance_(driver.instance()), two_(fmu.version() == Version::k2) {
    if (two_) {
      step2_ = fmu.function<decltype(&fmi2DoStep)>("fmi2DoStep");
      set2_ = fmu.function<decltype(&fmi2SetReal)>("fmi2SetReal");
      get2_ = fmu.function<decltype(&fmi2GetReal)>("fmi2GetReal");
    } else {
      step3_ = fmu.function<decltype(&fmi3DoStep)>("fmi3DoStep");
      set3_ = fmu.function<decltype(&fmi3SetFloat64)>("fmi3SetFloat64");
      get3_ = fmu.function<decltype(&fmi3GetFloat64)>("fmi3GetFloat64");
    }
  }
  int step(std::int64_t n) const {
    const double now = static_cast<double>(n) * kStep;
    if (two_) return step2_(instance_, now, kStep, fmi2True);
    bool event = false, terminate = false, early = false;
    double reached = 0;
    return step3_(instance_, now, kStep, true, &event, &terminate, &early, &reached);
  }
  int set(const std::vector<unsigned>& references, const std::vector<double>& values) const {
    if (two_) return set2_(instance_, references.data(), references.size(), values.data());
    return set3_(instance_, references.data(), references.size(), values.data(), values.size());
  }
  int get(const std::vector<unsigned>& references, std::vector<double>& values) const {
    if (two_) return get2_(instance_, references.data(), references.size(), values.data());
    return get3_(instance_, references.data(), references.size(), values.data(), values.size());
  }

 private:
  void* instance_;
  bool two_;
  decltype(&fmi2DoStep) step2_ = nullptr;
  decltype(&fmi2SetReal) set2_ = nullptr;
  decltype(&fmi2GetReal) get2_ = nullptr;
  decltype(&fmi3DoStep) step3_ = nullptr;
  decltype(&fmi3SetFloat64) set3_ = nullptr;
  decltype(&fmi3GetFloat64) get3_ = nullptr;
};

void expect_ok(int status) {
  if (status != 0) throw std::runtime_error("an FMU refused a call");
}

/// Motor torques in step `n` that keep the arm moving.
void excite(std::vector<double>& tau_m, std::int64_t n) {
  for (std::size_t i = 0; i < tau_m.size(); ++i) {
    tau_m[i] = 2 * std::sin(0.013 * static_cast<double>(n) + 0.7 * static_cast<double>(i));
  }
}

/// One step: sets the torque, steps, gets two outputs.
void drive_train(Version version, const fs::path& folder) {
  const std::string source = "unit:drive_train?robot=lwr4";
  fmu::PackRequest request;
  request.source = source;
  request.folders = folders();
  request.types = unit_types();
  request.version = version;
  const fs::path archive = folder / "drive_train.fmu";
  fmu::pack_unit(request, archive);
  const LoadedFmu loaded(archive, version);
  Driver driver(loaded);
  driver.initialise();
  const Stepped ours(loaded, driver);

  Instance alone = make_unit(source, {}, folders(), unit_types());
  alone.unit->initialise(Time{});
  const std::vector<unsigned> tau_m = fmu::testing::references(alone.variables, "tau_m", version);
  const std::vector<unsigned> q = fmu::testing::references(alone.variables, "q", version);
  const std::vector<unsigned> theta = fmu::testing::references(alone.variables, "theta", version);
  const std::size_t joints = alone.variables.at("tau_m").size();
  std::vector<double> in(joints), out(joints);
  std::int64_t n_ours = 0, n_alone = 0;
  const std::span<double> tau_m_alone = alone.variables.at("tau_m").reals(), q_alone = alone.variables.at("q").reals(),
                          theta_alone = alone.variables.at("theta").reals();
  const auto figures = measure_in_step(
      [&] {
        for (int i = 0; i < kSteps; ++i, ++n_ours) {
          excite(in, n_ours);
          expect_ok(ours.set(tau_m, in));
          expect_ok(ours.step(n_ours));
          expect_ok(ours.get(q, out));
          expect_ok(ours.get(theta, out));
          benchmark::keep(out);
        }
      },
      [&] {
        for (int i = 0; i < kSteps; ++i, ++n_alone) {
          excite(in, n_alone);
          std::copy(in.begin(), in.end(), tau_m_alone.begin());
          benchmark::keep(alone.unit->step(Time{n_alone * kTick.ns}, kTick));
          std::copy(q_alone.begin(), q_alone.end(), out.begin());
          std::copy(theta_alone.begin(), theta_alone.end(), out.begin());
          benchmark::keep(out);
        }
      });
  benchmark::print({"drive train as an FMU, " + name_of(version) + ", per step", "us", figures.ours * 1e6 / kSteps,
                    "the unit in process", figures.peer * 1e6 / kSteps, 1.1, true});
}

/// Both run the example's motion, without recording.
void whole_twin(Version version, const fs::path& folder) {
  master::Scenario scenario =
      master::load_scenario(fs::path(cotwin::places::source()) / "examples/02_free_motion_lwr4/twin.ssd");
  scenario.stop = Time{1'000'000 * kTick.ns};  // longer than any measurement
  const fs::path archive = folder / "twin.fmu";
  master::PackageOptions options;
  options.types = unit_types();
  options.folders = folders();
  options.version = version;
  master::pack_twin(scenario, options, archive);
  const LoadedFmu loaded(archive, version);
  Driver driver(loaded);
  driver.initialise();
  const Stepped ours(loaded, driver);

  master::MasterOptions in_process;
  in_process.types = unit_types();
  in_process.folders = folders();
  in_process.threads = 1;
  master::Master master(scenario, std::move(in_process));
  master.initialise();
  std::int64_t n = 0;
  const auto figures = measure_in_step(
      [&] {
        for (int i = 0; i < kSteps; ++i) expect_ok(ours.step(n++));
      },
      [&] {
        for (int i = 0; i < kSteps; ++i) master.step_tick();
      });
  benchmark::print({"whole twin (example 02) as an FMU, " + name_of(version) + ", per step", "us", figures.ours * 1e6 / kSteps,
                    "the run in process", figures.peer * 1e6 / kSteps, 1.1, true});
}

constexpr const char* kTrivial = R"(<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="trivial" guid="{trivial}" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="trivial" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="1" causality="input" variability="continuous"><Real start="0"/></ScalarVariable>
    <ScalarVariable name="y" valueReference="2" causality="output" variability="continuous" initial="calculated"><Real/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="2"/></Outputs></ModelStructure>
</fmiModelDescription>
)";

/// A chain in which each FMU feeds the next. All are instances of one archive.
master::Scenario chain_of(int count, const fs::path& folder, const std::string& query = "") {
  const std::vector<fmu::ArchiveFile> files = {{"modelDescription.xml", std::string(kTrivial)},
                                               {"binaries/linux64/trivial.so", fs::path(COTWIN_TRIVIAL_FMU)}};
  fmu::write_archive(folder / "trivial.fmu", files);
  master::Scenario scenario;
  scenario.name = "chain";
  scenario.folder = folder;
  scenario.stop = Time{1'000'000'000 * kTick.ns};  // longer than any measurement
  scenario.threads = 1;
  scenario.recording.push_back({"*", ""});
  scenario.reports.push_back({"", master::ReportKind::kSignal, "u0.y", "", ""});
  for (int i = 0; i < count; ++i) {
    master::ComponentSpec spec;
    spec.name = "u" + std::to_string(i);
    spec.source = "trivial.fmu" + query;
    scenario.components.push_back(spec);
    if (i > 0) scenario.connections.push_back({{"u" + std::to_string(i - 1), "y", ""}, {spec.name, "u", ""}, 1, 0, false, ""});
  }
  return scenario;
}

/// Both loops copy each output to the input of the next FMU and step all FMUs. Returns what the bare calls take per FMU and step, ns.
double chain(int count, const fs::path& folder) {
  master::Master ours(chain_of(count, folder), {});
  ours.initialise();

  struct Calls {
    void* instance;
    decltype(&fmi2DoStep) step;
    decltype(&fmi2SetReal) set;
    decltype(&fmi2GetReal) get;
  };
  const LoadedFmu loaded(folder / "trivial.fmu", Version::k2);
  std::vector<std::unique_ptr<Driver>> drivers;
  std::vector<Calls> instances;
  for (int i = 0; i < count; ++i) {
    drivers.push_back(std::make_unique<Driver>(loaded));
    drivers.back()->initialise();
    instances.push_back({drivers.back()->instance(), loaded.function<decltype(&fmi2DoStep)>("fmi2DoStep"),
                         loaded.function<decltype(&fmi2SetReal)>("fmi2SetReal"),
                         loaded.function<decltype(&fmi2GetReal)>("fmi2GetReal")});
  }
  std::vector<double> y(instances.size()), next(instances.size());
  const fmi2ValueReference u_reference = 1, y_reference = 2;
  std::int64_t n = 0;
  const auto bare = [&] {
    const double now = static_cast<double>(n++) * kStep;
    int worst = 0;
    for (std::size_t i = 0; i < instances.size(); ++i) {
      const Calls& f = instances[i];
      if (i > 0) worst |= f.set(f.instance, &u_reference, 1, &y[i - 1]);
      worst |= f.step(f.instance, now, kStep, fmi2True);
      worst |= f.get(f.instance, &y_reference, 1, &next[i]);
    }
    std::swap(y, next);
    expect_ok(worst);
  };
  const auto figures = benchmark::measure(
      [&] {
        for (int i = 0; i < kSteps; ++i) ours.step_tick();
      },
      [&] {
        for (int i = 0; i < kSteps; ++i) bare();
      },
      31, 2e-3, benchmark::thread_seconds);
  const double per = 1e9 / kSteps / count;
  benchmark::print({"chain of " + std::to_string(count) + " trivial FMUs in the master, per FMU and step", "ns",
                    figures.ours * per, "bare loop over the same FMUs", figures.peer * per, 2, true});
  return figures.peer * per;
}

/// The same chain as a file, so that other masters can read it.
void write_ssd(int count, const fs::path& folder, bool records) {
  chain_of(count, folder);
  std::ofstream out(folder / "SystemStructure.ssd");
  out << R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription name="chain" version="1.0" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="chain"><ssd:Elements>)";
  for (int i = 0; i < count; ++i) {
    out << "<ssd:Component name='u" << i << "' source='trivial.fmu'><ssd:Connectors>"
        << "<ssd:Connector name='u' kind='input'><ssc:Real/></ssd:Connector>"
        << "<ssd:Connector name='y' kind='output'><ssc:Real/></ssd:Connector></ssd:Connectors></ssd:Component>\n";
  }
  out << "</ssd:Elements><ssd:Connections>";
  for (int i = 1; i < count; ++i) {
    out << "<ssd:Connection startElement='u" << i - 1 << "' startConnector='y' endElement='u" << i << "' endConnector='u'/>\n";
  }
  out << R"(</ssd:Connections></ssd:System>
  <ssd:Annotations><ssc:Annotation type="cotwin.master">
    <cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="1 ms">)"
      << (records ? "" : R"(<cotwin:Recording decimation="1000000000"/>)") << R"(</cotwin:Master>
  </ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>
)";
}

/// Processor time of the programs that a command runs, s.
double seconds_of(const std::string& command) {
  const auto children = [] {
    rusage usage{};
    getrusage(RUSAGE_CHILDREN, &usage);
    const auto seconds = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec); };
    return seconds(usage.ru_utime) + seconds(usage.ru_stime);
  };
  const double before = children();
  if (std::system((command + " >/dev/null 2>&1").c_str()) != 0) throw std::runtime_error("failed: " + command);
  return children() - before;
}

/// Runs whole programs on the same SSP in turn: Cotwin, and ecos (COTWIN_ECOS: its command-line program) if it is given, both without a
/// recording; then Cotwin with a recording of all values. The cost of a step is the difference between a long and a short run.
void whole_runs(int count, const fs::path& folder, double bare) {
  const double few = std::ceil(benchmark::shortened(2e5, 1e4) / count) * kStep,
               many = std::ceil(benchmark::shortened(1e7, 1e5) / count) * kStep;  // s
  const std::string in = (folder / "SystemStructure.ssd").string(), out = (folder / "results").string();
  const std::string ours = "'" + cotwin::places::program() + "' run '" + in + "' --quiet --out '" + out + "' --stop ";
  const auto cost = [&](const std::string& command) {
    return (seconds_of(command + std::to_string(many)) - seconds_of(command + std::to_string(few))) * 1e9 * kStep /
           (many - few) / count;
  };
  const auto median = [](std::vector<double> all) {
    std::sort(all.begin(), all.end());
    return all[all.size() / 2];
  };
  const int repeats = benchmark::shortened(5, 1);
  const std::string chain = "chain of " + std::to_string(count) + " trivial FMUs, cotwin run";
  write_ssd(count, folder, false);
  std::vector<double> a, b;
  const char* const ecos = std::getenv("COTWIN_ECOS");
  for (int i = 0; i < repeats; ++i) {
    a.push_back(cost(ours));
    if (ecos == nullptr) continue;
    b.push_back(cost("cd '" + folder.string() + "' && '" + ecos + "' simulate --noCsv --path '" + folder.string() +
                     "' --stepSize " + std::to_string(kStep) + " --stopTime "));
  }
  benchmark::print(
      {chain + ", processor time per FMU and step", "ns", median(a), "bare loop over the same FMUs", bare, 150, false});
  if (ecos != nullptr) {
    benchmark::print({chain + ", processor time per FMU and step beside ecos", "ns", median(a), "ecos simulate --noCsv",
                      median(b), count == 1 ? 1.2 : 0.7, true});
  }
  write_ssd(count, folder, true);
  a.clear();
  for (int i = 0; i < repeats; ++i) a.push_back(cost(ours));
  benchmark::print({chain + " that records all values, processor time of all threads per FMU and step", "ns", median(a),
                    "bare loop over the same FMUs", bare, 150, false});
}

/// Runs of the same chain with and without recording, long enough that the speed of the writer decides, not the size of the
/// ring. The writer is a thread beside the loop. If it has its own core, only the time by which it is behind counts.
void recorded_chain(int count, const fs::path& folder) {
  const int ticks = benchmark::shortened(2'000'000, 20'000) / count;
  const auto run = [&](bool record) {
    master::MasterOptions options;
    if (record) options.results = folder / "results";
    master::Master master(chain_of(count, folder), std::move(options));
    master.initialise();
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < ticks; ++i) master.step_tick();
    master.finish();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  std::vector<double> with, without;  // s
  for (int i = 0; i < 5; ++i) {
    with.push_back(run(true));
    without.push_back(run(false));
  }
  const auto median = [](std::vector<double> runs) {
    std::sort(runs.begin(), runs.end());
    return runs[runs.size() / 2];
  };
  const double per = 1e9 / ticks / count, stepping = median(without);
  benchmark::print(
      {"recording both variables of " + std::to_string(count) + " trivial FMUs, all written, added time per FMU and step", "ns",
       (median(with) - stepping) * per, "the same run without recording", stepping * per, 1, true});
}

/// The cost per step of an FMU in a process of its own.
void own_process(const fs::path& folder) {
  master::Master own(chain_of(1, folder, "?process=own"), {}), shared(chain_of(1, folder), {});
  own.initialise();
  shared.initialise();
  const auto figures = benchmark::measure(
      [&] {
        for (int i = 0; i < kSteps; ++i) own.step_tick();
      },
      [&] {
        for (int i = 0; i < kSteps; ++i) shared.step_tick();
      });
  benchmark::print({"trivial FMU in a process of its own, per step", "us", figures.ours * 1e6 / kSteps,
                    "in the master's process", figures.peer * 1e6 / kSteps, 0, true});
}

}  // namespace

/// `fmu [chains]`: all rows, or those of chains in whole runs alone.
int main(int argc, char** argv) {
  const fmu::TemporaryFolder folder;
  if (argc > 1 && std::string(argv[1]) == "chains") {
    for (const int count : {1, 10, 100}) whole_runs(count, folder.path(), chain(count, folder.path()));
    return 0;
  }
  for (const Version version : {Version::k2, Version::k3}) drive_train(version, folder.path());
  for (const Version version : {Version::k2, Version::k3}) whole_twin(version, folder.path());
  for (const int count : {1, 10, 100}) whole_runs(count, folder.path(), chain(count, folder.path()));
  for (const int count : {10, 100}) recorded_chain(count, folder.path());
  own_process(folder.path());
}
