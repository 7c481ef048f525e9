#include "fmu/import/callbacks.h"

#include <cstdint>
#include <mutex>
#include <utility>

#include "fmu/import/under_way.h"

namespace cotwin::fmu {

namespace {

// All instances, the newest first. Callbacks have no other argument that can be trusted.
constinit std::mutex newest_mutex;
constinit CallbackData* newest = nullptr;

/// Replaces NULL and small numbers, which no text can have as its address.
const char* text_at(const char* text) {
  constexpr std::uintptr_t kFirstPage = 4096;
  return reinterpret_cast<std::uintptr_t>(text) < kFirstPage ? "" : text;
}

}  // namespace

CallbackData::CallbackData(std::string instance) : instance_(std::move(instance)), place_(under_way().place) {
  const std::lock_guard lock(newest_mutex);
  next_ = std::exchange(newest, this);
}

CallbackData::~CallbackData() {
  const std::lock_guard lock(newest_mutex);
  CallbackData** link = &newest;
  while (*link != this) link = &(*link)->next_;
  *link = next_;
}

CallbackData* CallbackData::find_locked(const void* environment, const char* instance) {
  const auto first = [](auto wanted) {
    CallbackData* one = newest;
    while (one != nullptr && !wanted(*one)) one = one->next_;
    return one;
  };
  CallbackData* found = first([&](const CallbackData& one) { return &one == environment; });
  if (found == nullptr && under_way().function != nullptr && under_way().place != nullptr)
    found = first([](const CallbackData& one) { return one.place_ == under_way().place; });
  if (found == nullptr) found = first([name = text_at(instance)](const CallbackData& one) { return one.instance_ == name; });
  if (found == nullptr && newest != nullptr && newest->next_ == nullptr) found = newest;
  return found;
}

CallbackData* CallbackData::find(const void* environment, const char* instance) {
  const std::lock_guard lock(newest_mutex);
  return find_locked(environment, instance);
}

void CallbackData::log(const void* environment, const char* instance, const char* level, const char* category,
                       const char* text) noexcept {
  try {
    const std::lock_guard lock(newest_mutex);  // the instance must not be destroyed meanwhile
    if (CallbackData* const data = find_locked(environment, instance))
      data->messages.add(level, text_at(category), text_at(text));
  } catch (...) {  // out of memory: the message is dropped and the FMU continues
  }
}

}  // namespace cotwin::fmu
