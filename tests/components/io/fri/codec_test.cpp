// Codecs of FRI against bytes of real clients and controllers (KUKA's SDKs, captured on loopback), against a second description of
// the layouts, and with damaged datagrams.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <span>
#include <string>

#include "components/io/fri/crc.h"
#include "components/io/fri/lwr.h"
#include "components/io/fri/sunrise.h"
#include "models/foundation/support/error.h"
#include "tests/components/io/fri/messages.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::codec_test {
namespace {

using namespace fri;
using testing::Bytes;
using testing::bytes_of;
using testing::difference;
using testing::encoded;
using testing::hex_of;
using testing::RandomMessages;
using M = Monitoring;
using C = Command;

std::string repeated(const std::string& text, int n) {
  std::string all;
  for (int i = 0; i < n; ++i) all += text;
  return all;
}

std::string part(const Bytes& bytes, std::size_t from, std::size_t size) {
  return hex_of(std::span(bytes).subspan(from, size));
}

template <class T>
T value_at(const Bytes& bytes, std::size_t offset) {
  T value{};
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

TEST(FriLwr, WritesTheBytesOfTheWorkedExample) {
  Monitoring m;
  m.joints = 7;
  m.counter = 5;
  m.reflected = 4;
  m.state = SessionState::kCommandingActive;
  m.quality = Quality::kExcellent;
  m.send_period = 0.005;
  const Bytes msr = encoded(Protocol::kLwr, m);
  ASSERT_EQ(msr.size(), 916u);
  EXPECT_EQ(part(msr, 0, 8), "0500040094030620");
  EXPECT_EQ(part(msr, 144, 4), "02000300");
  EXPECT_EQ(part(msr, 148, 4), "0ad7a33b");

  Command c;
  c.joints = 7;
  c.reflected = 5;
  c.fields = C::kPosition;
  c.q[0] = 0.1;
  const Bytes cmd = encoded(Protocol::kLwr, c);
  ASSERT_EQ(cmd.size(), 376u);
  EXPECT_EQ(part(cmd, 2, 6), "050078010510");
  EXPECT_EQ(part(cmd, 140, 8), "01000000cdcccc3d");
  EXPECT_EQ(value_at<std::uint32_t>(bytes_of("db0f4940"), 0), 0x40490fdbu);  // the byte order test of KUKA's client
}

// Each quantity gets a number of its own and must be at the offset of the table, and nothing else may be there.
TEST(FriLwr, HasEachQuantityAtItsOffset) {
  Monitoring m;
  m.joints = 7;
  m.state = SessionState::kMonitoringReady;
  m.quality = Quality::kGood;
  m.krl.real[15] = 1.5f;
  m.krl.integer[0] = -2;
  m.krl.boolean = 0x8001;
  m.time = 2'500'000'000;
  m.command_period = 0.25;
  m.safety_factor = 0.5;
  m.answer_rate = 0.75;
  m.latency = 0.125;
  m.jitter = 0.0625;
  m.miss_rate = 0.03125;
  m.misses = 77;
  m.drives[6] = DriveState::kActive;
  m.drives[0] = DriveState::kActive;
  m.control = ControlMode::kJointImpedance;
  m.errors = 3;
  m.warnings = 4;
  for (std::size_t i = 0; i < 7; ++i) {
    const double k = static_cast<double>(i);
    m.temperature[i] = 30 + k;
    m.q_measured[i] = 40 + k;
    m.q_interpolator[i] = 50 + k;
    m.q_commanded[i] = 110 + 2 * k;  // the offset of FRI: 60 + k
    m.tau_measured[i] = 70 + k;
    m.tau_external[i] = 80 + k;
    m.gravity[i] = 90 + k;
  }
  for (int i = 0; i < 6; ++i) m.F_external[i] = 100 + i;
  for (std::size_t i = 0; i < 42; ++i) m.jacobian[i] = 200 + static_cast<double>(i);
  for (std::size_t i = 0; i < 49; ++i) m.mass[i] = 300 + static_cast<double>(i);
  m.X_measured.R << 1, 2, 3, 5, 6, 7, 9, 10, 11;
  m.X_measured.p << 4, 8, 12;
  const Bytes b = encoded(Protocol::kLwr, m);
  const auto f = [&](std::size_t offset) { return value_at<float>(b, offset); };
  const auto u16 = [&](std::size_t offset) { return value_at<std::uint16_t>(b, offset); };
  EXPECT_EQ(f(8 + 60), 1.5f);
  EXPECT_EQ(value_at<std::int32_t>(b, 8 + 64), -2);
  EXPECT_EQ(u16(8 + 128), 0x8001);
  EXPECT_EQ(f(140), 2.5f);
  EXPECT_EQ(u16(144), 1);
  EXPECT_EQ(u16(146), 2);
  EXPECT_EQ(f(152), 0.25f);
  EXPECT_EQ(f(156), 0.5f);
  EXPECT_EQ(f(160), 0.75f);
  EXPECT_EQ(f(164), 0.125f);
  EXPECT_EQ(f(168), 0.0625f);
  EXPECT_EQ(f(172), 0.03125f);
  EXPECT_EQ(value_at<std::uint32_t>(b, 176), 77u);
  EXPECT_EQ(u16(180), 0x41);
  EXPECT_EQ(u16(182), 3);
  EXPECT_EQ(u16(184), 3);
  EXPECT_EQ(u16(186), 4);
  for (std::size_t i = 0; i < 7; ++i) {
    const auto k = static_cast<float>(i);
    EXPECT_EQ(f(188 + 4 * i), 30 + k);
    EXPECT_EQ(f(216 + 4 * i), 40 + k);
    EXPECT_EQ(f(292 + 4 * i), 50 + k);
    EXPECT_EQ(f(320 + 4 * i), 60 + k);
    EXPECT_EQ(f(444 + 4 * i), 70 + k);
    EXPECT_EQ(f(472 + 4 * i), 80 + k);
    EXPECT_EQ(f(888 + 4 * i), 90 + k);
  }
  for (std::size_t i = 0; i < 12; ++i) EXPECT_EQ(f(244 + 4 * i), 1 + static_cast<float>(i));
  // Fx Fy Fz Tz Ty Tx, and rows of the Jacobian X Y Z RZ RY RX.
  const std::size_t order[] = {0, 1, 2, 5, 4, 3};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(f(500 + 4 * i), 100 + static_cast<float>(order[i]));
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t j = 0; j < 7; ++j) EXPECT_EQ(f(524 + 4 * (7 * row + j)), 200 + static_cast<float>(7 * order[row] + j));
  }
  for (std::size_t i = 0; i < 49; ++i) EXPECT_EQ(f(692 + 4 * i), 300 + static_cast<float>(i));

