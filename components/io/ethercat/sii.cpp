#include "components/io/ethercat/sii.h"

#include <algorithm>
#include <initializer_list>

#include "components/io/ethercat/little_endian.h"
#include "models/foundation/support/error.h"

namespace cotwin::ethercat {

namespace {

constexpr std::size_t kCategories = 0x80;  // byte offset of the first category
constexpr std::uint16_t kStrings = 10, kGeneral = 30, kFmmu = 40, kSyncManager = 41, kTxPdo = 50, kRxPdo = 51, kClock = 60;
constexpr std::uint16_t kEnd = 0xffff;
constexpr std::size_t kGeneralSize = 32, kSyncManagerSize = 8, kPdoSize = 8, kClockSize = 24;
constexpr std::size_t kKibit = 128;  // bytes

using Bytes = std::span<const std::uint8_t>;

struct Category {
  std::uint16_t type;
  Bytes data;
};

std::vector<Category> categories_of(Bytes image, const std::string& place) {
  std::vector<Category> found;
  for (std::size_t at = kCategories; at + 4 <= image.size();) {
    const auto type = load<std::uint16_t>(&image[at]);
    if (type == kEnd) break;
    const std::size_t size = 2 * std::size_t{load<std::uint16_t>(&image[at + 2])};
    if (type == 0 && size == 0) break;  // memory without content
    at += 4;
    if (size > image.size() - at) {
      throw Error(place, "category " + std::to_string(type) + " at byte " + std::to_string(at - 4) + " has " +
                             std::to_string(size) + " bytes, expected at most " + std::to_string(image.size() - at));
    }
    if (type != 0) found.push_back({type, image.subspan(at, size)});
    at += size;
  }
  return found;
}

std::vector<std::string> strings_of(Bytes data) {
  std::vector<std::string> strings;
  if (data.empty()) return strings;
  std::size_t at = 1;
  for (int n = data[0]; n > 0 && at < data.size(); --n) {
    const std::size_t size = std::min<std::size_t>(data[at], data.size() - at - 1);
    strings.emplace_back(reinterpret_cast<const char*>(data.data()) + at + 1, size);
    at += 1 + size;
  }
  return strings;
}

class Reader {
 public:
  Reader(Bytes image, const std::string& place) : place_(place), categories_(categories_of(image, place)) {
    for (const Category& c : categories_) {
      if (c.type == kStrings && strings_.empty()) strings_ = strings_of(c.data);
    }
  }

  void read(Sii& sii) const {
    for (const Category& c : categories_) {
      switch (c.type) {
        case kStrings:
          break;
        case kGeneral:
          read_general(c.data, sii.general);
          break;
        case kFmmu:
          read_fmmus(c.data, sii.fmmus);
          break;
        case kSyncManager:
          read_sync_managers(c.data, sii.sync_managers);
          break;
        case kTxPdo:
          read_pdos(c.data, sii.tx_pdos);
          break;
        case kRxPdo:
          read_pdos(c.data, sii.rx_pdos);
          break;
        case kClock:
          read_clock_modes(c.data, sii.clock_modes);
          break;
        default:
          sii.others.push_back({c.type, {c.data.begin(), c.data.end()}});
      }
    }
  }

 private:
  std::string name(std::uint8_t number) const {
    return number == 0 || number > strings_.size() ? std::string() : strings_[number - 1u];
  }

  void read_general(Bytes d, SiiGeneral& g) const {
    if (d.size() < 18) throw Error(place_, "category GENERAL has " + std::to_string(d.size()) + " bytes, expected at least 18");
    g.group = name(d[0]);
    g.image = name(d[1]);
    g.order = name(d[2]);
    g.name = name(d[3]);
    g.coe = d[5];
    g.foe = d[6];
    g.eoe = d[7];
    g.flags = d[0x0b];
    g.ebus_current = load<std::int16_t>(&d[0x0c]);
    g.physical_ports = load<std::uint16_t>(&d[0x10]);
  }

  static void read_fmmus(Bytes d, std::vector<std::uint8_t>& fmmus) {
    fmmus.insert(fmmus.end(), d.begin(), d.end());
    while (!fmmus.empty() && (fmmus.back() == 0 || fmmus.back() == 0xff)) fmmus.pop_back();  // padding
  }

  static void read_sync_managers(Bytes d, std::vector<SiiSyncManager>& list) {
    for (; d.size() >= kSyncManagerSize; d = d.subspan(kSyncManagerSize)) {
      SiiSyncManager s;
      s.start = load<std::uint16_t>(&d[0]);
      s.length = load<std::uint16_t>(&d[2]);
      s.control = d[4];
      s.status = d[5];
      s.enable = d[6];
      s.type = d[7] <= 4 ? static_cast<SyncManagerType>(d[7]) : SyncManagerType::kUnused;
      list.push_back(s);
    }
  }

