#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "components/bus/live_run.h"
#include "components/gateway/live/live.h"
#include "components/gateway/mqtt/plant.h"
#include "components/unit/variables.h"

namespace cotwin::gateway {

/// What the gateway has of the run that it is in: its routes, and the MQTT broker of the plant.
class RunSide {
 public:
  /// The reply to a request {"service": …} that came over MQTT; completes it first (see fill). Throws Refusal or Error.
  using Answer = std::function<std::string(nlohmann::ordered_json& request)>;

  /// Parameters of the broker.
  void declare(Variables& v);
  void add_routes(http::Router& router) { live_.add_routes(router); }
  /// Where it is written what came over MQTT.
  const std::shared_ptr<access::Audit>& audit() const { return audit_; }
  /// Connects to the broker, if one is given. Before the first event(). Throws Error for parameters that are not permitted.
  void begin();
  /// From now on requests to services are answered. May be replaced at any time.
  void serve(Answer answer);
  void observe(std::shared_ptr<bus::LiveRun> run);
  /// Whether clients may command the run and set its values, over HTTP and MQTT.
  void permit_commands(bool permitted) { live_.permit_commands(permitted); }
  /// See live::Live::fill.
  void fill(nlohmann::ordered_json& request, const live::PostureName& name) const { live_.fill(request, name); }
  /// The least element of a signal of the run that is a number, if there is one. Throws Refusal.
  std::optional<double> least_value(const std::string& signal) const;
  /// An event of a job for the plant: "jobs/7". From any thread; never waits.
  void event(const std::string& topic, std::string json);
  /// Closes the streams of the run and leaves the broker. begin() may follow.
  void end() noexcept;
  void append_notes(std::vector<std::string>& sentences) const;

 private:
  mqtt::PlantReply command(const std::string& payload) const;
  mqtt::PlantReply request(const std::string& payload) const;

  std::shared_ptr<mqtt::Plant> plant() const;

  const std::shared_ptr<access::Audit> audit_ = std::make_shared<access::Audit>();
  live::Live live_;
  mutable std::mutex mutex_;
  Answer answer_;                       // guarded by mutex_
  std::shared_ptr<mqtt::Plant> plant_;  // likewise: events come from the jobs' thread
  bool ended_ = false;

  std::string broker_, prefix_ = "cotwin", client_, login_, authority_, certificate_, key_, values_;
  double rate_ = 1;
};

}  // namespace cotwin::gateway
