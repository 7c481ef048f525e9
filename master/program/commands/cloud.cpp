// cotwin cloud: what is in a point cloud, and what can be made of it.
#include <cmath>
#include <iostream>
#include <memory>
#include <optional>

#include "components/unit/settings.h"
#include "components/unit/si.h"
#include "master/program/commands/commands.h"
#include "master/workflows/clear_of.h"
#include "models/cloud/cloud_file.h"
#include "models/cloud/sample.h"
#include "models/cloud/tree.h"
#include "models/collision/cell/cell.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/robot_links.h"
#include "models/scene/urdf/urdf_shapes.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

struct CloudArguments {
  fs::path file, out;
  std::string unit = "m", from, pose, without, base = "0 0 0";
  cloud::Sampling sampling;
  std::vector<double> at;
  std::optional<double> voxel;  // m
};

double metres(const std::string& unit) {
  const si::Measure measure = si::parse(unit);
  if (!si::convertible(measure, si::parse("m"))) throw Error("--unit", "'" + unit + "', expected a length such as mm");
  return measure.factor;
}

/// The cloud without the points that are on the hulls of a robot.
cloud::Cloud without_robot(cloud::Cloud cloud, const CloudArguments& a) {
  const fs::path file =
      Settings("cloud", "", {}, model_folders({})).robot_file(a.without, " (another robot: --without PATH.urdf)");
  std::vector<std::string> warnings;
  scene::PlacedRobot robot{"", robot::load_urdf(file, {}, &warnings), {}};
  robot.shapes = scene::hulls_of_urdf(file, robot.model, &warnings);
  for (const std::string& warning : warnings) std::cerr << "cotwin: warning: " << warning << '\n';
  const robot::RobotModel& model = robot.model;
  if (std::ssize(a.at) != model.n())
    throw Error("--at", std::to_string(a.at.size()) + " positions, expected " + std::to_string(model.n()) +
                            ", of the joints of " + model.name);
  for (const double q : a.at)
    if (!std::isfinite(q)) throw Error("--at", text::to_text(q) + ", expected finite positions");
  std::vector<Pose> X_WL(model.bodies.size());
  std::vector<Twist> V_WL(model.bodies.size());
  const Pose X_WB = read_base(a.base).second;
  scene::place_links(model, X_WB, a.at, std::vector<double>(a.at.size(), 0.0), X_WL, V_WL);
  collision::Cell cell;
  if (const std::string bare = cell.add(robot, false); !bare.empty()) std::cerr << "cotwin: warning: " << bare << '\n';
  cell.place(0, X_WB, X_WL);

  const std::size_t own = cell.drop_near(cloud, kOwn);
  std::cout << "robot    " << own << " points within " << text::to_text(kOwn) << " m of the hulls of " << model.name
            << " dropped\n";
  if (cloud.points.empty()) throw Error(a.file.string(), "all of its points are points of the robot");
  return cloud;
}

void tell(const cloud::Cloud& cloud) {
  const cloud::Tree tree(cloud);
  const cloud::Tree::Node box = tree.node(0);
  std::cout << "points   " << cloud.points.size() << "\nbox     ";
  const auto rounded = [](double x) { return text::to_text(std::abs(x) < 1e-9 ? 0 : x, 6); };
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double middle = cloud.origin[i] + box.middle[i];
    std::cout << ' ' << "xyz"[i] << ' ' << rounded(middle - box.half[i]) << " to " << rounded(middle + box.half[i])
              << (i < 2 ? "," : " m\n");
  }
  if (cloud.points.size() == 1) return;
  const cloud::Spacing spacing = cloud::spacing(tree);
  std::cout << "spacing  median " << text::to_text(spacing.median, 3) << ", 95 % up to " << text::to_text(spacing.most, 3)
            << ", largest " << text::to_text(spacing.largest, 3) << " m: with " << text::to_text(spacing.most / 2, 3)
            << " m the balls of 95 % of the points touch the next one\n";
}

cloud::Cloud read(const CloudArguments& a) {
  cloud::CloudFile file = cloud::load_cloud(a.file, metres(a.unit));
  std::cout << "read     " << file.cloud.points.size()
            << " points; dropped: " << text::counted(static_cast<std::int64_t>(file.doubles), "double") << ", "
            << file.not_finite << " without finite coordinates";
  if (!file.passed_over.empty()) std::cout << "; passed over: " << text::joined(file.passed_over);
  std::cout << '\n';
  for (const std::string& remark : file.remarks) std::cerr << "cotwin: warning: " << a.file.string() << ": " << remark << '\n';
  return std::move(file.cloud);
}

