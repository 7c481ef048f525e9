#include "components/io/ethercat/master/sequence.h"

#include <algorithm>

#include "components/io/ethercat/little_endian.h"

namespace cotwin::ethercat {

namespace {

constexpr std::int64_t kSyncLead = 100'000'000;  // ns from the set-up of SYNC0 to its first pulse

std::string hex(std::uint32_t value) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text = "0x";
  for (int shift = value > 0xffff ? 28 : 12; shift >= 0; shift -= 4) text += kDigits[value >> shift & 15];
  return text;
}

}  // namespace

void Sequence::start(std::span<const Step> steps, const SlaveTimes& times, std::int64_t now) {
  steps_ = steps;
  times_ = times;
  at_ = 0;
  al_code_ = AlCode::kNone;
  abort_ = SdoAbort::kNone;
  silent_ = true;
  status_ = steps_.empty() ? Status::kDone : Status::kBusy;
  if (status_ == Status::kBusy) {
    deadline_ = now + step().timeout;
    data_.assign(step().data.begin(), step().data.end());
  }
}

void Sequence::prepare(const BusTime& time) {
  data_.assign(step().data.begin(), step().data.end());
  if (step().kind == Step::Kind::kWriteOffset) {
    // The reference continues the time of the bus; all others take it over with the delay of the frame that latched both.
    const std::int64_t system = times_.is_reference ? time.at(latched_at_) : system_ + times_.delay;
    store(data_.data(), system - local_);
  } else if (step().kind == Step::Kind::kWriteStart) {
    const std::int64_t cycle = std::max<std::int64_t>(times_.sync0_cycle, 1);
    store(data_.data(), ((system_ + kSyncLead) / cycle + 1) * cycle + times_.sync0_shift);
  }
}

bool Sequence::fits(std::span<const std::uint8_t> answer) const {
  const Step& s = step();
  if (answer.size() < s.mask.size()) return false;
  for (std::size_t i = 0; i < s.mask.size(); ++i) {
    if ((answer[i] & s.mask[i]) != s.expected[i]) return false;
  }
  return true;
}

Sequence::Status Sequence::receive(bool answered, std::uint16_t working_counter, std::span<const std::uint8_t> answer,
                                   BusTime& time, std::int64_t now) {
  if (status_ != Status::kBusy) return status_;
  const Step& s = step();
  const bool broadcast = s.command == Command::kBwr || s.command == Command::kBrd;
  const bool taken = answered && (broadcast ? working_counter > 0 : working_counter == 1) && answer.size() == data_.size();
  silent_ = silent_ && !answered;
  bool done = taken && fits(answer);
  if (taken && s.kind == Step::Kind::kState && !done && (answer[0] & kStateError) != 0) {
    al_code_ = static_cast<AlCode>(load<std::uint16_t>(answer.data() + 4));
    return status_ = Status::kFailed;
  }
  if (taken && s.kind == Step::Kind::kMail && !done) {
    const std::optional<CoeMail> mail = read_coe(answer);
    if (mail && mail->service != CoeService::kEmergency && mail->content.size() >= 8 && mail->content[0] == sdo::kAbort) {
      abort_ = static_cast<SdoAbort>(load<std::uint32_t>(mail->content.data() + 4));
      return status_ = Status::kFailed;
    }
  }
  if (!done) {
    if (now >= deadline_) return status_ = Status::kFailed;
    if (taken && s.back > 0) {
      at_ -= std::min(at_, s.back);
      prepare(time);
    }
    return status_;
  }
  if (s.kind == Step::Kind::kReadLocal) local_ = load<std::int64_t>(answer.data());
  if (s.kind == Step::Kind::kLatch) latched_at_ = now;
  if (s.kind == Step::Kind::kReadNow) system_ = load<std::int64_t>(answer.data());
  if (s.kind == Step::Kind::kReadSystem) system_ = load<std::int64_t>(answer.data()) + load<std::int64_t>(answer.data() + 8);
  if (++at_ == steps_.size()) {
    --at_;
    return status_ = Status::kDone;
  }
  silent_ = true;
  deadline_ = now + step().timeout;
  prepare(time);
  return status_;
}

std::string Sequence::failure() const {
  std::string text = std::string("did not ") + step().what + ": ";
  if (al_code_ != AlCode::kNone) return text + "AL status code " + hex(static_cast<std::uint32_t>(al_code_));
  if (abort_ != SdoAbort::kNone) {
    return text + "SDO abort " + hex(static_cast<std::uint32_t>(abort_)) + ", " + std::string(describe(abort_));
  }
  return text + (silent_ ? "no answer" : "another answer") + " within " + std::to_string(step().timeout / 1'000'000) + " ms";
}

}  // namespace cotwin::ethercat