  Command c;
  c.joints = 7;
  c.fields = testing::command_fields(Protocol::kLwr);
  for (int i = 0; i < 6; ++i) {
    c.F[i] = 10 + i;
    c.cartesian_stiffness[i] = 20 + i;
    c.cartesian_damping[i] = 30 + i;
  }
  for (std::size_t i = 0; i < 7; ++i) {
    const double k = static_cast<double>(i);
    c.q[i] = 40 + k;
    c.tau[i] = 50 + k;
    c.joint_stiffness[i] = 60 + k;
    c.joint_damping[i] = 70 + k;
  }
  c.X.p << 7, 8, 9;
  const Bytes d = encoded(Protocol::kLwr, c);
  EXPECT_EQ(value_at<std::uint32_t>(d, 140), 0x3535u);
  EXPECT_EQ(value_at<float>(d, 172 + 12), 7.0f);
  EXPECT_EQ(value_at<float>(d, 172 + 44), 9.0f);
  for (std::size_t i = 0; i < 7; ++i) {
    const auto k = static_cast<float>(i);
    EXPECT_EQ(value_at<float>(d, 144 + 4 * i), 40 + k);
    EXPECT_EQ(value_at<float>(d, 220 + 4 * i), 50 + k);
    EXPECT_EQ(value_at<float>(d, 272 + 4 * i), 60 + k);
    EXPECT_EQ(value_at<float>(d, 300 + 4 * i), 70 + k);
  }
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(value_at<float>(d, 248 + 4 * i), 10 + static_cast<float>(order[i]));
    EXPECT_EQ(value_at<float>(d, 328 + 4 * i), 20 + static_cast<float>(order[i]));
    EXPECT_EQ(value_at<float>(d, 352 + 4 * i), 30 + static_cast<float>(order[i]));
  }
}

