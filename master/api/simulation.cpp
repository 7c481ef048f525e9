#include <algorithm>
#include <cmath>

#include "components/unit/unit_module.h"
#include "fmu/description/rate.h"
#include "fmu/import/load.h"
#include "fmu/process/process.h"
#include "master/api/cotwin.h"
#include "master/api/program_units.h"
#include "master/results/results_folder.h"
#include "master/run/master.h"
#include "master/scenario/folders.h"
#include "models/foundation/support/text.h"

namespace cotwin {

namespace {

namespace fs = std::filesystem;

/// Gives FMUs of other tools a process of their own, unless the scenario chooses, so that they cannot end the calling program.
void isolate_foreign_fmus(master::Scenario& scenario) {
  if (fmu::host_program().empty()) return;
  for (master::ComponentSpec& spec : scenario.components) {
    if (master::is_unit(spec) || spec.process != fmu::ProcessChoice::kAuto) continue;
    const master::FmuSource source = master::fmu_source(spec, scenario);
    if (source.options.process != fmu::ProcessChoice::kAuto) continue;
    try {
      if (fmu::read_fmu_description(source.path).generation_tool == fmu::kGenerationTool) continue;
    } catch (const Error&) {  // the same error comes again, with its place, when the component is loaded
    }
    spec.process = fmu::ProcessChoice::kOwn;
  }
}

/// The scenario with the changes of the options.
master::Scenario changed(master::Scenario scenario, const SimulationOptions& options, std::span<const UnitType> types) {
  for (const std::string& assignment : options.set) master::assign(scenario, assignment, types);
  if (options.stop) {
    constexpr double kMaxSeconds = 9e9;  // 2^63 ns is 9.22e9 s
    if (!(std::abs(*options.stop) <= kMaxSeconds)) throw Error("stop", "expected a time in seconds, 9e9 at most");
    scenario.stop = Time::from_seconds(*options.stop);
  }
  keep_on_the_loops_thread(options.program_units, scenario);
  isolate_foreign_fmus(scenario);
  return scenario;
}

master::Scenario parse(const ScenarioText& text) {
  const fs::path folder = text.folder.empty() ? fs::current_path() : fs::absolute(text.folder);
  return master::parse_scenario(text.xml, text.name, folder);
}

/// The recorded rows of a run in memory.
class Rows {
 public:
  explicit Rows(const master::Master& master) : columns_(master.columns()), every_(master.scenario().decimation) {
    recording_.names = {"time"};
    recording_.units = {"s"};
    recording_.joints = {""};
    for (const master::Column& column : columns_) {
      recording_.names.insert(recording_.names.end(), column.names.begin(), column.names.end());
      const Elements elements = column.signal.of_elements();
      for (std::size_t i = 0; i < column.signal.count; ++i) {
        recording_.units.push_back(column.signal.variable->si_of(column.signal.first + i));
        recording_.joints.push_back(elements.names.empty() ? "" : elements.names[i]);
      }
    }
  }

  /// After the start and after each tick: a row at each multiple of the decimation, and at the end, as the recorder makes them.
  void sample(const master::Master& master) {
    if (master.tick() < next_ || master.tick() == last_) return;
    last_ = master.tick();
    next_ = std::min(master.ticks(), (last_ / every_ + 1) * every_);
    recording_.values.push_back(master.now().seconds());
    for (const master::Column& column : columns_) {
      std::visit(
          [&](auto all) {
            if constexpr (!std::is_same_v<typename decltype(all)::value_type, std::string>) {
              for (const auto value : all.subspan(column.signal.first, column.signal.count))
                recording_.values.push_back(static_cast<double>(value));
            }
          },
          column.signal.variable->storage);
    }
    ++recording_.rows;
  }

  const Recording& recording() const { return recording_; }

