#include "master/farm/figures.h"

#include <cmath>
#include <limits>

#include "master/results/summary.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

Figures::Figures(const std::vector<std::string>& keep, Master& master) {
  static constexpr std::pair<const char*, Kind> kWords[] = {
      {"end", Kind::kEnd}, {"min", Kind::kMin}, {"max", Kind::kMax}, {"peak", Kind::kPeak}};
  for (const std::string& text : keep) {
    if (text == "figures") {
      summary_ = true;
      continue;
    }
    const std::string place = "keep " + text;
    const std::size_t blank = text.find(' ');
    if (blank == std::string::npos)
      throw Error(place, "expected figures, or end, min, max or peak and a variable, as in 'peak world.force'");
    const std::string word = text.substr(0, blank);
    const Kind kind = text::choose(place, word, kWords);
    Watched watched(master.members(), std::string(text::trim(text.substr(blank))), place);
    const double nothing = std::numeric_limits<double>::quiet_NaN();
    std::vector<double> values(watched.size(), nothing);
    kept_.push_back({kind, word, std::move(watched), std::move(values)});
  }
}

void Figures::sample() {
  for (Kept& kept : kept_) {
    for (std::size_t k = 0; k < kept.values.size(); ++k) {
      const double now = kept.kind == Kind::kPeak ? std::abs(kept.watched.at(k)) : kept.watched.at(k);
      double& value = kept.values[k];
      const bool replaces =
          std::isnan(value) || kept.kind == Kind::kEnd || (kept.kind == Kind::kMin ? now < value : now > value);
      if (replaces) value = now;
    }
  }
}

std::vector<Figures::Named> Figures::all(const Summary& summary) const {
  std::vector<Named> found;
  for (const Kept& kept : kept_) {
    const Signal& signal = kept.watched.signal();
    for (std::size_t k = 0; k < kept.values.size(); ++k) {
      const std::string element =
          kept.values.size() == 1 ? signal.name : signal.name + "[" + std::to_string(signal.first + k + 1) + "]";
      found.push_back({kept.word + " " + element, kept.values[k]});
    }
  }
  if (summary_) {
    for (const Tally& t : summary.tallies) {
      if (!t.elements.si.empty()) continue;  // no totals where units of measure differ
      found.push_back({"rms " + t.name, t.total_rms});
      found.push_back({"max " + t.name, t.total_max});
    }
    for (const Compared& c : summary.comparisons) {
      if (!c.elements.si.empty()) continue;
      found.push_back({"rms " + c.name, joined_rms(c.rms)});
      found.push_back({"max " + c.name, largest_of(c.max)});
    }
    for (const Work& w : summary.works) found.push_back({"net " + w.name, w.value});
    for (const Bonded& b : summary.bonds) found.push_back({"leak " + b.name, b.leak});
  }
  return found;
}

Condition success_condition(const std::string& text) {
  Condition condition(text, "success " + text);
  if (condition.name.find(' ') == std::string::npos) condition.name = "end " + condition.name;
  return condition;
}

}  // namespace cotwin::master
