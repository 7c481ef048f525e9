#pragma once
#include <cstdint>

/// Registers of an EtherCAT slave controller (ESC): addresses, bits and values (ETG.1000.4 and the data sheet of the ET1100).
namespace cotwin::ethercat {

namespace reg {
inline constexpr std::uint16_t kType = 0x0000;
inline constexpr std::uint16_t kFmmuCount = 0x0004;
inline constexpr std::uint16_t kSyncManagerCount = 0x0005;
inline constexpr std::uint16_t kRamSize = 0x0006;   // KiB
inline constexpr std::uint16_t kPorts = 0x0007;     // 2 bits per port: 0 none, 1 not configured, 2 EBUS, 3 MII
inline constexpr std::uint16_t kFeatures = 0x0008;  // feature::…
inline constexpr std::uint16_t kStation = 0x0010;
inline constexpr std::uint16_t kAlias = 0x0012;
inline constexpr std::uint16_t kDlControl = 0x0100;
inline constexpr std::uint16_t kPortControl = 0x0101;   // 2 bits per port: 0 automatic, 1 automatic closing, 2 open, 3 closed
inline constexpr std::uint16_t kAliasControl = 0x0103;  // bit 0: FP… commands also reach the alias
inline constexpr std::uint16_t kDlStatus = 0x0110;
inline constexpr std::uint16_t kAlControl = 0x0120;
inline constexpr std::uint16_t kAlStatus = 0x0130;
inline constexpr std::uint16_t kAlStatusCode = 0x0134;  // AlCode
inline constexpr std::uint16_t kPdiControl = 0x0140;    // bit 8: the controller copies AL control to AL status
inline constexpr std::uint16_t kEventMask = 0x0200;
inline constexpr std::uint16_t kEventRequest = 0x0210;     // event::…
inline constexpr std::uint16_t kErrorCounters = 0x0300;    // per port: invalid frames, receive errors
inline constexpr std::uint16_t kForwardedErrors = 0x0308;  // per port
inline constexpr std::uint16_t kProcessingErrors = 0x030C;
inline constexpr std::uint16_t kPdiErrors = 0x030D;
inline constexpr std::uint16_t kLostLinks = 0x0310;        // per port
inline constexpr std::uint16_t kWatchdogDivider = 0x0400;  // (divider + 2) * 40 ns is the unit of the watchdog times
inline constexpr std::uint16_t kPdiWatchdog = 0x0410;
inline constexpr std::uint16_t kProcessDataWatchdog = 0x0420;
inline constexpr std::uint16_t kWatchdogStatus = 0x0440;  // bit 0: 1 = running or switched off, 0 = expired
inline constexpr std::uint16_t kWatchdogCounter = 0x0442;
inline constexpr std::uint16_t kSiiConfig = 0x0500;
inline constexpr std::uint16_t kSiiControl = 0x0502;  // sii_control::…
inline constexpr std::uint16_t kSiiAddress = 0x0504;  // word address
inline constexpr std::uint16_t kSiiData = 0x0508;
inline constexpr std::uint16_t kFmmu = 0x0600;
inline constexpr std::uint16_t kFmmuSize = 16;  // bytes
inline constexpr std::uint16_t kSyncManager = 0x0800;
inline constexpr std::uint16_t kSyncManagerSize = 8;    // bytes
inline constexpr std::uint16_t kReceiveTimes = 0x0900;  // 4 ports of 4 bytes; a write latches them on the same frame
inline constexpr std::uint16_t kSystemTime = 0x0910;
inline constexpr std::uint16_t kReceiveTime = 0x0918;  // at the processing unit, 64 bit
inline constexpr std::uint16_t kSystemTimeOffset = 0x0920;
inline constexpr std::uint16_t kSystemTimeDelay = 0x0928;
inline constexpr std::uint16_t kSystemTimeDifference =
    0x092C;  // bit 31: local copy < received, bits 0 to 30: mean magnitude, ns
inline constexpr std::uint16_t kSpeedCounterStart = 0x0930;
inline constexpr std::uint16_t kSpeedCounterDifference = 0x0932;
inline constexpr std::uint16_t kDifferenceFilter = 0x0934;  // depth
inline constexpr std::uint16_t kSpeedFilter = 0x0935;       // depth
inline constexpr std::uint16_t kCyclicControl = 0x0980;
inline constexpr std::uint16_t kActivation = 0x0981;  // bit 0: cyclic operation, bit 1: SYNC0, bit 2: SYNC1
inline constexpr std::uint16_t kPulseLength = 0x0982;
inline constexpr std::uint16_t kActivationStatus = 0x0984;
inline constexpr std::uint16_t kSync0Status = 0x098E;
inline constexpr std::uint16_t kStartTime = 0x0990;  // write: system time of the first SYNC0; read: of the next
inline constexpr std::uint16_t kNextSync1 = 0x0998;
inline constexpr std::uint16_t kSync0Cycle = 0x09A0;  // ns
inline constexpr std::uint16_t kSync1Cycle = 0x09A4;  // ns
inline constexpr std::uint16_t kDigitalOutputs = 0x0F00;
inline constexpr std::uint16_t kProcessRam = 0x1000;
}  // namespace reg

namespace feature {
inline constexpr std::uint16_t kClock = 0x0004;
inline constexpr std::uint16_t kNoLrw = 0x0200;
inline constexpr std::uint16_t kNoReadWrite = 0x0400;  // no BRW, APRW, FPRW
}  // namespace feature

namespace event {
inline constexpr std::uint16_t kLatch = 0x0001;
inline constexpr std::uint16_t kDlStatus = 0x0004;
inline constexpr std::uint16_t kAlStatus = 0x0008;
inline constexpr std::uint16_t kSyncManager0 = 0x0010;  // bits 4 to 11: sync manager 0 to 7
}  // namespace event

namespace sii_control {
inline constexpr std::uint16_t kWriteEnable = 0x0001;
inline constexpr std::uint16_t kReads8Bytes = 0x0040;
inline constexpr std::uint16_t kRead = 0x0100;
inline constexpr std::uint16_t kWrite = 0x0200;
inline constexpr std::uint16_t kReload = 0x0400;  // some masters write 0x0300
inline constexpr std::uint16_t kCommands = 0x0700;
inline constexpr std::uint16_t kChecksumError = 0x0800;
inline constexpr std::uint16_t kNotLoaded = 0x1000;
inline constexpr std::uint16_t kCommandError = 0x2000;
inline constexpr std::uint16_t kWriteError = 0x4000;
inline constexpr std::uint16_t kBusy = 0x8000;
inline constexpr std::uint16_t kErrors = kCommandError | kNotLoaded;  // of a command to read
}  // namespace sii_control

/// States of the application layer; the values are those of AL control and AL status.
enum class State : std::uint8_t { kInit = 1, kPreOp = 2, kBootstrap = 3, kSafeOp = 4, kOp = 8 };

inline constexpr std::uint16_t kStateBits = 0x000f;
/// In AL status: error; in AL control: its acknowledgement.
inline constexpr std::uint16_t kStateError = 0x0010;

/// AL status codes (ETG.1000.6, table 11).
enum class AlCode : std::uint16_t {
  kNone = 0,
  kUnspecified = 0x0001,
  kInvalidChange = 0x0011,
  kUnknownState = 0x0012,
  kNoBootstrap = 0x0013,
  kMailboxBootstrap = 0x0015,
  kMailbox = 0x0016,
  kSyncManagers = 0x0017,
  kNoInputs = 0x0018,
  kNoOutputs = 0x0019,
  kSynchronisation = 0x001A,
  kWatchdog = 0x001B,
  kOutputs = 0x001D,
  kInputs = 0x001E,
  kClockSetUp = 0x0030,
  kNoSync = 0x002D,
  kClockLost = 0x0032,
  kClockSync = 0x0033,
  kSync0Cycle = 0x0036,
};

/// Bits of the control byte and the other bytes of a sync manager.
namespace sync_manager {
inline constexpr std::uint8_t kModeBits = 0x03;  // 0: three buffers, 2: mailbox
inline constexpr std::uint8_t kMailbox = 0x02;
inline constexpr std::uint8_t kDirectionBits = 0x0c;  // 0: the master reads, 4: the master writes
inline constexpr std::uint8_t kMasterWrites = 0x04;
inline constexpr std::uint8_t kMasterEvent = 0x10;
inline constexpr std::uint8_t kWatchdog = 0x40;
inline constexpr std::uint8_t kEnabled = 0x01;     // activate byte
inline constexpr std::uint8_t kRepeat = 0x02;      // activate byte
inline constexpr std::uint8_t kWriteEvent = 0x01;  // status byte
inline constexpr std::uint8_t kReadEvent = 0x02;   // status byte
inline constexpr std::uint8_t kFull = 0x08;        // status byte: mailbox full
}  // namespace sync_manager

/// Type byte of an FMMU.
namespace fmmu {
inline constexpr std::uint8_t kRead = 1;   // inputs: the master reads
inline constexpr std::uint8_t kWrite = 2;  // outputs: the master writes
}  // namespace fmmu

}  // namespace cotwin::ethercat
