// grow: against the other services motion by motion, closed forms of a planar arm and of a slide, and what cannot be answered.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "components/services/json/json.h"
#include "models/foundation/support/threads.h"
#include "tests/support/places.h"

namespace cotwin::services::grow_test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

Robots shipped() { return Robots({places::source() + "/models/robots"}, "lwr4"); }

json ask(Robots& robots, const json& request, const Context& context = {}) {
  return json::parse(answer(robots, request.dump(), context));
}

std::string problem_of(Robots& robots, json request, const json& change) {
  request.merge_patch(change);
  try {
    ask(robots, request);
  } catch (const std::exception& e) {
    return e.what();
  }
  return "";
}

json request(const json& more = json::object()) {
  json r{{"service", "grow"},
         {"from_q_rad", {0, 0.5, 0, -1, 0, 0.6, 0}},
         {"to_q_rad", {1.2, -0.2, 0.4, 0.7, -0.5, -0.3, 0.8}},
         {"T_min_s", 0.9},
         {"T_max_s", 3},
         {"motions", 400}};
  r.update(more);
  return r;
}

json in_turn(json service, const json& motion) {
  service["from_q_rad"] = motion["q_start_rad"];
  service["to_q_rad"] = motion["q_end_rad"];
  service["c_r_rad"] = motion["c_r_rad"];
  service["degree"] = 9;
  service["T_s"] = motion["T_s"];
  return service;
}

// With and without friction, whose kink at rest the other rules of integration see elsewhere.
TEST(Grow, HasTheCostsThatTheOtherServicesTellOfEachMotion) {
  Robots robots = shipped();
  const json jerk_bound = std::vector<double>(7, 300.0);
  for (const char* drives : {"robot", "none"}) {
    const json common{{"payload", {{"mass_kg", 2}}}, {"drives", drives}, {"dddq_max_rad_per_s3", jerk_bound}};
    json asked = request(common);
    asked.update({{"best", 30}, {"motions", 600}});
    const json best = ask(robots, asked)["costs"]["energy_J"]["best"];
    ASSERT_EQ(best.size(), 30u);
    for (std::size_t k = 0; k < best.size(); ++k) {
      const json& costs = best[k]["costs"];
      const auto of = [&](const char* service) {
        json own = common;
        own.update({{"service", service}, {"detail", "all"}});
        return ask(robots, in_turn(own, best[k]["motion"]));
      };
      const auto expect_near = [&](const char* cost, const json& other, double share) {
        EXPECT_NEAR(costs[cost].get<double>(), other.get<double>(), share * other.get<double>()) << cost << " " << drives;
      };
      const json feasibility = of("feasibility");
      EXPECT_TRUE(feasibility["feasible"].get<bool>()) << feasibility["reason"];
      EXPECT_EQ(costs["time_s"], best[k]["T_s"]);
      expect_near("torque_squared_integral", feasibility["torque_squared_integral"], 1e-9);
      expect_near("work_J", feasibility["work_J"], 1e-9);
      expect_near("jerk_squared_integral", of("jerk")["jerk_squared_integral_rad2_per_s5"], 1e-9);
      expect_near("torque_squared_integral", of("torques")["torque_squared_integral"],
                  drives == std::string("none") ? 1e-9 : 2e-3);
      expect_near("energy_J", of("energy")["energy_J"], 1e-3);  // the link's capacitor sees samples
      if (k > 0) EXPECT_LE(best[k - 1]["costs"]["energy_J"], costs["energy_J"]);
    }
  }
}

TEST(Grow, GivesTheSameBytesOnAnyNumberOfThreadsAndTellsItsProgress) {
  Robots robots = shipped();
  const json two{{{"name", "time"}}, {{"name", "torque"}}};
  const json asked = request({{"motions", 17000}, {"detail", "all"}, {"cost", two}});
  const std::string one = answer(robots, asked.dump());
  numerics::Threads threads(2);
  Context context;
  context.threads = &threads;
  std::vector<double> shares;
  context.progress = [&](double share, const std::string&) { shares.push_back(share); };
  EXPECT_EQ(answer(robots, asked.dump(), context), one);
  ASSERT_GE(shares.size(), 3u);
  EXPECT_TRUE(std::ranges::is_sorted(shares));
  EXPECT_EQ(shares.back(), 1);
  EXPECT_NE(answer(robots, request({{"motions", 17000}, {"detail", "all"}, {"cost", two}, {"seed", 2}}).dump()), one);
  // A billion motions end where the caller ends them.
  context.progress = [](double, const std::string&) { throw Error("job", "was cancelled"); };
  json endless = request({{"motions", 1000000000}, {"samples", 8}, {"T_min_s", 0.0001}, {"T_max_s", 0.0002}});
  EXPECT_THROW(ask(robots, endless, context), Error);
}

