#include "components/gateway/run_side.h"

#include <unistd.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "components/gateway/api/api.h"
#include "components/gateway/api/catalogue.h"
#include "components/gateway/api/json_tools.h"
#include "components/gateway/http/audited.h"
#include "components/gateway/http/problem.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway {

namespace {

constexpr const char* kCommand = "command";  // over MQTT, in the audit

mqtt::PlantReply reply_of(const http::Refusal& refused) {
  const http::Response response = http::to_response(refused.problem, refused.fields);
  return {response.status, response.body};
}

mqtt::PlantReply problem(int status, const std::string& detail) {
  return reply_of(http::Refusal{{status, detail, "", ""}, {}});
}

}  // namespace

void RunSide::declare(Variables& v) {
  v.parameter("mqtt", broker_, "MQTT broker of the plant, mqtt://HOST:PORT, or mqtts://HOST:PORT with TLS; empty: none");
  v.parameter("mqtt_prefix", prefix_, "beginning of all MQTT topics");
  v.parameter("mqtt_client", client_, "client identifier at the broker; empty: cotwin- with host and process");
  v.parameter("mqtt_login", login_, "file of two lines, user and password for the broker, mode 600; empty: no login");
  v.parameter("mqtt_authority", authority_, "file of the authorities that the broker's certificate may come from, PEM");
  v.parameter("mqtt_certificate", certificate_, "file of the own certificate for the broker, PEM; empty: none");
  v.parameter("mqtt_key", key_, "file of that certificate's key, PEM, mode 600");
  v.parameter("mqtt_values", values_, "signals that are published over MQTT, separated by commas");
  v.parameter("mqtt_rate", rate_, "Hz", "how often, at most").range(0.001, 100);
}

mqtt::PlantReply RunSide::command(const std::string& payload) const {
  http::Request request;
  request.by = access::kBrokerName;
  request.method = kCommand;
  request.body = payload;
  request.audit = audit_;
  mqtt::PlantReply given;
  http::Reply reply = [&](const http::Response& response) { given = {response.status, response.body}; };
  try {
    reply = http::audited(request, reply);
    http::Response done;
    done.body = live_.ask(live::read_command(payload), http::Scopes::all(), access::kBrokerName);
    reply(done);
  } catch (const http::Refusal& refused) {
    reply(http::to_response(refused.problem, refused.fields));
  }
  return given;
}

mqtt::PlantReply RunSide::request(const std::string& payload) const {
  Answer answer;
  {
    const std::lock_guard lock(mutex_);
    answer = answer_;
  }
  if (!answer) return problem(503, "the gateway does not answer requests to services now");
  try {
    Json request = object_of(payload);
    std::string reply = answer(request);
    if (reply.size() > kLargestReply)
      throw refusal(422, "the reply has " + std::to_string(reply.size()) + " bytes, expected at most " +
                             std::to_string(kLargestReply) + " over MQTT: ask for fewer samples");
    return {200, std::move(reply)};
  } catch (const http::Refusal& refused) {
    return reply_of(refused);
  } catch (const Error& error) {
    return problem(422, error.what());
  }
}

std::optional<double> RunSide::least_value(const std::string& signal) const {
  std::optional<double> least;
  const Json sample = Json::parse(live_.values({signal}, ""));
  for (const Json& value : sample["values"])
    for (const Json& one : value.is_array() ? value : Json::array({value}))
      if (one.is_number()) least = std::min(least.value_or(one.get<double>()), one.get<double>());
  return least;
}

std::shared_ptr<mqtt::Plant> RunSide::plant() const {
  const std::lock_guard lock(mutex_);
  return plant_;
}

void RunSide::serve(Answer answer) {
  const std::lock_guard lock(mutex_);
  answer_ = std::move(answer);
}

void RunSide::begin() {
  if (std::exchange(ended_, false)) {
    const std::lock_guard lock(mutex_);
    plant_.reset();
  }
  if (broker_.empty() || plant()) return;
#ifdef COTWIN_MQTT
  mqtt::PlantOptions o;
  o.broker.url = broker_;
  o.broker.client_id = client_;
  if (client_.empty()) {
    char host[256] = {};
    (void)::gethostname(host, sizeof host - 1);
    o.broker.client_id = "cotwin-" + std::string(host) + "-" + std::to_string(::getpid());
  }
  o.broker.login = login_;
  o.broker.authority = authority_;
  o.broker.certificate = certificate_;
  o.broker.key = key_;
  o.broker.place = "unit:gateway.mqtt";
  o.prefix = prefix_;
  for (const std::string_view item : text::split(values_, ',')) {
    if (const std::string_view name = text::trim(item); !name.empty()) o.names.emplace_back(name);
  }
  o.rate_hz = rate_;
  auto made = std::make_shared<mqtt::Plant>(
      o, [this](const std::string& payload) { return command(payload); },
      [this](const std::string& payload) { return request(payload); });
  const std::lock_guard lock(mutex_);
  plant_ = std::move(made);
#else
  throw Error("unit:gateway.mqtt", "this build has no MQTT, expected no broker");
#endif
}

void RunSide::observe(std::shared_ptr<bus::LiveRun> run) {
  audit_->open(run->facts().results);
  // The run itself keeps who sends requests to it.
  audit_->on_done([run](const access::Deed& deed) {
    const bool is_of_run = deed.what == kCommand || deed.what.find(" /run/") != std::string::npos;
    if (!is_of_run) run->note({run->position().tick, deed.what, deed.by});
  });
  live_.observe(run);
#ifdef COTWIN_MQTT
  if (const auto p = plant()) p->observe(std::move(run));
#endif
}

void RunSide::event([[maybe_unused]] const std::string& topic, [[maybe_unused]] std::string json) {
#ifdef COTWIN_MQTT
  if (const auto p = plant()) p->event(topic, std::move(json));
#endif
}

void RunSide::end() noexcept {
  live_.end();
  ended_ = true;
#ifdef COTWIN_MQTT
  if (const auto p = plant()) p->end();
#endif
  serve({});
}

void RunSide::append_notes([[maybe_unused]] std::vector<std::string>& sentences) const {
#ifdef COTWIN_MQTT
  const auto p = plant();
  if (!p) return;
  const mqtt::Plant::Counts& c = p->counts();
  std::string sentence = text::counted(static_cast<std::int64_t>(c.delivered.load()), "message") + " to the MQTT broker, " +
                         std::to_string(c.received.load()) + " from it, " + std::to_string(c.dropped.load()) + " dropped";
  // After an orderly end there is no connection either, and no trouble.
  if (const std::string trouble = p->trouble(); !p->connected() && !trouble.empty()) sentence += "; no connection: " + trouble;
  sentences.push_back(std::move(sentence));
#endif
}

}  // namespace cotwin::gateway
