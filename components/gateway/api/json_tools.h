#pragma once
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "components/gateway/http/router.h"
#include "components/services/robots.h"

/// JSON and header fields of routes, for the sources of this folder.
namespace cotwin::gateway {

using Json = nlohmann::ordered_json;

http::Response give(const Json& value, int status = 200);
/// A response from JSON text that is there already.
http::Response give_text(std::string text, int status = 200);
http::Refusal refusal(int status, std::string detail, std::string pointer = "");

/// The object of a request's body: at most 32 levels, no member twice, only finite numbers. Throws Refusal 400.
Json object_of(const std::string& body);
/// Throws Refusal 422 for a request to a service that these robots can never answer, see services::check_object().
void expect_answerable(services::Robots& robots, const Json& request);
/// services::settle(). Throws Refusal 422, also for a service that is not there.
void must_settle(Json& request, const std::function<void(Json&, const std::string& pointer)>& complete = {});
/// Throws Refusal 422 for the first member that is not in `names`.
void expect_members(const Json& object, std::initializer_list<std::string_view> names, const std::string& pointer = "");

/// An integer in the query within [least, most]; `other` if it is not given. Throws Refusal 400.
long long query_integer(const http::Request& request, std::string_view name, long long least, long long most, long long other);
/// A text in the query; "" if it is not given.
std::string query_text(const http::Request& request, std::string_view name);
/// The seconds of `Prefer: wait=…` or of ?wait=…, 0 to kLongestWait; 0 if there is none. Throws Refusal 400 for another value in the query.
double wait_of(const http::Request& request);
inline constexpr double kLongestWait = 30;  // s

}  // namespace cotwin::gateway
