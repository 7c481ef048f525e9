// State machine, mailbox and CoE of emulated slaves.
#include "components/io/emulators/ethercat/slave.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/devices.h"
#include "components/io/ethercat/coe.h"
#include "tests/components/io/ethercat/captures.h"
#include "tests/components/io/ethercat/wire.h"

namespace cotwin::ethercat::slave_test {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint16_t kStation = 0x1001;

/// One encoder terminal, with its state machine.
struct Axis {
  Axis() : Axis(terminal_options()) {}
  explicit Axis(const SlaveOptions& options) {
    encoder = static_cast<El5101*>(&bus.append(std::make_unique<El5101>(options)));
    wire.number_stations();
  }
  std::uint16_t request(State s, bool acknowledge = false) { return wire.request(kStation, s, acknowledge); }
  void to_op() {
    wire.set_sync_managers(0);
    request(State::kPreOp);
    request(State::kSafeOp);
    wire.write_bytes(kStation, 0x1000, {0, 0, 0});
    request(State::kOp);
    ASSERT_EQ(encoder->state(), State::kOp);
  }
  /// One SDO transfer over the mailboxes; the result of the client.
  SdoClient::Result transfer() {
    for (;;) {
      Bytes mail(246);
      const auto request_mail = client.request();
      std::copy(request_mail.begin(), request_mail.end(), mail.begin());
      EXPECT_EQ(wire.write_bytes(kStation, 0x1800, mail), 1);
      const auto answer = wire.read(kStation, 0x18f6, 246);
      EXPECT_EQ(answer.count, 1);
      const auto result = client.receive(answer.data);
      if (result != SdoClient::Result::kContinue) return result;
    }
  }
  SdoClient::Result write(std::uint16_t index, std::uint8_t subindex, const Bytes& data) {
    client.download(index, subindex, data);
    return transfer();
  }
  std::uint64_t read(std::uint16_t index, std::uint8_t subindex) {
    client.upload(index, subindex);
    EXPECT_EQ(transfer(), SdoClient::Result::kDone);
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < client.data().size(); ++i) value |= static_cast<std::uint64_t>(client.data()[i]) << (8 * i);
    return value;
  }

  Bus bus;
  El5101* encoder;
  BusWire wire{bus};
  SdoClient client{246, 246};
};

TEST(StateMachine, AllowsTheChangesOfTheSpecificationAndNoOthers) {
  // Row: from; column: to. ETG.1000.6, figure 5; BOOT needs mailboxes for it, which INIT → BOOT finds set up here.
  const State states[] = {State::kInit, State::kPreOp, State::kBootstrap, State::kSafeOp, State::kOp};
  const bool allowed[5][5] = {{true, true, true, false, false},
                              {true, true, false, true, false},
                              {true, false, true, false, false},
                              {true, true, false, true, true},
                              {true, true, false, true, true}};
  for (int from = 0; from < 5; ++from) {
    for (int to = 0; to < 5; ++to) {
      Axis a;
      a.wire.set_sync_managers(0);
      if (states[from] == State::kBootstrap) {
        a.request(State::kBootstrap);
      } else if (from != 0) {
        a.request(State::kPreOp);
        if (from >= 3) a.request(State::kSafeOp);
        a.wire.write_bytes(kStation, 0x1000, {0, 0, 0});
        if (from == 4) a.request(State::kOp);
      }
      ASSERT_EQ(a.encoder->state(), states[from]);
      const std::uint16_t status = a.request(states[to]);
      if (allowed[from][to]) {
        EXPECT_EQ(status, static_cast<std::uint16_t>(states[to])) << from << to;
        EXPECT_EQ(a.wire.code(kStation), AlCode::kNone);
      } else {
        EXPECT_EQ(status, static_cast<std::uint16_t>(states[from]) | kStateError) << from << to;
        EXPECT_EQ(a.wire.code(kStation), AlCode::kInvalidChange);
      }
    }
  }
}

TEST(StateMachine, AnErrorStaysUntilItIsAcknowledged) {
  Axis a;
  EXPECT_EQ(a.request(State::kOp), 0x11);
  a.wire.set_sync_managers(0);
  EXPECT_EQ(a.request(State::kPreOp), 0x11);        // not acknowledged
  EXPECT_EQ(a.request(State::kPreOp, true), 0x02);  // acknowledged with the request
  EXPECT_EQ(a.request(static_cast<State>(7)), 0x12);
  EXPECT_EQ(a.wire.code(kStation), AlCode::kUnknownState);
  EXPECT_EQ(a.request(State::kPreOp, true), 0x02);
  EXPECT_EQ(a.wire.code(kStation), AlCode::kNone);
}

