// cotwin search: finds the value of a parameter at which a condition begins or ceases to hold, by bisection over runs.
#include <cmath>
#include <csignal>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "master/program/commands/commands.h"
#include "master/program/interrupt.h"
#include "master/run/master.h"
#include "models/support/atomic_file.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path file;
  std::string vary, until, json;
  std::vector<std::string> set, peaks;
  double tolerance = 1e-3;
  std::optional<double> stop;
  std::optional<int> threads;
  bool quiet = false;
};

/// "component.variable=low:high"
struct Varied {
  explicit Varied(const std::string& text) {
    const auto fail = [&] { return Error("--vary " + text, "expected component.variable=LOW:HIGH with LOW < HIGH"); };
    const std::size_t equals = text.find('='), colon = text.find(':', equals == std::string::npos ? 0 : equals);
    if (equals == std::string::npos || colon == std::string::npos) throw fail();
    name = text.substr(0, equals);
    const auto from = text::parse_real(text.substr(equals + 1, colon - equals - 1)),
               to = text::parse_real(text.substr(colon + 1));
    if (!from || !to || !std::isfinite(*from) || !std::isfinite(*to) || !(*from < *to)) throw fail();
    low = *from;
    high = *to;
    width = high - low;
  }
  /// Relative to the larger end; while the interval includes 0, to the whole interval that is searched.
  bool is_narrow(double tolerance) const {
    const bool has_zero = low <= 0 && high >= 0;
    return high - low <= tolerance * (has_zero ? width : std::max(std::abs(low), std::abs(high)));
  }
  /// Between two values of one sign, which may differ by orders of magnitude: their geometric mean.
  double middle() const {
    if (!(low > 0 || high < 0)) return low + (high - low) / 2;
    return std::copysign(std::sqrt(low) * std::sqrt(high), high);
  }
  std::string name;
  double low = 0, high = 0;
  double width = 0;  // at the start
};

/// The text without its numbers, by which warnings of runs with different values are compared.
std::string without_numbers(const std::string& text) {
  std::string rest;
  for (std::size_t k = 0; k < text.size(); ++k) {
    const auto is_digit = [&](std::size_t at) { return at < text.size() && text[at] >= '0' && text[at] <= '9'; };
    const bool is_part = text[k] == '.' || text[k] == 'e' || text[k] == '-' || text[k] == '+';
    if (!is_digit(k) && !(is_part && (is_digit(k + 1) || (k > 0 && is_digit(k - 1))))) rest += text[k];
  }
  return rest;
}

/// "component.variable", true or not 0, or a comparison of it with a number: "component.variable>0.1"
struct Condition {
  explicit Condition(const std::string& text) : place("--until " + text) {
    const std::size_t at = text.find_first_of("<>");
    name = std::string(text::trim(std::string_view(text).substr(0, at)));
    if (at == std::string::npos) return;
    sign = text[at];
    or_equal = at + 1 < text.size() && text[at + 1] == '=';
    const auto number = text::parse_real(text::trim(std::string_view(text).substr(at + (or_equal ? 2 : 1))));
    if (!number || std::isnan(*number))
      throw Error(place, "expected a variable, or a comparison of one with a number, as world.x>0.1");
    limit = *number;
  }
  bool holds(double value) const {
    if (sign == '>') return or_equal ? value >= limit : value > limit;
    if (sign == '<') return or_equal ? value <= limit : value < limit;
    return value != 0;
  }
  std::string place, name;
  char sign = 0;
  bool or_equal = false;
  double limit = 0;
};

/// A variable as numbers; booleans are 0 or 1.
class Watched {
 public:
  Watched(std::span<const Member> members, const std::string& name, const std::string& place)
      : signal_(find_signal(members, name, place)) {
    if (signal_.variable->kind() == Kind::kString) throw Error(place, name + " is a text, expected numbers");
  }
  std::size_t size() const { return signal_.count; }
  double at(std::size_t element) const {
    const Variable& v = *signal_.variable;
    const std::size_t k = signal_.first + element;
    if (v.kind() == Kind::kReal) return v.reals()[k];
    return v.kind() == Kind::kInteger ? v.integers()[k] : static_cast<double>(v.booleans()[k]);
  }
  double largest() const {
    double most = 0;
    for (std::size_t k = 0; k < size(); ++k) most = std::max(most, std::abs(at(k)));
    return most;
  }

