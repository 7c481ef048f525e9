// Who may change a running twin, and who did it, as a plant's security officer sees it: the program, its log and its files.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "tests/components/gateway/gateway_program.h"
#include "tests/support/files.h"
#include "tests/support/mosquitto.h"
#include "tests/support/mqtt_client.h"
#include "tests/support/places.h"

namespace access_program_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::Gateway;
using cotwin::testing::has;
using cotwin::testing::http_call;
using cotwin::testing::rewrite_secret;
using cotwin::testing::run_command;
using cotwin::testing::RunResult;
using cotwin::testing::SecretFile;
using cotwin::testing::TemporaryFolder;
using cotwin::testing::within_patience;
using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;

const fs::path kScenario = fs::path(cotwin::places::source()) / "tests/components/gateway/openapi.ssd";

std::string bearer(const std::string& token) { return "Authorization: Bearer " + token + "\r\n"; }

std::vector<json> audit_of(const fs::path& folder) {
  std::vector<json> lines;
  std::ifstream in(folder / "audit.jsonl");
  for (std::string line; std::getline(in, line);) lines.push_back(json::parse(line));
  return lines;
}

TEST(AccessToARun, IsByNameAndKeptInItsRecord) {
  const TemporaryFolder folder("access");
  const SecretFile tokens(
      "tune 0123456789abcdef-anna name=anna\nend 0123456789abcdef-chief name=chief\njobs 0123456789abcdef-plan "
      "name=planner\nread 0123456789abcdef-read\n");
  Gateway gateway = Gateway::in_run(kScenario, folder.path(), {"tokens=" + tokens.path()});
  const std::string anna = bearer("0123456789abcdef-anna"), chief = bearer("0123456789abcdef-chief"),
                    read = bearer("0123456789abcdef-read");
  ASSERT_TRUE(within_patience([&] { return gateway.call("GET", "/run", "", read).status == 200; }));
  const auto may = [&](const std::string& who) { return json::parse(gateway.call("GET", "/run", "", who).body)["may"].dump(); };
  EXPECT_EQ(may(anna), R"(["read","tune"])");
  EXPECT_EQ(may(chief), R"(["read","end"])");
  EXPECT_EQ(may(read), R"(["read"])");
  const auto command = [&](const std::string& body, const std::string& who) {
    return gateway.call("POST", "/run/commands", body, who).status;
  };
  EXPECT_EQ(gateway.call("PUT", "/run/tunables/drive.B[2]", R"({"value":1.5})", anna).status, 200);
  EXPECT_EQ(command(R"({"command":"set","values":{"drive.B[1]":1.25}})", anna), 200);
  EXPECT_EQ(command(R"({"command":"pause"})", anna), 200);
  EXPECT_EQ(command(R"({"command":"resume"})", anna), 200);
  const std::string move = R"({"robot":"lwr4","from_q_rad":[0,-0.9,0,1.2,0,0.6,0],"to_q_rad":[1.2,0.9,0,-1.2,0,-0.6,0]})";
  const std::string async = "Prefer: respond-async, wait=0\r\n";
  EXPECT_EQ(gateway.call("POST", "/services/feasibility", move, async + anna).status, 403);
  EXPECT_LT(gateway.call("POST", "/services/feasibility", move, async + bearer("0123456789abcdef-plan")).status, 300);
  EXPECT_EQ(command(R"({"command":"stop"})", anna), 403);
  EXPECT_EQ(command(R"({"command":"pause"})", chief), 403);
  EXPECT_EQ(gateway.call("PUT", "/run/tunables/drive.B[2]", R"({"value":2})", read).status, 403);
  EXPECT_EQ(gateway.call("PUT", "/run/tunables/drive.B[2]", R"({"value":2})", bearer("0123456789abcdef-nobody")).status, 401);
  // The chief's token is taken back while the run goes on, and given again.
  rewrite_secret(tokens.path(), "tune 0123456789abcdef-anna name=anna");
  ASSERT_TRUE(within_patience([&] { return gateway.call("GET", "/run", "", chief).status == 401; }));
  EXPECT_EQ(command(R"({"command":"stop"})", chief), 401);
  rewrite_secret(tokens.path(), "tune 0123456789abcdef-anna name=anna\nend 0123456789abcdef-other name=chief");
  const std::string other = bearer("0123456789abcdef-other");
  ASSERT_TRUE(within_patience([&] { return gateway.call("GET", "/run", "", other).status == 200; }));
  EXPECT_EQ(command(R"({"command":"stop"})", other), 200);
  const RunResult ended = gateway.process().wait();
  EXPECT_EQ(ended.code, 0);

  const json outside = json::parse(content(folder.path() / "run.json"))["from_outside"];
  EXPECT_EQ(outside["changes"][0]["name"], "drive.B[2]");
  EXPECT_EQ(outside["changes"][0]["by"], "anna");
  EXPECT_EQ(outside["others"].size(), 1u);
  EXPECT_EQ(outside["others"][0]["what"], "POST /services/feasibility");
  EXPECT_EQ(outside["others"][0]["by"], "planner");
  std::string commands;
  for (const json& one : outside["commands"])
    commands += one["command"].get<std::string>() + " " + one["by"].get<std::string>() + "; ";
  EXPECT_EQ(commands, "pause anna; resume anna; stop chief; ");
  std::string kept;
  for (const json& line : audit_of(folder.path())) {
    if (line.contains("status") && line["status"] != 401)
      kept += line.value("by", "-") + " " + line.value("body", "-") + " " + line["status"].dump() + "\n";
  }
  EXPECT_THAT(kept, HasSubstr("anna {\"value\":1.5} 200\nanna {\"command\":\"set\",\"values\":{\"drive.B[1]\":1.25}} 200\n"));
  EXPECT_THAT(kept, HasSubstr("anna {\"command\":\"stop\"} 403\nchief {\"command\":\"pause\"} 403\ntoken "));
  EXPECT_THAT(kept, ::testing::EndsWith("chief {\"command\":\"stop\"} 200\n"));
  EXPECT_THAT(ended.err,
              HasSubstr("cotwin: gateway: PUT /run/tunables/drive.B[2] {\"value\":1.5} by anna at 127.0.0.1: 200\n"));
  EXPECT_THAT(ended.err, HasSubstr("cotwin: gateway: wrong token or ticket from 127.0.0.1\n"));
  EXPECT_THAT(ended.err, HasSubstr("cotwin: gateway: read again: " + tokens.path() + ", 1 token\n"));
  EXPECT_THAT(ended.err + kept, Not(HasSubstr("0123456789abcdef-"))) << "tokens appear nowhere";
}

