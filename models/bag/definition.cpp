#include "models/bag/definition.h"

#include <algorithm>
#include <map>
#include <optional>

#include "models/foundation/support/text.h"

namespace cotwin::bag {

namespace {

constexpr std::size_t kMostNumbers = 10'000;  // of a message; an image has more
constexpr std::size_t kMostTypes = 500;
constexpr int kDeepest = 32;

/// Definitions of types whose bags may have none (rosbag2 before Iron).
const std::map<std::string, const char*>& built_in() {
  static const std::map<std::string, const char*> all = {
      {"builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"},
      {"builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n"},
      {"std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"},
      {"std_msgs/Float64", "float64 data\n"},
      {"std_msgs/MultiArrayDimension", "string label\nuint32 size\nuint32 stride\n"},
      {"std_msgs/MultiArrayLayout", "MultiArrayDimension[] dim\nuint32 data_offset\n"},
      {"std_msgs/Float64MultiArray", "MultiArrayLayout layout\nfloat64[] data\n"},
      {"geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"},
      {"geometry_msgs/Wrench", "Vector3 force\nVector3 torque\n"},
      {"geometry_msgs/WrenchStamped", "std_msgs/Header header\nWrench wrench\n"}};
  return all;
}

/// "sensor_msgs/msg/JointState" without its middle part, as in definitions.
std::string short_name(std::string type) {
  if (const std::size_t at = type.find("/msg/"); at != std::string::npos) type.erase(at, 4);
  return type;
}

template <class T>
double as(Cdr& message) {
  return static_cast<double>(message.number<T>());
}

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  for (const std::string_view word : text::split(line.substr(0, line.find('#')), ' '))
    if (!text::trim(word).empty()) words.push_back(text::trim(word));
  return words;
}

}  // namespace

Definition::Member Definition::member_of(const std::string& type, const std::string& name) {
  static const std::map<std::string, Number> numbers = {
      {"bool", as<std::uint8_t>},    {"byte", as<std::uint8_t>},  {"char", as<std::uint8_t>},    {"int8", as<std::int8_t>},
      {"uint8", as<std::uint8_t>},   {"int16", as<std::int16_t>}, {"uint16", as<std::uint16_t>}, {"int32", as<std::int32_t>},
      {"uint32", as<std::uint32_t>}, {"int64", as<std::int64_t>}, {"uint64", as<std::uint64_t>}, {"float32", as<float>},
      {"float64", as<double>}};
  Member member;
  member.name = name;
  std::string base = type.substr(0, type.find('['));
  base = base.substr(0, base.find("<="));
  if (const std::size_t open = type.find('['); open != std::string::npos) {
    const std::string_view inside = std::string_view(type).substr(open + 1, type.find(']', open) - open - 1);
    member.array = Array::kSequence;
    if (!inside.empty() && !inside.starts_with("<=")) {
      const std::optional<double> length = text::parse_real(inside);
      if (!length || !(*length >= 1 && *length <= static_cast<double>(kMostNumbers)))
        throw Fault("has a member '" + name + "' of the type " + type + ", expected at most " + std::to_string(kMostNumbers) +
                    " elements");
      member.array = Array::kFixed;
      member.length = static_cast<std::size_t>(*length);
    }
  }
  if (base == "wstring") throw Fault("has a member '" + name + "' of the type wstring, which is not read");
  if (const auto found = numbers.find(base); found != numbers.end()) {
    member.number = found->second;
  } else {
    member.type = base == "string" ? base : short_name(base);
  }
  return member;
}

/// Adds a type, and those that follow it in the text.
void Definition::parse(const std::string& text, const std::string& type) {
  types_.push_back({type, {}});
  for (const std::string_view whole : text::split(text, '\n')) {
    std::string line(whole);
    std::ranges::replace_if(
        line, [](char c) { return c == '\t' || c == '\r'; }, ' ');
    const std::vector<std::string_view> words = words_of(line);
    if (words.empty() || words[0].starts_with("====")) continue;
    if (types_.size() > kMostTypes) throw Fault("has a definition of more than " + std::to_string(kMostTypes) + " types");
    if (words[0] == "MSG:" && words.size() > 1) {
      types_.push_back({short_name(std::string(words[1])), {}});
      continue;
    }
    if (words.size() < 2)
      throw Fault("has a definition with the line '" + line.substr(0, 80) + "', expected a type and a name");
    const bool is_constant = words[1].find('=') != std::string_view::npos || (words.size() > 2 && words[2].starts_with('='));
    if (!is_constant) types_.back().members.push_back(member_of(std::string(words[0]), std::string(words[1])));
  }
}

