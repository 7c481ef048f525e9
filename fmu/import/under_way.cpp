#include "fmu/import/under_way.h"

#include <cxxabi.h>

#include <cstring>
#include <exception>
#include <string>

#include "fmu/import/watched_calls.h"
#include "models/foundation/support/error.h"

namespace cotwin::fmu {

constinit thread_local UnderWay own_call;
constinit thread_local UnderWay* watched_call = nullptr;
constinit WatchedCalls* watched_calls = nullptr;

void mirror_function(const char* function) noexcept {
  std::strncpy(under_way().mirror, function != nullptr ? function : "", UnderWay::kMirrorBytes - 1);
}

void begin_watched_call() noexcept { watched_call = watched_calls->call_of_this_thread(); }

const char* known_function(const char* function) noexcept {
  if (watched_calls != nullptr) watched_calls->add(function);
  return function;
}

void rethrow_from(const char* function) {
  try {
    throw;
  } catch (const abi::__forced_unwind&) {  // pthread_exit ends the thread
    throw;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    throw Error(std::string(function) + " threw an exception (" + error.what() + "), expected a status");
  } catch (...) {
    throw Error(std::string(function) + " threw an exception, expected a status");
  }
}

}  // namespace cotwin::fmu