TEST(AccessToARun, IsForItsUserAloneOnThisMachineUnlessAllAreNamed) {
  if (::getuid() != 0 || !has("setpriv") || !has("curl")) GTEST_SKIP() << "needs root, setpriv and curl to act as another user";
  const TemporaryFolder folder("access");
  const auto as = [](const Gateway& gateway, const char* user, std::vector<std::string> more) {
    std::vector<std::string> command = {"setpriv", std::string("--reuid=") + user, "--clear-groups", "curl", "-s", "--max-time",
                                        "60"};
    const std::string target = "http://localhost:" + std::to_string(gateway.port()) + more.front();
    command.insert(command.end(), more.begin() + 1, more.end());
    command.push_back(target);
    return run_command(std::move(command)).out;
  };
  const std::vector<std::string> put = {"/run/tunables/drive.B", "-X", "PUT", "-H", "Content-Type: application/json", "-d",
                                        R"({"value":1.5})"};
  {
    Gateway gateway = Gateway::in_run(kScenario, folder.path());
    ASSERT_TRUE(within_patience([&] { return gateway.call("GET", "/run").status == 200; }));
    EXPECT_EQ(json::parse(as(gateway, "12345", {"/run"}))["may"].dump(), R"(["read"])");
    EXPECT_THAT(
        as(gateway, "12345", put),
        HasSubstr("only the user who runs this gateway, and root, may do this, and this connection is of local user 12345"));
    EXPECT_THAT(as(gateway, "12345", {"/services/feasibility", "-H", "Content-Type: application/json", "-d", "{}"}),
                HasSubstr("422"))
        << "asking is reading";
    EXPECT_THAT(as(gateway, "12345", {"/job-orders", "-H", "Content-Type: application/json", "-d", "{}"}), HasSubstr("403"));
    EXPECT_THAT(as(gateway, "0", put), HasSubstr("\"set\""));
    gateway.process().signal(SIGHUP);
    EXPECT_EQ(gateway.process().wait().code, 128 + SIGHUP) << "SIGHUP ends a run in order";
    EXPECT_EQ(json::parse(content(folder.path() / "run.json"))["from_outside"]["changes"][0]["by"], "local user 0");
  }
  Gateway all = Gateway::in_run(kScenario, folder.path(), {"local_writes=all"});
  ASSERT_TRUE(within_patience([&] { return all.call("GET", "/run").status == 200; }));
  EXPECT_THAT(as(all, "12345", put), HasSubstr("\"set\""));
  EXPECT_EQ(audit_of(folder.path()).back()["by"], "local user 12345");
}

TEST(AccessToARun, OverABrokerIsTheBrokers) {
  if (cotwin::testing::mosquitto_program().empty()) GTEST_SKIP() << "needs mosquitto";
  const TemporaryFolder folder("access"), place("broker");
  cotwin::testing::Mosquitto broker(place.path());
  ASSERT_TRUE(broker.start());
  cotwin::testing::MqttClient client(broker.port(), "line");
  Gateway gateway = Gateway::in_run(kScenario, folder.path(), {"mqtt=" + broker.url()});
  ASSERT_TRUE(client.next("cotwin/run", "running"));
  for (const char* order :
       {R"({"command":"set","values":{"drive.B[3]":1.25}})", R"({"command":"fly"})", R"({"command":"stop"})"})
    client.send("cotwin/commands", order);
  EXPECT_EQ(gateway.process().wait().code, 0);
  const json outside = json::parse(content(folder.path() / "run.json"))["from_outside"];
  EXPECT_EQ(outside["changes"][0]["by"], "mqtt");
  EXPECT_EQ(outside["commands"][0]["by"], "mqtt");
  std::string kept;
  for (const json& line : audit_of(folder.path())) {
    if (line.contains("status"))
      kept += line.value("by", "-") + " " + line.value("what", "-") + " " + line["status"].dump() + "; ";
  }
  EXPECT_EQ(kept, "mqtt command 200; mqtt command 422; mqtt command 200; ");
}

}  // namespace
}  // namespace access_program_test