// Links of 0.4 and 0.35 m at a height of 0.5 m, joints from −2.8 to 2.8 rad.
TEST(Grow, MapsTheReachOfAPlanarArm) {
  Robots robots = shipped();
  const json reply =
      ask(robots, {{"service", "grow"},
                   {"robot", "planar2"},
                   {"from_q_rad", {0.3, 0.5}},
                   {"to_grid", {{"least_m", {-0.91, 0, -0.41}}, {"most_m", {0.89, 0, 1.39}}, {"counts", {13, 1, 13}}}},
                   {"cost", {{{"name", "time"}}, {{"name", "work"}}}},
                   {"T_min_s", 0.5},
                   {"T_max_s", 5},
                   {"motions", 13 * 13 * 20}});
  const json& goals = reply["goals"];
  ASSERT_EQ(goals["x_m"].size(), 169u);
  const double nearest = std::sqrt(0.4 * 0.4 + 0.35 * 0.35 + 2 * 0.4 * 0.35 * std::cos(2.8));
  int reached = 0;
  for (std::size_t k = 0; k < 169; ++k) {
    const double x = goals["x_m"][k], z = goals["z_m"][k].get<double>() - 0.5, r = std::hypot(x, z);
    EXPECT_NEAR(x, -0.91 + 0.15 * static_cast<double>(k % 13), 1e-12);
    EXPECT_NEAR(z, -0.91 + 0.15 * static_cast<double>(k / 13), 1e-12);
    // The shoulder's angle of both elbow postures.
    bool within = false;
    if (r < 0.75 && r > nearest)
      for (const double elbow : {-1.0, 1.0}) {
        const double q2 = elbow * std::acos((r * r - 0.4 * 0.4 - 0.35 * 0.35) / (2 * 0.4 * 0.35));
        const double q1 = std::atan2(z, x) - std::atan2(0.35 * std::sin(q2), 0.4 + 0.35 * std::cos(q2));
        within = within || std::abs(std::remainder(q1, 2 * M_PI)) < 2.8;
      }
    EXPECT_EQ(goals["reached"][k].get<bool>(), within) << x << " " << z;
    EXPECT_EQ(goals["feasible_share"][k].is_null(), !within);
    EXPECT_EQ(goals["time_s"][k].is_null(), !within || goals["feasible_share"][k] == 0);
    reached += within ? 1 : 0;
  }
  EXPECT_GT(reached, 50);
  EXPECT_LT(reached, 120);
}

TEST(Grow, TellsWhatIsNotPossible) {
  Robots robots = shipped();
  json reply = ask(robots, request({{"T_min_s", 0.01}, {"T_max_s", 0.02}}));
  EXPECT_EQ(reply["feasible"], false);
  EXPECT_THAT(reply["reason"].get<std::string>(), HasSubstr("none of 400 motions keeps the bounds; dq of joint"));
  EXPECT_TRUE(reply["costs"]["time_s"].is_null());
  EXPECT_TRUE(reply["front"].empty());
  // A box of which half is beyond the limits of a joint.
  json wide = request({{"motions", 2000}, {"T_min_s", 20}, {"T_max_s", 20}, {"c_r_max_rad", {0, 0, 0, 0, 0, 0, 0}}});
  wide.erase("to_q_rad");
  wide["to_box"] = {{"least_q_rad", {0, 0, 0, 0, 0, 0, -1}}, {"most_q_rad", {0, 0, 0, 0, 0, 4, 1}}};
  reply = ask(robots, wide);
  EXPECT_EQ(reply["forbidden"][0]["bound"], "q");
  EXPECT_EQ(reply["forbidden"].size(), 1u);
  const double limit = robots.find("lwr4")->model.joints[5].q_max;
  EXPECT_NEAR(reply["forbidden"][0]["share"].get<double>(), 1 - limit / 4, 4 * 0.5 / std::sqrt(2000.0));
  // A grid that nothing reaches, one motion, and a motion that stands still.
  json far = request();
  far.erase("to_q_rad");
  far["to_grid"] = {{"least_m", {5, 0, 0}}, {"most_m", {6, 0, 0}}, {"counts", {2, 1, 1}}};
  reply = ask(robots, far);
  EXPECT_EQ(reply["reason"], "no place of the grid is reached within the bounds of position");
  EXPECT_EQ(reply["motions"], 0);
  EXPECT_EQ(reply["goals"]["reached"], json({false, false}));
  reply = ask(robots, request({{"motions", 1}, {"T_min_s", 3}}));
  EXPECT_EQ(reply["feasible_motions"], 1);
  EXPECT_EQ(reply["front"].size(), 1u);
  reply = ask(robots, request({{"to_q_rad", request()["from_q_rad"]}}));
  EXPECT_GT(reply["feasible_motions"], 100);
}

