#include "components/io/emulators/ur/controller.h"

#include <algorithm>
#include <cmath>

#include "components/io/rtde/big_endian.h"

namespace cotwin::rtde {

namespace {

constexpr double kVersion1Frequency = 125;  // Hz

/// `bits` of `old` that are set in `mask` become those of `wanted`.
double masked(double old, double wanted, double mask, unsigned shift) {
  const auto m = static_cast<std::uint64_t>(mask) << shift;
  return static_cast<double>((static_cast<std::uint64_t>(old) & ~m) | ((static_cast<std::uint64_t>(wanted) << shift) & m));
}

}  // namespace

Controller::Controller(const ControllerSettings& settings)
    : settings_(settings), values_(directory_.slots()), writes_(directory_.slots()), owners_(directory_.slots(), -1) {
  types_.reserve(Recipe::kMaxFields * 16);
}

int Controller::connect() {
  const auto free = std::ranges::find(clients_, false, &Client::connected);
  if (free == clients_.end()) {
    ++statistics_.refused;
    return -1;
  }
  free->connected = true;
  free->broken = free->started = free->has_outputs = false;
  free->version = 1;
  free->frequency = kVersion1Frequency;
  free->phase = 0;
  free->reader.clear();
  free->writer.clear();
  free->input_recipes = 0;
  ++statistics_.clients;
  return static_cast<int>(free - clients_.begin());
}

void Controller::disconnect(std::size_t client) {
  clients_[client].connected = clients_[client].started = false;
  std::ranges::replace(owners_, static_cast<int>(client), -1);
}

void Controller::received(std::size_t client, std::size_t bytes) {
  Client& c = clients_[client];
  c.reader.received(bytes);
  while (!c.broken) {
    const auto package = c.reader.next();
    if (!package) break;
    handle(client, *package);
  }
  if (c.reader.broken() && !c.broken) {
    ++statistics_.faults;
    c.broken = true;
  }
}

void Controller::handle(std::size_t client, const PackageReader::Raw& package) {
  Client& c = clients_[client];
  switch (package.kind) {
    case Package::kRequestProtocol:
      return request_protocol(c, package.contents);
    case Package::kGetVersion:
      return give_version(c);
    case Package::kText:
      return;
    case Package::kData:
      return read_inputs(c, package.contents);
    case Package::kSetupOutputs:
      return set_up_outputs(client, package.contents);
    case Package::kSetupInputs:
      return set_up_inputs(client, package.contents);
    case Package::kStart:
      if (!c.has_outputs) say(c, "Output package has not been configured", Level::kWarning);
      c.started = c.has_outputs;
      c.phase = 1;
      return reply(c, Package::kStart, c.started);
    case Package::kPause:
      c.started = false;
      return reply(c, Package::kPause, true);
  }
  ++statistics_.faults;
  say(c, "Unknown package type", Level::kError);
}

/// A client that does not read its replies is given up.
void Controller::reply(Client& c, Package kind, bool accepted) { c.broken = !c.writer.add_flag(kind, accepted) || c.broken; }

void Controller::say(Client& c, std::string_view text, Level level) { c.writer.add_text(c.version, true, text, "RTDE", level); }

void Controller::request_protocol(Client& c, std::span<const std::uint8_t> contents) {
  const int version = contents.size() == 2 ? load<std::uint16_t>(contents.data()) : 0;
  const bool known = version == 1 || version == 2;
  if (contents.size() != 2) ++statistics_.faults;
  if (known) c.version = version;
  reply(c, Package::kRequestProtocol, known);
}

void Controller::give_version(Client& c) {
  std::uint8_t* at = c.writer.add(Package::kGetVersion, 16);
  c.broken = c.broken || at == nullptr;
  if (at == nullptr) return;
  for (const std::uint32_t number : settings_.version) {
    store(at, number);
    at += 4;
  }
}

/// Sets the recipe and the list of types. False if a name is not found or in use, or there are too many.
bool Controller::read_names(std::size_t client, std::string_view names, bool inputs, Recipe& recipe) {
  recipe.clear();
  types_.clear();
  Client& c = clients_[client];
  if (names.size() > kMaxNames) {
    ++statistics_.faults;
    say(c, "The list of names is longer than 2048 bytes", Level::kError);
    return false;
  }
  bool good = !names.empty();
  while (true) {
    const std::size_t comma = names.find(',');
    const Field* field = directory_.find(names.substr(0, comma));
    Type type = Type::kNotFound;
    if (field != nullptr && (inputs ? field->input : field->output)) type = field->type;
    if (inputs && type != Type::kNotFound) {
      const int owner = owners_[field->slot];
      if (owner >= 0 && owner != static_cast<int>(client)) type = Type::kInUse;
    }
    good = values_of(type) > 0 && recipe.add(*field) && good;
    const std::string_view text = name_of(type);
    if (!types_.empty()) types_.push_back(',');
    types_.insert(types_.end(), text.begin(), text.end());
    if (comma == std::string_view::npos) return good;
    names.remove_prefix(comma + 1);
  }
}

void Controller::set_up_outputs(std::size_t client, std::span<const std::uint8_t> contents) {
  Client& c = clients_[client];
  double frequency = kVersion1Frequency;
  if (c.version >= 2) {
    if (contents.size() < 8) {
      ++statistics_.faults;
      c.broken = true;
      return;
    }
    frequency = load<double>(contents.data());
    contents = contents.subspan(8);
  }
  bool good = read_names(client, {reinterpret_cast<const char*>(contents.data()), contents.size()}, false, c.outputs);
  if (!(frequency > 0) || !std::isfinite(frequency)) {
    say(c, "The output frequency must be positive", Level::kError);
    good = false;
  }
  c.frequency = std::min(frequency, settings_.frequency);
  c.has_outputs = good;
  c.started = c.started && good;
  const std::size_t id = c.version >= 2 ? 1 : 0;
  std::uint8_t* at = c.writer.add(Package::kSetupOutputs, id + types_.size());
  c.broken = c.broken || at == nullptr;
  if (at == nullptr) return;
  if (c.version >= 2) *at++ = good ? 1 : 0;
  std::ranges::copy(types_, at);
}

void Controller::set_up_inputs(std::size_t client, std::span<const std::uint8_t> contents) {
  Client& c = clients_[client];
  std::uint8_t id = 0;
  if (c.input_recipes == kInputRecipes) {
    types_.clear();
    ++statistics_.faults;
    say(c, "Too many input recipes", Level::kError);
  } else {
    Recipe& recipe = c.inputs[c.input_recipes];
    if (read_names(client, {reinterpret_cast<const char*>(contents.data()), contents.size()}, true, recipe)) {
      id = static_cast<std::uint8_t>(++c.input_recipes);
      for (const Field* field : recipe.fields()) owners_[field->slot] = static_cast<int>(client);
    }
  }
  std::uint8_t* at = c.writer.add(Package::kSetupInputs, 1 + types_.size());
  c.broken = c.broken || at == nullptr;
  if (at == nullptr) return;
  *at++ = id;
  std::ranges::copy(types_, at);
}

void Controller::read_inputs(Client& c, std::span<const std::uint8_t> contents) {
  const std::size_t id = contents.empty() ? 0 : contents[0];
  if (!c.started || id == 0 || id > c.input_recipes ||
      read_values(c.inputs[id - 1], contents.subspan(1), values_) != Fault::kNone) {
    ++statistics_.rejected;
    return;
  }
  ++statistics_.received;
  apply(c.inputs[id - 1]);
}

/// What takes effect by a mask. Without a mask in the recipe, the value has no effect.
void Controller::apply(const Recipe& recipe) {
  const auto has = [&](std::string_view name) { return recipe.has(*directory_.find(name)); };
  for (const Field* field : recipe.fields()) ++writes_[field->slot];
  if (has("speed_slider_mask") && has("speed_slider_fraction") && at("speed_slider_mask") != 0) {
    at("target_speed_fraction") = std::clamp(at("speed_slider_fraction"), 0.0, 1.0);
  }
  double& bits = at("actual_digital_output_bits");
  if (has("standard_digital_output_mask") && has("standard_digital_output")) {
    bits = masked(bits, at("standard_digital_output"), at("standard_digital_output_mask"), 0);
  }
  if (has("configurable_digital_output_mask") && has("configurable_digital_output")) {
    bits = masked(bits, at("configurable_digital_output"), at("configurable_digital_output_mask"), 8);
    at("actual_configurable_digital_output_bits") = static_cast<double>(static_cast<std::uint64_t>(bits) >> 8 & 0xff);
  }
  if (has("tool_digital_output_mask") && has("tool_digital_output")) {
    bits = masked(bits, at("tool_digital_output"),
                  static_cast<double>(static_cast<unsigned>(at("tool_digital_output_mask")) & 3u), 16);
  }
  if (!has("standard_analog_output_mask")) return;
  const auto mask = static_cast<unsigned>(at("standard_analog_output_mask"));
  const auto voltage = static_cast<unsigned>(at("standard_analog_output_type"));
  for (unsigned i = 0; i < 2; ++i) {
    const char* const inputs[] = {"standard_analog_output_0", "standard_analog_output_1"};
    const char* const outputs[] = {"standard_analog_output0", "standard_analog_output1"};
    if ((mask >> i & 1u) == 0 || !has(inputs[i])) continue;
    const double share = std::clamp(at(inputs[i]), 0.0, 1.0);
    const bool is_voltage = (voltage >> i & 1u) != 0;
    at(outputs[i]) = is_voltage ? 10 * share : 0.004 + 0.016 * share;  // V, A
    at("analog_io_types") = masked(at("analog_io_types"), is_voltage ? 1 : 0, 1, 2 + i);
  }
}

void Controller::cycle() {
  for (Client& c : clients_) {
    if (!c.connected || !c.started || c.broken) continue;
    constexpr double kRounding = 1e-9;  // of the sum of shares
    const double share = c.frequency / settings_.frequency;
    if (c.phase < 1 - kRounding) {
      c.phase += share;
      continue;
    }
    c.phase += share - 1;
    if (!c.writer.waiting().empty()) {  // the socket took not all of the last package
      ++statistics_.dropped;
      continue;
    }
    const std::size_t id = c.version >= 2 ? 1 : 0;
    std::uint8_t* at = c.writer.add(Package::kData, id + c.outputs.bytes());
    if (id == 1) *at++ = 1;
    write_values(c.outputs, values_, at);
    ++statistics_.sent;
  }
}

std::size_t Controller::started() const {
  return static_cast<std::size_t>(std::ranges::count_if(clients_, [](const Client& c) { return c.connected && c.started; }));
}

}  // namespace cotwin::rtde
