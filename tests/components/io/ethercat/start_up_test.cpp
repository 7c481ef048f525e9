// Start-up values: their file, and their way over CoE to a slave, in one mail or in segments: components/io/ethercat/master/start_up.h.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <memory>
#include <numeric>

#include "components/io/emulators/ethercat/servo_drive.h"
#include "components/io/ethercat/master/start_up.h"
#include "tests/components/io/ethercat/cell.h"
#include "tests/support/error_of.h"

namespace cotwin::ethercat::start_up_test {
namespace {

using cotwin::testing::error_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::string kHead = "slave,when,index,subindex,type,value\n";

TEST(StartUpFile, ReadsEachTypeInLittleEndian) {
  const auto rows = read_start_up("# limits\n" + kHead +
                                      "q1, PS, 0x607d, 1, i32, -100000\r\n"
                                      "\n"
                                      "q1,SO,24677,0,u32,0x000186a0\n"
                                      "q2,PS,0x605a,0,i16,2\n"
                                      "q2,PS,0x6098,0,i8,-1\n"
                                      "q2,PS,0x2000,7,f32,1.5\n"
                                      "q2,PS,0x2000,8,f64,-2\n"
                                      "q2,PS,0x2001,0,bytes,01 fF7a\n"
                                      "q2,PS,0x2002,255,text,left, upper arm\n",
                                  "drives.csv");
  ASSERT_EQ(rows.size(), 8u);
  EXPECT_EQ(rows[0].slave, "q1");
  EXPECT_EQ(rows[0].value.index, 0x607d);
  EXPECT_EQ(rows[0].value.subindex, 1);
  EXPECT_THAT(rows[0].value.data, ElementsAre(0x60, 0x79, 0xfe, 0xff));  // −100000 = 0xfffe7960
  EXPECT_FALSE(rows[0].value.before_op);
  EXPECT_EQ(rows[0].value.origin, "drives.csv:3");
  EXPECT_EQ(rows[1].value.index, 24677);
  EXPECT_TRUE(rows[1].value.before_op);
  EXPECT_THAT(rows[1].value.data, ElementsAre(0xa0, 0x86, 0x01, 0x00));
  EXPECT_THAT(rows[2].value.data, ElementsAre(2, 0));
  EXPECT_THAT(rows[3].value.data, ElementsAre(0xff));
  EXPECT_THAT(rows[4].value.data, ElementsAre(0, 0, 0xc0, 0x3f));
  EXPECT_THAT(rows[5].value.data, ElementsAre(0, 0, 0, 0, 0, 0, 0, 0xc0));
  EXPECT_THAT(rows[6].value.data, ElementsAre(0x01, 0xff, 0x7a));
  EXPECT_EQ(std::string(rows[7].value.data.begin(), rows[7].value.data.end()), "left, upper arm");
}

TEST(StartUpFile, NamesTheLineThatDoesNotFit) {
  const auto refusal = [](const std::string& line) { return error_of([&] { read_start_up(kHead + line, "f"); }); };
  EXPECT_THAT(refusal("q1,PS,0x6060"), HasSubstr("f:2: expected slave,when,index,subindex,type,value"));
  EXPECT_THAT(refusal(",PS,0x6060,0,i8,8"), HasSubstr("f:2: slave is empty"));
  EXPECT_THAT(refusal("q1,IP,0x6060,0,i8,8"), HasSubstr("when is 'IP', expected PS (before SAFEOP) or SO (before OP)"));
  EXPECT_THAT(refusal("q1,PS,0x10000,0,i8,8"), HasSubstr("index is '0x10000', expected a number from 0 to 65535"));
  EXPECT_THAT(refusal("q1,PS,-1,0,i8,8"), HasSubstr("index is '-1'"));
  EXPECT_THAT(refusal("q1,PS,0x6060,256,i8,8"), HasSubstr("subindex is '256', expected a number from 0 to 255"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,int,8"), HasSubstr("type is 'int', expected u8, i8, u16, i16"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,i8,128"), HasSubstr("value is '128', expected an integer from -128 to 127"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,u8,-1"), HasSubstr("expected an integer from 0 to 255"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,u32,4294967296"), HasSubstr("expected an integer from 0 to 4294967295"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,u8,8.5"), HasSubstr("value is '8.5'"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,f32,1e39"), HasSubstr("expected a number that f32 can hold"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,f64,nan"), HasSubstr("expected a number that f64 can hold"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,bytes,0g"), HasSubstr("expected bytes of two hexadecimal digits each"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,bytes,012"), HasSubstr("expected bytes of two hexadecimal digits each"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,text,"), HasSubstr("value is empty"));
  EXPECT_THAT(refusal("q1,PS,0x6060,0,text," + std::string(4097, 'x')),
              HasSubstr("value has 4097 bytes, expected at most 4096"));
  for (const char* index : {"0x1600", "0x17ff", "0x1a00", "0x1bff", "0x1c12", "0x1c2f"}) {
    EXPECT_THAT(refusal(std::string("q1,PS,") + index + ",0,u8,0"), HasSubstr("maps or assigns PDOs")) << index;
  }
  EXPECT_THAT(error_of([] { read_start_up("q1,PS,0x6060,0,i8,8\n", "f"); }),
              HasSubstr("f:1: 'q1,PS,0x6060,0,i8,8', expected the line slave,"));
  EXPECT_THAT(error_of([] { read_start_up("# nothing\n", "f"); }), HasSubstr("f: is empty, expected the line slave,"));
}

/// A bus of one drive, with start-up values.
struct OneDrive {
  OneDrive() {
    options.system_time = 800'000'000'000'000'000;
    expected = ethercat::expected("DRIVE402", kServoDrive, 16, 14);
    expected.vendor = kCotwinVendor;
    bus.append(std::make_unique<ServoDrive>(terminal_options())).power_on(0);
  }
  void value(std::uint16_t index, std::uint8_t subindex, std::vector<std::uint8_t> data, bool before_op = false) {
    expected.start_up.push_back({index, subindex, std::move(data), before_op, "values.csv:7"});
  }
  BusSetup set_up() {
    Exchange exchange(wire);
    return set_up_bus(exchange, {expected}, options);
  }
  std::vector<std::uint8_t> upload(const BusSetup& setup, std::uint16_t index, std::uint8_t subindex) {
    const SiiMailbox& box = setup.slaves[0].setup.mailbox;
    const std::uint16_t station = setup.slaves[0].found.station;
    Exchange exchange(wire);
    client.upload(index, subindex);
    for (int mails = 0; mails < 100; ++mails) {
      std::vector<std::uint8_t> mail(client.request().begin(), client.request().end());
      mail.resize(box.out_size);
      EXPECT_EQ(exchange.transfer(Command::kFpwr, at_station(station, box.out), std::span(mail)), 1);
      std::vector<std::uint8_t> answer(box.in_size);
      EXPECT_EQ(exchange.transfer(Command::kFprd, at_station(station, box.in), std::span(answer)), 1);
      if (client.receive(answer) != SdoClient::Result::kContinue) break;
    }
    return {client.data().begin(), client.data().end()};
  }