TEST(FriLwr, RefusesOtherDatagramsWithTheReason) {
  Monitoring m;
  m.joints = 7;
  m.state = SessionState::kMonitoringReady;
  const Bytes good = encoded(Protocol::kLwr, m);
  Monitoring out;
  const auto fault = [&](Bytes b) { return decode(Protocol::kLwr, b, 7, out); };
  EXPECT_EQ(fault(good), Fault::kNone);
  EXPECT_EQ(fault({}), Fault::kSize);
  EXPECT_EQ(fault(Bytes(good.begin(), good.end() - 1)), Fault::kSize);
  Bytes longer = good;
  longer.push_back(0);
  EXPECT_EQ(fault(longer), Fault::kSize);
  Bytes other = good;
  other[6] = 0x05;
  EXPECT_EQ(fault(other), Fault::kIdentifier);
  other = good;
  other[4] = 0x95;  // packetSize
  EXPECT_EQ(fault(other), Fault::kSize);
  other = good;
  other[144] = other[145] = 0xff;  // state: invalid
  EXPECT_EQ(fault(other), Fault::kValue);
  other = good;
  other[146] = 4;  // quality
  EXPECT_EQ(fault(other), Fault::kValue);
  Command c;
  EXPECT_EQ(decode(Protocol::kLwr, good, 7, c), Fault::kSize);
}

TEST(FriLwr, SaysThatItNeedsSevenJoints) {
  EXPECT_NO_THROW(check_joints(Protocol::kLwr, 7, "io"));
  EXPECT_EQ(testing::error_of([] { check_joints(Protocol::kLwr, 6, "io.robot"); }),
            "io.robot: protocol lwr with 6 joints, expected 7");
  EXPECT_EQ(testing::error_of([] { check_joints(Protocol::kSunrise1_15, 25, "io.robot"); }),
            "io.robot: protocol sunrise-1.15 with 25 joints, expected 1 to 24");
  EXPECT_THAT(testing::error_of([] { protocol_of("sunrise", "io.protocol"); }), ::testing::HasSubstr("sunrise-2.7"));
  for (const Protocol p : kProtocols) EXPECT_EQ(protocol_of(to_text(p), ""), p);
  Monitoring m;
  m.joints = 6;
  m.state = SessionState::kMonitoringReady;
  Bytes bytes(1500);
  EXPECT_EQ(encode(Protocol::kLwr, m, bytes), 0u);
}

/// The monitoring message that a client of SDK 1.15 accepted: MONITORING_WAIT, all positions 0, all torques 0.5 N.m.
Monitoring captured_monitoring() {
  Monitoring m;
  m.counter = 1;
  m.joints = 7;
  m.state = SessionState::kMonitoringWait;
  m.quality = Quality::kExcellent;
  m.send_period = 0.005;
  m.operation = OperationMode::kAutomatic;
  m.tau_measured.fill(0.5);
  m.time = 1'700'000'000'250'000'000;
  m.fields = testing::monitoring_fields(Protocol::kSunrise1_15, m.state);
  return m;
}

