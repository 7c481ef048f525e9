#include "fmu/import/watched_calls.h"

#include <sys/mman.h>

#include <algorithm>
#include <cstring>
#include <new>

#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

void copy_name(std::array<char, 96>& to, const char* from) { std::strncpy(to.data(), from, to.size() - 1); }

}  // namespace

WatchedCalls* WatchedCalls::make() noexcept {
  void* memory = mmap(nullptr, sizeof(WatchedCalls), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  return memory == MAP_FAILED ? nullptr : new (memory) WatchedCalls;
}

void WatchedCalls::begin() noexcept {
  watched_calls = this;
  begin_watched_call();
}

void WatchedCalls::add(const CallPlace& place) noexcept {
  // Studies create units again and again at the same address with the same names.
  const std::uint32_t known = std::min<std::uint32_t>(places_, kPlaces);
  for (std::uint32_t i = known; i-- > 0;) {
    if (names_[i].place != &place) continue;
    copy_name(names_[i].fmu, place.fmu);
    copy_name(names_[i].instance, place.instance);
    return;
  }
  const std::uint32_t i = places_.fetch_add(1);
  if (i >= kPlaces) return;
  copy_name(names_[i].fmu, place.fmu);
  copy_name(names_[i].instance, place.instance);
  names_[i].place = &place;
}

void WatchedCalls::add(const char* function) noexcept {
  if (name_of(function) != nullptr) return;
  const std::uint32_t i = functions_.fetch_add(1);
  if (i >= kFunctions) return;
  copy_name(function_names_[i].name, function);
  function_names_[i].function = function;
}

UnderWay* WatchedCalls::call_of_this_thread() noexcept {
  struct Releaser {
    std::atomic<bool>* taken = nullptr;
    ~Releaser() {
      watched_call = nullptr;
      if (taken != nullptr) *taken = false;
    }
  };
  thread_local Releaser releaser;
  for (std::size_t i = 0; i < kThreads; ++i) {
    if (taken_[i].exchange(true)) continue;
    releaser.taken = &taken_[i];
    calls_[i] = {};
    return &calls_[i];
  }
  return &own_call;
}

const WatchedCalls::Place* WatchedCalls::names_of(const CallPlace* place) const {
  const auto found = std::ranges::find_if(names_, [&](const Place& one) { return one.place == place; });
  return found != names_.end() ? &*found : nullptr;
}

const WatchedCalls::FunctionName* WatchedCalls::name_of(const char* function) const {
  if (function == nullptr) return nullptr;
  const auto found = std::ranges::find_if(function_names_, [&](const FunctionName& one) { return one.function == function; });
  return found != function_names_.end() ? &*found : nullptr;
}

std::string WatchedCalls::describe(const UnderWay& call) const {
  const Place* const names = names_of(call.place);
  if (call.place == nullptr || names == nullptr) return "";
  const FunctionName* const known = name_of(call.function);
  // The process may have damaged the memory that it shares, also the ends of the names.
  const auto shown = [](const auto& name) { return std::string(name.data(), ::strnlen(name.data(), name.size())); };
  const std::string function = known != nullptr ? ": " + shown(known->name) : "";
  return "component '" + shown(names->instance) + "' at t = " + text::to_text(static_cast<double>(call.ns) / 1e9) +
         " s: " + shown(names->fmu) + function;
}

std::string WatchedCalls::last_calls() const {
  constexpr std::size_t kMost = 3;
  std::string all;
  std::size_t shown = 0;
  for (const UnderWay& call : calls_) {
    if (call.function == nullptr || shown == kMost) continue;
    all += (all.empty() ? "" : ", ") + describe(call);
    ++shown;
  }
  if (!all.empty()) return all;
  const std::string last = describe(calls_.front());
  return last.empty() ? "" : "after a call of " + last;
}

}  // namespace cotwin::fmu
