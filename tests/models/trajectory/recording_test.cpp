#include "models/trajectory/series/recording.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"

namespace cotwin::trajectory::recording_test {
namespace {

using cotwin::testing::TemporaryFile;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

Recording load(const std::string& text, std::span<const Axis> axes, const RecordingFormat& format = {}) {
  const TemporaryFile file(text);
  return load_recording(file.path(), axes, format);
}

std::string error_of(const std::string& text, std::span<const Axis> axes, const RecordingFormat& format = {}) {
  const TemporaryFile file(text);
  try {
    load_recording(file.path(), axes, format);
  } catch (const Error& e) {
    std::string message = e.what();
    for (std::size_t at; (at = message.find(file.path())) != std::string::npos;) {
      message.replace(at, file.path().size(), "file.csv");
    }
    return message;
  }
  return "no error";
}

TEST(Recording, ColumnsAreFoundUnderTheirUsualNames) {
  std::vector<Axis> axes = free_axes(2);
  axes[0].name = "shoulder";
  axes[1].name = "elbow";
  for (const char* header : {"t,q1,q2", "time,q0,q1", "Timestamp,q_1,q_2", "t,q[1],q[2]", "t,actual_q_0,actual_q_1",
                             "t,shoulder,elbow", "t,position_shoulder,position_elbow", "t,shoulder_position,elbow_position"}) {
    const Recording r = load(std::string(header) + "\n5,1,2\n6,3,4\n", axes);
    EXPECT_THAT(r.q.t, ElementsAre(0, 1)) << header;
    EXPECT_THAT(r.q.x, ElementsAre(1, 2, 3, 4)) << header;
    EXPECT_EQ(r.tau.size(), 0u);
    EXPECT_THAT(r.lines, ElementsAre(2, 3));
  }
}

TEST(Recording, ColumnsAreChosenByListsAndPatternsAndScaledToSi) {
  std::vector<Axis> axes = free_axes(2);
  axes[0].name = "a";
  axes[1].name = "b";
  axes[1].revolute = false;  // m, not degrees
  RecordingFormat format;
  format.t_unit = 1e-3;
  format.t_column = "clock";
  format.q_columns = "x act, y act";
  format.dq_columns = "v{name}";
  format.tau_columns = "i{0}";
  format.tau_e_columns = "none";
  format.angle_unit = std::numbers::pi / 180;
  format.q_scale = {-1, 1};
  format.q_offset = {0.5, 0};
  format.tau_scale = {-100, 160};
  const Recording r =
      load("y act,clock,x act,vb,va,i0,i1,tau_e1,tau_e2\n0.1,10,90,0.3,180,1,2,9,9\n0.2,20,90,0.4,0,3,4,9,9\n", axes, format);
  const double pi = std::numbers::pi;
  EXPECT_NEAR(r.q.t[1], 0.01, 1e-15);
  EXPECT_THAT(r.q.x, ElementsAre(0.5 - pi / 2, 0.1, 0.5 - pi / 2, 0.2));
  EXPECT_THAT(r.dq.x, ElementsAre(-pi, 0.3, 0, 0.4));
  EXPECT_THAT(r.tau.x, ElementsAre(-100, 320, -300, 640));
  EXPECT_EQ(r.tau_e.size(), 0u);
}

TEST(Recording, WithoutAColumnOfTimeSamplesFollowAtTheGivenRate) {
  RecordingFormat format;
  format.rate = 250;
  EXPECT_THAT(load("q1\n0\n0.01\n0.02\n", free_axes(1), format).q.t, ElementsAre(0, 0.004, 0.008));
  EXPECT_THAT(error_of("q1\n0\n0.01\n", free_axes(1)), HasSubstr("has no column 't', 'time' or 'timestamp', expected one"));
}

TEST(Recording, EpochsInNanosecondsKeepTheirDifferences) {
  RecordingFormat format;
  format.t_unit = 1e-9;
  const Recording r = load("t,q1\n1700000000000000000,0\n1700000000001000000,0\n1700000000002000000,0\n", free_axes(1), format);
  EXPECT_NEAR(r.q.t[2], 0.002, 3e-7);  // a double holds 1.7e18 to 256 ns
}

TEST(Recording, ErrorsInARowNameItsLineAndColumn) {
  const auto axes = free_axes(1);
  EXPECT_EQ(error_of("t,q1\n0,0\n1,nan\n", axes), "file.csv:3: column 'q1': nan, expected a finite number");
  EXPECT_EQ(error_of("t,q1\n0,0\n1,\n", axes), "file.csv:3: column 'q1': empty, expected a number");
  EXPECT_EQ(error_of("t,q1,tau1\n0,0,1\n1,0,inf\n", axes), "file.csv:3: column 'tau1': inf, expected a finite number");
  EXPECT_EQ(error_of("t,q1\n0,0\nnan,0\n", axes), "file.csv:3: column 't': nan, expected a finite number");
  EXPECT_EQ(error_of("t,q1\n0,0\n2,0\n# remark\n1,0\n", axes),
            "file.csv:5: column 't': 1 is before the time on line 3, expected increasing time");
  EXPECT_EQ(error_of("t,q1\n0,0\n2,0\n2,0\n", axes),
            "file.csv:4: column 't': 2, the same time as on line 3, expected a later one");
  EXPECT_EQ(error_of("t,q1\n0,0\n1,0\n2,0\n9,0\n10,0\n", axes),
            "file.csv:5: a gap: 7 s after the sample on line 4, expected at most 5 s (max_gap, 5 median steps)");
}

TEST(Recording, GapsMayBeAllowed) {
  RecordingFormat format;
  format.max_gap = 7;
  EXPECT_EQ(error_of("t,q1\n0,0\n1,0\n2,0\n9,0\n10,0\n", free_axes(1), format), "no error");
}

TEST(Recording, ColumnsThatAreNotOnePerJointAreErrors) {
  EXPECT_EQ(error_of("t,q1,q2\n0,0,0\n1,0,0\n", free_axes(3)),
            "file.csv: has columns 'q1' to 'q2' of q, expected 3, one per joint; select columns by a list of names");
  EXPECT_EQ(error_of("t,q1,q2\n0,0,0\n1,0,0\n", free_axes(1)),
            "file.csv: has columns 'q1' to 'q2' of q, expected 1, one per joint; select columns by a list of names");
  RecordingFormat format;
  format.q_columns = "q2";
  EXPECT_THAT(load("t,q1,q2\n0,0,5\n1,0,6\n", free_axes(1), format).q.x, ElementsAre(5, 6));
  EXPECT_EQ(error_of("t,q1,q2\n0,0,0\n1,0,0\n", free_axes(2), format),
            "file.csv: 1 columns given for q ('q2'), expected 2, one per joint");
  EXPECT_THAT(error_of("t,q1,q2,tau1\n0,0,0,1\n1,0,0,1\n", free_axes(2)),
              HasSubstr("has columns 'tau1' to 'tau1' of tau, expected 2"));
  EXPECT_EQ(
      error_of("t,x,y\n0,0,0\n1,0,0\n", free_axes(2)),
      "file.csv: has no columns of joint positions, expected 'q1', 'q2', … or their names in q_columns (cotwin tune and ask: "
      "--q-columns); columns of the table: 't', 'x', 'y'");
  std::string wide = "t";
  for (int i = 0; i < 30; ++i) wide += std::string(",") + static_cast<char>('a' + i % 26) + (i < 26 ? "x" : "y");
  EXPECT_THAT(error_of(wide + "\n", free_axes(2)), HasSubstr("'rx', 'sx', …"));
  EXPECT_THAT(error_of("time,pos1,pos2,current_0,current_1\n0,0,0,0,0\n1,0,0,0,0\n", free_axes(2)),
              HasSubstr("numbered columns of the table: 'pos{}', 'current_{0}'"));
  format.q_columns = "x,z";
  EXPECT_EQ(error_of("t,x,y\n0,0,0\n1,0,0\n", free_axes(2), format), "file.csv: has no column 'z', did you mean 't'?");
  EXPECT_EQ(error_of("t,q1\n0,0\n", free_axes(1)), "file.csv: holds 1 samples, expected at least two");
}

TEST(Recording, DegreesTakenForRadiansAreNoticed) {
  // ±40° at 0.5 Hz: 126°/s. In radians this is faster than a joint can be.
  std::ostringstream fast, slow;
  fast << "t,q1\n";
  slow << "t,q1\n";
  for (int k = 0; k <= 100; ++k) {
    const double t = k * 0.01;
    fast << t << "," << 40 * std::sin(std::numbers::pi * t) << "\n";
    slow << t << "," << 40 + t << "\n";
  }
  std::vector<Axis> axes = free_axes(1);
  EXPECT_THAT(error_of(fast.str(), axes), HasSubstr("file.csv:3: column 'q1': joint 1 would have moved with 125.6"));
  EXPECT_THAT(error_of(fast.str(), axes), HasSubstr("are these degrees? Then angle = deg"));
  EXPECT_EQ(error_of(slow.str(), axes), "no error");  // the joint has no known limits
  axes[0].q_min = -2.9;
  axes[0].q_max = 2.9;
  EXPECT_EQ(
      error_of(slow.str(), axes),
      "file.csv:2: column 'q1': joint 1 would be at 40 rad, expected -2.9 to 2.9 rad; are these degrees? Then angle = deg");
  RecordingFormat degrees;
  degrees.angle_unit = std::numbers::pi / 180;
  EXPECT_EQ(error_of(fast.str(), axes, degrees), "no error");
  EXPECT_EQ(error_of(slow.str(), axes, degrees), "no error");
}

// Data of real robots. The assertions are properties that follow from the measurements themselves.
class RealRecording : public ::testing::Test {
 protected:
  /// A log; the empty path, if it is not there.
  static std::string log(const std::string& name) {
    const std::string file = places::public_data("measurements/" + name);
    return std::filesystem::exists(file) ? file : "";
  }
  /// RMS of measured minus derived velocity, over RMS of the measured one, per joint.
  std::vector<double> velocity_mismatch(const Recording& r, const Series& q) const {
    const Path path = interpolate(q);
    const std::size_t n = q.width;
    std::vector<double> position(n), dq(n), ddq(n), mismatch(n), size(n);
    for (std::size_t k = 0; k < r.dq.size(); ++k) {
      path.at(r.dq.t[k], position, dq, ddq);
      for (std::size_t j = 0; j < n; ++j) {
        mismatch[j] += std::pow(r.dq.x[k * n + j] - dq[j], 2);
        size[j] += std::pow(r.dq.x[k * n + j], 2);
      }
    }
    for (std::size_t j = 0; j < n; ++j) mismatch[j] = std::sqrt(mismatch[j] / size[j]);
    return mismatch;
  }
};

TEST_F(RealRecording, Ur10VelocitiesAreTheDerivativesOfItsPositions) {
  if (log("ur10_unisa.csv").empty()) GTEST_SKIP() << "needs ur10_unisa.csv (examples/public_data.md)";
  const Recording r = load_recording(log("ur10_unisa.csv"), free_axes(6));
  EXPECT_EQ(r.q.size(), 3441u);
  EXPECT_EQ(r.tau.size(), 3441u);
  EXPECT_NEAR(median_step(r.q.t), 0.008, 1e-6);
  for (const double mismatch : velocity_mismatch(r, r.q)) EXPECT_LT(mismatch, 0.05);
}

TEST_F(RealRecording, SmoothedPandaVelocitiesLieWithinTheNoiseOfTheMeasuredOnes) {
  if (log("panda_unisa.csv").empty()) GTEST_SKIP() << "needs panda_unisa.csv (examples/public_data.md)";
  const Recording r = load_recording(log("panda_unisa.csv"), free_axes(7));
  EXPECT_EQ(r.q.size(), 727u);
  EXPECT_NEAR(median_step(r.q.t), 1 / 30.0, 1e-3);
  for (const double mismatch : velocity_mismatch(r, smooth(r.q, 4, 2))) EXPECT_LT(mismatch, 0.5);
}

TEST_F(RealRecording, Kr300LinkAndMotorSidesAreReadByName) {
  if (log("kr300_A.csv").empty()) GTEST_SKIP() << "needs kr300_A.csv (examples/public_data.md)";
  RecordingFormat motor;
  motor.q_columns = "qmot{}";
  motor.dq_columns = "qdmot{}";
  const Recording link = load_recording(log("kr300_A.csv"), free_axes(6));
  const Recording drive = load_recording(log("kr300_A.csv"), free_axes(6), motor);
  EXPECT_EQ(link.q.size(), 2501u);
  for (std::size_t k = 0; k < link.q.size(); ++k) {
    for (std::size_t j = 0; j < 3; ++j)
      ASSERT_NEAR(link.q.x[k * 6 + j], drive.q.x[k * 6 + j], 0.01);  // a stiff gear between them
  }
}

}  // namespace
}  // namespace cotwin::trajectory::recording_test
