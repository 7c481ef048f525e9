#include "components/io/ethercat/coe.h"

#include <algorithm>
#include <string>

#include "components/io/ethercat/little_endian.h"
#include "models/foundation/support/error.h"

namespace cotwin::ethercat {

std::optional<MailHeader> read_mail_header(std::span<const std::uint8_t> mail) {
  if (mail.size() < kMailHeader) return std::nullopt;
  MailHeader h;
  h.length = load<std::uint16_t>(&mail[0]);
  if (h.length > mail.size() - kMailHeader) return std::nullopt;
  h.station = load<std::uint16_t>(&mail[2]);
  h.priority = mail[4];
  h.type = static_cast<MailType>(mail[5] & 0x0f);
  h.counter = mail[5] >> 4 & 7;
  return h;
}

void write_mail_header(std::span<std::uint8_t> mail, const MailHeader& h) {
  store(&mail[0], h.length);
  store(&mail[2], h.station);
  mail[4] = h.priority;
  mail[5] = static_cast<std::uint8_t>(static_cast<std::uint8_t>(h.type) | h.counter << 4);
}

std::string_view describe(SdoAbort code) {
  switch (code) {
    case SdoAbort::kNone:
      return "no abort";
    case SdoAbort::kToggle:
      return "the toggle bit did not change";
    case SdoAbort::kCommand:
      return "the command is not valid";
    case SdoAbort::kMemory:
      return "out of memory";
    case SdoAbort::kAccess:
      return "the access is not supported";
    case SdoAbort::kWriteOnly:
      return "the object can only be written";
    case SdoAbort::kReadOnly:
      return "the object can only be read";
    case SdoAbort::kSubindex0:
      return "subindex 0 must be 0 before the others are written";
    case SdoAbort::kComplete:
      return "complete access is not supported";
    case SdoAbort::kNoObject:
      return "the object does not exist";
    case SdoAbort::kNotMappable:
      return "the object cannot be mapped to the PDO";
    case SdoAbort::kPdoLength:
      return "the mapped objects are too long for the PDO";
    case SdoAbort::kLength:
      return "the length does not match the data type";
    case SdoAbort::kTooLong:
      return "the value is too long";
    case SdoAbort::kTooShort:
      return "the value is too short";
    case SdoAbort::kNoSubindex:
      return "the subindex does not exist";
    case SdoAbort::kRange:
      return "the value is out of range";
    case SdoAbort::kGeneral:
      return "general error";
    case SdoAbort::kState:
      return "not possible in this state";
  }
  return "unknown abort code";
}

std::span<std::uint8_t> write_coe(std::span<std::uint8_t> buffer, CoeService service, std::uint8_t counter, std::size_t size) {
  write_mail_header(buffer, {.length = static_cast<std::uint16_t>(size + 2), .type = MailType::kCoE, .counter = counter});
  store(&buffer[kMailHeader], static_cast<std::uint16_t>(static_cast<unsigned>(service) << 12));
  return buffer.first(kCoeHeader + size);
}

std::optional<CoeMail> read_coe(std::span<const std::uint8_t> mail) {
  const auto header = read_mail_header(mail);
  if (!header || header->type != MailType::kCoE || header->length < 2) return std::nullopt;
  return CoeMail{static_cast<CoeService>(load<std::uint16_t>(&mail[kMailHeader]) >> 12),
                 mail.subspan(kCoeHeader, header->length - 2u)};
}

void write_sdo(std::span<std::uint8_t> content, std::uint8_t command, std::uint16_t index, std::uint8_t subindex,
               std::uint32_t value) {
  content[0] = command;
  store(&content[1], index);
  content[3] = subindex;
  store(&content[4], value);
}

SdoClient::SdoClient(std::size_t out, std::size_t in, std::size_t largest) : out_(out), request_(out), data_(largest) {
  if (out < kShortestMailbox || in < kShortestMailbox) {
    throw Error("mailbox", std::to_string(out) + " and " + std::to_string(in) + " bytes, expected at least 16");
  }
}

/// The content of the next request, `size` bytes.
std::span<std::uint8_t> SdoClient::begin(std::size_t size) {
  counter_ = static_cast<std::uint8_t>(counter_ % 7 + 1);
  request_size_ = write_coe(request_, CoeService::kSdoRequest, counter_, size).size();
  const std::span<std::uint8_t> content = std::span(request_).subspan(kCoeHeader, size);
  std::fill(content.begin(), content.end(), std::uint8_t{0});
  return content;
}

void SdoClient::upload(std::uint16_t index, std::uint8_t subindex, bool complete) {
  index_ = index;
  subindex_ = subindex;
  uploading_ = true;
  segmented_ = false;
  size_ = done_ = 0;
  toggle_ = 0;
  abort_ = SdoAbort::kNone;
  write_sdo(begin(8), static_cast<std::uint8_t>(sdo::kUpload | (complete ? sdo::kComplete : 0)), index, subindex, 0);
}

void SdoClient::download(std::uint16_t index, std::uint8_t subindex, std::span<const std::uint8_t> data, bool complete) {
  if (data.size() > data_.size()) {
    throw Error("SDO download", std::to_string(data.size()) + " bytes, expected at most " + std::to_string(data_.size()));
  }
  index_ = index;
  subindex_ = subindex;
  uploading_ = false;
  size_ = data.size();
  toggle_ = 0;
  abort_ = SdoAbort::kNone;
  std::copy(data.begin(), data.end(), data_.begin());
  const std::uint8_t command = static_cast<std::uint8_t>(sdo::kDownload | sdo::kSizeGiven | (complete ? sdo::kComplete : 0));
  if (!data.empty() && data.size() <= 4) {
    const auto content = begin(8);
    write_sdo(content, static_cast<std::uint8_t>(command | sdo::kExpedited | (4 - data.size()) << 2), index, subindex, 0);
    std::copy(data.begin(), data.end(), content.begin() + 4);
    done_ = size_;
  } else {
    done_ = std::min(size_, out_ - kSdoHeader);
    const auto content = begin(8 + done_);
    write_sdo(content, command, index, subindex, static_cast<std::uint32_t>(size_));
    std::copy_n(data_.begin(), done_, content.begin() + 8);
  }
  segmented_ = done_ < size_;
}

void SdoClient::send_segment() {
  const std::size_t part = std::min(size_ - done_, out_ - kCoeHeader - 1);
  const auto content = begin(1 + std::max<std::size_t>(part, 7));
  content[0] = static_cast<std::uint8_t>(sdo::kDownloadSegment | toggle_ | (part < 7 ? (7 - part) << 1 : 0) |
                                         (done_ + part == size_ ? sdo::kLast : 0));
  std::copy_n(data_.begin() + static_cast<std::ptrdiff_t>(done_), part, content.begin() + 1);
  done_ += part;
}

void SdoClient::ask_segment() {
  const auto content = begin(8);
  content[0] = static_cast<std::uint8_t>(sdo::kUploadSegment | toggle_);
}

SdoClient::Result SdoClient::fail(SdoAbort code) {
  abort_ = code;
  write_sdo(begin(8), sdo::kAbort, index_, subindex_, static_cast<std::uint32_t>(code));
  return Result::kAborted;
}

SdoClient::Result SdoClient::receive(std::span<const std::uint8_t> mail) {
  const auto coe = read_coe(mail);
  if (!coe || coe->content.empty()) return Result::kUnrelated;
  const auto content = coe->content;
  const std::uint8_t service = content[0] & sdo::kServiceBits;
  const bool initial = content.size() >= 8;
  const bool ours = initial && load<std::uint16_t>(&content[1]) == index_ && content[3] == subindex_;
  if (service == sdo::kAbort && (coe->service == CoeService::kSdoRequest || coe->service == CoeService::kSdoResponse)) {
    if (!ours) return Result::kUnrelated;
    request_size_ = 0;
    abort_ = static_cast<SdoAbort>(load<std::uint32_t>(&content[4]));
    return Result::kAborted;
  }
  if (coe->service != CoeService::kSdoResponse) return Result::kUnrelated;
  if (uploading_) {
    if (segmented_) return receive_segment(content);
    if (service != sdo::kUploaded || !initial) return fail(SdoAbort::kCommand);
    return ours ? receive_uploaded(content) : Result::kUnrelated;
  }
  if (service == sdo::kDownloaded && initial) {
    if (!ours) return Result::kUnrelated;
  } else if (service != sdo::kDownloadedSegment || !segmented_) {
    return fail(SdoAbort::kCommand);
  } else if ((content[0] & sdo::kToggle) != toggle_) {
    return fail(SdoAbort::kToggle);
  } else {
    toggle_ ^= sdo::kToggle;
  }
  if (done_ == size_) return Result::kDone;
  send_segment();
  return Result::kContinue;
}

SdoClient::Result SdoClient::receive_uploaded(std::span<const std::uint8_t> content) {
  if (content[0] & sdo::kExpedited) {
    size_ = done_ = content[0] & sdo::kSizeGiven ? 4 - (content[0] >> 2 & 3u) : 4u;
    if (done_ > data_.size()) return fail(SdoAbort::kMemory);
    std::copy_n(content.begin() + 4, done_, data_.begin());
    return Result::kDone;
  }
  size_ = load<std::uint32_t>(&content[4]);
  const auto part = content.subspan(8);
  if (size_ > data_.size()) return fail(SdoAbort::kMemory);
  done_ = std::min(part.size(), size_);
  std::copy_n(part.begin(), done_, data_.begin());
  if (done_ == size_) return Result::kDone;
  segmented_ = true;
  ask_segment();
  return Result::kContinue;
}

SdoClient::Result SdoClient::receive_segment(std::span<const std::uint8_t> content) {
  if ((content[0] & sdo::kServiceBits) != sdo::kUploadedSegment || content.size() < 8) return fail(SdoAbort::kCommand);
  if ((content[0] & sdo::kToggle) != toggle_) return fail(SdoAbort::kToggle);
  std::size_t part = content.size() - 1;
  if (part == 7) part -= content[0] >> 1 & 7;
  if (part > size_ - done_) return fail(SdoAbort::kTooLong);
  std::copy_n(content.begin() + 1, part, data_.begin() + static_cast<std::ptrdiff_t>(done_));
  done_ += part;
  if (content[0] & sdo::kLast) return done_ == size_ ? Result::kDone : fail(SdoAbort::kTooShort);
  if (part == 0) return fail(SdoAbort::kTooShort);
  toggle_ ^= sdo::kToggle;
  ask_segment();
  return Result::kContinue;
}

}  // namespace cotwin::ethercat
