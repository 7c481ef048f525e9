// Heightmaps of SDF as ground.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "models/collision/contact/detector.h"
#include "models/scene/sdf/sdf.h"
#include "tests/components/contact_world/shapes.h"
#include "tests/support/allocations.h"
#include "tests/support/files.h"
#include "tests/support/png.h"

namespace cotwin::contact_world::heightmap_test {
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
scene::Scene read(const TemporaryFolder& folder, const std::string& models, const std::string& gravity = "-9.81") {
  return scene::parse_sdf(
      "<sdf version='1.10'><world name='w'><gravity>0 0 " + gravity + "</gravity>" + models + "</world></sdf>",
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

// A cliff: floor at z = 0 for x ≤ 0, a plateau at kHigh from x = kCell on.
constexpr double kCell = 0.05, kHigh = 2;
constexpr int kSide = 33;
int cliff(int x, int) { return x > kSide / 2 ? 65535 : 0; }

/// The triangles of a map as a mesh.
std::string obj(int nodes, double cell, double height, int (*grey)(int, int)) {
  std::string file;
  const double middle = (nodes - 1) / 2.0;
  for (int j = 0; j < nodes; ++j) {
    for (int i = 0; i < nodes; ++i) {
      const Vector3d p(cell * (i - middle), cell * (j - middle), height * grey(i, nodes - 1 - j) / 65535);
      char line[100];
      std::snprintf(line, sizeof line, "v %.17g %.17g %.17g\n", p.x(), p.y(), p.z());
      file += line;
    }
  }
  for (int j = 0; j + 1 < nodes; ++j) {
    for (int i = 0; i + 1 < nodes; ++i) {
      const int k = j * nodes + i + 1;
      for (const auto& [b, c] : {std::pair(k + 1, k + nodes + 1), std::pair(k + nodes + 1, k + nodes)})
        file += "f " + std::to_string(k) + " " + std::to_string(b) + " " + std::to_string(c) + "\n";
    }
  }
  return file;
}
std::string square_map(int nodes, double cell, double height) {
  const std::string side = std::to_string((nodes - 1) * cell);
  return heightmap(side + " " + side + " " + std::to_string(height));
}

const std::pair<const char*, const char*> kShapes[] = {
    {"sphere", "<sphere><radius>0.1</radius></sphere>"},
    {"box", "<box><size>0.2 0.2 0.2</size></box>"},
    {"cylinder", "<cylinder><radius>0.1</radius><length>0.2</length></cylinder>"},
    {"capsule", "<capsule><radius>0.05</radius><length>0.2</length></capsule>"},
    {"ellipsoid", "<ellipsoid><radii>0.1 0.08 0.12</radii></ellipsoid>"},
    {"cone", "<cone><radius>0.1</radius><length>0.2</length></cone>"},
};

// Without friction a push along x, against a cliff that is the same all along y, moves nothing along y, and the body comes to rest
// where it touches both planes.
TEST(Heightmaps, ABodyThatIsPushedToTheFootOfACliffStaysInLine) {
  const TemporaryFolder folder("heightmaps");
  folder.write("h.png", grey_png(kSide, kSide, cliff));
  for (const double high : {0.5, kHigh}) {
    const double angle = std::atan2(high, kCell);  // of the cliff
    for (const auto& [name, geometry] : kShapes) {
      World w(read(folder, ground(square_map(kSide, kCell, high), 0) + body("-0.15 0.013 0.16 0 0 0", geometry, 0)), {});
      const double mass = w.scene().bodies[1].inertia.mass;
      for (int k = 0; k < 1000; ++k) {
        w.apply(1, (Wrench() << 30 * mass, 0, 0, 0, 0, 0).finished());
        w.step(1e-3);
        // A cone has 64 sides, which do not lie alike on both sides of its way.
        ASSERT_NEAR(w.poses()[1].p.y(), 0.013, name == std::string("cone") ? 5e-3 : 1e-5) << name << " " << k;
      }
      if (std::string(name) != "sphere") continue;
      EXPECT_NEAR(w.poses()[1].p.x(), -0.1 * (1 - std::cos(angle)) / std::sin(angle), 1e-5) << high;
      EXPECT_NEAR(w.poses()[1].p.z(), 0.1, 1e-5) << high;
    }
  }
}

// What starts inside the wall leaves it along the wall's normal, a sphere until n·p = r; nothing is lifted to the plateau.
TEST(Heightmaps, ABodyInsideACliffLeavesItSidewards) {
  const TemporaryFolder folder("heightmaps");
  folder.write("h.png", grey_png(kSide, kSide, cliff));
  const Vector3d n = Vector3d(-kHigh, 0, kCell).normalized();
  for (const double z : {0.6, 1.5, 1.8}) {
    for (const double depth : {0.001, 0.02, 0.06}) {
      for (const auto& [name, geometry] : kShapes) {
        const double reach = name == std::string("capsule") ? 0.05 : 0.1;
        const Vector3d p((reach - depth - n.z() * z) / n.x(), 0.013, z);  // n·p is the reach less the depth
        World w(read(folder, ground(square_map(kSide, kCell, kHigh)) + body(text_of(p) + " 0 0 0", geometry), "0"), {});
        run(w, 0.5, 2e-3);
        EXPECT_NEAR(w.poses()[1].p.z(), p.z(), 0.02) << name << " " << depth << " " << z;
        EXPECT_NEAR(w.poses()[1].p.y(), 0.013, 2e-3) << name << " " << depth << " " << z;
        EXPECT_LT(w.twists()[1].head<3>().norm(), 0.12) << name << " " << depth << " " << z;
        if (name != std::string("sphere")) continue;
        EXPECT_NEAR(n.dot(w.poses()[1].p), reach - std::max(0.0, depth - 0.05), 1e-3) << depth << " " << z;
      }
    }
  }
}

int hills(int x, int y) { return 20000 + (7919 * x * x + 104729 * y * y + 15485863 * ((x * 31 + y * 17) % 23)) % 41000; }

// The solid of a map is the union of the prisms below its triangles. Where a body does not touch it, the least distance from one
// of the prisms, each a static body of its own, is that from the map.
TEST(Heightmaps, AreAsFarFromABodyAsTheUnionOfTheirPrisms) {
  const TemporaryFolder folder("heightmaps");
  constexpr int kNodes = 7;
  constexpr double kWide = 0.1;
  folder.write("h.png", grey_png(kNodes, kNodes, hills));
  for (const double high : {0.02, 0.2, 2.0}) {
    const scene::Scene map = read(folder, ground(square_map(kNodes, kWide, high)));
    const scene::HeightField& field = *map.bodies[0].shapes[0].heights;
    scene::Scene prisms;
    for (std::size_t number = 0; number < field.triangles(); ++number) {
      scene::Shape prism;
      prism.type = scene::ShapeType::kHull;
      for (const Vector3d& corner : field.triangle(number).corners) {
        prism.vertices.push_back(corner);
        prism.vertices.push_back({corner.x(), corner.y(), -1});
      }
      scene::Body& one = prisms.bodies.emplace_back();
      one.name = std::to_string(number);
      one.motion = scene::Motion::kStatic;
      one.shapes = {prism};
    }
    for (const auto& [name, geometry] : kShapes) {
      const scene::Body thing = read(folder, body("0 0 0 0 0 0", geometry)).bodies[0];
      scene::Scene on_map = map, on_prisms = prisms;
      on_map.bodies.push_back(thing);
      on_prisms.bodies.push_back(thing);
      collision::Detector of_map(on_map), of_prisms(on_prisms);
      testing::Random random(7);
      for (int trial = 0; trial < 50; ++trial) {
        Pose X{random.rotation(), {random.real(-0.35, 0.35), random.real(-0.2, 0.2), 0}};
        const auto least = [&](collision::Detector& detector, std::size_t bodies) {
          std::vector<Pose> poses(bodies);
          poses.back() = X;
          detector.detect(poses, 0.05);
          double gap = 0.05;
          for (const ContactPoint& p : detector.points()) gap = std::min(gap, p.gap);
          return gap;
        };
        // A height at which it is a little above the ground.
        double low = 0, up = high + 0.3;
        for (int k = 0; k < 12; ++k) {
          X.p.z() = (low + up) / 2;
          (least(of_prisms, prisms.bodies.size() + 1) > 0.002 ? up : low) = X.p.z();
        }
        X.p.z() = up;
        EXPECT_NEAR(least(of_map, 2), least(of_prisms, prisms.bodies.size() + 1), 1e-7) << name << " " << high << " " << trial;
      }
    }
  }
}

// Gentle ground as a mesh: the motion is the same, too.
TEST(Heightmaps, MoveBodiesAsTheSameGroundAsAMesh) {
  const TemporaryFolder folder("heightmaps");
  constexpr int kNodes = 17;
  constexpr double kWide = 0.1, kRelief = 0.08;
  folder.write("h.png", grey_png(kNodes, kNodes, hills));
  int brightest = 0;
  for (int i = 0; i < kNodes * kNodes; ++i) brightest = std::max(brightest, hills(i % kNodes, i / kNodes));
  folder.write("h.obj", obj(kNodes, kWide, kRelief * 65535 / brightest, hills));
  for (const auto& [name, geometry] : kShapes) {
    const std::string thing = body("0.1 0.05 0.25 0.3 0.2 0.1", geometry);
    World map(read(folder, ground(square_map(kNodes, kWide, kRelief)) + thing), {});
    World mesh(read(folder, ground("<mesh><uri>h.obj</uri></mesh>") + thing), {});
    const double start = map.energy();
    for (int k = 0; k < 250; ++k) {
      map.step(1e-3);
      mesh.step(1e-3);
      ASSERT_LE(map.energy(), start + 1e-9) << name << " " << k;
    }
    EXPECT_LT((map.poses()[1].p - mesh.poses()[1].p).norm(), 2e-3) << name;
    EXPECT_NEAR(map.energy(), mesh.energy(), 0.02 * std::abs(start - mesh.energy())) << name;
  }
}

TEST(Heightmaps, KeepTheEnergyOfABallThatBounces) {
  const TemporaryFolder folder("heightmaps");
  folder.write("h.png", grey_png(kSide, kSide, [](int x, int y) { return 100 * ((x - 16) * (x - 16) + (y - 16) * (y - 16)); }));
  const std::string bouncing =
      "<surface><friction><ode><mu>0</mu></ode></friction><bounce><restitution_coefficient>1"
      "</restitution_coefficient></bounce></surface>";
  std::string models = ground(heightmap("1.6 1.6 1.28")) + body("0.21 0.13 0.6 0 0 0", kShapes[0].second);
  for (std::size_t at = 0; (at = models.find(friction(0.5), at)) != std::string::npos;)
    models.replace(at, friction(0.5).size(), bouncing);
  World w(read(folder, models), {});
  const double start = w.energy();
  for (int k = 0; k < 5000; ++k) w.step(1e-3);
  EXPECT_NEAR(w.energy(), start, 1e-3 * std::abs(start));
  EXPECT_EQ(w.fault(0.01, 0.25), "");
}

TEST(Heightmaps, AFlatOneOfManyCellsHasFourPointsUnderABox) {
  const TemporaryFolder folder("heightmaps");
  folder.write("h.png", grey_png(201, 201, [](int, int) { return 77; }));
  World w(read(folder, ground(heightmap("2 2 1", "0 0 -1")) + body("0.003 0.004 0.0999 0 0 0.3", kShapes[1].second)), {});
  run(w, 0.1);
  EXPECT_EQ(w.contacts().size(), 4u);
  EXPECT_NEAR(w.poses()[1].p.z(), 0.1, 1e-5);
  double force = 0;
  for (const Vector3d& f : w.forces()) force += f.z();
  EXPECT_NEAR(force, kGravity * w.scene().bodies[1].inertia.mass, 1e-6 * force);
}

TEST(Heightmaps, StopAFastBallAsAPlaneDoes) {
  const TemporaryFolder folder("heightmaps");
  folder.write("h.png", grey_png(kSide, kSide, cliff));
  folder.write("flat.png", grey_png(kSide, kSide, [](int, int) { return 1; }));
  const std::string fast = "<cotwin:velocity>150 20 0 0 0 0</cotwin:velocity>";
  World w(read(folder, ground(square_map(kSide, kCell, kHigh), 0) +
                           body("-0.7 0.013 1.0 0 0 0", "<sphere><radius>0.005</radius></sphere>", 0, fast)),
          {});
  for (int k = 0; k < 20; ++k) w.step(1e-3);
  const Vector3d n = Vector3d(-kHigh, 0, kCell).normalized();
  EXPECT_LT(n.dot(w.twists()[1].head<3>()), 0.3);  // along the wall
  EXPECT_LT(w.poses()[1].p.x(), 0.025);
  EXPECT_NEAR(w.twists()[1][1], 20, 1e-6);

  // One that skims over flat ground loses no time at the seams.
  const std::string along = "<cotwin:velocity>31 7 0 0 0 0</cotwin:velocity>";
  std::string flat = ground(square_map(kSide, kCell, 1), 0);
  flat.replace(flat.find("h.png"), 5, "flat.png");
  World skims(read(folder, flat + body("-0.7 -0.1 1.0200001 0 0 0", "<sphere><radius>0.02</radius></sphere>", 0, along)), {});
  for (int k = 0; k < 30; ++k) skims.step(1e-3);
  EXPECT_NEAR(skims.poses()[1].p.x(), -0.7 + 31 * 0.03, 1e-6);
  EXPECT_NEAR(skims.poses()[1].p.y(), -0.1 + 7 * 0.03, 1e-6);
}

TEST(Heightmaps, AStepAllocatesNothing) {
  const TemporaryFolder folder("heightmaps");
  folder.write("h.png", grey_png(kSide, kSide, cliff));
  std::string models = ground(square_map(kSide, kCell, 0.5));
  for (const auto& [name, geometry] : kShapes) {
    std::string one =
        body(std::to_string(-0.6 + 0.25 * static_cast<double>(models.size() % 5)) + " 0 0.9 0.3 0.2 0.1", geometry);
    one.replace(one.find("'body'"), 6, "'" + std::string(name) + "'");
    models += one;
  }
  World w(read(folder, models), {});
  for (int k = 0; k < 300; ++k) {
    const std::uint64_t before = cotwin::testing::allocations();
    w.step(1e-3);
    ASSERT_EQ(cotwin::testing::allocations(), before) << k;
  }
  EXPECT_EQ(w.status().grown, 0u);
}

}  // namespace
}  // namespace cotwin::contact_world::heightmap_test
