// cotwin serve as users start it: the API against its own description, jobs, TLS, hostile bodies, and the clients of examples/12_mes.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "tests/components/gateway/gateway_program.h"
#include "tests/support/files.h"
#include "tests/support/http_client.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace program_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::Gateway;
using cotwin::testing::has;
using cotwin::testing::http_call;
using cotwin::testing::http_request;
using cotwin::testing::HttpReply;
using cotwin::testing::Process;
using cotwin::testing::RawClient;
using cotwin::testing::run_command;
using cotwin::testing::run_program;
using cotwin::testing::RunOptions;
using cotwin::testing::RunResult;
using cotwin::testing::start_program;
using cotwin::testing::TemporaryFolder;
using cotwin::testing::within_patience;
using nlohmann::json;
using ::testing::HasSubstr;

const std::string kMove = R"("robot":"lwr4","from_q_rad":[0,-0.9,0,1.2,0,0.6,0],"to_q_rad":[1.2,0.9,0,-1.2,0,-0.6,0])";
const std::string kSearch = R"({"service":"optimise",)" + kMove +
                            R"(,"T_min_s":2.0,"degree":7,"cost":"torque","particles":16,"rounds":5,"refine":false})";

/// The response to a job after its end, which may take minutes on a loaded machine.
json ended(const Gateway& gateway, const std::string& id) {
  json response;
  for (int i = 0; i < 10; ++i) {
    response = gateway.get("/job-responses/" + id + "?wait=30");
    if (response["JobState"][0]["StateNumber"] >= 5) break;
  }
  return response;
}

std::string order(const std::string& id) {
  return json{{"JobOrderID", id}, {"JobOrderParameters", {{{"ID", "Request"}, {"Value", json::parse(kSearch)}}}}}.dump();
}

/// Checks every "$ref" below a value, and that "required" members of object schemas with properties are among them.
void check_schema(const json& value, const json& document, const std::string& place) {
  if (value.is_object()) {
    if (value.contains("$ref") && value["$ref"].is_string()) {
      const std::string reference = value["$ref"];
      ASSERT_TRUE(reference.starts_with("#/components/schemas/")) << place << ' ' << reference;
      EXPECT_TRUE(document.contains(json::json_pointer(reference.substr(1)))) << place << ' ' << reference;
    }
    if (value.contains("required") && value["required"].is_array() && value.contains("properties")) {
      for (const json& name : value["required"]) EXPECT_TRUE(value["properties"].contains(name)) << place << ' ' << name;
    }
  }
  if (!value.is_structured()) return;
  for (const auto& [key, member] : value.items()) check_schema(member, document, place + "/" + key);
}

TEST(ServeCommand, DescribesEachOfItsRoutesAndNothingElse) {
  const TemporaryFolder folder("serve");
  const Gateway gateway(folder.path());
  const json document = gateway.get("/openapi.json");
  EXPECT_EQ(document["openapi"], "3.1.1");
  EXPECT_TRUE(document["info"].contains("title") && document["info"].contains("version"));
  std::set<std::string> ids;
  for (const auto& [path, operations] : document["paths"].items()) {
    for (const auto& [method, operation] : operations.items()) {
      const std::string place = method + " " + path;
      EXPECT_TRUE(ids.insert(operation["operationId"]).second) << place;
      EXPECT_FALSE(operation["responses"].empty()) << place;
      for (const auto& [status, answer] : operation["responses"].items())
        EXPECT_TRUE(answer.contains("description")) << place << ' ' << status;
      // Each {part} is a parameter, and each parameter of the path a part.
      std::size_t parts = 0;
      for (const json& parameter : operation.value("parameters", json::array())) {
        if (parameter["in"] != "path") continue;
        ++parts;
        EXPECT_TRUE(parameter["required"]) << place;
        EXPECT_THAT(path, HasSubstr("{" + parameter["name"].get<std::string>() + "}"));
      }
      EXPECT_EQ(parts, static_cast<std::size_t>(std::count(path.begin(), path.end(), '{'))) << place;
      // The route exists: another answer than 404 and 405 for the path, or 404 by its handler, which names the thing.
      if (method != "get" || path == "/events") continue;
      std::string target = path;
      while (target.find('{') != std::string::npos)
        target.replace(target.find('{'), target.find('}') - target.find('{') + 1, "lwr4");
      if (path.find("work-masters/{") != std::string::npos) target = "/work-masters/feasibility";
      const HttpReply reply = gateway.call("GET", target);
      EXPECT_THAT(reply.body, ::testing::Not(HasSubstr("expected one of the paths in /openapi.json"))) << target;
      EXPECT_TRUE(operation["responses"].contains(std::to_string(reply.status)) || reply.status == 404)
          << target << ' ' << reply.body;
    }
  }
  for (const char* path :
       {"/health", "/services/{name}", "/job-orders/{id}/commands", "/job-responses/{id}", "/results", "/events"})
    EXPECT_TRUE(document["paths"].contains(path)) << path;
  check_schema(document, document, "");
  const json masters = gateway.get("/work-masters");
  for (const json& master : masters["WorkMasters"]) {
    EXPECT_EQ(gateway.get("/work-masters/" + master["ID"].get<std::string>()), master);
    EXPECT_EQ(master["RequestSchema"].value("type", ""), "object") << master["ID"];
  }
}

TEST(ServeCommand, AnswersEachPathAsItsDocumentSays) {
  if (run_command({"python3", "-c", "import jsonschema"}).code != 0) GTEST_SKIP() << "needs python3-jsonschema";
  const TemporaryFolder folder("serve");
  const fs::path tests = fs::path(cotwin::places::source()) / "tests/components/gateway";
  const std::string tokens = folder.path() / "tokens";
  std::string lines;
  for (const std::string scope : {"read", "jobs", "tune", "acknowledge", "end", "operate"})
    lines += scope + " 0123456789abcdef-" + scope + "\n";
  std::ofstream(tokens) << lines;
  fs::permissions(tokens, fs::perms(0600));
  fs::create_directories(folder.path() / "run");
  const Gateway run = Gateway::in_run(tests / "openapi.ssd", folder.path() / "run");
  const Gateway closed(folder.path() / "closed", {"--token-file", tokens});
  const Gateway plain(folder.path() / "plain", {"--no-jobs"});
  std::vector<std::string> command = {"python3", tests / "openapi.py"};
  for (const Gateway* gateway : {&run, &closed, &plain}) command.push_back(std::to_string(gateway->port()));
  const RunResult result = run_command(std::move(command));
  EXPECT_EQ(result.code, 0) << result.out << result.err;
}

