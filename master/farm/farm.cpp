#include "master/farm/farm.h"

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "master/run/master.h"
#include "master/scenario/folders.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file_hash.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

using WallClock = std::chrono::steady_clock;

constexpr std::size_t kMostWaiting = 4096;  // rows that wait for the registry
constexpr double kMostSeconds = 9e9;        // 2^63 ns is 9.22e9 s

double seconds_since(WallClock::time_point begin) { return std::chrono::duration<double>(WallClock::now() - begin).count(); }

}  // namespace

Farm::Farm(Study study, std::span<const UnitType> types)
    : study_(std::move(study)), types_(types), scenario_(load_scenario(study_.scenario)) {
  scenario_.folder = std::filesystem::current_path() / scenario_.folder;
  folders_ = model_folders(scenario_.folder);
  if (study_.stop) {
    if (!(std::abs(*study_.stop) <= kMostSeconds))
      throw Error("stop_s", text::to_text(*study_.stop) + ", expected " + text::to_text(kMostSeconds) + " s at most");
    scenario_.stop = Time::from_seconds(*study_.stop);
  }
  scenario_.clock = {};
  try_values();
}

Scenario Farm::scenario_of(const std::vector<std::string>& point) const {
  Scenario scenario = scenario_;
  for (const std::string& assignment : study_.assignments(point)) assign(scenario, assignment, types_);
  for (ComponentSpec& component : scenario.components) {
    if (!is_unit(component)) component.source = with_setting(component.source, "process", "own");
  }
  return scenario;
}

Master Farm::master_of(Scenario scenario) const {
  MasterOptions options;
  options.types = types_;
  options.folders = folders_;
  options.models = models_;
  options.threads = 1;
  return Master(std::move(scenario), std::move(options));
}

void Farm::try_values() {
  const auto attempt = [&](const std::vector<std::string>& point) {
    Scenario scenario = scenario_of(point);
    scenarios_ = scenarios_ * 0x100000001b3u ^ hash_of(scenario);
    return master_of(std::move(scenario));
  };
  const std::vector<std::string> typical = study_.design.typical();
  Master master = [&] {
    try {
      return attempt(typical);
    } catch (const Error& error) {
      std::string values;
      for (std::size_t k = 0; k < typical.size(); ++k) text::append(values, study_.design.factors[k].name + "=" + typical[k]);
      throw Error(values, error.what());
    }
  }();
  for (const Member& member : master.members()) {
    if (reaches_outside(member))
      throw Error("component '" + member.name() + "'",
                  "reaches a robot, a bus or a network, expected none in a study: many runs would reach it at once");
  }
  name_figures(master);
  for (const Design::Extreme& extreme : study_.design.extremes()) {
    try {
      Master tried = attempt(extreme.point);
      for (const Member& member : tried.members()) member.variables().check_ranges();
    } catch (const Error& error) {
      throw Error(extreme.what, error.what());
    }
  }
}

void Farm::name_figures(Master& master) {
  keep_ = study_.keep;
  const auto read_names = [&] {
    figures_.clear();
    for (Figures::Named& figure : Figures(keep_, master).all(master.summary())) figures_.push_back(std::move(figure.name));
  };
  read_names();
  for (const std::string& text : study_.success) {
    const Condition condition = success_condition(text);
    if (std::ranges::find(figures_, condition.name) != figures_.end()) continue;
    keep_.push_back(condition.name);
    read_names();
  }
  for (const std::string& text : study_.success) {
    Condition condition = success_condition(text);
    const auto at = std::ranges::find(figures_, condition.name);
    if (at == figures_.end())
      throw Error(condition.place, "has several elements, expected one of them, as in " + condition.name + "[1]");
    success_.emplace_back(std::move(condition), static_cast<std::size_t>(at - figures_.begin()));
  }
  if (figures_.empty())
    throw Error("keep", "nothing is kept of a run, expected figures, or a variable as in 'peak world.force'");
}

Facts Farm::facts(const Build& build) const {
  return {{"study", study_.text},
          {"table", study_.table.empty() ? "none" : hexadecimal(hash_of_file(study_.table))},
          {"scenario", hexadecimal(scenarios_)},
          {"models", hexadecimal(hash_of(*models_))},
          {"program", "cotwin " + build.version + " (build " + hexadecimal(build.file) + ")"},
          {"instruction set", build.cpu}};
}

