#include "components/io/emulators/ethercat_slaves.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>

#include "components/io/emulators/ethercat/servo_drive.h"
#include "components/io/ethercat/master/start_up.h"

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

using ethercat::ExpectedSlave;

constexpr std::uint16_t kWithSync0 = 0x0300;  // cyclic operation and SYNC0

struct Known {
  const char* device;
  SlaveChoice::Kind kind;
  ethercat::Sii (*sii)();
};

constexpr Known kKnown[] = {{"EK1100", SlaveChoice::Kind::kCoupler, ethercat::ek1100_sii},
                            {"EL1809", SlaveChoice::Kind::kDigitalInputs, ethercat::el1809_sii},
                            {"EL2809", SlaveChoice::Kind::kDigitalOutputs, ethercat::el2809_sii},
                            {"EL5101", SlaveChoice::Kind::kEncoder, ethercat::el5101_sii},
                            {"DRIVE402", SlaveChoice::Kind::kDrive, ethercat::servo_drive_sii}};

bool is_identifier(const std::string& name) {
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
  return !name.empty() && letter(name[0]) &&
         std::all_of(name.begin(), name.end(), [&](char c) { return letter(c) || (c >= '0' && c <= '9'); });
}

std::vector<std::uint8_t> read_image(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw Error(path.string(), "cannot be read, expected an SII image");
  return {std::istreambuf_iterator<char>(file), {}};
}

ethercat::PdoChoice encoder_pdos(bool wide) { return wide ? ethercat::PdoChoice{{0x1603}, {0x1a04}} : ethercat::PdoChoice{}; }

/// The devices of SII images that `list` names are drives.
void choose_drives(const std::string& list, std::vector<SlaveChoice>& slaves, const std::string& place) {
  if (list.empty()) return;
  for (const std::string_view part : text::split(list, ',')) {
    const auto slave = std::ranges::find(slaves, text::trim(part), &SlaveChoice::name);
    if (slave == slaves.end() || slave->kind != SlaveChoice::Kind::kImage) {
      throw Error(place,
                  "drives: '" + std::string(part) + "', expected the name of a slave that is described by its SII image");
    }
    slave->kind = SlaveChoice::Kind::kDrive;
  }
}

}  // namespace

bool SlaveChoice::is_digital(bool outputs) const {
  const std::vector<ethercat::Channel>& channels = outputs ? setup.outputs : setup.inputs;
  return !channels.empty() &&
         std::all_of(channels.begin(), channels.end(), [](const ethercat::Channel& c) { return c.bits == 1; });
}

void declare_ethercat_settings(SettingList& s) {
  s.text(
      "slaves", "",
      "link=ethercat, ethercat_bus: the slaves in the order of the bus, as in "
      "EK1100,buttons:EL1809,valves:EL2809,axis:EL5101,q1:DRIVE402; "
      "door:EL1004.bin: a device that is described by its SII image in that file; the name before the colon is the prefix of "
      "its ports");
  s.text("drives", "",
         "link=ethercat, ethercat_bus: names of the slaves with an SII image that are drives with the profile CiA 402, as in "
         "q1,q2; each moves a joint. DRIVE402, the emulated drive, is one without this");
  s.text("start_up", "",
         "link=ethercat: file of values that are written over CoE at the start, with the lines "
         "slave,when,index,subindex,type,value (docs/ethercat_drives.md)");
  s.integer("encoder_bits", 16, 16, 32, "link=ethercat: bits of the counters of EL5101: 16, or 32, which is set up over CoE");
  s.text("interface", "emulated",
         "link=ethercat, ethercat_bus: network interface of the bus; emulated: a bus within this program, whose field side are "
         "further ports");
  s.boolean("clocks", true, "link=ethercat: whether distributed clocks are synchronised");
}

std::vector<SlaveChoice> read_slaves(Settings& settings, const std::string& place) {
  const std::string list = settings.text("slaves");
  const long long bits = settings.integer("encoder_bits");
  if (bits != 16 && bits != 32) throw Error(place, "encoder_bits=" + std::to_string(bits) + ", expected 16 or 32");
  if (list.empty()) {
    throw Error(place, "slaves is missing, expected the slaves in the order of the bus, as in slaves=EK1100,buttons:EL1809");
  }
  std::vector<SlaveChoice> slaves;
  for (const std::string_view part : text::split(list, ',')) {
    const std::string word(part);
    SlaveChoice choice;
    const std::size_t colon = word.find(':');
    choice.name = colon == std::string::npos ? "" : word.substr(0, colon);
    choice.device = colon == std::string::npos ? word : word.substr(colon + 1);
    if (colon != std::string::npos && !is_identifier(choice.name)) {
      throw Error(place, "slaves: '" + choice.name + "' cannot be a name, expected letters, digits and underscores");
    }
    if (choice.device.ends_with(".bin")) {
      choice.kind = SlaveChoice::Kind::kImage;
      const std::filesystem::path path = settings.data_file(choice.device);
      choice.image = read_image(path);
      const ethercat::Sii sii = ethercat::read_sii(choice.image, path.string());
      choice.setup = ethercat::setup_of(sii, {}, path.string());
      choice.device = choice.setup.device.empty() ? path.filename().string() : choice.setup.device;
    } else {
      const auto known =
          std::find_if(std::begin(kKnown), std::end(kKnown), [&](const Known& k) { return choice.device == k.device; });
      if (known == std::end(kKnown)) {
        throw Error(
            place,
            "slaves: no device '" + choice.device +
                "', expected EK1100, EL1809, EL2809, EL5101, DRIVE402 or the file of an SII image, as in door:EL1004.bin");
      }
      choice.kind = known->kind;
      const bool wide = bits == 32 && choice.kind == SlaveChoice::Kind::kEncoder;
      choice.setup = ethercat::setup_of(known->sii(), encoder_pdos(wide), place);
    }
    const bool has_data = !choice.setup.process_data.empty();
    if (has_data && choice.name.empty()) {
      throw Error(place, "slaves: " + choice.device + " has process data, expected a name for its ports, as in name:" + word);
    }
    const bool twice = !choice.name.empty() &&
                       std::any_of(slaves.begin(), slaves.end(), [&](const SlaveChoice& s) { return s.name == choice.name; });
    if (twice) throw Error(place, "slaves: two slaves are named '" + choice.name + "', expected different names");
    slaves.push_back(std::move(choice));
  }
  choose_drives(settings.text("drives"), slaves, place);
  return slaves;
}