 private:
  std::span<const master::Column> columns_;
  std::int64_t every_, next_ = 0, last_ = -1;
  Recording recording_;
};

master::MasterOptions options_of(const SimulationOptions& options, const master::Scenario& scenario,
                                 std::span<const UnitType> types) {
  master::MasterOptions made;
  made.types = types;
  made.folders = options.folders;
  for (fs::path& folder : master::model_folders(scenario.folder)) made.folders.push_back(std::move(folder));
  made.results = options.results;
  made.view_data = !options.results.empty();
  made.threads = options.threads;
  return made;
}

/// `value` as an element of a signal; Error if it is none of its variable's values.
template <class Element>
Element element_of(const master::Signal& signal, double value) {
  const Variable& v = *signal.variable;
  const bool whole = std::is_same_v<Element, double> || value == std::floor(value);
  const double least = std::is_same_v<Element, bool> ? 0 : v.min, most = std::is_same_v<Element, bool> ? 1 : v.max;
  const bool fits = !std::is_same_v<Element, std::int32_t> || std::abs(value) <= 2147483647;
  if (!std::isfinite(value) || !whole || !fits || value < least || value > most)
    throw Error(signal.name + " = " + text::to_text(value),
                "expected " + (std::is_same_v<Element, bool> ? "0 or 1" : allowed_values(v)));
  return static_cast<Element>(value);
}

}  // namespace

struct Simulation::Impl {
  Impl(master::Scenario scenario, const SimulationOptions& options)
      : program_units(options.program_units, load_units(unit_types(), options.units).types),
        master(make(changed(std::move(scenario), options, program_units.types()), options)) {
    if (options.keep_rows) rows.emplace(master);
  }

  master::Master make(master::Scenario scenario, const SimulationOptions& options) {
    if (!options.results.empty())
      results.emplace(fs::current_path() / options.results, options.results);  // an FMU may call chdir()
    master::MasterOptions chosen = options_of(options, scenario, program_units.types());
    chosen.before_results = [this] {
      if (!results) return;
      results->open();
      results->keep_earlier_run();
    };
    const ProgramUnits::Loading loading(program_units);
    return master::Master(std::move(scenario), std::move(chosen));
  }

  master::Signal find(std::string_view name) const {
    return master::find_signal(const_cast<master::Master&>(master).members(), name, "variable");
  }

  /// Throws Error for a signal that must not be written now.
  void check_may_set(const master::Signal& signal) {
    const Variable& v = *signal.variable;
    const bool changeable = v.role == Role::kInput || v.role == Role::kTunable;
    const bool starts = !started && (v.role == Role::kParameter || v.role == Role::kState || v.has_start);
    if (!changeable && !starts) {
      throw Error(signal.name,
                  master::with_article(v.role) + (started ? " after the start, expected an input or a tunable parameter"
                                                          : ", expected a parameter, an input or a state"));
    }
    const master::Member& member = master.members()[signal.member];
    for (const master::ConnectionSpec& c : master.scenario().connections) {
      if (c.to.component != member.name()) continue;
      const FoundElement fed = find_element(member.variables(), c.to.variable);
      const auto first = static_cast<std::ptrdiff_t>(signal.first), last = first + static_cast<std::ptrdiff_t>(signal.count);
      if (fed.variable == &v && (fed.element < 0 || (fed.element >= first && fed.element < last)))
        throw Error(signal.name,
                    "is fed by " + c.from.component + "." + c.from.variable + ", expected an input without a connection");
    }
  }

  void start() {
    if (started) throw Error(master.scenario().name, "was started before");
    master.initialise();
    started = true;
    if (rows) rows->sample(master);
  }
  bool step_tick() {
    if (ended || !master.step_tick()) return false;
    if (rows) rows->sample(master);
    return true;
  }
  /// Closes the files; an error of a last step beside the loop is thrown.
  void finish() {
    ended = true;
    master.finish();
    if (started) results.reset();
  }
  /// A call that steps; after an error nothing can be stepped.
  template <class Call>
  auto stepping(Call call) {
    if (failed) throw Error(master.scenario().name, "the run has failed, expected a new Simulation");
    if (!started) start();
    try {
      return call();
    } catch (...) {
      failed = true;
      throw;
    }
  }

