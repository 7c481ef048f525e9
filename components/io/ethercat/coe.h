#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

/// The mailbox and CANopen over EtherCAT (CoE): service data objects (SDO) in expedited, normal and segmented transfers
/// (ETG.1000.6, section 5.6). A mail is the content of a mailbox: header (6 bytes) and data.
namespace cotwin::ethercat {

enum class MailType : std::uint8_t { kError = 0, kAoE = 1, kEoE = 2, kCoE = 3, kFoE = 4, kSoE = 5, kVoE = 15 };

inline constexpr std::size_t kMailHeader = 6;               // bytes
inline constexpr std::size_t kCoeHeader = kMailHeader + 2;  // bytes of both headers
inline constexpr std::size_t kSdoHeader =
    kCoeHeader + 8;  // bytes of the headers and an initial SDO request without further data
inline constexpr std::size_t kShortestMailbox = kSdoHeader;  // bytes

struct MailHeader {
  std::uint16_t length = 0;  // bytes after the header
  std::uint16_t station = 0;
  std::uint8_t priority = 0;
  MailType type = MailType::kError;
  std::uint8_t counter = 0;  // 1 to 7, one further with each mail; 0: none
};

/// The header of a mail; none if the mail is shorter than its header says.
std::optional<MailHeader> read_mail_header(std::span<const std::uint8_t> mail);
void write_mail_header(std::span<std::uint8_t> mail, const MailHeader& header);

enum class CoeService : std::uint8_t { kEmergency = 1, kSdoRequest = 2, kSdoResponse = 3, kSdoInformation = 8 };

/// Codes of an SDO abort.
enum class SdoAbort : std::uint32_t {
  kNone = 0,
  kToggle = 0x05030000,
  kCommand = 0x05040001,
  kMemory = 0x05040005,
  kAccess = 0x06010000,
  kWriteOnly = 0x06010001,
  kReadOnly = 0x06010002,
  kSubindex0 = 0x06010003,  // cannot be written while subindex 0 is not 0
  kComplete = 0x06010004,
  kNoObject = 0x06020000,
  kNotMappable = 0x06040041,
  kPdoLength = 0x06040042,
  kLength = 0x06070010,
  kTooLong = 0x06070012,
  kTooShort = 0x06070013,
  kNoSubindex = 0x06090011,
  kRange = 0x06090030,
  kGeneral = 0x08000000,
  kState = 0x08000022,
};

/// The code in words.
std::string_view describe(SdoAbort code);

/// Command bytes of SDOs.
namespace sdo {
inline constexpr std::uint8_t kDownloadSegment = 0x00, kDownload = 0x20, kUpload = 0x40, kUploadSegment = 0x60,
                              kAbort = 0x80;  // requests
inline constexpr std::uint8_t kUploadedSegment = 0x00, kDownloadedSegment = 0x20, kUploaded = 0x40,
                              kDownloaded = 0x60;  // answers
inline constexpr std::uint8_t kServiceBits = 0xe0;
inline constexpr std::uint8_t kComplete = 0x10, kExpedited = 0x02, kSizeGiven = 0x01;  // of initial commands
inline constexpr std::uint8_t kToggle = 0x10, kLast = 0x01;                            // of segments
}  // namespace sdo

/// Writes the headers of a CoE mail with `size` bytes after the CoE header. Returns the mail.
std::span<std::uint8_t> write_coe(std::span<std::uint8_t> buffer, CoeService service, std::uint8_t counter, std::size_t size);
/// The service and content of a CoE mail; none if it is no CoE mail or its header does not fit it.
struct CoeMail {
  CoeService service;
  std::span<const std::uint8_t> content;  // after the CoE header
};
std::optional<CoeMail> read_coe(std::span<const std::uint8_t> mail);

/// Writes the content of an SDO request or answer: command, index, subindex and 4 bytes.
void write_sdo(std::span<std::uint8_t> content, std::uint8_t command, std::uint16_t index, std::uint8_t subindex,
               std::uint32_t value);

/// The master's side of one SDO transfer with one slave. Allocates in the constructor only.
///   client.upload(index, subindex); send client.request(); for each mail: while receive() is kContinue send client.request().
class SdoClient {
 public:
  enum class Result {
    kContinue,   // send request()
    kDone,       // upload: data() is the value
    kAborted,    // by the slave: abort_code(); or an answer that is not valid: abort_code() is what was wrong, send request()
    kUnrelated,  // the mail does not belong to the transfer (an emergency, another protocol); still waiting
  };

  /// `out`, `in`: sizes of the mailboxes in bytes, at least 16. `largest`: of a value, bytes.
  SdoClient(std::size_t out, std::size_t in, std::size_t largest = 4096);

  void upload(std::uint16_t index, std::uint8_t subindex, bool complete = false);
  /// Throws Error if `data` is longer than `largest`.
  void download(std::uint16_t index, std::uint8_t subindex, std::span<const std::uint8_t> data, bool complete = false);
  /// The mail to send.
  std::span<const std::uint8_t> request() const { return std::span(request_).first(request_size_); }
  Result receive(std::span<const std::uint8_t> mail);
  std::span<const std::uint8_t> data() const { return std::span(data_).first(done_); }
  SdoAbort abort_code() const { return abort_; }

 private:
  std::span<std::uint8_t> begin(std::size_t size);
  void send_segment();
  void ask_segment();
  Result fail(SdoAbort code);
  Result receive_uploaded(std::span<const std::uint8_t> content);
  Result receive_segment(std::span<const std::uint8_t> content);

  std::size_t out_;
  std::vector<std::uint8_t> request_, data_;
  std::size_t request_size_ = 0;
  std::size_t size_ = 0, done_ = 0;  // bytes of data_: whole, transferred
  std::uint16_t index_ = 0;
  std::uint8_t subindex_ = 0, counter_ = 0, toggle_ = 0;
  bool uploading_ = false, segmented_ = false;
  SdoAbort abort_ = SdoAbort::kNone;
};

}  // namespace cotwin::ethercat
