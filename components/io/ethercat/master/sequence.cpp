#include "components/io/ethercat/master/sequence.h"

#include <algorithm>

#include "components/io/ethercat/little_endian.h"

namespace cotwin::ethercat {

namespace {

constexpr std::int64_t kSyncLead = 100'000'000;  // ns from the set-up of SYNC0 to its first pulse
constexpr std::int64_t kSyncCycles = 40;         // … at least, because an operating bus has one datagram per cycle for it
constexpr int kMostRefusals = 30;                // answers in a row with which no slave takes a datagram …
constexpr std::int64_t kAbsent = 20'000'000;     // … for so many ns: the slave has gone

std::string hex(std::uint32_t value) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text = "0x";
  for (int shift = value > 0xffff ? 28 : 12; shift >= 0; shift -= 4) text += kDigits[value >> shift & 15];
  return text;
}

/// Local time of the reference at the latch, and its offset.
std::int64_t system_time_in(std::span<const std::uint8_t> answer) {
  return static_cast<std::int64_t>(load<std::uint64_t>(answer.data()) + load<std::uint64_t>(answer.data() + 8));
}

}  // namespace

void Sequence::start(std::span<const Step> steps, const SlaveTimes& times, std::int64_t now) {
  steps_ = steps;
  times_ = times;
  at_ = furthest_ = 0;
  al_code_ = AlCode::kNone;
  abort_ = SdoAbort::kNone;
  silent_ = true;
  refusals_ = 0;
  absent_ = repeat_ = repeating_ = asked_again_ = holds_latch_ = false;
  status_ = steps_.empty() ? Status::kDone : Status::kBusy;
  if (status_ == Status::kBusy) {
    deadline_ = now + step().timeout;
    data_.assign(step().data.begin(), step().data.end());
  }
}

std::int64_t Sequence::sync0_cycle() const { return std::max<std::int64_t>(times_.sync0_cycle, 1); }
std::int64_t Sequence::sync_lead() const { return std::max(kSyncLead, kSyncCycles * sync0_cycle()); }

void Sequence::prepare(const BusTime& time) {
  if (repeating_) {
    data_.assign(1, static_cast<std::uint8_t>(sync_manager::kEnabled | (repeat_ ? sync_manager::kRepeat : 0)));
    return;
  }
  data_.assign(step().data.begin(), step().data.end());
  if (step().kind == Step::Kind::kWriteOffset) {
    // The reference continues the time of the bus; all others take it over with the delay of the frame that latched both.
    const std::int64_t system = times_.is_reference ? time.at(latched_at_) : sum(system_, times_.delay);
    store(data_.data(), difference(system, local_));
  } else if (step().kind == Step::Kind::kWriteStart) {
    const std::int64_t cycle = sync0_cycle();
    const std::int64_t shift = (times_.sync0_shift % cycle + cycle) % cycle;
    const auto earliest = static_cast<std::uint64_t>(sum(system_, sync_lead()));
    sync_start_ =
        sum(static_cast<std::int64_t>((earliest / static_cast<std::uint64_t>(cycle) + 1) * static_cast<std::uint64_t>(cycle)),
            shift);
    store(data_.data(), sync_start_);
  }
}

bool Sequence::fits(std::span<const std::uint8_t> answer, const BusTime& time) const {
  const Step& s = step();
  if (answer.size() < s.mask.size()) return false;
  // A reference that was switched off, too, does not have the time of the bus yet.
  if (s.kind == Step::Kind::kReadSystem) return time.is_plausible(system_time_in(answer), latched_at_);
  if (s.kind == Step::Kind::kCheckStart) {
    // Further away than it was set, it comes from a damaged time.
    const std::int64_t left = difference(sync_start_, load<std::int64_t>(answer.data()));
    return left > 0 && left <= sync_lead() + 2 * sync0_cycle();
  }
  for (std::size_t i = 0; i < s.mask.size(); ++i) {
    if ((answer[i] & s.mask[i]) != s.expected[i]) return false;
  }
  return true;
}

/// Repeats earlier steps, within the time of the furthest one.
void Sequence::go_back(const BusTime& time) {
  at_ -= std::min(at_, step().back);
  holds_latch_ = false;
  prepare(time);
}

