// A profile of 1000 beams, in processor time of the thread, beside the rays of Bullet (libbullet-dev) against the same bodies. Ranges must agree to
// 1 mm: Bullet ends its search of convex shapes before.
#include <btBulletCollisionCommon.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "models/foundation/support/text.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/files.h"

namespace {

using namespace cotwin;
using Eigen::Vector3d;

constexpr int kBeams = 1000;
constexpr double kOpening = 2 * std::numbers::pi * 0.999, kRange = 10;

class Random {
 public:
  double real(double low, double high) { return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53; }

 private:
  std::mt19937_64 engine_{1};
};

/// The same bodies for both.
class Cell {
 public:
  /// At p, turned by `turn` about z.
  void add(const std::string& geometry, std::unique_ptr<btCollisionShape> shape, const Vector3d& p, double turn) {
    const std::string name = "body_" + std::to_string(objects_.size());
    std::string pose;
    for (const double x : {p.x(), p.y(), p.z(), 0.0, 0.0, turn}) pose += text::to_text(x) + " ";
    sdf_ += "<model name=\"" + name + "\"><static>true</static><pose>" + pose + "</pose><link name=\"" + name +
            "\"><collision name=\"c\"><geometry>" + geometry + "</geometry></collision></link></model>";
    objects_.push_back(std::make_unique<btCollisionObject>());
    objects_.back()->setCollisionShape(shape.get());
    objects_.back()->setWorldTransform(btTransform(btQuaternion(btVector3(0, 0, 1), turn), btVector3(p.x(), p.y(), p.z())));
    shapes_.push_back(std::move(shape));
    world_.addCollisionObject(objects_.back().get());
  }

  /// Takes profiles about the origin in the plane z = 0, and prints their time.
  void measure(const std::string& name, const std::filesystem::path& folder, double most) {
    std::ofstream(folder / "cell.sdf") << "<sdf version=\"1.11\"><world name=\"w\">" << sdf_ << "</world></sdf>";
    Instance scanner =
        make_unit("unit:scanner?scene=" + (folder / "cell.sdf").string() + "&frame=body_0&beams=" + std::to_string(kBeams), {},
                  {}, unit_types());
    // Its frame is that of the first body, a post far above.
    const double half = std::sqrt(0.5);
    const auto set = [&](const char* variable, std::initializer_list<double> values) {
      std::ranges::copy(values, scanner.variables.at(variable).reals().begin());
    };
    set("mount_p", {0, 0, -50});
    set("mount_quat", {half, half, 0, 0});  // y of the scanner is z of the cell
    set("opening", {kOpening});
    set("range_max", {kRange});
    scanner.unit->initialise({});
    bool& trigger = scanner.variables.at("trigger").booleans()[0];
    const std::span<double> ranges = scanner.variables.at("ranges").reals();
    Time now;
    const auto ours = [&] {
      for (const bool on : {false, true}) {
        trigger = on;
        if (scanner.unit->step(now, Duration{1'000'000}) != StepResult::kDone) std::exit(1);
        now = now + Duration{1'000'000};
      }
    };
    std::vector<double> of_peer(kBeams);
    const auto peer = [&] {
      for (int i = 0; i < kBeams; ++i) {
        const double angle = (i - (kBeams - 1) / 2.0) * kOpening / (kBeams - 1);
        const btVector3 from(0, 0, 0), to(kRange * std::sin(angle), -kRange * std::cos(angle), 0);
        btCollisionWorld::ClosestRayResultCallback hit(from, to);
        world_.rayTest(from, to, hit);
        of_peer[static_cast<std::size_t>(i)] = hit.hasHit() ? kRange * hit.m_closestHitFraction : 0;
      }
    };
    ours();
    peer();
    int met = 0, different = 0;
    for (std::size_t i = 0; i < kBeams; ++i) {
      met += ranges[i] > 0 ? 1 : 0;
      different += std::abs(ranges[i] - of_peer[i]) > 1e-3 ? 1 : 0;
    }
    // A glancing ray may meet one of them alone.
    if (different > kBeams / 100 || met < kBeams / 4) {
      std::fprintf(stderr, "%s: %d of %d beams came back, %d of them are others of Bullet's\n", name.c_str(), met, kBeams,
                   different);
      std::exit(1);
    }
    const benchmark::Figures f = benchmark::measure(ours, peer, 31, 2e-3, benchmark::thread_seconds);
    benchmark::print({name, "ms", 1e3 * f.ours, "Bullet, a ray each", 1e3 * f.peer, most, false});
  }

