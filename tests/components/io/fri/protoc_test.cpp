// The messages of Sunrise against Google's implementation of Protocol Buffers (Debian: protobuf-compiler), from a schema and from
// texts that are written here from the tables of the protocol, independently of the codec.
#include <gtest/gtest.h>

#include <cstdlib>
#include <sstream>
#include <string>

#include "components/io/fri/sunrise.h"
#include "tests/components/io/fri/messages.h"
#include "tests/support/files.h"
#include "tests/support/run_program.h"

namespace cotwin::protoc_test {
namespace {

using namespace fri;
using testing::Bytes;
using testing::difference;
using testing::RandomMessages;
using M = Monitoring;
using C = Command;

struct Version {
  bool ios, two, framed;
};
Version version_of(Protocol p) { return {p != Protocol::kSunrise1_11, p >= Protocol::kSunrise2_5, p == Protocol::kSunrise2_7}; }

/// The schema of a version. `repeated`: the option of repeated numbers, "" or "[packed=true]".
std::string schema_of(Protocol p, const std::string& packed) {
  const Version v = version_of(p);
  std::ostringstream s;
  s << "syntax = \"proto2\";\n"
    << "message MessageHeader { required uint32 messageIdentifier = 1; required uint32 sequenceCounter = 2;"
    << " required uint32 reflectedSequenceCounter = 3; }\n"
    << "message JointValues { repeated double value = 1 " << packed << "; }\n"
    << "message CartesianVector { repeated double element = 1 " << packed << "; }\n"
    << "message TimeStamp { required uint32 sec = 1; required uint32 nanosec = 2; }\n"
    << "message ConnectionInfo { required int32 sessionState = 1; required int32 quality = 2; optional uint32 sendPeriod = 3;"
    << " optional uint32 receiveMultiplier = 4; }\n"
    << "message RobotInfo { optional int32 numberOfJoints = 1; optional int32 safetyState = 2; repeated int32 driveState = 5 "
    << packed << "; optional int32 operationMode = 6; optional int32 controlMode = 7; }\n"
    << "message RedundancyInformation { required int32 strategy = 1; required double value = 2; }\n";
  if (v.two) {
    s << "message Pose { required string name = 1; repeated double element = 2 " << packed
      << "; optional TimeStamp timestamp = 3; }\n";
  } else {
    s << "message Pose { required string name = 1; repeated double matrix = 2 " << packed
      << "; optional TimeStamp timestamp = 3; }\n";
  }
  s << "message FriIOValue { required string name = 1; required int32 type = 2; required int32 direction = 3;"
    << " optional uint64 digitalValue = 4; optional double analogValue = 5; }\n"
    << "message MessageMonitorData { optional JointValues measuredJointPosition = 1; optional JointValues measuredTorque = 2;"
    << (v.two ? "" : " optional JointValues commandedJointPosition = 3;")
    << " optional JointValues commandedTorque = 4; optional JointValues externalTorque = 5;"
    << (v.framed ? " optional CartesianVector externalForce = 6;" : "")
    << (v.ios ? " repeated FriIOValue readIORequest = 8;" : "")
    << (v.two ? " optional Pose measuredCartesianPose = 9; optional RedundancyInformation measuredRedundancyInformation = 10;"
              : "")
    << " optional TimeStamp timestamp = 15; }\n"
    << "message MessageIpoData { optional JointValues jointPosition = 1;"
    << (v.two ? " optional Pose cartesianPose = 2; optional RedundancyInformation redundancyInformation = 3;" : "")
    << " optional int32 clientCommandMode = 10; optional int32 overlayType = 11; optional double trackingPerformance = 12; }\n"
    << "message MessageCommandData { optional JointValues jointPosition = 1; optional CartesianVector "
       "cartesianWrenchFeedForward = 2;"
    << " optional JointValues jointTorque = 3; repeated Pose commandedTransformations = 4;"
    << (v.ios ? " repeated FriIOValue writeIORequest = 5;" : "")
    << (v.two ? " optional Pose cartesianPose = 6; optional RedundancyInformation redundancyInformation = 7;" : "") << " }\n"
    << "message FRIMonitoringMessage { required MessageHeader header = 1; optional RobotInfo robotInfo = 2;"
    << " optional MessageMonitorData monitorData = 3; optional ConnectionInfo connectionInfo = 4; optional MessageIpoData "
       "ipoData = 5;"
    << " repeated Pose requestedTransformations = 6; }\n"
    << "message FRICommandMessage { required MessageHeader header = 1; optional MessageCommandData commandData = 2; }\n";
  return s.str();
}

/// Writes the text format of Protocol Buffers.
class Text {
 public:
  explicit Text(Protocol p) : version_(version_of(p)) { text_.precision(17); }

  std::string take() const { return text_.str(); }
  const Version& version() const { return version_; }

