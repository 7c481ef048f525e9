#include "components/gateway/jobs/job.h"

#include <array>
#include <charconv>
#include <cstdio>

namespace cotwin::gateway {

namespace {

template <class Value>
struct Name {
  Value value;
  std::string_view text;
};

constexpr std::array<Name<JobState>, 6> kStates = {{{JobState::kNotAllowedToStart, "NotAllowedToStart"},
                                                    {JobState::kAllowedToStart, "AllowedToStart"},
                                                    {JobState::kRunning, "Running"},
                                                    {JobState::kInterrupted, "Interrupted"},
                                                    {JobState::kEnded, "Ended"},
                                                    {JobState::kAborted, "Aborted"}}};
constexpr std::array<Name<JobResult>, 3> kResults = {
    {{JobResult::kUnknown, "Unknown"}, {JobResult::kSuccessful, "Successful"}, {JobResult::kUnsuccessful, "Unsuccessful"}}};
constexpr std::array<Name<JobVerb>, 8> kVerbs = {{{JobVerb::kStart, "Start"},
                                                  {JobVerb::kRevokeStart, "RevokeStart"},
                                                  {JobVerb::kPause, "Pause"},
                                                  {JobVerb::kResume, "Resume"},
                                                  {JobVerb::kStop, "Stop"},
                                                  {JobVerb::kAbort, "Abort"},
                                                  {JobVerb::kCancel, "Cancel"},
                                                  {JobVerb::kClear, "Clear"}}};

template <class Names, class Value>
std::string_view name_in(const Names& names, Value value) {
  for (const auto& name : names) {
    if (name.value == value) return name.text;
  }
  return "";
}

template <class Value, std::size_t n>
std::optional<Value> value_in(const std::array<Name<Value>, n>& names, std::string_view text) {
  for (const auto& name : names) {
    if (name.text == text) return name.value;
  }
  return std::nullopt;
}

/// Reads a number of exactly `digits` digits from the start of `text` and removes it.
bool read_number(std::string_view& text, std::size_t digits, int& value) {
  if (text.size() < digits) return false;
  const auto [end, error] = std::from_chars(text.data(), text.data() + digits, value);
  if (error != std::errc() || end != text.data() + digits || text.front() == '-') return false;
  text.remove_prefix(digits);
  return true;
}

bool take(std::string_view& text, std::string_view characters) {
  if (text.empty() || characters.find(text.front()) == std::string_view::npos) return false;
  text.remove_prefix(1);
  return true;
}

}  // namespace

std::string_view to_text(JobState state) { return name_in(kStates, state); }
std::string_view to_text(JobResult result) { return name_in(kResults, result); }
std::string_view to_text(JobVerb verb) { return name_in(kVerbs, verb); }
std::optional<JobState> state_of(std::string_view name) { return value_in(kStates, name); }
std::optional<JobVerb> verb_of(std::string_view name) { return value_in(kVerbs, name); }

std::string to_text(UtcTime time) {
  const auto day = std::chrono::floor<std::chrono::days>(time);
  const std::chrono::year_month_day date(day);
  const std::chrono::hh_mm_ss clock(time - day);
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%04d-%02u-%02uT%02d:%02d:%02d.%03dZ", static_cast<int>(date.year()),
                static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()), static_cast<int>(clock.hours().count()),
                static_cast<int>(clock.minutes().count()), static_cast<int>(clock.seconds().count()),
                static_cast<int>(clock.subseconds().count()));
  return text.data();
}

std::optional<UtcTime> time_of(std::string_view text) {
  using namespace std::chrono;
  int y = 0, m = 0, d = 0, hour = 0, minute = 0, second = 0, thousandths = 0;
  if (!read_number(text, 4, y) || !take(text, "-") || !read_number(text, 2, m) || !take(text, "-") ||
      !read_number(text, 2, d) || !take(text, "Tt") || !read_number(text, 2, hour) || !take(text, ":") ||
      !read_number(text, 2, minute) || !take(text, ":") || !read_number(text, 2, second))
    return std::nullopt;
  if (take(text, ".")) {
    std::size_t digits = 0;
    for (int weight = 100; !text.empty() && text.front() >= '0' && text.front() <= '9'; weight /= 10, ++digits) {
      thousandths += weight * (text.front() - '0');
      text.remove_prefix(1);
    }
    if (digits == 0 || digits > 9) return std::nullopt;
  }
  minutes offset{0};
  if (!take(text, "Zz")) {
    if (text.empty()) return std::nullopt;
    const int sign = text.front() == '-' ? -1 : 1;
    int hours_east = 0, minutes_east = 0;
    if (!take(text, "+-") || !read_number(text, 2, hours_east) || !take(text, ":") || !read_number(text, 2, minutes_east) ||
        hours_east > 23 || minutes_east > 59)
      return std::nullopt;
    offset = sign * (hours(hours_east) + minutes(minutes_east));
  }
  const year_month_day date{year(y), month(static_cast<unsigned>(m)), day(static_cast<unsigned>(d))};
  if (!text.empty() || y < 1970 || !date.ok() || hour > 23 || minute > 59 || second > 59) return std::nullopt;
  return UtcTime(sys_days(date) + hours(hour) + minutes(minute) + seconds(second) + milliseconds(thousandths) - offset);
}

}  // namespace cotwin::gateway