 private:
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btDbvtBroadphase broadphase_;
  btCollisionWorld world_{&dispatcher_, &broadphase_, &configuration_};
  std::vector<std::unique_ptr<btCollisionShape>> shapes_;
  std::vector<std::unique_ptr<btCollisionObject>> objects_;
  std::string sdf_;
};

std::string words(double x, double y, double z) { return text::to_text(x) + " " + text::to_text(y) + " " + text::to_text(z); }

void add_post(Cell& cell) {
  cell.add("<box><size>0.1 0.1 0.1</size></box>", std::make_unique<btBoxShape>(btVector3(0.05, 0.05, 0.05)), {0, 0, 50}, 0);
}

void bodies(const std::filesystem::path& folder) {
  Cell cell;
  Random random;
  add_post(cell);
  for (int k = 1; k < 50; ++k) {
    const double angle = random.real(0, 6.28), far = random.real(0.8, 3), x = random.real(0.1, 0.5), y = random.real(0.1, 0.5);
    const Vector3d p(far * std::cos(angle), far * std::sin(angle), random.real(-0.1, 0.1));
    if (k % 2 == 0) {
      cell.add("<box><size>" + words(x, y, 0.4) + "</size></box>", std::make_unique<btBoxShape>(btVector3(x / 2, y / 2, 0.2)),
               p, random.real(-3, 3));
    } else {
      cell.add("<sphere><radius>" + text::to_text(x / 2) + "</radius></sphere>", std::make_unique<btSphereShape>(x / 2), p, 0);
    }
  }
  cell.measure("profile of 1000 beams, 50 bodies", folder, 1);
}

/// A ring with bumps around the scanner, 100 × 100 quadrilaterals.
void mesh(const std::filesystem::path& folder) {
  constexpr int kSides = 100;
  const auto corner = [](int i, int k) {
    const double a = 2 * std::numbers::pi * i / kSides, b = 2 * std::numbers::pi * k / kSides;
    const double r = 1.5 + 0.1 * std::sin(7 * a) + 0.5 * std::cos(b);
    return Vector3d(r * std::cos(a), r * std::sin(a), 0.5 * std::sin(b));
  };
  btTriangleMesh triangles;
  std::ofstream obj(folder / "ring.obj");
  for (int i = 0; i < kSides; ++i) {
    for (int k = 0; k < kSides; ++k) {
      const Vector3d p = corner(i, k);
      obj << "v " << words(p.x(), p.y(), p.z()) << '\n';
      const auto add = [&](const Vector3d& a, const Vector3d& b, const Vector3d& c) {
        const auto to_bullet = [](const Vector3d& v) { return btVector3(v.x(), v.y(), v.z()); };
        triangles.addTriangle(to_bullet(a), to_bullet(b), to_bullet(c));
      };
      add(p, corner(i + 1, k), corner(i + 1, k + 1));
      add(p, corner(i + 1, k + 1), corner(i, k + 1));
    }
  }
  const auto at = [](int i, int k) { return std::to_string(i % kSides * kSides + k % kSides + 1); };
  for (int i = 0; i < kSides; ++i) {
    for (int k = 0; k < kSides; ++k) {
      obj << "f " << at(i, k) << ' ' << at(i + 1, k) << ' ' << at(i + 1, k + 1) << '\n';
      obj << "f " << at(i, k) << ' ' << at(i + 1, k + 1) << ' ' << at(i, k + 1) << '\n';
    }
  }
  obj.close();
  Cell cell;
  add_post(cell);
  cell.add("<mesh><uri>ring.obj</uri></mesh>", std::make_unique<btBvhTriangleMeshShape>(&triangles, true), Vector3d::Zero(), 0);
  cell.measure("profile of 1000 beams, a mesh of 20 000 triangles", folder, 2);
}

}  // namespace

int main() {
  const cotwin::testing::TemporaryFolder folder("scanner");
  bodies(folder.path());
  mesh(folder.path());
}
