// What can be asked at once: robots, services.
#include <cmath>
#include <new>

#include "components/gateway/api/api.h"
#include "components/gateway/api/catalogue.h"
#include "components/gateway/api/job_board.h"
#include "components/gateway/api/json_tools.h"
#include "components/gateway/http/audited.h"
#include "components/services/json/control/control.h"
#include "components/services/json/json.h"
#include "models/foundation/support/error.h"

namespace cotwin::gateway {

namespace {

using http::Request;
using http::Response;

constexpr double kPatience = 10;  // s that a client waits for a long service without saying how long

std::string schema_name(const std::string& service) {
  std::string name;
  bool upper = true;
  for (const char c : service) {
    if (c == '_') {
      upper = true;
      continue;
    }
    name += upper && c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    upper = false;
  }
  return name;
}

/// The request of a service as a schema within the document, as POST /services/{name} takes it: with the present posture of the run as
/// another start, and without "service", which is in the path.
Json request_schema(const ServiceInfo& service) {
  Json schema = Json::parse(service.request_schema);
  schema.erase("$schema");  // only the root of a document may have it
  Json& required = schema["required"];
  for (auto name = required.begin(); name != required.end();) name = *name == "service" ? required.erase(name) : name + 1;
  if (required.empty()) schema.erase("required");
  Json& members = schema["properties"];
  if (!members.contains("from_q_rad")) return schema;
  members["from"] = {{"const", "run"}, {"description", "the present joint positions of the run, in place of from_q_rad"}};
  members["from_signal"] = {{"type", "string"}, {"description", "the signal that has them; without it the only q of the run"}};
  if (!schema.contains("allOf")) return schema;
  for (Json& choice : schema["allOf"]) {
    if (choice["anyOf"][0]["required"][0] == "from_q_rad") choice["anyOf"].push_back({{"required", Json::array({"from"})}});
  }
  return schema;
}

Json reply_schema(const ServiceInfo& service) {
  Json schema = Json::parse(service.reply_schema);
  schema.erase("$schema");
  return schema;
}

std::string service_names_schema() {
  Json names = Json::array();
  for (const ServiceInfo& service : all_services()) names.push_back(service.name);
  return Json{{"enum", names}}.dump();
}

Json limit(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json robot_json(const services::Robot& robot) {
  Json joints = Json::array();
  for (const robot::Joint& j : robot.model.joints) {
    const bool slides = j.type == robot::JointType::kPrismatic;
    const std::string m = slides ? "m" : "rad";
    joints.push_back({{"name", j.name},
                      {"type", slides ? "prismatic" : "revolute"},
                      {"q_min_" + m, limit(j.q_min)},
                      {"q_max_" + m, limit(j.q_max)},
                      {"dq_max_" + m + "_per_s", limit(j.dq_max)},
                      {"ddq_max_" + m + "_per_s2", limit(j.ddq_max)},
                      {"dddq_max_" + m + "_per_s3", limit(j.dddq_max)},
                      {slides ? "tau_max_N" : "tau_max_Nm", limit(j.tau_max)}});
  }
  return {{"name", robot.name},
          {"joints", std::move(joints)},
          {"has_drives", robot.drives.has_value()},
          {"has_energy", robot.energy.has_value()},
          {"data", services::data_of(robot)}};
}

Json master_json(const ServiceInfo& service) {
  return {{"ID", service.name},
          {"Description", Json::array({{{"Locale", "en"}, {"Text", service.summary}}})},
          {"Immediate", !service.is_long},
          {"Href", "/services/" + service.name},
          {"RequestSchema", Json::parse(service.request_schema)},
          {"ReplySchema", Json::parse(service.reply_schema)}};
}

const ServiceInfo* find_service(const std::string& name) {
  for (const ServiceInfo& s : all_services()) {
    if (s.name == name) return &s;
  }
  return nullptr;
}

const ServiceInfo& service_of(const std::string& name) {
  const ServiceInfo* const service = find_service(name);
  if (service == nullptr) throw refusal(404, "there is no service '" + name.substr(0, 40) + "', expected one of /work-masters");
  return *service;
}

/// The request with the service of the path.
Json with_service(const Request& request, const ServiceInfo& service) {
  Json object = object_of(request.body);
  if (object.contains("service") && object["service"] != service.name)
    throw refusal(422, "is not '" + service.name + "', the service of the path; it may be left out", "/service");
  object["service"] = service.name;
  return object;
}

Response answer_now(services::Robots& robots, const Json& object) {
  try {
    std::string reply = services::answer_object(robots, object);
    if (reply.size() > kLargestReply) {
      throw refusal(422, "the reply has " + std::to_string(reply.size()) + " bytes, expected at most " +
                             std::to_string(kLargestReply) + " of an immediate answer: ask for fewer samples, or order a job");
    }
    return give_text(std::move(reply));
  } catch (const services::RequestError& error) {
    throw refusal(422, error.detail(), error.pointer());
  }
}

/// `asked`: the request before the gateway filled it in.
void answer_by_job(const std::shared_ptr<JobBoard>& board, const Request& request, const Json& object, std::string asked,
                   bool promised, const http::Reply& reply) {
  JobOrder order;
  order.request = object.dump();
  order.asked = std::move(asked);
  const JobReply stored = store_for(board->jobs(), request, order);
  const double seconds =
      request.field("Prefer") != nullptr || request.query_value("wait") != nullptr ? wait_of(request) : kPatience;
  board->wait(stored.id, seconds, [board, id = stored.id, promised, reply](bool done) {
    Response response = response_of([&] { return done ? board->reply_of(id) : give(board->job_json(id), 202); });
    const std::string encoded = http::encode_segment(id);
    if (done) {
      response.fields.push_back({"Content-Location", "/job-responses/" + encoded});
    } else {
      response.fields.push_back({"Location", "/job-responses/" + encoded});
      response.fields.push_back({"Retry-After", "1"});
    }
    if (promised) response.fields.push_back({"Preference-Applied", "respond-async"});
    reply(std::move(response));
  });
}

}  // namespace

void add_service_routes(http::Router& router, services::Robots& robots, const std::shared_ptr<JobBoard>& board,
                        const Fill& fill) {
  router.add_schema("Joint", R"({
    "type": "object", "description": "Limits without a value are null; units of measure are in the names",
    "properties": {
      "name": {"type": "string"}, "type": {"enum": ["revolute", "prismatic"]},
      "q_min_rad": {"type": ["number", "null"]}, "q_max_rad": {"type": ["number", "null"]},
      "dq_max_rad_per_s": {"type": ["number", "null"]}, "tau_max_Nm": {"type": ["number", "null"]},
      "q_min_m": {"type": ["number", "null"]}, "q_max_m": {"type": ["number", "null"]},
      "dq_max_m_per_s": {"type": ["number", "null"]}, "tau_max_N": {"type": ["number", "null"]},
      "ddq_max_rad_per_s2": {"type": ["number", "null"]}, "dddq_max_rad_per_s3": {"type": ["number", "null"]},
      "ddq_max_m_per_s2": {"type": ["number", "null"]}, "dddq_max_m_per_s3": {"type": ["number", "null"]}},
    "required": ["name", "type"], "additionalProperties": false,
    "if": {"properties": {"type": {"const": "revolute"}}}, "then": {"required": ["q_min_rad", "q_max_rad", "dq_max_rad_per_s", "tau_max_Nm"]},
    "else": {"required": ["q_min_m", "q_max_m", "dq_max_m_per_s", "tau_max_N"]}})");
  router.add_schema("RobotData", R"({
    "type": "object", "description": "Which data beside the URDF a robot has, by file",
    "properties": {"joints": {"type": "integer"}, "problem": {"type": "string", "description": "why the robot cannot be read"}},
    "additionalProperties": {"enum": ["missing", "given", "partly assumed", "assumed"]}})");
  router.add_schema("Robot", R"({
    "type": "object",
    "properties": {
      "data": {"$ref": "#/components/schemas/RobotData"},
      "name": {"type": "string"}, "joints": {"type": "array", "items": {"$ref": "#/components/schemas/Joint"}},
      "has_drives": {"type": "boolean"}, "has_energy": {"type": "boolean"}},
    "required": ["name", "joints", "has_drives", "has_energy", "data"], "additionalProperties": false})");
  router.add_schema("Robots", R"({
    "type": "object",
    "properties": {"robots": {"type": "array", "items": {"type": "string"}}, "default": {"type": "string"},
      "data": {"type": "object", "additionalProperties": {"$ref": "#/components/schemas/RobotData"}}},
    "required": ["robots", "default", "data"], "additionalProperties": false})");
  router.add_schema("WorkMaster", R"({
    "type": "object", "description": "A service: ISA95WorkMasterDataType of OPC 10031-4, and the JSON Schema of its request",
    "properties": {
      "ID": {"type": "string"}, "Description": {"type": "array", "items": {"$ref": "#/components/schemas/LocalizedText"}},
      "Immediate": {"type": "boolean", "description": "Answered at once by POST to Href; else by a job"},
      "Href": {"type": "string"}, "RequestSchema": {"type": "object"}, "ReplySchema": {"type": "object"}},
    "required": ["ID", "Description", "Immediate", "Href", "RequestSchema", "ReplySchema"], "additionalProperties": false})");
  router.add_schema("WorkMasters", R"({
    "type": "object",
    "properties": {"WorkMasters": {"type": "array", "items": {"$ref": "#/components/schemas/WorkMaster"}}},
    "required": ["WorkMasters"], "additionalProperties": false})");
  router.add_schema("LocalizedText", R"({
    "type": "object", "properties": {"Locale": {"type": "string"}, "Text": {"type": "string"}}, "required": ["Text"], "additionalProperties": false})");
  Json requests = Json::array(), replies = Json::array();
  for (const ServiceInfo& service : all_services()) {
    const std::string name = schema_name(service.name);
    router.add_schema(name + "Request", request_schema(service).dump());
    router.add_schema(name + "Reply", reply_schema(service).dump());
    requests.push_back({{"$ref", "#/components/schemas/" + name + "Request"}});
    replies.push_back({{"$ref", "#/components/schemas/" + name + "Reply"}});
  }
  router.add_schema("ServiceRequest", Json{{"description", "That of the service in the path, whose name may be left out here"},
                                           {"type", "object"},
                                           {"anyOf", requests}}
                                          .dump());
  router.add_schema("NamedRequest", Json{{"description", "The request of the service that its member service names"},
                                         {"type", "object"},
                                         {"required", Json::array({"service"})},
                                         {"anyOf", requests}}
                                        .dump());
  const Json control = services::control_schemas();
  router.add_schema(
      "OrderRequest",
      Json{{"description", "A request that names its service, one whose service is chosen, or a chain of requests"},
           {"anyOf", {{{"$ref", "#/components/schemas/NamedRequest"}}, control["chosen"], control["chain"]}}}
          .dump());
  router.add_schema("Reply", Json{{"description", "The reply of the service; the same request gives the same bytes"},
                                  {"type", "object"},
                                  {"anyOf", replies}}
                                 .dump());
  router.add_schema("OrderReply", Json{{"anyOf", {{{"$ref", "#/components/schemas/Reply"}}, control["chain_reply"]}}}.dump());
  const http::Parameter service_part{"name", "path", "name of the service", service_names_schema()};

  const auto get = [&](const char* pattern, const char* id, const char* summary, const char* schema) {
    http::Route r;
    r.method = "GET";
    r.pattern = pattern;
    r.id = id;
    r.summary = summary;
    r.tag = "services";
    r.answers = {{200, schema, summary}};
    r.slow = true;  // reads files
    return r;
  };
  router.add(
      get("/robots", "listRobots", "Names of the robots that requests may name, and their data", "Robots"),
      [&robots](const Request&) {
        return give({{"robots", robots.names()}, {"default", robots.fallback()}, {"data", services::data_of_all(robots)}});
      });
  router.add(get("/robots/{name}", "getRobot", "Joints and limits of a robot", "Robot"), [&robots](const Request& request) {
    try {
      return give(robot_json(*robots.find(request.part("name"))));
    } catch (const Error& error) {
      throw refusal(404, error.what());
    }
  });
  router.add(get("/work-masters", "listWorkMasters", "The services with the JSON Schemas of their requests", "WorkMasters"),
             [](const Request&) {
               Json all = Json::array();
               for (const ServiceInfo& service : all_services()) all.push_back(master_json(service));
               return give({{"WorkMasters", std::move(all)}});
             });
  http::Route master =
      get("/work-masters/{name}", "getWorkMaster", "A service with the JSON Schema of its request", "WorkMaster");
  master.parameters = {service_part};
  router.add(master, [](const Request& request) { return give(master_json(service_of(request.part("name")))); });

  http::Route ask;
  ask.method = "POST";
  ask.pattern = "/services/{name}";
  ask.id = "askService";
  ask.tag = "services";
  ask.summary = "The answer to a request: at once, or by a job for long services and with Prefer: respond-async";
  ask.takes = "ServiceRequest";
  ask.slow = true;
  ask.answers = {{200, "Reply", "The reply of the service; after a job Content-Location has its response"},
                 http::problem_answer(409, "The run whose posture is asked for has ended")};
  ask.parameters = {service_part};
  if (board) {
    http::Answer ordered{202, "JobOrderAndState", "A job was ordered, Location has its response"};
    ordered.fields = {"Location", "Retry-After"};
    ask.answers.push_back(std::move(ordered));
    ask.answers.push_back(http::problem_answer(403, "The token, or the local user, may not order jobs, and the answer is one"));
    ask.answers.push_back(http::problem_answer(410, "The key was used for a job order that was removed"));
    ask.answers.push_back(http::problem_answer(500, "The job ended without a reply: it was stopped, or its workers died"));
    ask.parameters = {service_part,
                      {"Prefer", "header", "respond-async, wait=SECONDS (RFC 7240)"},
                      {"Idempotency-Key", "header", "for answers by a job: a repeated request gives the same job"},
                      {"wait", "query", "the same as wait of Prefer", R"({"type":"number","minimum":0,"maximum":30})"}};
  } else {
    ask.answers.push_back(http::problem_answer(501, "The service is answered by jobs, and this gateway has none"));
  }
  const auto answer = [&robots, board, fill](const Request& request, const std::function<Json()>& read,
                                             const http::Reply& reply) {
    Json object = read();
    const std::string* const prefer = request.field("Prefer");
    const bool promised = prefer != nullptr && http::preference(*prefer, "respond-async").has_value();
    if (fill) fill(object);
    const bool takes_long = is_long(object);
    if (!board && takes_long)
      throw refusal(501,
                    object.value("service", "one of the steps") +
                        " takes long and is answered by jobs, but this gateway has no database for them (parameter database)");
    if (board && (takes_long || promised)) {
      if (!request.scopes.has(http::Scope::kJobs)) {
        const http::Refusal refused =
            refusal(403, request.by + " may not order jobs, expected the scope jobs: the answer is a job");
        http::audit_refusal(request, http::to_response(refused.problem));
        throw refused;
      }
      expect_answerable(robots, object);
      return answer_by_job(board, request, object, read().dump(), promised, http::audited(request, reply));
    }
    reply(answer_now(robots, object));
  };
  http::Route control_route = ask;
  control_route.pattern = "/services";
  control_route.id = "askControl";
  control_route.summary = "The answer to a request whose service is chosen by its goal and context, or to a chain of requests";
  control_route.takes = "OrderRequest";
  control_route.answers[0].schema = "OrderReply";
  control_route.parameters.erase(control_route.parameters.begin());
  router.add_later(control_route, [answer](const Request& request, const http::Reply& reply) {
    answer(
        request, [&] { return object_of(request.body); }, reply);
  });
  router.add_later(ask, [answer](const Request& request, const http::Reply& reply) {
    const ServiceInfo& service = service_of(request.part("name"));
    answer(
        request, [&] { return with_service(request, service); }, reply);
  });
}

}  // namespace cotwin::gateway