TEST(StateMachine, AMailboxOrProcessDataThatIsNotSetUpIsNamed) {
  Axis a;
  EXPECT_EQ(a.request(State::kPreOp), 0x11);
  EXPECT_EQ(a.wire.code(kStation), AlCode::kMailbox);
  a.wire.set_sync_managers(0, 4);  // outputs one byte too long
  EXPECT_EQ(a.request(State::kPreOp, true), 0x02);
  EXPECT_EQ(a.request(State::kSafeOp), 0x12);
  EXPECT_EQ(a.wire.code(kStation), AlCode::kOutputs);
  a.wire.set_sync_managers(0, 0, 6);
  EXPECT_EQ(a.request(State::kSafeOp, true), 0x12);
  EXPECT_EQ(a.wire.code(kStation), AlCode::kInputs);
  a.wire.set_sync_managers(0);
  EXPECT_EQ(a.request(State::kSafeOp, true), 0x04);
  // A sync manager that is switched off ends the exchange.
  a.wire.write(kStation, reg::kSyncManager + 8 * 3 + 6, std::uint8_t{0});
  EXPECT_EQ(a.wire.status(kStation), 0x12);
  EXPECT_EQ(a.wire.code(kStation), AlCode::kInputs);
}

TEST(StateMachine, OpWaitsForOutputsAndThenGivesUp) {
  SlaveOptions options = terminal_options();
  options.outputs_wait = 50'000'000;
  Axis a(options);
  a.wire.set_sync_managers(0);
  a.request(State::kPreOp);
  a.request(State::kSafeOp);
  EXPECT_EQ(a.request(State::kOp), 0x04);
  a.wire.now += 40'000'000;
  EXPECT_EQ(a.wire.status(kStation), 0x04);
  a.wire.now += 20'000'000;
  EXPECT_EQ(a.wire.status(kStation), 0x14);
  EXPECT_EQ(a.wire.code(kStation), AlCode::kNoOutputs);
  EXPECT_EQ(a.request(State::kOp, true), 0x04);
  a.wire.write_bytes(kStation, 0x1000, {0, 0, 0});
  EXPECT_EQ(a.wire.status(kStation), 0x08);
}

TEST(StateMachine, AStateMayTakeItsTime) {
  SlaveOptions options = terminal_options();
  options.state_time = 3'000'000;
  Axis a(options);
  a.wire.set_sync_managers(0);
  EXPECT_EQ(a.request(State::kPreOp), 0x01);
  a.wire.now += 2'900'000;
  EXPECT_EQ(a.wire.status(kStation), 0x01);
  a.wire.now += 100'000;
  EXPECT_EQ(a.wire.status(kStation), 0x02);
}

TEST(StateMachine, AnExpiredWatchdogEndsOpAndTheOutputs) {
  Axis a;
  a.to_op();
  a.wire.write_bytes(kStation, 0x1000, {0x80, 1, 2});
  a.wire.status(kStation);
  EXPECT_EQ(a.encoder->outputs()[0], 0x80);
  a.bus.advance(a.wire.now + 99'000'000);
  EXPECT_EQ(a.encoder->state(), State::kOp);
  a.wire.now += 102'000'000;
  EXPECT_EQ(a.wire.status(kStation), 0x14);
  EXPECT_EQ(a.wire.code(kStation), AlCode::kWatchdog);
  EXPECT_EQ(a.encoder->outputs()[0], 0);
  // OP again needs outputs.
  EXPECT_EQ(a.request(State::kOp, true), 0x04);
  a.wire.write_bytes(kStation, 0x1000, {0x80, 1, 2});
  EXPECT_EQ(a.wire.status(kStation), 0x08);
}

TEST(StateMachine, ATerminalWithoutProcessorCopiesTheRequest) {
  // As in the captures: AL status is 0x11 after a request of INIT with acknowledgement.
  Bus bus;
  bus.append(std::make_unique<El1809>());
  BusWire w(bus);
  w.number_stations();
  EXPECT_EQ(w.request(kStation, State::kInit, true), 0x11);
  EXPECT_EQ(w.request(kStation, State::kOp), 0x08);
  EXPECT_EQ(w.code(kStation), AlCode::kNone);
}

