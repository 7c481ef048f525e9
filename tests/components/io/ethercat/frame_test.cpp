#include "components/io/ethercat/frame.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <numeric>
#include <string>
#include <vector>

#include "components/io/ethercat/registers.h"
#include "tests/components/io/ethercat/captures.h"
#include "tests/support/allocations.h"

namespace cotwin::ethercat::frame_test {
namespace {

using Bytes = std::vector<std::uint8_t>;

FrameFault fault_of(const Bytes& frame) { return FrameReader(frame).fault(); }

/// BRD 0x0000 of the bus in soem-sdinfo-ek1100-el1004.pcapng, as it came back.
const Bytes kAnswer = {0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x03, 0x01, 0x01, 0x01, 0x01, 0x01, 0x88, 0xa4, 0x0e,
                       0x10, 0x07, 0x02, 0x02, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00, 0x11, 0x01, 0x02, 0x00};

TEST(Frame, ACapturedAnswerIsReadFieldByField) {
  FrameReader reader(kAnswer);
  ASSERT_EQ(reader.fault(), FrameFault::kNone);
  Datagram d;
  ASSERT_TRUE(reader.next(d));
  EXPECT_EQ(d.command, Command::kBrd);
  EXPECT_EQ(d.index, 2);
  EXPECT_EQ(d.station(), 2);  // counted up by two slaves
  EXPECT_EQ(d.offset(), 0);
  EXPECT_FALSE(d.circulating);
  EXPECT_EQ(d.working_counter, 2);
  EXPECT_THAT(reader.data(d), ::testing::ElementsAre(0x11, 0x01));
  EXPECT_FALSE(reader.next(d));
}

TEST(Frame, AWrittenFrameHasTheBytesOfTheSpecification) {
  Bytes buffer(kLongestFrame, 0xaa);
  FrameWriter writer(buffer);
  writer.begin();
  const Bytes three = {1, 2, 3};
  ASSERT_TRUE(writer.add(Command::kFpwr, 7, at_station(0x1001, reg::kAlControl), three));
  ASSERT_NE(writer.add(Command::kLrw, 8, 0x12345678, 2), 0u);
  const auto frame = writer.finish();
  EXPECT_THAT(frame.subspan(12, 33),
              ::testing::ElementsAre(0x88, 0xa4, 0x1d, 0x10,                                         // 29 bytes, type 1
                                     5, 7, 0x01, 0x10, 0x20, 0x01, 0x03, 0x80, 0, 0, 1, 2, 3, 0, 0,  // more follow
                                     12, 8, 0x78, 0x56, 0x34, 0x12, 0x02, 0x00, 0, 0, 0, 0, 0, 0));
  EXPECT_EQ(frame.size(), kShortestFrame);
  EXPECT_EQ(fault_of({frame.begin(), frame.end()}), FrameFault::kNone);
}

TEST(Frame, ThePositionOfASlaveIsItsTwosComplement) {
  EXPECT_EQ(at_position(0, 0x10), 0x00100000u);
  EXPECT_EQ(at_position(1, 0x10), 0x0010ffffu);
  EXPECT_EQ(at_position(3, 0), 0xfffdu);
}

TEST(Frame, EveryDamageHasItsFault) {
  const auto changed = [](std::size_t at, int value) {
    Bytes b = kAnswer;
    b[at] = static_cast<std::uint8_t>(value);
    return fault_of(b);
  };
  EXPECT_EQ(changed(12, 0x08), FrameFault::kNotEtherCat);
  EXPECT_EQ(changed(15, 0x40), FrameFault::kProtocol);  // network variables
  EXPECT_EQ(changed(15, 0x18), FrameFault::kReserved);
  EXPECT_EQ(changed(14, 0x0f), FrameFault::kCutShort);
  EXPECT_EQ(changed(14, 0x0d), FrameFault::kCutDatagram);
  EXPECT_EQ(changed(14, 0x00), FrameFault::kCutDatagram);
  EXPECT_EQ(changed(16, 15), FrameFault::kCommand);
  EXPECT_EQ(changed(22, 3), FrameFault::kCutDatagram);
  EXPECT_EQ(changed(22, 1), FrameFault::kMore);
  EXPECT_EQ(changed(23, 0x80), FrameFault::kMore);
  EXPECT_EQ(changed(23, 0x08), FrameFault::kReserved);
  EXPECT_EQ(fault_of(Bytes(kLongestFrame + 1)), FrameFault::kTooLong);
  EXPECT_EQ(fault_of({}), FrameFault::kNotEtherCat);
  for (std::size_t n = 0; n < kAnswer.size(); ++n) {
    EXPECT_NE(fault_of({kAnswer.begin(), kAnswer.begin() + static_cast<std::ptrdiff_t>(n)}), FrameFault::kNone) << n;
  }
}

TEST(Frame, FifteenDatagramsAreTheMost) {
  Bytes buffer(kLongestFrame);
  FrameWriter writer(buffer);
  writer.begin();
  for (std::size_t i = 0; i < kMostDatagrams; ++i) EXPECT_NE(writer.add(Command::kNop, 0, 0, 1), 0u);
  EXPECT_EQ(writer.add(Command::kNop, 0, 0, 1), 0u);
  const auto frame = writer.finish();
  Bytes sixteen(frame.begin(), frame.end());
  EXPECT_EQ(fault_of(sixteen), FrameFault::kNone);
  // A sixteenth datagram by hand.
  sixteen[frame.size() - 6] |= 0x80;
  sixteen.insert(sixteen.end(), 13, 0);
  sixteen[frame.size() + 6] = 1;
  sixteen[14] = static_cast<std::uint8_t>(16 * 13);
  EXPECT_EQ(fault_of(sixteen), FrameFault::kTooMany);
}

TEST(Frame, TheLongestDatumFillsTheFrameAndOneByteMoreDoesNotFit) {
  Bytes buffer(2000);
  FrameWriter writer(buffer);
  writer.begin();
  EXPECT_EQ(writer.add(Command::kLrw, 0, 0, kLongestData + 1), 0u);
  EXPECT_NE(writer.add(Command::kLrw, 0, 0, kLongestData), 0u);
  const auto frame = writer.finish();
  EXPECT_EQ(frame.size(), kLongestFrame);
  EXPECT_EQ(fault_of({frame.begin(), frame.end()}), FrameFault::kNone);
}

TEST(Frame, WritingAndReadingAllocateNothing) {
  Bytes buffer(kLongestFrame);
  FrameWriter writer(buffer);
  const std::uint64_t before = cotwin::testing::allocations();
  writer.begin();
  writer.add(Command::kLrw, 0, 0, 100);
  writer.add(Command::kBrd, 1, at_position(0, reg::kAlStatus), 2);
  FrameReader reader(writer.finish());
  Datagram d;
  int datagrams = 0;
  while (reader.next(d)) ++datagrams;
  EXPECT_EQ(datagrams, 2);
  EXPECT_EQ(cotwin::testing::allocations(), before);
}

struct Capture {
  const char* file;
  int frames, others, datagrams;  // counted by a script that shares no code with FrameReader
};

class Captures : public ::testing::TestWithParam<Capture> {};

TEST_P(Captures, DecodesCompletelyAndIsWrittenAgainByteByByte) {
  const std::string path = captures_folder() + "/" + GetParam().file;
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "needs scripts/fetch_logs.py --tests";
  int frames = 0, others = 0, datagrams = 0;
  Bytes buffer(kLongestFrame);
  for (const Captured& packet : read_pcapng(path)) {
    FrameReader reader(packet.frame);
    if (!packet.is_ethercat()) {
      EXPECT_EQ(reader.fault(), FrameFault::kNotEtherCat);
      ++others;
      continue;
    }
    ASSERT_EQ(reader.fault(), FrameFault::kNone);
    ++frames;
    FrameWriter writer(buffer);
    MacAddress source{}, destination{};
    std::copy_n(packet.frame.begin(), 6, destination.begin());
    std::copy_n(packet.frame.begin() + 6, 6, source.begin());
    writer.begin(source, destination);
    Datagram d;
    while (reader.next(d)) {
      ++datagrams;
      ASSERT_TRUE(writer.add(d.command, d.index, d.address, reader.data(d)));
    }
    if (packet.returned()) continue;
    // A request: no slave has set working counters or events.
    const auto written = writer.finish();
    const std::size_t n = std::min(written.size(), packet.frame.size());
    EXPECT_TRUE(std::equal(packet.frame.begin(), packet.frame.begin() + static_cast<std::ptrdiff_t>(n), written.begin()));
  }
  EXPECT_EQ(frames, GetParam().frames);
  EXPECT_EQ(others, GetParam().others);
  EXPECT_EQ(datagrams, GetParam().datagrams);
}

INSTANTIATE_TEST_SUITE_P(Real, Captures,
                         ::testing::Values(Capture{"replay-dc.pcapng", 3604, 0, 5676},
                                           Capture{"replay-ek1100-el2828-el2889.pcapng", 3578, 0, 4124},
                                           Capture{"rs-detect-slaves-ek1100-el1004.pcapng", 2, 163, 2},
                                           Capture{"soem-sdinfo-ek1100-el1004.pcapng", 580, 14, 580},
                                           Capture{"twincat-run-ek1100-el1004.pcapng", 553, 1, 581}));

}  // namespace
}  // namespace cotwin::ethercat::frame_test