  void read_pdos(Bytes d, std::vector<Pdo>& list) const {
    while (d.size() >= kPdoSize) {
      Pdo p;
      p.index = load<std::uint16_t>(&d[0]);
      const std::size_t count = d[2];
      p.sync_manager = d[3];
      p.sync = d[4];
      p.name = name(d[5]);
      p.flags = load<std::uint16_t>(&d[6]);
      d = d.subspan(kPdoSize);
      if (count * kPdoSize > d.size()) {
        throw Error(place_, "PDO " + std::to_string(p.index) + " has " + std::to_string(count) + " entries, expected at most " +
                                std::to_string(d.size() / kPdoSize));
      }
      for (std::size_t i = 0; i < count; ++i, d = d.subspan(kPdoSize)) {
        p.entries.push_back({load<std::uint16_t>(&d[0]), d[2], name(d[3]), d[4], d[5], load<std::uint16_t>(&d[6])});
      }
      list.push_back(std::move(p));
    }
  }

  void read_clock_modes(Bytes d, std::vector<SiiClockMode>& list) const {
    for (; d.size() >= kClockSize; d = d.subspan(kClockSize)) {
      list.push_back({load<std::uint32_t>(&d[0]), load<std::int32_t>(&d[4]), load<std::int32_t>(&d[8]),
                      load<std::int16_t>(&d[12]), load<std::uint16_t>(&d[14]), load<std::int16_t>(&d[16]), name(d[18]),
                      name(d[19])});
    }
  }

  const std::string& place_;
  std::vector<Category> categories_;
  std::vector<std::string> strings_;
};

class Writer {
 public:
  explicit Writer(const Sii& s) {
    words({s.pdi_control, s.pdi_config, s.sync_impulse, s.pdi_config2, s.alias, 0, 0});
    words({sii_checksum(image_)});
    for (const std::uint32_t v : {s.vendor, s.product, s.revision, s.serial}) value(image_, v);
    image_.resize(0x28);
    for (const SiiMailbox& m : {s.bootstrap, s.mailbox}) words({m.out, m.out_size, m.in, m.in_size});
    words({s.protocols});
    image_.resize(0x7c);
    words({static_cast<std::uint16_t>(std::max<int>(s.size_kibit, 1) - 1), s.version});
    write_general(s.general);
    if (!s.fmmus.empty()) content_.emplace_back(kFmmu, s.fmmus);
    write_sync_managers(s.sync_managers);
    write_pdos(kTxPdo, s.tx_pdos);
    write_pdos(kRxPdo, s.rx_pdos);
    write_clock_modes(s.clock_modes);
    for (const SiiCategory& c : s.others) content_.emplace_back(c.type, c.data);
  }

  std::vector<std::uint8_t> image(std::size_t size) {
    std::vector<std::uint8_t> strings = {static_cast<std::uint8_t>(strings_.size())};
    for (const std::string& s : strings_) {
      strings.push_back(static_cast<std::uint8_t>(s.size()));
      strings.insert(strings.end(), s.begin(), s.end());
    }
    if (strings.size() % 2) strings.push_back(0);
    category(kStrings, strings);
    for (auto& [type, data] : content_) {
      if (data.size() % 2) data.push_back(0xff);
      category(type, data);
    }
    words({kEnd});
    image_.resize(std::max(size, image_.size()), 0xff);
    return std::move(image_);
  }

 private:
  template <class T>
  static void value(std::vector<std::uint8_t>& to, T v) {
    to.resize(to.size() + sizeof v);
    store(&to[to.size() - sizeof v], v);
  }
  void words(std::initializer_list<std::uint16_t> values) {
    for (const std::uint16_t w : values) value(image_, w);
  }
  void category(std::uint16_t type, const std::vector<std::uint8_t>& data) {
    if (data.size() / 2 > 0xffff) {
      throw Error("SII category " + std::to_string(type),
                  std::to_string(data.size()) + " bytes, expected at most " + std::to_string(2 * 0xffff));
    }
    words({type, static_cast<std::uint16_t>(data.size() / 2)});
    image_.insert(image_.end(), data.begin(), data.end());
  }

  std::uint8_t number(const std::string& s) {
    if (s.empty()) return 0;
    auto at = std::find(strings_.begin(), strings_.end(), s);
    if (at == strings_.end()) {
      if (strings_.size() == 255) throw Error("SII strings", "more than 255 names");
      if (s.size() > 255)
        throw Error("SII strings", "'" + s + "' has " + std::to_string(s.size()) + " bytes, expected at most 255");
      at = strings_.insert(at, s);
    }
    return static_cast<std::uint8_t>(at - strings_.begin() + 1);
  }