 private:
  Signal signal_;
};

struct Run {
  double value = 0;
  bool holds = false;
  double time = 0;            // s: when the condition held first, otherwise the end of the run
  std::vector<double> peaks;  // largest magnitudes up to then
};

class Search {
 public:
  explicit Search(const Arguments& arguments)
      : arguments_(arguments), varied_(arguments.vary), condition_(arguments.until), scenario_(load_scenario(arguments.file)) {
    for (const std::string& assignment : arguments.set) assign(scenario_, assignment, units());
    constexpr double kMaxSeconds = 9e9;  // 2^63 ns is 9.22e9 s
    if (arguments.stop && !(std::abs(*arguments.stop) <= kMaxSeconds))
      throw Error("--stop " + text::to_text(*arguments.stop),
                  "expected a time in seconds, " + text::to_text(kMaxSeconds) + " at most");
    if (arguments.stop) scenario_.stop = Time::from_seconds(*arguments.stop);
    scenario_.clock = {};
    if (!(arguments.tolerance > 0 && arguments.tolerance < 1))
      throw Error("--tolerance", text::to_text(arguments.tolerance) + ", expected a share between 0 and 1");
  }

  /// Throws Error for a scenario, variable or interval that cannot be searched; a run that fails is told by the exit code.
  int search() {
    if (!arguments_.quiet && arguments_.json != "-") print_head();
    const bool at_low = run(varied_.low), at_high = run(varied_.high);
    if (stop_signal() != 0) return kExitSignalled + stop_signal();
    if (at_low == at_high) {
      throw Error("--vary " + arguments_.vary, "the condition " + arguments_.until + " holds " +
                                                   (at_low ? "at both ends" : "at neither end") +
                                                   " of the interval, expected it at one of them");
    }
    while (!varied_.is_narrow(arguments_.tolerance)) {
      const double middle = varied_.middle();
      if (!(middle > varied_.low && middle < varied_.high)) break;
      (run(middle) == at_low ? varied_.low : varied_.high) = middle;
      if (stop_signal() != 0) return kExitSignalled + stop_signal();
    }
    report(at_high);
    return kExitDone;
  }

  /// Whether a run has begun and not ended.
  bool runs() const { return runs_now_; }

 private:
  bool run(double value) {
    if (stop_signal() != 0) return false;
    Scenario scenario = scenario_;
    assign(scenario, varied_.name + "=" + text::to_text(value), units());
    MasterOptions options;
    options.types = units();
    options.folders = model_folders(scenario.folder);
    options.threads = arguments_.threads;
    Master master(std::move(scenario), std::move(options));
    const Watched watched(master.members(), condition_.name, condition_.place);
    std::vector<Watched> shown;
    for (const std::string& name : arguments_.peaks) shown.emplace_back(master.members(), name, "--peak " + name);
    master.initialise();
    for (const std::string& warning : master.warnings()) {
      if (warned_.insert(without_numbers(warning)).second) std::cerr << "cotwin: warning: " << warning << '\n';
    }
    Run result{value, false, 0, std::vector<double>(shown.size(), 0.0)};
    const auto look = [&] {
      for (std::size_t k = 0; k < shown.size(); ++k) result.peaks[k] = std::max(result.peaks[k], shown[k].largest());
      for (std::size_t k = 0; k < watched.size(); ++k) result.holds = result.holds || condition_.holds(watched.at(k));
    };
    runs_now_ = true;
    look();
    try {
      while (!result.holds && stop_signal() == 0 && master.step_tick()) look();
      master.finish();
    } catch (const Error& error) {
      throw Error(varied_.name + "=" + text::to_text(value), error.what());
    }
    result.time = master.now().seconds();
    runs_now_ = false;
    if (stop_signal() != 0) return false;
    runs_.push_back(result);
    if (!arguments_.quiet && arguments_.json != "-") print(result);
    return result.holds;
  }