TEST(Grow, TakesListsOfPosturesAsGoals) {
  Robots robots = shipped();
  json r = request({{"motions", 7}, {"T_min_s", 3}});
  r.erase("to_q_rad");
  r["to_postures"] = {
      {{"q_deg", {10, 0, 0, 0, 0, 0, 0}}}, {{"q_rad", {0, 0.1, 0, 0, 0, 0, 0}}}, {{"q_rad", {0, 0, 0, 0, 0, 0, 0}}}};
  const json reply = ask(robots, r);
  EXPECT_EQ(reply["goals"]["feasible_share"], json({1, 1, 1}));
  EXPECT_FALSE(reply["goals"].contains("x_m"));
}

/// Keeps a table.
class Kept : public RowSink {
 public:
  void begin(const std::vector<std::string>& names, std::size_t count) override {
    columns = names;
    rows = count;
  }
  void row(const std::vector<double>& values) override { table.push_back(values); }
  std::vector<std::string> columns;
  std::size_t rows = 0;
  std::vector<std::vector<double>> table;
};

TEST(Grow, WritesEveryMotion) {
  Robots robots = shipped();
  Kept kept;
  Context context;
  context.rows = &kept;
  const json reply = ask(robots, request(), context);
  EXPECT_EQ(kept.rows, 400u);
  ASSERT_EQ(kept.table.size(), 400u);
  EXPECT_EQ(kept.columns.size(), 5u + 5 + 2 * 7 + 4 * 7);
  EXPECT_EQ(kept.columns[5], "time_s");
  EXPECT_EQ(kept.columns.back(), "c_r[7;4]");
  int feasible = 0;
  for (const auto& row : kept.table) {
    ASSERT_EQ(row.size(), kept.columns.size());
    feasible += row[2] == 1 ? 1 : 0;
  }
  EXPECT_EQ(feasible, reply["feasible_motions"]);
}

TEST(Grow, RefusesWhatItCannotMean) {
  Robots robots = shipped();
  const auto refused = [&](const json& change) { return problem_of(robots, request(), change); };
  EXPECT_EQ(refused(json::object()), "");
  EXPECT_THAT(refused({{"to_q_rad", nullptr}}),
              HasSubstr("/to_q_rad: is missing, expected a posture, a list, a box or a grid"));
  EXPECT_THAT(refused({{"from_q_rad", nullptr}}), HasSubstr("/from_q_rad: is missing"));
  EXPECT_THAT(refused({{"T_min_s", nullptr}}), HasSubstr("/T_min_s: is missing"));
  EXPECT_THAT(refused({{"to_postures", {{{"q_rad", {0, 0, 0, 0, 0, 0, 0}}}}}}),
              HasSubstr("/to_postures: is given beside to_q_rad"));
  EXPECT_THAT(refused({{"from_postures", json::array()}, {"from_q_rad", nullptr}}),
              HasSubstr("/from_postures: is no array of 1 to"));
  EXPECT_THAT(refused({{"from_postures", {{{"q_rad", {0}}}}}, {"from_q_rad", nullptr}}),
              HasSubstr("/from_postures/0/q_rad: has 1 values"));
  const json zero = {0, 0, 0, 0, 0, 0, 0}, below = {0, 0, 0, 0, 0, 0, -1};
  EXPECT_THAT(refused({{"to_box", {{"least_q_rad", zero}, {"most_q_rad", below}}}, {"to_q_rad", nullptr}}),
              HasSubstr("/to_box/most_q_rad/6: is -1"));
  EXPECT_THAT(refused({{"c_r_max_rad", below}}), HasSubstr("/c_r_max_rad/6: is negative"));
  EXPECT_THAT(refused({{"c_r_max_rad", {1}}}), HasSubstr("/c_r_max_rad: has 1 values"));
  EXPECT_THAT(refused({{"cost", "stiffness"}}), HasSubstr("/cost: has stiffness"));
  EXPECT_THAT(refused({{"cost", {{{"name", "time"}, {"weight", 2}}}}}), HasSubstr("expected no weights"));
  EXPECT_THAT(refused({{"motions", 0}}), HasSubstr("/motions: is 0, expected a whole number from 1 to 1000000000"));
  const auto grid = [&](const json& change) {
    json own{{"least_m", {0, 0, 0}}, {"most_m", {1, 1, 0}}, {"counts", {3, 3, 1}}};
    own.update(change);
    return refused({{"to_q_rad", nullptr}, {"to_grid", own}});
  };
  EXPECT_THAT(grid({{"counts", {3, 1, 1}}}), HasSubstr("/to_grid/counts/1: is 1 between different corners"));
  EXPECT_THAT(grid({{"counts", {2.5, 3, 1}}}), HasSubstr("/to_grid/counts/0: is 2.5"));
  EXPECT_THAT(grid({{"counts", {1000, 1000, 1}}}), HasSubstr("/to_grid/counts: has 1000000 places"));
  EXPECT_THAT(grid({{"most_m", {-1, 1, 0}}}), HasSubstr("/to_grid/most_m/0: is -1"));
  EXPECT_THAT(grid({{"quaternion_wxyz", {1, 1, 0, 0}}}), HasSubstr("has the norm 1.41"));
  EXPECT_THAT(grid({{"frame", "nowhere"}}), HasSubstr("nowhere"));
}

