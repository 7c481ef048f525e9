#include "components/io/rtde/rtde.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "components/io/rtde/big_endian.h"

namespace cotwin::rtde {

namespace {

struct TypeRow {
  std::string_view name;
  std::size_t values, bytes;
};

constexpr std::array<TypeRow, 12> kTypes{{{"BOOL", 1, 1},
                                          {"UINT8", 1, 1},
                                          {"UINT32", 1, 4},
                                          {"UINT64", 1, 8},
                                          {"INT32", 1, 4},
                                          {"DOUBLE", 1, 8},
                                          {"VECTOR3D", 3, 24},
                                          {"VECTOR6D", 6, 48},
                                          {"VECTOR6INT32", 6, 24},
                                          {"VECTOR6UINT32", 6, 24},
                                          {"NOT_FOUND", 0, 0},
                                          {"IN_USE", 0, 0}}};

template <class T>
T limited(double value) {
  if (!(value > static_cast<double>(std::numeric_limits<T>::min()))) return std::numeric_limits<T>::min();
  if (value >= static_cast<double>(std::numeric_limits<T>::max())) return std::numeric_limits<T>::max();
  return static_cast<T>(std::nearbyint(value));
}

std::uint8_t* write_value(Type type, double value, std::uint8_t* to) {
  switch (type) {
    case Type::kBool:
      *to = value != 0 ? 1 : 0;
      return to + 1;
    case Type::kUint8:
      *to = limited<std::uint8_t>(value);
      return to + 1;
    case Type::kUint64:
      store(to, limited<std::uint64_t>(value));
      return to + 8;
    case Type::kUint32:
    case Type::kVector6Uint32:
      store(to, limited<std::uint32_t>(value));
      return to + 4;
    case Type::kInt32:
    case Type::kVector6Int32:
      store(to, limited<std::int32_t>(value));
      return to + 4;
    default:
      store(to, value);
      return to + 8;
  }
}

double read_value(Type type, const std::uint8_t*& from) {
  const std::uint8_t* at = from;
  switch (type) {
    case Type::kBool:
      from += 1;
      return *at != 0 ? 1 : 0;
    case Type::kUint8:
      from += 1;
      return *at;
    case Type::kUint64:
      from += 8;
      return static_cast<double>(load<std::uint64_t>(at));
    case Type::kUint32:
    case Type::kVector6Uint32:
      from += 4;
      return load<std::uint32_t>(at);
    case Type::kInt32:
    case Type::kVector6Int32:
      from += 4;
      return static_cast<std::int32_t>(load<std::uint32_t>(at));
    default:
      from += 8;
      return load<double>(at);
  }
}

struct Row {
  const char* name;
  Type type;
};

constexpr Type B = Type::kBool, U8 = Type::kUint8, U32 = Type::kUint32, U64 = Type::kUint64, I32 = Type::kInt32,
               D = Type::kDouble, V3 = Type::kVector3d, V6 = Type::kVector6d, V6I = Type::kVector6Int32;

constexpr Row kOutputs[] = {{"timestamp", D},
                            {"target_q", V6},
                            {"target_qd", V6},
                            {"target_qdd", V6},
                            {"target_current", V6},
                            {"target_moment", V6},
                            {"actual_q", V6},
                            {"actual_qd", V6},
                            {"actual_current", V6},
                            {"actual_current_window", V6},
                            {"actual_current_as_torque", V6},
                            {"joint_control_output", V6},
                            {"actual_TCP_pose", V6},
                            {"actual_TCP_speed", V6},
                            {"actual_TCP_force", V6},
                            {"target_TCP_pose", V6},
                            {"target_TCP_speed", V6},
                            {"actual_digital_input_bits", U64},
                            {"actual_configurable_digital_input_bits", U64},
                            {"joint_temperatures", V6},
                            {"actual_execution_time", D},
                            {"robot_mode", I32},
                            {"joint_mode", V6I},
                            {"safety_mode", I32},
                            {"safety_status", I32},
                            {"actual_tool_accelerometer", V3},
                            {"speed_scaling", D},
                            {"target_speed_fraction", D},
                            {"actual_momentum", D},
                            {"actual_main_voltage", D},
                            {"actual_robot_voltage", D},
                            {"actual_robot_current", D},
                            {"actual_joint_voltage", V6},
                            {"actual_digital_output_bits", U64},
                            {"actual_configurable_digital_output_bits", U64},
                            {"runtime_state", U32},
                            {"elbow_position", V3},
                            {"elbow_velocity", V3},
                            {"robot_status_bits", U32},
                            {"safety_status_bits", U32},
                            {"analog_io_types", U32},
                            {"standard_analog_input0", D},
                            {"standard_analog_input1", D},
                            {"standard_analog_output0", D},
                            {"standard_analog_output1", D},
                            {"io_current", D},
                            {"euromap67_input_bits", U32},
                            {"euromap67_output_bits", U32},
                            {"euromap67_24V_voltage", D},
                            {"euromap67_24V_current", D},
                            {"tool_mode", U32},
                            {"tool_analog_input_types", U32},
                            {"tool_analog_input0", D},
                            {"tool_analog_input1", D},
                            {"tool_output_voltage", I32},
                            {"tool_output_current", D},
                            {"tool_temperature", D},
                            {"tool_output_mode", U8},
                            {"tool_digital_output0_mode", U8},
                            {"tool_digital_output1_mode", U8},
                            {"tcp_force_scalar", D},
                            {"tcp_offset", V6},
                            {"joint_position_deviation_ratio", D},
                            {"collision_detection_ratio", D},
                            {"time_scale_source", I32},
                            {"ft_raw_wrench", V6},
                            {"payload", D},
                            {"payload_cog", V3},
                            {"payload_inertia", V6},
                            {"script_control_line", U32},
                            {"encoder0_raw", I32},
                            {"encoder1_raw", I32}};

constexpr Row kInputs[] = {{"speed_slider_mask", U32},
                           {"speed_slider_fraction", D},
                           {"standard_digital_output_mask", U8},
                           {"standard_digital_output", U8},
                           {"configurable_digital_output_mask", U8},
                           {"configurable_digital_output", U8},
                           {"tool_digital_output_mask", U8},
                           {"tool_digital_output", U8},
                           {"standard_analog_output_mask", U8},
                           {"standard_analog_output_type", U8},
                           {"standard_analog_output_0", D},
                           {"standard_analog_output_1", D},
                           {"external_force_torque", V6}};

}  // namespace

std::string_view name_of(Type type) { return kTypes[static_cast<std::size_t>(type)].name; }

std::optional<Type> type_of(std::string_view name) {
  for (std::size_t i = 0; i < kTypes.size(); ++i) {
    if (kTypes[i].name == name) return static_cast<Type>(i);
  }
  return std::nullopt;
}

std::size_t values_of(Type type) { return kTypes[static_cast<std::size_t>(type)].values; }
std::size_t bytes_of(Type type) { return kTypes[static_cast<std::size_t>(type)].bytes; }

Directory::Directory() {
  for (const Row& row : kOutputs) add(row.name, row.type, true, false);
  for (const Row& row : kInputs) add(row.name, row.type, false, true);
  for (const bool input : {false, true}) {
    const std::string side = input ? "input" : "output";
    add(side + "_bit_registers0_to_31", U32, true, input);
    add(side + "_bit_registers32_to_63", U32, true, input);
    for (int i = 64; i < 128; ++i) add(side + "_bit_register_" + std::to_string(i), B, true, input);
    for (int i = 0; i < 48; ++i) add(side + "_int_register_" + std::to_string(i), I32, true, input);
    for (int i = 0; i < 48; ++i) add(side + "_double_register_" + std::to_string(i), D, true, input);
  }
  std::ranges::sort(fields_, {}, &Field::name);
}

void Directory::add(std::string name, Type type, bool output, bool input) {
  const bool is_double = type == D || type == V3 || type == V6;
  const bool is_register = name.find("_register") != std::string::npos;
  const double largest = is_double && !is_register ? kLargestNumber : std::numeric_limits<double>::max();
  fields_.push_back({std::move(name), type, output, input, slots_, largest});
  slots_ += values_of(type);
}

const Field* Directory::find(std::string_view name) const {
  const auto field = std::ranges::lower_bound(fields_, name, {}, [](const Field& f) { return std::string_view(f.name); });
  return field != fields_.end() && field->name == name ? &*field : nullptr;
}

bool Recipe::add(const Field& field) {
  if (fields_.size() == kMaxFields) return false;
  fields_.push_back(&field);
  bytes_ += bytes_of(field.type);
  return true;
}

bool Recipe::has(const Field& field) const { return std::ranges::find(fields_, &field) != fields_.end(); }

void write_values(const Recipe& recipe, std::span<const double> values, std::uint8_t* to) {
  for (const Field* field : recipe.fields()) {
    for (std::size_t i = 0; i < values_of(field->type); ++i) to = write_value(field->type, values[field->slot + i], to);
  }
}

Fault read_values(const Recipe& recipe, std::span<const std::uint8_t> from, std::span<double> values) {
  if (from.size() != recipe.bytes()) return Fault::kSize;
  const auto for_each = [&](const auto& visit) {
    const std::uint8_t* at = from.data();
    for (const Field* field : recipe.fields()) {
      for (std::size_t i = 0; i < values_of(field->type); ++i) {
        if (!visit(*field, i, read_value(field->type, at))) return false;
      }
    }
    return true;
  };
  const auto is_usable = [](const Field& field, std::size_t, double value) { return std::abs(value) <= field.largest; };
  if (!for_each(is_usable)) return Fault::kNotFinite;
  for_each([&](const Field& field, std::size_t i, double value) {
    values[field.slot + i] = value;
    return true;
  });
  return Fault::kNone;
}

std::span<std::uint8_t> PackageReader::space() {
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  return std::span(buffer_).subspan(end_);
}

bool PackageReader::senseless(std::size_t offset) const {
  const std::size_t at = begin_ + offset;
  if (end_ < at + kHeader) return false;
  const std::size_t size = load<std::uint16_t>(buffer_.data() + at);
  return size < kHeader || size > kMaxPackage;
}

std::optional<PackageReader::Raw> PackageReader::peek(std::size_t& offset) const {
  const std::size_t at = begin_ + offset;
  if (broken_ || end_ < at + kHeader) return std::nullopt;
  if (senseless(offset)) {
    broken_ = offset == 0;  // the packages before it are still good
    return std::nullopt;
  }
  const std::size_t size = load<std::uint16_t>(buffer_.data() + at);
  if (end_ < at + size) return std::nullopt;
  offset += size;
  return Raw{static_cast<Package>(buffer_[at + 2]), {buffer_.data() + at + kHeader, size - kHeader}};
}

std::optional<PackageReader::Raw> PackageReader::next() {
  std::size_t size = 0;
  const std::optional<Raw> package = peek(size);
  begin_ += size;
  return package;
}

std::uint8_t* PackageWriter::add(Package kind, std::size_t contents) {
  const std::size_t size = kHeader + contents;
  if (size > 0xffff) return nullptr;
  if (end_ + size > buffer_.size() && begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  if (end_ + size > buffer_.size()) return nullptr;
  std::uint8_t* at = buffer_.data() + end_;
  store(at, static_cast<std::uint16_t>(size));
  at[2] = static_cast<std::uint8_t>(kind);
  end_ += size;
  return at + kHeader;
}

bool PackageWriter::add_flag(Package kind, bool flag) {
  std::uint8_t* at = add(kind, 1);
  if (at != nullptr) *at = flag ? 1 : 0;
  return at != nullptr;
}

bool PackageWriter::add_text(int version, bool to_client, std::string_view text, std::string_view source, Level level) {
  text = text.substr(0, 255);
  source = source.substr(0, 255);
  const auto append = [](std::uint8_t* at, std::string_view part) { return std::ranges::copy(part, at).out; };
  if (version < 2 && to_client) {
    std::uint8_t* at = add(Package::kText, 1 + text.size());
    if (at == nullptr) return false;
    *at++ = static_cast<std::uint8_t>(level);
    append(at, text);
    return true;
  }
  std::uint8_t* at = add(Package::kText, 3 + text.size() + source.size());
  if (at == nullptr) return false;
  *at++ = static_cast<std::uint8_t>(text.size());
  at = append(at, text);
  *at++ = static_cast<std::uint8_t>(source.size());
  at = append(at, source);
  *at = static_cast<std::uint8_t>(level);
  return true;
}

void PackageWriter::sent(std::size_t bytes) {
  begin_ += bytes;
  if (begin_ == end_) begin_ = end_ = 0;
}

}  // namespace cotwin::rtde