RunRow Farm::run(std::int64_t number, const std::function<bool()>& stops) const {
  RunRow row;
  row.run = number;
  row.values = study_.design.point(number);
  const WallClock::time_point begin = WallClock::now();
  std::optional<Master> master;
  try {
    master.emplace(master_of(scenario_of(row.values)));
    Figures figures(keep_, *master);
    master->initialise();
    figures.sample();
    while (!stops() && master->step_tick()) {
      figures.sample();
      if (seconds_since(begin) > study_.limit)
        throw Error("limit_s", "the run has taken " + text::to_text(study_.limit) +
                                   " s and is at t = " + text::to_text(master->now().seconds()) + " s");
    }
    master->finish();
    const Summary summary = master->summary();
    const std::vector<Figures::Named> all = figures.all(summary);
    for (std::size_t k = 0; k < figures_.size(); ++k) {
      if (k >= all.size() || all[k].name != figures_[k])
        throw Error(figures_[k], "is not a figure of this run, expected the figures of run 1");
    }
    row.warnings = summary.warnings;
    for (const auto& [condition, figure] : success_) {
      if (std::isnan(all[figure].value)) throw Error(condition.place, "the value is not a number");
      row.success = row.success.value_or(true) && condition.holds(all[figure].value);
    }
    for (const Figures::Named& figure : all) row.figures.push_back(figure.value);
  } catch (const std::exception& error) {
    row.failure = error.what();
    row.success.reset();
  }
  if (master) row.time = master->now().seconds();
  row.seconds = seconds_since(begin);
  return row;
}

std::vector<RunRow> Farm::sample(const std::function<bool()>& stops) const {
  constexpr double kMostSampled = 20;  // s
  std::vector<RunRow> rows;
  double seconds = 0;
  for (const std::int64_t number : std::set{std::int64_t{1}, (study_.design.runs + 1) / 2, study_.design.runs}) {
    if (seconds > kMostSampled) break;
    RunRow row = run(number, stops);
    if (stops()) break;  // perhaps in its middle
    seconds += row.seconds;
    rows.push_back(std::move(row));
  }
  return rows;
}

void Farm::run_all(int threads, const std::function<std::int64_t()>& next, const std::function<bool()>& stops,
                   const std::function<void(std::span<const RunRow>)>& sink) const {
  std::mutex mutex;
  std::condition_variable has_rows, has_room;
  std::vector<RunRow> rows;
  int working = threads;
  std::exception_ptr trouble;
  std::atomic<bool> ends = false;
  const auto is_ended = [&] { return ends || stops(); };
  const auto work = [&] {
    for (;;) {
      std::int64_t number = 0;
      {
        std::unique_lock lock(mutex);
        has_room.wait(lock, [&] { return ends || rows.size() < kMostWaiting; });
        if (is_ended()) break;
        number = next();
        if (number == 0) break;
      }
      RunRow row;
      try {
        row = run(number, is_ended);
      } catch (...) {
        const std::lock_guard lock(mutex);
        trouble = std::current_exception();
        ends = true;
        break;
      }
      if (is_ended()) break;  // perhaps in its middle
      const std::lock_guard lock(mutex);
      rows.push_back(std::move(row));
      has_rows.notify_one();
    }
    const std::lock_guard lock(mutex);
    --working;
    has_rows.notify_one();
  };
  std::vector<std::jthread> workers;
  for (int k = 0; k < threads; ++k) workers.emplace_back(work);
  try {
    for (bool is_last = false; !is_last;) {
      std::vector<RunRow> batch;
      {
        std::unique_lock lock(mutex);
        has_rows.wait_for(lock, std::chrono::milliseconds(200), [&] { return !rows.empty() || working == 0; });
        batch.swap(rows);
        is_last = working == 0;
        has_room.notify_all();
      }
      sink(batch);
    }
  } catch (...) {
    {
      const std::lock_guard lock(mutex);
      ends = true;
    }
    has_room.notify_all();
    workers.clear();
    throw;
  }
  workers.clear();
  if (trouble) std::rethrow_exception(trouble);
}

bool Farm::fill(Registry& registry, int threads, const FarmHooks& hooks) const {
  const std::vector<bool> over = registry.over(study_.design.runs);
  const Registry::Totals before = registry.totals();
  std::int64_t ended = before.done + before.failed, failed = before.failed;
  const std::int64_t session = registry.begin_session(this_process(threads));
  const auto next = [&, last = std::int64_t{0}]() mutable {
    while (last < study_.design.runs && over[static_cast<std::size_t>(last)]) ++last;
    return last < study_.design.runs ? ++last : 0;
  };
  run_all(threads, next, hooks.stops, [&](std::span<const RunRow> rows) {
    if (!rows.empty()) registry.add(rows, session);
    ended += static_cast<std::int64_t>(rows.size());
    failed += std::ranges::count_if(rows, [](const RunRow& row) { return !row.failure.empty(); });
    hooks.progress(ended, failed, "");
  });
  return ended == study_.design.runs;
}

std::size_t Farm::bytes_of_twin() const {
  const auto used = [] { return mallinfo2().uordblks + mallinfo2().hblkhd; };
  const std::size_t before = used();
  Master master = master_of(scenario_of(study_.design.typical()));
  master.initialise();
  return used() - before;
}

std::string difference(const Facts& was, const Facts& now) {
  std::string all;
  for (const auto& [name, value] : now) {
    if (const std::string& before = fact_of(was, name, "the study"); before != value)
      text::append(all, "the " + name + " is " + value + ", was " + before, "; ");
  }
  return all;
}

}  // namespace cotwin::master