  const ProgramUnits program_units;
  std::optional<master::ResultsFolder> results;  // locked from the start of the run to its end
  master::Master master;
  std::optional<Rows> rows;
  bool started = false, failed = false, ended = false;
};

Simulation::Simulation(const fs::path& scenario, const SimulationOptions& options)
    : impl_(std::make_unique<Impl>(master::load_scenario(scenario), options)) {}
Simulation::Simulation(const ScenarioText& scenario, const SimulationOptions& options)
    : impl_(std::make_unique<Impl>(parse(scenario), options)) {}
Simulation::~Simulation() = default;
Simulation::Simulation(Simulation&&) noexcept = default;
Simulation& Simulation::operator=(Simulation&&) noexcept = default;

std::vector<VariableInfo> Simulation::variables() const {
  std::vector<VariableInfo> all;
  for (const master::Member& member : impl_->master.members()) {
    for (const Variable& v : member.variables()) {
      all.push_back({member.name() + "." + v.name, std::string(name_of(v.role)), std::string(name_of(v.kind())), v.si, v.size(),
                     v.description, v.mixed() ? v.elements->si : std::vector<std::string>()});
    }
  }
  return all;
}

void Simulation::set(std::string_view name, std::span<const double> values) {
  const master::Signal signal = impl_->find(name);
  impl_->check_may_set(signal);
  if (values.size() != signal.count) {
    throw Error(signal.name, std::to_string(values.size()) + " values, expected " + std::to_string(signal.count));
  }
  std::visit(
      [&](auto all) {
        using Element = typename decltype(all)::value_type;
        if constexpr (std::is_same_v<Element, std::string>) {
          throw Error(signal.name, "is a string, expected set_text()");
        } else {
          for (const double value : values) (void)element_of<Element>(signal, value);
          for (std::size_t i = 0; i < values.size(); ++i) all[signal.first + i] = static_cast<Element>(values[i]);
        }
      },
      signal.variable->storage);
  impl_->master.values_changed();
}

void Simulation::set(std::string_view name, double value) { set(name, std::span(&value, 1)); }

void Simulation::set_text(std::string_view name, const std::string& value) {
  const master::Signal signal = impl_->find(name);
  impl_->check_may_set(signal);
  if (signal.variable->kind() != Kind::kString)
    throw Error(signal.name, "'" + value + "' is a text, expected " +
                                 (signal.count == 1 ? "a number" : std::to_string(signal.count) + " numbers"));
  if (signal.count != 1)
    throw Error(signal.name,
                "has " + std::to_string(signal.count) + " texts, expected the name of one: '" + signal.name + "[1]'");
  signal.variable->strings()[signal.first] = value;
  impl_->master.values_changed();
}

std::vector<double> Simulation::get(std::string_view name) const {
  const master::Signal signal = impl_->find(name);
  return std::visit(
      [&](auto all) -> std::vector<double> {
        if constexpr (std::is_same_v<typename decltype(all)::value_type, std::string>) {
          throw Error(signal.name, "is a string, expected get_text()");
        } else {
          const auto part = all.subspan(signal.first, signal.count);
          return {part.begin(), part.end()};
        }
      },
      signal.variable->storage);
}

std::string Simulation::get_text(std::string_view name) const {
  const master::Signal signal = impl_->find(name);
  if (signal.variable->kind() != Kind::kString || signal.count != 1) throw Error(signal.name, "is no string, expected get()");
  return signal.variable->strings()[signal.first];
}

std::span<const double> Simulation::view(std::string_view name) const {
  const master::Signal signal = impl_->find(name);
  if (signal.variable->kind() != Kind::kReal) throw Error(signal.name, "is not real, expected get()");
  return signal.reals();
}

void Simulation::start() { impl_->start(); }
double Simulation::time() const { return impl_->master.now().seconds(); }
bool Simulation::step() {
  return impl_->stepping([this] {
    if (impl_->step_tick()) return true;
    impl_->finish();
    return false;
  });
}

bool Simulation::run_to(double t) {
  const Time end = Time::from_seconds(t);
  return impl_->stepping([&] {
    while (impl_->master.now() < end) {
      if (!impl_->step_tick()) {
        impl_->finish();
        return false;
      }
    }
    return true;
  });
}

RunResult Simulation::run() {
  impl_->stepping([this] {
    while (impl_->step_tick()) {
    }
    impl_->finish();
    return true;
  });
  return result();
}

void Simulation::finish() { impl_->finish(); }
double Simulation::stop() const { return impl_->master.scenario().stop.seconds(); }

Recording Simulation::recording() const {
  if (!impl_->rows) throw Error(impl_->master.scenario().name, "keeps no rows, expected keep_rows among its options");
  return impl_->rows->recording();
}

RunResult Simulation::result() const {
  const master::Summary summary = impl_->master.summary();
  RunResult result{summary.start,    summary.reached,   summary.stop, summary.ticks, summary.wall_seconds, {},
                   summary.warnings, summary.recording, summary.rows};
  for (const master::Tally& t : summary.tallies)
    result.figures.push_back({t.name, t.what, t.si, t.rms, t.max, t.total_rms, t.total_max, t.elements.si});
  return result;
}

}  // namespace cotwin