  template <class Number>
  void field(const char* name, Number value) {
    text_ << name << ": " << value << "\n";
  }
  void begin(const char* name) { text_ << name << " {\n"; }
  void end() { text_ << "}\n"; }

  void header(std::uint32_t identifier, std::uint32_t counter, std::uint32_t reflected) {
    begin("header");
    field("messageIdentifier", identifier);
    field("sequenceCounter", counter);
    field("reflectedSequenceCounter", reflected);
    end();
  }
  void joints(const char* name, const Joints& values, std::size_t n) {
    begin(name);
    for (std::size_t i = 0; i < n; ++i) field("value", values[i]);
    end();
  }
  void wrench(const char* name, const Wrench& F) {
    begin(name);
    for (const int i : {0, 1, 2, 5, 4, 3}) field("element", F[i]);  // A about z, B about y, C about x
    end();
  }
  void time(std::int64_t t) {
    begin("timestamp");
    field("sec", t / 1'000'000'000);
    field("nanosec", t % 1'000'000'000);
    end();
  }
  void redundancy(const char* name, const Redundancy& r) {
    begin(name);
    field("strategy", r.strategy);
    field("value", r.value);
    end();
  }
  /// Bytes are compared, so that the numbers must have the same bits: those of the codec, which other tests compare.
  void pose(const char* name, const std::string& label, const Pose& X, std::optional<std::int64_t> t = {}) {
    begin(name);
    quoted("name", label);
    if (version_.two) {
      const Eigen::Quaterniond q = Eigen::Quaterniond(X.R).normalized();
      for (int i = 0; i < 3; ++i) field("element", X.p[i] / 1e-3);
      for (const double value : {q.w(), q.x(), q.y(), q.z()}) field("element", value);
    } else {
      for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 3; ++column) field("matrix", X.R(row, column));
        field("matrix", X.p[row] / 1e-3);
      }
    }
    if (t) time(*t);
    end();
  }
  void io(const char* name, const Io& value) {
    begin(name);
    quoted("name", std::string(value.name.view()));
    field("type", static_cast<int>(value.type));
    field("direction", static_cast<int>(value.direction));
    if (value.type == Io::Type::kAnalog) {
      field("analogValue", value.analog);
    } else {
      field("digitalValue", value.digital);
    }
    end();
  }

 private:
  void quoted(const char* name, const std::string& value) {
    std::string escaped;
    for (const char c : value) escaped += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
    text_ << name << ": \"" << escaped << "\"\n";
  }

