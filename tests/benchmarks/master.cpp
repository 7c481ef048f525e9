// The master's own cost: a chain of empty units in the master and in a bare loop that calls step() on the same units, and the
// additional cost of recording every variable.
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "master/run/master.h"
#include "tests/benchmarks/measure.h"

namespace {

using namespace cotwin;
using namespace cotwin::master;

/// Changes its output in every step to a number with many digits, and does nothing else.
class Empty final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "1", "from the unit before");
    v.output("y", y_, "1", "to the unit after");
  }
  void initialise(Time) override { y_ = u_; }
  StepResult step(Time, Duration) override {
    y_ += 1e-3 + 1e-6 * u_;
    return StepResult::kDone;
  }

 private:
  double u_ = 0, y_ = 0;
};

const UnitType kTypes[] = {
    {"empty", "does next to nothing", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Empty>(); }}};

Master chain(int units, const std::filesystem::path& results) {
  Scenario scenario;
  scenario.name = "chain";
  scenario.stop = Time{std::int64_t{4'000'000'000} * 1'000'000};  // longer than any measurement
  scenario.threads = 0;                                           // as many as are useful: one here
  for (int i = 0; i < units; ++i) {
    ComponentSpec spec;
    spec.name = "u" + std::to_string(i);
    spec.source = "unit:empty";
    scenario.components.push_back(spec);
    if (i > 0) scenario.connections.push_back({{"u" + std::to_string(i - 1), "y", ""}, {spec.name, "u", ""}, 1, 0, false, ""});
  }
  scenario.recording.push_back({"*", ""});
  scenario.reports.push_back({"", ReportKind::kSignal, "u0.y", "", ""});
  MasterOptions options;
  options.types = kTypes;
  options.results = results;
  Master master(scenario, std::move(options));
  master.initialise();
  return master;
}

std::vector<Unit*> units_of(Master& master) {
  std::vector<Unit*> units;
  for (Member& member : master.members()) units.push_back(member.instance.unit.get());
  return units;
}

void bare(const std::vector<Unit*>& units, std::int64_t& n) {
  const Duration tick{1'000'000};
  for (Unit* unit : units) benchmark::keep(unit->step(Time{n * tick.ns}, tick));
  ++n;
}

void own_cost(int count) {
  Master ours = chain(count, {}), theirs = chain(count, {});
  const std::vector<Unit*> units = units_of(theirs);
  std::int64_t n = 0;
  constexpr int kTicks = 100;
  const auto figures = benchmark::measure(
      [&] {
        for (int i = 0; i < kTicks; ++i) ours.step_tick();
      },
      [&] {
        for (int i = 0; i < kTicks; ++i) bare(units, n);
      },
      31, 2e-3, benchmark::thread_seconds);
  const double per = 1e9 / kTicks / count;
  benchmark::print({"master, " + std::to_string(count) + " empty units, own cost per unit and step", "ns",
                    (figures.ours - figures.peer) * per, "bare loop over step()", figures.peer * per, count == 1 ? 8.0 : 25.0,
                    false});
}

/// The cost of a step of a trivial FMU in a bare loop: recording a value should cost no more.
constexpr double kTrivialFmu = 62;  // ns

/// Runs long enough that the speed of the writer decides, not the size of the ring.
void recording(int count, const std::filesystem::path& folder) {
  const int ticks = benchmark::shortened(200'000, 2'000);
  const auto seconds = [&](bool record) {
    Master master = chain(count, record ? folder : std::filesystem::path());
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < ticks; ++i) master.step_tick();
    master.finish();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  std::vector<double> with, without;
  for (int i = 0; i < 3; ++i) {
    with.push_back(seconds(true));
    without.push_back(seconds(false));
  }
  std::sort(with.begin(), with.end());
  std::sort(without.begin(), without.end());
  const double per = 1e9 / ticks / (2.0 * count);
  benchmark::print({"recording both variables of " + std::to_string(count) + " units, all written, per value", "ns",
                    (with[1] - without[1]) * per, "the same run without recording", without[1] * per, kTrivialFmu, false});
}

}  // namespace

/// `master [own]`: all rows, or those of the own cost alone.
int main(int argc, char** argv) {
  for (const int count : {1, 10, 100}) own_cost(count);
  if (argc > 1 && std::string(argv[1]) == "own") return 0;
  const auto folder = std::filesystem::temp_directory_path() / "cotwin_benchmark_master";
  recording(10, folder);
  std::filesystem::remove_all(folder);
}
