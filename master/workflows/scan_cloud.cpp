// From profiles to points, and from points to what was seen.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "components/unit/surroundings/surroundings.h"
#include "master/engine/wiring/members.h"
#include "master/workflows/clear_of.h"
#include "master/workflows/scan.h"
#include "models/cloud/sample.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"

namespace cotwin::master {

using Eigen::Vector3d;

struct ProfileTaker::Robots {
  const Variables* scanner = nullptr;
  std::span<double> posture;       // of the own robot
  std::vector<double> q, at_rest;  // posture after the last tick, at which a profile of this one is; zeros
  collision::Cell cell;
  std::vector<std::unique_ptr<surroundings::Robot>> all;

  /// Brings all to where they are: the own one to q.
  void place(const ScannerSite& site) {
    for (std::size_t r = 0; r < all.size(); ++r) {
      surroundings::Robot& robot = *all[r];
      const auto values = [&](const std::string& name) { return scanner->at(robot.prefix + name).reals(); };
      const auto pose = [&](const std::string& start) {
        return pose_of(site.name + "." + robot.base_prefix + "quat" + start,
                       {values("base_p" + start).begin(), values("base_p" + start).end()},
                       {values("base_quat" + start).begin(), values("base_quat" + start).end()});
      };
      robot.X_WB = pose(site.floating ? "" : "0");
      const bool own = static_cast<int>(r) == site.frame.robot;
      at_rest.assign(robot.q.size(), 0.0);
      robot.place(cell, own ? std::span<const double>(q) : std::span<const double>(values("q")), at_rest);
      for (std::size_t k = 0; k < robot.tools.size(); ++k)
        robot.tools_wanted[k] = values("tool." + text::identifier(robot.tools[k]))[0];
      for (std::size_t link = 0; link < robot.placed->shapes.size() && robot.is_in_cell(); ++link)
        (void)robot.show_tools(cell, link);
    }
  }
};

ProfileTaker::ProfileTaker(Master& master, const ScannerSite& site, const std::string& posture,
                           const std::optional<Pose>& mounting)
    : robots_(std::make_unique<Robots>()), site_(site), X_FS_(mounting.value_or(site.X_FS)) {
  const std::span<Member> members = master.members();
  Robots& r = *robots_;
  r.scanner = &std::ranges::find(members, site.name, &Member::name)->variables();
  const std::string name = posture.empty() ? site.name + "." + site.prefix + "q" : posture;
  r.posture = find_real_signal(members, name, "--posture").reals();
  const robot::RobotModel& robot = site.cell.robots[static_cast<std::size_t>(site.frame.robot)].model;
  if (std::ssize(r.posture) != robot.n())
    throw Error("--posture " + name, "has " + std::to_string(r.posture.size()) + " elements, expected " +
                                         std::to_string(robot.n()) + ", of the joints of " + robot.name);
  for (const scene::PlacedRobot& placed : site.cell.robots) {
    r.all.push_back(std::make_unique<surroundings::Robot>(placed));
    if (std::ranges::any_of(placed.shapes, [](const auto& shapes) { return !shapes.empty(); }))
      (void)r.all.back()->add_to(r.cell, site.floating);
  }
}

ProfileTaker::~ProfileTaker() = default;

void ProfileTaker::take() {
  Robots& r = *robots_;
  const auto count = static_cast<std::size_t>(r.scanner->at("count").integers()[0]);
  if (r.q.empty()) r.q.assign(r.posture.begin(), r.posture.end());
  if (count > profiles_) {
    profiles_ = count;
    r.place(site_);
    const surroundings::Robot& own = *r.all[static_cast<std::size_t>(site_.frame.robot)];
    const Pose X_WS =
        (site_.frame.body < 0 ? own.X_WB : own.X_WL[static_cast<std::size_t>(site_.frame.body)]) * site_.frame.X_BF * X_FS_;
    const auto ranges = r.scanner->at("ranges").reals();
    const double increment = r.scanner->at("angle_increment").reals()[0];
    std::vector<Vector3d> points;
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      const double angle = (static_cast<double>(i) - static_cast<double>(ranges.size() - 1) / 2) * increment;
      if (ranges[i] > 0) points.push_back(X_WS * Vector3d(ranges[i] * std::sin(angle), 0, ranges[i] * std::cos(angle)));
    }
    if (points.empty()) {
      ++empty_;
    } else {
      cloud::Cloud cloud = cloud::make_cloud(points);
      own_ += r.cell.drop_near(cloud, kOwn);
      for (std::size_t k = 0; k < cloud.points.size(); ++k) points_.push_back(cloud.point(k));
    }
  }
  std::ranges::copy(r.posture, r.q.begin());
}

ScanFigures judge_scan(std::shared_ptr<const cloud::Tree> tree, const scene::Scene& scene) {
  constexpr double kSamples = 2000;
  ScanFigures figures;
  figures.spacing = cloud::spacing(*tree);
  const double near = std::isfinite(figures.spacing.most) ? 2 * figures.spacing.most : 0;  // a single point shows nothing
  const std::array<scene::Shape, 1> ball{};                                                // of radius 0
  const collision::Body point(ball), points(tree, 0);
  std::vector<collision::Body> bodies;
  collision::Finder finder;
  finder.reserve(point);
  finder.reserve(points);
  for (const scene::Body& body : scene.bodies) {
    bodies.emplace_back(body.shapes);
    finder.reserve(bodies.back());
    ScanFigures::OfBody of_body{body.name, {}};
    if (const double area = cloud::area(body); area > 0) {
      std::vector<std::string> left_out;
      scene::Scene alone;
      alone.bodies.push_back(body);
      const cloud::Cloud samples = cloud::sample(alone, {.spacing = std::sqrt(area / kSamples)}, left_out);
      std::size_t seen = 0;
      for (std::size_t k = 0; k < samples.points.size(); ++k)
        seen += finder.find(point, {Eigen::Matrix3d::Identity(), samples.point(k)}, points, {}, near).d < scene::kInfinity;
      of_body.seen = static_cast<double>(seen) / static_cast<double>(samples.points.size());
    }
    figures.bodies.push_back(std::move(of_body));
  }
  if (bodies.empty()) return figures;
  double square = figures.largest = 0;
  const cloud::Cloud& cloud = tree->cloud();
  for (std::size_t k = 0; k < cloud.points.size(); ++k) {
    double least = scene::kInfinity;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      const double d =
          finder.find(bodies[b], scene.bodies[b].X_WB, point, {Eigen::Matrix3d::Identity(), cloud.point(k)}, least).d;
      least = std::min(least, std::abs(d));
    }
    square += least * least;
    figures.largest = std::max(figures.largest, least);
  }
  figures.rms = std::sqrt(square / static_cast<double>(cloud.points.size()));
  return figures;
}

}  // namespace cotwin::master