// State, tariff and nearness come from the run and the configuration, and are stored: what happens later does not change the answer.
TEST(ServeCommand, FillsTheContextOfOrdersFromItsRun) {
  const TemporaryFolder folder("context");
  const fs::path scenario = fs::path(cotwin::places::source()) / "tests/components/gateway/openapi.ssd";
  const Gateway gateway =
      Gateway::in_run(scenario, folder.path(), {"persons=drive.B[1]", "price_per_kWh=0.25", "co2_per_kWh=0.4"});
  ASSERT_TRUE(within_patience([&] { return gateway.call("GET", "/run").status == 200; }));
  const auto set_distance = [&](double d) {
    EXPECT_EQ(gateway.call("PUT", "/run/tunables/drive.B[1]", "{\"value\": " + std::to_string(d) + "}").status, 200);
  };
  const std::string to = R"("robot": "lwr4", "to_q_rad": [0.6, 0.4, 0, -0.7, 0, -0.6, 0])";
  const auto order = [&](const std::string& id, const std::string& request) {
    const HttpReply reply =
        gateway.call("POST", "/job-orders",
                     R"({"JobOrderID": ")" + id + R"(", "JobOrderParameters": [{"ID": "Request", "Value": )" + request + "}]}");
    EXPECT_EQ(reply.status, 201) << reply.body;
    return json::parse(reply.body)["JobOrder"]["JobOrderParameters"][0]["Value"];
  };
  const auto reply_of = [&](const std::string& id) {
    const json response = gateway.get("/job-responses/" + id + "?wait=30");
    for (const json& item : response["JobResponseData"])
      if (item["ID"] == "Reply") return item["Value"];
    return json();
  };
  const std::string fastest = R"({"goal": "fastest", )" + to + "}",
                    cheapest = R"({"goal": "cheapest", "detail": "verdict", )" + to + "}";
  const json away = order("away", fastest);
  ASSERT_EQ(away["from_q_rad"].size(), 7u) << away;
  EXPECT_NEAR(away["from_q_rad"][1].get<double>(), 0, 0.01);  // the robot sinks a little
  EXPECT_EQ(away["choice"], json::parse(R"({"persons": "away", "row": "duration"})"));
  const json first = reply_of("away");
  set_distance(1.5);
  EXPECT_EQ(order("near", fastest)["choice"], json::parse(R"({"persons": "near", "row": "beside_persons"})"));
  EXPECT_EQ(reply_of("near")["choice"]["service"], "safety");
  // The stored order once more.
  order("again", away.dump());
  EXPECT_EQ(reply_of("again"), first);
  // A client that knows better counts.
  EXPECT_EQ(order("told", R"({"person_m": 7, "goal": "fastest", )" + to + "}")["choice"]["persons"], "away");
  // A chain has one context, and its key stands for what was sent.
  const std::string steps =
      R"({"JobOrderParameters": [{"ID": "Request", "Value": {"defaults": {"deadline": "2099-01-01T00:00:00Z", )" + to +
      R"(}, "steps": [{"goal": "fastest"}, {"goal": "possible", "T_s": "$1/T_s"}]}}]})";
  const HttpReply stored = gateway.call("POST", "/job-orders", steps, "Idempotency-Key: chain\r\n"),
                  repeated = gateway.call("POST", "/job-orders", steps, "Idempotency-Key: chain\r\n");
  EXPECT_EQ(stored.status, 201) << stored.body;
  EXPECT_EQ(repeated.status, 200) << repeated.body;
  const json chain = json::parse(stored.body)["JobOrder"]["JobOrderParameters"][0]["Value"];
  EXPECT_EQ(chain["steps"][0]["from_q_rad"], chain["steps"][1]["from_q_rad"]);
  EXPECT_EQ(chain["steps"][0]["choice"]["deadline_s"], chain["steps"][1]["choice"]["deadline_s"]);
  EXPECT_EQ(chain["steps"][1]["choice"]["persons"], "near");
  order("cost", cheapest);
  const json cost = reply_of("cost");
  EXPECT_NEAR(cost["price"].get<double>(), cost["energy_J"].get<double>() / 3.6e6 * 0.25, 1e-12);
  EXPECT_NEAR(cost["co2_kg"].get<double>(), cost["energy_J"].get<double>() / 3.6e6 * 0.4, 1e-12);
  set_distance(1e12);  // what a monitor has without anybody
  EXPECT_EQ(order("nobody", fastest)["choice"]["persons"], "unknown");
  // A service by its name gets nothing of this.
  EXPECT_EQ(
      order("plain",
            R"({"service": "reach", "robot": "lwr4", "poses": [{"p_m": [0.4, 0.2, 0.6], "quaternion_wxyz": [1, 0, 0, 0]}]})")
          .size(),
      3u);
  fs::create_directories(folder.path() / "wrong");
  const Gateway wrong = Gateway::in_run(scenario, folder.path() / "wrong", {"persons=drive.nothing"});
  ASSERT_TRUE(within_patience([&] { return wrong.call("GET", "/run").status == 200; }));
  const HttpReply refused = wrong.call("POST", "/services", fastest);
  EXPECT_EQ(refused.status, 422);
  EXPECT_THAT(refused.body, HasSubstr("drive.nothing")) << "what is configured and not there is not unknown";
}

TEST(ServeCommand, AnswersAsTheProgramDoes) {
  const TemporaryFolder folder("serve");
  Gateway gateway(folder.path(), {"--no-jobs"});
  const HttpReply reply = gateway.call("POST", "/services/feasibility", "{" + kMove + ",\"T_s\":1.6}");
  ASSERT_EQ(reply.status, 200) << reply.body;
  const RunResult asked = run_program(
      {"ask", "feasibility", "--from", "0,-0.9,0,1.2,0,0.6,0", "--to", "1.2,0.9,0,-1.2,0,-0.6,0", "--duration", "1.6"});
  EXPECT_EQ(json::parse(reply.body), json::parse(asked.out));
  EXPECT_EQ(gateway.call("POST", "/services/feasibility", "{" + kMove + ",\"T_s\":1.6}").body, reply.body) << "the same bytes";
  EXPECT_EQ(gateway.get("/robots/lwr4")["joints"].size(), 7u);
  EXPECT_EQ(gateway.call("GET", "/robots/..%2f..").status, 400);
  EXPECT_EQ(gateway.call("GET", "/robots/nobody").status, 404);
  EXPECT_EQ(gateway.call("POST", "/services/optimise", "{}").status, 501) << "needs jobs";
  EXPECT_EQ(gateway.call("GET", "/job-orders").status, 404) << "there are no jobs";
  gateway.process().signal(SIGTERM);
  EXPECT_EQ(gateway.process().wait().code, 128 + SIGTERM);
}