TEST(StateMachine, ASlaveThatIsSwitchedOffForgetsEverything) {
  Axis a;
  a.to_op();
  a.bus.power(0, false, a.wire.now);
  EXPECT_EQ(a.wire.status(kStation), 0);  // no answer
  a.bus.power(0, true, a.wire.now);
  EXPECT_EQ(a.wire.read(kStation, reg::kType, 1).count, 0);
  a.wire.number_stations();
  EXPECT_EQ(a.wire.status(kStation), 0x01);
  EXPECT_FALSE(a.encoder->esc().sync_manager(0).enabled);
}

// --------------------------------------------------------------------------------------------------------------------- CoE

TEST(Coe, ASlaveTellsItsIdentityAndMapping) {
  Axis a;
  a.wire.set_sync_managers(0);
  a.request(State::kPreOp);
  EXPECT_EQ(a.read(0x1018, 1), kBeckhoff);
  EXPECT_EQ(a.read(0x1018, 2), kEl5101);
  EXPECT_EQ(a.read(0x1c12, 1), 0x1600u);
  EXPECT_EQ(a.read(0x1a00, 2), 0x60000210u);
  EXPECT_EQ(a.read(0x1c00, 4), 4u);
  a.client.upload(0x1008, 0);  // a normal transfer
  ASSERT_EQ(a.transfer(), SdoClient::Result::kDone);
  EXPECT_EQ(std::string(a.client.data().begin(), a.client.data().end()), "EL5101");
}

TEST(Coe, FaultsOfRequestsHaveTheirAbortCodes) {
  Axis a;
  a.wire.set_sync_managers(0);
  a.request(State::kPreOp);
  const auto code = [&](SdoClient::Result result) {
    EXPECT_EQ(result, SdoClient::Result::kAborted);
    return a.client.abort_code();
  };
  a.client.upload(0x5000, 0);
  EXPECT_EQ(code(a.transfer()), SdoAbort::kNoObject);
  a.client.upload(0x1018, 9);
  EXPECT_EQ(code(a.transfer()), SdoAbort::kNoSubindex);
  a.client.upload(0x1018, 0, true);
  EXPECT_EQ(code(a.transfer()), SdoAbort::kComplete);
  EXPECT_EQ(code(a.write(0x1018, 1, {1, 2, 3, 4})), SdoAbort::kReadOnly);
  EXPECT_EQ(code(a.write(0x1c12, 0, {1, 0})), SdoAbort::kTooLong);
  EXPECT_EQ(code(a.write(0x1c12, 1, {3, 0x16})), SdoAbort::kSubindex0);
  EXPECT_EQ(a.write(0x1c12, 0, {0}), SdoClient::Result::kDone);
  EXPECT_EQ(code(a.write(0x1c12, 1, {3})), SdoAbort::kTooShort);
  EXPECT_EQ(code(a.write(0x1c12, 1, {0, 0x1a})), SdoAbort::kNotMappable);  // of the other direction
  EXPECT_EQ(code(a.write(0x1c12, 0, {9})), SdoAbort::kRange);
}

TEST(Coe, TheAssignmentOfPdosChangesTheProcessDataInPreOpOnly) {
  Axis a;
  a.wire.set_sync_managers(0);
  a.request(State::kPreOp);
  EXPECT_EQ(a.write(0x1c12, 0, {0}), SdoClient::Result::kDone);
  EXPECT_EQ(a.encoder->output_bytes(), 0u);
  EXPECT_EQ(a.write(0x1c12, 1, {0x03, 0x16}), SdoClient::Result::kDone);
  EXPECT_EQ(a.write(0x1c12, 0, {1}), SdoClient::Result::kDone);
  EXPECT_EQ(a.encoder->output_bytes(), 6u);
  EXPECT_EQ(a.write(0x1c13, 0, {0}), SdoClient::Result::kDone);
  EXPECT_EQ(a.write(0x1c13, 1, {0x04, 0x1a}), SdoClient::Result::kDone);
  EXPECT_EQ(a.write(0x1c13, 2, {0x02, 0x1a}), SdoClient::Result::kDone);
  EXPECT_EQ(a.write(0x1c13, 0, {2}), SdoClient::Result::kDone);
  EXPECT_EQ(a.encoder->input_bytes(), 18u);
  EXPECT_EQ(a.request(State::kSafeOp), 0x12);  // the old lengths
  a.wire.set_sync_managers(0, 6, 18);
  EXPECT_EQ(a.request(State::kSafeOp, true), 0x04);
  EXPECT_EQ(a.write(0x1c12, 0, {0}), SdoClient::Result::kAborted);
  EXPECT_EQ(a.client.abort_code(), SdoAbort::kState);
  // Process data as objects.
  a.encoder->set_position(123456, a.wire.now);
  EXPECT_EQ(a.read(0x6010, 0x11), 123456u);
  // Switched off and on: the first assignment again.
  a.bus.power(0, false, a.wire.now);
  a.bus.power(0, true, a.wire.now);
  EXPECT_EQ(a.encoder->input_bytes(), 5u);
}