  void write_general(const SiiGeneral& g) {
    std::vector<std::uint8_t> d(kGeneralSize);
    d[0] = number(g.group);
    d[1] = number(g.image);
    d[2] = number(g.order);
    d[3] = number(g.name);
    d[5] = g.coe;
    d[6] = g.foe;
    d[7] = g.eoe;
    d[0x0b] = g.flags;
    store(&d[0x0c], g.ebus_current);
    store(&d[0x10], g.physical_ports);
    content_.emplace_back(kGeneral, std::move(d));
  }

  void write_sync_managers(const std::vector<SiiSyncManager>& list) {
    std::vector<std::uint8_t> d;
    for (const SiiSyncManager& s : list) {
      value(d, s.start);
      value(d, s.length);
      d.insert(d.end(), {s.control, s.status, s.enable, static_cast<std::uint8_t>(s.type)});
    }
    if (!d.empty()) content_.emplace_back(kSyncManager, std::move(d));
  }

  void write_pdos(std::uint16_t type, const std::vector<Pdo>& list) {
    std::vector<std::uint8_t> d;
    for (const Pdo& p : list) {
      if (p.entries.size() > 255) throw Error("SII PDO " + std::to_string(p.index), "more than 255 entries");
      value(d, p.index);
      d.insert(d.end(), {static_cast<std::uint8_t>(p.entries.size()), p.sync_manager, p.sync, number(p.name)});
      value(d, p.flags);
      for (const PdoEntry& e : p.entries) {
        value(d, e.index);
        d.insert(d.end(), {e.subindex, number(e.name), e.type, e.bits});
        value(d, e.flags);
      }
    }
    if (!d.empty()) content_.emplace_back(type, std::move(d));
  }

  void write_clock_modes(const std::vector<SiiClockMode>& list) {
    std::vector<std::uint8_t> d;
    for (const SiiClockMode& c : list) {
      value(d, c.sync0_cycle);
      value(d, c.sync0_shift);
      value(d, c.sync1_shift);
      value(d, c.sync1_factor);
      value(d, c.assign_activate);
      value(d, c.sync0_factor);
      d.insert(d.end(), {number(c.name), number(c.description), 0, 0, 0, 0});
    }
    if (!d.empty()) content_.emplace_back(kClock, std::move(d));
  }

  std::vector<std::uint8_t> image_;
  std::vector<std::string> strings_;
  std::vector<std::pair<std::uint16_t, std::vector<std::uint8_t>>> content_;
};

}  // namespace

std::size_t Pdo::bits() const {
  std::size_t sum = 0;
  for (const PdoEntry& e : entries) sum += e.bits;
  return sum;
}

std::uint8_t sii_checksum(std::span<const std::uint8_t> image) {
  std::uint8_t crc = 0xff;
  for (const std::uint8_t byte : image.first(14)) {
    crc = static_cast<std::uint8_t>(crc ^ byte);
    for (int i = 0; i < 8; ++i) crc = static_cast<std::uint8_t>(crc & 0x80 ? crc << 1 ^ 0x07 : crc << 1);
  }
  return crc;
}

Sii read_sii(std::span<const std::uint8_t> image, const std::string& place) {
  if (image.size() < kCategories) {
    throw Error(place, "the SII image has " + std::to_string(image.size()) + " bytes, expected at least 128");
  }
  const auto word = [&](std::size_t n) { return load<std::uint16_t>(&image[2 * n]); };
  Sii s;
  s.pdi_control = word(0);
  s.pdi_config = word(1);
  s.sync_impulse = word(2);
  s.pdi_config2 = word(3);
  s.alias = word(4);
  s.checksum_correct = image[14] == sii_checksum(image);
  s.vendor = load<std::uint32_t>(&image[0x10]);
  s.product = load<std::uint32_t>(&image[0x14]);
  s.revision = load<std::uint32_t>(&image[0x18]);
  s.serial = load<std::uint32_t>(&image[0x1c]);
  s.bootstrap = {word(0x14), word(0x15), word(0x16), word(0x17)};
  s.mailbox = {word(0x18), word(0x19), word(0x1a), word(0x1b)};
  s.protocols = word(0x1c);
  s.size_kibit = static_cast<std::uint16_t>(std::min(word(0x3e) + 1, 0xffff));
  s.version = word(0x3f);
  Reader(image, place).read(s);
  return s;
}

std::vector<std::uint8_t> write_sii(const Sii& sii) { return Writer(sii).image(sii.size_kibit * kKibit); }

}  // namespace cotwin::ethercat