// Light, exit code, state of the job, row of the table and event are those of the reply, whoever asks, alone and as a chain.
TEST(ServeCommand, TellsOneVerdictEverywhere) {
  const TemporaryFolder folder("verdicts");
  Gateway gateway(folder.path());
  RawClient events(gateway.port());
  events.send(http_request("GET", "/events"));
  ASSERT_TRUE(events.receive_until("text/event-stream"));
  int number = 0;
  for (const auto& [light, own] :
       {std::pair{"amber", R"("service":"feasibility","T_s":2.5)"}, {"red", R"("service":"jerk","T_s":0.5)"}})
    for (const std::string require : {"", "amber", "green"}) {
      const bool met = require.empty() || (require == "amber" && std::string(light) == "amber");
      json request = json::parse("{" + kMove + "," + own + "}");
      if (!require.empty()) request["require"] = require;
      json chain{{"steps", {request}}};
      if (!require.empty()) {
        chain["steps"][0].erase("require");
        chain["require"] = require;
      }
      for (const json& each : {request, chain}) {
        const std::string where = each.dump(), id = "job" + std::to_string(++number);
        const RunResult table = [&] {
          std::ofstream(folder.path() / "tasks.json") << where;
          return run_program({"ask", "--file", folder.path() / "tasks.json", "--table", "csv"});
        }();
        EXPECT_EQ(table.code, met ? 0 : 1) << where;
        EXPECT_THAT(table.out, HasSubstr(std::string(",") + light)) << where;
        std::ofstream(folder.path() / "line.json") << R"({"id":"a","request":)" << where << "}\n";
        const json verdict = json::parse(
            run_command({"sh", "-c", cotwin::places::program() + " ask --worker <" + (folder.path() / "line.json").string()})
                .out)["reply"]["verdict"];
        EXPECT_EQ(verdict["light"], light);
        EXPECT_EQ(verdict.contains("unmet"), !met);
        const std::string order =
            json{{"JobOrderID", id}, {"JobOrderParameters", {{{"ID", "Request"}, {"Value", each}}}}}.dump();
        ASSERT_EQ(gateway.call("POST", "/job-orders", order).status, 201);
        const json done = ended(gateway, id), job = gateway.get("/job-orders/" + id);
        EXPECT_EQ(job["Light"], light) << job;
        EXPECT_EQ(job["State"][0]["StateText"], met ? "Ended" : "Aborted") << where;
        EXPECT_EQ(job["JobResult"], met ? "Successful" : "Unsuccessful");
        for (const json& item : done["JobResponseData"]) {
          if (item["ID"] == "Light") {
            EXPECT_EQ(item["Value"], light);
          } else if (item["ID"] == "Reply") {
            EXPECT_EQ(item["Value"]["verdict"], verdict);
          } else if (item["ID"] == "ReasonForStateChange" && !met) {
            EXPECT_EQ(item["Value"], verdict["unmet"]);
          }
        }
        const std::string state = met ? R"("Ended","StateNumber":5}],"JobResult":"Successful")"
                                      : R"("Aborted","StateNumber":6}],"JobResult":"Unsuccessful")";
        ASSERT_TRUE(events.receive_until(R"({"JobOrderID":")" + id +
                                         R"(","Change":"state","State":[{"BrowsePath":null,"StateText":)" + state +
                                         R"(,"Progress":1.0,"Light":")" + light + "\""));
        if (each.contains("steps")) continue;
        EXPECT_EQ(json::parse(gateway.call("POST", "/services/" + each["service"].get<std::string>(), where).body)["verdict"],
                  verdict);
        const std::string with = "{" + kMove + "," + own + "}";
        std::vector<std::string> command{"ask", each["service"], "--with", with};
        if (!require.empty()) command.insert(command.end(), {"--require", require});
        const RunResult asked = run_program(command);
        EXPECT_EQ(asked.code, met ? 0 : 1) << asked.err;
        EXPECT_EQ(json::parse(asked.out)["verdict"], verdict);
      }
    }
}

TEST(ServeCommand, FillsJobOrdersWithThePostureOfTheRun) {
  const TemporaryFolder folder("serve");
  const Gateway gateway(folder.path());
  const HttpReply reply =
      gateway.call("POST", "/job-orders",
                   R"({"JobOrderParameters":[{"ID":"Request","Value":{"service":"feasibility","from":"run","from_q":[1]}}]})");
  EXPECT_EQ(reply.status, 422) << reply.body;
  EXPECT_THAT(reply.body, HasSubstr("is given beside from_q, expected one of the two"));
  EXPECT_EQ(json::parse(reply.body)["pointer"], "/JobOrderParameters/0/Value/from");
}

TEST(ServeCommand, RefusesAParameterOfAJobOrderThatIsGivenTwice) {
  const TemporaryFolder folder("serve");
  const Gateway gateway(folder.path());
  const json request{{"ID", "Request"}, {"Value", json::parse(kSearch)}};
  const auto parameter = [](const char* id, const json& value) { return json{{"ID", id}, {"Value", value}}; };
  for (const json& more :
       {request, parameter("Deadline", "2099-01-01T00:00:00Z"), parameter("TimeLimit", 60), parameter("Reuse", true)}) {
    const json body{{"JobOrderParameters", {request, more, more}}};
    const HttpReply reply = gateway.call("POST", "/job-orders", body.dump());
    const std::string id = more["ID"];
    EXPECT_EQ(reply.status, 422) << reply.body;
    EXPECT_EQ(json::parse(reply.body)["detail"], "'" + id + "' is given twice, expected it once");
    EXPECT_EQ(json::parse(reply.body)["pointer"], "/JobOrderParameters/" + std::string(id == "Request" ? "1" : "2") + "/ID");
  }
  EXPECT_EQ(gateway.get("/job-orders")["JobOrders"].size(), 0u);
}