/// Finds the types of members, also built-in ones.
void Definition::resolve() {
  for (std::size_t t = 0; t < types_.size(); ++t) {
    const std::string package = types_[t].name.substr(0, types_[t].name.find('/') + 1);
    if (types_[t].members.empty()) types_[t].members.push_back({"", "", as<std::uint8_t>});  // the rule of rosidl
    for (std::size_t m = 0; m < types_[t].members.size(); ++m) {
      if (!types_[t].members[m].is_message()) continue;
      std::string name = types_[t].members[m].type;
      if (name.find('/') == std::string::npos) name = package + name;
      auto found = std::ranges::find(types_, name, &Type::name);
      if (found == types_.end() && types_[t].members[m].type == "Header") {
        name = "std_msgs/Header";
        found = std::ranges::find(types_, name, &Type::name);
      }
      if (found == types_.end()) {
        const auto known = built_in().find(name);
        if (known == built_in().end()) throw Fault("has members of the type " + name + ", whose definition is not in the file");
        parse(known->second, name);
        found = types_.end() - 1;
      }
      types_[t].members[m].nested = static_cast<std::size_t>(found - types_.begin());
    }
  }
}

Definition::Definition(const std::string& type, const std::string& text) {
  const std::string name = short_name(type);
  const auto known = built_in().find(name);
  if (text.empty() && known == built_in().end())
    throw Fault("has the type " + type + ", whose definition as ros2msg is not in the file");
  parse(text.empty() ? known->second : text, name);
  resolve();
  const Member& first = types_[0].members[0];
  has_header_ = first.is_message() && first.array == Array::kNone && types_[first.nested].name == "std_msgs/Header";
  if (!has_header_) return;
  header_ = first.nested;
  const std::vector<Member> rest(types_[0].members.begin() + 1, types_[0].members.end());
  const bool is_wrapped = rest.size() == 1 && rest[0].is_message() && rest[0].array == Array::kNone;
  body_ = is_wrapped ? rest[0].nested : types_.size();
  if (!is_wrapped) types_.push_back({"", rest});
}

std::uint64_t Definition::read(Cdr& message, std::vector<double>& values, std::vector<std::string>* names) const {
  const std::size_t before = values.size();
  std::uint64_t shape = 0;
  if (has_header_) read(types_[header_], "", message, values, nullptr, shape, 1);
  values.resize(before);
  read(types_[body_], "", message, values, names, shape, 1);
  return shape;
}

void Definition::read(const Type& type, const std::string& path, Cdr& message, std::vector<double>& values,
                      std::vector<std::string>* names, std::uint64_t& shape, int depth) const {
  if (depth > kDeepest) throw Fault("has a type that contains itself");
  for (const Member& member : type.members) {
    const std::size_t count = member.array == Array::kNone    ? 1
                              : member.array == Array::kFixed ? member.length
                                                              : message.count();
    if (member.array == Array::kSequence) shape = (shape ^ count) * 0x100000001b3u;
    for (std::size_t i = 0; i < count; ++i) {
      if (member.type == "string") {
        message.text();
        continue;
      }
      if (values.size() == kMostNumbers) throw Fault("has more than " + std::to_string(kMostNumbers) + " numbers");
      std::string name;
      if (names != nullptr)
        name = path + (path.empty() ? "" : ".") + member.name +
               (member.array == Array::kNone ? "" : "[" + std::to_string(i) + "]");
      if (member.number == nullptr) {
        read(types_[member.nested], name, message, values, names, shape, depth + 1);
        continue;
      }
      values.push_back(member.number(message));
      if (names != nullptr) names->push_back(std::move(name));
    }
  }
}

}  // namespace cotwin::bag
