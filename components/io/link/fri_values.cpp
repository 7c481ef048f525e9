#include "components/io/link/fri_values.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

constexpr std::pair<const char*, fri::Io::Type> kTypes[] = {
    {"boolean", fri::Io::Type::kBoolean}, {"digital", fri::Io::Type::kDigital}, {"analog", fri::Io::Type::kAnalog}};

}  // namespace

std::int32_t saturated(std::uint64_t count) {
  constexpr auto kMost = std::numeric_limits<std::int32_t>::max();
  return count < static_cast<std::uint64_t>(kMost) ? static_cast<std::int32_t>(count) : kMost;
}

void KrlPorts::declare_inputs(Variables& v, const std::string& prefix, const std::string& what) {
  v.input(prefix + "_real", real, "1", what + "_REA[1..16]");
  v.input(prefix + "_integer", integer, what + "_INT[1..16]");
  v.input(prefix + "_boolean", boolean, what + "_BOOL[1..16]");
}

void KrlPorts::declare_outputs(Variables& v, const std::string& prefix, const std::string& what) {
  v.output(prefix + "_real", real, "1", what + "_REA[1..16]").discrete();
  v.output(prefix + "_integer", integer, what + "_INT[1..16]");
  v.output(prefix + "_boolean", boolean, what + "_BOOL[1..16]");
}

void KrlPorts::read(const fri::KrlVariables& values) {
  for (std::size_t i = 0; i < real.size(); ++i) {
    if (std::isfinite(values.real[i])) real[i] = static_cast<double>(values.real[i]);
    integer[i] = values.integer[i];
    boolean[i] = (values.boolean >> i & 1) != 0;
  }
}

void KrlPorts::write(fri::KrlVariables& values) const {
  values.boolean = 0;
  for (std::size_t i = 0; i < real.size(); ++i) {
    // What is not finite keeps the value before: neither side's program has to expect it.
    if (std::abs(real[i]) <= static_cast<double>(std::numeric_limits<float>::max()))
      values.real[i] = static_cast<float>(real[i]);
    values.integer[i] = integer[i];
    values.boolean = static_cast<std::uint16_t>(values.boolean | (boolean[i] ? 1 : 0) << i);
  }
}

IoPorts::IoPorts(const std::string& list, fri::Io::Direction direction, const std::string& place) {
  for (const std::string_view item : text::split(list, ',')) {
    const std::string_view trimmed = text::trim(item);
    if (trimmed.empty()) continue;
    const std::size_t colon = trimmed.rfind(':');
    fri::Io io;
    io.direction = direction;
    if (colon == std::string_view::npos || colon == 0 || !io.name.assign(text::trim(trimmed.substr(0, colon)))) {
      throw Error(place, "'" + std::string(trimmed) + "', expected Group.Name:type with a name of at most " +
                             std::to_string(fri::kMaxName) + " characters");
    }
    io.type = text::choose<fri::Io::Type>(place, std::string(text::trim(trimmed.substr(colon + 1))), kTypes);
    ios_.push_back(io);
  }
  if (ios_.size() > fri::kMaxIos) {
    throw Error(place, std::to_string(ios_.size()) + " values, expected at most " + std::to_string(fri::kMaxIos));
  }
  values_.resize(ios_.size());
}

std::string IoPorts::names() const {
  std::string list;
  for (const fri::Io& io : ios_) text::append(list, io.name.view());
  return list;
}

void IoPorts::declare_input(Variables& v, const std::string& name, const std::string& what) {
  if (!empty()) v.input(name, values_, "1", what + ": " + names());
}

void IoPorts::declare_output(Variables& v, const std::string& name, const std::string& what) {
  if (!empty()) v.output(name, values_, "1", what + ": " + names()).discrete();
}

void IoPorts::examine() {
  using Kind = BelievedNumbers::Kind;
  believed_.emplace();
  for (const fri::Io& io : ios_) believed_->add(io.type == fri::Io::Type::kBoolean ? Kind::kState : Kind::kNumber);
}

void IoPorts::read(const fri::Few<fri::Io, fri::kMaxIos>& values) {
  for (const fri::Io& io : values.all()) {
    for (std::size_t i = 0; i < ios_.size(); ++i) {
      if (!(ios_[i].name == io.name) || ios_[i].type != io.type) continue;
      const double value = io.type == fri::Io::Type::kAnalog ? io.analog : static_cast<double>(io.digital);
      if (std::isfinite(value)) values_[i] = believed_ ? believed_->put(i, value) : value;
    }
  }
}

