// Job control over HTTP: the verbs of OPC 10031-4.
#include <algorithm>
#include <set>

#include "components/gateway/api/api.h"
#include "components/gateway/api/catalogue.h"
#include "components/gateway/api/job_board.h"
#include "components/gateway/jobs/canonical.h"
#include "components/services/json/json.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway {

namespace {

using http::Request;
using http::Response;

std::string tag_of(const Job& job) { return "\"" + std::to_string(job.version) + "\""; }

const Json& member(const Json& object, const char* name, bool (Json::*is)() const noexcept, const char* expected,
                   const std::string& pointer) {
  const Json& value = object.at(name);
  if (!(value.*is)()) throw refusal(422, std::string("is no ") + expected, pointer + "/" + name);
  return value;
}

std::vector<LocalizedText> texts_of(const Json& object, const char* name) {
  std::vector<LocalizedText> all;
  if (!object.contains(name)) return all;
  const Json& list = member(object, name, &Json::is_array, "array of {Locale, Text}", "");
  for (std::size_t i = 0; i < list.size(); ++i) {
    const std::string pointer = std::string("/") + name + "/" + std::to_string(i);
    if (!list[i].is_object()) throw refusal(422, "is no object, expected {Locale, Text}", pointer);
    expect_members(list[i], {"Locale", "Text"}, pointer);
    LocalizedText text;
    if (list[i].contains("Locale"))
      text.locale = member(list[i], "Locale", &Json::is_string, "text", pointer).get<std::string>();
    if (!list[i].contains("Text")) throw refusal(422, "is missing", pointer + "/Text");
    text.text = member(list[i], "Text", &Json::is_string, "text", pointer).get<std::string>();
    all.push_back(std::move(text));
  }
  return all;
}

UtcTime time_of_member(const Json& value, const std::string& pointer) {
  const std::optional<UtcTime> time = value.is_string() ? time_of(value.get<std::string>()) : std::nullopt;
  if (!time) throw refusal(422, "is no time, expected one such as 2026-11-22T08:00:00Z", pointer);
  return *time;
}

void read_parameter(const Json& one, const std::string& pointer, const Fill& fill, std::set<std::string>& given,
                    JobOrder& order) {
  if (!one.is_object()) throw refusal(422, "is no object, expected {ID, Value}", pointer);
  expect_members(one, {"ID", "Value"}, pointer);
  if (!one.contains("ID") || !one.contains("Value")) throw refusal(422, "has no ID or no Value", pointer);
  const std::string id = member(one, "ID", &Json::is_string, "text", pointer).get<std::string>();
  if (!given.insert(id).second)
    throw refusal(422, "'" + id.substr(0, 40) + "' is given twice, expected it once", pointer + "/ID");
  const Json& value = one["Value"];
  const std::string place = pointer + "/Value";
  if (id == "Request") {
    if (!value.is_object()) throw refusal(422, "is no object, expected the request of a service", place);
    Json request = value;
    try {
      fill(request);
    } catch (http::Refusal& refused) {
      if (refused.problem.status == 422) refused.problem.pointer.insert(0, place);
      throw;
    }
    order.request = request.dump();
    order.asked = value.dump();
  } else if (id == "Deadline") {
    order.deadline = time_of_member(value, place);
  } else if (id == "TimeLimit") {
    if (!value.is_number() || !(value.get<double>() > 0)) throw refusal(422, "is no duration, expected seconds above 0", place);
    order.time_limit_s = value.get<double>();
  } else if (id == "Reuse") {
    if (!value.is_boolean()) throw refusal(422, "is neither true nor false", place);
    order.reuse = value.get<bool>();
  } else {
    throw refusal(422, "'" + id.substr(0, 40) + "' is no parameter, expected Request, Deadline, TimeLimit or Reuse",
                  pointer + "/ID");
  }
}

JobOrder order_of(const Json& j, const Fill& fill) {
  expect_members(j, {"JobOrderID", "Description", "WorkMasterID", "StartTime", "EndTime", "Priority", "JobOrderParameters"});
  JobOrder order;
  if (j.contains("JobOrderID")) {
    order.id = member(j, "JobOrderID", &Json::is_string, "text", "").get<std::string>();
    if (order.id.empty()) throw refusal(422, "is empty; without this member an identifier is made", "/JobOrderID");
  }
  order.description = texts_of(j, "Description");
  if (j.contains("Priority")) {
    const Json& p = member(j, "Priority", &Json::is_number_integer, "integer", "");
    if (p < -32768 || p > 32767) throw refusal(422, "is out of range, expected -32768 to 32767", "/Priority");
    order.priority = p.get<std::int16_t>();
  }
  if (j.contains("StartTime")) order.start_time = time_of_member(j["StartTime"], "/StartTime");
  if (j.contains("EndTime")) order.end_time = time_of_member(j["EndTime"], "/EndTime");
  if (j.contains("JobOrderParameters")) {
    const Json& list = member(j, "JobOrderParameters", &Json::is_array, "array of {ID, Value}", "");
    std::set<std::string> given;
    for (std::size_t i = 0; i < list.size(); ++i)
      read_parameter(list[i], "/JobOrderParameters/" + std::to_string(i), fill, given, order);
  }
  if (order.request.empty())
    throw refusal(422, "has no parameter Request, expected {\"ID\": \"Request\", \"Value\": {\"service\": …}}",
                  "/JobOrderParameters");
  if (j.contains("WorkMasterID")) {
    const Json request = services::parse_json(order.request);
    const Json& masters = j["WorkMasterID"];
    const bool one = masters.is_array() && masters.size() == 1 && masters[0].is_object() && masters[0].contains("ID");
    if (!one || masters[0]["ID"] != request.value("service", kChain))
      throw refusal(422, "is not [{\"ID\": service of the request}]; it may be left out", "/WorkMasterID");
  }
  return order;
}

Response job_response(JobBoard& board, const std::string& id, int status = 200) {
  const std::optional<Job> job = board.jobs().find(id);
  if (!job) throw refusal(404, "there is no job order '" + id.substr(0, 80) + "'");
  Response response = give(JobBoard::to_json(*job), status);
  response.fields.push_back({"ETag", tag_of(*job)});
  if (status == 201) response.fields.push_back({"Location", "/job-orders/" + http::encode_segment(id)});
  return response;
}

Response stored(JobBoard& board, const Request& request, const JobOrder& order) {
  bool start = true;
  if (const std::string* const text = request.query_value("start")) {
    const std::optional<bool> value = text::parse_boolean(*text);
    if (!value) throw refusal(400, "?start=" + text->substr(0, 40) + ", expected true (StoreAndStart) or false (Store)");
    start = *value;
  }
  const JobReply reply = store_for(board.jobs(), request, order, start);
  return job_response(board, reply.id, reply.repeated ? 200 : 201);
}

Response put(JobBoard& board, const Request& request, const Fill& fill) {
  JobOrder order = order_of(object_of(request.body), fill);
  const std::string& id = request.part("id");
  if (!order.id.empty() && order.id != id)
    throw refusal(422, "is not the identifier of the path; it may be left out", "/JobOrderID");
  order.id = id;
  if (const std::string* const none = request.field("If-None-Match")) {
    if (text::trim(*none) != "*") throw refusal(400, "If-None-Match has another value than *");
    if (board.jobs().find(id)) throw refusal(412, "the job order is there already");
    return stored(board, request, order);
  }
  const std::string* const match = request.field("If-Match");
  if (match == nullptr) throw refusal(428, "expected If-None-Match: * for a new job order, or If-Match: ETAG to change one");
  std::string_view tag = text::trim(*match);
  std::optional<std::int64_t> version;
  if (tag != "*") {
    if (tag.size() < 3 || tag.front() != '"' || tag.back() != '"')
      throw refusal(400, "If-Match is no entity tag, expected one such as \"12\"");
    version = text::parse_integer(tag.substr(1, tag.size() - 2)).value_or(-1);
  }
  const JobReply reply = board.jobs().update(order, version);
  if (!reply.ok()) throw refusal_of(reply);
  return job_response(board, id);
}

Response command(JobBoard& board, const Request& request) {
  const Json j = object_of(request.body);
  expect_members(j, {"Command", "Comment"});
  if (!j.contains("Command"))
    throw refusal(422, "is missing, expected Start, RevokeStart, Pause, Resume, Stop, Abort, Cancel or Clear", "/Command");
  const std::string name = member(j, "Command", &Json::is_string, "text", "").get<std::string>();
  const std::optional<JobVerb> verb = verb_of(name);
  if (!verb)
    throw refusal(422, "'" + name.substr(0, 40) + "', expected Start, RevokeStart, Pause, Resume, Stop, Abort, Cancel or Clear",
                  "/Command");
  const std::string& id = request.part("id");
  const JobReply reply = board.jobs().command(id, *verb, texts_of(j, "Comment"));
  if (!reply.ok()) throw refusal_of(reply);
  if (*verb == JobVerb::kCancel || *verb == JobVerb::kClear) {
    Response gone;
    gone.status = 204;
    gone.type = "";
    return gone;
  }
  return job_response(board, id, 202);
}

std::optional<UtcTime> query_time(const Request& request, const char* name) {
  const std::string* const value = request.query_value(name);
  if (value == nullptr) return std::nullopt;
  const std::optional<UtcTime> time = time_of(*value);
  if (!time)
    throw refusal(400, std::string("?") + name + "=" + value->substr(0, 40) + ", expected a time such as 2026-11-22T08:00:00Z");
  return time;
}

bool newest_first(const Request& request, bool otherwise) {
  const std::string* const order = request.query_value("order");
  if (order == nullptr) return otherwise;
  if (*order != "newest" && *order != "oldest")
    throw refusal(400, "?order=" + order->substr(0, 40) + ", expected newest or oldest");
  return *order == "newest";
}

void add_next(Response& response, const Request& request, const std::string& next) {
  if (next.empty()) return;
  std::string target = request.path + "?";
  for (const auto& [key, value] : request.query) {
    if (key != "cursor") target += http::encode_segment(key) + "=" + http::encode_segment(value) + "&";
  }
  response.fields.push_back({"Link", "<" + target + "cursor=" + http::encode_segment(next) + ">; rel=\"next\""});
}

Response list(JobBoard& board, const Request& request) {
  JobFilter filter;
  const std::string states = query_text(request, "state");
  for (const std::string_view name : text::split(states, ',')) {
    if (name.empty()) continue;
    const std::optional<JobState> state = state_of(name);
    if (!state)
      throw refusal(400, "?state=" + std::string(name.substr(0, 40)) + ", expected names such as Running, separated by commas");
    filter.states.push_back(*state);
  }
  filter.service = query_text(request, "service");
  filter.robot = query_text(request, "robot");
  filter.stored_from = query_time(request, "from");
  filter.stored_before = query_time(request, "before");
  filter.newest_first = newest_first(request, false);
  const auto limit = static_cast<std::size_t>(query_integer(request, "limit", 1, 1000, 100));
  JobPage page;
  try {
    page = board.jobs().list(filter, query_text(request, "cursor"), limit);
  } catch (const Unavailable&) {
    throw;
  } catch (const Error& error) {
    throw refusal(400, error.what());
  }
  Json all = Json::array();
  for (const Job& job : page.jobs) all.push_back(JobBoard::to_json(job));
  Response response = give({{"JobOrders", std::move(all)}, {"Next", page.next}});
  add_next(response, request, page.next);
  return response;
}

/// The members of a Result but its reply, which is inserted as text: it stays as it is, byte for byte.
std::string result_text(const Result& r) {
  const Json j{{"Number", r.number},
               {"JobOrderID", r.job_id},
               {"Service", r.service},
               {"Robot", r.robot},
               {"RequestHash", r.request_hash},
               {"RobotHash", r.robot_hash},
               {"Producer", r.producer},
               {"Stored", to_text(r.stored)},
               {"Busy_s", r.busy_s},
               {"Reused", r.reused},
               {"Bytes", r.bytes},
               {"Request", Json::parse(r.request, nullptr, false)}};
  std::string text = j.dump(-1, ' ', false, Json::error_handler_t::replace);
  if (!r.reply.empty()) text.insert(text.size() - 1, ",\"Reply\":" + r.reply);
  return text;
}

Response results(JobBoard& board, const Request& request, const std::string& equal_to) {
  ResultFilter filter;
  filter.request = equal_to;
  filter.job_id = query_text(request, "job");
  filter.request_hash = query_text(request, "request_hash");
  filter.service = query_text(request, "service");
  filter.robot = query_text(request, "robot");
  filter.stored_from = query_time(request, "from");
  filter.stored_before = query_time(request, "before");
  filter.newest_first = newest_first(request, true);
  const auto limit = static_cast<std::size_t>(query_integer(request, "limit", 1, 1000, 100));
  ResultPage page;
  try {
    page = board.jobs().results(filter, query_text(request, "cursor"), limit);
  } catch (const Unavailable&) {
    throw;
  } catch (const Error& error) {
    throw refusal(400, error.what());
  }
  std::string text = "{\"Results\":[";
  for (std::size_t i = 0; i < page.results.size(); ++i) text += (i == 0 ? "" : ",") + result_text(page.results[i]);
  text += "],\"Next\":" + Json(page.next).dump() + "}";
  Response response = give_text(std::move(text));
  add_next(response, request, page.next);
  return response;
}

/// ISA95JobResponseDataType, with the reply among the data.
Response job_response_data(JobBoard& board, const std::string& id, http::Scopes scopes) {
  // What one who may only read has seen stays for those who ordered it.
  const bool operates = scopes.has(http::Scope::kJobs);
  const std::optional<Job> found = operates ? board.jobs().response(id) : board.jobs().find(id);
  if (!found) throw refusal(404, "there is no job order '" + id.substr(0, 80) + "'");
  const Job& job = *found;
  Json j{{"JobResponseID", job.order.id}, {"JobOrderID", job.order.id}};
  if (job.started) j["StartTime"] = to_text(*job.started);
  if (job.ended) j["EndTime"] = to_text(*job.ended);
  j["JobState"] = JobBoard::to_json(job)["State"];
  Json data = Json::array();
  const auto add = [&](const char* name, Json value) { data.push_back({{"ID", name}, {"Value", std::move(value)}}); };
  add("JobResult", static_cast<int>(job.result));
  add("Progress", job.progress);
  if (!job.light.empty()) add("Light", job.light);
  if (!job.reason.empty()) add("ReasonForStateChange", job.reason);
  if (job.busy_s > 0) add("ActualUnitBusyTime", job.busy_s * 1e3);  // Duration of OPC: ms
  if (job.remaining_s) add("EstimatedRemainingTime", *job.remaining_s * 1e3);
  if (!job.problem.empty()) add("Problem", Json::parse(job.problem, nullptr, false));
  if (job.result_number) add("ResultNumber", *job.result_number);
  j["JobResponseData"] = std::move(data);
  std::string text = j.dump(-1, ' ', false, Json::error_handler_t::replace);
  if (job.result_number) {
    const std::optional<Result> result = board.jobs().result(*job.result_number);
    if (result) text.insert(text.size() - 2, ",{\"ID\":\"Reply\",\"Value\":" + result->reply + "}");
  }
  Response response = give_text(std::move(text));
  if (!is_done(job.state)) response.fields.push_back({"Retry-After", "1"});
  return response;
}

}  // namespace

