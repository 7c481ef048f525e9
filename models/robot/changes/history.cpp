#include "models/robot/changes/history.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin::robot {

namespace {

using Json = nlohmann::ordered_json;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kVersion = 1;
constexpr double kRounding = 1e-9;  // of an inertia that is computed again, relative to its largest number

constexpr std::pair<const char*, Change::Kind> kKinds[] = {
    {"attach", Change::Kind::kAttach}, {"detach", Change::Kind::kDetach}, {"set_inertia", Change::Kind::kSetInertia}};

const char* word_of(Change::Kind kind) {
  return std::find_if(std::begin(kKinds), std::end(kKinds), [&](const auto& row) { return row.second == kind; })->first;
}

double finite(double value, const std::string& robot) {
  if (!std::isfinite(value)) throw Error("robot '" + robot + "'", "has a number that is not finite in its history");
  return value;
}

Json numbers(const double* values, std::size_t count, const std::string& robot) {
  Json list = Json::array();
  for (std::size_t i = 0; i < count; ++i) list.push_back(finite(values[i], robot));
  return list;
}

Json pose(const Pose& X, const std::string& robot) {
  const Matrix3d by_rows = X.R.transpose();
  return {{"xyz", numbers(X.p.data(), 3, robot)}, {"R", numbers(by_rows.data(), 9, robot)}};
}

Json inertia(const Inertia& body, const std::string& robot) {
  const Matrix3d& I = body.I_CC;
  const double moments[] = {I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
  return {{"mass", finite(body.mass, robot)},
          {"com", numbers(body.p_LC.data(), 3, robot)},
          {"inertia", numbers(moments, 6, robot)}};
}

const std::string& name_of_body(const RobotModel& robot, int body) {
  return body < 0 ? robot.base.name : robot.bodies[static_cast<std::size_t>(body)].name;
}

Json change_to_json(const Change& change, const RobotModel& robot) {
  Json j;
  if (change.time) j["time"] = finite(*change.time, robot.name);
  j["change"] = word_of(change.kind);
  if (!change.reason.empty()) j["reason"] = change.reason;
  if (change.kind != Change::Kind::kSetInertia) {
    j["name"] = change.frame.name;
    j["parent"] = change.parent;
  }
  if (change.kind == Change::Kind::kAttach) {
    j["pose"] = pose(change.X_PF, robot.name);
    j["part"] = inertia(change.own, robot.name);
    for (const PartFrame& frame : change.further) {
      Json further = pose(frame.X_AF, robot.name);
      further["name"] = frame.name;
      j["frames"].push_back(std::move(further));
    }
  }
  j["body"] = name_of_body(robot, change.body);
  j["result"] = inertia(change.after, robot.name);
  return j;
}

/// The members of an object of the file. A member that is not asked for is an error.
class Members {
 public:
  Members(const Json& json, std::string place) : json_(json), place_(std::move(place)) {
    if (!json_.is_object()) fail("is no object");
  }

  [[noreturn]] void fail(const std::string& what) const { throw Error(place_, what); }
  const std::string& place() const { return place_; }
  const Json* find(const char* key) {
    asked_.push_back(key);
    const auto found = json_.find(key);
    return found == json_.end() ? nullptr : &*found;
  }
  const Json& at(const char* key) {
    const Json* found = find(key);
    if (found == nullptr) fail("has no '" + std::string(key) + "'");
    return *found;
  }
  std::string text(const char* key) {
    const Json& value = at(key);
    if (!value.is_string()) fail("'" + std::string(key) + "' is no text");
    return value.get<std::string>();
  }
  std::string text_or_none(const char* key) { return find(key) == nullptr ? "" : text(key); }
  double number(const char* key) { return number(at(key), key); }
  std::vector<double> numbers(const char* key, std::size_t count) {
    const Json& list = at(key);
    if (!list.is_array() || list.size() != count)
      fail("'" + std::string(key) + "' is no list of " + std::to_string(count) + " numbers");
    std::vector<double> values;
    for (const Json& value : list) values.push_back(number(value, key));
    return values;
  }
  const Json& list(const char* key) {
    const Json& value = at(key);
    if (!value.is_array()) fail("'" + std::string(key) + "' is no list");
    return value;
  }
  void expect_no_others() const {
    for (const auto& [key, value] : json_.items()) {
      if (std::find(asked_.begin(), asked_.end(), key) == asked_.end()) fail("has an unknown member '" + key + "'");
    }
  }

 private:
  double number(const Json& value, const char* key) const {
    const double number = value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
    if (!(std::abs(number) < 1e15)) fail("'" + std::string(key) + "' is no number of a magnitude below 1e15");
    return number;
  }

  const Json& json_;
  std::string place_;
  std::vector<std::string> asked_;
};

Pose read_pose(Members& members) {
  Pose X;
  X.p = Vector3d(members.numbers("xyz", 3).data());
  X.R = Matrix3d(members.numbers("R", 9).data()).transpose();
  if (!is_rotation(X.R)) members.fail("'R' is no rotation matrix");
  return X;
}

Inertia read_inertia(const Json& json, const std::string& place) {
  Members members(json, place);
  Inertia body;
  body.mass = members.number("mass");
  body.p_LC = Vector3d(members.numbers("com", 3).data());
  const std::vector<double> I = members.numbers("inertia", 6);
  body.I_CC << I[0], I[1], I[2], I[1], I[3], I[4], I[2], I[4], I[5];
  members.expect_no_others();
  return body;
}

bool agree(const Inertia& a, const Inertia& b) {
  const auto difference = [](const auto& x, const auto& y) { return (x - y).cwiseAbs().maxCoeff(); };
  const auto close = [](double distance, double size) { return distance <= kRounding * (size + 1e-9); };
  return close(std::abs(a.mass - b.mass), a.mass) && close(difference(a.p_LC, b.p_LC), 1 + a.p_LC.norm()) &&
         close(difference(a.I_CC, b.I_CC), a.I_CC.norm());
}

int body_named(const RobotModel& robot, const std::string& name, const Members& members) {
  for (int body = -1; body < robot.body_count(); ++body) {
    if (name_of_body(robot, body) == name) return body;
  }
  members.fail("the robot has no body '" + name + "'");
}

void replay(const Json& json, const std::string& place, RobotModel& robot) {
  Members members(json, place);
  const std::string word = members.text("change");
  const auto kind = std::find_if(std::begin(kKinds), std::end(kKinds), [&](const auto& row) { return row.first == word; });
  if (kind == std::end(kKinds)) members.fail("'change' is '" + word + "', expected attach, detach or set_inertia");
  const std::string reason = members.text_or_none("reason");
  std::optional<double> time;
  if (members.find("time") != nullptr) time = members.number("time");
  const Inertia result = read_inertia(members.at("result"), place + ", result");
  const int body = body_named(robot, members.text("body"), members);
  if (kind->second == Change::Kind::kSetInertia) {
    set_inertia(robot, body, result, reason, time);
    return members.expect_no_others();
  }
  Attachment part;
  part.name = members.text("name");
  part.parent = members.text("parent");
  if (kind->second == Change::Kind::kDetach) {
    detach(robot, part.name, reason, time);
  } else {
    Members at(members.at("pose"), place + ", pose");
    part.X_PA = read_pose(at);
    at.expect_no_others();
    part.inertia = read_inertia(members.at("part"), place + ", part");
    if (members.find("frames") != nullptr) {
      for (const Json& frame : members.list("frames")) {
        Members further(frame, place + ", frames");
        const Pose X_AF = read_pose(further);
        part.further.push_back({further.text("name"), X_AF});
        further.expect_no_others();
      }
    }
    attach(robot, part, reason, time);
  }
  members.expect_no_others();
  const Change& change = robot.history.back();
  if (change.body != body || change.parent != part.parent)
    members.fail("'" + part.name + "' is on body '" + name_of_body(robot, change.body) + "' at '" + change.parent +
                 "', but the file names another body or parent");
  if (!agree(change.after, result))
    members.fail("'result' is not the inertia of body '" + name_of_body(robot, body) + "' after this change, which has " +
                 text::to_text(change.after.mass, 6) + " kg");
}

RobotHistory read_robot(const Json& json, const std::string& place) {
  Members members(json, place);
  RobotHistory history;
  history.name = members.text("name");
  history.source = members.text_or_none("source");
  if (members.find("components") != nullptr) {
    for (const Json& component : members.list("components")) {
      if (!component.is_string()) members.fail("'components' is no list of names");
      history.components.push_back(component.get<std::string>());
    }
  }
  UrdfOptions options;
  options.unphysical = Unphysical::kWarn;
  options.ignore_words = true;
  std::vector<std::string> warnings;
  history.robot = parse_urdf(members.text("urdf"), place + ", urdf", options, &warnings);
  const Json& changes = members.list("changes");
  members.expect_no_others();
  for (std::size_t i = 0; i < changes.size(); ++i) {
    const std::string at = place + ", change " + std::to_string(i + 1);
    try {
      replay(changes[i], at, history.robot);
    } catch (const Error& error) {
      const std::string what = error.what();
      throw what.rfind(place, 0) == 0 ? error : Error(at, what);
    }
  }
  return history;
}

}  // namespace

std::string to_json(std::span<const RobotHistory> histories) {
  Json file;
  file["cotwin_history"] = kVersion;
  file["robots"] = Json::array();
  for (const RobotHistory& history : histories) {
    Json robot;
    robot["name"] = history.name;
    if (!history.source.empty()) robot["source"] = history.source;
    if (!history.components.empty()) robot["components"] = history.components;
    robot["changes"] = Json::array();
    for (const Change& change : history.robot.history) robot["changes"].push_back(change_to_json(change, history.robot));
    robot["urdf"] = to_urdf(before(history.robot, 0));
    file["robots"].push_back(std::move(robot));
  }
  try {
    return file.dump(1) + "\n";
  } catch (const nlohmann::json::exception&) {
    throw Error("history", "a name or reason is no UTF-8 text");
  }
}

std::vector<RobotHistory> parse_history(std::string_view text, const std::string& place) {
  Json file;
  try {
    file = Json::parse(text);
  } catch (const nlohmann::json::exception& error) {
    throw Error(place, "is no JSON: " + text::reason_of(error));
  }
  Members members(file, place);
  const Json* version = members.find("cotwin_history");
  if (version == nullptr || !version->is_number_integer() || *version != kVersion)
    throw Error(place, "is no history file of version " + std::to_string(kVersion));
  const Json& robots = members.list("robots");
  members.expect_no_others();
  std::vector<RobotHistory> histories;
  for (std::size_t i = 0; i < robots.size(); ++i)
    histories.push_back(read_robot(robots[i], place + ", robot " + std::to_string(i + 1)));
  return histories;
}

}  // namespace cotwin::robot
