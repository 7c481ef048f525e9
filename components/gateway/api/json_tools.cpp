#include "components/gateway/api/json_tools.h"

#include <algorithm>
#include <mutex>

#include "components/services/json/control/control.h"
#include "components/services/json/json.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway {

http::Response give(const Json& value, int status) {
  return give_text(value.dump(-1, ' ', false, Json::error_handler_t::replace), status);
}

http::Response give_text(std::string text, int status) {
  http::Response response;
  response.status = status;
  response.body = std::move(text);
  if (response.body.empty() || response.body.back() != '\n') response.body += '\n';
  return response;
}

http::Refusal refusal(int status, std::string detail, std::string pointer) {
  return {{status, std::move(detail), std::move(pointer), ""}, {}};
}

Json object_of(const std::string& body) {
  // One long body at a time: many of them leave the processors to others.
  static std::mutex mutex;
  std::unique_lock lock(mutex, std::defer_lock);
  if (body.size() > http::kLongBody) lock.lock();
  try {
    return services::parse_object(body, services::kMostBodyValues);
  } catch (const services::RequestError& error) {
    throw refusal(400, error.detail(), error.pointer());
  }
}

void expect_answerable(services::Robots& robots, const Json& request) {
  try {
    services::check_object(robots, request);
  } catch (const services::RequestError& error) {
    throw refusal(422, error.detail(), error.pointer());
  } catch (const Error& error) {
    throw refusal(422, error.what());
  }
}

void must_settle(Json& request, const std::function<void(Json&, const std::string&)>& complete) {
  try {
    services::settle(request, complete);
  } catch (const services::RequestError& error) {
    throw refusal(422, error.detail(), error.pointer());
  }
  const std::vector<std::string> names = services::service_names();
  if (!services::is_chain(request) && std::find(names.begin(), names.end(), request["service"]) == names.end())
    throw refusal(422, "is no service, expected one of /work-masters", "/service");
}

void expect_members(const Json& object, std::initializer_list<std::string_view> names, const std::string& pointer) {
  for (const auto& [key, unused] : object.items()) {
    if (std::find(names.begin(), names.end(), key) != names.end()) continue;
    std::string list;
    for (const std::string_view name : names) text::append(list, name);
    throw refusal(422, "'" + key.substr(0, 40) + "' is not a member here, expected " + list, pointer);
  }
}

long long query_integer(const http::Request& request, std::string_view name, long long least, long long most, long long other) {
  const std::string* const value = request.query_value(name);
  if (value == nullptr) return other;
  const std::optional<long long> number = text::parse_integer(*value);
  if (!number || *number < least || *number > most)
    throw refusal(400, "?" + std::string(name) + "=" + value->substr(0, 40) + ", expected " + std::to_string(least) + " to " +
                           std::to_string(most));
  return *number;
}

std::string query_text(const http::Request& request, std::string_view name) {
  const std::string* const value = request.query_value(name);
  return value == nullptr ? std::string() : *value;
}

double wait_of(const http::Request& request) {
  if (const std::string* const value = request.query_value("wait")) {
    const std::optional<double> seconds = text::parse_real(*value);
    if (!seconds || !(*seconds >= 0)) throw refusal(400, "?wait=" + value->substr(0, 40) + ", expected seconds");
    return std::min(*seconds, kLongestWait);
  }
  const std::string* const prefer = request.field("Prefer");
  if (prefer == nullptr) return 0;
  const double seconds = text::parse_real(http::preference(*prefer, "wait").value_or("0")).value_or(0);
  return seconds > 0 ? std::min(seconds, kLongestWait) : 0;  // a preference that cannot be read is ignored (RFC 7240)
}

}  // namespace cotwin::gateway
