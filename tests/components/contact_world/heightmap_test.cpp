// Heightmaps of SDF as ground.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "models/scene/sdf/sdf.h"
#include "tests/support/files.h"
#include "tests/support/png.h"

namespace cotwin::contact_world {
namespace {

using cotwin::testing::grey_png;
using cotwin::testing::TemporaryFolder;
using Eigen::Vector3d;

constexpr double kGravity = 9.81;  // m/s²

std::string friction(double mu) {
  return "<surface><friction><ode><mu>" + std::to_string(mu) + "</mu></ode></friction></surface>";
}
std::string ground(const std::string& geometry, double mu = 0.5) {
  return "<model name='ground'><static>true</static><link name='l'><collision name='c'><geometry>" + geometry + "</geometry>" +
         friction(mu) + "</collision></link></model>";
}
std::string heightmap(const std::string& size, const std::string& pos = "0 0 0") {
  return "<heightmap><uri>h.png</uri><size>" + size + "</size><pos>" + pos + "</pos></heightmap>";
}
std::string text_of(const Vector3d& v) {
  return std::to_string(v.x()) + " " + std::to_string(v.y()) + " " + std::to_string(v.z());
}
std::string body(const std::string& pose, const std::string& geometry, double mu = 0.5, const std::string& velocity = "") {
  return "<model name='body' xmlns:cotwin='urn:cotwin:scene:1'><pose>" + pose +
         "</pose><link name='l'><inertial auto='true'/>" + velocity + "<collision name='c'><geometry>" + geometry +
         "</geometry>" + friction(mu) + "</collision></link></model>";
}
scene::Scene read(const TemporaryFolder& folder, const std::string& models) {
  return scene::parse_sdf("<sdf version='1.10'><world name='w'><gravity>0 0 -9.81</gravity>" + models + "</world></sdf>",
                          folder.path() / "test.sdf");
}
void run(World& world, double time, double h = 1e-3) {
  for (int k = 0; k < static_cast<int>(std::lround(time / h)); ++k) world.step(h);
}

// The map of c (i² + j²) is convex and has plane cells, so that a ball on its axis rests on the highest of their planes:
// z = r √(1 + s² (a² + b²)) − c (i (i + 1) + j (j + 1)) with slopes s a, s b for a = 2 i + 1, b = 2 j + 1 and s = c / cell.
TEST(Heightmaps, ABallRestsInABowlAtTheHeightOfItsTangentPlanes) {
  const TemporaryFolder folder("heightmaps");
  constexpr int kHalf = 8;
  constexpr double kCell = 0.1, kRise = 0.01;
  folder.write("h.png", grey_png(2 * kHalf + 1, 2 * kHalf + 1,
                                 [](int x, int y) { return 500 * ((x - kHalf) * (x - kHalf) + (y - kHalf) * (y - kHalf)); }));
  const Vector3d middle(3, -2, 0.5);
  for (const double radius : {0.05, 0.2, 0.45}) {
    double height = 0;
    for (int i = 0; i < kHalf; ++i) {
      for (int j = 0; j < kHalf; ++j) {
        const double a = kRise / kCell * (2 * i + 1), b = kRise / kCell * (2 * j + 1);
        height = std::max(height, radius * std::sqrt(1 + a * a + b * b) - kRise * (i * (i + 1) + j * (j + 1)));
      }
    }
    World w(read(folder, ground(heightmap("1.6 1.6 1.28", text_of(middle))) +
                             body(text_of(middle + Vector3d(0, 0, height + 0.01)) + " 0 0 0",
                                  "<sphere><radius>" + std::to_string(radius) + "</radius></sphere>")),
            {});
    run(w, 1);
    EXPECT_NEAR(w.poses()[1].p.z(), middle.z() + height, 5e-5) << radius;
    EXPECT_LT((w.poses()[1].p - middle).head<2>().norm(), 1e-3) << radius;
    EXPECT_LT(w.twists()[1].head<3>().norm(), 1e-2) << radius;
  }
}

TEST(Heightmaps, ABallThatIsLetGoOnTheSideOfABowlStaysInIt) {
  const TemporaryFolder folder("heightmaps");
  constexpr int kHalf = 16;
  folder.write("h.png",
               grey_png(33, 33, [](int x, int y) { return 100 * ((x - kHalf) * (x - kHalf) + (y - kHalf) * (y - kHalf)); }));
  World w(read(folder, ground(heightmap("1.6 1.6 1.28")) + body("0.4 0.2 0.35 0 0 0", "<sphere><radius>0.1</radius></sphere>")),
          {});
  const double start = w.poses()[1].p.z();
  for (int k = 0; k < 3000; ++k) {
    w.step(1e-3);
    const Vector3d p = w.poses()[1].p;
    ASSERT_LT(p.z(), start + 1e-6) << k;
    // of the paraboloid z = x² + y², whose chords are above it
    ASSERT_GT(p.z() - p.head<2>().squaredNorm(), 0.1 - 1e-3) << k;
  }
}

TEST(Heightmaps, ABoxOnASlopeSlidesOrHoldsByItsFriction) {
  const TemporaryFolder folder("heightmaps");
  folder.write("h.png", grey_png(17, 17, [](int x, int) { return 4000 * x; }));
  const double slope = std::atan(0.6 / 2);  // up along x
  const Vector3d n(-std::sin(slope), 0, std::cos(slope)), along(std::cos(slope), 0, std::sin(slope));
  const Vector3d start = Vector3d(0.2, 0.07, 0.36) + 0.05 * n;
  for (const double mu : {0.1, 0.2, 0.35}) {
    World w(read(folder, ground(heightmap("2 2 0.6"), mu) + body(text_of(start) + " 0 " + std::to_string(-slope) + " 0",
                                                                 "<box><size>0.3 0.2 0.1</size></box>", mu)),
            {});
    constexpr double kTime = 0.5;
    run(w, kTime);
    const double speed = std::max(0.0, kGravity * (std::sin(slope) - mu * std::cos(slope)) * kTime);
    EXPECT_NEAR(-along.dot(w.twists()[1].head<3>()), speed, 0.01 * speed + 1e-4) << mu;
    EXPECT_NEAR(n.dot(w.poses()[1].p - start), 0, 2e-4) << mu;
    EXPECT_NEAR(w.poses()[1].p.y(), 0.07, 1e-3) << mu;
  }
}

TEST(Heightmaps, AFlatOneIsLikeAPlane) {
  const TemporaryFolder folder("heightmaps");
  folder.write("h.png", grey_png(17, 17, [](int, int) { return 77; }));
  const std::string bounce = "<cotwin:velocity>0.7 0.3 0 0 0 0</cotwin:velocity>";
  for (const std::string& shape :
       {std::string("<sphere><radius>0.1</radius></sphere>"), std::string("<box><size>0.2 0.1 0.15</size></box>")}) {
    const std::string thrown = body("-0.3 -0.2 0.3 0 0 0", shape, 0.5, bounce);
    World map(read(folder, ground(heightmap("4 4 1", "0 0 -1")) + thrown), {}),
        plane(read(folder, ground("<plane/>") + thrown), {});
    for (int k = 0; k < 1000; ++k) {
      map.step(1e-3);
      plane.step(1e-3);
      ASSERT_LT((map.poses()[1].p - plane.poses()[1].p).norm(), 2e-3) << shape << k;
    }
    EXPECT_NEAR(map.poses()[1].p.z(), plane.poses()[1].p.z(), 1e-5) << shape;
  }
}

TEST(Heightmaps, EndAtTheirBorder) {
  const TemporaryFolder folder("heightmaps");
  folder.write("h.png", grey_png(5, 5, [](int, int) { return 1; }));
  World w(read(folder, ground(heightmap("2 2 0.1")) + body("1.051 0 0.2 0 0 0", "<sphere><radius>0.05</radius></sphere>")), {});
  run(w, 0.5);
  EXPECT_NEAR(w.poses()[1].p.z(), 0.2 - kGravity * 0.25 / 2, 1e-3 * kGravity);
}

}  // namespace
}  // namespace cotwin::contact_world
