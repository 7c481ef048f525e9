#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/devices.h"
#include "components/io/ethercat/master/bus_setup.h"
#include "components/unit/settings.h"

namespace cotwin::io {

/// A slave that the setting `slaves` names.
struct SlaveChoice {
  enum class Kind : std::uint8_t { kCoupler, kDigitalInputs, kDigitalOutputs, kEncoder, kDrive, kImage };

  std::string name;    // prefix of its ports; empty: it has none
  std::string device;  // "EL1809", or the order number in the SII
  Kind kind = Kind::kCoupler;
  std::vector<std::uint8_t> image;               // kImage and kDrive: its SII; empty: a known device
  std::vector<ethercat::StartUpValue> start_up;  // of the user
  ethercat::SlaveSetup setup;

  /// Whether all its inputs (outputs) are single bits: then they are one port.
  bool is_digital(bool outputs) const;
};

/// Declares the settings `slaves` and `encoder_bits`.
void declare_ethercat_settings(SettingList& s);

/// Reads them: `slaves=EK1100,buttons:EL1809,valves:EL2809,axis:EL5101,door:EL1004.bin`, and
/// `drives`. Throws Error that names the word and the expectation.
std::vector<SlaveChoice> read_slaves(Settings& settings, const std::string& place);

/// Reads the setting `start_up` and gives the slaves its values. Throws Error for a name that no slave has.
void read_start_up_file(Settings& settings, std::vector<SlaveChoice>& slaves, const std::string& place);

/// The joint of each slave that has one: the encoders and drives in the order of the bus. Throws Error if there are more than joints.
std::vector<std::size_t> joints_of(const std::vector<SlaveChoice>& slaves, std::size_t joints, const std::string& place);

/// What a master expects on the bus.
std::vector<ethercat::ExpectedSlave> expected_slaves(const std::vector<SlaveChoice>& slaves, bool sync0, double sync0_shift);

/// A new emulated slave of this kind.
std::unique_ptr<ethercat::Slave> make_slave(const SlaveChoice& choice, const ethercat::ClockOptions& clock);

/// Value of `bits` bits (at most 32) from bit `bit` on, and its counterpart.
std::uint32_t read_bits(std::span<const std::uint8_t> bytes, std::size_t bit, std::size_t bits);
void write_bits(std::span<std::uint8_t> bytes, std::size_t bit, std::size_t bits, std::uint32_t value);

}  // namespace cotwin::io
