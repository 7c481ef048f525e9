#include "components/io/emulators/ethercat/coe_server.h"

#include <algorithm>
#include <tuple>

#include "components/io/ethercat/little_endian.h"
#include "models/foundation/support/error.h"

namespace cotwin::ethercat {

namespace {

// Codes of a mailbox error reply.
constexpr std::uint16_t kUnsupportedProtocol = 2, kUnsupportedService = 4, kInvalidHeader = 5, kTooShortMail = 6;

// Operations of the SDO information service.
constexpr std::uint8_t kGetList = 1, kList = 2, kGetObject = 3, kObject = 4, kGetEntry = 5, kEntry = 6, kInformationError = 7;
constexpr std::uint8_t kMoreFollow = 0x80;
constexpr std::size_t kInformationHeader = 4;  // bytes

constexpr std::uint8_t kVariable = 7, kRecord = 9;               // object codes
constexpr std::uint16_t kReadAlways = 0x07, kWritePreOp = 0x08;  // access rights of entries

bool before(const ObjectEntry& a, const ObjectEntry& b) {
  return std::tie(a.index, a.subindex) < std::tie(b.index, b.subindex);
}

}  // namespace

void ObjectDictionary::insert(ObjectEntry e, std::span<const std::uint8_t> value) {
  e.value = values_.size();
  values_.insert(values_.end(), value.begin(), value.end());
  initial_ = values_;
  const auto at = std::lower_bound(entries_.begin(), entries_.end(), e, before);
  if (at != entries_.end() && at->index == e.index && at->subindex == e.subindex) {
    throw Error("object dictionary", "entry " + std::to_string(e.index) + ":" + std::to_string(e.subindex) + " is there twice");
  }
  entries_.insert(at, std::move(e));
}

void ObjectDictionary::add(std::uint16_t index, std::uint8_t subindex, const std::string& name, std::uint16_t type,
                           std::uint16_t bits, std::uint64_t value, bool writable) {
  if (bits == 0 || bits > 64) throw Error("object dictionary", std::to_string(bits) + " bits, expected 1 to 64");
  std::uint8_t bytes[8];
  store(bytes, value);
  const ObjectEntry e{index, subindex, writable, type, bits, 0, name};
  insert(e, std::span(bytes, e.bytes()));
}

void ObjectDictionary::add_text(std::uint16_t index, std::uint8_t subindex, const std::string& name, const std::string& value,
                                bool writable) {
  insert({index, subindex, writable, object_type::kText, static_cast<std::uint16_t>(8 * value.size()), 0, name},
         std::span(reinterpret_cast<const std::uint8_t*>(value.data()), value.size()));
}

bool ObjectDictionary::has(std::uint16_t index) const {
  const auto at = std::lower_bound(entries_.begin(), entries_.end(), index,
                                   [](const ObjectEntry& e, std::uint16_t i) { return e.index < i; });
  return at != entries_.end() && at->index == index;
}

const ObjectEntry* ObjectDictionary::find(std::uint16_t index, std::uint8_t subindex) const {
  const auto at = std::lower_bound(entries_.begin(), entries_.end(), std::pair(index, subindex),
                                   [](const ObjectEntry& e, const auto& key) { return std::pair(e.index, e.subindex) < key; });
  return at != entries_.end() && at->index == index && at->subindex == subindex ? &*at : nullptr;
}

std::uint64_t ObjectDictionary::number(std::uint16_t index, std::uint8_t subindex) const {
  const ObjectEntry* const e = find(index, subindex);
  std::uint64_t value = 0;
  if (e && e->bytes() <= 8) std::memcpy(&value, bytes(*e).data(), e->bytes());
  return value;
}

void ObjectDictionary::set_number(std::uint16_t index, std::uint8_t subindex, std::uint64_t value) {
  const ObjectEntry* const e = find(index, subindex);
  if (e && e->bytes() <= 8) std::memcpy(bytes(*e).data(), &value, e->bytes());
}

CoeServer::CoeServer(ObjectDictionary& objects, ObjectOwner& owner, std::size_t out, std::size_t in, std::size_t largest)
    : objects_(objects), owner_(owner), in_(in), reply_(std::max(in, kShortestMailbox)), data_(largest) {
  if (out < kShortestMailbox || in < kShortestMailbox) {
    throw Error("mailbox", std::to_string(out) + " and " + std::to_string(in) + " bytes, expected at least 16");
  }
  content_ = std::span(reply_).subspan(kCoeHeader);
}

void CoeServer::reset() {
  transfer_ = Transfer::kNone;
  listed_ = to_list_ = 0;
  heard_ = 0;
}

/// A mail with the first `size` bytes of content_.
std::span<const std::uint8_t> CoeServer::send(CoeService service, std::size_t size) {
  counter_ = static_cast<std::uint8_t>(counter_ % 7 + 1);
  return write_coe(reply_, service, counter_, size);
}

std::span<const std::uint8_t> CoeServer::mail_error(std::uint16_t detail) {
  counter_ = static_cast<std::uint8_t>(counter_ % 7 + 1);
  write_mail_header(reply_, {.length = 4, .type = MailType::kError, .counter = counter_});
  store(&reply_[kMailHeader], std::uint16_t{1});
  store(&reply_[kMailHeader + 2], detail);
  return std::span<const std::uint8_t>(reply_).first(kMailHeader + 4);
}

std::span<const std::uint8_t> CoeServer::abort(std::uint16_t index, std::uint8_t subindex, SdoAbort code) {
  transfer_ = Transfer::kNone;
  write_sdo(content_, sdo::kAbort, index, subindex, static_cast<std::uint32_t>(code));
  return send(CoeService::kSdoRequest, 8);
}

std::span<const std::uint8_t> CoeServer::answer(std::span<const std::uint8_t> mail) {
  const auto header = read_mail_header(mail);
  if (header && header->counter != 0 && header->counter == heard_) return {};
  listed_ = to_list_ = 0;
  if (!header) return mail_error(kInvalidHeader);
  heard_ = header->counter;
  if (header->type != MailType::kCoE) return mail_error(kUnsupportedProtocol);
  const auto coe = read_coe(mail);
  if (!coe || coe->content.size() < (coe->service == CoeService::kSdoInformation ? kInformationHeader : 8)) {
    return mail_error(kTooShortMail);
  }
  if (coe->service == CoeService::kSdoInformation) return information(coe->content);
  if (coe->service != CoeService::kSdoRequest) return mail_error(kUnsupportedService);
  switch (coe->content[0] & sdo::kServiceBits) {
    case sdo::kDownload:
      return download(coe->content);
    case sdo::kDownloadSegment:
      return download_segment(coe->content);
    case sdo::kUpload:
      return upload(coe->content);
    case sdo::kUploadSegment:
      return upload_segment(coe->content);
    case sdo::kAbort:
      transfer_ = Transfer::kNone;
      return {};
    default:
      return abort(load<std::uint16_t>(&coe->content[1]), coe->content[3], SdoAbort::kCommand);
  }
}

SdoAbort CoeServer::access(std::uint16_t index, std::uint8_t subindex, std::uint8_t command, const ObjectEntry*& entry) const {
  if (!objects_.has(index)) return SdoAbort::kNoObject;
  if (command & sdo::kComplete) return SdoAbort::kComplete;
  entry = objects_.find(index, subindex);
  return entry ? SdoAbort::kNone : SdoAbort::kNoSubindex;
}

std::span<const std::uint8_t> CoeServer::upload(Content request) {
  index_ = load<std::uint16_t>(&request[1]);
  subindex_ = request[3];
  const ObjectEntry* entry = nullptr;
  if (const SdoAbort code = access(index_, subindex_, request[0], entry); code != SdoAbort::kNone)
    return abort(index_, subindex_, code);
  owner_.refresh(*entry);
  const std::span<const std::uint8_t> value = objects_.bytes(*entry);
  transfer_ = Transfer::kNone;
  if (!value.empty() && value.size() <= 4) {
    write_sdo(content_, static_cast<std::uint8_t>(sdo::kUploaded | sdo::kExpedited | sdo::kSizeGiven | (4 - value.size()) << 2),
              index_, subindex_, 0);
    std::copy(value.begin(), value.end(), content_.begin() + 4);
    return send(CoeService::kSdoResponse, 8);
  }
  if (value.size() > data_.size()) return abort(index_, subindex_, SdoAbort::kMemory);
  std::copy(value.begin(), value.end(), data_.begin());
  size_ = value.size();
  done_ = std::min(size_, in_ - kSdoHeader);
  toggle_ = 0;
  if (done_ < size_) transfer_ = Transfer::kUpload;
  write_sdo(content_, sdo::kUploaded | sdo::kSizeGiven, index_, subindex_, static_cast<std::uint32_t>(size_));
  std::copy_n(data_.begin(), done_, content_.begin() + 8);
  return send(CoeService::kSdoResponse, 8 + done_);
}

std::span<const std::uint8_t> CoeServer::upload_segment(Content request) {
  if (transfer_ != Transfer::kUpload) return abort(index_, subindex_, SdoAbort::kCommand);
  if ((request[0] & sdo::kToggle) != toggle_) return abort(index_, subindex_, SdoAbort::kToggle);
  const std::size_t part = std::min(size_ - done_, in_ - kCoeHeader - 1), sent = std::max<std::size_t>(part, 7);
  const bool last = done_ + part == size_;
  std::fill_n(content_.begin(), 1 + sent, std::uint8_t{0});
  content_[0] =
      static_cast<std::uint8_t>(sdo::kUploadedSegment | toggle_ | (part < 7 ? (7 - part) << 1 : 0) | (last ? sdo::kLast : 0));
  std::copy_n(data_.begin() + static_cast<std::ptrdiff_t>(done_), part, content_.begin() + 1);
  done_ += part;
  toggle_ ^= sdo::kToggle;
  if (last) transfer_ = Transfer::kNone;
  return send(CoeService::kSdoResponse, 1 + sent);
}

std::span<const std::uint8_t> CoeServer::download(Content request) {
  index_ = load<std::uint16_t>(&request[1]);
  subindex_ = request[3];
  const ObjectEntry* entry = nullptr;
  if (const SdoAbort code = access(index_, subindex_, request[0], entry); code != SdoAbort::kNone)
    return abort(index_, subindex_, code);
  if (!entry->writable) return abort(index_, subindex_, SdoAbort::kReadOnly);
  Content part;
  if (request[0] & sdo::kExpedited) {
    size_ = request[0] & sdo::kSizeGiven ? 4 - (request[0] >> 2 & 3u) : std::min<std::size_t>(entry->bytes(), 4);
    part = request.subspan(4, size_);
  } else {
    size_ = load<std::uint32_t>(&request[4]);
    part = request.subspan(8);
    part = part.first(std::min(part.size(), size_));
  }
  if (size_ > entry->bytes() || size_ > data_.size()) return abort(index_, subindex_, SdoAbort::kTooLong);
  if (size_ < entry->bytes()) return abort(index_, subindex_, SdoAbort::kTooShort);
  std::copy(part.begin(), part.end(), data_.begin());
  done_ = part.size();
  toggle_ = 0;
  if (done_ == size_) return finish_download();
  transfer_ = Transfer::kDownload;
  write_sdo(content_, sdo::kDownloaded, index_, subindex_, 0);
  return send(CoeService::kSdoResponse, 8);
}

std::span<const std::uint8_t> CoeServer::download_segment(Content request) {
  if (transfer_ != Transfer::kDownload) return abort(index_, subindex_, SdoAbort::kCommand);
  if ((request[0] & sdo::kToggle) != toggle_) return abort(index_, subindex_, SdoAbort::kToggle);
  std::size_t part = request.size() - 1;
  if (part == 7) part -= request[0] >> 1 & 7;
  if (part > size_ - done_) return abort(index_, subindex_, SdoAbort::kTooLong);
  std::copy_n(request.begin() + 1, part, data_.begin() + static_cast<std::ptrdiff_t>(done_));
  done_ += part;
  if (request[0] & sdo::kLast) {
    if (done_ != size_) return abort(index_, subindex_, SdoAbort::kTooShort);
    const ObjectEntry* const entry = objects_.find(index_, subindex_);
    const auto value = std::span<const std::uint8_t>(data_).first(size_);
    if (const SdoAbort code = owner_.check(*entry, value); code != SdoAbort::kNone) return abort(index_, subindex_, code);
    std::copy(value.begin(), value.end(), objects_.bytes(*entry).begin());
    transfer_ = Transfer::kNone;
  }
  std::fill_n(content_.begin(), 8, std::uint8_t{0});
  content_[0] = static_cast<std::uint8_t>(sdo::kDownloadedSegment | toggle_);
  toggle_ ^= sdo::kToggle;
  return send(CoeService::kSdoResponse, 8);
}

std::span<const std::uint8_t> CoeServer::finish_download() {
  transfer_ = Transfer::kNone;
  const ObjectEntry* const entry = objects_.find(index_, subindex_);
  const auto value = std::span<const std::uint8_t>(data_).first(size_);
  if (const SdoAbort code = owner_.check(*entry, value); code != SdoAbort::kNone) return abort(index_, subindex_, code);
  std::copy(value.begin(), value.end(), objects_.bytes(*entry).begin());
  write_sdo(content_, sdo::kDownloaded, index_, subindex_, 0);
  return send(CoeService::kSdoResponse, 8);
}

std::span<const std::uint8_t> CoeServer::information_error(SdoAbort code) {
  content_[0] = kInformationError;
  content_[1] = content_[2] = content_[3] = 0;
  store(&content_[4], static_cast<std::uint32_t>(code));
  return send(CoeService::kSdoInformation, 8);
}

std::span<const std::uint8_t> CoeServer::information(Content request) {
  const std::uint8_t operation = request[0] & 0x7f;
  const std::size_t needed = operation == kGetEntry ? 4 : 2;
  if (request.size() < kInformationHeader + needed) return information_error(SdoAbort::kCommand);
  const auto index = load<std::uint16_t>(&request[4]);
  std::fill_n(content_.begin(), 8, std::uint8_t{0});
  if (operation == kGetList) return object_list(index);
  if (operation != kGetObject && operation != kGetEntry) return information_error(SdoAbort::kCommand);
  if (!objects_.has(index)) return information_error(SdoAbort::kNoObject);
  const ObjectEntry* const entry = objects_.find(index, operation == kGetEntry ? request[6] : 0);
  if (!entry) return information_error(SdoAbort::kNoSubindex);
  const std::size_t fixed = operation == kGetEntry ? 14 : 10;
  if (content_.size() < fixed) return information_error(SdoAbort::kMemory);
  store(&content_[4], index);
  if (operation == kGetEntry) {
    content_[0] = kEntry;
    content_[6] = entry->subindex;
    content_[7] = 0;  // no value information
    store(&content_[8], entry->type);
    store(&content_[10], entry->bits);
    store(&content_[12], static_cast<std::uint16_t>(entry->writable ? kReadAlways | kWritePreOp : kReadAlways));
  } else {
    const auto entries = objects_.entries();
    const auto last = std::find_if(entries.rbegin(), entries.rend(), [&](const ObjectEntry& e) { return e.index == index; });
    content_[0] = kObject;
    store(&content_[6], entry->type);
    content_[8] = last->subindex;
    content_[9] = last->subindex == 0 ? kVariable : kRecord;
  }
  const std::size_t size = std::min(entry->name.size(), content_.size() - fixed);
  std::copy_n(entry->name.begin(), size, content_.begin() + static_cast<std::ptrdiff_t>(fixed));
  return send(CoeService::kSdoInformation, fixed + size);
}

/// List 0: the numbers of objects in lists 1 to 5; list 1: all objects. The others are empty.
std::span<const std::uint8_t> CoeServer::object_list(std::uint16_t list) {
  if (list > 5) return information_error(SdoAbort::kRange);
  std::size_t count = 0;
  const auto entries = objects_.entries();
  for (std::size_t i = 0; i < entries.size(); ++i) count += i == 0 || entries[i].index != entries[i - 1].index;
  content_[0] = kList;
  store(&content_[4], list);
  if (list == 0) {
    if (content_.size() < 16) return information_error(SdoAbort::kMemory);
    std::fill_n(content_.begin() + 6, 10, std::uint8_t{0});
    store(&content_[6], static_cast<std::uint16_t>(count));
    return send(CoeService::kSdoInformation, 16);
  }
  listed_ = 0;
  to_list_ = list == 1 ? count : 0;
  if (to_list_ == 0) return send(CoeService::kSdoInformation, 6);
  return next_part();
}

std::span<const std::uint8_t> CoeServer::next_part() {
  if (listed_ >= to_list_) return {};
  const bool first = listed_ == 0;
  const std::size_t head = kInformationHeader + (first ? 2 : 0);
  const std::size_t here = std::min(to_list_ - listed_, (content_.size() - head) / 2);
  const std::size_t rest = to_list_ - listed_ - here, per_mail = (content_.size() - kInformationHeader) / 2;
  content_[0] = static_cast<std::uint8_t>(kList | (rest != 0 ? kMoreFollow : 0));
  content_[1] = 0;
  store(&content_[2], static_cast<std::uint16_t>((rest + per_mail - 1) / per_mail));
  if (first) store(&content_[4], std::uint16_t{1});
  std::size_t number = 0, written = 0;
  const auto entries = objects_.entries();
  for (std::size_t i = 0; i < entries.size() && written < here; ++i) {
    if (i != 0 && entries[i].index == entries[i - 1].index) continue;
    if (number++ < listed_) continue;
    store(&content_[head + 2 * written++], entries[i].index);
  }
  listed_ += here;
  return send(CoeService::kSdoInformation, head + 2 * here);
}

}  // namespace cotwin::ethercat