TEST(FriSunrise, WritesTheBytesOfTheCapturedMessages) {
  const std::string zeros = repeated("09 0000000000000000", 7), halves = repeated("09 000000000000e03f", 7);
  const std::string head =
      "0a 09 | 08 c2a29101 | 10 01 | 18 00 | 12 16 | 08 07 | 10 00 |" + repeated("28 00", 7) + "30 02 | 38 00";
  const std::string data = "1a d202 0a 3f" + zeros + "12 3f" + halves + "1a 3f" + zeros + "22 3f" + zeros + "2a 3f" + zeros +
                           "7a 0b 08 80e2cfaa06 10 80e59a77";
  Monitoring m = captured_monitoring();
  const Bytes monitoring = bytes_of(head + data + "22 08 08 01 10 03 18 05 20 01");
  ASSERT_EQ(monitoring.size(), 386u);
  EXPECT_EQ(hex_of(encoded(Protocol::kSunrise1_15, m)), hex_of(monitoring));

  m.state = SessionState::kCommandingActive;
  m.fields = testing::monitoring_fields(Protocol::kSunrise1_15, m.state);
  m.command_mode = ClientCommandMode::kPosition;
  m.overlay = OverlayType::kJoint;
  m.tracking_performance = 1;
  const Bytes active =
      bytes_of(head + data + "22 08 08 04 10 03 18 05 20 01 | 2a 4e 0a 3f" + zeros + "50 01 58 01 61 000000000000f03f");
  ASSERT_EQ(active.size(), 466u);  // the capture has 468: its two counters were above 127
  EXPECT_EQ(hex_of(encoded(Protocol::kSunrise1_15, m)), hex_of(active));

  Command c;
  c.joints = 7;
  c.reflected = 1;
  c.fields = C::kPosition;
  c.q.fill(0.1);
  const Bytes command = bytes_of("0a 08 | 08 81800d | 10 00 | 18 01 | 12 41 | 0a 3f" + repeated("09 9a9999999999b93f", 7));
  ASSERT_EQ(command.size(), 77u);
  EXPECT_EQ(hex_of(encoded(Protocol::kSunrise1_15, c)), hex_of(command));

  // Clients of 2.x send the header alone in the monitoring states: 10 bytes, and 18 with the frame of 2.7.
  c.fields = 0;
  EXPECT_EQ(hex_of(encoded(Protocol::kSunrise2_5, c)), hex_of(bytes_of("0a 08 08 81800d 10 00 18 01")));
  const Bytes framed = encoded(Protocol::kSunrise2_7, c);
  ASSERT_EQ(framed.size(), 18u);
  EXPECT_EQ(part(framed, 0, 4), "0a000000");
  EXPECT_EQ(value_at<std::uint32_t>(framed, 14), crc32(std::span(framed).subspan(4, 10)));
}

TEST(FriSunrise, HasTheChecksumOfZlib) {
  // The check value of CRC-32/ISO-HDLC, and of whole and broken words.
  const std::string digits = "123456789";
  const std::span<const std::uint8_t> all(reinterpret_cast<const std::uint8_t*>(digits.data()), digits.size());
  EXPECT_EQ(crc32(all), 0xcbf43926u);
  EXPECT_EQ(crc32(all.first(8)), 0x9ae0daafu);
  EXPECT_EQ(crc32(all.first(1)), 0x83dcefb7u);
  EXPECT_EQ(crc32({}), 0u);
}

TEST(FriSunrise, ReadsPackedAndUnpackedNumbersAndSkipsUnknownFields) {
  Command c;
  // Fields 9 (fixed32), 8 (varint), 14 (length) and 11 (fixed64) are unknown, at both levels.
  const std::string unknown = "4d 01020304 | 40 ff01 | 72 02 abcd | 59 0000000000000000";
  const std::string packed = "0a 12 0a 10 000000000000e03f 000000000000f03f";
  const Bytes bytes = bytes_of("0a 08 08 81800d 10 02 18 01" + unknown + "12 29" + unknown + packed);
  ASSERT_EQ(decode(Protocol::kSunrise1_15, bytes, 2, c), Fault::kNone);
  EXPECT_EQ(c.fields, C::kPosition);
  EXPECT_EQ(c.q[0], 0.5);
  EXPECT_EQ(c.q[1], 1.0);
  // Packed drive states, too.
  Monitoring m;
  const Bytes drives = bytes_of("0a 09 08 c2a29101 10 01 18 00 | 12 04 2a 02 02 01 | 22 04 08 01 10 03");
  ASSERT_EQ(decode(Protocol::kSunrise1_15, drives, 2, m), Fault::kNone);
  EXPECT_EQ(m.drives[0], DriveState::kActive);
  EXPECT_EQ(m.drives[1], DriveState::kTransitioning);
}

