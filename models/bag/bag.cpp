#include "models/bag/bag.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "models/bag/definition.h"
#include "models/bag/joint_state.h"
#include "models/bag/storage.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::bag {

namespace {

namespace fs = std::filesystem;

constexpr const char* kJointState = "sensor_msgs/msg/JointState";
constexpr std::int64_t kSecond = 1'000'000'000;  // ns

/// The number before the suffix of a split: 10 of "log_10.mcap".
double number_of(const fs::path& file) {
  const std::string stem = file.stem().string();
  const std::size_t digits = stem.find_last_not_of("0123456789") + 1;
  return text::parse_real(stem.substr(digits)).value_or(-1);
}

std::vector<fs::path> files_of(const fs::path& bag) {
  std::error_code none;
  if (!fs::is_directory(bag, none)) return {bag};
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(bag, none)) {
    const std::string extension = entry.path().extension().string();
    if (extension == ".mcap" || extension == ".db3") files.push_back(entry.path());
    if (extension == ".zstd")
      throw Error(entry.path().string(), "is a compressed file of a bag, expected it as it was: zstd -d");
  }
  if (files.empty()) throw Error(bag.string(), "is a folder of rosbag2 without .mcap or .db3");
  std::ranges::sort(files, {}, [](const fs::path& file) { return std::pair(number_of(file), file.filename().string()); });
  return files;
}

std::unique_ptr<Storage> storage_of(const fs::path& file) {
  std::string begin(16, '\0');
  std::ifstream(file, std::ios::binary).read(begin.data(), static_cast<std::streamsize>(begin.size()));
  if (begin.starts_with("#ROSBAG V"))
    throw Error(file.string(), "is a bag of ROS 1, expected one of ROS 2: rosbags-convert --src FILE --dst FOLDER");
  return begin.starts_with("SQLite format 3") ? open_sqlite(file) : open_mcap(file);
}

/// A word of a file for a terminal.
std::string shown(std::string word) {
  std::ranges::replace_if(
      word, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }, '?');
  return word;
}

/// Also of times of damaged files, which may be any.
double seconds_between(std::int64_t begin, std::int64_t end) {
  const auto ns = static_cast<std::int64_t>(static_cast<std::uint64_t>(end) - static_cast<std::uint64_t>(begin));
  return static_cast<double>(ns) / static_cast<double>(kSecond);
}

/// What is known of the messages of a topic after a scan.
struct Survey {
  Topic topic;
  std::string trouble;
  std::optional<Definition> definition;  // of others than JointState
  JointStates joints;
  struct Seen {
    std::int64_t messages = 0;
    std::array<std::int64_t, JointStates::kQuantities> with{};  // of them that have a value
    /// Velocities are for checks alone: where some are missing or unknown, rows are not left out for them.
    bool has(std::size_t quantity) const { return with[quantity] > (quantity == 1 ? messages - 1 : 0); }
  };
  std::vector<Seen> seen;  // per joint
  std::int64_t messages = 0, first = std::numeric_limits<std::int64_t>::max(), last = std::numeric_limits<std::int64_t>::min();
  std::int64_t unstamped = 0;
  std::size_t publishers = 1;

  bool is_joints() const { return topic.type == kJointState; }
  bool has_header() const { return is_joints() || (definition && definition->has_header()); }
};

/// ns
std::int64_t stamp_of(std::span<const std::byte> data) {
  Cdr message(data);
  const std::int64_t seconds = message.number<std::int32_t>();
  return seconds * kSecond + message.number<std::uint32_t>();
}

/// All files of a bag, one after the other.
class Bag {
 public:
  explicit Bag(const fs::path& bag) : place_(bag.string()) {
    for (const fs::path& file : files_of(bag)) {
      Storage& storage = *storages_.emplace_back(storage_of(file));
      own_.emplace_back();
      storage.scan([&](const Message& message) { look_at(message); });
      own_topics(storage.topics().size());  // also those without messages
    }
  }

  std::vector<Survey>& topics() { return topics_; }

  void select(std::size_t topic) {
    for (std::size_t s = 0; s < storages_.size(); ++s) {
      std::vector<bool> wanted;
      for (const std::size_t own : own_[s]) wanted.push_back(own == topic);
      storages_[s]->select(std::move(wanted));
    }
  }
  bool next(Message& message) {
    while (current_ < storages_.size()) {
      if (storages_[current_]->next(message)) return true;
      ++current_;
    }
    return false;
  }

