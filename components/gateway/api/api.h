#pragma once
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "components/gateway/access/access.h"
#include "components/gateway/http/router.h"
#include "components/services/robots.h"

/// The routes of the gateway.
namespace cotwin::gateway {

inline constexpr std::size_t kLargestReply = 2 << 20;  // bytes of an immediate answer

class JobBoard;
/// Completes a request to a service before it is answered or stored ("from": "run"). May wait; may throw Refusal.
using Fill = std::function<void(nlohmann::ordered_json&)>;

/// GET /health and /openapi.json, which describes all routes of the table; POST /tickets. `tickets`: those that the server redeems.
void add_general_routes(http::Router& router, std::shared_ptr<access::Tickets> tickets, const std::string& version);

/// GET /robots and /work-masters (one per service, with the JSON Schema of its request); POST /services/{name}. `board`: nullptr without job
/// control; then there are only immediate answers.
void add_service_routes(http::Router& router, services::Robots& robots, const std::shared_ptr<JobBoard>& board,
                        const Fill& fill = {});

/// /job-orders, /job-responses, /results, and the events of jobs at /events. Orders that `robots` can never answer are refused.
void add_job_routes(http::Router& router, services::Robots& robots, const std::shared_ptr<JobBoard>& board,
                    const Fill& complete = {});

/// Schemas that several routes refer to.
void add_common_schemas(http::Router& router);
/// Those of jobs, which add_job_routes adds.
void add_job_schemas(http::Router& router);

/// The OpenAPI 3.1 document of a table of routes: one JSON text.
std::string openapi(const http::Router& router, const std::string& version);

}  // namespace cotwin::gateway