TEST(FriSunrise, RefusesOtherDatagramsWithTheReason) {
  Command c;
  const auto fault = [&](const std::string& hex) { return decode(Protocol::kSunrise1_15, bytes_of(hex), 1, c); };
  const std::string header = "0a 08 08 81800d 10 02 18 01";
  EXPECT_EQ(fault(header), Fault::kNone);
  EXPECT_EQ(fault(""), Fault::kMissing);
  EXPECT_EQ(fault("0a 06 08 81800d 10 02"), Fault::kMissing);  // no reflected counter
  EXPECT_EQ(fault("0a 08 08 82800d 10 02 18 01"), Fault::kIdentifier);
  EXPECT_EQ(fault("0a 09 08 81800d 10 02 18 01"), Fault::kTruncated);  // longer than the datagram
  EXPECT_EQ(fault(header + "12 0b 0a 09 09 0000000000000000"), Fault::kNone);
  EXPECT_EQ(fault(header + "12 0b 0a 09 09 00000000000000"), Fault::kTruncated);
  EXPECT_EQ(fault(header + "12 14 0a 12" + repeated("09 0000000000000000", 2)), Fault::kCount);  // two joints
  EXPECT_EQ(fault(header + "12 03 0a 01 09"), Fault::kTruncated);                                // key without a value
  EXPECT_EQ(fault(header + "12 04 0a 02 08 01"), Fault::kWireType);                              // a double as varint
  EXPECT_EQ(fault(header + "02 00"), Fault::kWireType);                                          // field 0
  EXPECT_EQ(fault(header + "4b 4c"), Fault::kWireType);                                          // a group
  EXPECT_EQ(fault(header + "40 ffffffffffffffffff01"), Fault::kNone);                            // 64 bits
  EXPECT_EQ(fault(header + "40 ffffffffffffffffff02"), Fault::kWireType);                        // more
  EXPECT_EQ(fault(header + "72 ffffffffffffffffff01"), Fault::kTruncated);                       // a length that would wrap
  EXPECT_EQ(fault(header + "12 07 2a 05 0a 01 41 10 00"), Fault::kMissing);          // an I/O value without direction
  EXPECT_EQ(fault(header + "12 09 2a 07 0a 01 41 10 05 18 00"), Fault::kMissing);    // of an unknown type
  std::string long_name = "12 48 2a 46 0a 40" + repeated("41", 64) + "10 00 18 00";  // 64 characters
  EXPECT_EQ(fault(header + long_name), Fault::kCount);
  EXPECT_EQ(fault(header + "12 63" + repeated("2a 07 0a 01 41 10 00 18 00", 11)), Fault::kCount);  // 11 I/O values

  Monitoring m;
  const auto monitoring = [&](const std::string& hex) { return decode(Protocol::kSunrise1_15, bytes_of(hex), 1, m); };
  const std::string head = "0a 09 08 c2a29101 10 01 18 00";
  EXPECT_EQ(monitoring(head + "22 04 08 01 10 03"), Fault::kNone);
  EXPECT_EQ(monitoring(head), Fault::kMissing);
  EXPECT_EQ(monitoring(head + "22 04 08 05 10 03"), Fault::kValue);  // session state 5
  EXPECT_EQ(monitoring(head + "22 04 08 01 10 04"), Fault::kValue);  // quality 4
  EXPECT_EQ(monitoring(head + "22 04 08 01 10 03 12 02 08 07"), Fault::kCount);

  Bytes framed(64);
  Command out;
  out.joints = 1;
  framed.resize(encode(Protocol::kSunrise2_7, out, framed));
  const auto of_frame = [&](const Bytes& b) { return decode(Protocol::kSunrise2_7, b, 1, c); };
  EXPECT_EQ(of_frame(framed), Fault::kNone);
  for (std::size_t bit = 0; bit < 8 * framed.size(); ++bit) {  // the length, the message or the checksum is wrong
    Bytes damaged = framed;
    damaged[bit / 8] = static_cast<std::uint8_t>(damaged[bit / 8] ^ 1u << bit % 8);
    EXPECT_EQ(of_frame(damaged), bit < 32 ? Fault::kSize : Fault::kChecksum);
  }
  EXPECT_EQ(of_frame(Bytes(7)), Fault::kSize);
}

