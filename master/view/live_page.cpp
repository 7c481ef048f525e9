#include "master/view/live_page.h"

#include <algorithm>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "master/scenery/recorded.h"
#include "master/scenery/scenery.h"
#include "master/view/packer.h"
#include "master/view/stage_json.h"
#include "master/view/view.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// `text` with `old`, which it must have once, replaced. Throws Error.
std::string with_replaced(std::string text, std::string_view old, std::string_view by, const fs::path& place) {
  const std::size_t at = text.find(old);
  if (at == std::string::npos || text.find(old, at + 1) != std::string::npos)
    throw Error(place.string(), "has not once '" + std::string(old) + "', expected the page of this version");
  return text.replace(at, old.size(), by);
}

/// The signals of a run as a recording without rows. Inputs of joint positions are left out: they are copies of what other components compute.
Recorded signals_of(const bus::LiveRun& run) {
  Recorded signals;
  std::size_t first = 0;
  for (const bus::LiveSignal& s : run.signals()) {
    const bool positions = s.variable == "q" || s.variable == "q_link" || s.variable == "q_c" || s.variable == "q_d" ||
                           s.variable.ends_with(".q") || s.variable.ends_with(".q_d");
    if (s.kind == Kind::kString || (s.role == Role::kInput && positions)) continue;
    if (s.size == 0 || s.role == Role::kParameter) continue;
    signals.signals.push_back({s.name, s.si, first, s.size});
    first += s.size;
  }
  signals.columns.resize(first);
  return signals;
}

/// The numbers of an event's value; empty for a text.
std::vector<double> numbers_of(const std::string& value) {
  if (value == "true" || value == "false") return {value == "true" ? 1.0 : 0.0};
  std::vector<double> numbers;
  std::string words = value;
  std::ranges::replace(words, ',', ' ');
  for (const std::string_view word : text::split(words, ' ')) {
    if (text::trim(word).empty()) continue;
    const std::optional<double> number = text::parse_real(text::trim(word));
    if (!number) return {};
    numbers.push_back(*number);
  }
  return numbers;
}

/// The changes of values that the scenario plans, for people who want one of them now.
Json events_of(const Scenario& scenario) {
  Json events = Json::array();
  for (const EventSpec& event : scenario.events) {
    const std::vector<double> numbers = numbers_of(event.value);
    if (numbers.empty()) continue;
    events.push_back(
        {{"time_s", event.time.seconds()}, {"name", event.variable}, {"values", numbers}, {"ramp_s", event.ramp.seconds()}});
  }
  return events;
}

std::string page_of_gateways() {
  const fs::path file = empty_page();
  std::string html = text::read_file(file, "the page without a recording");
  // It asks its own origin for its content. Pages of recordings may ask for nothing.
  html = with_replaced(std::move(html), "connect-src data:", "connect-src 'self' data:", file);
  return with_replaced(std::move(html), "<!--data-->", R"(<script type="application/json" id="cotwin-live">{}</script>)", file);
}

class GatewayPage final : public bus::RunPage {
 public:
  const std::string& html() const override { return html_; }
  bool shows_runs() const override { return false; }
  std::string content(const bus::LiveRun&) override { return {}; }

 private:
  const std::string html_ = page_of_gateways();
};

class LivePage final : public bus::RunPage {
 public:
  LivePage(Scenario scenario, std::span<const UnitType> types, std::vector<fs::path> folders)
      : scenario_(std::move(scenario)), types_(types), folders_(std::move(folders)), html_(page_of_gateways()) {}

  const std::string& html() const override { return html_; }

  std::string content(const bus::LiveRun& run) override {
    const std::lock_guard lock(mutex_);
    if (content_.empty()) content_ = make(run);
    return content_;
  }

 private:
  std::string make(const bus::LiveRun& run) const {
    const Recorded recorded = signals_of(run);
    const Scenery stage = scenery_of(scenario_, recorded, types_, folders_);
    std::vector<std::string> remarks = stage.remarks;
    Packer packer;
    CalculatedTable none;
    Json page = {{"format", 1}, {"name", scenario_.name}, {"state", ""}, {"facts", facts(run)}, {"tables", Json::array()}};
    page.update(stage_json({stage, recorded, &scenario_, types_, folders_, true}, {}, none, packer, remarks));
    page["remarks"] = remarks;
    page["plots"] = plots(stage, recorded);
    page["events"] = events_of(scenario_);
    page["numbers"] = packer.base64();
    return page.dump(-1, ' ', false, Json::error_handler_t::replace);
  }

  Json facts(const bus::LiveRun& run) const {
    Json facts = Json::array();
    facts.push_back(Json::array({"scenario", scenario_.file.string()}));
    facts.push_back(Json::array({"tick", text::to_text(run.facts().tick.seconds()) + " s"}));
    facts.push_back(Json::array({"clock", run.facts().clock}));
    facts.push_back(Json::array({"accuracy", "a plotted number is within 1/16777216 of itself of the run's"}));
    return facts;
  }

  /// What the scenario reports, otherwise the joints of the robots.
  Json plots(const Scenery& stage, const Recorded& recorded) const {
    std::vector<std::string> names = first_plots(&scenario_, {});
    for (const StagedRobot& robot : stage.robots) {
      for (const StagedTrack& track : robot.tracks) names.push_back(track.signal);
    }
    std::vector<std::string> chosen;
    for (const std::string& name : names) {
      const bool known = std::ranges::find(chosen, name) != chosen.end();
      if (!known && chosen.size() < 2 && recorded.find(name) != nullptr) chosen.push_back(name);
    }
    return chosen;
  }

  const Scenario scenario_;
  const std::span<const UnitType> types_;
  const std::vector<fs::path> folders_;
  std::string html_;
  std::mutex mutex_;
  std::string content_;
};

}  // namespace

std::shared_ptr<bus::RunPage> live_page(Scenario scenario, std::span<const UnitType> types, std::vector<fs::path> folders) {
  return std::make_shared<LivePage>(std::move(scenario), types, std::move(folders));
}

std::shared_ptr<bus::RunPage> gateway_page() { return std::make_shared<GatewayPage>(); }

}  // namespace cotwin::master