/// The satellite with a probe of example 22.
json of_satellite(const std::string& service, const json& more) {
  json r{{"service", service},
         {"robot", places::source() + "/examples/22_reactionless/satellite.urdf"},
         {"from_q_rad", {0, 0.5, 0, -1.4, 0, 0.8, 0}}};
  r.update(more);
  return r;
}

// The way back: reactionless gets to the places that grow tells, and by Newton and Euler its motions do not turn the base.
TEST(Grow, TellsWhereMotionsThatDoNotTurnTheBaseEnd) {
  Robots robots({places::source() + "/models/robots"}, "lwr4", true);
  Kept kept;
  Context context;
  context.rows = &kept;
  const json asked = of_satellite("grow", {{"constraint", "base"}, {"motions", 120}, {"detail", "all"}});
  const json reply = ask(robots, asked, context);
  ASSERT_EQ(kept.table.size(), 120u);
  numerics::Threads threads(3);
  Context more;
  more.threads = &threads;
  EXPECT_EQ(ask(robots, asked, more), reply);
  const double q_max = robots.find(asked["robot"])->model.joints[3].q_max;
  int feasible = 0, tried = 0;
  for (const auto& row : kept.table) {
    feasible += row[1] == 1 ? 1 : 0;
    if (row[1] == 1) EXPECT_LE(std::abs(row[10 + 3]), q_max);
    for (int i = 0; i < 3; ++i)
      if (row[1] == 1) {
        EXPECT_GE(row[3 + static_cast<std::size_t>(i)], reply["ends"]["least_m"][i]);
        EXPECT_LE(row[3 + static_cast<std::size_t>(i)], reply["ends"]["most_m"][i]);
      }
    if (row[1] != 1 || std::hypot(row[3] + 0.7104, row[4], row[5] + 0.0915) < 0.2 || tried == 2) continue;
    ++tried;
    const json goal{{"directions", {"x", "y", "z"}},
                    {"p_m", {row[3], row[4], row[5]}},
                    {"quaternion_wxyz", {row[6], row[7], row[8], row[9]}}};
    const json back = ask(robots, of_satellite("reactionless", {{"to_pose", goal}, {"particles", 16}, {"rounds", 20}}));
    EXPECT_TRUE(back["reactionless"].get<bool>()) << row[0];
    EXPECT_LT(back["to_go"]["distance_m"].get<double>(), 1e-6);
    EXPECT_LT(back["worst"]["turn"]["turn_rad"].get<double>(), 1e-6);
  }
  EXPECT_EQ(tried, 2);
  EXPECT_EQ(feasible, reply["feasible_motions"]);
  EXPECT_GT(feasible, 60);
  EXPECT_EQ(reply["forbidden"][0]["bound"], "q");
}

TEST(Grow, RefusesWhatCannotKeepTheBase) {
  Robots robots({places::source() + "/models/robots"}, "lwr4", true);
  const json asked = of_satellite("grow", {{"constraint", "base"}, {"motions", 10}});
  const auto refused = [&](const json& change) { return problem_of(robots, asked, change); };
  EXPECT_EQ(refused(json::object()), "");
  EXPECT_THAT(refused({{"to_q_rad", {0, 0, 0, 0, 0, 0, 0}}}), HasSubstr("/to_q_rad: is given with the constraint base"));
  EXPECT_THAT(refused({{"from_q_rad", nullptr}}), HasSubstr("/from_q_rad: is missing"));
  EXPECT_THAT(refused({{"T_min_s", 1}}), HasSubstr("/T_min_s: is an unknown member"));
  EXPECT_THAT(refused({{"from_q_rad", {0, 0, 0, 0, 0, 0, 0}}}),
              HasSubstr("/constraint: is base, but the first posture is singular"));
  EXPECT_THAT(refused({{"constraint", nullptr}, {"base", {{"mass_kg", 1}}}}),
              HasSubstr("/base: is given, but has no effect without the constraint"));
  EXPECT_THAT(refused({{"robot", "planar2"},
                       {"locked_q", {{"elbow", 1}}},
                       {"from_q_rad", {0}},
                       {"base", {{"mass_kg", 1}, {"inertia_kg_m2", {1, 0, 0, 1, 0, 1}}}}}),
              HasSubstr("the robot has one joint, which turns the base"));
}

}  // namespace
}  // namespace cotwin::services::grow_test
