#include <algorithm>
#include <map>

#include "components/services/json/control/control.h"
#include "components/services/json/request.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

constexpr std::size_t kMostBytes = 4 << 20;    // of the defaults in all steps
constexpr std::size_t kMostStepMembers = 256;  // no service has half as many
using Pointer = Json::json_pointer;

std::string place_of(std::size_t step) { return "/steps/" + std::to_string(step); }

std::string name_of(const Json& steps, std::size_t k) {
  const Json& step = steps[k];
  return step.contains("name") && step["name"].is_string() ? step["name"].get<std::string>() : std::to_string(k + 1);
}

/// Calls replace(name, pointer, place) for each reference in a value: a text "$NAME" or "$NAME/POINTER".
template <class Replace>
void for_references(Json& value, const std::string& place, const Replace& replace) {
  if (value.is_string() && value.get_ref<const std::string&>().starts_with('$')) {
    const std::string text = value.get<std::string>();
    const std::size_t cut = std::min(text.find('/'), text.size());
    value = replace(text.substr(1, cut - 1), text.substr(cut), place);
  } else if (value.is_object()) {
    for (auto& [name, own] : value.items()) for_references(own, place + "/" + pointer_part(name), replace);
  } else if (value.is_array()) {
    for (std::size_t i = 0; i < value.size(); ++i) for_references(value[i], place + "/" + std::to_string(i), replace);
  }
}

/// Whether a value of the schema may have something at the place.
bool may_have(const Json& schema, const Pointer& place) {
  if (place.empty()) return true;
  if (const auto any = schema.find("anyOf"); any != schema.end() && !schema.contains("properties"))
    return std::ranges::any_of(*any, [&](const Json& one) { return may_have(one, place); });
  Pointer rest = place;
  std::vector<std::string> names;
  for (; !rest.empty(); rest.pop_back()) names.push_back(rest.back());
  for (std::size_t i = names.size() - 1; i-- > 0;) rest.push_back(names[i]);
  const std::string& first = names.back();
  if (schema.contains("items")) return text::parse_integer(first) && may_have(schema["items"], rest);
  const Json properties = schema.value("properties", Json::object());
  if (properties.contains(first)) return may_have(properties[first], rest);
  return schema.contains("patternProperties");
}

/// Refuses references to what no earlier step can have answered.
void check_references(const Json& steps, std::size_t k) {
  Json step = steps[k];
  for_references(step, place_of(k), [&](const std::string& name, const std::string& pointer, const std::string& place) {
    std::size_t earlier = 0;
    while (earlier < k && name_of(steps, earlier) != name) ++earlier;
    if (earlier == k)
      throw RequestError(place,
                         "refers to the step '" + name.substr(0, 80) +
                             "', which is no earlier one: steps take answers of those before them, so never in a circle");
    const std::string service = steps[earlier]["service"].get<std::string>();
    Pointer at;
    try {
      at = Pointer(pointer);
    } catch (const Json::exception&) {
      throw RequestError(place, "'" + pointer.substr(0, 80) + "' is no JSON pointer, expected one such as $" + name + "/T_s");
    }
    if (pointer.empty() || !may_have(schemas_of(service)["reply"], at))
      throw RequestError(place, "refers to '" + pointer.substr(0, 80) + "', which " + service + " never answers");
    return Json();
  });
}

}  // namespace

void settle(Json& request, const std::function<void(Json&, const std::string&)>& complete) {
  if (!is_chain(request)) {
    if (complete) complete(request, "");
    return choose(request);
  }
  for (const auto& [name, unused] : request.items())
    if (name != "steps" && name != "defaults" && name != "audience" && name != "require")
      throw RequestError("/" + pointer_part(name.substr(0, 40)),
                         "is no member of a chain, expected steps, defaults, audience or require; members of all steps are in "
                         "defaults");
  (void)audience_of(request, false);
  const Json defaults = request.value("defaults", Json::object());
  if (!defaults.is_object()) throw RequestError("/defaults", "is no object, expected members of the steps");
  if (defaults.contains("require"))
    throw RequestError("/defaults/require", "is given for each step, expected it beside the steps of the chain only");
  request.erase("defaults");
  Json& steps = request["steps"];
  if (!steps.is_array() || steps.empty() || steps.size() > kMostSteps)
    throw RequestError("/steps", "is no array of 1 to " + std::to_string(kMostSteps) + " requests, expected one");
  if (defaults.dump().size() * steps.size() > kMostBytes)
    throw RequestError("/defaults", "are too large to be members of " + std::to_string(steps.size()) +
                                        " steps, expected at most " + std::to_string(kMostBytes) +
                                        " bytes of all steps together");
  for (std::size_t k = 0; k < steps.size(); ++k) {
    if (!steps[k].is_object()) throw RequestError(place_of(k), "is no object, expected the request of a service");
    if (steps[k].size() + defaults.size() > kMostStepMembers)
      throw RequestError(place_of(k), "has " + std::to_string(steps[k].size() + defaults.size()) +
                                          " members with the defaults, expected at most " + std::to_string(kMostStepMembers));
    Json step = defaults;
    step.update(steps[k]);
    step["name"] = name_of(steps, k);
    steps[k] = std::move(step);
  }
  for (std::size_t k = 0; k < steps.size(); ++k) {
    const std::string name = name_of(steps, k);
    for (std::size_t other = 0; other < k; ++other)
      if (name_of(steps, other) == name)
        throw RequestError(place_of(k) + "/name", "is that of an earlier step, expected another");
    if (name.empty() || name.find('/') != std::string::npos)
      throw RequestError(place_of(k) + "/name", "is '" + name.substr(0, 80) + "', expected a name without '/'");
    try {
      for (const char* own : {"steps", "audience", "require"})
        if (steps[k].contains(own))
          throw RequestError(std::string("/") + own, "is given in a step, expected it beside the steps of the chain only");
      Json step = steps[k];
      step.erase("name");
      if (complete) complete(step, place_of(k));
      choose(step);
      if (!step["service"].is_string() || std::ranges::count(service_names(), step["service"].get<std::string>()) == 0)
        throw RequestError("/service", "is unknown, expected one of " + text::joined(service_names()));
      steps[k] = {{"name", name}};
      steps[k].update(step);
    } catch (const RequestError& e) {
      throw RequestError(place_of(k) + e.pointer(), e.detail());
    }
    check_references(steps, k);
  }
}

