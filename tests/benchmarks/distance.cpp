// Distances of bodies and clouds, in processor time of the thread, beside FCL (Pan, Chitta, Manocha, ICRA 2012; libfcl-dev). Both are given the same
// shapes at the same poses, and must agree to 1e-6 m; FCL has clouds as the voxels of an octree (OctoMap), and must agree to their diagonal.
#include <fcl/broadphase/broadphase_dynamic_AABB_tree.h>
#include <fcl/broadphase/default_broadphase_callbacks.h>
#include <fcl/geometry/octree/octree.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/convex.h>
#include <fcl/narrowphase/distance.h>

#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "models/cloud/tree.h"
#include "models/collision/body.h"
#include "models/scene/hull.h"
#include "tests/benchmarks/measure.h"

namespace {

using namespace cotwin;
using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;

class Random {
 public:
  double real(double low, double high) { return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53; }
  Vector3d vector(double most) { return {real(-most, most), real(-most, most), real(-most, most)}; }
  Pose pose(double most) {
    return {Eigen::Quaterniond(real(-1, 1), real(-1, 1), real(-1, 1), real(-1, 1)).normalized().toRotationMatrix(),
            vector(most)};
  }

 private:
  std::mt19937_64 engine_{1};
};

Shape capsule(Random& random) {
  Shape shape;
  shape.type = ShapeType::kCapsule;
  shape.size = {random.real(0.03, 0.1), random.real(0.1, 0.5), 0};
  return shape;
}

/// 30 corners on an ellipsoid.
Shape hull(Random& random) {
  Shape shape;
  shape.type = ShapeType::kHull;
  for (int k = 0; k < 30; ++k) shape.vertices.push_back(random.vector(1).normalized().cwiseProduct(Vector3d(0.1, 0.15, 0.25)));
  return shape;
}

fcl::Transform3d transform(const Pose& X) {
  fcl::Transform3d T = fcl::Transform3d::Identity();
  T.linear() = X.R;
  T.translation() = X.p;
  return T;
}

std::shared_ptr<fcl::CollisionGeometryd> to_fcl(const Shape& shape) {
  if (shape.type == ShapeType::kCapsule) return std::make_shared<fcl::Capsuled>(shape.size.x(), shape.size.y());
  const scene::Polytope polytope = scene::convex_hull(shape.vertices);
  const auto faces = std::make_shared<std::vector<int>>();
  for (const scene::Polytope::Face& face : polytope.faces) {
    faces->push_back(static_cast<int>(face.count));
    for (std::uint32_t k = 0; k < face.count; ++k) faces->push_back(static_cast<int>(polytope.corners[face.begin + k]));
  }
  return std::make_shared<fcl::Convexd>(std::make_shared<const std::vector<fcl::Vector3d>>(polytope.vertices),
                                        static_cast<int>(polytope.faces.size()), faces);
}

fcl::DistanceRequestd request() {
  fcl::DistanceRequestd request(true);
  request.gjk_solver_type = fcl::GST_LIBCCD;
  request.distance_tolerance = 1e-8;
  return request;
}

void expect_equal(const char* what, double ours, double peer, double tolerance = 1e-6) {
  if (std::abs(ours - peer) <= tolerance) return;
  std::fprintf(stderr, "%s: %.9g m, FCL %.9g m\n", what, ours, peer);
  std::exit(1);
}

/// The least distance of 8 links that move from 20 hulls that stand still.
void tick() {
  constexpr int kLinks = 8, kHulls = 20;
  Random random;
  std::vector<std::unique_ptr<collision::Body>> links, hulls;
  std::vector<Pose> X_links, X_hulls;
  fcl::DynamicAABBTreeCollisionManagerd of_links, of_hulls;
  std::vector<std::unique_ptr<fcl::CollisionObjectd>> objects;
  collision::Finder finder;
  const auto add = [&](auto& solids, auto& poses, auto& manager, const Shape& shape, const Pose& X) {
    solids.push_back(std::make_unique<collision::Body>(std::span(&shape, 1)));
    finder.reserve(*solids.back());
    poses.push_back(X);
    objects.push_back(std::make_unique<fcl::CollisionObjectd>(to_fcl(shape), transform(X)));
    manager.registerObject(objects.back().get());
  };
  for (int k = 0; k < kLinks; ++k) add(links, X_links, of_links, k % 2 == 0 ? capsule(random) : hull(random), random.pose(0.5));
  for (int k = 0; k < kHulls; ++k) {
    Pose X = random.pose(0.6);
    X.p += X.p.normalized() * 1.2;
    add(hulls, X_hulls, of_hulls, hull(random), X);
  }
  of_links.setup();
  of_hulls.setup();
  int step = 0, peer_step = 0;
  const auto shift = [](int n) { return Vector3d(1e-3 * std::sin(0.1 * n), 0, 0); };
  const auto ours = [&] {
    const Vector3d by = shift(step++);
    double least = scene::kInfinity;
    for (int i = 0; i < kLinks; ++i) {
      Pose X = X_links[static_cast<std::size_t>(i)];
      X.p += by;
      for (int k = 0; k < kHulls; ++k) {
        const collision::Distance found =
            finder.find(*links[static_cast<std::size_t>(i)], X, *hulls[static_cast<std::size_t>(k)],
                        X_hulls[static_cast<std::size_t>(k)], least);
        least = std::min(least, found.d);
      }
    }
    return least;
  };
  const auto peer = [&] {
    const Vector3d by = shift(peer_step++);
    for (int i = 0; i < kLinks; ++i) {
      Pose X = X_links[static_cast<std::size_t>(i)];
      X.p += by;
      objects[static_cast<std::size_t>(i)]->setTransform(transform(X));
      objects[static_cast<std::size_t>(i)]->computeAABB();
    }
    of_links.update();
    fcl::DefaultDistanceData<double> data;
    data.request = request();
    of_links.distance(&of_hulls, &data, fcl::DefaultDistanceFunction);
    return data.result.min_distance;
  };
  expect_equal("8 links x 20 hulls", ours(), peer());
  const benchmark::Figures f = benchmark::measure([&] { benchmark::keep(ours()); }, [&] { benchmark::keep(peer()); }, 31, 2e-3,
                                                  benchmark::thread_seconds);
  benchmark::print(
      {"least distance of 8 links from 20 hulls", "us", 1e6 * f.ours, "FCL, dynamic AABB trees", 1e6 * f.peer, 100, false});
}

/// A floor, walls, a table and a ball, as a scanner sees them.
std::vector<Vector3d> cell(std::size_t n, Random& random) {
  std::vector<Vector3d> points;
  while (points.size() < n) {
    const double u = random.real(-1, 1), v = random.real(-1, 1), noise = random.real(-1e-3, 1e-3);
    const std::size_t k = points.size() % 5;
    points.push_back(k == 0   ? Vector3d(2 * u, 2 * v, noise - 0.7)
                     : k == 1 ? Vector3d(2 + noise, 2 * u, 0.65 + 1.35 * v)
                     : k == 2 ? Vector3d(2 * u, 2 + noise, 0.65 + 1.35 * v)
                     : k == 3 ? Vector3d(0.8 + 0.4 * u, 0.6 * v, noise)
                              : Vector3d(-0.8, 0.3, 0.2) + 0.3 * random.vector(1).normalized());
  }
  return points;
}

/// The least distance of 8 capsules that move, with bounds by the one that was the nearest, from a million points.
void cloud_tick() {
  constexpr std::size_t kLinks = 8;
  constexpr double kVoxel = 0.01;  // m
  Random random;
  const std::vector<Vector3d> points = cell(benchmark::shortened<std::size_t>(1'000'000, 20'000), random);
  std::shared_ptr<const cloud::Tree> tree;
  std::shared_ptr<octomap::OcTree> voxels;
  const benchmark::Figures made = benchmark::measure(
      [&] { tree = std::make_shared<const cloud::Tree>(cloud::make_cloud(points)); },
      [&] {
        voxels = std::make_shared<octomap::OcTree>(kVoxel);
        for (const Vector3d& p : points)
          voxels->updateNode(octomap::point3d(p.cast<float>().x(), p.cast<float>().y(), p.cast<float>().z()), true, true);
        voxels->updateInnerOccupancy();
      },
      3, 0, benchmark::thread_seconds);
  benchmark::print(
      {"a cloud of 1e6 points in its tree", "ms", 1e3 * made.ours, "OctoMap, voxels of 1 cm", 1e3 * made.peer, 1200, false});

  const collision::Body cloud(tree, 0);
  fcl::CollisionObjectd of_cloud(std::make_shared<fcl::OcTreed>(std::shared_ptr<const octomap::OcTree>(voxels)));
  collision::Finder finder;
  finder.reserve(cloud);
  std::vector<collision::Body> links;
  std::vector<std::unique_ptr<fcl::CollisionObjectd>> objects;
  for (std::size_t k = 0; k < kLinks; ++k) {
    Shape shape = capsule(random);
    shape.size = {0.07, 0.3, 0};
    links.emplace_back(std::span(&shape, 1));
    objects.push_back(std::make_unique<fcl::CollisionObjectd>(to_fcl(shape)));
  }
  const auto pose = [](std::size_t k, int n) {
    const double a = 0.002 * n, reach = 0.1 * static_cast<double>(k);
    return Pose{Eigen::AngleAxisd(a + static_cast<double>(k), Vector3d(1, 2, 3).normalized()).toRotationMatrix(),
                {reach * std::cos(a), reach * std::sin(a), 0.45 + 0.5 * reach * std::sin(3 * a)}};
  };
  int step = 0, peer_step = 0;
  std::size_t nearest = 0;
  const auto ours = [&] {
    double least = scene::kInfinity;
    const std::size_t first = nearest;
    for (std::size_t i = 0; i < kLinks; ++i) {
      const std::size_t k = i == 0 ? first : i <= first ? i - 1 : i;
      const double d = finder.find(links[k], pose(k, step), cloud, {}, least).d;
      if (d < least) least = d, nearest = k;
    }
    ++step;
    return least;
  };
  const auto peer = [&] {
    double least = scene::kInfinity;
    for (std::size_t k = 0; k < kLinks; ++k) {
      objects[k]->setTransform(transform(pose(k, peer_step)));
      fcl::DistanceResultd result;
      fcl::DistanceRequestd with;
      result.min_distance = least;
      fcl::distance(objects[k].get(), &of_cloud, with, result);
      least = std::min(least, result.min_distance);
    }
    ++peer_step;
    return least;
  };
  expect_equal("8 capsules x 1e6 points", ours(), peer(), kVoxel * std::sqrt(3.0));
  const benchmark::Figures f = benchmark::measure([&] { benchmark::keep(ours()); }, [&] { benchmark::keep(peer()); }, 31, 2e-3,
                                                  benchmark::thread_seconds);
  benchmark::print({"least distance of 8 capsules from 1e6 points", "us", 1e6 * f.ours, "FCL, octree with voxels of 1 cm",
                    1e6 * f.peer, 150, false});
}

}  // namespace

int main() {
  tick();
  cloud_tick();
}
