#pragma once
#include <functional>
#include <string>

#include "fmu/import/foreign.h"

namespace cotwin::fmu {

struct CallPlace;

/// What the callbacks of one instance use; its address is the environment that the FMU is given. Some FMUs pass another pointer
/// to their callbacks (NULL, or a number). Therefore find() compares the pointer with those of all instances and never
/// dereferences it.
class CallbackData {
 public:
  /// `instance`: the name that the FMU was given. Created under set_call_place() of that instance.
  explicit CallbackData(std::string instance);
  ~CallbackData();
  CallbackData(const CallbackData&) = delete;
  CallbackData& operator=(const CallbackData&) = delete;

  /// Adds a message to the instance that find() finds. Drops it without one, or if memory is exhausted. Any thread may call it. The texts may be NULL.
  static void log(const void* environment, const char* instance, const char* level, const char* category,
                  const char* text) noexcept;
  /// The data whose address is `environment`; otherwise of the instance that this thread is calling; otherwise of the instance
  /// with this name, if `instance` is not NULL; otherwise of the only instance of this process. nullptr if there is none. Valid
  /// while the caller's instance exists.
  static CallbackData* find(const void* environment, const char* instance);

  Messages messages;
  std::function<void(double)> set_inputs;  // in intermediate updates (FMI 3)
  bool may_ask_for_return = false;
  bool update_failed = false;  // an intermediate update of the current step failed

 private:
  static CallbackData* find_locked(const void* environment, const char* instance);

  std::string instance_;
  const CallPlace* place_;
  CallbackData* next_ = nullptr;
};

}  // namespace cotwin::fmu