/// Whether the slave has gone: a master need not wait for the time-out of the step then.
bool Sequence::note_absence(std::int64_t now) {
  if (refusals_++ == 0) refused_since_ = now;
  return absent_ = refusals_ >= kMostRefusals && now - refused_since_ >= kAbsent;
}

void Sequence::read_value(std::span<const std::uint8_t> answer, std::int64_t now) {
  switch (step().kind) {
    case Step::Kind::kLatch:
      latched_at_ = now;
      holds_latch_ = true;
      break;
    case Step::Kind::kReadLocal:
      local_ = load<std::int64_t>(answer.data());
      break;
    case Step::Kind::kReadSystem:
      system_ = system_time_in(answer);
      break;
    case Step::Kind::kWriteOffset:
      holds_latch_ = false;
      break;
    case Step::Kind::kReadNow:
      system_ = load<std::int64_t>(answer.data());
      break;
    default:
      break;
  }
}

Sequence::Status Sequence::receive(bool answered, std::uint16_t working_counter, std::span<const std::uint8_t> answer,
                                   BusTime& time, std::int64_t now) {
  if (status_ != Status::kBusy) return status_;
  const Step& s = step();
  const bool broadcast = s.command == Command::kBwr || s.command == Command::kBrd;
  const bool taken =
      answered && (broadcast ? working_counter >= s.least : working_counter == 1) && answer.size() == data_.size();
  silent_ = silent_ && !answered;
  if (taken || s.may_refuse) {
    refusals_ = 0;
  } else if (answered && note_absence(now)) {
    return fail();
  }
  if (repeating_) {
    if (taken) {  // wait for the mail again
      repeating_ = false;
      go_back(time);
    }
    return !taken && now >= deadline_ ? fail() : status_;
  }
  const bool done = taken && fits(answer, time);
  if (taken && s.kind == Step::Kind::kState && !done && (answer[0] & kStateError) != 0) {
    al_code_ = static_cast<AlCode>(load<std::uint16_t>(answer.data() + 4));
    return fail();
  }
  if (taken && s.kind == Step::Kind::kMail && !done) {
    const std::optional<CoeMail> mail = read_coe(answer);
    if (mail && mail->service != CoeService::kEmergency && mail->content.size() >= 8 && mail->content[0] == sdo::kAbort) {
      abort_ = static_cast<SdoAbort>(load<std::uint32_t>(mail->content.data() + 4));
      return fail();
    }
  }
  if (!done) {
    if (now >= deadline_ || (taken && s.identity)) return fail();
    if (!taken && s.kind == Step::Kind::kMail) {
      // The frame that took the mail out of the mailbox may be lost: the slave is asked for it again.
      repeat_ = !repeat_;
      repeating_ = true;
      prepare(time);
    } else if (taken && s.back > 0) {
      go_back(time);
    } else if (taken && s.repeat != 0 && !asked_again_ && deadline_ - now < s.timeout / 2) {
      // No mail comes: the last one may have been read, but damaged on its way.
      asked_again_ = repeating_ = true;
      repeat_ = !repeat_;
      prepare(time);
    }
    return status_;
  }
  read_value(answer, now);
  if (++at_ == steps_.size()) {
    --at_;
    return status_ = Status::kDone;
  }
  if (at_ > furthest_) {
    furthest_ = at_;
    silent_ = true;
    asked_again_ = false;
    deadline_ = now + step().timeout;
  }
  prepare(time);
  return status_;
}

std::string Sequence::failure() const {
  std::string text = "did not " + step().what + ": ";
  if (al_code_ != AlCode::kNone) return text + "AL status code " + hex(static_cast<std::uint32_t>(al_code_));
  if (abort_ != SdoAbort::kNone) {
    return text + "SDO abort " + hex(static_cast<std::uint32_t>(abort_)) + ", " + std::string(describe(abort_));
  }
  if (absent_) return text + "frames pass, but no slave takes them there";
  return text + (silent_ ? "no answer" : "another answer") + " within " + std::to_string(step().timeout / 1'000'000) + " ms";
}

}  // namespace cotwin::ethercat
