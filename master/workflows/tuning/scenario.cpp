#include "master/workflows/tuning/scenario.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "master/scenario/ssd_text.h"
#include "models/foundation/support/text.h"

namespace cotwin::master::tuning {

namespace {

std::string seconds(double t) { return text::to_text(t, 12); }

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
  if (best->end - best->begin < 2) return std::nullopt;  // of steps of minutes
  best->boundary = std::clamp(boundary, best->begin, best->end);
  best->step = data.smoothing.step;
  return best;
}

std::string twin_scenario(const std::string& name, const Settings& settings, const Replay& replay) {
  const bool motor = settings.model.motor_inertia;
  const std::string torque = motor ? "compliance.tau_m" : "drive.tau_J";
  SsdText ssd(
      "tuned_twin", name,
      "  Written by cotwin tune: the tuned twin moves as the robot did (motion.csv) and its torques are compared with the\n"
      "  measured ones. figures.json, \"twin\", has the errors that are to be expected.\n",
      "0.5 ms");
  ssd.component("recording", "unit:io?link=recording", {},
                {{"file", "motion.csv"}, {"max_gap", "1e9"}, {"max_speed", "1e9"}, {"limits", "ignore"}});
  // No elasticity, no bristle and no admittance: the robot moved as recorded, whatever pushed it.
  ssd.component(
      "compliance", "unit:compliance", {"drive_train.ssv"},
      {{"K", "0"}, {"sigma0", "0"}, {"sigma1", "0"}, {"tau_max", "0"}, {"M_a", "1e9"}, {"S_a", "1e9"}, {"omega", "40"}});
  ssd.component("drive", "unit:drive_train?transmission=rigid&friction=smooth", {"drive_train.ssv"},
                {{"sigma0", "0"}, {"sigma1", "0"}});
  for (const auto& [of_recording, input] : {std::pair{"q", "q_d"}, {"dq", "dq_d"}, {"ddq", "ddq_d"}})
    ssd.connect("recording", of_recording, "compliance", input);
  ssd.connect("recording", "q", "drive", "q0");
  ssd.connect("recording", "dq", "drive", "dq0");
  ssd.connect("compliance", "drive", {"tau_m"});
  ssd.connect("drive", "compliance", {"q", "dq", "theta", "dtheta"});

  ssd.annotate("<cotwin:Setting name=\"robot\" value=\"robot.urdf\"/>");
  int stage = 0;
  for (const char* component : {"recording", "compliance", "drive"})
    ssd.annotate("<cotwin:Component name=\"" + std::string(component) + "\" stage=\"" + std::to_string(stage++) + "\"/>");
  ssd.annotate("<cotwin:Recording decimation=\"10\">");
  ssd.annotate(
      "  <cotwin:Record variables=\"recording.q recording.dq recording.tau compliance.tau_m compliance.tau_f drive.q "
      "drive.tau_J\"/>");
  ssd.annotate("</cotwin:Recording>");
  // From its last sample on a recording stands still: the run ends a tick before.
  constexpr double kTick = 0.5e-3;  // s
  const double end = kTick * (std::floor(static_cast<double>(replay.end - 1 - replay.begin) * replay.step / kTick) - 1);
  const double boundary = static_cast<double>(replay.boundary - replay.begin) * replay.step;
  const auto comparison = [&](const std::string& part, double from, double to) {
    ssd.annotate("<cotwin:Comparison name=\"twin against robot, " + part + "\" a=\"" + torque +
                 "\" b=\"recording.tau\" segments=\"1\" from=\"" + seconds(from) + "\" to=\"" + seconds(to) + "\"/>");
  };
  if (boundary > 0) comparison("training", 0, std::min(boundary, end));
  if (boundary < end) comparison("held out", boundary, end);
  ssd.annotate("<cotwin:Report name=\"measured torque\" kind=\"signal\" a=\"recording.tau\"/>");
  ssd.annotate("<cotwin:Report name=\"tracking error\" kind=\"difference\" a=\"drive.q\" b=\"recording.q\"/>");
  return ssd.text(seconds(end));
}

}  // namespace cotwin::master::tuning
