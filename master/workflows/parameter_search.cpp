#include "master/workflows/parameter_search.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "master/engine/wiring/members.h"
#include "master/run/master.h"
#include "master/scenario/folders.h"
#include "master/workflows/watched.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

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
    return std::copysign(std::sqrt(std::abs(low)) * std::sqrt(std::abs(high)), high);
  }
  std::string name;
  double low = 0, high = 0;
  double width = 0;  // at the start
};

}  // namespace

class ParameterSearch::Impl {
 public:
  Impl(const SearchSettings& settings, std::span<const UnitType> types, SearchHooks hooks)
      : settings_(settings),
        types_(types),
        hooks_(std::move(hooks)),
        varied_(settings.vary),
        condition_(settings.until, "--until " + settings.until),
        scenario_(load_scenario(settings.file)) {
    scenario_.folder = std::filesystem::current_path() / scenario_.folder;  // an FMU may call chdir()
    for (const std::string& assignment : settings.set) assign(scenario_, assignment, types_);
    constexpr double kMaxSeconds = 9e9;  // 2^63 ns is 9.22e9 s
    if (settings.stop && !(std::abs(*settings.stop) <= kMaxSeconds))
      throw Error("--stop " + text::to_text(*settings.stop),
                  "expected a time in seconds, " + text::to_text(kMaxSeconds) + " at most");
    if (settings.stop) scenario_.stop = Time::from_seconds(*settings.stop);
    scenario_.clock = {};
    if (!(settings.tolerance > 0 && settings.tolerance < 1))
      throw Error("--tolerance", text::to_text(settings.tolerance) + ", expected a share between 0 and 1");
  }

  bool search() {
    const bool at_low = run(varied_.low);
    holds_above_ = run(varied_.high);
    if (hooks_.stops()) return false;
    if (at_low == holds_above_) {
      throw Error("--vary " + settings_.vary, "the condition " + settings_.until + " holds " +
                                                  (at_low ? "at both ends" : "at neither end") +
                                                  " of the interval, expected it at one of them");
    }
    while (!varied_.is_narrow(settings_.tolerance)) {
      const double middle = varied_.middle();
      if (!(middle > varied_.low && middle < varied_.high)) break;
      (run(middle) == at_low ? varied_.low : varied_.high) = middle;
      if (hooks_.stops()) return false;
    }
    return true;
  }

  const SearchSettings settings_;
  std::span<const UnitType> types_;
  SearchHooks hooks_;
  Varied varied_;
  Condition condition_;
  Scenario scenario_;
  std::vector<SearchRun> made_;
  bool runs_now_ = false, holds_above_ = false;

 private:
  bool run(double value) {
    if (hooks_.stops()) return false;
    Scenario scenario = scenario_;
    assign(scenario, varied_.name + "=" + text::to_text(value), types_);
    MasterOptions options;
    options.types = types_;
    options.folders = model_folders(scenario.folder);
    options.threads = settings_.threads;
    Master master(std::move(scenario), std::move(options));
    const Watched watched(master.members(), condition_.name, condition_.place);
    std::vector<Watched> shown;
    for (const std::string& name : settings_.peaks) shown.emplace_back(master.members(), name, "--peak " + name);
    master.initialise();
    for (const std::string& warning : master.warnings()) {
      if (warned_.insert(without_numbers(warning)).second) hooks_.warn(warning);
    }
    SearchRun result{value, false, 0, std::vector<double>(shown.size(), 0.0)};
    const auto look = [&] {
      for (std::size_t k = 0; k < shown.size(); ++k) result.peaks[k] = std::max(result.peaks[k], shown[k].largest());
      for (std::size_t k = 0; k < watched.size(); ++k) result.holds = result.holds || condition_.holds(watched.at(k));
    };
    runs_now_ = true;
    look();
    try {
      while (!result.holds && !hooks_.stops() && master.step_tick()) look();
      master.finish();
    } catch (const Error& error) {
      throw Error(varied_.name + "=" + text::to_text(value), error.what());
    }
    result.time = master.now().seconds();
    runs_now_ = false;
    if (hooks_.stops()) return false;
    made_.push_back(result);
    hooks_.ended(result);
    return result.holds;
  }

  std::set<std::string> warned_;
};

ParameterSearch::ParameterSearch(const SearchSettings& settings, std::span<const UnitType> types, SearchHooks hooks)
    : impl_(std::make_unique<Impl>(settings, types, std::move(hooks))) {}
ParameterSearch::~ParameterSearch() = default;

bool ParameterSearch::search() { return impl_->search(); }
bool ParameterSearch::runs() const { return impl_->runs_now_; }
const std::string& ParameterSearch::scenario() const { return impl_->scenario_.name; }
const std::string& ParameterSearch::variable() const { return impl_->varied_.name; }
double ParameterSearch::low() const { return impl_->varied_.low; }
double ParameterSearch::high() const { return impl_->varied_.high; }
double ParameterSearch::critical() const { return impl_->varied_.middle(); }
bool ParameterSearch::holds_above() const { return impl_->holds_above_; }
const std::vector<SearchRun>& ParameterSearch::made() const { return impl_->made_; }

}  // namespace cotwin::master