  Bus bus;
  EmulatedWire wire{bus};
  SetupOptions options;
  ExpectedSlave expected;
  SdoClient client{128, 128};  // one for all uploads: a slave takes a mail with the counter of the last one for its repetition
};

TEST(StartUpValues, ReachTheSlaveBeforeItsStates) {
  OneDrive d;
  d.value(0x607d, 1, {0x60, 0x79, 0xfe, 0xff});
  d.value(0x6080, 0, {1, 2, 3, 4}, true);
  const BusSetup setup = d.set_up();
  EXPECT_EQ(d.bus.slave(0).state(), State::kSafeOp);
  EXPECT_THAT(d.upload(setup, 0x607d, 1), ElementsAre(0x60, 0x79, 0xfe, 0xff));
  EXPECT_THAT(d.upload(setup, 0x6080, 0), ElementsAre(1, 2, 3, 4));
  // The steps have the same order as the states: the first value before the request of SAFEOP, the second after it.
  std::vector<std::string> order;
  for (const Step& step : setup.slaves[0].start) {
    if (step.what.find("values.csv") != std::string::npos || step.what == "go to SAFEOP") order.push_back(step.what);
  }
  EXPECT_THAT(order,
              ElementsAre("take 0x607d:1 (values.csv:7)", "go to SAFEOP", "go to SAFEOP", "take 0x6080:0 (values.csv:7)"));
}

// The mailbox has 128 bytes: 112 of a value in its first mail, 119 in each segment.
TEST(StartUpValues, LongOnesGoInSegments) {
  OneDrive d;
  std::vector<std::uint8_t> table(256);
  std::iota(table.begin(), table.end(), std::uint8_t{3});
  d.value(0x2001, 0, table);
  d.value(0x6080, 0, {9, 0, 0, 0});
  const BusSetup setup = d.set_up();
  EXPECT_EQ(d.upload(setup, 0x2001, 0), table);
  EXPECT_THAT(d.upload(setup, 0x6080, 0), ElementsAre(9, 0, 0, 0)) << "the mail after the segments";
  const auto mails = std::count_if(setup.slaves[0].start.begin(), setup.slaves[0].start.end(),
                                   [](const Step& step) { return step.kind == Step::Kind::kMail; });
  EXPECT_EQ(mails, 4) << "112 + 119 + 25 bytes, and one more value";
}

TEST(StartUpValues, NameTheirLineIfTheSlaveRefusesThem) {
  const auto refusal = [](std::uint16_t index, std::uint8_t subindex, std::vector<std::uint8_t> data) {
    OneDrive d;
    d.value(index, subindex, std::move(data));
    return error_of([&] { d.set_up(); });
  };
  EXPECT_THAT(refusal(0x5fff, 0, {1}),
              HasSubstr("did not take 0x5fff:0 (values.csv:7): SDO abort 0x06020000, the object does not exist"));
  EXPECT_THAT(refusal(0x607d, 3, {1}), HasSubstr("the subindex does not exist"));
  EXPECT_THAT(refusal(0x605a, 0, {1, 0}), HasSubstr("the object can only be read"));
  EXPECT_THAT(refusal(0x6080, 0, {1}), HasSubstr("the value is too short"));
  EXPECT_THAT(refusal(0x2001, 0, std::vector<std::uint8_t>(300)), HasSubstr("did not take 0x2001:0 (values.csv:7): SDO abort"));
  Cell cell(false);
  cell.slaves[1].start_up.push_back({0x6080, 0, {1}, false, "values.csv:2"});
  EXPECT_THAT(cell.refusal(), HasSubstr("values.csv:2: is for EtherCAT: slave 1 (EL1809), which has no mailbox with CoE"));
}

}  // namespace
}  // namespace cotwin::ethercat::start_up_test
