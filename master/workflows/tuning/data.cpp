#include "master/workflows/tuning/data.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file_hash.h"
#include "models/foundation/support/text.h"
#include "models/identification/feasible.h"

namespace cotwin::master::tuning {

namespace fs = std::filesystem;

namespace {

measurement::Log log_of(const Settings& settings, bool held_out) {
  return {held_out ? settings.held_out : settings.data, settings.format, settings.skip_rows, !settings.accept_data};
}

/// Number of samples of all segments on the grid; warns of segments without samples.
std::size_t grid_points(const measurement::Survey& survey, const measurement::Smoothing& smoothing,
                        std::vector<std::string>& warnings) {
  std::size_t points = 0;
  for (const measurement::Segment& segment : survey.segments) {
    const std::size_t here = measurement::grid_points(segment.duration, smoothing);
    if (here == 0) {
      warnings.push_back(segment.begin + ": a segment of " + text::to_text(segment.duration, 4) + " s, expected more than " +
                         text::to_text(2 * smoothing.margin, 4) + " s (twice the margin); it is left out");
    }
    points += here;
  }
  return points;
}

}  // namespace

identification::ModelOptions model_of(const Settings& settings, const measurement::Survey& survey) {
  identification::ModelOptions model = settings.model;
  for (std::size_t j = 0; j < survey.joints.size(); ++j) model.still.push_back(survey.moves(j) ? 0 : 1);
  return model;
}

measurement::Smoothing smoothing_of(const Settings& settings, const measurement::Survey& survey) {
  measurement::Smoothing smoothing;
  smoothing.step = survey.step;
  smoothing.cutoff = settings.cutoff > 0 ? settings.cutoff : survey.cutoff();
  smoothing.order = settings.order;
  smoothing.margin = settings.margin >= 0 ? settings.margin : 1 / smoothing.cutoff;
  return smoothing;
}

void split(const Settings& settings, Data& data) {
  const std::size_t points = grid_points(data.survey, data.smoothing, data.warnings);
  if (points == 0) {
    double longest = 0;
    for (const measurement::Segment& segment : data.survey.segments) longest = std::max(longest, segment.duration);
    throw Error(settings.data.front().string(),
                "the longest segment without a gap is " + text::to_text(longest, 4) + " s, expected more than " +
                    text::to_text(2 * data.smoothing.margin, 4) +
                    " s (twice the margin); a higher --cutoff or a smaller --margin leaves more of it");
  }
  data.split =
      settings.held_out.empty() ? static_cast<std::size_t>(std::floor(settings.split * static_cast<double>(points))) : points;
}

void for_each_block(const Settings& settings, const Data& data, const Hooks& hooks, const char* what,
                    const std::function<void(const measurement::Block&, Part)>& take) {
  const std::vector<trajectory::Axis> axes = trajectory::axes_of(data.robot);
  const double total = std::max(1.0, data.survey.duration / data.smoothing.step);
  std::size_t done = 0;
  for (const bool held_out : {false, true}) {
    const measurement::Log log = log_of(settings, held_out);
    if (log.files.empty()) continue;
    measurement::SmoothedLog smoothed(log, axes, data.smoothing, data.survey.gap);
    while (const measurement::Block* block = smoothed.next()) {
      take(*block, held_out ? Part::kHeldOut : Part::kTraining);
      done += block->count;
      hooks.tell(what, static_cast<double>(done) / total);
      if (hooks.stopped()) throw Stopped{};
    }
  }
}

Data survey_log(const Settings& settings, const Hooks& hooks) {
  Data data;
  data.robot = load_robot(settings, &data.warnings);
  if (data.robot.joints.empty()) throw Error(settings.robot.string(), "has no movable joint, expected at least one");

  for (const robot::Joint& joint : data.robot.joints) {
    if (joint.passive)
      data.warnings.push_back(joint.name + " is passive: no twin.ssd, because its controller drives every joint");
  }
  hooks.tell("checking the log", 0);
  for (const fs::path& held : settings.held_out)
    for (const fs::path& file : settings.data)
      if (hash_of_file(held) == hash_of_file(file))
        throw Error("--held-out",
                    held.string() + " has the bytes of " + file.string() + ", expected a log that no solver sees");
  measurement::Log all = log_of(settings, false);
  all.files.insert(all.files.end(), settings.held_out.begin(), settings.held_out.end());
  data.survey = measurement::survey(all, data.robot, {settings.accept_data});
  data.warnings.insert(data.warnings.end(), data.survey.warnings.begin(), data.survey.warnings.end());
  if (hooks.stopped()) throw Stopped{};
  return data;
}

namespace {

/// Compresses the log; torques pass the low-pass. Shows its rows to `diagnosis`, unless that is null.
void compress(const Settings& settings, Data& data, const Hooks& hooks, identification::Diagnosis* diagnosis = nullptr) {
  const std::size_t n = data.robot.joints.size();
  CompressedPart empty{identification::TorqueData(data.load_robot, model_of(settings, data.survey)), 0,
                       Eigen::VectorXd::Zero(data.robot.n())};
  CompressedPart training = empty, held_out = empty;
  std::size_t before = 0;
  for_each_block(settings, data, hooks, "compressing the log", [&](const measurement::Block& block, Part of_file) {
    for (std::size_t k = 0; k < block.count; ++k, ++before) {
      const bool train = of_file == Part::kTraining && before < data.split, motors = !block.theta.empty();
      const std::size_t row = k * n;
      if (diagnosis != nullptr && train)
        diagnosis->add(block.segment, block.measured[k] != 0, &block.q[row], &block.dq[row], &block.ddq[row], &block.tau[row],
                       motors ? &block.dtheta[row] : nullptr, motors ? &block.ddtheta[row] : nullptr);
      if (!block.measured[k]) continue;
      CompressedPart& part = train ? training : held_out;
      part.data.add(&block.q[row], &block.dq[row], &block.ddq[row], &block.tau[row], motors ? &block.dtheta[row] : nullptr,
                    motors ? &block.ddtheta[row] : nullptr);
      ++part.samples;
      for (std::size_t j = 0; j < n; ++j) {
        const double removed = block.tau_measured[row + j] - block.tau[row + j];
        part.removed[static_cast<Eigen::Index>(j)] += removed * removed;
      }
    }
  });
  for (CompressedPart* part : {&training, &held_out}) {
    part->data.flush();
    part->removed = (part->removed / static_cast<double>(std::max<std::size_t>(1, part->samples))).cwiseSqrt();
  }
  data.training = std::move(training);
  if (held_out.samples > 0) data.held_out = std::move(held_out);
}

}  // namespace

Data load_data(const Settings& settings, const Hooks& hooks) {
  Data data = survey_log(settings, hooks);
  data.smoothing = smoothing_of(settings, data.survey);
  split(settings, data);
  data.load_robot = data.robot;
  identification::Diagnosis diagnosis(data.robot, model_of(settings, data.survey), data.smoothing.step);
  compress(settings, data, hooks, &diagnosis);
  identification::Diagnosed diagnosed = diagnosis.findings();
  data.findings = std::move(diagnosed.findings);
  data.truth = std::move(diagnosed.truth);
  // The load of gears is the gravity of the real robot, not of the prior. A quick estimate from the training part is near
  // enough to the final one (three passes agree to 1e-3).
  for (int pass = 0; pass < 2 && settings.model.load; ++pass) {
    const identification::Problem problem(data.training->data, data.robot, problem_options(settings));
    identification::FeasibleOptions feasible;
    feasible.stop = hooks.stop;
    const identification::FeasibleResult found = identification::solve_feasible(problem, feasible);
    if (found.interrupted) throw Stopped{};
    data.load_robot = identification::with_bodies(data.robot, found.estimate, "load of friction");
    compress(settings, data, hooks);
  }
  return data;
}

}  // namespace cotwin::master::tuning
