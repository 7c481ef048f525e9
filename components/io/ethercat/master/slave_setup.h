#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "components/io/ethercat/registers.h"
#include "components/io/ethercat/sii.h"

/// What a master needs to know about a slave before it can exchange process data with it.
namespace cotwin::ethercat {

/// A value in the process data of a slave.
struct Channel {
  std::uint16_t index = 0;  // of the object dictionary
  std::uint8_t subindex = 0;
  std::string name;
  std::size_t bit = 0;  // first bit within the inputs or outputs of the slave
  std::size_t bits = 0;
  bool operator==(const Channel&) const = default;
};

/// A sync manager that carries process data. Its PDOs are packed without gaps from its start on.
struct ProcessData {
  std::uint8_t sync_manager = 0;
  std::uint16_t start = 0, length = 0;  // bytes
  std::uint8_t control = 0;
  bool outputs = false;             // from the master to the slave
  std::size_t offset = 0;           // of its bytes within the inputs or outputs of the slave
  std::vector<std::uint16_t> pdos;  // indices
};

/// An object that is downloaded while the slave is set up.
struct StartUpValue {
  std::uint16_t index = 0;
  std::uint8_t subindex = 0;
  std::vector<std::uint8_t> data;  // little endian
  bool before_op = false;          // in SAFEOP, before it goes to OP; otherwise in PREOP, before it goes to SAFEOP
  std::string origin;              // for messages: "drives.csv:3"; empty: the assignment of PDOs
};

struct SlaveSetup {
  std::string device;  // "EL1809"
  std::uint32_t vendor = 0, product = 0;
  SiiMailbox mailbox;  // sizes 0: none
  bool has_coe = false;
  std::vector<StartUpValue> start_up;
  std::vector<ProcessData> process_data;
  std::vector<Channel> inputs, outputs;  // gaps are left out
  std::size_t input_bytes = 0, output_bytes = 0;
};

/// PDOs that a user or a profile chooses; empty: those that the SII assigns to a sync manager.
struct PdoChoice {
  std::vector<std::uint16_t> outputs, inputs;  // indices, such as 0x1603 and 0x1a04
};

/// The setup of a slave from its SII. Chosen PDOs are assigned over CoE (objects 0x1C12 and 0x1C13). Throws Error `place: …` for a PDO that
/// the slave does not have, a PDO without sync manager, and a choice that the slave cannot take because it has no CoE.
SlaveSetup setup_of(const Sii& sii, const PdoChoice& choice, const std::string& place);

/// "EL1809 (vendor 0x00000002, product 0x07113052)".
std::string describe_identity(std::string_view device, std::uint32_t vendor, std::uint32_t product);

}  // namespace cotwin::ethercat