  Version version_;
  std::ostringstream text_;
};

std::string text_of(Protocol p, const Monitoring& m) {
  Text t(p);
  const std::size_t n = m.joints;
  t.header(0x245142, m.counter, m.reflected);
  t.begin("robotInfo");
  t.field("numberOfJoints", n);
  if (m.has(M::kSafetyState)) t.field("safetyState", static_cast<int>(m.safety));
  for (std::size_t i = 0; i < n && m.has(M::kDriveStates); ++i) t.field("driveState", static_cast<int>(m.drives[i]));
  if (m.has(M::kOperationMode)) t.field("operationMode", static_cast<int>(m.operation));
  if (m.has(M::kControlMode)) t.field("controlMode", static_cast<int>(m.control));
  t.end();
  t.begin("monitorData");
  if (m.has(M::kMeasuredPosition)) t.joints("measuredJointPosition", m.q_measured, n);
  if (m.has(M::kMeasuredTorque)) t.joints("measuredTorque", m.tau_measured, n);
  if (m.has(M::kCommandedPosition)) t.joints("commandedJointPosition", m.q_commanded, n);
  if (m.has(M::kCommandedTorque)) t.joints("commandedTorque", m.tau_commanded, n);
  if (m.has(M::kExternalTorque)) t.joints("externalTorque", m.tau_external, n);
  if (m.has(M::kExternalWrench)) t.wrench("externalForce", m.F_external);
  for (const Io& value : m.ios.all()) t.io("readIORequest", value);
  if (m.has(M::kMeasuredPose)) t.pose("measuredCartesianPose", "", m.X_measured);
  if (m.has(M::kMeasuredRedundancy)) t.redundancy("measuredRedundancyInformation", m.redundancy_measured);
  if (m.has(M::kTime)) t.time(m.time);
  t.end();
  t.begin("connectionInfo");
  t.field("sessionState", static_cast<int>(m.state));
  t.field("quality", static_cast<int>(m.quality));
  t.field("sendPeriod", std::lround(m.send_period * 1e3));
  t.field("receiveMultiplier", m.receive_multiplier);
  t.end();
  if (is_commanding(m.state)) {
    t.begin("ipoData");
    if (m.has(M::kInterpolatorPosition)) t.joints("jointPosition", m.q_interpolator, n);
    if (m.has(M::kInterpolatorPose)) t.pose("cartesianPose", "", m.X_interpolator);
    if (m.has(M::kInterpolatorRedundancy)) t.redundancy("redundancyInformation", m.redundancy_interpolator);
    if (m.has(M::kCommandMode)) t.field("clientCommandMode", static_cast<int>(m.command_mode));
    if (m.has(M::kOverlay)) t.field("overlayType", static_cast<int>(m.overlay));
    if (m.has(M::kTracking)) t.field("trackingPerformance", m.tracking_performance);
    t.end();
  }
  for (const Transformation& x : m.transformations.all()) {
    t.pose("requestedTransformations", std::string(x.name.view()), x.pose, x.time);
  }
  return t.take();
}

std::string text_of(Protocol p, const Command& c) {
  Text t(p);
  t.header(0x34001, c.counter, c.reflected);
  t.begin("commandData");
  if (c.has(C::kPosition)) t.joints("jointPosition", c.q, c.joints);
  if (c.has(C::kWrench)) t.wrench("cartesianWrenchFeedForward", c.F);
  if (c.has(C::kTorque)) t.joints("jointTorque", c.tau, c.joints);
  for (const Transformation& x : c.transformations.all()) {
    t.pose("commandedTransformations", std::string(x.name.view()), x.pose, x.time);
  }
  for (const Io& value : c.ios.all()) t.io("writeIORequest", value);
  if (c.has(C::kPose)) t.pose("cartesianPose", "", c.X);
  if (c.has(C::kRedundancy)) t.redundancy("redundancyInformation", c.redundancy);
  t.end();
  return t.take();
}

Bytes without_frame(Protocol p, const Bytes& bytes) {
  return version_of(p).framed ? Bytes(bytes.begin() + 4, bytes.end() - 4) : bytes;
}

class FriProtobuf : public ::testing::TestWithParam<Protocol> {
 protected:
  void SetUp() override {
    if (testing::run_command({"sh", "-c", "command -v protoc"}).code != 0) GTEST_SKIP() << "protoc is not installed";
  }
  Bytes third_party(const std::string& schema, const char* message, const std::string& text) {
    const testing::TemporaryFolder folder("fri");
    folder.write("fri.proto", schema);
    folder.write("in.txt", text);
    const testing::RunResult done = testing::run_command(
        {"sh", "-c", std::string("protoc --encode=") + message + " fri.proto < in.txt > out.bin"}, {.folder = folder.path()});
    EXPECT_EQ(done.code, 0) << done.err << text;
    const std::string bytes = testing::content(folder / "out.bin");
    return {bytes.begin(), bytes.end()};
  }
};

TEST_P(FriProtobuf, HasTheSameBytesAsGooglesImplementation) {
  const Protocol p = GetParam();
  for (std::uint32_t seed = 0; seed < 3; ++seed) {
    RandomMessages random(p, 7, 100 + seed);
    Monitoring m = random.monitoring();
    if (seed == 0) {  // a message with everything
      m.state = SessionState::kCommandingActive;
      m.fields = testing::monitoring_fields(p, m.state);
    }
    Command c = random.command();
    if (seed == 0) c.fields = testing::command_fields(p);
    *c.transformations.add() = random.transformation();  // commandData is not empty
    const std::string schema = schema_of(p, "");
    EXPECT_EQ(testing::hex_of(without_frame(p, testing::encoded(p, m))),
              testing::hex_of(third_party(schema, "FRIMonitoringMessage", text_of(p, m))));
    EXPECT_EQ(testing::hex_of(without_frame(p, testing::encoded(p, c))),
              testing::hex_of(third_party(schema, "FRICommandMessage", text_of(p, c))));
  }
}

TEST_P(FriProtobuf, ReadsThePackedNumbersOfGooglesImplementation) {
  const Protocol p = GetParam();
  RandomMessages random(p, 7, 200);
  Monitoring m = random.monitoring(), out;
  m.fields = testing::monitoring_fields(p, m.state);
  const Bytes bytes = third_party(schema_of(p, "[packed=true]"), "FRIMonitoringMessage", text_of(p, m));
  EXPECT_LT(bytes.size(), testing::encoded(p, m).size());
  // The frame of 2.7 has tests of its own; its message without a frame is read as one of 2.5, which skips the wrench.
  const Protocol reader = version_of(p).framed ? Protocol::kSunrise2_5 : p;
  ASSERT_EQ(decode(reader, bytes, 7, out), Fault::kNone);
  if (reader != p) m.fields &= ~std::uint32_t{M::kExternalWrench};
  EXPECT_EQ(difference(reader, m, out), "");
}

INSTANTIATE_TEST_SUITE_P(Versions, FriProtobuf,
                         ::testing::Values(Protocol::kSunrise1_11, Protocol::kSunrise1_15, Protocol::kSunrise2_5,
                                           Protocol::kSunrise2_7),
                         [](const auto& information) {
                           std::string name = to_text(information.param);
                           for (char& c : name) c = c == '-' || c == '.' ? '_' : c;
                           return name;
                         });

}  // namespace
}  // namespace cotwin::protoc_test
