#include "components/io/ethercat/master/slave_setup.h"

#include <algorithm>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::ethercat {

namespace {

std::string hex(std::uint32_t value, int digits) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text = "0x";
  for (int shift = 4 * (digits - 1); shift >= 0; shift -= 4) text += kDigits[value >> shift & 15];
  return text;
}

/// Appends the channels of a PDO. Returns the bit after it.
std::size_t append(const Pdo& pdo, std::size_t bit, std::vector<Channel>& channels) {
  for (const PdoEntry& e : pdo.entries) {
    if (e.index != 0) channels.push_back({e.index, e.subindex, e.name, bit, e.bits});
    bit += e.bits;
  }
  return bit;
}

class SlaveBuilder {
 public:
  SlaveBuilder(const Sii& sii, const PdoChoice& choice, const std::string& place) : sii_(sii), choice_(choice), place_(place) {}

  SlaveSetup build() {
    setup_.device = sii_.general.order.empty() ? sii_.general.name : sii_.general.order;
    setup_.vendor = sii_.vendor;
    setup_.product = sii_.product;
    if (sii_.mailbox.out_size != 0 && sii_.mailbox.in_size != 0) setup_.mailbox = sii_.mailbox;
    setup_.has_coe = setup_.mailbox.out_size != 0 && (sii_.protocols & mailbox_protocol::kCoE) != 0;
    add_direction(true);
    add_direction(false);
    return std::move(setup_);
  }

 private:
  void add_direction(bool outputs) {
    const std::vector<Pdo>& pdos = outputs ? sii_.rx_pdos : sii_.tx_pdos;
    const std::vector<std::uint16_t>& chosen = outputs ? choice_.outputs : choice_.inputs;
    std::size_t& bytes = outputs ? setup_.output_bytes : setup_.input_bytes;
    std::vector<Channel>& channels = outputs ? setup_.outputs : setup_.inputs;
    const SyncManagerType type = outputs ? SyncManagerType::kOutputs : SyncManagerType::kInputs;
    bool first = true;
    for (std::size_t n = 0; n < sii_.sync_managers.size(); ++n) {
      const SiiSyncManager& sm = sii_.sync_managers[n];
      if (sm.type != type) continue;
      ProcessData data;
      data.sync_manager = static_cast<std::uint8_t>(n);
      data.start = sm.start;
      data.control = sm.control;
      data.outputs = outputs;
      data.offset = bytes;
      std::size_t bits = 0;
      for (const Pdo* pdo : chosen.empty() ? assigned(pdos, n) : first ? named(pdos, chosen) : std::vector<const Pdo*>()) {
        bits = append(*pdo, 8 * bytes + bits, channels) - 8 * bytes;
        data.pdos.push_back(pdo->index);
      }
      if (!chosen.empty() && first) assign(n, data.pdos);
      first = false;
      // Simple slaves list sync managers without PDOs: then the sync manager's own length counts.
      const bool without_pdos = pdos.empty() && chosen.empty();
      const std::size_t length = without_pdos ? sm.length : (bits + 7) / 8;
      if (without_pdos && length > 0) {
        for (std::size_t i = 0; i < length; ++i) channels.push_back({0, 0, "byte " + std::to_string(i), 8 * (bytes + i), 8});
      }
      if (length == 0) continue;
      if (length > 0xffff) throw Error(place_, "its PDOs have " + std::to_string(length) + " bytes, expected at most 65535");
      data.length = static_cast<std::uint16_t>(length);
      bytes += length;
      setup_.process_data.push_back(std::move(data));
    }
    if (first && !chosen.empty()) {
      throw Error(place_, std::string("it has no sync manager for ") + (outputs ? "outputs" : "inputs") + ", which PDO " +
                              hex(chosen.front(), 4) + " needs");
    }
  }

  static std::vector<const Pdo*> assigned(const std::vector<Pdo>& pdos, std::size_t sync_manager) {
    std::vector<const Pdo*> list;
    for (const Pdo& pdo : pdos) {
      if (pdo.sync_manager == sync_manager) list.push_back(&pdo);
    }
    return list;
  }

  std::vector<const Pdo*> named(const std::vector<Pdo>& pdos, const std::vector<std::uint16_t>& chosen) const {
    std::vector<const Pdo*> list;
    for (const std::uint16_t index : chosen) {
      const auto found = std::find_if(pdos.begin(), pdos.end(), [&](const Pdo& pdo) { return pdo.index == index; });
      if (found == pdos.end()) {
        std::string known;
        for (const Pdo& pdo : pdos) text::append(known, hex(pdo.index, 4));
        throw Error(place_, "it has no PDO " + hex(index, 4) + ", expected one of: " + (known.empty() ? "none" : known));
      }
      list.push_back(&*found);
    }
    return list;
  }

  void assign(std::size_t sync_manager, const std::vector<std::uint16_t>& pdos) {
    if (!setup_.has_coe) throw Error(place_, "its PDOs cannot be chosen, because it has no mailbox with CoE");
    const auto object = static_cast<std::uint16_t>(0x1c10 + sync_manager);
    const auto add = [&](std::size_t subindex, std::vector<std::uint8_t> data) {
      setup_.start_up.push_back({object, static_cast<std::uint8_t>(subindex), std::move(data), false, ""});
    };
    add(0, {0});
    for (std::size_t i = 0; i < pdos.size(); ++i) {
      add(i + 1, {static_cast<std::uint8_t>(pdos[i]), static_cast<std::uint8_t>(pdos[i] >> 8)});
    }
    add(0, {static_cast<std::uint8_t>(pdos.size())});
  }

  const Sii& sii_;
  const PdoChoice& choice_;
  const std::string& place_;
  SlaveSetup setup_;
};

}  // namespace

SlaveSetup setup_of(const Sii& sii, const PdoChoice& choice, const std::string& place) {
  return SlaveBuilder(sii, choice, place).build();
}

std::string describe_identity(std::string_view device, std::uint32_t vendor, std::uint32_t product) {
  std::string text(device.empty() ? "a device" : device);
  return text + " (vendor " + hex(vendor, 8) + ", product " + hex(product, 8) + ")";
}

}  // namespace cotwin::ethercat
