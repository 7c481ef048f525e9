#pragma once
#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "models/identification/measurement/log.h"
#include "models/identification/problem.h"
#include "models/robot/robot_model.h"

namespace cotwin::master::tuning {

enum class Method { kSwarm, kFeasible, kLeastSquares };
const char* to_text(Method method);         // "swarm", "feasible", "least-squares"
Method method_of(const std::string& text);  // throws Error naming the choices

inline identification::ModelOptions with_sigmoid_friction() {
  identification::ModelOptions model;
  model.friction = identification::FrictionLaw::kSigmoid;
  return model;
}

/// All settings that have an effect on the result of a tuning.
struct Settings {
  std::filesystem::path robot;
  std::string lock, passive;  // as the settings of units (components/robot_files/joint_settings.h)
  std::vector<std::filesystem::path> data, held_out;
  trajectory::RecordingFormat format;
  double split = 0.7;  // share of the data, from the first sample on, used for training; not with held_out
  double cutoff = 0;   // Hz; 0: by the rule of measurement::Survey::cutoff
  int order = 4;       // of one pass of the low-pass
  double margin = -1;  // s left out at both ends of a segment; below 0: 1/cutoff
  bool accept_data = false;
  Method method = Method::kSwarm;
  identification::ModelOptions model = with_sigmoid_friction();
  double prior_weight = identification::kPriorWeightOfLogs;
  identification::Bounds bounds;
  double skip_rows = 0.01;  // share of a log's rows that may be left out, see measurement::Log::skip
  std::uint64_t seed = 1;
  int rounds = 500;
  int particles = 200;
  double threshold = 0;             // of the cost
  std::vector<std::string> chosen;  // trials and choice of cross_validate, one sentence each, for the report
};

/// Reads the robot with its locked and passive joints.
robot::RobotModel load_robot(const Settings& settings, std::vector<std::string>* warnings = nullptr);

identification::ProblemOptions problem_options(const Settings& settings);

/// The largest value of --mass-factor, --stretch-factor, --shear or --shift.
double most_of_bound(identification::ActiveBound::Kind kind);

nlohmann::json to_json(const Settings& settings);
/// Throws Error `place: …` for missing settings, settings of another type, and values out of range.
Settings settings_from_json(const nlohmann::json& json, const std::string& place);
/// Throws Error for values out of range.
void check(const Settings& settings);

}  // namespace cotwin::master::tuning