cloud::Cloud sampled(const CloudArguments& a) {
  if (!(a.sampling.spacing > 0) || !(a.sampling.sigma >= 0)) throw Error("--spacing", "and --sigma, expected lengths in m");
  std::vector<std::string> notes, left_out;
  const collision::PlacedCell around = cell_of({a.from}, notes);
  if (!around.clouds.empty())
    throw Error("--from " + a.from, "is a point cloud, expected a scene, or the cloud without --from");
  scene::Scene scene;
  for (const collision::PlacedCell::Body& one : around.bodies) scene.bodies.push_back(one.body);
  cloud::Cloud cloud = cloud::sample(scene, a.sampling, left_out);
  if (!left_out.empty()) notes.push_back("without planes: " + text::joined(left_out));
  for (const std::string& note : notes) std::cerr << "cotwin: warning: " << note << '\n';
  if (cloud.points.empty())
    throw Error(a.from, "has no surface of " + text::to_text(a.sampling.spacing) + " m by as much, so no points");
  return cloud;
}

int run_cloud(const CloudArguments& a) {
  if (a.without.empty() != a.at.empty()) throw Error("--without", "and --at, expected both or none");
  if (a.voxel && !(*a.voxel >= 1e-6 && *a.voxel <= 1e6))
    throw Error("--voxel", text::to_text(*a.voxel) + ", expected 1e-6 to 1e6 m");
  if (!a.out.empty()) (void)cloud::format_of(a.out);  // before the work
  if (a.file.empty() == a.from.empty()) throw Error("FILE", "and --from, expected one of the two");
  cloud::Cloud cloud = a.from.empty() ? read(a) : sampled(a);
  if (!a.pose.empty()) cloud = cloud::moved(cloud, read_base(a.pose, "--pose").second);
  if (!a.without.empty()) cloud = without_robot(std::move(cloud), a);
  if (a.voxel) cloud = cloud::thinned(cloud, *a.voxel);
  tell(cloud);
  if (!a.out.empty()) {
    AtomicFile file(a.out);
    cloud::write_cloud(file.stream(), cloud, cloud::format_of(a.out));
    file.commit();
    std::cout << "written  " << a.out.string() << ", in m\n";
  }
  return kExitDone;
}

}  // namespace

void add_cloud(CLI::App& app, Chosen& chosen) {
  const auto all = std::make_shared<CloudArguments>();
  CLI::App* command =
      app.add_subcommand("cloud", "Tell what is in a point cloud, and convert, move and thin it for unit:monitor");
  command->add_option("FILE", all->file, "Points: PCD, PLY, or text with x, y, z (.xyz, .csv, .txt, .asc, .pts)")
      ->type_name("FILE");
  command
      ->add_option("--from", all->from, "In place of FILE: points on the bodies of this scene (SDF file, or name of a scene)")
      ->type_name("SCENE");
  command->add_option("--spacing", all->sampling.spacing, "One of them for each square of this edge, m")
      ->type_name("M")
      ->capture_default_str();
  command->add_option("--sigma", all->sampling.sigma, "Their standard deviation along the normal, m")
      ->type_name("M")
      ->capture_default_str();
  command->add_option("--seed", all->sampling.seed, "Of the deviation; equal seeds give equal bits")
      ->type_name("N")
      ->capture_default_str();
  command->add_option("-o,--out", all->out, "Write the points in m, in the format of the ending (.pcd, .ply, .xyz …)")
      ->type_name("FILE");
  command->add_option("--unit", all->unit, "Unit of the coordinates in FILE, such as mm")
      ->type_name("UNIT")
      ->capture_default_str();
  command->add_option("--pose", all->pose, "Where the frame of the points is in W, m and rad: moves them there")
      ->type_name("'X Y Z [ROLL PITCH YAW]'");
  command->add_option("--voxel", all->voxel, "Leave one point, the mean, for each cube of this size, m")->type_name("SIZE");
  command
      ->add_option("--without", all->without,
                   "Drop the points of this robot (URDF, or name of a robot), which was scanned, too")
      ->type_name("ROBOT");
  command->add_option("--at", all->at, "Positions of its joints meanwhile, rad or m")->delimiter(',')->type_name("Q1,Q2,…");
  command->add_option("--base", all->base, "Where it stands in W, m and rad")
      ->type_name("'X Y Z [ROLL PITCH YAW]'")
      ->capture_default_str();
  command->callback([all, &chosen] { chosen = [all] { return run_cloud(*all); }; });
}

}  // namespace cotwin::master
