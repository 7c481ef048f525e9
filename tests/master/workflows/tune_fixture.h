#pragma once
#include <Eigen/Core>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "master/workflows/tuning/tuning.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/synthetic_log.h"

namespace cotwin::testing {

/// A known robot, logs of it, and a prior that is wrong by about 30 %.
class TunedRobot {
 public:
  TunedRobot() {
    truth = robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf");
    robot::RobotModel prior = truth;
    for (int i = 0; i < prior.n(); ++i) {
      Inertia inertia = prior.bodies[static_cast<std::size_t>(i)].inertia;
      inertia.mass *= i % 2 == 0 ? 1.3 : 0.7;
      inertia.I_CC *= i % 3 == 0 ? 0.7 : 1.3;
      inertia.p_LC *= 1.1;
      robot::set_inertia(prior, i, inertia, "wrong on purpose");
    }
    prior.history.clear();
    std::ofstream(folder / "prior.urdf") << robot::to_urdf(prior);
    log.write(folder / "log.csv", truth);
  }

  master::tuning::Settings settings() const {
    master::tuning::Settings s;
    s.robot = folder / "prior.urdf";
    s.data = {folder / "log.csv"};
    s.rounds = 60;
    s.particles = 64;
    s.cutoff = 5;
    return s;
  }
  master::tuning::Result tune(const master::tuning::Settings& settings, const std::string& out, int threads = 1,
                              const master::tuning::Hooks& hooks = {}, bool resume = false) const {
    std::filesystem::create_directories(folder / out);
    master::tuning::Run run;
    run.out = folder / out;
    run.threads = threads;
    if (resume) run.resume = master::tuning::load_resume(folder / out / "resume.json");
    return master::tuning::tune(settings, run, hooks, master::tuning::load_data(settings, hooks));
  }
  nlohmann::json figures(const std::string& out) const { return nlohmann::json::parse(content(folder / out / "figures.json")); }

  TemporaryFolder folder{"tune"};
  robot::RobotModel truth;
  SyntheticLog log{.rate = 100, .duration = 40, .amplitude = 0.6, .v_R = 0.1};
};

}  // namespace cotwin::testing
