#include "models/robot/urdf/units.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "models/foundation/support/text.h"
#include "models/robot/urdf/estimate.h"

namespace cotwin::robot {

namespace {

constexpr double kDegree = M_PI / 180;
constexpr double kPound = 0.45359237, kInch = 0.0254;

struct Quantity {
  const char* name;
  double UrdfUnits::*factor;
  std::vector<std::pair<const char*, double>> units;
};

const std::vector<Quantity>& quantities() {
  static const std::vector<Quantity> all = {
      {"length", &UrdfUnits::length, {{"m", 1}, {"cm", 1e-2}, {"mm", 1e-3}, {"in", kInch}}},
      {"mass", &UrdfUnits::mass, {{"kg", 1}, {"g", 1e-3}, {"lb", kPound}}},
      {"inertia",
       &UrdfUnits::inertia,
       {{"kg.m2", 1}, {"kg.cm2", 1e-4}, {"kg.mm2", 1e-6}, {"g.m2", 1e-3}, {"g.cm2", 1e-7}, {"g.mm2", 1e-9}}},
      {"limit", &UrdfUnits::limit, {{"rad", 1}, {"deg", kDegree}}},
      {"speed", &UrdfUnits::speed, {{"rad/s", 1}, {"deg/s", kDegree}, {"rpm", M_PI / 30}}},
      {"rpy", &UrdfUnits::rpy, {{"rad", 1}, {"deg", kDegree}}}};
  return all;
}

/// The length of which the reach is that of a robot: 5 cm to 10 m.
std::string plausible_length(double reach) { return reach * 1e-3 >= 0.15 ? "mm" : reach * 1e-2 <= 10 ? "cm" : "mm"; }

/// The unit in which the radius of gyration of most links is that of a robot with this reach; nothing if it is as it is.
std::optional<UnitSuspicion> suspect_inertia(const RobotModel& robot, double reach) {
  constexpr double kLargest = 5, kReaches = 5, kUsual = 0.15;  // m, reaches, of the reach
  std::vector<double> radii;
  for (const Body& body : robot.bodies) {
    const Inertia& inertia = body.inertia;
    const double trace = inertia.I_CC.trace();
    if (inertia.mass > 0 && trace > 0) radii.push_back(std::sqrt(trace / (2 * inertia.mass)));
  }
  if (radii.empty()) return std::nullopt;
  const auto middle = radii.begin() + static_cast<std::ptrdiff_t>(radii.size() / 2);
  std::ranges::nth_element(radii, middle);
  if (*middle <= std::max(kLargest, kReaches * reach)) return std::nullopt;
  const auto& units =
      std::ranges::find(quantities(), "inertia", [](const Quantity& q) { return std::string_view(q.name); })->units;
  const auto best = std::ranges::min_element(units, {}, [&](const auto& unit) {
    return std::abs(std::log(std::sqrt(unit.second) * *middle / (kUsual * std::max(reach, 0.1))));
  });
  return UnitSuspicion{"half of its links have a radius of gyration of " + text::to_text(*middle, 3) + " m and more",
                       std::string("inertia=") + best->first};
}

}  // namespace

UrdfUnits parse_urdf_units(const std::string& text, const std::string& place) {
  UrdfUnits units{.text = text};
  if (text == "si") {
    for (const Quantity& q : quantities()) units.named.insert(q.name);
    return units;
  }
  bool inertia_given = false;
  for (const std::string_view entry : text::split(text, ',')) {
    const std::size_t equals = entry.find('=');
    const std::string name(text::trim(entry.substr(0, equals)));
    const std::string unit(equals == std::string_view::npos ? "" : text::trim(entry.substr(equals + 1)));
    std::vector<std::string> names;
    for (const Quantity& q : quantities()) names.emplace_back(q.name);
    const auto quantity = std::ranges::find(quantities(), name, [](const Quantity& q) { return std::string(q.name); });
    if (quantity == quantities().end()) {
      throw Error(place, "'" + std::string(text::trim(entry)) + "', expected si, or quantities with their units as in " +
                             "length=mm,mass=g; quantities: " + text::joined(names));
    }
    std::vector<std::string> known;
    for (const auto& [word, factor] : quantity->units) known.emplace_back(word);
    const auto found = std::ranges::find(known, unit);
    if (found == known.end())
      throw Error(place, "'" + std::string(text::trim(entry)) + "', expected one of the units " + text::joined(known));
    units.*quantity->factor = quantity->units[static_cast<std::size_t>(found - known.begin())].second;
    inertia_given = inertia_given || name == "inertia";
    units.named.insert(name);
  }
  if (!inertia_given) units.inertia = units.mass * units.length * units.length;
  return units;
}

bool is_si_unit(std::string_view word) {
  // Lower case without signs of products and powers; a lower-case n would be nano.
  constexpr std::array kWords = {"",       "si",  "kg",     "kilogram", "kilograms", "m",      "meter", "meters", "metre",
                                 "metres", "rad", "radian", "radians",  "n",         "nm",     "rad/s", "m/s",    "kgm2",
                                 "kgm²",   "n/m", "ns/m",   "nm/rad",   "nms/rad",   "rad/s2", "m/s2"};
  std::string plain;
  for (const char c : text::trim(word))
    if (std::string_view(" .*^").find(c) == std::string_view::npos)
      plain += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  constexpr std::string_view kDot = "·";
  for (std::size_t at = plain.find(kDot); at != std::string::npos; at = plain.find(kDot)) plain.erase(at, kDot.size());
  return std::ranges::find(kWords, plain) != kWords.end() && !text::trim(word).starts_with('n');
}

bool is_si(const UrdfUnits& units, const std::string& quantity) {
  const auto found = std::ranges::find(quantities(), quantity, [](const Quantity& q) { return std::string(q.name); });
  return found == quantities().end() || units.*found->factor == 1;
}

std::vector<UnitSuspicion> suspect_units(const RobotModel& robot) {
  constexpr double kReach = 20, kMass = 100, kDensity = 2500;  // m, kg, kg/m³
  constexpr double kNoTravel = 1e4;                            // m, and more: no limit
  constexpr double kLimit = 20, kSpeed = 30, kDegrees = 1100;  // rad, rad/s; three turns in degrees
  const auto number = [](double x) { return text::to_text(x, 3); };
  std::vector<UnitSuspicion> found;
  double reach = reach_of(robot);
  std::string farthest;
  if (robot.body_count() == 0) {  // a tool
    reach = robot.base.inertia.p_LC.norm();
    for (const Frame& frame : robot.frames) reach = std::max(reach, frame.X_BF.p.norm());
  }
  if (reach > kReach) {
    double step = 0;
    for (int body = 0; body < robot.body_count(); ++body) {
      const Joint& joint = robot.joint_of(body);
      if (joint.parent < 0 || joint.X_PJ.p.norm() <= step) continue;
      step = joint.X_PJ.p.norm();
      farthest = "; joint '" + joint.name + "' is " + number(step) + " m from the one before";
    }
    found.push_back({(robot.body_count() == 0 ? "it reaches " : "the robot reaches ") + number(reach) + " m" + farthest,
                     "length=" + (robot.body_count() == 0 ? "mm" : plausible_length(reach))});
  }
  const double to_m = reach <= kReach ? 1 : plausible_length(reach) == "mm" ? 1e-3 : 1e-2;
  for (int body = 0; body < robot.body_count(); ++body) {
    const Joint& slide = robot.joint_of(body);
    const double most = to_m * std::max(std::abs(slide.q_min), std::abs(slide.q_max));
    // Slides of links without a mass are those of a vehicle.
    const bool has_mass = robot.bodies[static_cast<std::size_t>(body)].inertia.mass > 0;
    if (slide.type != JointType::kPrismatic || !has_mass || !(most > kReach && most < kNoTravel)) continue;
    found.push_back({"the limits of slide '" + slide.name + "' are " + number(to_m * slide.q_min) + " and " +
                         number(to_m * slide.q_max) + " m",
                     "length=m"});
    break;
  }
  double mass = 0, travel = 0;
  for (const Body& body : robot.bodies) mass += body.inertia.mass;
  for (const Joint& joint : robot.joints)
    if (joint.type == JointType::kPrismatic && std::isfinite(joint.q_max - joint.q_min)) travel += joint.q_max - joint.q_min;
  const double length = to_m * (reach + travel);
  if (reach <= kReach) {  // inertia follows other units of length
    if (const auto inertia = suspect_inertia(robot, reach)) found.push_back(*inertia);
  }
  if (mass > kMass && length > 0 && mass > kDensity * length * length * length)
    found.push_back({"its moving links weigh " + number(mass) + " kg with a reach of " + number(length) + " m", "mass=g"});
  const Joint* far = nullptr;
  int limited = 0, in_degrees = 0, fast = 0;
  for (const Joint& joint : robot.joints) {
    if (joint.type != JointType::kRevolute || !std::isfinite(joint.q_max - joint.q_min)) continue;
    ++limited;
    const double most = std::max(std::abs(joint.q_min), std::abs(joint.q_max));
    if (joint.dq_max > kSpeed && joint.dq_max < kDegrees) ++fast;
    if (!(most > kLimit && most < kDegrees)) continue;
    ++in_degrees;
    if (far == nullptr) far = &joint;
  }
  const bool speeds = 2 * fast >= limited;
  const auto is_round = [](double x) { return 2 * x == std::nearbyint(2 * x); };  // as degrees are; drums have multiples of 2 π
  if (far != nullptr &&
      ((2 * in_degrees >= limited && (in_degrees > 1 || speeds)) || (is_round(far->q_min) && is_round(far->q_max)))) {
    const bool all = in_degrees == limited || (2 * in_degrees >= limited && (in_degrees > 1 || speeds));
    found.push_back({"the limits of joint '" + far->name + "' are " + number(far->q_min) + " and " + number(far->q_max) +
                         " rad, " + number((far->q_max - far->q_min) / (2 * M_PI)) + " turns",
                     !all     ? "limit=rad"
                     : speeds ? "limit=deg,speed=deg/s"
                              : "limit=deg"});
  }
  return found;
}

OtherUnits other_units(const std::string& place, const std::vector<UnitSuspicion>& found) {
  std::string what, units;
  bool cures = false;
  for (const UnitSuspicion& suspicion : found) {
    text::append(what, suspicion.what, "; ");
    text::append(units, suspicion.units, ",");
    const UrdfUnits other = parse_urdf_units(suspicion.units, place);
    cures = cures || std::ranges::any_of(other.named, [&](const std::string& name) { return !is_si(other, name); });
  }
  if (!cures)
    return {place + ": " + what + ", expected SI: correct it, or take it as it is with cotwin new --urdf-units " + units, ""};
  return {place + ": " + what + ". Not in SI? cotwin new --urdf-units " + units +
              " reads it so and writes it in SI (robot.urdf); --urdf-units si takes it as it is",
          units};
}

}  // namespace cotwin::robot
