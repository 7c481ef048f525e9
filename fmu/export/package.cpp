#include "fmu/export/package.h"

#include "models/foundation/support/bytes.h"

namespace cotwin::fmu {

namespace {

constexpr std::uint64_t kPackageMagic = 0x38554d4657544f43u;  // the bytes "COTWFMU8": the format and its version

template <class Matrix>
void put(ByteWriter& out, const Matrix& m) {
  for (Eigen::Index i = 0; i < m.size(); ++i) out.value(m.data()[i]);
}
template <class Matrix>
void get(ByteReader& in, Matrix& m) {
  for (Eigen::Index i = 0; i < m.size(); ++i) m.data()[i] = in.value<double>();
}

void put(ByteWriter& out, const Pose& X) {
  put(out, X.R);
  put(out, X.p);
}
void get(ByteReader& in, Pose& X) {
  get(in, X.R);
  get(in, X.p);
}

void put(ByteWriter& out, const robot::Body& body) {
  out.text(body.name);
  out.value(body.inertia.mass);
  put(out, body.inertia.p_LC);
  put(out, body.inertia.I_CC);
}
void get(ByteReader& in, robot::Body& body) {
  body.name = in.text();
  body.inertia.mass = in.value<double>();
  get(in, body.inertia.p_LC);
  get(in, body.inertia.I_CC);
}

void put(ByteWriter& out, const robot::Joint& joint) {
  out.text(joint.name);
  out.value(static_cast<std::int32_t>(joint.type));
  out.value(static_cast<std::int32_t>(joint.parent));
  put(out, joint.X_PJ);
  put(out, joint.axis);
  for (const double limit :
       {joint.q_min, joint.q_max, joint.dq_max, joint.ddq_max, joint.dddq_max, joint.tau_max, joint.damping, joint.friction})
    out.value(limit);
  out.value(static_cast<std::int32_t>(joint.passive));
}
void get(ByteReader& in, robot::Joint& joint) {
  joint.name = in.text();
  joint.type = static_cast<robot::JointType>(in.value<std::int32_t>());
  if (joint.type != robot::JointType::kRevolute && joint.type != robot::JointType::kPrismatic) in.fail("has an unknown joint");
  joint.parent = in.value<std::int32_t>();
  get(in, joint.X_PJ);
  get(in, joint.axis);
  for (double* limit : {&joint.q_min, &joint.q_max, &joint.dq_max, &joint.ddq_max, &joint.dddq_max, &joint.tau_max,
                        &joint.damping, &joint.friction}) {
    *limit = in.value<double>();
  }
  joint.passive = in.value<std::int32_t>() != 0;
}

void put(ByteWriter& out, const robot::Mimic& mimic) {
  put(out, mimic.joint);
  for (const int index : {mimic.leader, mimic.place}) out.value(static_cast<std::int32_t>(index));
  out.value(mimic.multiplier);
  out.value(mimic.offset);
}
void get(ByteReader& in, robot::Mimic& mimic) {
  get(in, mimic.joint);
  for (int* index : {&mimic.leader, &mimic.place}) *index = in.value<std::int32_t>();
  mimic.multiplier = in.value<double>();
  mimic.offset = in.value<double>();
}

/// Throws Error unless every joint comes after its parent and every mimic has a leader.
void check_tree(const ByteReader& in, const robot::RobotModel& robot) {
  const int all = robot.body_count();
  int place = -1;
  for (const robot::Mimic& mimic : robot.mimics) {
    if (mimic.leader < 0 || mimic.leader >= robot.n() || mimic.place <= place || mimic.place >= all)
      in.fail("has a mimic joint without a leader or place");
    place = mimic.place;
  }
  std::vector<char> seen(static_cast<std::size_t>(all));
  for (const int body : robot.depth_first()) {
    const int parent = robot.joint_of(body).parent;
    if (parent < -1 || parent >= all || (parent >= 0 && seen[static_cast<std::size_t>(parent)] == 0))
      in.fail("has a joint before its parent");
    seen[static_cast<std::size_t>(body)] = 1;
  }
}

void put(ByteWriter& out, const robot::RobotModel& robot) {
  out.text(robot.name);
  out.value(static_cast<std::uint64_t>(robot.joints.size()));
  for (const robot::Joint& joint : robot.joints) put(out, joint);
  out.value(static_cast<std::uint64_t>(robot.mimics.size()));
  for (const robot::Mimic& mimic : robot.mimics) put(out, mimic);
  for (const robot::Body& body : robot.bodies) put(out, body);
  put(out, robot.base);
  out.value(static_cast<std::uint64_t>(robot.frames.size()));
  for (const robot::Frame& frame : robot.frames) {
    out.text(frame.name);
    out.value(static_cast<std::int32_t>(frame.body));
    put(out, frame.X_BF);
  }
  put(out, robot.gravity);
}
void get(ByteReader& in, robot::RobotModel& robot) {
  robot.name = in.text();
  robot.joints.resize(in.count(100));
  for (robot::Joint& joint : robot.joints) get(in, joint);
  robot.mimics.resize(in.count(100));
  for (robot::Mimic& mimic : robot.mimics) get(in, mimic);
  check_tree(in, robot);
  robot.bodies.resize(robot.joints.size() + robot.mimics.size());
  for (robot::Body& body : robot.bodies) get(in, body);
  get(in, robot.base);
  robot.frames.resize(in.count(100));
  for (robot::Frame& frame : robot.frames) {
    frame.name = in.text();
    frame.body = in.value<std::int32_t>();
    if (frame.body < -1 || frame.body >= robot.body_count()) in.fail("has a frame on a body that does not exist");
    get(in, frame.X_BF);
  }
  get(in, robot.gravity);
}

/// Reads an enumeration value from 0 to `last`.
template <class Enum>
Enum choice(ByteReader& in, int last) {
  const auto value = in.value<std::int32_t>();
  if (value < 0 || value > last)
    in.fail("has the invalid enumeration value " + std::to_string(value) + ", expected 0 to " + std::to_string(last));
  return static_cast<Enum>(value);
}

void put(ByteWriter& out, const scene::Shape& shape) {
  out.text(shape.name);
  out.value(static_cast<std::int32_t>(shape.type));
  put(out, shape.size);
  out.value(static_cast<std::uint64_t>(shape.vertices.size()));
  for (const Eigen::Vector3d& vertex : shape.vertices) put(out, vertex);
  put(out, shape.X_BS);
  const scene::Material& m = shape.material;
  put(out, m.first_direction);
  for (const double value : {m.mu, m.mu2, m.torsion, m.patch_radius, m.surface_radius, m.restitution, m.stiffness, m.damping,
                             m.foundation, m.foundation_damping, m.yield, m.breakthrough, m.whole ? 1.0 : 0.0})
    out.value(value);
  out.text(shape.tool);
}
void get(ByteReader& in, scene::Shape& shape) {
  shape.name = in.text();
  shape.type = choice<scene::ShapeType>(in, static_cast<int>(scene::ShapeType::kEllipsoid));
  get(in, shape.size);
  shape.vertices.resize(in.count(sizeof(Eigen::Vector3d)));
  for (Eigen::Vector3d& vertex : shape.vertices) get(in, vertex);
  get(in, shape.X_BS);
  scene::Material& m = shape.material;
  get(in, m.first_direction);
  double whole = 0;
  for (double* value : {&m.mu, &m.mu2, &m.torsion, &m.patch_radius, &m.surface_radius, &m.restitution, &m.stiffness, &m.damping,
                        &m.foundation, &m.foundation_damping, &m.yield, &m.breakthrough, &whole})
    *value = in.value<double>();
  m.whole = whole != 0;
  shape.tool = in.text();
}

void put(ByteWriter& out, const std::vector<scene::Shape>& shapes) {
  out.value(static_cast<std::uint64_t>(shapes.size()));
  for (const scene::Shape& shape : shapes) put(out, shape);
}
void get(ByteReader& in, std::vector<scene::Shape>& shapes) {
  shapes.resize(in.count(100));
  for (scene::Shape& shape : shapes) get(in, shape);
}

void put(ByteWriter& out, const scene::Body& body) {
  out.text(body.name);
  out.value(static_cast<std::int32_t>(body.motion));
  put(out, body.X_WB);
  put(out, body.V_WB);
  out.value(body.inertia.mass);
  put(out, body.inertia.p_LC);
  put(out, body.inertia.I_CC);
  put(out, body.shapes);
}
void get(ByteReader& in, scene::Body& body) {
  body.name = in.text();
  body.motion = choice<scene::Motion>(in, static_cast<int>(scene::Motion::kDynamic));
  get(in, body.X_WB);
  get(in, body.V_WB);
  body.inertia.mass = in.value<double>();
  get(in, body.inertia.p_LC);
  get(in, body.inertia.I_CC);
  get(in, body.shapes);
}

void put(ByteWriter& out, const scene::Joint& joint) {
  out.text(joint.name);
  for (const int value : {static_cast<int>(joint.type), joint.parent, joint.child}) out.value(static_cast<std::int32_t>(value));
  put(out, joint.X_PJ);
  put(out, joint.X_CJ);
  put(out, joint.axis);
  for (const double value :
       {joint.q, joint.q_min, joint.q_max, joint.friction, joint.damping, joint.stiffness, joint.q_spring, joint.pitch})
    out.value(value);
}
void get(ByteReader& in, scene::Joint& joint) {
  joint.name = in.text();
  joint.type = choice<scene::JointType>(in, static_cast<int>(scene::JointType::kScrew));
  joint.parent = in.value<std::int32_t>();
  joint.child = in.value<std::int32_t>();
  get(in, joint.X_PJ);
  get(in, joint.X_CJ);
  get(in, joint.axis);
  for (double* value :
       {&joint.q, &joint.q_min, &joint.q_max, &joint.friction, &joint.damping, &joint.stiffness, &joint.q_spring, &joint.pitch})
    *value = in.value<double>();
}

void put(ByteWriter& out, const scene::Cell& cell) {
  const scene::Scene& scene = cell.scene;
  out.text(scene.name);
  put(out, scene.gravity);
  out.value(static_cast<std::uint64_t>(scene.bodies.size()));
  for (const scene::Body& body : scene.bodies) put(out, body);
  out.value(static_cast<std::uint64_t>(scene.joints.size()));
  for (const scene::Joint& joint : scene.joints) put(out, joint);
  out.value(static_cast<std::uint64_t>(scene.gears.size()));
  for (const scene::Gear& gear : scene.gears) {
    for (const int joint : {gear.leader, gear.follower}) out.value(static_cast<std::int32_t>(joint));
    for (const double value : {gear.ratio, gear.offset}) out.value(value);
  }
  out.value(static_cast<std::uint64_t>(scene.frames.size()));
  for (const scene::Frame& frame : scene.frames) {
    out.text(frame.name);
    out.value(static_cast<std::int32_t>(frame.body));
    put(out, frame.X_BF);
  }
  out.value(static_cast<std::uint64_t>(scene.no_contact.size()));
  for (const auto& [a, b] : scene.no_contact) {
    out.value(static_cast<std::int32_t>(a));
    out.value(static_cast<std::int32_t>(b));
  }
  out.value(static_cast<std::uint64_t>(cell.robots.size()));
  for (const scene::PlacedRobot& robot : cell.robots) {
    out.text(robot.name);
    put(out, robot.model);
    out.value(static_cast<std::uint64_t>(robot.shapes.size()));
    for (const std::vector<scene::Shape>& shapes : robot.shapes) put(out, shapes);
  }
}
void get(ByteReader& in, scene::Cell& cell) {
  scene::Scene& scene = cell.scene;
  scene.name = in.text();
  get(in, scene.gravity);
  scene.bodies.resize(in.count(100));
  for (scene::Body& body : scene.bodies) get(in, body);
  scene.joints.resize(in.count(100));
  for (scene::Joint& joint : scene.joints) get(in, joint);
  scene.gears.resize(in.count(24));
  for (scene::Gear& gear : scene.gears) {
    for (int* joint : {&gear.leader, &gear.follower}) *joint = in.value<std::int32_t>();
    for (double* value : {&gear.ratio, &gear.offset}) *value = in.value<double>();
  }
  scene.frames.resize(in.count(100));
  for (scene::Frame& frame : scene.frames) {
    frame.name = in.text();
    frame.body = in.value<std::int32_t>();
    get(in, frame.X_BF);
  }
  scene.no_contact.resize(in.count(8));
  for (auto& [a, b] : scene.no_contact) {
    a = in.value<std::int32_t>();
    b = in.value<std::int32_t>();
  }
  cell.robots.resize(in.count(100));
  for (scene::PlacedRobot& robot : cell.robots) {
    robot.name = in.text();
    get(in, robot.model);
    robot.shapes.resize(in.count(8));
    if (robot.shapes.size() > robot.model.bodies.size() + 1) in.fail("has shapes of bodies that do not exist");
    for (std::vector<scene::Shape>& shapes : robot.shapes) get(in, shapes);
  }
  scene::check(scene);
}

}  // namespace

std::string serialise(const Package& package) {
  ByteWriter out;
  out.text(package.token);
  out.text(package.unit);
  out.text(package.query);
  out.value(static_cast<std::uint8_t>(package.robot != nullptr));
  if (package.robot != nullptr) put(out, *package.robot);
  out.value(static_cast<std::uint8_t>(package.cell != nullptr));
  if (package.cell != nullptr) put(out, *package.cell);
  out.text(package.start.serialise());

  ByteWriter head;
  head.value(kPackageMagic);
  head.value(hash_of(out.bytes()));
  return head.bytes() + out.bytes();
}

Package deserialise_package(std::string_view bytes, const std::string& place) {
  ByteReader in(as_bytes(bytes), place);
  if (bytes.size() < sizeof kPackageMagic || in.value<std::uint64_t>() != kPackageMagic)
    in.fail("is not a unit package of this version");
  if (in.value<std::uint64_t>() != hash_of(bytes.substr(2 * sizeof(std::uint64_t)))) in.fail("is damaged");
  Package package;
  package.token = in.text();
  package.unit = in.text();
  package.query = in.text();
  if (in.value<std::uint8_t>() != 0) {
    auto robot = std::make_shared<robot::RobotModel>();
    get(in, *robot);
    package.robot = std::move(robot);
  }
  if (in.value<std::uint8_t>() != 0) {
    auto cell = std::make_shared<scene::Cell>();
    get(in, *cell);
    package.cell = std::move(cell);
  }
  package.start = Snapshot::deserialise(in.text());
  in.expect_end();
  return package;
}

}  // namespace cotwin::fmu
