#include "components/gateway/http/router.h"

#include <algorithm>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::http {

namespace {

bool is_name(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
  });
}

}  // namespace

Answer problem_answer(int status, std::string description) {
  return {status, "Problem", std::move(description), "application/problem+json", {}};
}

void Router::add(Route route, Handler handler) {
  add_later(std::move(route),
            [handler = std::move(handler)](const Request& request, const Reply& reply) { reply(handler(request)); });
}

void Router::add_later(Route route, LaterHandler handler) {
  const std::string place = "route " + route.method + " " + route.pattern;
  Entry entry;
  if (route.pattern.empty() || route.pattern.front() != '/') throw Error(place, "the pattern does not begin with a slash");
  if (route.pattern.size() > 1) {
    for (const std::string_view part : text::split(std::string_view(route.pattern).substr(1), '/')) {
      const bool open = part.size() > 2 && part.front() == '{' && part.back() == '}';
      const std::string_view name = open ? part.substr(1, part.size() - 2) : part;
      if (!is_name(name) || name == "." || name == "..")
        throw Error(place, "'" + std::string(part) + "' is not allowed, expected a name or {name}");
      if (open) entry.names.emplace_back(name);
      entry.segments.emplace_back(open ? std::string_view("{") : part);
    }
  }
  for (const Entry& other : entries_) {
    if (other.route.method == route.method && other.segments == entry.segments)
      throw Error(place, "is there already as " + other.route.pattern);
  }
  if (route.id.empty()) {
    for (const char c : route.method + route.pattern) route.id += is_name(std::string(1, c)) ? c : '_';
  }
  entry.route = std::move(route);
  entry.handler = std::move(handler);
  entries_.push_back(std::move(entry));
}

std::variant<const Router::Entry*, Refusal> Router::find(Request& request) const {
  const std::string_view method = request.method == "HEAD" ? std::string_view("GET") : std::string_view(request.method);
  const Entry* best = nullptr;
  std::vector<std::string> allowed;
  const auto matches = [&](const Entry& entry) {
    if (entry.segments.size() != request.segments.size()) return false;
    for (std::size_t i = 0; i < entry.segments.size(); ++i) {
      if (entry.segments[i] != "{" && entry.segments[i] != request.segments[i]) return false;
    }
    return true;
  };
  for (const Entry& entry : entries_) {
    if (!matches(entry)) continue;
    allowed.push_back(entry.route.method);
    if (entry.route.method != method) continue;
    if (best == nullptr || entry.names.size() < best->names.size()) best = &entry;  // /a/b before /a/{name}
  }
  if (best == nullptr && allowed.empty())
    return Refusal{{404, "there is no " + request.path + ", expected one of the paths in /openapi.json", "", ""}, {}};
  if (best == nullptr) {
    std::string list;
    std::sort(allowed.begin(), allowed.end());
    allowed.erase(std::unique(allowed.begin(), allowed.end()), allowed.end());
    for (const std::string& each : allowed) text::append(list, each + (each == "GET" ? ", HEAD" : ""));
    return Refusal{{405, request.method + " does not apply to " + request.path + ", expected " + list, "", ""},
                   {{"Allow", list}}};
  }
  request.matched.clear();
  std::size_t number = 0;
  for (std::size_t i = 0; i < best->segments.size(); ++i) {
    if (best->segments[i] == "{") request.matched.emplace_back(best->names[number++], request.segments[i]);
  }
  return best;
}

void Router::add_schema(const std::string& name, const std::string& schema) {
  for (const auto& [key, text] : schemas_) {
    if (key == name) throw Error("schema " + name, "is there already");
  }
  schemas_.emplace_back(name, schema);
}

}  // namespace cotwin::gateway::http
