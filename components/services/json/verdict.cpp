#include "components/services/json/verdict.h"

#include <algorithm>

namespace cotwin::services {

namespace {

const std::vector<std::string> kOf = {"bounds",     "poses", "power",   "clear_of", "twin",
                                      "compliance", "base",  "persons", "deadline", "search"};
const std::vector<std::string> kSays = {"yes", "no", "unknown"};

std::size_t index_of(const std::vector<std::string>& words, const Json& word) {
  return static_cast<std::size_t>(std::ranges::find(words, word.get<std::string>()) - words.begin());
}

void light_all(Json& value, bool assumed) {
  if (value.is_object()) {
    if (value.contains("verdict")) {
      Json findings = std::move(value["verdict"]["findings"]);
      value["verdict"] = {{"light", ""}, {"findings", std::move(findings)}};
      value["verdict"]["light"] = kLights[Verdict(value).light(assumed)];
    }
    for (auto& [name, member] : value.items())
      if (name != "verdict") light_all(member, assumed);
  } else if (value.is_array() && !value.empty() && value.front().is_object()) {
    for (Json& one : value) light_all(one, assumed);
  }
}

}  // namespace

Verdict::Verdict(const Json& reply) {
  for (const Json& one : reply["verdict"]["findings"])
    findings_.push_back({static_cast<Of>(index_of(kOf, one["of"])), static_cast<Says>(index_of(kSays, one["says"])),
                         one["why"].get<std::string>()});
}

const Finding* Verdict::find(Of of) const {
  const auto at = std::ranges::find(findings_, of, &Finding::of);
  return at == findings_.end() ? nullptr : &*at;
}

const Finding* Verdict::obstacle() const {
  const auto at = std::ranges::find_if(findings_, [](const Finding& f) { return f.of < Of::kPersons && f.says == Says::kNo; });
  return at == findings_.end() ? nullptr : &*at;
}

std::size_t Verdict::light(bool assumed) const {
  const auto any = [&](Says says) { return std::ranges::find(findings_, says, &Finding::says) != findings_.end(); };
  return any(Says::kNo) ? 2 : any(Says::kUnknown) || assumed ? 1 : 0;
}

void Verdict::tell(Json& reply) const {
  reply["feasible"] = feasible();
  reply["reason"] = reason();
  tell_findings(reply);
}

void Verdict::tell_findings(Json& reply) const {
  Json all = Json::array();
  for (const Finding& f : findings_)
    all.push_back(
        {{"of", kOf[static_cast<std::size_t>(f.of)]}, {"says", kSays[static_cast<std::size_t>(f.says)]}, {"why", f.why}});
  reply["verdict"]["findings"] = std::move(all);
}

void light_all(Json& reply) { light_all(reply, !reply.value("assumptions", Json::array()).empty()); }

std::size_t light_of(const Json& reply) { return index_of(kLights, reply["verdict"]["light"]); }

schemas::Json schemas::verdict() {
  const Json finding = Object()
                           .must("of", {{"enum", kOf}})
                           .must("says", {{"enum", kSays}})
                           .must("why", described(kText, "as people read it; empty of a plain yes"));
  return described(Object()
                       .must("light", described({{"enum", kLights}},
                                                "red: a finding says no; amber: one is unknown, or there are "
                                                "assumptions; green: yes"))
                       .must("findings", array_of(finding))
                       .may("unmet", described(kText, "the sentence, where the light is worse than the request requires")),
                   "of this motion, and of no other in the reply");
}

}  // namespace cotwin::services