 private:
  /// Adds the topics of the last file that are before `count`; their indices in topics_.
  const std::vector<std::size_t>& own_topics(std::size_t count) {
    std::vector<std::size_t>& own = own_.back();
    while (own.size() < count) own.push_back(add(storages_.back()->topics()[own.size()], own));
    return own;
  }
  std::size_t add(const Topic& topic, const std::vector<std::size_t>& own) {
    const auto known = std::ranges::find_if(
        topics_, [&](const Survey& one) { return one.topic.name == shown(topic.name) && one.topic.type == shown(topic.type); });
    const auto index = static_cast<std::size_t>(known - topics_.begin());
    if (known != topics_.end()) {
      if (std::ranges::find(own, index) != own.end()) ++known->publishers;
      return index;
    }
    Survey& survey = topics_.emplace_back();
    survey.topic = {shown(topic.name), shown(topic.type), "", ""};
    survey.trouble = topic.trouble;
    if (!survey.trouble.empty() || survey.is_joints()) return index;
    try {
      survey.definition.emplace(topic.type, topic.definition);
    } catch (const Fault& fault) {
      survey.trouble = fault.what();
    }
    return index;
  }

  void look_at(const Message& message) {
    Survey& survey = topics_[own_topics(message.topic + 1)[message.topic]];
    ++survey.messages;
    survey.first = std::min(survey.first, message.time);
    survey.last = std::max(survey.last, message.time);
    if (!survey.trouble.empty()) return;
    try {
      if (survey.has_header() && stamp_of(message.data) == 0) ++survey.unstamped;
      if (!survey.is_joints()) return;
      Cdr cdr(message.data);
      const JointStates::Layout& layout = survey.joints.read(cdr, values_);
      survey.seen.resize(survey.joints.joints().size());
      for (const std::size_t joint : layout.joints) ++survey.seen[joint].messages;
      for (std::size_t k = 0; k < values_.size(); ++k)
        for (std::size_t j = 0; j < values_[k].size(); ++j)
          if (k != 1 || std::isfinite(values_[k][j])) ++survey.seen[layout.joints[j]].with[k];
    } catch (const Fault& fault) {
      survey.trouble = "message " + std::to_string(survey.messages) + ": " + fault.what();
    }
  }

  std::string place_;
  std::vector<std::unique_ptr<Storage>> storages_;
  std::vector<std::vector<std::size_t>> own_;  // per file: topics_ of its own topics
  std::vector<Survey> topics_;
  std::array<std::vector<double>, JointStates::kQuantities> values_;
  std::size_t current_ = 0;
};

std::string listed(std::span<const Survey> topics) {
  std::string list;
  for (const Survey& one : topics)
    text::append(list, one.topic.name + " (" + one.topic.type + ", " + text::counted(one.messages, "message") + ")", ", ");
  return list.empty() ? "none" : list;
}

class Table final : public csv::Source {
 public:
  Table(const fs::path& file, const csv::Options& options)
      : Source(file.string()), bag_(file), survey_(bag_.topics()[choose(options.topic)]) {
    before_ = file_ + ": " + survey_.topic.name + ": message ";
    if (!survey_.trouble.empty()) throw Error(file_ + ": " + survey_.topic.name, survey_.trouble);
    if (survey_.messages == 0) throw Error(file_ + ": " + survey_.topic.name, "has no messages");
    by_stamp_ = survey_.has_header() && survey_.unstamped == 0;
    bag_.select(static_cast<std::size_t>(&survey_ - bag_.topics().data()));
    names_ = {"t"};
    if (survey_.is_joints()) {
      name_joints();
    } else {
      ahead_ = bag_.next(message_);
      try {
        shape_ = decode_others(&names_);
      } catch (const Fault& fault) {
        throw Error(before_ + "1", fault.what());
      }
    }
    values_.resize(names_.size());
  }

  const char* row() const override { return "message"; }

  bool next() override {
    for (;;) {
      if (!std::exchange(ahead_, false) && !bag_.next(message_)) return false;
      ++line_;
      read();
      const auto lacks = [&](std::size_t column) { return !given_[column]; };
      if (std::ranges::none_of(required_, lacks)) return true;
      if (left_out_++ == 0) first_left_out_ = line_;
    }
  }

  double real(std::size_t column) const override { return values_[column]; }
  std::string_view text(std::size_t column) const override {
    text_ = cotwin::text::to_text(values_[column]);
    return text_;
  }
  void require(const std::vector<std::size_t>& columns) override { required_ = columns; }