void IoPorts::write(fri::Few<fri::Io, fri::kMaxIos>& values) const {
  values.count = 0;
  for (std::size_t i = 0; i < ios_.size(); ++i) {
    fri::Io& io = *values.add();
    // What is not finite keeps the value before.
    const double before = io.type == fri::Io::Type::kAnalog ? io.analog : static_cast<double>(io.digital);
    const double value = std::isfinite(values_[i]) ? values_[i] : before;
    io = ios_[i];
    io.analog = io.type == fri::Io::Type::kAnalog ? value : 0;
    io.digital = 0;
    if (io.type == fri::Io::Type::kBoolean) io.digital = value != 0 ? 1 : 0;
    constexpr double kMost = 9007199254740992;  // 2⁵³: every whole number up to it is a double
    if (io.type == fri::Io::Type::kDigital) io.digital = static_cast<std::uint64_t>(std::clamp(std::round(value), 0.0, kMost));
  }
}

void ClientCounts::declare(Variables& v) {
  v.output("received", received, "messages received from the robot, without duplicates");
  v.output("lost", lost, "messages of the robot that did not come, by their counters");
  v.output("duplicates", duplicates, "messages that came more than once");
  v.output("reordered", reordered, "messages that came after newer ones");
  v.output("rejected", rejected, "datagrams that were not accepted: damaged, of another protocol, or of another sender");
  v.output("strangers", strangers, "those of another sender");
  v.output("answers", answers, "answers sent");
  v.output("unreflected", unreflected, "answers that the robot has not got, by its reflected counter");
  v.output("jitter", jitter, "s", "mean deviation of the interval between messages from the send period (RFC 3550)").discrete();
  v.output("round_trip", round_trip, "s", "mean time from an answer to the first message that reflects it").discrete();
}

void ClientCounts::read(const fri::ClientStatistics& s) {
  received = saturated(s.monitoring.received());
  lost = saturated(s.monitoring.lost());
  duplicates = saturated(s.monitoring.duplicates());
  reordered = saturated(s.monitoring.reordered());
  rejected = saturated(s.faults.total());
  strangers = saturated(s.faults.of(fri::Fault::kStranger));
  answers = saturated(s.answers);
  unreflected = saturated(s.unreflected);
  jitter = s.jitter;
  round_trip = s.round_trip.mean();
}

void ControllerCounts::declare(Variables& v) {
  v.output("sent", sent, "messages sent to the client");
  v.output("in_time", in_time, "command periods with an answer in time");
  v.output("late", late, "command periods with a late answer");
  v.output("missing", missing, "command periods without an answer");
  v.output("lost", lost, "commands of the client that did not come, by their counters");
  v.output("duplicates", duplicates, "commands that came more than once");
  v.output("reordered", reordered, "commands that came after newer ones");
  v.output("rejected", rejected, "datagrams that were not accepted: damaged, of another protocol, or of another sender");
  v.output("strangers", strangers, "those of another sender");
  v.output("bridged", bridged, "command periods whose command was extrapolated");
  v.output("skipped", skipped, "messages that were not sent because the steps are longer than the send period");
  v.output("latency", latency, "s", "mean time from a message to its answer").discrete();
  v.output("latency_deviation", jitter, "s", "standard deviation of that time").discrete();
}

void ControllerCounts::read(const fri::ControllerStatistics& s) {
  sent = saturated(s.sent);
  in_time = saturated(s.in_time);
  late = saturated(s.late);
  missing = saturated(s.missing);
  lost = saturated(s.commands.lost());
  duplicates = saturated(s.commands.duplicates());
  reordered = saturated(s.commands.reordered());
  rejected = saturated(s.faults.total());
  strangers = saturated(s.faults.of(fri::Fault::kStranger));
  bridged = saturated(s.bridged);
  skipped = saturated(s.skipped);
  latency = s.latency.mean();
  jitter = s.latency.deviation();
}

void declare_fri_settings(SettingList& s) {
  s.choice("protocol", {"lwr", "sunrise-1.11", "sunrise-1.14", "sunrise-1.15", "sunrise-1.16", "sunrise-2.5", "sunrise-2.7"},
           "link=fri, fri_controller: FRI 1.0 of the LWR 4+, or the version of Sunrise's FRI");
  s.text("io_read", "",
         "link=fri, fri_controller: Sunrise's I/O values that the robot sends, Group.Name:boolean|digital|analog,…");
  s.text("io_write", "", "link=fri, fri_controller: Sunrise's I/O values that the client writes, as io_read");
}

fri::Protocol protocol_of(Settings& settings) {
  const std::string place = "unit:io?link=" + settings.choice("link");
  return fri::protocol_of(settings.choice("protocol"), place + "&protocol");
}

std::int32_t default_port(fri::Protocol protocol) { return protocol == fri::Protocol::kLwr ? 49938 : 30200; }

}  // namespace cotwin::io
