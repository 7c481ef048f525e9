#include "components/gateway/access/offences.h"

#include <algorithm>
#include <utility>

namespace cotwin::gateway::access {

Offences::Verdict Offences::note(const std::string& who, Time now) {
  auto found = entries_.find(who);
  if (found == entries_.end()) {
    if (entries_.size() >= kMost && now - swept_ >= std::chrono::seconds(1)) {
      std::erase_if(entries_, [&](const auto& e) { return now - e.second.at >= kWindow; });
      swept_ = now;
    }
    found = entries_.try_emplace(entries_.size() >= kMost ? "" : who, Entry{.credit = told_, .at = now}).first;
  }
  Entry& entry = found->second;
  Time& oldest = entry.last[entry.count % kPrompt];
  Verdict verdict;
  verdict.late = entry.count >= kPrompt && now - oldest < kWindow;
  oldest = now;
  ++entry.count;
  entry.credit = std::min(told_, entry.credit + std::chrono::duration<double>(now - entry.at).count());
  entry.at = now;
  verdict.told = entry.credit >= 1;
  if (verdict.told) {
    entry.credit -= 1;
    verdict.since_told = std::exchange(entry.untold, 0);
  } else {
    ++entry.untold;
  }
  return verdict;
}

}  // namespace cotwin::gateway::access