TEST(Coe, AMailThatWasLostIsRepeated) {
  Axis a;
  a.wire.set_sync_managers(0);
  a.request(State::kPreOp);
  a.client.upload(0x1018, 2);
  Bytes mail(246);
  std::copy(a.client.request().begin(), a.client.request().end(), mail.begin());
  a.wire.write_bytes(kStation, 0x1800, mail);
  const auto lost = a.wire.read(kStation, 0x18f6, 246);
  EXPECT_EQ(a.wire.read(kStation, 0x18f6, 246).count, 0);
  a.wire.write(kStation, reg::kSyncManager + 8 + 6, static_cast<std::uint8_t>(sync_manager::kEnabled | sync_manager::kRepeat));
  EXPECT_EQ(a.wire.read(kStation, reg::kSyncManager + 8 + 7, 1).value(), sync_manager::kRepeat);
  const auto again = a.wire.read(kStation, 0x18f6, 246);
  EXPECT_EQ(again.count, 1);
  EXPECT_EQ(again.data, lost.data);
}

TEST(Coe, AForeignProtocolIsAnsweredWithAMailboxError) {
  Axis a;
  a.wire.set_sync_managers(0);
  a.request(State::kPreOp);
  Bytes mail(246);
  mail[0] = 4;
  mail[5] = static_cast<std::uint8_t>(MailType::kFoE);
  a.wire.write_bytes(kStation, 0x1800, mail);
  const auto answer = a.wire.read(kStation, 0x18f6, 246);
  ASSERT_EQ(answer.count, 1);
  EXPECT_EQ(answer.data[5] & 0x0f, 0);
  EXPECT_EQ(answer.data[8], 2);  // the protocol is not supported
}

/// An object owner without rules.
struct Free final : ObjectOwner {
  void refresh(const ObjectEntry&) override {}
  SdoAbort check(const ObjectEntry&, std::span<const std::uint8_t>) override { return SdoAbort::kNone; }
};

TEST(Coe, ValuesOfEveryLengthCrossMailboxesOfEverySize) {
  Free owner;
  for (const std::size_t size : {16u, 17u, 20u, 24u, 128u}) {
    for (std::size_t length = 0; length < 300; length += length < 40 ? 1 : 37) {
      std::string text;
      for (std::size_t i = 0; i < length; ++i) text += static_cast<char>('a' + i % 23);
      ObjectDictionary objects;
      objects.add_text(0x2000, 1, "text", text);
      CoeServer server(objects, owner, size, size);
      SdoClient client(size, size);
      client.upload(0x2000, 1);
      auto result = SdoClient::Result::kContinue;
      for (int mails = 0; result == SdoClient::Result::kContinue && mails < 100; ++mails) {
        ASSERT_LE(client.request().size(), size);
        const auto answer = server.answer(client.request());
        ASSERT_LE(answer.size(), size);
        result = client.receive(answer);
      }
      ASSERT_EQ(result, SdoClient::Result::kDone) << size << " " << length;
      EXPECT_EQ(std::string(client.data().begin(), client.data().end()), text);
    }
  }
}

