#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "components/gateway/access/utc.h"

/// The data of job control. States, numbers and verbs are those of OPC 10031-4 V2.00 (ISA-95 Job Control), the result those of
/// OPC 40001-3.
namespace cotwin::gateway {

/// StateNumber. A failed job is kEnded or kAborted with JobResult::kUnsuccessful, and so is one whose light is worse than its request
/// requires, which has a result; a queued job is kAllowedToStart.
enum class JobState : std::int32_t {
  kNotAllowedToStart = 1,
  kAllowedToStart = 2,
  kRunning = 3,
  kInterrupted = 4,
  kEnded = 5,
  kAborted = 6
};
enum class JobResult : std::int32_t { kUnknown = 0, kSuccessful = 1, kUnsuccessful = 2 };
enum class JobVerb : std::uint8_t { kStart, kRevokeStart, kPause, kResume, kStop, kAbort, kCancel, kClear };

/// ReturnStatus (Annex B.2, Table 95): a set of bits. Bits 33 to 63 are ours.
using ReturnStatus = std::uint64_t;
inline constexpr ReturnStatus kNoError = 1;                        ///< bit 0
inline constexpr ReturnStatus kUnknownJobOrder = 1ull << 1;        ///< no job order has this identifier
inline constexpr ReturnStatus kInvalidJobOrderStatus = 1ull << 3;  ///< the verb is not allowed in the job's state
inline constexpr ReturnStatus kUnableToAccept = 1ull << 4;         ///< a limit is reached or the disk is full: try later
inline constexpr ReturnStatus kInvalidRequest = 1ull << 32;        ///< malformed request or order
inline constexpr ReturnStatus kKeyOfAnotherRequest = 1ull << 33;   ///< the idempotency key came with another payload
inline constexpr ReturnStatus kVersionChanged = 1ull << 34;        ///< the job has another version than the given one

/// "NotAllowedToStart", …, "Aborted"; "Unknown", "Successful", "Unsuccessful"; "Start", "RevokeStart", …
std::string_view to_text(JobState state);
std::string_view to_text(JobResult result);
std::string_view to_text(JobVerb verb);
std::optional<JobState> state_of(std::string_view name);
std::optional<JobVerb> verb_of(std::string_view name);
/// Ended or Aborted: the state does not change any more.
constexpr bool is_done(JobState state) { return state == JobState::kEnded || state == JobState::kAborted; }

struct LocalizedText {
  std::string locale, text;
  bool operator==(const LocalizedText&) const = default;
};

/// What a client orders.
struct JobOrder {
  std::string id;  ///< JobOrderID, 1 to 200 printable ASCII characters without '/'; "": a new one is made
  std::string request;  ///< JSON object for a worker: {"service": "…", "robot": "…", …}, or a chain of them: {"steps": […], …}
  std::string asked;  ///< the request as the client sent it, for idempotency keys, if something was filled in since; else ""
  std::vector<LocalizedText> description;  ///< shown to people
  std::int16_t priority = 0;               ///< higher is more urgent
  std::optional<UtcTime> start_time;       ///< proposed start: the job does not run before it
  std::optional<UtcTime> end_time;         ///< proposed end: recorded only
  std::optional<UtcTime> deadline;         ///< the job is aborted if it is not done by then
  double time_limit_s = 0;                 ///< of running, s, wall time without pauses; 0: JobsOptions::time_limit_s
  bool reuse = true;                       ///< an earlier result of the same request, robot and build is taken
};

struct StoreOptions {
  bool start = true;            ///< StoreAndStart, else Store
  std::string idempotency_key;  ///< "": none; at most 255 characters
  std::string owner;            ///< namespace of the key, for example a hash of the client's token
  std::vector<LocalizedText> comment;
};

/// Reply to a verb.
struct JobReply {
  ReturnStatus status = kNoError;
  std::string id;         ///< of the job order
  std::string message;    ///< why not, "" for kNoError
  bool repeated = false;  ///< the idempotency key was used before with the same payload: nothing was stored again
  bool ok() const { return status == kNoError; }
};

/// A job as it is now.
struct Job {
  JobOrder order;             ///< order.request is the canonical JSON
  std::int64_t sequence = 0;  ///< order of arrival, from 1, never used again
  std::int64_t version = 0;   ///< number of the latest change of its state or order; grows over all jobs (ETag, event number)
  JobState state = JobState::kNotAllowedToStart;
  JobResult result = JobResult::kUnknown;
  std::string service, robot;
  std::string request_hash;            ///< SHA-256 of the canonical request, hexadecimal
  std::string reason;                  ///< ReasonForStateChange of the latest change, for people
  std::vector<LocalizedText> comment;  ///< of the latest verb
  double progress = 0;                 ///< 0 to 1
  std::string progress_message;
  int retries = 0;   ///< workers that this job lost
  int restarts = 0;  ///< ends of the gateway without close() while this job ran
  UtcTime stored;
  std::optional<UtcTime> started, ended;      ///< first start, end
  double busy_s = 0;                          ///< of the worker that answered, s, wall time (ActualUnitBusyTime)
  std::optional<double> remaining_s;          ///< while running, from the progress (EstimatedRemainingTime)
  std::optional<std::int64_t> result_number;  ///< of its reply in the results
  std::string problem;                        ///< JSON {"title", "detail", "pointer"} if a worker refused the request, else ""
  bool read = false;                          ///< response() was called after its end
  std::string light;                          ///< of its reply's verdict: "green", "amber", "red"; "": there is none
};

struct JobFilter {
  std::vector<JobState> states;  ///< empty: all
  std::string service, robot;    ///< "": all
  std::optional<UtcTime> stored_from, stored_before;
  bool newest_first = false;
};

struct JobPage {
  std::vector<Job> jobs;
  std::string next;  ///< cursor of the next page, "": this is the last one
};

/// A reply that is kept.
struct Result {
  std::int64_t number = 0;  ///< from 1, never used again
  std::string job_id;
  std::string service, robot;
  std::string request_hash;  ///< SHA-256 of the canonical request, hexadecimal
  std::string robot_hash;  ///< of the robot's files, as JobsOptions::robot_hash gave it; "": unknown, the result is not reused
  std::string producer;    ///< JobsOptions::producer at that time
  UtcTime stored;
  double busy_s = 0;        ///< s, of the worker that computed it
  bool reused = false;      ///< taken from an earlier job
  std::string request;      ///< canonical JSON
  std::string reply;        ///< JSON, byte for byte as the worker wrote it; "" unless the filter has with_reply
  std::uint64_t bytes = 0;  ///< size of the reply
};

struct ResultFilter {
  std::string job_id, request_hash, service, robot, robot_hash;  ///< "": all
  std::string request;                                           ///< JSON: results of an equal request; "": all
  std::optional<UtcTime> stored_from, stored_before;
  bool newest_first = true;
  bool with_reply = false;
};

struct ResultPage {
  std::vector<Result> results;
  std::string next;  ///< cursor of the next page, "": this is the last one
};

/// A change, for subscribers.
struct JobChange {
  enum class Kind : std::uint8_t { kState, kOrder, kProgress, kRemoved };
  Kind kind = Kind::kState;
  Job job;            ///< after the change; without the request
  bool lost = false;  ///< changes before this one were dropped, because the callback was too slow: list the jobs again
};

}  // namespace cotwin::gateway
