#include "fmu/package.h"

#include "fmu/bytes.h"

namespace cotwin::fmu {

namespace {

constexpr std::uint64_t kMagic = 0x31554d4657544f43u;  // the bytes "COTWFMU1": the format and its version

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
  for (const double limit : {joint.q_min, joint.q_max, joint.dq_max, joint.tau_max, joint.damping, joint.friction})
    out.value(limit);
}
void get(ByteReader& in, robot::Joint& joint) {
  joint.name = in.text();
  joint.type = static_cast<robot::JointType>(in.value<std::int32_t>());
  joint.parent = in.value<std::int32_t>();
  get(in, joint.X_PJ);
  get(in, joint.axis);
  for (double* limit : {&joint.q_min, &joint.q_max, &joint.dq_max, &joint.tau_max, &joint.damping, &joint.friction}) {
    *limit = in.value<double>();
  }
}

void put(ByteWriter& out, const robot::RobotModel& robot) {
  out.text(robot.name);
  out.value(static_cast<std::uint64_t>(robot.joints.size()));
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    put(out, robot.joints[i]);
    put(out, robot.bodies[i]);
  }
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
  robot.bodies.resize(robot.joints.size());
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    get(in, robot.joints[i]);
    get(in, robot.bodies[i]);
  }
  get(in, robot.base);
  robot.frames.resize(in.count(100));
  for (robot::Frame& frame : robot.frames) {
    frame.name = in.text();
    frame.body = in.value<std::int32_t>();
    get(in, frame.X_BF);
  }
  get(in, robot.gravity);
}

}  // namespace

std::string serialise(const Package& package) {
  ByteWriter out;
  out.text(package.token);
  out.text(package.unit);
  out.text(package.query);
  out.value(static_cast<std::uint8_t>(package.robot != nullptr));
  if (package.robot != nullptr) put(out, *package.robot);
  const std::vector<std::byte> start = package.start.serialise();
  out.text({reinterpret_cast<const char*>(start.data()), start.size()});

  ByteWriter head;
  head.value(kMagic);
  head.value(hash_of(out.bytes()));
  return head.bytes() + out.bytes();
}

Package deserialise_package(std::string_view bytes, const std::string& place) {
  ByteReader in(as_bytes(bytes), place);
  if (bytes.size() < sizeof kMagic || in.value<std::uint64_t>() != kMagic)
    in.fail("is not what a unit of this version is built from");
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
  package.start = Snapshot::deserialise(as_bytes(in.text()));
  in.expect_end();
  return package;
}

}  // namespace cotwin::fmu
