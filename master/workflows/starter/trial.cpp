#include "master/workflows/starter/trial.h"

#include <cmath>

#include "master/engine/wiring/members.h"
#include "master/run/master.h"
#include "master/scenario/folders.h"
#include "master/scenario/scenario.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master::starter {

namespace {

namespace fs = std::filesystem;

Master start(const fs::path& twin, std::span<const UnitType> types) {
  Scenario scenario = load_scenario(twin);
  MasterOptions options;
  options.types = types;
  options.folders = model_folders(scenario.folder);
  options.threads = 1;
  Master master(std::move(scenario), std::move(options));
  master.initialise();
  return master;
}

std::span<const double> reals(Master& master, const std::string& name) {
  return find_real_signal(master.members(), name, "cotwin new").variable->reals();
}

double norm(std::span<const double> v) {
  double square = 0;
  for (const double x : v) square += x * x;
  return std::sqrt(square);
}

std::string number(double x) { return text::to_text(x, 3); }

/// Deviations of the joints at the end of both pushes.
class Pushes {
 public:
  explicit Pushes(const Sketch& sketch) : sketch_(sketch) {}

  void look(double t, std::span<const double> q, std::span<const double> q_d) {
    if (first_.empty() && t >= 3.9) take(first_, q, q_d);
    if (second_.empty() && t >= 9.9) take(second_, q, q_d);
  }
  void check(std::span<const robot::Joint> joints) const {
    constexpr double kSmall = 1e-5;  // rad or m
    for (std::size_t i = 0; i < second_.size(); ++i) {
      const double expected = sketch_.push[i] / sketch_.S_a[i];
      for (const auto& [is, should] : {std::pair(first_[i], expected), std::pair(second_[i], expected / 2)}) {
        if (std::abs(is - should) <= 0.1 * std::abs(should) + kSmall) continue;
        throw Error("joint '" + joints[i].name + "'", "gives way by " + number(is) + ", expected " + number(should));
      }
    }
  }

 private:
  static void take(std::vector<double>& to, std::span<const double> q, std::span<const double> q_d) {
    for (std::size_t i = 0; i < q.size(); ++i) to.push_back(q[i] - q_d[i]);
  }
  const Sketch& sketch_;
  std::vector<double> first_, second_;
};

}  // namespace

void try_scenario(const fs::path& twin, const Sketch& sketch, const robot::RobotModel& robot, std::span<const UnitType> types) {
  constexpr double kTracking = 5e-3;  // rad or m
  Master master = start(twin, types);
  const std::span<const double> q = reals(master, "drive.q"), theta = reals(master, "drive.theta"),
                                q_c = reals(master, "compliance.q_c"), q_d = reals(master, "motion.q_d");
  const std::span<const double> force = sketch.contact ? reals(master, "world.f_c") : std::span<const double>();
  Pushes pushes(sketch);
  const double rest = sketch.waypoints[1].t + sketch.waypoints[1].dwell - 0.1;  // s, near the end of the rest in the plate
  std::optional<double> at_rest;
  while (master.step_tick()) {
    const double t = master.now().seconds();
    for (std::size_t i = 0; i < q.size(); ++i) {
      // Behind soft gears the link is elsewhere than its motor.
      if (std::min(std::abs(q[i] - q_c[i]), std::abs(theta[i] - q_c[i])) <= kTracking) continue;
      throw Error("at " + number(t) + " s", "joint '" + robot.joints[i].name + "' is " +
                                                text::to_text(std::abs(q[i] - q_c[i]), 5) +
                                                " away from the compliant motion, expected at most " + number(kTracking));
    }
    if (sketch.kind == Kind::kCompliance) pushes.look(t, q, q_d);
    if (!at_rest && t >= rest) at_rest = norm(force);
  }
  master.finish();
  if (sketch.kind == Kind::kCompliance) pushes.check(robot.joints);
  if (sketch.contact && std::abs(at_rest.value_or(0) - sketch.contact->force) > 0.1 * sketch.contact->force) {
    throw Error("the force at rest",
                "is " + number(at_rest.value_or(0)) + " N, expected " + number(sketch.contact->force) + " N");
  }
}

std::optional<std::string> touching_at_start(const fs::path& twin, const robot::RobotModel& robot,
                                             std::span<const UnitType> types) {
  constexpr double kTried = 1;  // s; the probe needs longer
  try {
    Master master = start(twin, types);
    const auto contacts = find_signal(master.members(), "world.contacts", "cotwin new").variable->integers();
    const auto bodies = find_signal(master.members(), "world.contact_bodies", "cotwin new").variable->integers();
    const auto name_of = [&](int number) {  // the plate, the base, the links
      if (number == 1) return std::string("plate");
      const auto link = static_cast<std::size_t>(number - 3);
      return number >= 3 && link < robot.bodies.size() ? robot.bodies[link].name : robot.base.name;
    };
    while (master.now().seconds() < kTried && master.step_tick()) {
      if (contacts[0] > 0) return "'" + name_of(bodies[0]) + "' and '" + name_of(bodies[1]) + "' touch each other";
    }
    return std::nullopt;
  } catch (const Error& error) {
    return error.what();
  }
}

}  // namespace cotwin::master::starter