void read_start_up_file(Settings& settings, std::vector<SlaveChoice>& slaves, const std::string& place) {
  const std::string name = settings.text("start_up");
  if (name.empty()) return;
  const std::filesystem::path path = settings.data_file(name);
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  if (!file) throw Error(path.string(), "cannot be read, expected a list of start-up values");
  for (ethercat::StartUpRow& row : ethercat::read_start_up(text, path.string())) {
    const auto slave = std::ranges::find(slaves, row.slave, &SlaveChoice::name);
    if (slave == slaves.end()) {
      throw Error(row.value.origin, "slave is '" + row.slave + "', expected a name in the setting slaves of " + place);
    }
    if (!slave->setup.has_coe) {
      throw Error(row.value.origin,
                  "slave " + row.slave + " (" + slave->device + ") has no mailbox with CoE, expected one that has");
    }
    slave->start_up.push_back(std::move(row.value));
  }
}

std::vector<std::size_t> joints_of(const std::vector<SlaveChoice>& slaves, std::size_t joints, const std::string& place) {
  std::vector<std::size_t> list(slaves.size());
  std::size_t encoders = 0, drives = 0;
  for (std::size_t i = 0; i < slaves.size(); ++i) {
    list[i] = encoders + drives;
    encoders += slaves[i].kind == SlaveChoice::Kind::kEncoder;
    drives += slaves[i].kind == SlaveChoice::Kind::kDrive;
  }
  if (encoders + drives <= joints) return list;
  throw Error(place, std::to_string(encoders) + " encoders" + (drives > 0 ? " and " + std::to_string(drives) + " drives" : "") +
                         ", but " + std::to_string(joints) +
                         " joints, expected at most one encoder or drive per joint (setting joints or robot)");
}

std::vector<ExpectedSlave> expected_slaves(const std::vector<SlaveChoice>& slaves, bool sync0, double sync0_shift) {
  std::vector<ExpectedSlave> expected;
  for (const SlaveChoice& choice : slaves) {
    ExpectedSlave e;
    e.name = choice.name;
    e.device = choice.device;
    e.vendor = choice.setup.vendor;
    e.product = choice.setup.product;
    e.start_up = choice.start_up;
    if (choice.kind == SlaveChoice::Kind::kEncoder) e.pdos = encoder_pdos(!choice.setup.start_up.empty());
    if (choice.kind == SlaveChoice::Kind::kEncoder || choice.kind == SlaveChoice::Kind::kDrive) {
      if (sync0) e.sync_activation = kWithSync0;
      e.sync0_shift = std::llround(sync0_shift * 1e9);
    }
    e.input_bytes = choice.setup.input_bytes;
    e.output_bytes = choice.setup.output_bytes;
    expected.push_back(std::move(e));
  }
  return expected;
}

std::unique_ptr<ethercat::Slave> make_slave(const SlaveChoice& choice, const ethercat::ClockOptions& clock) {
  switch (choice.kind) {
    case SlaveChoice::Kind::kCoupler:
      return std::make_unique<ethercat::Ek1100>(ethercat::ek1100_options(clock));
    case SlaveChoice::Kind::kDigitalInputs:
      return std::make_unique<ethercat::El1809>(ethercat::terminal_options(clock));
    case SlaveChoice::Kind::kDigitalOutputs:
      return std::make_unique<ethercat::El2809>(ethercat::terminal_options(clock));
    case SlaveChoice::Kind::kEncoder:
      return std::make_unique<ethercat::El5101>(ethercat::terminal_options(clock));
    case SlaveChoice::Kind::kDrive:
      if (choice.image.empty()) return std::make_unique<ethercat::ServoDrive>(ethercat::terminal_options(clock));
      break;
    case SlaveChoice::Kind::kImage:
      break;
  }
  return std::make_unique<ethercat::Slave>(choice.image, ethercat::terminal_options(clock));
}

std::uint32_t read_bits(std::span<const std::uint8_t> bytes, std::size_t bit, std::size_t bits) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < bits; ++i) {
    const std::size_t at = bit + i;
    value |= (static_cast<std::uint32_t>(bytes[at / 8]) >> (at % 8) & 1u) << i;
  }
  return value;
}

void write_bits(std::span<std::uint8_t> bytes, std::size_t bit, std::size_t bits, std::uint32_t value) {
  for (std::size_t i = 0; i < bits; ++i) {
    const std::size_t at = bit + i;
    const auto mask = static_cast<std::uint8_t>(1u << (at % 8));
    bytes[at / 8] = static_cast<std::uint8_t>((value >> i & 1u) != 0 ? bytes[at / 8] | mask : bytes[at / 8] & ~mask);
  }
}

}  // namespace cotwin::io
