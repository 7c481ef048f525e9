#pragma once
#include <filesystem>
#include <iosfwd>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "master/workflows/tuning/progress.h"
#include "master/workflows/tuning/settings.h"
#include "models/anomaly/anomaly.h"

/// `cotwin anomaly`: two questions about a log. Did the robot change within this session (models/anomaly)? Is it another robot than the tuned one?
namespace cotwin::master {

struct AnomalySettings {
  tuning::Settings
      log;  // robot, data: the log; its format, and how it is smoothed. A cutoff of 0 is kCutoff, or a fifth of the sampling rate
  std::vector<std::filesystem::path> reference;  // a log that is the baseline; none: the session's own beginning
  std::vector<std::filesystem::path> healthy;    // logs of the robot as it should be, of other days
  bool motor = true;                             // torques are measured at the motors
  anomaly::WatchOptions watch;

  static constexpr double kCutoff = 10;  // Hz
};

/// Of one joint.
struct JointVerdict {
  std::string name, unit;             // "N.m" or "N"
  double rms = 0;                     // of the residual, all samples
  std::optional<double> index;        // maturity
  double moving_rms = 0;              // of the samples that are judged,
  std::optional<double> high;         // and the largest that healthy logs let expect
  bool other = false;                 // more than that
  bool beyond = false;                // not rendered at all, as half of the joints that move
  double compared = 0;                // s with the baseline;
  double resting = 0, saturated = 0;  // could not be
};

struct AnomalyReport {
  std::string robot;
  std::vector<std::string> files;
  double duration = 0, motion = 0, baseline = 0, outside = 0;  // s, of the log; `baseline`: 0 if nothing could be compared
  std::vector<anomaly::Event> events;
  std::vector<std::string> sentences;  // of the events
  bool again = false;                  // a baseline after a change was not completed
  double found = 0;                    // number of events, also of those that are not listed
  std::vector<JointVerdict> joints;
  std::vector<std::string> notes;  // what the verdict rests on, and what is not known
  bool something() const;
};

/// Throws Error for bad files, for a robot or log that does not fit, and if neither question can be answered; tuning::Stopped.
AnomalyReport find_anomalies(const AnomalySettings& settings, const tuning::Hooks& hooks);

void write_text(std::ostream& out, const AnomalyReport& report);
nlohmann::ordered_json to_json(const AnomalyReport& report);

}  // namespace cotwin::master
