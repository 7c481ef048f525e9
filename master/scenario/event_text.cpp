#include "master/scenario/event_text.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "master/scenario/annotation.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

void add_event(Scenario& scenario, std::string_view text) {
  const std::string place = "--event " + std::string(text);
  const char* const form = "expected 't=TIME COMPONENT.VARIABLE=VALUE', and ramp=TIME unless it is a jump";
  xml::Element times;  // of all changes
  std::vector<std::pair<std::string, std::string>> changes;
  std::string* value = nullptr;  // to which words without '=' belong, as in "ramp=10 ms" and "drive.tau_e=0 0 5"
  times.name = "Event";
  times.place = xml::Place(xml::Shared(place), 0);
  for (const std::string_view word : text::split(text, ' ')) {
    const std::size_t equals = word.find('=');
    if (word.empty()) continue;
    if (equals == std::string_view::npos) {
      if (value == nullptr) throw Error(place, "'" + std::string(word) + "', " + form);
      *value += (value->empty() ? "" : " ") + std::string(word);
      continue;
    }
    const std::string name(word.substr(0, equals)), first(word.substr(equals + 1));
    if (name != "t" && name != "ramp") {
      value = &changes.emplace_back(name, first).second;
      continue;
    }
    const std::string attribute = name == "t" ? "time" : name;
    if (xml::find(times, attribute) != nullptr) throw Error(place, "'" + name + "' stands there twice");
    value = &times.attributes.emplace_back(xml::Attribute{{}, attribute, first}).value;
  }
  if (xml::find(times, "time") == nullptr) throw Error(place, std::string("has no time, ") + form);
  if (changes.empty()) throw Error(place, std::string("changes no variable, ") + form);
  const ComponentIndex index(scenario);
  for (const auto& [name, given] : changes) {
    xml::Element event = times;
    event.attributes.push_back({{}, "variable", name});
    event.attributes.push_back({{}, "value", given});
    scenario.events.push_back(read_change(event, scenario, index));
  }
  std::stable_sort(scenario.events.begin(), scenario.events.end(),
                   [](const EventSpec& a, const EventSpec& b) { return a.time < b.time; });
}

}  // namespace cotwin::master
