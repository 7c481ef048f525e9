#include <algorithm>
#include <cmath>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <ostream>

#include "master/workflows/anomaly/anomaly.h"
#include "models/anomaly/maturity.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

std::string seconds(double t) { return text::to_text(t, 4) + " s"; }

/// What was found at joint j, in a few words.
std::string verdict(const AnomalyReport& report, std::size_t j) {
  std::string words;
  const auto add = [&](const std::string& what) { words += (words.empty() ? "" : "; ") + what; };
  for (const anomaly::Event& event : report.events) {
    if (!event.concerns(j)) continue;
    std::string what = event.brief ? "blow" : to_text(event.cause);
    if (!event.brief && event.other != event.cause) what += std::string(" or ") + to_text(event.other);
    add(what + " since " + seconds(event.since));
  }
  const JointVerdict& joint = report.joints[j];
  if (joint.beyond) add("not the torque of the tuned robot");
  if (joint.other) add("another robot than the healthy one");
  if (!words.empty()) return words;
  if (joint.compared == 0 && !joint.high) return "not judged";
  return joint.compared > 0 ? "nothing" : "changes within the log not judged";
}

}  // namespace

void write_text(std::ostream& out, const AnomalyReport& report) {
  out << report.robot << ": " << seconds(report.duration) << ", joints move for " << seconds(report.motion) << '\n';
  out << "\nDid it change within the session? ";
  if (report.baseline == 0) {
    out << "Not judged: no baseline.\n";
  } else if (report.events.empty()) {
    out << "Nothing found. A change from the beginning on is in the baseline, the first " << seconds(report.baseline)
        << " of motion, and not seen.\n";
  } else {
    out << report.found << (report.found == 1 ? " change" : " changes") << " after the baseline of " << seconds(report.baseline)
        << " of motion:\n";
    for (std::size_t k = 0; k < report.events.size(); ++k)
      out << "  since " << seconds(report.events[k].since) << " (found at " << seconds(report.events[k].found)
          << "): " << report.sentences[k] << '\n';
  }
  if (report.again) out << "  What came after the last change was not judged: it is shorter than a baseline.\n";
  out << "\nIs it another robot than the tuned one? ";
  const bool known = std::ranges::any_of(report.joints, [](const JointVerdict& j) { return j.high.has_value(); });
  const bool other = std::ranges::any_of(report.joints, [](const JointVerdict& j) { return j.other || j.beyond; });
  out << (other ? "Yes, at the joints below.\n" : known ? "No: residuals as in the healthy logs.\n" : "Not known.\n");

  const bool seven = report.joints.size() == anomaly::kPaperMaturity.size();
  out << "\n joint     RMS     of limit  maturity        " << (seven ? "paper  " : "")
      << (known ? "moving RMS (healthy)    " : "") << "compared  verdict\n";
  for (std::size_t j = 0; j < report.joints.size(); ++j) {
    const JointVerdict& v = report.joints[j];
    out << std::setw(4) << j + 1 << "  " << std::setw(8) << text::to_text(v.rms, 3) << ' ' << std::setw(3) << std::left
        << v.unit << std::right << "  " << std::setw(7) << (v.index ? text::to_text(100 * *v.index, 2) + " %" : "—") << "  "
        << std::setw(14) << std::left << (v.index ? anomaly::maturity_band(v.index) : "unknown") << std::right << "  ";
    if (seven) out << std::setw(4) << text::to_text(anomaly::kPaperMaturity[j], 2) << " %  ";
    if (known) {
      out << std::setw(22) << std::left
          << (v.high ? text::to_text(v.moving_rms, 3) + " (up to " + text::to_text(*v.high, 2) + ")" : "—") << std::right
          << "  ";
    }
    out << std::setw(8) << seconds(std::round(v.compared)) << "  " << verdict(report, j) << '\n';
  }
  out << '\n';
  for (std::size_t j = 0; j < report.joints.size(); ++j) {
    const JointVerdict& v = report.joints[j];
    if (v.saturated > 0) out << "joint " << j + 1 << ": torque at its limit for " << seconds(v.saturated) << ", not judged\n";
    if (v.compared == 0 && report.baseline > 0) out << "joint " << j + 1 << ": moves too little in the baseline, not judged\n";
  }
  if (report.outside > 0)
    out << "not judged: " << seconds(report.outside)
        << " of motions faster or more accelerated than 1.3 times the baseline's\n";
  for (const std::string& note : report.notes) out << note << '\n';
}

nlohmann::ordered_json to_json(const AnomalyReport& report) {
  using nlohmann::ordered_json;
  const auto optional = [](const std::optional<double>& x) { return x ? ordered_json(*x) : ordered_json(nullptr); };
  ordered_json j;
  j["robot"] = report.robot;
  j["files"] = report.files;
  j["something"] = report.something();
  j["duration_s"] = report.duration;
  j["motion_s"] = report.motion;
  j["baseline_s"] = report.baseline > 0 ? ordered_json(report.baseline) : ordered_json(nullptr);
  j["outside_s"] = report.outside;
  j["count"] = static_cast<std::int64_t>(report.found);
  j["events"] = ordered_json::array();
  for (std::size_t k = 0; k < report.events.size(); ++k) {
    const anomaly::Event& e = report.events[k];
    ordered_json joints = ordered_json::array();
    for (std::size_t i = 0; i < report.joints.size(); ++i)
      if (e.concerns(i)) joints.push_back(i + 1);
    j["events"].push_back({{"since_s", e.since},
                           {"found_s", e.found},
                           {"hint", to_text(e.cause)},
                           {"or", e.other == e.cause ? ordered_json(nullptr) : ordered_json(to_text(e.other))},
                           {"kind", e.brief    ? "blow"
                                    : e.spread ? "spread"
                                               : "change"},
                           {"joint", e.joint + 1},
                           {"joints", joints},
                           {"size", e.size},
                           {"deviation", e.deviation},
                           {"torque", e.torque},
                           {"text", report.sentences[k]}});
  }
  j["joints"] = ordered_json::array();
  for (std::size_t k = 0; k < report.joints.size(); ++k) {
    const JointVerdict& v = report.joints[k];
    j["joints"].push_back({{"name", v.name},
                           {"unit", v.unit},
                           {"rms", v.rms},
                           {"maturity", optional(v.index)},
                           {"band", anomaly::maturity_band(v.index)},
                           {"moving_rms", v.moving_rms},
                           {"healthy_rms", optional(v.high)},
                           {"other_robot", v.other || v.beyond},
                           {"compared_s", v.compared},
                           {"resting_s", v.resting},
                           {"verdict", verdict(report, k)}});
  }
  j["notes"] = report.notes;
  return j;
}

}  // namespace cotwin::master