TEST(ServeCommand, RefusesWhatCanNeverBeAnsweredBeforeItIsAJob) {
  const TemporaryFolder folder("serve");
  const Gateway gateway(folder.path());
  const auto changed = [](const char* removed, const json& change) {
    json request = json::parse(kSearch);
    request.erase(removed);
    request.update(change);
    return request;
  };
  struct Case {
    json request;
    std::string pointer;
  };
  const std::vector<Case> cases = {
      {{{"service", "optimise"}, {"robot", "planar2"}}, "/from_q_rad"},
      {changed("", {{"dq_mx", 1}}), "/dq_mx"},
      {changed("T_min_s", json::object()), ""},
      {changed("", {{"robot", "planar2"}}), "/from_q_rad"},
      {changed("", {{"robot", "nobody"}}), "/robot"},
      {changed("", {{"cost", {{{"name", "speed"}}}}}), "/cost/0/name"},
  };
  for (const Case& c : cases) {
    const std::string order = json{{"JobOrderParameters", {{{"ID", "Request"}, {"Value", c.request}}}}}.dump();
    for (const HttpReply& reply :
         {gateway.call("POST", "/job-orders", order), gateway.call("PUT", "/job-orders/a", order, "If-None-Match: *\r\n")}) {
      EXPECT_EQ(reply.status, 422) << reply.body;
      EXPECT_EQ(json::parse(reply.body)["pointer"], "/JobOrderParameters/0/Value" + c.pointer) << reply.body;
    }
    const HttpReply asked = gateway.call("POST", "/services/optimise", c.request.dump(), "Prefer: respond-async\r\n");
    EXPECT_EQ(asked.status, 422) << asked.body;
    EXPECT_EQ(json::parse(asked.body).value("pointer", ""), c.pointer) << asked.body;
  }
  EXPECT_EQ(gateway.get("/job-orders")["JobOrders"].size(), 0u);
  // A search that takes its time is stored at once.
  EXPECT_EQ(gateway.call("POST", "/job-orders?start=false", order("a")).status, 201);
}

