#include "master/results/run_record.h"

#include <fcntl.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "master/run/columns.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

using nlohmann::ordered_json;

constexpr off_t kReserve = 64 << 10;  // bytes, for the text that close() adds
constexpr std::size_t kMostEvents = 1000;

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    const std::size_t colon = line.find(": ");
    if (line.starts_with("model name") && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "";
}

ordered_json machine(const Build& build) {
  utsname name{};
  uname(&name);
  return {{"host", name.nodename},
          {"system", std::string(name.sysname) + " " + name.release},
          {"processor", processor()},
          {"processors", std::thread::hardware_concurrency()},
          {"instruction_set", build.cpu}};
}

ordered_json value_of(const ParameterValue& value) {
  return std::visit(
      [](const auto& v) -> ordered_json {
        if constexpr (std::is_same_v<std::decay_t<decltype(v)>, double>) {
          if (!std::isfinite(v)) return std::to_string(v);
        }
        return v;
      },
      value.value);
}

ordered_json parameters(const Scenario& scenario) {
  ordered_json all = ordered_json::object();
  for (const ComponentSpec& component : scenario.components) {
    for (const ParameterValue& value : component.start_values) {
      ordered_json& entry = all[component.name + "." + value.name];  // later values replace earlier ones
      entry = ordered_json{{"value", value_of(value)}};
      if (!value.unit.empty()) entry["unit"] = value.unit;
    }
  }
  return all;
}

ordered_json components(const Scenario& scenario) {
  ordered_json all = ordered_json::array();
  for (const ComponentSpec& c : scenario.components) {
    all.push_back({{"name", c.name}, {"source", c.source}, {"stage", c.stage}, {"period", c.period}});
    if (c.beside) all.back()["beside"] = true;
  }
  return all;
}

/// The scheduled changes of values and tools, by time.
ordered_json events(const Scenario& scenario) {
  ordered_json all = ordered_json::array();
  for (const EventSpec& e : scenario.events) {
    if (all.size() == kMostEvents) return all;
    all.push_back({{"time", e.time.seconds()}, {"name", e.variable}, {"value", e.value}});
    if (e.ramp.ns > 0) all.back()["ramp"] = e.ramp.seconds();
  }
  for (const ToolSpec& tool : scenario.tools) {
    if (all.size() == kMostEvents) return all;
    all.push_back({{"time", tool.time.seconds()}, {tool.attach ? "attach" : "detach", tool.name}});
  }
  return all;
}

/// What observers did. A change is repeated by an event with its time, name and value.
ordered_json influence(const Influence& i) {
  ordered_json changes = ordered_json::array();
  for (const Influence::Change& c : i.changes) {
    ordered_json change = {{"tick", c.tick}, {"time", c.time}, {"name", c.name}};
    if (c.kind == Kind::kReal) change["value"] = c.value;
    if (c.kind == Kind::kInteger) change["value"] = static_cast<std::int32_t>(c.value);
    if (c.kind == Kind::kBoolean) change["value"] = c.value != 0;
    if (!c.by.empty()) change["by"] = c.by;
    changes.push_back(std::move(change));
  }
  ordered_json commands = ordered_json::array();
  for (const Influence::Command& c : i.commands) {
    ordered_json command = {{"tick", c.tick}, {"time", c.time}, {"command", text::word_of(c.verb, bus::kRunVerbWords)}};
    if (!c.by.empty()) command["by"] = c.by;
    commands.push_back(std::move(command));
  }
  ordered_json others = ordered_json::array();
  for (const bus::LiveRun::Deed& d : i.others) others.push_back({{"tick", d.tick}, {"what", d.what}, {"by", d.by}});
  return {{"changes", changes},
          {"changes_not_listed", i.more},
          {"commands", commands},
          {"others", others},
          {"refused_requests", i.refused},
          {"pauses", i.pauses},
          {"paused_seconds", i.paused_seconds},
          {"stopped", i.stopped}};
}

std::string dump(const ordered_json& json) { return json.dump(1, ' ', false, ordered_json::error_handler_t::replace) + "\n"; }

/// Reserves space after the end of the file, so that close() succeeds on a full disk. Not all file systems support it.
void reserve(const std::filesystem::path& file, std::size_t size) {
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CLOEXEC);
  if (descriptor < 0) return;
