#include "master/api/cotwin.h"
#include "master/scenario/folders.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/threads.h"
#include "models/identification/excitation/design.h"
#include "models/identification/excitation/samples.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin {

ExcitingMotion excite(const ExciteOptions& options) {
  excitation::DesignOptions design;
  design.period = options.period;
  design.harmonics = options.harmonics;
  design.share = options.share;
  design.ddq_max = options.ddq_max;
  if (options.dq_max) design.dq_max = *options.dq_max;
  design.q_min = options.q_min;
  design.q_max = options.q_max;
  design.criterion = text::choose<excitation::Criterion>(
      "criterion", options.criterion,
      {{"condition", excitation::Criterion::kCondition}, {"determinant", excitation::Criterion::kDeterminant}});
  design.seed = options.seed;
  design.rounds = options.rounds;
  design.particles = options.particles;
  if (options.threads < 1) throw Error("threads", "expected at least 1");
  excitation::check_samples("rate", options.period, options.rate);
  constexpr int kMostPeriods = 10000;
  if (options.periods < 1 || options.periods > kMostPeriods)
    throw Error("periods", "are " + std::to_string(options.periods) + ", expected 1 to " + std::to_string(kMostPeriods));

  ExcitingMotion motion;
  const robot::RobotModel robot =
      robot::load_urdf(master::urdf_of(options.robot), {robot::Unphysical::kWarn, ""}, &motion.warnings);
  numerics::Threads threads(options.threads);
  bool stopped = false;
  const excitation::Design found = excitation::design_excitation(robot, design, &threads, [&](int round) {
    stopped = options.progress && !options.progress(round);
    return !stopped;
  });
  if (stopped) throw Error("excite", "was stopped by its progress function");
  motion.joints = found.series.joints;
  excitation::for_each_sample(found.series, options.rate, options.periods,
                              [&](double t, std::span<const excitation::FourierSeries::State> states) {
                                motion.t.push_back(t);
                                for (const auto& state : states) {
                                  motion.q.push_back(state.q);
                                  motion.dq.push_back(state.dq);
                                  motion.ddq.push_back(state.ddq);
                                }
                              });
  motion.condition = found.condition;
  motion.excited = found.rank;
  motion.base = found.base;
  return motion;
}

}  // namespace cotwin
