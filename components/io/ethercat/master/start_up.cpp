#include "components/io/ethercat/master/start_up.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "components/io/ethercat/little_endian.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::ethercat {

namespace {

constexpr const char* kColumns = "slave,when,index,subindex,type,value";
constexpr std::size_t kLargestValue = 4096;  // bytes, of SdoClient

struct IntegerType {
  std::string_view name;
  long long least, most;
  std::size_t bytes;
};
constexpr IntegerType kIntegerTypes[] = {{"u8", 0, 0xff, 1},        {"i8", -0x80, 0x7f, 1},
                                         {"u16", 0, 0xffff, 2},     {"i16", -0x8000, 0x7fff, 2},
                                         {"u32", 0, 0xffffffff, 4}, {"i32", -0x80000000LL, 0x7fffffff, 4}};

std::vector<std::uint8_t> little_endian(std::uint64_t value, std::size_t bytes) {
  std::vector<std::uint8_t> data(bytes);
  for (std::size_t i = 0; i < bytes; ++i) data[i] = static_cast<std::uint8_t>(value >> (8 * i));
  return data;
}

int digit_of(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

/// Decimal, or hexadecimal after 0x.
std::optional<long long> integer_of(std::string_view word) {
  if (!word.starts_with("0x") && !word.starts_with("0X")) return text::parse_integer(word);
  word.remove_prefix(2);
  long long value = 0;
  if (word.empty() || word.size() > 8) return std::nullopt;
  for (const char c : word) {
    if (digit_of(c) < 0) return std::nullopt;
    value = 16 * value + digit_of(c);
  }
  return value;
}

std::optional<std::vector<std::uint8_t>> bytes_of(std::string_view word) {
  std::vector<std::uint8_t> data;
  int high = -1;
  for (const char c : word) {
    if (c == ' ' && high < 0) continue;
    const int digit = digit_of(c);
    if (digit < 0) return std::nullopt;
    if (high >= 0) data.push_back(static_cast<std::uint8_t>(16 * high + digit));
    high = high >= 0 ? -1 : digit;
  }
  if (high >= 0) return std::nullopt;
  return data;
}

std::string quoted(std::string_view word) { return "'" + std::string(word) + "'"; }

/// One line of the file.
class Row {
 public:
  Row(std::string_view line, std::string place) : place_(std::move(place)) {
    for (std::string_view& word : words_) {
      const std::size_t comma = &word == &words_.back() ? std::string_view::npos : line.find(',');
      word = text::trim(line.substr(0, comma));
      if (&word != &words_.back() && comma == std::string_view::npos) throw Error(place_, std::string("expected ") + kColumns);
      if (comma != std::string_view::npos) line.remove_prefix(comma + 1);
    }
  }

  StartUpRow read() const {
    StartUpRow row;
    row.slave = words_[0];
    if (row.slave.empty()) throw Error(place_, "slave is empty, expected the name of a slave");
    StartUpValue& v = row.value;
    if (words_[1] != "PS" && words_[1] != "SO") {
      throw Error(place_, "when is " + quoted(words_[1]) + ", expected PS (before SAFEOP) or SO (before OP)");
    }
    v.before_op = words_[1] == "SO";
    v.index = static_cast<std::uint16_t>(number("index", words_[2], 0xffff));
    v.subindex = static_cast<std::uint8_t>(number("subindex", words_[3], 0xff));
    v.data = value();
    v.origin = place_;
    const auto within = [&](unsigned first, unsigned last) { return v.index >= first && v.index <= last; };
    if (within(0x1600, 0x17ff) || within(0x1a00, 0x1bff) || within(0x1c10, 0x1c2f)) {
      throw Error(place_, "object " + std::string(words_[2]) +
                              " maps or assigns PDOs, expected another one: these follow from the ports of the slave");
    }
    if (v.data.empty()) throw Error(place_, "value is empty, expected at least one byte");
    if (v.data.size() > kLargestValue) {
      throw Error(place_,
                  "value has " + std::to_string(v.data.size()) + " bytes, expected at most " + std::to_string(kLargestValue));
    }
    return row;
  }

 private:
  long long number(const char* what, std::string_view word, long long most) const {
    const std::optional<long long> value = integer_of(word);
    if (value && *value >= 0 && *value <= most) return *value;
    throw Error(place_, std::string(what) + " is " + quoted(word) + ", expected a number from 0 to " + std::to_string(most));
  }

  [[noreturn]] void refuse_value(const std::string& expected) const {
    throw Error(place_, "value is " + quoted(words_[5]) + ", expected " + expected);
  }

  std::vector<std::uint8_t> value() const {
    const std::string_view type = words_[4], word = words_[5];
    const auto integer = std::ranges::find(kIntegerTypes, type, &IntegerType::name);
    if (integer != std::end(kIntegerTypes)) {
      const std::optional<long long> v = integer_of(word);
      if (!v || *v < integer->least || *v > integer->most) {
        refuse_value("an integer from " + std::to_string(integer->least) + " to " + std::to_string(integer->most));
      }
      return little_endian(static_cast<std::uint64_t>(*v), integer->bytes);
    }
    if (type == "f32" || type == "f64") {
      const std::optional<double> v = text::parse_real(word);
      const bool fits = v && std::isfinite(*v) && (type == "f64" || std::abs(*v) <= std::numeric_limits<float>::max());
      if (!fits) refuse_value("a number that " + std::string(type) + " can hold");
      if (type == "f64") return little_endian(std::bit_cast<std::uint64_t>(*v), 8);
      return little_endian(std::bit_cast<std::uint32_t>(static_cast<float>(*v)), 4);
    }
    if (type == "text") return {word.begin(), word.end()};
    if (type == "bytes") {
      if (auto data = bytes_of(word)) return *std::move(data);
      refuse_value("bytes of two hexadecimal digits each");
    }
    throw Error(place_, "type is " + quoted(type) + ", expected u8, i8, u16, i16, u32, i32, f32, f64, text or bytes");
  }

  std::string place_;
  std::array<std::string_view, 6> words_;
};

std::string index_of(unsigned value) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text = "0x";
  for (int shift = 12; shift >= 0; shift -= 4) text += kDigits[value >> shift & 15];
  return text;
}

Step datagram(Command command, std::uint32_t address, std::vector<std::uint8_t> data, std::string what) {
  Step step;
  step.command = command;
  step.address = address;
  step.data = std::move(data);
  step.what = std::move(what);
  return step;
}

/// The answer with which a slave accepts the last request of `client`, and which bits of it are looked at.
struct Acceptance {
  std::array<std::uint8_t, kSdoHeader> mail{}, mask{};
};

Acceptance acceptance_of(const StartUpValue& value, bool initial, std::uint8_t toggle) {
  Acceptance a;
  const auto content = std::span(a.mail).subspan(kCoeHeader), mask = std::span(a.mask).subspan(kCoeHeader);
  write_coe(a.mail, CoeService::kSdoResponse, 0, content.size());
  a.mask[5] = 0x0f;  // type of the mail
  a.mask[7] = 0xf0;  // service
  if (initial) {
    write_sdo(content, sdo::kDownloaded, value.index, value.subindex, 0);
    mask[0] = sdo::kServiceBits;
    std::fill_n(mask.begin() + 1, 3, std::uint8_t{0xff});
  } else {
    content[0] = static_cast<std::uint8_t>(sdo::kDownloadedSegment | toggle);
    mask[0] = sdo::kServiceBits | sdo::kToggle;
  }
  return a;
}

}  // namespace

