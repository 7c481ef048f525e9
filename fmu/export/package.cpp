#include "fmu/export/package.h"

#include "fmu/description/consistency.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/fields.h"

namespace cotwin::fmu {

namespace {

constexpr std::uint64_t kPackageMagic = 0x39554d4657544f43u;  // the bytes "COTWFMU9": the format and its version

/// Throw Error, without a place, unless every joint comes after its parent, every mimic has a leader, and every frame is on a body.
void check(const robot::RobotModel& robot) {
  const int all = robot.body_count();
  if (robot.bodies.size() != static_cast<std::size_t>(all)) throw Error("has different numbers of bodies and joints");
  int place = -1;
  for (const robot::Mimic& mimic : robot.mimics) {
    if (mimic.leader < 0 || mimic.leader >= robot.n() || mimic.place <= place || mimic.place >= all)
      throw Error("has a mimic joint without a leader or place");
    place = mimic.place;
  }
  std::vector<char> seen(static_cast<std::size_t>(all));
  for (const int body : robot.depth_first()) {
    const int parent = robot.joint_of(body).parent;
    if (parent < -1 || parent >= all || (parent >= 0 && seen[static_cast<std::size_t>(parent)] == 0))
      throw Error("has a joint before its parent");
    seen[static_cast<std::size_t>(body)] = 1;
  }
  for (const robot::Frame& frame : robot.frames) {
    if (frame.body < -1 || frame.body >= all) throw Error("has a frame on a body that does not exist");
  }
}

void check(const scene::Cell& cell) {
  for (const scene::PlacedRobot& robot : cell.robots) {
    check(robot.model);
    if (robot.shapes.size() > robot.model.bodies.size() + 1) throw Error("has shapes of bodies that do not exist");
  }
  scene::check(cell.scene);
}

}  // namespace

std::string serialise(const Package& package) {
  ByteWriter out;
  Putter(out).put(package);
  return sealed(kPackageMagic, out.take());
}

Package deserialise_package(std::string_view bytes, const std::string& place) {
  ByteReader in = opened(kPackageMagic, bytes, place, "is not a unit package of this version");
  Package package;
  Getter(in).get(package);
  in.expect_end();
  at(place, [&] {
    if (package.robot != nullptr) check(*package.robot);
    if (package.cell != nullptr) check(*package.cell);
  });
  return package;
}

}  // namespace cotwin::fmu
