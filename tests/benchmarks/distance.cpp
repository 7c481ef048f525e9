// Distances of shapes and bodies, in processor time of the thread, beside FCL (Pan, Chitta, Manocha, ICRA 2012; libfcl-dev). Both are given the same
// shapes at the same poses, and must agree to 1e-6 m.
#include <fcl/broadphase/broadphase_dynamic_AABB_tree.h>
#include <fcl/broadphase/default_broadphase_callbacks.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/convex.h>
#include <fcl/narrowphase/distance.h>

#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "models/collision/body.h"
#include "models/scene/hull.h"
#include "tests/benchmarks/measure.h"

namespace {

using namespace cotwin;
using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;

constexpr std::size_t kPairs = 256;

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

void expect_equal(const char* what, double ours, double peer) {
  if (std::abs(ours - peer) <= 1e-6) return;
  std::fprintf(stderr, "%s: %.9g m, FCL %.9g m\n", what, ours, peer);
  std::exit(1);
}

/// A call measures one pair of separated shapes.
template <class Make>
void pairs(const char* name, const Make& make, double ratio) {
  struct Pair {
    collision::Convex a, b;
    Pose X_a, X_b;
    std::unique_ptr<fcl::CollisionObjectd> fcl_a, fcl_b;
  };
  Random random;
  std::vector<Pair> all;
  collision::Feature scratch;
  const auto ours = [&](const Pair& p) {
    return collision::distance({&p.a, p.X_a.R, p.X_a.p}, {&p.b, p.X_b.R, p.X_b.p}, scratch).d;
  };
  const auto peer = [&](const Pair& p) {
    fcl::DistanceResultd result;
    return fcl::distance(p.fcl_a.get(), p.fcl_b.get(), request(), result);
  };
  while (all.size() < kPairs) {
    const Shape a = make(random), b = make(random);
    Pair pair{collision::make_convex(a), collision::make_convex(b), random.pose(0.4), random.pose(0.4), {}, {}};
    pair.fcl_a = std::make_unique<fcl::CollisionObjectd>(to_fcl(a), transform(pair.X_a));
    pair.fcl_b = std::make_unique<fcl::CollisionObjectd>(to_fcl(b), transform(pair.X_b));
    // The frame of our shape is in its middle.
    pair.X_a = pair.X_a * pair.a.X_BC;
    pair.X_b = pair.X_b * pair.b.X_BC;
    if (ours(pair) < 0.01) continue;
    expect_equal(name, ours(pair), peer(pair));
    all.push_back(std::move(pair));
  }
  std::size_t i = 0, k = 0;
  const benchmark::Figures f =
      benchmark::measure([&] { benchmark::keep(ours(all[i++ % kPairs])); }, [&] { benchmark::keep(peer(all[k++ % kPairs])); },
                         31, 2e-3, benchmark::thread_seconds);
  benchmark::print({name, "ns", 1e9 * f.ours, "FCL", 1e9 * f.peer, ratio, true});
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

}  // namespace

int main() {
  pairs("two capsules", capsule, 1);
  pairs("two hulls of 30 corners", hull, 2);
  tick();
}
