#include "components/gateway/jobs/job.h"

#include <array>

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

}  // namespace

std::string_view to_text(JobState state) { return name_in(kStates, state); }
std::string_view to_text(JobResult result) { return name_in(kResults, result); }
std::string_view to_text(JobVerb verb) { return name_in(kVerbs, verb); }
std::optional<JobState> state_of(std::string_view name) { return value_in(kStates, name); }
std::optional<JobVerb> verb_of(std::string_view name) { return value_in(kVerbs, name); }

}  // namespace cotwin::gateway
