#include "components/gateway/http/audited.h"

#include <nlohmann/json.hpp>

#include "components/gateway/http/problem.h"
#include "models/foundation/support/error.h"

namespace cotwin::gateway::http {

namespace {

access::Deed deed_of(const Request& request) {
  return {request.by, request.address, request.method + (request.path.empty() ? "" : " " + request.path), request.body};
}

/// The detail of a response that is a problem.
std::string why_of(const Response& response) {
  if (response.status < 400) return "";
  const auto problem = nlohmann::json::parse(response.body, nullptr, false);
  return problem.is_object() && problem.contains("detail") && problem["detail"].is_string() ? problem["detail"] : "";
}

/// Something that is being done. One that is dropped without an end has failed.
struct Doing {
  Doing(std::shared_ptr<access::Audit> a, access::Deed d, std::uint64_t n)
      : audit(std::move(a)), deed(std::move(d)), number(n) {}
  Doing(const Doing&) = delete;
  Doing& operator=(const Doing&) = delete;

  const std::shared_ptr<access::Audit> audit;
  const access::Deed deed;
  const std::uint64_t number;
  bool told = false;

  void end(int status, const std::string& why) {
    if (!std::exchange(told, true)) audit->end(number, deed, status, why);
  }
  ~Doing() { end(500, "it was not answered"); }
};

}  // namespace

Reply audited(const Request& request, Reply reply) {
  if (!request.audit) return reply;
  access::Deed deed = deed_of(request);
  std::uint64_t number = 0;
  try {
    number = request.audit->begin(deed);
  } catch (const Error& error) {
    throw Refusal{{503, std::string("is not done, because it cannot be written who does it: ") + error.what(), "", ""},
                  {{"Retry-After", "10"}}};
  }
  const auto doing = std::make_shared<Doing>(request.audit, std::move(deed), number);
  return [doing, reply = std::move(reply)](Response response) {
    doing->end(response.status, why_of(response));
    reply(std::move(response));
  };
}

void audit_refusal(const Request& request, const Response& response) {
  if (request.audit) request.audit->refused(deed_of(request), response.status, why_of(response));
}

}  // namespace cotwin::gateway::http