std::string next_step(const std::string& chain, const std::vector<std::string>& replies) {
  const Json all = parse_json(chain), &steps = all["steps"];
  const std::size_t k = replies.size();
  if (k >= steps.size()) return "";
  Json step = steps[k];
  std::map<std::string, Json> parsed;
  const Audience reader{all.value("audience", "")};  // to whom nothing is left out
  for_references(step, place_of(k), [&](const std::string& name, const std::string& pointer, const std::string& place) {
    Json& reply = parsed[name];
    for (std::size_t earlier = 0; reply.is_null() && earlier < k; ++earlier)
      if (name_of(steps, earlier) == name)
        reply =
            presented(steps[earlier]["service"], reader, steps[earlier].value("choice", Json()), Json::parse(replies[earlier]));
    Json value;
    try {
      value = reply.at(Pointer(pointer));
    } catch (const Json::exception&) {
      // Not there.
    }
    if (value.is_null()) {
      const std::string reason = reply.is_object() ? reply.value("reason", "") : "";
      throw RequestError(place, "takes '" + pointer + "' of the step '" + name + "', which did not answer that" +
                                    (reason.empty() ? "" : ": " + reason));
    }
    return value;
  });
  for (const char* own : {"name", "choice"}) step.erase(own);
  const std::string detail = detail_for(all.value("audience", ""));
  if (detail == "all" && !step.contains("detail")) step["detail"] = detail;
  return step.dump();
}

std::string answer_chain(Robots& robots, Json chain, const Context& context) {
  settle(chain);
  const std::string text = chain.dump();
  const double count = static_cast<double>(chain["steps"].size());
  std::vector<std::string> replies;
  Context own = context;
  if (context.progress)
    own.progress = [&](double share, const std::string& message) {
      context.progress((static_cast<double>(replies.size()) + share) / count, message);
    };
  try {
    for (std::string step = next_step(text, replies); !step.empty(); step = next_step(text, replies))
      replies.push_back(answer(robots, step, own));
  } catch (const Error& e) {
    const Json told = Json::parse(chain_problem(text, replies.size(), problem(e)));
    throw RequestError(told["pointer"], told["detail"]);
  }
  return chain_reply(text, replies);
}

void check_chain(Robots& robots, Json chain) {
  settle(chain);
  const Json& steps = chain["steps"];
  for (std::size_t k = 0; k < steps.size(); ++k) {
    Json step = steps[k];
    step.erase("name");
    bool refers = false;
    for_references(step, "", [&](const std::string&, const std::string&, const std::string&) {
      refers = true;
      return Json();
    });
    try {
      if (!refers) check_object(robots, step);
      const Json& request = schemas_of(step["service"])["request"];
      for (const auto& [name, unused] : step.items())
        if (!request["properties"].contains(name))
          throw RequestError("/" + pointer_part(name), "is no member of " + step["service"].get<std::string>());
    } catch (const RequestError& e) {
      throw RequestError(place_of(k) + e.pointer(), "step '" + name_of(steps, k) + "': " + e.detail());
    }
  }
}

std::string chain_reply(const std::string& chain, const std::vector<std::string>& replies) {
  const Json all = parse_json(chain), &steps = all["steps"];
  Json told = Json::array();
  std::size_t worst = 0;  // the first step with the worst light
  for (std::size_t k = 0; k < replies.size(); ++k) {
    const std::string service = steps[k]["service"].get<std::string>();
    const Audience audience = audience_of(all, steps[k].contains("detail"));
    Json reply = presented(service, audience, steps[k].value("choice", Json()), Json::parse(replies[k]));
    told.push_back({{"name", name_of(steps, k)}, {"service", service}, {"reply", std::move(reply)}});
    if (light_of(told[k]["reply"]) > light_of(told[worst]["reply"])) worst = k;
  }
  Json reply{{"verdict", told[worst]["reply"]["verdict"]}};
  for (Json& one : told) one["reply"]["verdict"].erase("unmet");  // it is the chain's
  reply["steps"] = told;
  for (const char* own : {"sentence", "light"})
    if (const Json& decisive = told[worst]["reply"]; decisive.contains(own)) reply[own] = decisive[own];
  return reply.dump();
}

std::string chain_problem(const std::string& chain, std::size_t failed, const std::string& problem) {
  const Json all = parse_json(chain), &steps = all["steps"];
  const std::size_t step = std::min(failed, steps.size() - 1);
  Json told = Json::parse(problem);
  const std::string pointer = told.value("pointer", "");
  std::string left;
  for (std::size_t k = step + 1; k < steps.size(); ++k) text::append(left, "'" + name_of(steps, k) + "'");
  told["detail"] = "step '" + name_of(steps, step) + "': " + told.value("detail", "") +
                   (left.empty() ? "" : "; not asked after it: " + left);
  told["pointer"] = pointer.starts_with(place_of(step) + "/") ? pointer : place_of(step) + pointer;
  return told.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace cotwin::services
