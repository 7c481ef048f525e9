#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

/// The slave information interface (SII): the image in a slave's EEPROM (ETG.1000.6, ETG.2010), as plain values.
namespace cotwin::ethercat {

struct SiiMailbox {
  std::uint16_t out = 0, out_size = 0;  // start and bytes of the mailbox that the master writes
  std::uint16_t in = 0, in_size = 0;    // … that the master reads
  bool operator==(const SiiMailbox&) const = default;
};

/// Bits of Sii::protocols.
namespace mailbox_protocol {
inline constexpr std::uint16_t kAoE = 1, kEoE = 2, kCoE = 4, kFoE = 8, kSoE = 16, kVoE = 32;
}

/// Category GENERAL.
struct SiiGeneral {
  std::string group, image, order, name;
  std::uint8_t coe = 0;  // bit 0 SDO, 1 SDO information, 2 PDO assignment, 3 PDO mapping, 4 upload at start, 5 complete access
  std::uint8_t foe = 0, eoe = 0, flags = 0;
  std::int16_t ebus_current = 0;     // mA; negative: supplies
  std::uint16_t physical_ports = 0;  // 4 bits per port: 0 none, 1 MII, 3 EBUS
  bool operator==(const SiiGeneral&) const = default;
};

enum class SyncManagerType : std::uint8_t { kUnused, kMailboxOut, kMailboxIn, kOutputs, kInputs };

/// Category SYNCM: one sync manager.
struct SiiSyncManager {
  std::uint16_t start = 0, length = 0;  // bytes
  std::uint8_t control = 0, status = 0;
  std::uint8_t enable = 0;  // bit 0: enable
  SyncManagerType type = SyncManagerType::kUnused;
  bool operator==(const SiiSyncManager&) const = default;
};

/// A value in a PDO; index 0: a gap.
struct PdoEntry {
  std::uint16_t index = 0;
  std::uint8_t subindex = 0;
  std::string name;
  std::uint8_t type = 0;  // data type of the object dictionary: 1 BOOL, 5 U8, 6 U16, 7 U32
  std::uint8_t bits = 0;
  std::uint16_t flags = 0;
  bool operator==(const PdoEntry&) const = default;
};

inline constexpr std::uint8_t kNotAssigned = 0xff;

struct Pdo {
  std::uint16_t index = 0;
  std::uint8_t sync_manager = kNotAssigned;
  std::uint8_t sync = 0;
  std::string name;
  std::uint16_t flags = 0;
  std::vector<PdoEntry> entries;

  std::size_t bits() const;
  bool operator==(const Pdo&) const = default;
};

/// Category DC: one mode of synchronisation.
struct SiiClockMode {
  std::uint32_t sync0_cycle = 0;      // ns
  std::int32_t sync0_shift = 0;       // ns
  std::int32_t sync1_shift = 0;       // ns
  std::int16_t sync1_factor = 0;      // SYNC1 cycle in SYNC0 cycles
  std::uint16_t assign_activate = 0;  // to 0x0980 and 0x0981
  std::int16_t sync0_factor = 0;      // SYNC0 cycle in cycles of the master
  std::string name;
  std::string description;
  bool operator==(const SiiClockMode&) const = default;
};

/// A category that is not among the above, such as those of the manufacturer.
struct SiiCategory {
  std::uint16_t type = 0;
  std::vector<std::uint8_t> data;  // an even number of bytes
  bool operator==(const SiiCategory&) const = default;
};

struct Sii {
  std::uint16_t pdi_control = 0, pdi_config = 0, sync_impulse = 0, pdi_config2 = 0;
  std::uint16_t alias = 0;
  bool checksum_correct = true;  // of the image that was read; ignored by write_sii
  std::uint32_t vendor = 0, product = 0, revision = 0, serial = 0;
  SiiMailbox bootstrap, mailbox;
  std::uint16_t protocols = 0;  // mailbox_protocol::…
  std::uint16_t size_kibit = 1;
  std::uint16_t version = 1;
  SiiGeneral general;
  std::vector<std::uint8_t> fmmus;  // use of each FMMU: 1 outputs, 2 inputs, 3 state of the mailbox
  std::vector<SiiSyncManager> sync_managers;
  std::vector<Pdo> tx_pdos;  // inputs of the master
  std::vector<Pdo> rx_pdos;  // outputs of the master
  std::vector<SiiClockMode> clock_modes;
  std::vector<SiiCategory> others;
  bool operator==(const Sii&) const = default;
};

/// CRC-8 (polynomial 0x07, initial value 0xFF) of bytes 0 to 13 of an image, its byte 14.
std::uint8_t sii_checksum(std::span<const std::uint8_t> image);

/// Reads an image. Names that are numbered past the end of the strings become empty; a wrong checksum is reported in the result, as
/// slaves and masters do. Throws Error `place: …` if the image is shorter than 128 bytes or a category reaches past its end.
Sii read_sii(std::span<const std::uint8_t> image, const std::string& place);

/// The image of `sii`: its size is `size_kibit`, or more if the content needs it; unused bytes are 0xFF. Throws Error if a category is
/// too long for the format.
std::vector<std::uint8_t> write_sii(const Sii& sii);

}  // namespace cotwin::ethercat
