#include "components/io/rtde/client.h"

#include <algorithm>
#include <cmath>

#include "components/io/rtde/big_endian.h"
#include "models/foundation/support/error.h"

namespace cotwin::rtde {

Client::Client(const ClientSettings& settings, const std::string& place)
    : settings_(settings), values_(directory_.slots()), read_(values_), sent_(values_) {
  const auto add = [&](const Wanted& wanted, bool input, std::vector<Row>& rows) {
    const Field* field = directory_.find(wanted.name);
    if (field == nullptr || !(input ? field->input : field->output)) {
      throw Error(place, "'" + wanted.name + "' is no " + (input ? "input" : "output") + " of RTDE");
    }
    rows.push_back({field, wanted.required, true});
  };
  for (const Wanted& wanted : settings_.outputs) add(wanted, false, outputs_);
  for (const Wanted& wanted : settings_.inputs) add(wanted, true, inputs_);
}

bool Client::has(std::string_view output) const {
  const Field* field = directory_.find(output);
  return field != nullptr && output_recipe_.has(*field);
}

void Client::open(std::int64_t now) {
  reader_.clear();
  writer_.clear();
  looked_ = 0;
  stamp_.reset();
  protocol_ = 1;
  reason_ = "";
  culprit_ = nullptr;
  for (std::vector<Row>* rows : {&outputs_, &inputs_}) {
    for (Row& row : *rows) row.available = true;
  }
  std::uint8_t* at = writer_.add(Package::kRequestProtocol, 2);
  store(at, std::uint16_t{2});
  state_ = State::kProtocol;
  asked_ = now;
}

void Client::fail(const char* reason, const Field* culprit) {
  state_ = State::kFailed;
  reason_ = reason;
  culprit_ = culprit;
}

void Client::ask(Package kind, State state, std::int64_t now) {
  writer_.add(kind, 0);
  state_ = state;
  asked_ = now;
}

void Client::ask_recipe(bool inputs, std::int64_t now) {
  std::size_t size = 0;
  const std::vector<Row>& rows = inputs ? inputs_ : outputs_;
  Recipe& recipe = inputs ? input_recipe_ : output_recipe_;
  recipe.clear();
  for (const Row& row : rows) {
    if (row.available && recipe.add(*row.field)) size += row.field->name.size() + 1;
  }
  const std::size_t frequency = !inputs && protocol_ >= 2 ? 8 : 0;
  std::uint8_t* at =
      size > 0 ? writer_.add(inputs ? Package::kSetupInputs : Package::kSetupOutputs, frequency + size - 1) : nullptr;
  if (at == nullptr) return fail("the recipe is empty or too long");
  if (frequency > 0) store(at, settings_.frequency);
  at += frequency;
  bool first = true;
  for (const Field* field : recipe.fields()) {
    if (!first) *at++ = ',';
    first = false;
    at = std::ranges::copy(field->name, at).out;
  }
  state_ = inputs ? State::kInputs : State::kOutputs;
  asked_ = now;
}

/// A quantity that is not required and not there is left out of the recipe, which is then asked for again.
void Client::read_types(bool inputs, std::span<const std::uint8_t> contents, std::int64_t now) {
  std::uint8_t id = 0;
  if (inputs || protocol_ >= 2) {
    if (contents.empty()) return fail("the reply to a set-up is empty");
    id = contents[0];
    contents = contents.subspan(1);
  }
  std::string_view types(reinterpret_cast<const char*>(contents.data()), contents.size());
  std::vector<Row>& rows = inputs ? inputs_ : outputs_;
  bool again = false;
  for (Row& row : rows) {
    if (!row.available) continue;
    const std::size_t comma = types.find(',');
    const std::optional<Type> type = type_of(types.substr(0, comma));
    types = comma == std::string_view::npos ? std::string_view() : types.substr(comma + 1);
    if (type == row.field->type) continue;
    if (type == Type::kInUse) return fail("another client writes", row.field);
    if (type != Type::kNotFound) return fail("the controller has another type for", row.field);
    if (row.required) return fail("the controller does not have", row.field);
    row.available = false;
    again = true;
  }
  if (again) return ask_recipe(inputs, now);
  if (id == 0 && (inputs || protocol_ >= 2)) return fail("the controller refuses the recipe");
  (inputs ? input_id_ : output_id_) = id;
  if (!inputs && !inputs_.empty()) return ask_recipe(true, now);
  ask(Package::kStart, State::kStart, now);
}

void Client::read_text(std::span<const std::uint8_t> contents) {
  // Version 2: size, text, size, source, level; version 1: level, text.
  const std::size_t size = contents.empty() ? 0 : protocol_ >= 2 ? contents[0] : contents.size() - 1;
  if (contents.empty() || contents.size() < 1 + size) {
    ++rejected_;
    return;
  }
  const std::uint8_t level = protocol_ >= 2 ? contents.back() : contents[0];
  if (level >= static_cast<std::uint8_t>(Level::kInfo)) return;
  text_size_ = std::min(size, text_.size());
  std::ranges::transform(contents.subspan(1, text_size_), text_.begin(),
                         [](std::uint8_t c) { return c >= ' ' && c < 127 ? static_cast<char>(c) : '?'; });
}

void Client::handle(const PackageReader::Raw& package, std::int64_t now) {
  const std::span<const std::uint8_t> contents = package.contents;
  const bool accepted = contents.size() == 1 && contents[0] != 0;
  switch (package.kind) {
    case Package::kText:
      return read_text(contents);
    case Package::kRequestProtocol:
      if (state_ != State::kProtocol) break;
      protocol_ = accepted ? 2 : 1;
      return ask(Package::kGetVersion, State::kVersion, now);
    case Package::kGetVersion:
      if (state_ != State::kVersion || contents.size() != 16) break;
      for (std::size_t i = 0; i < 4; ++i) version_[i] = load<std::uint32_t>(contents.data() + 4 * i);
      return ask_recipe(false, now);
    case Package::kSetupOutputs:
      if (state_ != State::kOutputs) break;
      return read_types(false, contents, now);
    case Package::kSetupInputs:
      if (state_ != State::kInputs) break;
      return read_types(true, contents, now);
    case Package::kStart:
      if (state_ != State::kStart) break;
      if (!accepted) return fail("the controller refuses to start");
      state_ = State::kRunning;
      return;
    case Package::kPause:
      state_ = State::kStart;
      return;
    default:
      break;
  }
  ++rejected_;
}

bool Client::read_data(const PackageReader::Raw& package) {
  std::span<const std::uint8_t> contents = package.contents;
  if (protocol_ >= 2) {
    if (contents.empty() || contents[0] != output_id_) {
      ++rejected_;
      return false;
    }
    contents = contents.subspan(1);
  }
  if (read_values(output_recipe_, contents, read_) == Fault::kNone && read_stamp()) {
    std::ranges::copy(read_, values_.begin());
    return true;
  }
  ++rejected_;
  return false;
}

/// False if the time stamp jumps. One that goes on from there is accepted again: the controller's clock was set.
bool Client::read_stamp() {
  const double stamp = read_[directory_.slot("timestamp")];
  const bool jumps = stamp_ && std::abs(stamp - *stamp_) > kLongestPause;
  stamp_ = stamp;
  return !jumps;
}

bool Client::read(std::int64_t now) {
  while (state_ != State::kIdle && state_ != State::kFailed) {
    const std::size_t before = reader_.waiting();
    const auto package = reader_.next();
    if (!package) {
      if (reader_.broken()) {
        ++rejected_;
        fail("the stream of the controller cannot be read");
      } else if (state_ != State::kRunning && now - asked_ > settings_.patience) {
        fail("the controller does not reply");
      }
      return false;
    }
    looked_ -= std::min(looked_, before - reader_.waiting());
    if (package->kind != Package::kData) {
      handle(*package, now);
    } else if (state_ == State::kRunning && read_data(*package)) {
      return true;
    }
  }
  return false;
}

void Client::set_up(std::int64_t now) {
  while (state_ != State::kRunning && state_ != State::kIdle && state_ != State::kFailed) {
    if (!read(now)) return;
  }
}

std::optional<double> Client::look_ahead() {
  std::optional<double> time;
  const Field& stamp = *directory_.find("timestamp");
  const std::size_t id = protocol_ >= 2 ? 1 : 0;
  if (state_ != State::kRunning) return time;
  std::size_t offset = 0;  // of the timestamp in the contents
  for (const Field* field : output_recipe_.fields()) {
    if (field == &stamp) break;
    offset += bytes_of(field->type);
  }
  while (const auto package = reader_.peek(looked_)) {
    if (package->kind != Package::kData || package->contents.size() != id + output_recipe_.bytes()) continue;
    const double seen = output_recipe_.has(stamp) ? load<double>(package->contents.data() + id + offset) : 0.0;
    if (std::abs(seen) <= stamp.largest) time = seen;
  }
  return time;
}

void Client::make_room(std::int64_t now) {
  const std::size_t room = 2 * (kHeader + 1 + output_recipe_.bytes());
  while (state_ == State::kRunning && reader_.space().size() < room) {
    std::size_t size = 0;
    if (!reader_.peek(size) || size >= looked_) return;
    const PackageReader::Raw package = *reader_.next();
    looked_ -= size;
    if (package.kind != Package::kData) handle(package, now);
  }
}

bool Client::send() {
  if (state_ != State::kRunning || input_recipe_.fields().empty()) return false;
  for (const Field* field : input_recipe_.fields()) {
    for (std::size_t i = 0; i < values_of(field->type); ++i) {
      if (!std::isfinite(sent_[field->slot + i])) return false;
    }
  }
  // Commands that wait behind others would be old when they arrive.
  std::uint8_t* at = writer_.waiting().empty() ? writer_.add(Package::kData, 1 + input_recipe_.bytes()) : nullptr;
  if (at == nullptr) {
    ++unsent_;
    return false;
  }
  *at++ = input_id_;
  write_values(input_recipe_, sent_, at);
  return true;
}

}  // namespace cotwin::rtde
