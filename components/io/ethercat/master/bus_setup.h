#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "components/io/ethercat/master/exchange.h"
#include "components/io/ethercat/master/sequence.h"
#include "components/io/ethercat/master/slave_setup.h"
#include "components/io/ethercat/master/topology.h"

/// Finding the slaves of a bus and bringing them to SAFEOP (ETG.1000.6, ETG.1020), with waiting: before a run.
namespace cotwin::ethercat {

/// A slave that the user expects.
struct ExpectedSlave {
  std::string name;                       // "axis"
  std::string device;                     // "EL5101"
  std::uint32_t vendor = 0, product = 0;  // 0: any
  PdoChoice pdos;
  std::size_t input_bytes = 0, output_bytes = 0;  // that its ports were made for
  std::vector<StartUpValue> start_up;             // of the user
  std::optional<Sii> sii;                         // instead of that in the slave
  std::uint16_t sync_activation = 0;              // to 0x0980 and 0x0981, with distributed clocks; 0: without SYNC0
  std::int64_t sync0_shift = 0;                   // ns
};

/// A slave that answers.
struct FoundSlave {
  std::uint16_t station = 0;
  std::uint16_t features = 0;
  std::uint8_t fmmus = 0, sync_managers = 0;
  SlavePorts ports;
  std::vector<std::uint8_t> image;  // of its SII
  Sii sii;
};

/// A slave in operation.
struct BusSlave {
  ExpectedSlave expected;
  FoundSlave found;
  SlaveSetup setup;
  Place place;                                            // with clocks
  std::uint32_t delay = 0;                                // ns from the reference clock
  std::size_t inputs_at = 0, outputs_at = 0;              // of its bytes in the images of all inputs and outputs
  std::uint32_t logical_inputs = 0, logical_outputs = 0;  // first logical addresses
  std::vector<Step> start;                                // from INIT to SAFEOP, after its station address was set
  std::vector<Step> address;  // sets the station address of a slave that lost it, after checking its identity
  std::vector<Step> run;      // from SAFEOP to OP
  SlaveTimes times;
};

/// Logical addresses from the beginning of a segment to that of the next.
/// ns without a frame after which slaves switch their outputs off.
inline constexpr std::int64_t kOutputWatchdog = 100'000'000;
inline constexpr std::uint32_t kSegmentSpan = 0x1000;

/// Part of the process image that one datagram exchanges.
struct Segment {
  std::uint32_t logical = 0;                     // its outputs, then its inputs
  std::size_t outputs_at = 0, output_bytes = 0;  // in the image of all outputs
  std::size_t inputs_at = 0, input_bytes = 0;
  bool combined = true;                           // one LRW; otherwise LWR and LRD
  std::uint16_t read_count = 0, write_count = 0;  // working counters of LRD and LWR
  std::uint16_t expected() const { return static_cast<std::uint16_t>(combined ? read_count + 2 * write_count : read_count); }
};

struct BusSetup {
  std::vector<BusSlave> slaves;
  std::vector<Segment> segments;
  std::size_t input_bytes = 0, output_bytes = 0;
  int reference = -1;  // position of the first slave with a clock; −1: none, or clocks are not used
};

struct SetupOptions {
  std::string place = "EtherCAT";           // for messages: "interface eth1"
  std::int64_t cycle = 1'000'000;           // ns, of SYNC0
  bool clocks = false;                      // distributed clocks
  int drift_frames = 15'000;                // that compensate the drift of the clocks before SAFEOP
  std::int64_t drift_time = 5'000'000'000;  // ns that they may take
  std::int64_t wait = 0;                    // ns for which a silent bus is waited for
  std::string sii_folder;                   // the SII images of all slaves are written there; empty: nowhere
  std::int64_t system_time = 0;             // ns since 2000-01-01, at Wire::now() == host_time
  std::int64_t host_time = 0;
};

/// The slaves that answer, after all were reset to INIT: with station addresses 0x1001 … and their SII. Throws Error if the bus is silent for `wait` (ns) or a
/// slave does not let its SII be read.
std::vector<FoundSlave> scan_bus(Exchange& exchange, const std::string& place, std::int64_t wait = 0);

/// Reads the whole SII image of a slave by its registers 0x0502 to 0x0508. Throws Error `place: …`.
std::vector<std::uint8_t> read_sii_image(Exchange& exchange, std::uint16_t station, const std::string& place);

/// "interface eth1: slave 2", for messages.
inline std::string position_of(const std::string& place, std::size_t i) { return place + ": slave " + std::to_string(i); }

/// Brings the expected slaves to SAFEOP. Throws Error that names the position, what answers there and what is expected, or the slave,
/// the state that it does not reach and its AL status code.
BusSetup set_up_bus(Exchange& exchange, const std::vector<ExpectedSlave>& expected, const SetupOptions& options);

}  // namespace cotwin::ethercat
