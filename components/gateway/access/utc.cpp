#include "components/gateway/access/utc.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>

namespace cotwin::gateway {

namespace {

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

UtcTime utc_now() { return std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now()); }

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

UtcTime ForwardClock::now(UtcTime system, Steady steady) {
  if (at_ != Steady{}) latest_ += steady - at_;
  latest_ = std::max<std::chrono::sys_time<std::chrono::nanoseconds>>(latest_, system);
  at_ = steady;
  return std::chrono::floor<std::chrono::milliseconds>(latest_);
}

}  // namespace cotwin::gateway