void add_job_routes(http::Router& router, services::Robots& robots, const std::shared_ptr<JobBoard>& board,
                    const Fill& complete) {
  add_job_schemas(router);
  const Fill fill = [&robots, complete](Json& request) {
    if (complete) complete(request);
    expect_answerable(robots, request);
  };
  const auto make = [](const char* method, const char* pattern, const char* id, const char* summary, http::Scope scope) {
    http::Route r;
    r.method = method;
    r.pattern = pattern;
    r.id = id;
    r.summary = summary;
    r.tag = "jobs";
    r.scope = scope;
    r.slow = true;  // the database
    return r;
  };
  const auto add = [&](const http::Route& route, http::Handler handler) {
    router.add(route, [handler = std::move(handler)](const Request& r) { return response_of([&] { return handler(r); }); });
  };
  const std::vector<http::Parameter> pages = {
      {"service", "query", "only of this service"},
      {"robot", "query", "only of this robot"},
      {"from", "query", "stored at this time or later", R"({"type":"string","format":"date-time"})"},
      {"before", "query", "stored before", R"({"type":"string","format":"date-time"})"},
      {"order", "query", "newest or oldest first", R"({"enum":["newest","oldest"]})"},
      {"limit", "query", "most items of a page", R"({"type":"integer","minimum":1,"maximum":1000,"default":100})"},
      {"cursor", "query", "Next of the page before"}};

  http::Route post =
      make("POST", "/job-orders", "storeJobOrder", "StoreAndStart, or Store with start=false", http::Scope::kJobs);
  post.takes = "JobOrder";
  post.parameters = {{"start", "query", "false: Store", R"({"type":"boolean","default":true})"},
                     {"Idempotency-Key", "header", "a repeated order with this key is the same job"}};
  const auto with = [](http::Answer given, std::vector<std::string> fields) {
    given.fields = std::move(fields);
    return given;
  };
  const http::Answer conflict = http::problem_answer(409, "The state of the job does not permit that (ReturnStatus)");
  const http::Answer in_use = http::problem_answer(409, "The identifier is or was in use, or the run has ended");
  post.answers = {with({201, "JobOrderAndState", "Stored"}, {"ETag", "Location"}),
                  with({200, "JobOrderAndState", "The key was used before: the same job"}, {"ETag"}), in_use,
                  http::problem_answer(410, "The key was used for a job order that was removed")};
  add(post, [board, fill](const Request& r) { return stored(*board, r, order_of(object_of(r.body), fill)); });

  http::Route all = make("GET", "/job-orders", "listJobOrders", "JobOrderList, by pages", http::Scope::kRead);
  all.parameters = pages;
  all.parameters.push_back({"state", "query", "names of states, separated by commas"});
  all.answers = {{200, "JobOrders", "A page"}};
  add(all, [board](const Request& r) { return list(*board, r); });

  http::Route one =
      make("GET", "/job-orders/{id}", "getJobOrder", "A job order and its state; the ETag is its version", http::Scope::kRead);
  one.answers = {with({200, "JobOrderAndState", "It"}, {"ETag"})};
  add(one, [board](const Request& r) { return job_response(*board, r.part("id")); });

  http::Route replace =
      make("PUT", "/job-orders/{id}", "putJobOrder", "Store with If-None-Match: *; Update with If-Match", http::Scope::kJobs);
  replace.takes = "JobOrder";
  replace.parameters = {{"If-None-Match", "header", "*: a new order"},
                        {"If-Match", "header", "ETag of the order that is changed"},
                        {"Idempotency-Key", "header", "a repeated order with this key is the same job"},
                        {"start", "query", "false: Store", R"({"type":"boolean","default":true})"}};
  replace.answers = {with({201, "JobOrderAndState", "Stored"}, {"ETag", "Location"}),
                     with({200, "JobOrderAndState", "Updated"}, {"ETag"}), in_use,
                     http::problem_answer(412, "The job order is there already, or has another version"),
                     http::problem_answer(428, "Neither If-None-Match: * nor If-Match is given")};
  add(replace, [board, fill](const Request& r) { return put(*board, r, fill); });

  http::Route remove = make("DELETE", "/job-orders/{id}", "removeJobOrder",
                            "Cancel of a waiting job, Clear of one that is done", http::Scope::kJobs);
  remove.gives = "";
  remove.answers = {{204, "", "Removed"}, conflict};
  add(remove, [board](const Request& r) {
    const JobReply reply = board->jobs().remove(r.part("id"));
    if (!reply.ok()) throw refusal_of(reply);
    Response gone;
    gone.status = 204;
    gone.type = "";
    return gone;
  });

  http::Route verb = make("POST", "/job-orders/{id}/commands", "commandJob",
                          "Start, RevokeStart, Pause, Resume, Stop, Abort, Cancel, Clear", http::Scope::kJobs);
  verb.takes = "JobCommand";
  verb.answers = {with({202, "JobOrderAndState", "The command is taken; events tell its effect"}, {"ETag"}),
                  {204, "", "Removed (Cancel, Clear)"},
                  conflict};
  add(verb, [board](const Request& r) { return command(*board, r); });

  http::Route answer = make("GET", "/job-responses/{id}", "getJobResponse",
                            "State, progress and reply of a job; waits for its end with wait", http::Scope::kRead);
  answer.parameters = {{"wait", "query", "seconds", R"({"type":"number","minimum":0,"maximum":30})"},
                       {"Prefer", "header", "wait=SECONDS"}};
  answer.answers = {{200, "JobResponse", "As it is now"}};
  router.add_later(answer, [board](const Request& r, const http::Reply& reply) {
    const std::string id = r.part("id");
    const auto now = [board, id, scopes = r.scopes, reply](bool) {
      reply(response_of([&] { return job_response_data(*board, id, scopes); }));
    };
    const double seconds = wait_of(r);
    seconds > 0 ? board->wait(id, seconds, now) : now(true);
  });

  http::Route kept =
      make("GET", "/results", "listResults", "Replies that are kept, without the replies themselves", http::Scope::kRead);
  kept.parameters = pages;
  kept.parameters.push_back({"job", "query", "only of this job order"});
  kept.parameters.push_back({"request_hash", "query", "SHA-256 of the request's canonical JSON"});
  kept.answers = {{200, "Results", "A page"}};
  add(kept, [board](const Request& r) { return results(*board, r, ""); });

  http::Route equal = make("POST", "/results/find", "findResults", "Results of requests equal to the body", http::Scope::kRead);
  equal.takes = "OrderRequest";
  equal.parameters = pages;
  equal.answers = {{200, "Results", "A page"}};
  add(equal, [board](const Request& r) {
    Json request = object_of(r.body);
    must_settle(request);
    return results(*board, r, request.dump());
  });

  http::Route result = make("GET", "/results/{number}", "getResult", "A result with its reply", http::Scope::kRead);
  result.parameters = {{"number", "path", "Number of the result", R"({"type":"integer","minimum":1})"}};
  result.answers = {{200, "Result", "It"}};
  add(result, [board](const Request& r) {
    const std::optional<long long> number = text::parse_integer(r.part("number"));
    const std::optional<Result> found = number ? board->jobs().result(*number) : std::nullopt;
    if (!found) throw refusal(404, "there is no result " + r.part("number").substr(0, 40));
    return give_text(result_text(*found));
  });

  http::Route events = make("GET", "/events", "watchJobs", "Changes of all jobs as server-sent events; Last-Event-ID continues",
                            http::Scope::kRead);
  events.gives = "text/event-stream";
  events.ticket = true;
  events.slow = false;
  events.parameters = {{"Last-Event-ID", "header", "id of the last event that was received"}};
  events.answers = {{200, "", "Changes of jobs, as long as the client listens", "text/event-stream"}};
  events.messages = {{"job", "JobEvent", "A change; the event's id is the version of the job, progress has none"},
                     {"resync", "Nothing", "Events were lost: list the jobs again"},
                     {"heartbeat", "Nothing", "There were no others for a while"}};
  router.add(events, [board](const Request& r) {
    const std::string* const last = r.field("Last-Event-ID");
    Response response;
    response.stream = [board, id = last == nullptr ? std::string() : *last](const std::shared_ptr<http::Stream>& stream) {
      board->watch(stream, id);
    };
    return response;
  });
}

}  // namespace cotwin::gateway
