#include "components/services/services.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "components/services/json/json.h"
#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::services::services_test {
namespace {

struct Feasibility {
  bool feasible;
  std::string reason;
  double T, torque, work;
  std::vector<optimisation::Peak> peaks;
};

Feasibility feasibility(const robot::RobotModel& robot, const Move& move) {
  const Plan p = plan(robot, move);
  return {p.solution.status == optimisation::Status::kFeasible,
          p.solution.reason,
          p.solution.T,
          p.torque(),
          p.work(),
          p.solution.peaks};
}

robot::RobotModel lwr4() { return robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf"); }

Move move() {
  Move m;
  m.from_q = {0, 0.5, 0, -1, 0, 0.6, 0};
  m.to_q = {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8};
  return m;
}

// e^(−x) (1 + x) = 0.02 at x = 5.834: Table II of the paper with M = 1.
TEST(Services, SettlesCriticallyDampedImpedancesInTheTimesOfTheSpecification) {
  EXPECT_NEAR(settling_time(1, 2 * std::sqrt(1500), 1500, 0.02), 0.151, 5e-4);
  EXPECT_NEAR(settling_time(1, 2 * std::sqrt(1000), 1000, 0.02), 0.184, 5e-4);
  EXPECT_NEAR(settling_time(1, 2 * std::sqrt(500), 500, 0.02), 0.261, 5e-4);
}

// Against an explicit simulation of M ẍ + D ẋ + S x = 0 from x = 1 with small steps of the trapezoidal rule.
TEST(Services, SettlesAnyImpedanceWhenASimulationDoes) {
  for (const double zeta : {0.05, 0.3, 0.7, 0.999, 1.0, 1.001, 2.0, 10.0})
    for (const double share : {0.3, 0.02, 0.001}) {
      const double D = 2 * zeta, h = 1e-4;
      double x = 1, v = 0, last = 0;
      for (int i = 0; static_cast<double>(i) * h < 60 * std::max(zeta, 1 / zeta); ++i) {
        const double next_v = ((1 - h * h / 4 - h * D / 2) * v - h * x) / (1 + h * D / 2 + h * h / 4);
        x += h / 2 * (v + next_v);
        v = next_v;
        if (std::abs(x) > share) last = (i + 1) * h;
      }
      EXPECT_NEAR(settling_time(1, D, 1, share), last, 3 * h) << zeta << " " << share;
    }
  EXPECT_THROW(settling_time(1, 0, 1, 0.02), Error);
  EXPECT_THROW(settling_time(1, 1, 1, 1), Error);
  // The slow pole is -1/(2 zeta): e^(-t/(2 zeta)) = share.
  for (const double zeta : {1e3, 1e10, 1e160})
    EXPECT_NEAR(settling_time(1, 2 * zeta, 1, 0.02) / (2 * zeta * std::log(50)), 1, 1e-6) << zeta;
}

TEST(Services, FindsTheShortestDurationByTheFirstBoundThatIsMet) {
  const robot::RobotModel robot = lwr4();
  const Feasibility f = feasibility(robot, move());
  EXPECT_TRUE(f.feasible) << f.reason;
  double share = 0;
  for (const auto& peak : f.peaks) share = std::max(share, peak.share);
  EXPECT_NEAR(share, 1, 1e-6);
  // The quintic's peak speed is 1.875 Δ/T.
  double T = 0;
  for (std::size_t j = 0; j < 7; ++j)
    T = std::max(T, 1.875 * std::abs(move().to_q[j] - move().from_q[j]) / robot.joints[j].dq_max);
  EXPECT_NEAR(f.T, T, 1e-6);  // speed decides here
  Move shorter = move();
  shorter.T = 0.99 * f.T;
  const Feasibility no = feasibility(robot, shorter);
  EXPECT_FALSE(no.feasible);
  EXPECT_NE(no.reason.find("dq"), std::string::npos) << no.reason;
}

TEST(Services, RefuseMotionsWhoseValuesAreNotFinite) {
  Move m = move();
  m.T = 2;
  m.degree = 7;
  m.c.assign(14, 0);
  m.c[0] = 1e200;
  EXPECT_FALSE(feasibility(lwr4(), m).feasible);
  m.bounds.q_min.assign(7, -std::numeric_limits<double>::infinity());
  m.bounds.q_max = m.bounds.dq = m.bounds.ddq = m.bounds.dddq = m.bounds.tau =
      std::vector<double>(7, std::numeric_limits<double>::infinity());
  const Feasibility f = feasibility(lwr4(), m);
  EXPECT_FALSE(f.feasible);
  EXPECT_FALSE(f.reason.empty());
}

// The motors do not hold the robot against gravity: no duration helps.
TEST(Services, GiveAVerdictOnMovesThatTheMotorsCannotHold) {
  Move m = move();
  m.bounds.tau.assign(7, 10);
  EXPECT_TRUE(std::isinf(shortest_duration(lwr4(), m)));
  const Feasibility f = feasibility(lwr4(), m);
  EXPECT_FALSE(f.feasible);
  EXPECT_NE(f.reason.find(": tau = "), std::string::npos) << f.reason;
}

TEST(Services, SplitsTorquesWhoseSumDoesTheWork) {
  const robot::RobotModel robot = lwr4();
  Move m = move();
  m.T = 2;
  const Torques t = torques(robot, m, 2001);
  const robot::Mechanism mechanism(robot);
  robot::Data data(mechanism);
  const Eigen::Map<const Eigen::VectorXd> from(m.from_q.data(), 7), to(m.to_q.data(), 7);
  double work = 0;
  for (std::size_t i = 0; i + 1 < t.t.size(); ++i) work += 0.5 * (t.power[i] + t.power[i + 1]) * (t.t[i + 1] - t.t[i]);
  // Without friction the work is the change of the potential energy; the motion is at rest at both ends.
  EXPECT_NEAR(work, robot::potential_energy(mechanism, data, to) - robot::potential_energy(mechanism, data, from), 1e-4);
  EXPECT_NEAR(t.peak_power, *std::max_element(t.power.begin(), t.power.end()), 0);
}

TEST(Services, AnswersRequestsInJsonAndRefusesOthers) {
  Robots robots({places::source() + "/models/robots"}, "lwr4");
  const std::string ends = R"("from_q_rad": [0,0.5,0,-1,0,0.6,0], "to_q_rad": [1,0,0.4,0.7,-0.5,-0.3,0.8])";
  const auto reply = nlohmann::json::parse(answer(robots, "{\"service\": \"feasibility\", \"T_s\": 3, " + ends + "}"));
  EXPECT_TRUE(reply["feasible"].get<bool>());
  EXPECT_EQ(answer(robots, "{\"service\": \"feasibility\", " + ends + "}"),
            answer(robots, "{\"service\": \"feasibility\", " + ends + "}"));
  const auto optimised = nlohmann::json::parse(answer(
      robots, "{\"service\": \"optimise\", \"T_min_s\": 1.5, \"degree\": 7, \"particles\": 16, \"rounds\": 20, " + ends + "}"));
  EXPECT_EQ(optimised["status"], "feasible") << optimised["reason"];
  const auto message = [&](const std::string& request) -> std::string {
    try {
      answer(robots, request);
    } catch (const Error& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_NE(message("{\"service\": \"feasibility\", \"speed\": 1, " + ends + "}").find("/speed"), std::string::npos);
  EXPECT_NE(message(R"({"service": "feasibility", "from_q_rad": [0, "1"], "to_q_rad": []})").find("/from_q_rad/1"),
            std::string::npos);
  EXPECT_NE(message(R"({"service": "feasibility", "from_q_rad": [0], "to_q_rad": [1]})").find("expected 7"), std::string::npos);
  EXPECT_NE(message("{\"service\": \"feasibility\", \"T_s\": 1e999, " + ends + "}"), "");
  EXPECT_NE(message("{\"service\": \"dance\"}").find("/service"), std::string::npos);
  EXPECT_NE(message("[1]"), "");
  EXPECT_NE(message("{"), "");
}

}  // namespace
}  // namespace cotwin::services::services_test