TEST(FriSunrise, HasTheFieldsOfEachVersion) {
  for (const Protocol p : kProtocols) {
    if (p == Protocol::kLwr) continue;
    RandomMessages random(p, 7, 1);
    Monitoring m = random.monitoring();
    m.fields = 0xffffffff;
    m.state = SessionState::kCommandingActive;
    m.ios.count = 1;
    m.transformations.count = 0;
    Monitoring out;
    ASSERT_EQ(decode(p, encoded(p, m), 7, out), Fault::kNone);
    EXPECT_EQ(out.fields, testing::monitoring_fields(p, m.state)) << to_text(p);
    EXPECT_EQ(out.ios.count, p == Protocol::kSunrise1_11 ? 0u : 1u);
  }
}

// A quarter turn about x has w = x = √½; KUKA writes x y z qw qx qy qz, in mm.
TEST(FriSunrise, WritesPosesOfVersion2AsPositionAndQuaternion) {
  Command c;
  c.joints = 7;
  c.fields = C::kPose;
  c.X.R = rotation_from_rpy(std::acos(0.0), 0, 0);
  c.X.p << 0.25, 0.5, 1;
  const Bytes bytes = encoded(Protocol::kSunrise2_5, c);
  const double expected[] = {250, 500, 1000, std::sqrt(0.5), std::sqrt(0.5), 0, 0};
  ASSERT_EQ(bytes.size(), 10u + 2 + 2 + 2 + 7 * 9);
  for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(value_at<double>(bytes, 16 + 9 * i + 1), expected[i], 1e-12);
  // All zero: the sender has no pose. Another number of elements is a fault.
  Bytes zero = bytes;
  for (std::size_t i = 3; i < 7; ++i)
    std::fill_n(zero.begin() + static_cast<std::ptrdiff_t>(16 + 9 * i + 1), 8, std::uint8_t{0});
  ASSERT_EQ(decode(Protocol::kSunrise2_5, zero, 7, c), Fault::kNone);
  EXPECT_EQ(c.fields, 0u);
  const std::string six = "0a 08 08 81800d 10 02 18 01 12 3c 32 3a 0a 00" + repeated("11 0000000000000000", 6) + "42 00";
  EXPECT_EQ(decode(Protocol::kSunrise2_5, bytes_of(six), 7, c), Fault::kCount);
}

class FriCodec : public ::testing::TestWithParam<Protocol> {};
class SunriseCodec : public FriCodec {};

TEST_P(FriCodec, GivesBackRandomMessages) {
  const Protocol p = GetParam();
  for (std::uint32_t seed = 0; seed < 500; ++seed) {
    const std::size_t joints = p == Protocol::kLwr ? 7 : 1 + seed % 10;
    RandomMessages random(p, joints, seed);
    const Monitoring m = random.monitoring();
    const Command c = random.command();
    Monitoring m_out = random.monitoring();  // what was there before must not stay
    Command c_out = random.command();
    const Bytes m_bytes = encoded(p, m), c_bytes = encoded(p, c);
    ASSERT_GT(m_bytes.size(), 0u) << seed;
    ASSERT_GT(c_bytes.size(), 0u) << seed;
    ASSERT_EQ(decode(p, m_bytes, joints, m_out), Fault::kNone) << seed;
    ASSERT_EQ(decode(p, c_bytes, joints, c_out), Fault::kNone) << seed;
    ASSERT_EQ(difference(p, m, m_out), "") << seed;
    ASSERT_EQ(difference(p, c, c_out), "") << seed;
  }
}