TEST(Coe, LongValuesAreDownloadedInSegments) {
  Free owner;
  for (const std::size_t size : {16u, 17u, 19u, 32u}) {
    ObjectDictionary objects;
    objects.add(0x2000, 1, "value", object_type::kU32, 64, 0, true);
    CoeServer server(objects, owner, size, size);
    SdoClient client(size, size);
    client.download(0x2000, 1, Bytes{1, 2, 3, 4, 5, 6, 7, 8});
    auto result = SdoClient::Result::kContinue;
    int mails = 0;
    for (; result == SdoClient::Result::kContinue && mails < 10; ++mails)
      result = client.receive(server.answer(client.request()));
    EXPECT_EQ(result, SdoClient::Result::kDone);
    EXPECT_EQ(mails > 1, size < 24) << size;
    EXPECT_EQ(objects.number(0x2000, 1), 0x0807060504030201u);
  }
}

TEST(Coe, ASegmentWithTheWrongToggleAborts) {
  Free owner;
  ObjectDictionary objects;
  objects.add_text(0x2000, 0, "text", std::string(50, 'x'));
  CoeServer server(objects, owner, 20, 20);
  SdoClient client(20, 20);
  client.upload(0x2000, 0);
  const auto first = server.answer(client.request());
  EXPECT_EQ(client.receive(first), SdoClient::Result::kContinue);
  Bytes request(client.request().begin(), client.request().end());
  request[8] |= sdo::kToggle;
  const auto answer = server.answer(request);
  EXPECT_EQ(client.receive(answer), SdoClient::Result::kAborted);
  EXPECT_EQ(client.abort_code(), SdoAbort::kToggle);
}

TEST(Coe, TheListOfObjectsCrossesSmallMailboxesInParts) {
  Free owner;
  for (const std::size_t size : {16u, 18u, 64u}) {
    ObjectDictionary objects;
    std::vector<std::uint16_t> expected;
    for (std::uint16_t i = 0; i < 9; ++i) {
      expected.push_back(static_cast<std::uint16_t>(0x2000 + 3 * i));
      objects.add(expected.back(), 0, "count", object_type::kU8, 8, 1);
      objects.add(expected.back(), 1, "value", object_type::kU16, 16, i);
    }
    CoeServer server(objects, owner, size, size);
    Bytes request(16);
    write_coe(request, CoeService::kSdoInformation, 1, 6)[kCoeHeader] = 1;
    store(&request[kCoeHeader + 4], std::uint16_t{1});  // all objects
    std::vector<std::uint16_t> found;
    std::size_t left = 99;
    for (auto mail = server.answer(request); !mail.empty(); mail = server.next_part()) {
      ASSERT_LE(mail.size(), size);
      const auto coe = read_coe(mail);
      ASSERT_TRUE(coe && coe->service == CoeService::kSdoInformation);
      const auto rest = load<std::uint16_t>(&coe->content[2]);
      EXPECT_LT(rest, left);
      left = rest;
      EXPECT_EQ((coe->content[0] & 0x80) != 0, rest != 0);
      for (std::size_t at = found.empty() ? 6 : 4; at + 2 <= coe->content.size(); at += 2) {
        found.push_back(load<std::uint16_t>(&coe->content[at]));
      }
    }
    EXPECT_EQ(left, 0u);
    EXPECT_EQ(found, expected) << size;
  }
}

TEST(Coe, AnObjectAndItsEntriesAreDescribed) {
  Axis a;
  a.wire.set_sync_managers(0);
  a.request(State::kPreOp);
  std::uint8_t counter = 0;
  const auto ask = [&](std::uint8_t operation, std::uint16_t index, std::uint8_t subindex) {
    Bytes mail(246);
    write_coe(mail, CoeService::kSdoInformation, ++counter, 8)[kCoeHeader] = operation;
    store(&mail[kCoeHeader + 4], index);
    mail[kCoeHeader + 6] = subindex;
    a.wire.write_bytes(kStation, 0x1800, mail);
    const auto answer = a.wire.read(kStation, 0x18f6, 246);
    const auto coe = read_coe(answer.data);
    return coe ? Bytes(coe->content.begin(), coe->content.end()) : Bytes();
  };
  const Bytes object = ask(3, 0x1018, 0);
  ASSERT_GE(object.size(), 10u);
  EXPECT_EQ(object[0], 4);
  EXPECT_EQ(object[8], 4);  // highest subindex
  EXPECT_EQ(object[9], 9);  // record
  EXPECT_EQ(std::string(object.begin() + 10, object.end()), "Identity");
  const Bytes entry = ask(5, 0x1018, 2);
  ASSERT_GE(entry.size(), 14u);
  EXPECT_EQ(entry[0], 6);
  EXPECT_EQ(load<std::uint16_t>(&entry[8]), object_type::kU32);
  EXPECT_EQ(load<std::uint16_t>(&entry[10]), 32);
  EXPECT_EQ(load<std::uint16_t>(&entry[12]), 0x07);  // read in PREOP, SAFEOP and OP
  EXPECT_EQ(std::string(entry.begin() + 14, entry.end()), "Product code");
  const Bytes none = ask(3, 0x5555, 0);
  ASSERT_EQ(none.size(), 8u);
  EXPECT_EQ(none[0], 7);
  EXPECT_EQ(load<std::uint32_t>(&none[4]), static_cast<std::uint32_t>(SdoAbort::kNoObject));
}