TEST(ServeCommand, NamesWhatIsWrongInABody) {
  const TemporaryFolder folder("serve");
  const Gateway gateway(folder.path(), {"--no-jobs"});
  struct Case {
    std::string body;
    int status;
    const char* pointer;
  };
  std::string many = "0", members = "\"\":0";
  for (int i = 1; i < 100'000; ++i) many += ",0";
  for (int i = 1; i < 5000; ++i) members += ",\"" + std::to_string(i) + "\":0";
  const std::vector<Case> cases = {
      {"", 415, ""},
      {"[]", 400, ""},
      {"{", 400, ""},
      {"{}{}", 400, ""},
      {"{\"a\":NaN}", 400, ""},
      {"{\"a\":1e999}", 400, ""},
      {"{\"a\":\"\xff\"}", 400, ""},
      {"{\"robot\":\"lwr4\",\"robot\":\"ur5e\"}", 400, ""},
      {"{\"a\":[" + many + "]}", 400, "/a/99998"},
      {"{\"a\":[{" + members + "}]}", 400, "/a/0"},
      {"{\"a\":" + std::string(100'000, '['), 400, ""},
      {"{\"a\":" + std::string(500, '[') + std::string(500, ']') + "}", 400, ""},
      {"{" + kMove + ",\"T_s\":\"1\"}", 422, "/T_s"},
      {"{" + kMove + ",\"T_s\":-1}", 422, ""},
      {"{" + kMove + ",\"speed\":1}", 422, "/speed"},
      {"{\"service\":\"energy\"," + kMove + "}", 422, "/service"},
      {"{\"robot\":\"../../etc\"}", 422, "/robot"},
      {"{\"robot\":\"/etc/passwd\"}", 422, "/robot"},
      {"{\"robot\":\"lwr4\",\"from_q_rad\":[0]}", 422, ""},
  };
  for (const Case& c : cases) {
    const HttpReply reply = gateway.call("POST", "/services/feasibility", c.body);
    EXPECT_EQ(reply.status, c.status) << c.body.substr(0, 100) << reply.body;
    const json problem = json::parse(reply.body, nullptr, false);
    ASSERT_TRUE(problem.is_object()) << reply.body;
    EXPECT_GT(problem.value("detail", "").size(), 5u) << reply.body;
    EXPECT_THAT(reply.body, ::testing::Not(HasSubstr("json.exception")));
    if (c.pointer[0] != 0) {
      EXPECT_EQ(problem.value("pointer", ""), c.pointer) << reply.body;
    }
  }
  EXPECT_EQ(gateway.get("/health")["status"], "ok");
}

TEST(ServeCommand, StaysSmallUnderAFlood) {
  const TemporaryFolder folder("serve");
  Gateway gateway(folder.path(), {"--no-jobs", "--connections", "64"});
  {
    // Bodies of 100 MB, half-open requests, and pipelined requests whose answers nobody reads.
    std::vector<std::unique_ptr<RawClient>> clients;
    const std::string big =
        "POST /services/feasibility HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: "
        "100000000\r\n\r\n";
    const std::string chunk(1 << 20, 'x');
    for (int i = 0; i < 8; ++i) {
      RawClient client(gateway.port());
      client.send(big);
      for (int k = 0; k < 100 && client.send(chunk); ++k) {
      }
    }
    std::string pipelined;
    for (int i = 0; i < 200; ++i) pipelined += http_request("GET", "/openapi.json");
    for (int i = 0; i < 80; ++i) {
      clients.push_back(std::make_unique<RawClient>(gateway.port(), 4096));
      if (i % 2 == 0)
        clients.back()->send("POST /services/feasibility HTTP/1.1\r\nHost: loc");
      else
        clients.back()->send(pipelined.substr(0, 16'000));
    }
    EXPECT_EQ(gateway.call("GET", "/health").status, 200) << "one that only waits for its client gives way";
  }
  EXPECT_TRUE(within_patience([&] { return gateway.call("GET", "/health").status == 200; })) << "it serves again";
  gateway.process().signal(SIGINT);
  const RunResult result = gateway.process().wait();
  EXPECT_EQ(result.code, 128 + SIGINT);
#if defined(__SANITIZE_ADDRESS__)
  constexpr long kMost = 700'000;  // KiB; the sanitizer keeps 256 MiB of freed memory
#else
  constexpr long kMost = 400'000;
#endif
  EXPECT_LT(result.memory, kMost) << "KiB; 8 bodies of 100 MB were refused before they were read";
}

TEST(ServeCommand, ControlsJobsByTheVerbsOfOpc10031) {
  const TemporaryFolder folder("serve");
  const Gateway gateway(folder.path());
  RawClient events(gateway.port());
  events.send(http_request("GET", "/events"));
  ASSERT_TRUE(events.receive_until("text/event-stream"));

  const HttpReply made = gateway.call("PUT", "/job-orders/a%2B1?start=false", order("a+1"), "If-None-Match: *\r\n");
  ASSERT_EQ(made.status, 201) << made.body;
  EXPECT_EQ(made.field("Location"), "/job-orders/a%2B1");
  EXPECT_EQ(json::parse(made.body)["State"][0]["StateText"], "NotAllowedToStart");
  EXPECT_EQ(json::parse(made.body)["State"][0]["StateNumber"], 1);
  EXPECT_EQ(gateway.call("PUT", "/job-orders/a%2B1", order("a+1"), "If-None-Match: *\r\n").status, 412);
  EXPECT_EQ(gateway.call("PUT", "/job-orders/a%2B1", order("a+1")).status, 428);
  EXPECT_EQ(gateway.call("PUT", "/job-orders/a%2B1", order("a+1"), "If-Match: \"0\"\r\n").status, 412);
  const HttpReply changed = gateway.call("PUT", "/job-orders/a%2B1", order("a+1"), "If-Match: " + made.field("ETag") + "\r\n");
  EXPECT_EQ(changed.status, 200) << changed.body;
  const auto command = [&](const std::string& verb) {
    return gateway.call("POST", "/job-orders/a%2B1/commands", json{{"Command", verb}}.dump());
  };
  const HttpReply wrong = command("Pause");
  EXPECT_EQ(wrong.status, 409) << wrong.body;
  EXPECT_EQ(json::parse(wrong.body)["ReturnStatus"], "8") << "bit 3: invalid job order status";
  EXPECT_EQ(command("Explode").status, 422);
  EXPECT_EQ(command("Start").status, 202);
  const json done = ended(gateway, "a%2B1");
  EXPECT_EQ(done["JobState"][0]["StateText"], "Ended") << done;
  ASSERT_TRUE(events.receive_until("\"StateText\":\"Ended\""));
  EXPECT_THAT(events.received(), HasSubstr("event: job\nid: "));

  // Kept, and found again by an equal request with other spacing and order of members.
  json request = json::parse(kSearch);
  const json found = json::parse(gateway.call("POST", "/results/find", request.dump(3)).body);
  ASSERT_EQ(found["Results"].size(), 1u) << found;
  const json result = gateway.get("/results/" + std::to_string(found["Results"][0]["Number"].get<int>()));
  for (const json& item : done["JobResponseData"]) {
    if (item["ID"] == "Reply") {
      EXPECT_EQ(item["Value"], result["Reply"]);
    }
  }
  // The same key is the same job; another request under it is refused.
  const std::string key = "Idempotency-Key: \"k1\"\r\n";
  EXPECT_EQ(gateway.call("POST", "/job-orders", order("b"), key).status, 201);
  EXPECT_EQ(gateway.call("POST", "/job-orders", order("b"), key).status, 200);
  EXPECT_EQ(gateway.call("POST", "/job-orders", order("c"), key).status, 422);
  EXPECT_EQ(gateway.call("POST", "/job-orders", order("d"), "Idempotency-Key: \"\"\r\n").status, 400);
  ended(gateway, "b");
  EXPECT_EQ(gateway.call("DELETE", "/job-orders/b").status, 204);
  const HttpReply gone = gateway.call("POST", "/job-orders", order("b"), key);
  EXPECT_EQ(gone.status, 410) << gone.body;
  EXPECT_EQ(json::parse(gone.body)["JobOrderID"], "b");
  EXPECT_EQ(gateway.call("GET", "/job-orders/nobody").status, 404);
  // The same for services, with and without the quotes of RFC 9651.
  const auto ask = [&](const std::string& with) {
    return gateway.call("POST", "/services/optimise", kSearch, "Idempotency-Key: " + with + "\r\n").field("Content-Location");
  };
  const std::string asked = ask("k2");
  EXPECT_THAT(asked, HasSubstr("/job-responses/job-"));
  EXPECT_EQ(ask("\"k2\""), asked);
  EXPECT_EQ(gateway.call("POST", "/services/optimise", kSearch, "Idempotency-Key: \"\"\r\n").status, 400);
  EXPECT_EQ(gateway.call("DELETE", "/job-orders/" + asked.substr(std::string("/job-responses/").size())).status, 204);
  EXPECT_EQ(gateway.call("POST", "/services/optimise", kSearch, "Idempotency-Key: k2\r\n").status, 410);
  // A kept result answers at once, also where the client would wait; another search takes its time.
  const HttpReply kept = gateway.call("POST", "/services/optimise", kSearch);
  EXPECT_EQ(kept.status, 200) << kept.body;
  request["rounds"] = 3000;
  const HttpReply later = gateway.call("POST", "/services/optimise", request.dump(), "Prefer: respond-async\r\n");
  EXPECT_EQ(later.status, 202) << later.body;
  EXPECT_EQ(later.field("Preference-Applied"), "respond-async");
  const json now = ended(gateway, later.field("Location").substr(std::string("/job-responses/").size()));
  EXPECT_EQ(now["JobState"][0]["StateText"], "Ended") << now;
  // Pages.
  const HttpReply page = gateway.call("GET", "/job-orders?limit=2&order=newest");
  EXPECT_EQ(json::parse(page.body)["JobOrders"].size(), 2u);
  ASSERT_THAT(page.field("Link"), HasSubstr("; rel=\"next\""));
  const std::string next = page.field("Link").substr(1, page.field("Link").find('>') - 1);
  EXPECT_EQ(gateway.get(next)["JobOrders"].size(), 1u) << next;
  EXPECT_EQ(gateway.call("GET", "/job-orders?limit=0").status, 400);
  EXPECT_EQ(gateway.call("GET", "/job-orders?cursor=x").status, 400);
  EXPECT_EQ(gateway.call("DELETE", "/job-orders/a%2B1").status, 204);
  EXPECT_EQ(gateway.call("GET", "/job-orders/a%2B1").status, 404);
  // A watcher that comes back gets what it missed, or learns that it cannot.
  const std::size_t id = events.received().find("id: ");
  const std::string first = events.received().substr(id + 4, events.received().find('\n', id) - id - 4);
  RawClient again(gateway.port());
  again.send(http_request("GET", "/events", "", "Last-Event-ID: " + first + "\r\n"));
  EXPECT_TRUE(again.receive_until("\"Change\":\"removed\""));
  RawClient lost(gateway.port());
  lost.send(http_request("GET", "/events", "", "Last-Event-ID: 999999\r\n"));
  EXPECT_TRUE(lost.receive_until("event: resync\n"));
}

TEST(ServeCommand, AsksWorkersWithItsOwnRobotsAndTellsResultsOfChangedFilesApart) {
  const TemporaryFolder folder("serve");
  const fs::path robots = folder.path() / "robots";
  fs::create_directories(robots);
  fs::copy(fs::path(cotwin::places::source()) / "models/robots/lwr4", robots / "own", fs::copy_options::recursive);
  json request = json::parse(kSearch);
  request.erase("robot");
  const auto answer = [&] {
    const Gateway gateway(folder.path() / "out", {"--robot", "own", "--robots", robots});
    const HttpReply reply = gateway.call("POST", "/services/optimise", request.dump());
    EXPECT_EQ(reply.status, 200) << reply.body;
    return gateway.get("/results")["Results"][0];
  };
  const json first = answer();
  EXPECT_THAT(first["Producer"].get<std::string>(), ::testing::MatchesRegex(".* [0-9a-f]{16}"));
  EXPECT_EQ(answer()["Reused"], true);
  std::set<std::string> hashes = {first["RobotHash"]};
  for (const char* file : {"robot.urdf", "drive_train.ssv", "compliance.ssv", "energy.ssv"}) {
    ASSERT_TRUE(fs::exists(robots / "own" / file)) << file;
    std::ofstream(robots / "own" / file, std::ios::app) << "<!-- changed -->\n";
    const json after = answer();
    EXPECT_EQ(after["Reused"], false) << file;
    EXPECT_TRUE(hashes.insert(after["RobotHash"]).second) << file;
  }
}

TEST(ServeCommand, KnowsTheBodyPartsOfPersonsAlsoWithOwnRobots) {
  const TemporaryFolder folder("serve");
  const fs::path robots = folder.path() / "robots";
  fs::create_directories(robots);
  fs::copy(fs::path(cotwin::places::source()) / "models/robots/lwr4", robots / "own", fs::copy_options::recursive);
  const Gateway gateway(folder.path() / "out", {"--robot", "own", "--robots", robots});
  const json request{{"from_q_rad", {0, -0.9, 0, 1.2, 0, 0.6, 0}}, {"to_q_rad", {1.2, 0.9, 0, -1.2, 0, -0.6, 0}}};
  const HttpReply now = gateway.call("POST", "/services/safety", request.dump());
  EXPECT_EQ(now.status, 200) << now.body;
  const HttpReply by_job = gateway.call("POST", "/services/safety", request.dump(), "Prefer: respond-async, wait=30\r\n");
  EXPECT_EQ(json::parse(by_job.body), json::parse(now.body));
  const RunResult asked = run_program({"ask", "safety", "--robot", "own", "--robots", robots, "--from", "0,-0.9,0,1.2,0,0.6,0",
                                       "--to", "1.2,0.9,0,-1.2,0,-0.6,0"});
  EXPECT_EQ(json::parse(asked.out), json::parse(now.body)) << asked.err;
}

TEST(ServeCommand, TakesOwnFoldersOfRobotsAndChoosesADefaultRobotOnlyWhereOneIsMeant) {
  const TemporaryFolder folder("serve");
  const fs::path source = fs::path(cotwin::places::source()) / "models/robots", first = folder.path() / "first",
                 second = folder.path() / "second", none = folder.path() / "none", out = folder.path() / "out";
  for (const fs::path& made : {first, second, none}) fs::create_directories(made);
  fs::copy(source / "planar2", first / "one", fs::copy_options::recursive);
  fs::copy(source / "lwr4/robot.urdf", second / "one.urdf");
  fs::copy(source / "planar2/robot.urdf", second / "two.urdf");
  {
    const Gateway gateway(out, {"--robots", first});
    json of_planar2{{"joints", 2}, {"drive_train.ssv", "assumed"}, {"compliance.ssv", "given"}, {"energy.ssv", "missing"}};
    EXPECT_EQ(gateway.get("/robots"), json({{"robots", {"one"}}, {"default", "one"}, {"data", {{"one", of_planar2}}}}));
    of_planar2.erase("joints");
    EXPECT_EQ(gateway.get("/robots/one")["data"], of_planar2);
  }
  {
    const Gateway gateway(out, {"--robots", first, "--robots", second});
    const json listed = gateway.get("/robots");
    EXPECT_EQ(listed["robots"], json({"one", "two"}));
    EXPECT_EQ(listed["default"], "");
    EXPECT_EQ(listed["data"]["two"]["drive_train.ssv"], "missing");
    EXPECT_EQ(gateway.get("/robots/one")["joints"].size(), 2u) << "the first folder counts";
    json request{{"service", "feasibility"}, {"from_q_rad", {0, 0}}, {"to_q_rad", {1, 1}}, {"T_s", 2}};
    const HttpReply unnamed = gateway.call("POST", "/services/feasibility", request.dump());
    EXPECT_EQ(unnamed.status, 422);
    EXPECT_EQ(json::parse(unnamed.body)["detail"], "is missing, expected the name of a robot");
    const auto order = [&] {
      return gateway.call("POST", "/job-orders?start=false",
                          json{{"JobOrderParameters", {{{"ID", "Request"}, {"Value", request}}}}}.dump());
    };
    EXPECT_EQ(json::parse(order().body)["pointer"], "/JobOrderParameters/0/Value/robot");
    request["robot"] = "two";
    EXPECT_EQ(order().status, 201);
    EXPECT_EQ(gateway.call("POST", "/services/feasibility", request.dump(), "Prefer: respond-async, wait=30\r\n").status, 200);
  }
  const auto error = [&](std::vector<std::string> options) {
    options.insert(options.begin(), {"serve", "--port", "0", "--seconds", "1", "--out", out});
    return run_program(options).err;
  };
  EXPECT_THAT(error({"--robots", first, "--robot", "lwr4"}), HasSubstr("--robot lwr4: robot: 'lwr4' is unknown"));
  EXPECT_THAT(error({"--robots", none}), HasSubstr("--robots " + none.string() + ": has no robot, expected"));
  EXPECT_THAT(error({"--robots", none / "x"}), HasSubstr("--robots " + (none / "x").string() + ": is not a folder, expected"));
}

TEST(ServeCommand, KeepsResultsThatOnlyReadersHaveSeen) {
  if (!has("python3")) GTEST_SKIP() << "needs python3";
  const TemporaryFolder folder("serve");
  const std::string tokens = folder.path() / "tokens", out = folder.path() / "out";
  std::ofstream(tokens) << "read 0123456789abcdef-read\noperate 0123456789abcdef-operate\n";
  fs::permissions(tokens, fs::perms(0600));
  const Gateway gateway(out, {"--token-file", tokens});
  const std::string reads = "Authorization: Bearer 0123456789abcdef-read\r\n",
                    operates = "Authorization: Bearer 0123456789abcdef-operate\r\n";
  ASSERT_EQ(gateway.call("POST", "/job-orders", order("a"), operates).status, 201);
  ASSERT_TRUE(within_patience(
      [&] { return gateway.call("GET", "/job-responses/a?wait=30", "", reads).body.find("\"Ended\"") != std::string::npos; }));
  const auto removable = [&] {
    const std::string look = "import sqlite3; print(sqlite3.connect('" + out +
                             "/jobs.sqlite').execute('SELECT removable FROM results').fetchone()[0])";
    return run_command({"python3", "-c", look}).out;
  };
  EXPECT_EQ(removable(), "0\n");
  EXPECT_EQ(gateway.call("GET", "/job-responses/a", "", operates).status, 200);
  EXPECT_EQ(removable(), "1\n");
}

TEST(ServeCommand, GivesRunningJobsBackToTheQueueWhenItEnds) {
  const TemporaryFolder folder("serve");
  json request = json::parse(kSearch);
  request["rounds"] = 100'000;
  request["particles"] = 2000;
  const std::string body =
      json{{"JobOrderID", "long"}, {"JobOrderParameters", {{{"ID", "Request"}, {"Value", request}}}}}.dump();
  {
    Gateway gateway(folder.path());
    ASSERT_EQ(gateway.call("POST", "/job-orders", body).status, 201);
    ASSERT_TRUE(within_patience([&] { return gateway.get("/job-orders/long")["State"][0]["StateText"] == "Running"; }));
    gateway.process().signal(SIGINT);
    EXPECT_EQ(gateway.process().wait().code, 128 + SIGINT);
  }
  const Gateway again(folder.path());
  const json job = again.get("/job-orders/long");
  EXPECT_THAT(job["State"][0]["StateText"], ::testing::AnyOf("Running", "AllowedToStart"));
  EXPECT_EQ(again.call("POST", "/job-orders/long/commands", R"({"Command":"Abort"})").status, 202);
  EXPECT_EQ(ended(again, "long")["JobState"][0]["StateText"], "Aborted");
}

TEST(ServeCommand, LeavesOneFolderAndSaysHowItsJobsGoOn) {
  const TemporaryFolder folder("serve");
  const fs::path out = folder.path() / "out";
  const auto serve = [&](const std::vector<std::string>& more = {}) {
    Gateway gateway(out, more);
    EXPECT_TRUE(within_patience([&] { return fs::exists(out / "signals.csv.part"); }));  // its run has begun
    gateway.process().signal(SIGTERM);
    return gateway.process().wait();
  };
  const auto folders = [&] {
    return std::count_if(fs::directory_iterator(out), fs::directory_iterator(), [](const auto& e) { return e.is_directory(); });
  };
  for (int restart = 0; restart < 3; ++restart) {
    const RunResult ended = serve();
    EXPECT_EQ(ended.code, 128 + SIGTERM);
    EXPECT_THAT(ended.err, HasSubstr("cotwin: jobs go on at the next cotwin serve --out " + out.string() + "\n"));
    EXPECT_THAT(ended.err, ::testing::Not(HasSubstr("--resume")));
    EXPECT_EQ(folders(), 0) << restart;
  }
  EXPECT_THAT(serve({"--no-jobs"}).err, ::testing::Not(HasSubstr("jobs go on")));
  // Results of another run are kept.
  std::ofstream(out / "run.json") << R"({"scenario": {"name": "arm", "file": "/home/anna/arm.ssd"}})";
  serve();
  EXPECT_EQ(folders(), 1);
  EXPECT_THAT(content(out / "earlier-1/run.json"), HasSubstr("anna"));
  int kept = 1;
  for (const char* odd : {R"({"scenario": {"file": 3}})", R"({"scenario": [1]})", "[]", "{", ""}) {
    std::ofstream(out / "run.json") << odd;
    EXPECT_EQ(serve().code, 128 + SIGTERM) << odd;
    EXPECT_EQ(folders(), ++kept) << odd;
  }
}

TEST(ServeCommand, TakesSettingsOfItsGatewayByTheirNames) {
  const TemporaryFolder folder("serve");
  const Gateway gateway(folder.path(), {"--no-jobs", "--set", "mqtt=mqtt://127.0.0.1:1", "--set", "gateway.mqtt_rate=7"});
  EXPECT_TRUE(within_patience([&] { return fs::exists(folder.path() / "run.json"); }));
  EXPECT_THAT(content(folder.path() / "run.json"), HasSubstr("gateway.mqtt=mqtt://127.0.0.1:1"));
  const RunResult wrong =
      run_program({"serve", "--port", "0", "--out", (folder.path() / "wrong").string(), "--set", "mqtt_rat=1"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("no variable and no setting 'mqtt_rat'"));
}

TEST(ServeCommand, DemandsTlsAndTokensBeyondLoopback) {
  if (!has("openssl") || !has("curl")) GTEST_SKIP() << "needs openssl and curl";
  const TemporaryFolder folder("serve");
  const std::string cert = folder.path() / "cert.pem", key = folder.path() / "key.pem", tokens = folder.path() / "tokens";
  ASSERT_EQ(
      run_command({"openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout",
                   key, "-out", cert, "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"})
          .code,
      0);
  std::ofstream(tokens) << "read 0123456789abcdef-read\noperate 0123456789abcdef-operate\n";
  for (const std::string& file : {key, tokens}) fs::permissions(file, fs::perms(0600));
  const RunResult open = run_program({"serve", "--address", "0.0.0.0", "--port", "0", "--out", folder.path() / "open"});
  EXPECT_EQ(open.code, 2);
  EXPECT_THAT(open.err,
              HasSubstr("0.0.0.0 can be reached from other machines, expected a certificate, a key and a file of tokens"));

  const RunResult named =
      run_program({"serve", "--address", "0.0.0.0", "--port", "0", "--out", folder.path() / "named", "--certificate", cert,
                   "--key", key, "--token-file", tokens, "--no-jobs", "--seconds", "0.1", "--host", "twin.example"});
  EXPECT_THAT(named.out, HasSubstr("gateway at https://twin.example:"));
  EXPECT_THAT(named.out, HasSubstr("clients may call it by the names localhost, 127.0.0.1, twin.example; --host adds names"));

  Gateway gateway(folder.path() / "out",
                  {"--address", "0.0.0.0", "--certificate", cert, "--key", key, "--token-file", tokens, "--no-jobs"});
  const std::string url = "https://localhost:" + std::to_string(gateway.port());
  EXPECT_EQ(gateway.url(), url) << "one that works";
  const auto curl = [&](std::vector<std::string> more) {
    std::vector<std::string> command = {"curl", "--silent", "--show-error", "--ipv4", "--cacert", cert, "--max-time", "60"};
    command.insert(command.end(), more.begin(), more.end());
    return run_command(std::move(command));
  };
  EXPECT_THAT(curl({url + "/health"}).out, HasSubstr("\"ok\""));
  EXPECT_THAT(curl({"--insecure", "https://127.0.0.1:" + std::to_string(gateway.port()) + "/health"}).out, HasSubstr("\"ok\""));
  EXPECT_THAT(curl({url + "/robots"}).out, HasSubstr("expected a token"));
  EXPECT_THAT(curl({"-H", "Authorization: Bearer 0123456789abcdef-read", url + "/robots"}).out, HasSubstr("lwr4"));
  EXPECT_THAT(curl({"-H", "Authorization: Bearer 0123456789abcdef-wrong", url + "/robots"}).out,
              HasSubstr("not one of the gateway's"));
  EXPECT_NE(curl({"--tls-max", "1.1", url + "/health"}).code, 0) << "TLS 1.1";
  EXPECT_EQ(curl({"--tlsv1.2", "--tls-max", "1.2", url + "/health"}).code, 0);
  EXPECT_NE(curl({"--tlsv1.2", "--tls-max", "1.2", "--ciphers", "AES128-SHA", url + "/health"}).code, 0)
      << "no forward secrecy";
  EXPECT_THAT(http_call(gateway.port(), "GET", "/health").body, HasSubstr("this port expects TLS"));
  // A refusal is received by a client that is still sending.
  std::ofstream(folder.path() / "body") << std::string(900'000, 'x');
  for (int i = 0; i < 5; ++i)
    EXPECT_THAT(curl({"-H", "Authorization: Bearer 0123456789abcdef-read", "-H", "Expect:", "-H", "Content-Type: text/plain",
                      "--data-binary", "@" + (folder.path() / "body").string(), url + "/services/feasibility"})
                    .out,
                HasSubstr("expected a body with Content-Type: application/json"));
  RawClient damaged(gateway.port());
  damaged.send(std::string("\x16\x03\x01\xff\xff", 5) + std::string(70'000, 'x'));
  EXPECT_TRUE(damaged.ended());
  EXPECT_EQ(curl({url + "/health"}).code, 0) << "it is still there";
  gateway.process().signal(SIGINT);
  const RunResult result = gateway.process().wait();
  EXPECT_EQ(result.code, 128 + SIGINT);
  // Tokens appear nowhere.
  EXPECT_THAT(result.out + result.err, ::testing::Not(HasSubstr("0123456789abcdef-")));
  for (const auto& entry : fs::recursive_directory_iterator(folder.path() / "out")) {
    if (!entry.is_regular_file()) continue;
    EXPECT_THAT(content(entry.path()), ::testing::Not(HasSubstr("0123456789abcdef-"))) << entry.path();
  }
}

TEST(ServeCommand, IsNoPartOfAnFmu) {
  const TemporaryFolder folder("serve");
  const RunResult packed = run_program({"pack", "unit:gateway", "--out", folder.path() / "gateway.fmu"});
  EXPECT_NE(packed.code, 0);
  EXPECT_THAT(packed.err, HasSubstr("cannot be part of an FMU"));
}

TEST(MesExample, ClientsAskChooseRunWatchAndCompare) {
  if (!has("python3") || !has("curl")) GTEST_SKIP() << "needs python3 and curl";
  const TemporaryFolder folder("mes");
  RunOptions options;
  options.environment = {"COTWIN=" + cotwin::places::program(), "OUT=" + folder.path().string(), "PORT=0"};
  const RunResult result = run_command({fs::path(cotwin::places::source()) / "examples/12_mes/run.sh"}, options);
  ASSERT_EQ(result.code, 0) << result.out << result.err;
  const json report = json::parse(content(folder.path() / "report.json"));
  // The rigid prediction and the run with flexible joints differ by the dynamics of the joints and of the controller.
  EXPECT_LT(report["prediction_error"].get<double>(), 0.05) << report;
  EXPECT_GT(report["saved_share"].get<double>(), 0.05) << report;
  EXPECT_LT(report["miss_rad"].get<double>(), 0.02) << report;
  EXPECT_NEAR(report["largest_payload_kg"].get<double>(), 9.28, 0.01) << report;
  EXPECT_THAT(result.out, HasSubstr("job better-"));
  // The order without a service, in two steps: the operator and the planner get the figures of the services.
  const json& brief = report["told"]["operator"];
  EXPECT_EQ(brief["light"], "amber");
  EXPECT_EQ(brief["sentence"],
            "The move takes 1.98 s at least, which makes 1815 moves per hour; not measured: inertia of motors and 2 more.");
  EXPECT_EQ(
      brief["steps"][1]["reply"]["sentence"],
      "The move takes 1.98 s and needs 307 J, which costs 0.0256 per 1000 moves; not measured: inertia of motors and 3 more.");
  const json& steps = report["told"]["planner"]["steps"];
  EXPECT_EQ(steps[0]["reply"]["choice"]["row"], "duration");
  EXPECT_EQ(steps[1]["reply"]["choice"]["row"], "cost");
  EXPECT_NEAR(steps[0]["reply"]["figures"][0]["value"].get<double>(), 1.983, 0.001);
  EXPECT_EQ(steps[0]["reply"]["figures"][0]["value"], steps[1]["reply"]["figures"][0]["value"]);
}

}  // namespace
}  // namespace program_test
