#pragma once
#include <cstdint>
#include <string>

#include "components/unit/variables.h"

namespace cotwin {

/// What a detector can see, in all units. Codes keep their numbers.
enum class EventCode : std::int32_t { kNone = 0, kClear = 10, kSlow = 11, kStop = 12, kLost = 13, kNotStopped = 14 };

/// The outputs that every detector has: how much it has seen, and the last of it.
class EventPorts {
 public:
  /// `codes`: meaning of the codes. `links`: what event_link counts. `size`: meaning of event_size, in `si`.
  void declare(Variables& v, const std::string& codes, const std::string& links, const std::string& si,
               const std::string& size) {
    v.output("event_count", count_, "events since the start");
    v.output("event_code", code_, "of the last event: " + codes + "; 0: there was none");
    v.output("event_link", link_, "of the last event: " + links);
    v.output("event_t", t_, "s", "time of the last event").discrete();
    v.output("event_size", size_, si, "of the last event: " + size).discrete();
  }
  void raise(EventCode code, std::int32_t link, double t, double size) {
    ++count_;
    code_ = static_cast<std::int32_t>(code);
    link_ = link;
    t_ = t;
    size_ = size;
  }
  void reset() { *this = {}; }

 private:
  std::int32_t count_ = 0, code_ = 0, link_ = 0;
  double t_ = 0, size_ = 0;
};

}  // namespace cotwin
