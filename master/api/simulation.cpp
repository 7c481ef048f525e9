#include <algorithm>
#include <cmath>

#include "components/unit/unit_module.h"
#include "master/api/cotwin.h"
#include "master/program/folders.h"
#include "master/run/master.h"
#include "models/support/text.h"

namespace cotwin {

namespace {

namespace fs = std::filesystem;

master::Scenario load(const fs::path& file, const SimulationOptions& options, std::span<const UnitType> types) {
  master::Scenario scenario = master::load_scenario(file);
  for (const std::string& assignment : options.set) master::assign(scenario, assignment, types);
  if (options.stop) {
    constexpr double kMaxSeconds = 9e9;  // 2^63 ns is 9.22e9 s
    if (!(std::abs(*options.stop) <= kMaxSeconds)) throw Error("stop", "expected a time in seconds, 9e9 at most");
    scenario.stop = Time::from_seconds(*options.stop);
  }
  return scenario;
}

master::MasterOptions options_of(const SimulationOptions& options, const master::Scenario& scenario,
                                 std::span<const UnitType> types) {
  master::MasterOptions made;
  made.types = types;
  made.folders = options.folders;
  for (fs::path& folder : master::model_folders(scenario.folder)) made.folders.push_back(std::move(folder));
  made.results = options.results;
  made.threads = options.threads;
  made.before_results = [folder = options.results] {
    if (!folder.empty()) fs::create_directories(folder);
  };
  return made;
}

/// `value` as an element of a variable; Error if it is none of the variable's values.
template <class Element>
Element element_of(const Variable& v, double value) {
  const bool whole = std::is_same_v<Element, double> || value == std::floor(value);
  const double least = std::is_same_v<Element, bool> ? 0 : v.min, most = std::is_same_v<Element, bool> ? 1 : v.max;
  const bool fits = !std::is_same_v<Element, std::int32_t> || std::abs(value) <= 2147483647;
  if (!std::isfinite(value) || !whole || !fits || value < least || value > most)
    throw Error(v.name + " = " + text::to_text(value),
                "expected " + (std::is_same_v<Element, bool> ? "0 or 1" : allowed_values(v)));
  return static_cast<Element>(value);
}

}  // namespace

struct Simulation::Impl {
  Impl(const fs::path& file, const SimulationOptions& options)
      : types(load_units(unit_types(), options.units).types), master(make(load(file, options, types), options)) {}

  master::Master make(master::Scenario scenario, const SimulationOptions& options) const {
    master::MasterOptions chosen = options_of(options, scenario, types);
    return master::Master(std::move(scenario), std::move(chosen));
  }

  master::Signal find(std::string_view name) const {
    return master::find_signal(const_cast<master::Master&>(master).members(), name, "variable");
  }

  /// Throws Error for a signal that must not be written now.
  void check_may_set(const master::Signal& signal) {
    const Variable& v = *signal.variable;
    const bool changeable = v.role == Role::kInput || v.role == Role::kTunable;
    if (!started && (changeable || v.role == Role::kParameter || v.role == Role::kState || v.has_start)) return;
    if (!started || !changeable) {
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
  }
  /// At the end of the run the files are closed, and an error of a last step beside the loop is thrown.
  bool step_tick() {
    if (master.step_tick()) return true;
    master.finish();
    return false;
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

  const std::vector<UnitType> types;
  master::Master master;
  bool started = false, failed = false;
};

Simulation::Simulation(const fs::path& scenario, const SimulationOptions& options)
    : impl_(std::make_unique<Impl>(scenario, options)) {}
Simulation::~Simulation() = default;
Simulation::Simulation(Simulation&&) noexcept = default;
Simulation& Simulation::operator=(Simulation&&) noexcept = default;

std::vector<VariableInfo> Simulation::variables() const {
  std::vector<VariableInfo> all;
  for (const master::Member& member : impl_->master.members()) {
    for (const Variable& v : member.variables()) {
      all.push_back({member.name() + "." + v.name, std::string(name_of(v.role)), std::string(name_of(v.kind())), v.si, v.size(),
                     v.description});
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
          for (const double value : values) (void)element_of<Element>(*signal.variable, value);
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
  if (signal.variable->kind() != Kind::kString || signal.count != 1) throw Error(signal.name, "is no string, expected set()");
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

void Simulation::start() { impl_->start(); }
double Simulation::time() const { return impl_->master.now().seconds(); }
bool Simulation::step() {
  return impl_->stepping([this] { return impl_->step_tick(); });
}

bool Simulation::run_to(double t) {
  const Time end = Time::from_seconds(t);
  return impl_->stepping([&] {
    while (impl_->master.now() < end) {
      if (!impl_->step_tick()) return false;
    }
    return true;
  });
}

RunResult Simulation::run() {
  impl_->stepping([this] {
    while (impl_->master.step_tick()) {
    }
    impl_->master.finish();
    return true;
  });
  return result();
}

RunResult Simulation::result() const {
  const master::Summary summary = impl_->master.summary();
  RunResult result{summary.start,    summary.reached,   summary.stop, summary.ticks, summary.wall_seconds, {},
                   summary.warnings, summary.recording, summary.rows};
  for (const master::Tally& t : summary.tallies)
    result.figures.push_back({t.name, t.what, t.si, t.rms, t.max, t.total_rms, t.total_max});
  return result;
}

}  // namespace cotwin