  std::vector<std::string> notes() const override {
    const std::string& place = survey_.topic.name;
    std::vector<std::string> all{place + ": times are " + (by_stamp_ ? "the stamps of the messages" : "those of the log")};
    if (!by_stamp_ && survey_.has_header())
      all[0] += ", as " + cotwin::text::counted(survey_.unstamped, "message") + " of " + std::to_string(survey_.messages) +
                " have no stamp";
    if (survey_.publishers > 1) all.push_back(place + ": messages of " + std::to_string(survey_.publishers) + " publishers");
    if (survey_.joints.sets() > 1)
      all.push_back(place + ": its messages name " + std::to_string(survey_.joints.sets()) +
                    " sets of joints, as those of several publishers");
    if (std::ranges::any_of(survey_.seen, [](const Survey::Seen& one) { return one.with[1] > 0 && !one.has(1); }))
      all.push_back(place + ": velocities are not in all messages, and are not read where some are missing");
    if (left_out_ > 0)
      all.push_back(place + ": " + cotwin::text::counted(left_out_, "message") +
                    " without a value of one of the joints left out, the first is message " + std::to_string(first_left_out_));
    if (std::ranges::any_of(required_, [&](std::size_t column) { return names_[column].starts_with("effort_"); }))
      all.push_back("effort of " + survey_.topic.name +
                    " is taken as N.m; drivers of UR report currents (--tau-scale) or torques less gravity");
    return all;
  }

 private:
  std::size_t choose(const std::string& wanted) {
    const std::vector<Survey>& topics = bag_.topics();
    std::vector<std::size_t> fit;
    for (std::size_t i = 0; i < topics.size(); ++i)
      if (wanted.empty() ? topics[i].is_joints() && topics[i].messages > 0 : topics[i].topic.name == wanted) fit.push_back(i);
    if (fit.size() != 1)
      throw Error(file_, (wanted.empty() ? std::to_string(fit.size()) + " topics with joints, expected one, or --topic NAME"
                                         : (fit.empty() ? "has no topic '" : "has several types on the topic '") + wanted +
                                               "', expected another one") +
                             "; topics: " + listed(topics));
    return fit[0];
  }

  void name_joints() {
    const std::vector<std::string>& joints = survey_.joints.joints();
    column_.resize(joints.size());
    for (std::size_t k = 0; k < JointStates::kQuantities; ++k)
      for (std::size_t j = 0; j < joints.size(); ++j) {
        if (!survey_.seen[j].has(k)) continue;
        column_[j][k] = names_.size();
        names_.push_back(std::string(JointStates::kNames[k]) + "_" + joints[j]);
      }
  }

  std::uint64_t decode_others(std::vector<std::string>* names) {
    Cdr cdr(message_.data);
    numbers_.assign(1, 0.0);
    return survey_.definition->read(cdr, numbers_, names);
  }

  void read() {
    try {
      const std::int64_t time = by_stamp_ ? stamp_of(message_.data) : message_.time;
      if (line_ == 1) origin_ = time;
      given_.assign(names_.size(), survey_.definition.has_value());
      given_[0] = true;
      if (survey_.is_joints()) {
        std::ranges::fill(values_, std::numeric_limits<double>::quiet_NaN());
        Cdr cdr(message_.data);
        const JointStates::Layout& layout = survey_.joints.read(cdr, of_joints_);
        for (std::size_t k = 0; k < of_joints_.size(); ++k)
          for (std::size_t j = 0; j < of_joints_[k].size(); ++j) {
            const std::size_t column = column_[layout.joints[j]][k];
            if (column == 0) continue;
            values_[column] = of_joints_[k][j];
            given_[column] = true;
          }
      } else {
        if (decode_others(nullptr) != shape_ || numbers_.size() != names_.size())
          throw Fault("has " + std::to_string(numbers_.size() - 1) + " numbers in arrays of other lengths, expected " +
                      std::to_string(names_.size() - 1) + " as in the first message");
        std::ranges::copy(numbers_, values_.begin());
      }
      values_[0] = seconds_between(origin_, time);
    } catch (const Fault& fault) {
      throw Error(place(), fault.what());
    }
  }

  Bag bag_;
  Survey& survey_;
  bool by_stamp_ = false, ahead_ = false;
  Message message_;
  std::int64_t origin_ = 0;
  std::uint64_t shape_ = 0;                                                // of the first message's arrays
  std::vector<std::array<std::size_t, JointStates::kQuantities>> column_;  // by joint
  std::array<std::vector<double>, JointStates::kQuantities> of_joints_;
  std::vector<double> values_, numbers_;
  std::vector<bool> given_;
  std::vector<std::size_t> required_;
  std::int64_t left_out_ = 0;
  std::size_t first_left_out_ = 0;
  mutable std::string text_;
};

std::unique_ptr<csv::Source> open(const fs::path& file, const csv::Options& options) {
  return std::make_unique<Table>(file, options);
}

}  // namespace

std::vector<TopicInfo> topics_of(const fs::path& bag) {
  Bag all(bag);
  std::vector<TopicInfo> topics;
  for (const Survey& one : all.topics()) {
    const double duration = one.messages > 0 ? seconds_between(one.first, one.last) : 0;
    topics.push_back({one.topic.name, one.topic.type, one.messages, duration, one.joints.joints(), one.trouble});
  }
  std::ranges::sort(topics, {}, &TopicInfo::name);
  return topics;
}

void start() { csv::bag_opener = &open; }

}  // namespace cotwin::bag