#ifdef FALLOC_FL_KEEP_SIZE
  ::fallocate(descriptor, FALLOC_FL_KEEP_SIZE, 0, static_cast<off_t>(size) + kReserve);
#else
  (void)size;
#endif
  ::close(descriptor);
}

bool write_over(const std::filesystem::path& file, const std::string& text) {
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CLOEXEC);
  if (descriptor < 0) return false;
  const bool written = ::pwrite(descriptor, text.data(), text.size(), 0) == static_cast<ssize_t>(text.size()) &&
                       ::ftruncate(descriptor, static_cast<off_t>(text.size())) == 0;
  return ::close(descriptor) == 0 && written;
}

}  // namespace

struct RunRecord::Content {
  ordered_json json;
};

RunRecord::RunRecord(Given given, const Master& master) : file_(std::move(given.file)), content_(std::make_unique<Content>()) {
  const Scenario& scenario = master.scenario();
  ordered_json& j = content_->json;
  j["format"] = "cotwin run 1";
  j["state"] = "running";
  j["program"] = {{"version", given.build.version}, {"build", hexadecimal(given.build.file)}};
  j["scenario"] = {{"name", scenario.name},
                   {"file", scenario.file.string()},
                   {"folder", std::filesystem::current_path().string()},
                   {"hash", hexadecimal(given.scenario)},
                   {"files_hash", hexadecimal(given.files)}};
  j["begun"] = utc_now();
  if (given.resumed_at) j["resumed_at"] = *given.resumed_at;
  j["process"] = ::getpid();
  j["machine"] = machine(given.build);
  j["start"] = scenario.start.seconds();
  j["stop"] = scenario.stop.seconds();
  j["tick"] = scenario.tick.seconds();
  j["clock"] = text::word_of(scenario.clock.kind, kClockWords);
  j["settings"] = scenario.settings;
  j["set"] = given.set;
  if (!given.events.empty()) j["event"] = given.events;
  if (!given.waypoints.empty()) j["waypoints"] = given.waypoints;
  if (!given.attach.empty()) j["attach"] = given.attach;
  if (!given.detach.empty()) j["detach"] = given.detach;
  j["components"] = components(scenario);
  j["parameters"] = parameters(scenario);
  j["events"] = events(scenario);
  if (!master.unsavable().empty()) j["no_checkpoints"] = master.unsavable();
  if (!given.results.empty()) {
    j["recording"] = {{"file", given.results.filename().string()}, {"every", scenario.decimation}};
    if (given.joint_names) j["recording"]["joint_names"] = true;
    j["recording"]["columns"] = ordered_json::parse(columns_json(master.columns()));
  }
  const std::string text = dump(j);
  ordered_json crashed = j;
  crashed["state"] = "failed";
  crashed["reason"] = "the program, or an FMU in its process, crashed";
  crashed_ = dump(crashed);
  write_file(file_, text);
  reserve(file_, text.size());
  saved_.emplace(save, this, "");
}

/// Called in a signal handler.
void RunRecord::save(void* self) noexcept {
  const RunRecord& record = *static_cast<RunRecord*>(self);
  static_cast<void>(write_over(record.file_, record.crashed_));
}

RunRecord::~RunRecord() = default;

void RunRecord::close(const Summary& summary, const Outcome& outcome) {
  saved_.reset();
  ordered_json& j = content_->json;
  constexpr std::pair<const char*, Outcome::State> kWords[] = {
      {"complete", Outcome::State::kDone}, {"stopped", Outcome::State::kInterrupted}, {"failed", Outcome::State::kFailed}};
  j["state"] = text::word_of(outcome.state, kWords);
  if (!outcome.message.empty()) j["reason"] = outcome.message;
  j["reached"] = summary.reached;
  j["ticks"] = summary.ticks;
  j["rows"] = summary.rows;
  j["dropped_rows"] = summary.dropped_rows;
  j["ended"] = utc_now();
  j["wall_seconds"] = summary.wall_seconds;
  j["threads"] = summary.threads;
  j["warnings"] = summary.warnings;
  if (const Influence& i = summary.influence; i.count() > 0 || !i.commands.empty() || !i.others.empty())
    j["from_outside"] = influence(i);
  const std::string text = dump(j);
  try {
    write_file(file_, text);
  } catch (const Error&) {
    if (!write_over(file_, text)) throw;
  }
}

}  // namespace cotwin::master
