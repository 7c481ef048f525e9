#include <nlohmann/json.hpp>

#include "master/program/commands/run/run_arguments.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

std::string options_of(const RunArguments& a) {
  nlohmann::ordered_json j;
  j["file"] = a.file.string();
  j["set"] = a.set;
  j["record"] = a.record;
  j["attach"] = a.attach;
  j["detach"] = a.detach;
  j["events"] = a.events;
  j["waypoints"] = a.waypoints;
  if (a.stop) j["stop"] = *a.stop;
  if (a.coupling) j["coupling"] = text::word_of(*a.coupling, kCouplingWords);
  j["joint_names"] = a.joint_names;
  j["no_view_data"] = a.no_view_data;
  j["real_time"] = a.real_time;
  if (!a.clock.empty()) j["clock"] = a.clock;
  if (!a.cpus.empty()) j["cpu"] = a.cpus;
  if (a.overrun) j["overrun"] = text::word_of(*a.overrun, kOverrunWords);
  if (a.priority) j["priority"] = *a.priority;
  if (!a.view.empty()) j["view"] = a.view;
  j["local_writes"] = a.local_writes;
  return j.dump();
}

void read_options(const std::string& text, const std::string& place, RunArguments& a) {
  try {
    const auto j = nlohmann::json::parse(text);
    a.file = j.at("file").get<std::string>();
    a.set = j.at("set").get<std::vector<std::string>>();
    a.record = j.at("record").get<std::vector<std::string>>();
    a.attach = j.at("attach").get<std::vector<std::string>>();
    a.detach = j.at("detach").get<std::vector<std::string>>();
    a.events = j.at("events").get<std::vector<std::string>>();
    a.waypoints = j.at("waypoints").get<std::vector<std::string>>();
    if (j.contains("stop")) a.stop = j["stop"].get<double>();
    if (j.contains("coupling")) a.coupling = text::choose(place, j["coupling"].get<std::string>(), kCouplingWords);
    a.joint_names = j.at("joint_names").get<bool>();
    a.no_view_data = j.at("no_view_data").get<bool>();
    a.real_time = j.at("real_time").get<bool>();
    a.clock = j.value("clock", "");
    a.cpus = j.value("cpu", "");
    if (j.contains("overrun")) a.overrun = text::choose(place, j["overrun"].get<std::string>(), kOverrunWords);
    if (j.contains("priority")) a.priority = j["priority"].get<int>();
    a.view = j.value("view", "");
    a.local_writes = j.at("local_writes").get<std::string>();
  } catch (const nlohmann::json::exception&) {
    throw Error(place, "is damaged: its options cannot be read");
  }
}

}  // namespace cotwin::master