TEST(Coe, TheStateOfTheMailboxCanBeMappedIntoTheProcessData) {
  // As masters do: an FMMU on the status byte of sync manager 1, whose bit 3 is "full".
  Axis a;
  a.wire.set_sync_managers(0);
  a.request(State::kPreOp);
  a.wire.set_fmmu(kStation, 2, 0x500, 1, 0, 0, reg::kSyncManager + 8 + 5, 3, fmmu::kRead);
  EXPECT_EQ(a.wire.send(Command::kLrd, 0x500, {0xf0}).data[0], 0xf0);
  a.client.upload(0x1018, 1);
  Bytes mail(246);
  std::copy(a.client.request().begin(), a.client.request().end(), mail.begin());
  a.wire.write_bytes(kStation, 0x1800, mail);
  EXPECT_EQ(a.wire.send(Command::kLrd, 0x500, {0xf0}).data[0], 0xf1);
  a.wire.read(kStation, 0x18f6, 246);
  EXPECT_EQ(a.wire.send(Command::kLrd, 0x500, {0xf0}).data[0], 0xf0);
}

TEST(Slave, EveryRealImageMakesASlaveThatReachesOp) {
  const std::string folder = captures_folder() + "/sii_dumps";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "needs scripts/fetch_logs.py --tests";
  for (const char* const name : {"akd.hex", "ek1100.hex", "el2004-eeprom-dump.bin", "el2262.bin", "el2828.hex", "el2889.hex",
                                 "hbm_clipx_eeprom_dump.bin"}) {
    Bus bus;
    Slave& slave = bus.append(std::make_unique<Slave>(file_bytes(folder + "/" + name)));
    BusWire w(bus);
    w.number_stations();
    int n = 0;
    std::size_t outputs = 0;
    for (const SiiSyncManager& s : slave.sii().sync_managers) {
      std::uint16_t length = s.length;
      std::size_t bits = 0;
      for (const auto* pdos : {&slave.sii().rx_pdos, &slave.sii().tx_pdos}) {
        for (const Pdo& p : *pdos) bits += p.sync_manager == n ? p.bits() : 0;
      }
      if (s.type == SyncManagerType::kOutputs || s.type == SyncManagerType::kInputs) {
        if (bits != 0) length = static_cast<std::uint16_t>((bits + 7) / 8);
        if (s.type == SyncManagerType::kOutputs) outputs += length;
      } else if (s.type == SyncManagerType::kMailboxOut) {
        length = slave.sii().mailbox.out_size;
      } else if (s.type == SyncManagerType::kMailboxIn) {
        length = slave.sii().mailbox.in_size;
      }
      w.set_sync_manager(kStation, n++, s.start, length, s.control);
    }
    w.request(kStation, State::kPreOp);
    w.request(kStation, State::kSafeOp);
    EXPECT_EQ(w.status(kStation), 0x04) << name << " code " << static_cast<int>(w.code(kStation));
    for (int m = 0; m < n; ++m) {
      const auto& s = slave.esc().sync_manager(m);
      if (s.enabled && s.master_writes() && !s.mailbox()) {
        EXPECT_EQ(w.write_bytes(kStation, s.start, Bytes(s.length, 0xff)), 1);
      }
    }
    EXPECT_EQ(w.request(kStation, State::kOp), 0x08) << name;
    EXPECT_EQ(slave.output_bytes(), outputs) << name;
    w.status(kStation);
    for (const std::uint8_t byte : slave.outputs()) EXPECT_EQ(byte, 0xff) << name;
  }
}

}  // namespace
}  // namespace cotwin::ethercat::slave_test