  void print_head() const {
    std::cout << varied_.name << ": " << arguments_.until;
    for (const std::string& name : arguments_.peaks) std::cout << ", largest " << name;
    std::cout << '\n';
  }
  void print(const Run& run) const {
    std::cout << text::to_text(run.value, 10) << ": "
              << (run.holds ? "holds at " + text::to_text(run.time, 6) + " s" : "does not hold");
    for (const double peak : run.peaks) std::cout << ", " << text::to_text(peak, 8);
    std::cout << std::endl;
  }

  void report(bool holds_above) const {
    const double critical = varied_.middle();
    if (!arguments_.quiet && arguments_.json != "-") {
      std::cout << varied_.name << " = " << text::to_text(critical, 8) << " (" << text::to_text(varied_.low, 10) << " to "
                << text::to_text(varied_.high, 10) << "): " << arguments_.until << " holds "
                << (holds_above ? "above" : "below") << '\n';
    }
    if (arguments_.json.empty()) return;
    nlohmann::ordered_json j;
    j["scenario"] = scenario_.name;
    j["variable"] = varied_.name;
    j["condition"] = arguments_.until;
    j["critical"] = critical;
    j["low"] = varied_.low;
    j["high"] = varied_.high;
    j["holds"] = holds_above ? "above" : "below";
    j["runs"] = nlohmann::ordered_json::array();
    for (const Run& run : runs_) {
      nlohmann::ordered_json one{{"value", run.value}, {"holds", run.holds}, {"time", run.time}};
      for (std::size_t k = 0; k < arguments_.peaks.size(); ++k) one["peaks"][arguments_.peaks[k]] = run.peaks[k];
      j["runs"].push_back(one);
    }
    if (arguments_.json == "-") {
      std::cout << j.dump(2) << '\n';
    } else {
      write_file(arguments_.json, j.dump(2) + "\n");
    }
  }

  const Arguments& arguments_;
  Varied varied_;
  Condition condition_;
  Scenario scenario_;
  std::vector<Run> runs_;
  std::set<std::string> warned_;
  bool runs_now_ = false;
};

}  // namespace

void add_search(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "search", "Find the value of a parameter at which a condition begins or ceases to hold, by bisection over runs");
  command->add_option("FILE", all->file, "System structure (.ssd) or package (.ssp)")->type_name("FILE")->required();
  command->add_option("--vary", all->vary, "Parameter and the interval that is searched, e.g. compliance.S_T=100:10000")
      ->type_name("NAME=LOW:HIGH")
      ->required();
  command
      ->add_option(
          "--until", all->until,
          "Condition that must hold at one end of the interval only, at any time of a run: a variable that is true or not\n"
          "0, or a comparison, e.g. 'world.pad.dent>0'. It ends the run")
      ->type_name("CONDITION")
      ->required();
  command
      ->add_option(
          "--tolerance", all->tolerance,
          "Width of the interval at which the search ends, relative to its larger end, or to the whole interval while\n"
          "it includes 0")
      ->type_name("SHARE")
      ->capture_default_str();
  command->add_option("--peak", all->peaks, "Variable whose largest magnitude in each run is told; may be repeated")
      ->type_name("NAME")
      ->allow_extra_args(false);
  command->add_option("--set", all->set, "As for cotwin run; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  command->add_option("--stop,--stop-time", all->stop, "Stop time in seconds; replaces that of the file")->type_name("SECONDS");
  command->add_option("--threads", all->threads, "Largest number of threads (default: chosen automatically)")
      ->check(CLI::Range(1, 255))
      ->type_name("N");
  command->add_option("--json", all->json, "Write the result as JSON, to stdout with -")->type_name("FILE|-");
  command->add_flag("--quiet", all->quiet, "No table");
  command->footer(
      "Each run begins anew with the scenario's start values; nothing is recorded. Where the interval does not include 0, its\n"
      "geometric middle is tried. A run that fails ends the search with its error.");
  command->callback([all, &chosen] {
    chosen = [all] {
      note_signals();
      Search search(*all);
      try {
        return search.search();
      } catch (const Error& error) {
        if (!search.runs()) throw;
        std::cerr << "cotwin: " << error.what() << '\n';
        return static_cast<int>(kExitRunFailed);
      }
    };
  });
}

}  // namespace cotwin::master
