#include "master/workflows/tuning/scenario.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "models/foundation/support/text.h"

namespace cotwin::master::tuning {

namespace {

std::string seconds(double t) { return text::to_text(t, 12); }

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '&') {
      result += "&amp;";
    } else if (c == '<') {
      result += "&lt;";
    } else if (c == '"') {
      result += "&quot;";
    } else {
      result += c;
    }
  }
  return result;
}

}  // namespace

std::size_t points_between(double step) {
  constexpr double kLongest = 2.5e-3;  // s
  return static_cast<std::size_t>(std::max(1.0, std::ceil(step / kLongest - 1e-6)));
}

std::optional<Replay> choose_replay(const Settings& settings, const Data& data) {
  const auto passive = [](const robot::Joint& joint) { return joint.passive; };
  if (std::any_of(data.robot.joints.begin(), data.robot.joints.end(), passive)) return std::nullopt;
  // The longest segment; of the held-out logs if there are any.
  std::optional<Replay> best;
  std::size_t boundary = data.split;
  for (const bool held_out : {true, false}) {
    std::size_t before = 0;
    for (const measurement::Segment& segment : data.survey.segments) {
      const std::size_t count = measurement::grid_points(segment.duration, data.smoothing);
      const bool of_held_out = segment.file >= settings.data.size();
      if (of_held_out == held_out && count > (best ? best->end - best->begin : 0)) {
        best = Replay{before, before + count, 0, 0, {}, {}};
        if (of_held_out) boundary = before;
      }
      before += count;
    }
    if (best) break;
  }
  if (!best) return best;
  const std::size_t count = best->end - best->begin, most = kReplayed / points_between(data.smoothing.step);
  if (count > most) {
    std::size_t begin = best->begin;
    if (best->begin < boundary && boundary < best->end) {
      const auto trained = static_cast<std::size_t>(settings.split * static_cast<double>(most));
      begin = std::min(boundary - std::min(trained, boundary - best->begin), best->end - most);
    }
    best->begin = begin;
    best->end = begin + most;
  }
  best->boundary = std::clamp(boundary, best->begin, best->end);
  best->step = data.smoothing.step;
  return best;
}

std::string twin_scenario(const std::string& name, const Settings& settings, const Replay& replay) {
  const bool motor = settings.model.motor_inertia;
  const char* const torque = motor ? "compliance.tau_m" : "drive.tau_J";
  std::ostringstream out;
  const auto parameters = [&](const char* of, std::initializer_list<std::pair<const char*, const char*>> values) {
    out << R"(          <ssd:ParameterBinding>
            <ssd:ParameterValues>
              <ssv:ParameterSet version="1.0" name=")"
        << of << R"(">
                <ssv:Parameters>
)";
    for (const auto& [parameter, value] : values) {
      out << "                  <ssv:Parameter name=\"" << parameter << "\"><ssv:String value=\"" << value
          << "\"/></ssv:Parameter>\n";
    }
    out << R"(                </ssv:Parameters>
              </ssv:ParameterSet>
            </ssd:ParameterValues>
          </ssd:ParameterBinding>
)";
  };
  const auto component = [&](const char* called, const char* source, bool tuned, const auto& values) {
    out << "      <ssd:Component name=\"" << called << "\" source=\"" << source
        << "\" type=\"application/x-cotwin-unit\">\n        <ssd:ParameterBindings>\n";
    if (tuned) out << "          <ssd:ParameterBinding source=\"drive_train.ssv\"/>\n";
    values();
    out << "        </ssd:ParameterBindings>\n      </ssd:Component>\n";
  };
  out << R"(<?xml version="1.0" encoding="UTF-8"?>
<!-- Written by cotwin tune: the tuned twin moves as the robot did (motion.csv) and its torques are compared with the measured ones.
     figures.json, "twin", has the errors that are to be expected. -->
<ssd:SystemStructureDescription version="1.0" name="tuned_twin"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name=")"
      << escaped(name) << R"(">
    <ssd:Elements>
)";
  component("recording", "unit:io?link=recording", false, [&] {
    parameters("recording", {{"file", "motion.csv"}, {"max_gap", "1e9"}, {"max_speed", "1e9"}, {"limits", "ignore"}});
  });
  component("compliance", "unit:compliance", true, [&] {
    // No elasticity, no bristle and no admittance: the robot moved as recorded, whatever pushed it.
    parameters(
        "controller",
        {{"K", "0"}, {"sigma0", "0"}, {"sigma1", "0"}, {"tau_max", "0"}, {"M_a", "1e9"}, {"S_a", "1e9"}, {"omega", "40"}});
  });
  component("drive", "unit:drive_train?transmission=rigid&amp;friction=smooth", true, [&] {
    parameters("drive", {{"sigma0", "0"}, {"sigma1", "0"}});
  });
  out << "    </ssd:Elements>\n    <ssd:Connections>\n";
  for (const auto& [from, from_port, to, to_port] : std::initializer_list<std::array<const char*, 4>>{
           {"recording", "q", "compliance", "q_d"},
           {"recording", "dq", "compliance", "dq_d"},
           {"recording", "ddq", "compliance", "ddq_d"},
           {"recording", "q", "drive", "q0"},
           {"recording", "dq", "drive", "dq0"},
           {"compliance", "tau_m", "drive", "tau_m"},
           {"drive", "q", "compliance", "q"},
           {"drive", "dq", "compliance", "dq"},
           {"drive", "theta", "compliance", "theta"},
           {"drive", "dtheta", "compliance", "dtheta"},
       }) {
    out << "      <ssd:Connection startElement=\"" << from << "\" startConnector=\"" << from_port << "\" endElement=\"" << to
        << "\" endConnector=\"" << to_port << "\"/>\n";
  }
  // From its last sample on a recording stands still: the run ends a tick before.
  constexpr double kTick = 0.5e-3;  // s
  const double end = kTick * (std::floor(static_cast<double>(replay.end - 1 - replay.begin) * replay.step / kTick) - 1);
  const double boundary = static_cast<double>(replay.boundary - replay.begin) * replay.step;
  out << "    </ssd:Connections>\n  </ssd:System>\n  <ssd:DefaultExperiment startTime=\"0\" stopTime=\"" << seconds(end)
      << R"("/>
  <ssd:Annotations>
    <ssc:Annotation type="cotwin.master">
      <cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="0.5 ms">
        <cotwin:Setting name="robot" value="robot.urdf"/>
        <cotwin:Component name="recording" stage="0"/>
        <cotwin:Component name="compliance" stage="1"/>
        <cotwin:Component name="drive" stage="2"/>
        <cotwin:Recording decimation="10">
          <cotwin:Record variables="recording.q recording.dq recording.tau compliance.tau_m compliance.tau_f drive.q drive.tau_J"/>
        </cotwin:Recording>
)";
  const auto comparison = [&](const char* part, double from, double to) {
    out << "        <cotwin:Comparison name=\"twin against robot, " << part << "\" a=\"" << torque
        << "\" b=\"recording.tau\" segments=\"1\" from=\"" << seconds(from) << "\" to=\"" << seconds(to) << "\"/>\n";
  };
  if (boundary > 0) comparison("training", 0, std::min(boundary, end));
  if (boundary < end) comparison("held out", boundary, end);
  out << R"(        <cotwin:Report name="measured torque" kind="signal" a="recording.tau"/>
        <cotwin:Report name="tracking error" kind="difference" a="drive.q" b="recording.q"/>
      </cotwin:Master>
    </ssc:Annotation>
  </ssd:Annotations>
</ssd:SystemStructureDescription>
)";
  return out.str();
}

}  // namespace cotwin::master::tuning