TEST_P(FriCodec, RefusesEveryTruncatedMessage) {
  const Protocol p = GetParam();
  RandomMessages random(p, 7, 3);
  Monitoring m = random.monitoring();
  m.fields = testing::monitoring_fields(p, m.state);
  const Bytes bytes = encoded(p, m);
  Monitoring out;
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    const Fault fault = decode(p, std::span(bytes).first(size), 7, out);
    // Without a frame, a message that is cut between two fields of the outermost level after its required ones is complete.
    if (fault == Fault::kNone) {
      EXPECT_TRUE(p != Protocol::kLwr && p != Protocol::kSunrise2_7) << size;
    }
  }
}

TEST_P(FriCodec, ReadsAnyBytesWithoutHarm) {
  const Protocol p = GetParam();
  RandomMessages random(p, 7, 4);
  for (int i = 0; i < 3000; ++i) {
    Bytes bytes = i % 2 == 0 ? encoded(p, random.monitoring()) : encoded(p, random.command());
    for (std::uint32_t edits = 1 + random.natural(4); edits > 0; --edits) {
      bytes[random.natural(static_cast<std::uint32_t>(bytes.size()))] = static_cast<std::uint8_t>(random.word());
    }
    bytes.resize(bytes.size() - random.natural(3));
    Monitoring m;
    Command c;
    if (decode(p, bytes, 7, m) == Fault::kNone) {
      EXPECT_LE(m.ios.count, kMaxIos);
    }
    if (decode(p, bytes, 7, c) == Fault::kNone) {
      EXPECT_LE(c.transformations.count, kMaxTransformations);
    }
  }
}

TEST_P(FriCodec, NeedsRoomForTheWholeMessage) {
  const Protocol p = GetParam();
  RandomMessages random(p, 7, 5);
  const Monitoring m = random.monitoring();
  const Bytes whole = encoded(p, m);
  for (std::size_t room = 0; room < whole.size(); ++room) {
    Bytes bytes(room);  // the sanitizers see what is written behind it
    ASSERT_EQ(encode(p, m, bytes), 0u) << room;
  }
  Bytes exact(whole.size());
  EXPECT_EQ(encode(p, m, exact), whole.size());
}

TEST_P(FriCodec, AllocatesNothing) {
  const Protocol p = GetParam();
  RandomMessages random(p, 7, 6);
  const Monitoring m = random.monitoring();
  const Command c = random.command();
  Monitoring m_out;
  Command c_out;
  std::array<std::uint8_t, kMaxDatagram> bytes{};
  const std::uint64_t before = testing::allocations();
  std::size_t size = encode(p, m, bytes);
  const Fault first = decode(p, std::span(bytes).first(size), 7, m_out);
  size = encode(p, c, bytes);
  const Fault second = decode(p, std::span(bytes).first(size), 7, c_out);
  EXPECT_EQ(testing::allocations(), before);
  EXPECT_EQ(first, Fault::kNone);
  EXPECT_EQ(second, Fault::kNone);
}

TEST_P(SunriseCodec, HasRoomForAsManyJointsAsItAllows) {
  const Protocol p = GetParam();
  RandomMessages random(p, kMaxJoints, 7);
  Monitoring m = random.monitoring();
  m.state = SessionState::kCommandingActive;
  m.fields = testing::monitoring_fields(p, m.state);
  m.transformations.count = m.ios.count = 0;
  Monitoring out;
  ASSERT_EQ(decode(p, encoded(p, m), kMaxJoints, out), Fault::kNone);
  EXPECT_EQ(difference(p, m, out), "");
}

std::string name_of(const ::testing::TestParamInfo<Protocol>& information) {
  std::string name = to_text(information.param);
  for (char& c : name) c = c == '-' || c == '.' ? '_' : c;
  return name;
}

INSTANTIATE_TEST_SUITE_P(AllProtocols, FriCodec, ::testing::ValuesIn(kProtocols), name_of);
static_assert(kProtocols.front() == Protocol::kLwr);
INSTANTIATE_TEST_SUITE_P(AllButLwr, SunriseCodec, ::testing::ValuesIn(std::span(kProtocols).subspan(1)), name_of);

}  // namespace
}  // namespace cotwin::codec_test