std::vector<StartUpRow> read_start_up(std::string_view text, const std::string& place) {
  std::vector<StartUpRow> rows;
  bool headed = false;
  std::size_t number = 0;
  for (const std::string_view raw : text::split(text, '\n')) {
    ++number;
    const std::string_view line = text::trim(raw);
    if (line.empty() || line.front() == '#') continue;
    const std::string here = place + ":" + std::to_string(number);
    if (std::exchange(headed, true)) {
      rows.push_back(Row(line, here).read());
    } else if (line != kColumns) {
      throw Error(here, quoted(line) + ", expected the line " + kColumns);
    }
  }
  if (!headed) throw Error(place, std::string("is empty, expected the line ") + kColumns);
  return rows;
}

void append_download(std::vector<Step>& steps, std::uint16_t station, const SiiMailbox& box, SdoClient& client,
                     const StartUpValue& value) {
  const std::string what = "take " + index_of(value.index) + ":" + std::to_string(value.subindex) +
                           (value.origin.empty() ? " (the assignment of its PDOs)" : " (" + value.origin + ")");
  constexpr std::uint32_t kIn = reg::kSyncManager + reg::kSyncManagerSize;
  client.download(value.index, value.subindex, value.data);
  std::uint8_t toggle = 0;
  for (bool initial = true;; initial = false) {
    std::vector<std::uint8_t> mail(client.request().begin(), client.request().end());
    mail.resize(box.out_size);
    Step send = datagram(Command::kFpwr, at_station(station, box.out), std::move(mail), "take a mail");
    send.may_refuse = true;
    steps.push_back(std::move(send));
    Step full = datagram(Command::kFprd, at_station(station, kIn + 5), std::vector<std::uint8_t>(1), "answer a mail");
    full.mask = full.expected = {sync_manager::kFull};
    full.repeat = at_station(station, kIn + 6);
    steps.push_back(full);
    Step answer = datagram(Command::kFprd, at_station(station, box.in), std::vector<std::uint8_t>(box.in_size), what);
    answer.kind = Step::Kind::kMail;
    answer.back = 1;
    answer.may_refuse = true;
    answer.repeat = full.repeat;
    const Acceptance a = acceptance_of(value, initial, toggle);
    if (!initial) toggle ^= sdo::kToggle;
    constexpr std::size_t kLookedAt = kCoeHeader + 4;  // bytes
    answer.mask.assign(a.mask.begin(), a.mask.begin() + kLookedAt);
    for (std::size_t i = 0; i < kLookedAt; ++i) answer.expected.push_back(a.mail[i] & a.mask[i]);
    steps.push_back(std::move(answer));
    if (client.receive(a.mail) != SdoClient::Result::kContinue) return;
  }
}

}  // namespace cotwin::ethercat
