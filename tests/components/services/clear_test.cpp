// clear_of: what a motion meets, and motions that are found around it.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "components/services/json/json.h"
#include "components/services/services.h"
#include "models/cloud/cloud_file.h"
#include "models/cloud/sample.h"
#include "models/robot/frame_kinematics.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"

namespace cotwin::services::clear_test {
namespace {

using cotwin::testing::error_of;
using nlohmann::json;
using ::testing::HasSubstr;

class ClearOfScenes : public ::testing::Test {
 protected:
  ClearOfScenes() {
    const auto model = [](const std::string& name, const std::string& pose, const std::string& size) {
      return "<model name=\"" + name + "\"><static>true</static><pose>" + pose + "</pose><link name=\"" + name +
             "\"><collision name=\"c\"><geometry><box><size>" + size + "</size></box></geometry></collision></link></model>";
    };
    folder_.write("scenes/post.sdf", "<sdf version=\"1.11\"><world name=\"w\">" +
                                         model("post", "0.62 0.42 0.2 0 0 0", "0.1 0.1 1.2") + "</world></sdf>");
    folder_.write("scenes/far.sdf", "<sdf version=\"1.11\"><world name=\"w\">" +
                                        model("post", "0.8 0.55 0.2 0 0 0", "0.1 0.1 1.2") + "</world></sdf>");
    folder_.write("scenes/empty.sdf", "<sdf version=\"1.11\"><world name=\"w\"/></sdf>");
    std::filesystem::create_directories(folder_ / "robots");
  }
  cotwin::testing::TemporaryFolder folder_{"clear"};
  /// As a server has it: scenes by name.
  Robots robots_{{places::source() + "/models/robots", (folder_ / "robots").string()}};
  json ask(const json& change, const std::string& service = "feasibility") {
    json request{{"service", service},
                 {"robot", "lwr4"},
                 {"from_q_rad", {0, -1.2, 0, 0.9, 0, -0.3, 0}},
                 {"to_q_rad", {1.2, -1.2, 0, 0.9, 0, -0.3, 0}},
                 {"detail", "all"}};
    if (service == "feasibility") request["T_s"] = 2;
    request.update(change);
    return json::parse(answer(robots_, request.dump()));
  }
  std::string refusal(const json& clear_of) {
    return error_of([&] { ask({{"clear_of", clear_of}}); });
  }
};

// The shape of a payload counts while it is carried.
TEST_F(ClearOfScenes, MeetPayloadsWhileTheyAreCarried) {
  const json scene{{"clear_of", {{"scene", "far"}}}};
  const json free = ask(scene);
  ASSERT_EQ(free["feasible"], true) << free["reason"];
  const auto with = [&](const json& interval, double T = 2) {
    json request = scene;
    request["T_s"] = T;
    request["payload"] = {{"mass_kg", 0.5}, {"p_m", {0, 0, 0.25}}, {"box_m", {0.05, 0.05, 0.3}}};
    request["payload"].update(interval);
    return ask(request);
  };
  const json carried = with(json::object());
  ASSERT_EQ(carried["feasible"], false);
  EXPECT_EQ(carried["clear_of"]["nearest"]["link"], "payload_1");
  ASSERT_EQ(carried["clear_of"]["places"].size(), 1u);
  EXPECT_TRUE(carried["clear_of"]["places"][0]["by"].is_null()) << "no base is given";
  EXPECT_THAT(carried["reason"].get<std::string>(), HasSubstr("payload_1 meets post at "));
  const double t = carried["clear_of"]["nearest"]["t_s"];
  EXPECT_EQ(with({{"to_share", t / 2 - 0.02}})["feasible"], true);
  EXPECT_EQ(with({{"to_share", t / 2 + 0.02}})["feasible"], false);
  EXPECT_EQ(with({{"from_share", t / 2 - 0.02}})["feasible"], false);
  EXPECT_NEAR(with({{"from_share", 0.01}}, 5)["clear_of"]["nearest"]["t_s"].get<double>(), 2.5 * t, 2e-3);
  // Shapes of others with this name are refused.
  json twice = scene;
  twice["payload"] = {{"name", "hand"}, {"mass_kg", 0.5}, {"box_m", {0.05, 0.05, 0.3}}};
  twice["clear_of"]["tools"] = {{{"name", "hand"}, {"frame", "link_7"}, {"box_m", {0.1, 0.1, 0.1}}}};
  EXPECT_THAT(error_of([&] { ask(twice); }), HasSubstr("/clear_of/tools: has 'hand', which is a payload, too"));
}

TEST_F(ClearOfScenes, TellTheFirstTimeALinkAndThePoints) {
  const json free = ask({{"clear_of", {{"scene", "empty"}}}});
  EXPECT_EQ(free["feasible"], true);
  EXPECT_EQ(free["clear_of"]["clear"], true);
  EXPECT_TRUE(free["clear_of"]["nearest"].is_null());

  const json met = ask({{"clear_of", {{"scene", "post"}}}});
  EXPECT_EQ(met["feasible"], false);
  const json nearest = met["clear_of"]["nearest"];
  EXPECT_EQ(nearest["obstacle"], "post");
  EXPECT_GT(nearest["t_s"], 0.2);
  EXPECT_LT(nearest["t_s"], 1);
  EXPECT_NEAR(nearest["distance_m"].get<double>(), 0, 2e-6);
  EXPECT_EQ(met["reason"].get<std::string>().find(nearest["link"].get<std::string>() + " meets post at 0."), 0u)
      << met["reason"];

  // With a clearance earlier; the same way in twice the time at twice the time.
  const json earlier = ask({{"clear_of", {{"scene", "post"}, {"clearance_m", 0.1}}}});
  EXPECT_LT(earlier["clear_of"]["nearest"]["t_s"], nearest["t_s"]);
  EXPECT_THAT(earlier["reason"].get<std::string>(), HasSubstr("comes nearer than 0.1 m to post"));
  const json slower = ask({{"T_s", 4}, {"clear_of", {{"scene", "post"}}}});
  EXPECT_NEAR(slower["clear_of"]["nearest"]["t_s"].get<double>(), 2 * nearest["t_s"].get<double>(), 1e-4);
  const json shortest = ask({{"clear_of", {{"scene", "post"}}}}, "cycle_time");
  EXPECT_TRUE(shortest["T_s"].is_null());
  EXPECT_EQ(shortest["clear_of"]["clear"], false);

  // From below the post, or with the base elsewhere, it is clear.
  EXPECT_EQ(ask({{"clear_of", {{"scene", "post"}, {"base", {{"p_m", {0, -1, 0}}}}}}})["clear_of"]["clear"], true);
  const json turned =
      ask({{"clear_of", {{"scene", "post"}, {"base", {{"quaternion_wxyz", {std::sqrt(0.5), 0, 0, -std::sqrt(0.5)}}}}}}});
  EXPECT_EQ(turned["clear_of"]["clear"], true);
}

TEST_F(ClearOfScenes, KnowOtherRobotsAtTheirPlacesAndTimes) {
  const auto other = [](json more) {
    json one{{"robot", "lwr4"}, {"name", "right"}, {"base", {{"p_m", {1.2, 0, 0}}, {"quaternion_wxyz", {0, 0, 0, 1}}}}};
    one.update(more);
    return json{{"robots", {one}}};
  };
  const json in_the_way{0, -1.2, 0, 0.9, 0, -0.3, 0}, up{0, 0, 0, 0, 0, 0, 0};
  EXPECT_EQ(ask({{"clear_of", other({{"q_rad", in_the_way}})}})["clear_of"]["clear"], false);
  EXPECT_EQ(ask({{"clear_of", other({{"q_rad", up}})}})["clear_of"]["clear"], true);
  // It comes down after the other has gone.
  const auto comes_at = [&](double t) {
    return ask({{"clear_of", other({{"series", {{"t_s", {0, t, t + 0.5}}, {"q_rad", {up, up, in_the_way}}}}})}})["clear_of"];
  };
  EXPECT_EQ(comes_at(2)["clear"], true) << comes_at(2);
  const json early = comes_at(0.1);
  EXPECT_EQ(early["clear"], false);
  EXPECT_EQ(early["nearest"]["obstacle"].get<std::string>().substr(0, 6), "right/");
}

// A bar of 1.2 m reaches the post, which the links alone pass at 0.16 m.
TEST_F(ClearOfScenes, KnowToolsOfTheRobotAndOfOthers) {
  const json away{{"scene", "post"}, {"base", {{"p_m", {-0.3, 0, 0}}}}};
  const auto with = [](json clear_of, json tool) {
    clear_of["tools"] = json::array({tool});
    return json{{"clear_of", clear_of}};
  };
  const json bar{{"name", "bar"}, {"frame", "link_7"}, {"p_m", {0, 0, 0.7}}, {"box_m", {0.05, 0.05, 1.2}}};
  EXPECT_EQ(ask({{"clear_of", away}})["clear_of"]["clear"], true);
  const json met = ask(with(away, bar));
  EXPECT_EQ(met["clear_of"]["clear"], false);
  EXPECT_EQ(met["clear_of"]["nearest"]["link"], "bar");
  EXPECT_THAT(met["reason"].get<std::string>(), HasSubstr("bar meets post at "));
  json ignored = away;
  ignored["ignore"] = {"bar:post"};
  EXPECT_EQ(ask(with(ignored, bar))["clear_of"]["clear"], true);
  // The same tool from a file, where paths are allowed.
  folder_.write(
      "bar.urdf",
      "<robot name=\"bar\"><link name=\"bar\"><collision><geometry><box size=\"0.05 0.05 1.2\"/></geometry></collision>"
      "</link></robot>");
  json file = bar;
  file.erase("box_m");
  file["urdf"] = (folder_ / "bar.urdf").string();
  Robots local({places::source() + "/models/robots", (folder_ / "robots").string()}, "", true);
  json request{{"service", "feasibility"},
               {"robot", "lwr4"},
               {"from_q_rad", {0, -1.2, 0, 0.9, 0, -0.3, 0}},
               {"to_q_rad", {1.2, -1.2, 0, 0.9, 0, -0.3, 0}},
               {"T_s", 2}};
  request.update(with(away, file));
  EXPECT_EQ(json::parse(answer(local, request.dump()))["clear_of"], met["clear_of"]);
  // Another robot carries it; the robot itself meets its own.
  json right{{"robot", "lwr4"},
             {"base", {{"p_m", {1.9, 0, 0}}, {"quaternion_wxyz", {0, 0, 0, 1}}}},
             {"q_rad", {0, -1.2, 0, 0.9, 0, -0.3, 0}}};
  EXPECT_EQ(ask({{"clear_of", {{"robots", json::array({right})}}}})["clear_of"]["clear"], true);
  right["tools"] = json::array({bar});
  EXPECT_EQ(ask({{"clear_of", {{"robots", json::array({right})}}}})["clear_of"]["nearest"]["obstacle"], "lwr4/bar");
  json back = bar;
  back["p_m"] = {0, 0, -0.6};
  EXPECT_EQ(ask(with({{"self", true}}, back))["clear_of"]["clear"], false);
  EXPECT_EQ(ask(with({{"self", true}, {"scene", "empty"}}, bar))["clear_of"]["clear"], true);
  // Bad input.
  const auto refused = [&](const json& change) {
    json tool = bar;
    tool.update(change);
    return error_of([&] { ask(with(away, tool)); });
  };
  EXPECT_THAT(refused({{"frame", "link_8"}}),
              HasSubstr("/clear_of/tools/0/frame: robot 'lwr4_published_fit': no frame 'link_8', did you mean"));
  EXPECT_THAT(refused({{"urdf", "x.urdf"}}), HasSubstr("/clear_of/tools/0/urdf: is given beside box_m"));
  EXPECT_THAT(refused({{"box_m", {1, 0, 1}}}), HasSubstr("/clear_of/tools/0/box_m: has an edge of 0 or less"));
  EXPECT_THAT(refused({{"name", "link_3"}}), HasSubstr("/clear_of/tools/0/name: 'link_3' is there twice"));
  EXPECT_THAT(refused({{"mass", 1}}), HasSubstr("/clear_of/tools/0"));
  EXPECT_THAT(error_of([&] { ask(with(away, file)); }), HasSubstr("/clear_of/tools/0/urdf: tool: is not a name of letters"));
  json neither = bar;
  neither.erase("box_m");
  EXPECT_THAT(error_of([&] { ask(with(away, neither)); }), HasSubstr("/clear_of/tools/0/urdf: and box_m are missing"));
  EXPECT_THAT(refusal({{"scene", "post"}, {"tools", 3}}), HasSubstr("/clear_of/tools: is no array"));
}

// A ball where the cheapest motion has the tip half way.
TEST_F(ClearOfScenes, FindMotionsAroundAnObstacle) {
  json search{{"T_min_s", 2}, {"T_max_s", 2.5}, {"degree", 7}, {"particles", 24}, {"rounds", 40}, {"cost", "torque"}};
  const json cheapest = ask(search, "optimise");
  const std::shared_ptr<const Robot> robot = robots_.find("lwr4");
  Move move;
  move.from_q = cheapest["motion"]["q_start_rad"].get<std::vector<double>>();
  move.to_q = cheapest["motion"]["q_end_rad"].get<std::vector<double>>();
  move.T = cheapest["T_s"];
  move.degree = 7;
  move.c = cheapest["motion"]["c_r_rad"].get<std::vector<double>>();
  std::vector<double> q(7), dq(7), ddq(7);
  plan(robot->model, move).solution.path.at(move.T / 2, q, dq, ddq);
  robot::FrameKinematics kinematics(robot->model, robot->model.end_effector());
  const Eigen::Map<const Eigen::VectorXd> posture(q.data(), 7);
  const Eigen::VectorXd rest = Eigen::VectorXd::Zero(7);
  const Eigen::Vector3d p = kinematics.at(posture, rest, rest).p;
  std::ostringstream place;
  place << p.x() << ' ' << p.y() << ' ' << p.z();
  folder_.write("scenes/ball.sdf",
                "<sdf version=\"1.11\"><world name=\"w\"><model name=\"ball\"><static>true</static><pose>" + place.str() +
                    " 0 0 0</pose><link name=\"ball\"><collision name=\"c\"><geometry><sphere><radius>0.02</radius></sphere>"
                    "</geometry></collision></link></model></world></sdf>");
  search["clear_of"] = {{"scene", "ball"}, {"clearance_m", 0.005}};
  const json around = ask(search, "optimise");
  EXPECT_EQ(around["feasible"], true) << around;
  EXPECT_EQ(around["clear_of"]["clear"], true);
  EXPECT_GE(around["clear_of"]["nearest"]["distance_m"], 0.005);
  EXPECT_GT(around["cost"], cheapest["cost"]);
  EXPECT_LT(around["cost"], 2 * cheapest["cost"].get<double>());
  EXPECT_THAT(around["notes"].dump(), HasSubstr("cheaper motions that were found are not clear (the cheapest one: link_"));
  // What was found is judged by itself.
  json found{{"T_s", around["T_s"]}, {"clear_of", search["clear_of"]}};
  if (around["motion"].contains("c_r_rad"))  // else the quintic is clear and cheaper than what the search tried
    found.update({{"degree", 7}, {"c_r_rad", around["motion"]["c_r_rad"]}});
  const json judged = ask(found);
  EXPECT_EQ(judged["feasible"], true) << judged["reason"];

  // No motion is clear of a wall around the start; the front loses those that meet the ball.
  folder_.write(
      "scenes/wall.sdf",
      "<sdf version=\"1.11\"><world name=\"w\"><model name=\"wall\"><static>true</static><link name=\"wall\"><collision "
      "name=\"c\"><geometry><box><size>3 3 3</size></box></geometry></collision></link></model></world></sdf>");
  json blocked = search;
  blocked.update({{"rounds", 10}, {"refine", false}, {"clear_of", {{"scene", "wall"}}}});
  const json none = ask(blocked, "optimise");
  EXPECT_EQ(none["feasible"], false);
  EXPECT_EQ(none["status"], "infeasible");
  EXPECT_THAT(none["notes"].dump(), HasSubstr("motions that were found is clear"));
  // A front loses those of its motions that are not clear, and no others.
  const json clear_of = search["clear_of"];
  search.update({{"rule", "pareto"},
                 {"cost", {{{"name", "torque"}}, {{"name", "jerk"}}}},
                 {"directions", 2},
                 {"rounds", 12},
                 {"refine", false}});
  json front = ask(search, "optimise")["front"];
  for (json& one : front) EXPECT_EQ(one["verdict"]["findings"].size(), 2U);  // bounds, clear_of
  for (json& one : front) one.erase("verdict");
  search.erase("clear_of");
  std::size_t clear = 0;
  json whole = ask(search, "optimise")["front"];
  for (json& one : whole) {
    one.erase("verdict");
    const json verdict =
        ask({{"degree", 7}, {"T_s", one["T_s"]}, {"c_r_rad", one["motion"]["c_r_rad"]}, {"clear_of", clear_of}})["clear_of"];
    if (verdict["clear"] == true && clear < front.size()) {
      EXPECT_EQ(front[clear], one);
    }
    clear += verdict["clear"] == true ? 1 : 0;
  }
  EXPECT_EQ(front.size(), clear);
  EXPECT_GT(whole.size(), 3U);
}

// The post as points.
TEST_F(ClearOfScenes, KnowPointClouds) {
  std::vector<std::string> notes;
  const auto write = [&](const std::string& file, double spacing) {
    std::ostringstream out;
    cloud::write_cloud(out, cloud::sample(robots_.scene("post", notes), {.spacing = spacing}, notes), cloud::Format::kPcd);
    folder_.write(file, out.str());
  };
  write("scenes/post_cloud.pcd", 0.01);
  const json met = ask({{"clear_of", {{"scene", "post"}}}}), cloud = ask({{"clear_of", {{"cloud", {{"name", "post_cloud"}}}}}});
  EXPECT_EQ(cloud["feasible"], false);
  EXPECT_THAT(cloud["reason"].get<std::string>(), HasSubstr("meets cloud at"));
  const json nearest = cloud["clear_of"]["nearest"];
  EXPECT_EQ(nearest["obstacle"], "cloud");
  EXPECT_NEAR(nearest["t_s"].get<double>(), met["clear_of"]["nearest"]["t_s"].get<double>(), 0.03);
  EXPECT_THAT(cloud["notes"].dump(), ::testing::Not(HasSubstr("radius_m")));
  // Elsewhere, and beside a scene.
  const json away{{"name", "post_cloud"}, {"p_m", {0.5, 0.5, 0}}};
  EXPECT_EQ(ask({{"clear_of", {{"cloud", away}}}})["clear_of"]["clear"], true);
  EXPECT_EQ(ask({{"clear_of", {{"cloud", away}, {"scene", "post"}}}})["clear_of"]["nearest"]["obstacle"], "post");
  const json turned{{"name", "post_cloud"}, {"quaternion_wxyz", {0, 0, 0, 1}}};
  EXPECT_EQ(ask({{"clear_of", {{"cloud", turned}}}})["clear_of"]["clear"], true);
  EXPECT_EQ(
      ask({{"clear_of", {{"cloud", {{"name", "post_cloud"}}}, {"ignore", json::array()}}}}, "cycle_time")["clear_of"]["clear"],
      false);
  // Larger balls are met earlier; of smaller ones a note tells.
  const json larger = ask({{"clear_of", {{"cloud", {{"name", "post_cloud"}, {"radius_m", 0.1}}}}}});
  EXPECT_LT(larger["clear_of"]["nearest"]["t_s"], nearest["t_s"]);
  const json points = ask({{"clear_of", {{"cloud", {{"name", "post_cloud"}, {"radius_m", 0}}}}}});
  EXPECT_THAT(points["notes"].dump(), HasSubstr("radius_m is 0 m, but 95 % of the points are up to 0.0"));
  // It is read again when it has changed.
  write("scenes/post_cloud.pcd", 0.1);
  std::filesystem::last_write_time(folder_ / "scenes/post_cloud.pcd",
                                   std::filesystem::file_time_type::clock::now() + std::chrono::hours(1));
  EXPECT_THAT(ask({{"clear_of", {{"cloud", {{"name", "post_cloud"}, {"radius_m", 0.01}}}}}})["notes"].dump(),
              HasSubstr("radius_m is 0.01 m"));

  const auto refused = [&](const json& given) { return refusal({{"cloud", given}}); };
  EXPECT_THAT(refused({{"name", "nothing"}}), HasSubstr("/clear_of/cloud/name: cloud: 'nothing' is unknown"));
  EXPECT_THAT(refused({{"name", (folder_ / "scenes/post_cloud.pcd").string()}}), HasSubstr("paths are for the command line"));
  EXPECT_THAT(refused({{"name", "post_cloud"}, {"radius_m", -1}}), HasSubstr("/clear_of/cloud/radius_m: is negative"));
  EXPECT_THAT(refused({{"name", "post_cloud"}, {"surprise", 1}}), HasSubstr("/clear_of/cloud/surprise"));
  folder_.write("scenes/bad.pcd", "VERSION");
  EXPECT_THAT(refused({{"name", "bad"}}), HasSubstr("has no columns, expected x, y, z"));
  Robots local{{places::source() + "/models/robots"}, "", true};
  json request{{"service", "feasibility"},
               {"robot", "lwr4"},
               {"from_q_rad", json::array({0, -1.2, 0, 0.9, 0, -0.3, 0})},
               {"to_q_rad", json::array({1.2, -1.2, 0, 0.9, 0, -0.3, 0})},
               {"T_s", 2}};
  request["clear_of"] = {{"cloud", {{"name", (folder_ / "scenes/post_cloud.pcd").string()}}}};
  EXPECT_EQ(json::parse(answer(local, request.dump()))["clear_of"]["clear"], false);
}

TEST_F(ClearOfScenes, RefuseWhatTheyCannotAnswer) {
  EXPECT_THAT(refusal(json::object()), HasSubstr("/clear_of/scene: is missing, and there are no cloud, no robots and no self"));
  EXPECT_THAT(refusal({{"scene", "nothing"}}), HasSubstr("/clear_of/scene: scene: 'nothing' is unknown"));
  const std::string path = (folder_ / "scenes/post.sdf").string();
  EXPECT_THAT(refusal({{"scene", path}}), HasSubstr("is not a name of letters"));
  EXPECT_THAT(refusal({{"scene", "../scenes/post"}}), HasSubstr("is not a name of letters"));
  EXPECT_THAT(refusal({{"scene", "post"}, {"clearance_m", -1}}), HasSubstr("/clear_of/clearance_m"));
  EXPECT_THAT(refusal({{"scene", "post"}, {"ignore", {"link_5:pst"}}}), HasSubstr("did you mean 'post'?"));
  EXPECT_THAT(refusal({{"scene", "post"}, {"base", {{"quaternion_wxyz", {0, 0, 0, 0}}}}}),
              HasSubstr("has the length 0, expected 1"));
  EXPECT_THAT(refusal({{"scene", "post"}, {"surprise", 1}}), HasSubstr("/clear_of"));
  EXPECT_THAT(refusal({{"robots", {{{"robot", "nobody"}, {"q_rad", {0}}}}}}), HasSubstr("/clear_of/robots/0/robot"));
  EXPECT_THAT(refusal({{"robots", {{{"robot", "planar2"}}}}}), HasSubstr("/clear_of/robots/0/q_rad"));
  EXPECT_THAT(refusal({{"robots", {{{"robot", "planar2"}, {"q_rad", {0, 0, 0}}}}}}), HasSubstr("has 3 values, expected 2"));
  const json twice{{"robot", "lwr4"}, {"q_rad", {0, 0, 0, 0, 0, 0, 0}}};
  EXPECT_THAT(refusal({{"robots", {twice, twice}}}), HasSubstr("'lwr4' is there twice"));
  EXPECT_THAT(error_of([&] { ask({{"clear_of", {{"scene", "post"}}}}, "reaction"); }), HasSubstr("clear_of"));
  EXPECT_THAT(error_of([&] {
                ask({{"clear_of", {{"scene", "post"}}}, {"T_min_s", 2}, {"rule", "lexicographic"}}, "optimise");
              }),
              HasSubstr("/rule: is lexicographic beside clear_of"));
}

}  // namespace
}  // namespace cotwin::services::clear_test
