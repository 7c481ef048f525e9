#pragma once
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "components/bus/live_run.h"
#include "components/gateway/mqtt/broker_session.h"

namespace cotwin::gateway::mqtt {

struct PlantOptions {
  BrokerOptions broker;
  std::string prefix;                                 // of all topics: "cotwin/cell_3"
  std::vector<std::string> names;                     // signals that are published
  double rate_hz = 1;                                 // of them, at most
  std::size_t backlog = 1000;                         // events that wait for the broker; older ones are dropped
  std::size_t backlog_bytes = 32 << 20;               // likewise
  double first_delay_s = 0.25, longest_delay_s = 30;  // between attempts to connect
};

/// The reply to a request: an HTTP status and JSON.
struct PlantReply {
  int status = 200;
  std::string body;
};

/// The gateway at the MQTT broker of a plant (docs/gateway_run.md). Topics below the prefix:
///   status     retained, QoS 1  {"online":true} and, as last will and at the end, {"online":false}
///   run        retained, QoS 1  phase of the run, when it changes
///   values     QoS 0            signals at a limited rate; only the newest ones wait for the broker
///   jobs/…     QoS 1            events, by event()
///   commands   subscribed       as POST /run/commands
///   requests   subscribed       as POST /services/{name}, with "service"
/// Replies go to the response topic of a request with its correlation data: {"status":200,…}. Retained commands and requests are
/// ignored. Nothing here waits for the broker, but for the last second of the destructor.
class Plant {
 public:
  using Handler = std::function<PlantReply(const std::string& payload)>;

  /// Begins to connect. `command`, `request`: each called on one thread of its own; may take their time, and may be empty. Throws Error for
  /// options that are not permitted.
  Plant(PlantOptions options, Handler command, Handler request);
  /// end()
  ~Plant();
  Plant(const Plant&) = delete;
  Plant& operator=(const Plant&) = delete;

  /// The run whose signals are published. Throws Error for unknown names.
  void observe(std::shared_ptr<bus::LiveRun> run);
  /// Publishes an event at prefix/topic with QoS 1, at least once. From any thread; never waits.
  void event(const std::string& topic, std::string json);
  /// Publishes the last state and leaves the broker.
  void end() noexcept;

  struct Counts {
    std::atomic<std::uint64_t> connections = 0;  // that succeeded
    std::atomic<std::uint64_t> lost = 0;         // and attempts that failed
    std::atomic<std::uint64_t> delivered = 0;    // messages
    std::atomic<std::uint64_t> dropped = 0;      // events and values that found no room
    std::atomic<std::uint64_t> received = 0;     // commands and requests
    std::atomic<std::uint64_t> ignored = 0;      // of them: retained, too many, without use
  };
  const Counts& counts() const { return counts_; }
  bool connected() const { return connected_; }
  /// Why there is no connection; "" if there is one.
  std::string trouble() const;

 private:
  struct Outgoing {
    std::uint64_t number = 0;
    BrokerSession::Message message;
  };
  /// Commands, or requests, that wait for the thread that answers them: a request that takes its time delays no command.
  struct Orders {
    Handler handler;
    std::deque<BrokerSession::Message> waiting;  // guarded by mutex_
    std::size_t bytes = 0;                       // likewise
    std::condition_variable arrived;
    std::thread thread;
  };

  void happened(BrokerSession::Event event);
  void work();
  void answer(Orders& orders);
  void handle(const BrokerSession::Event& event, std::int64_t now);
  void begin_session();
  void lose_session(const std::string& why, std::int64_t now);
  void publish_values(std::int64_t now);
  void publish_phase();
  void queue(std::string topic, std::string payload, int qos, bool retained, std::string correlation = "");
  void send_waiting();
  bool may_reply_to(const std::string& topic) const;
  std::string topic(const std::string& name) const { return options_.prefix + "/" + name; }

  const PlantOptions options_;
  Counts counts_;
  std::atomic<bool> connected_ = false, ending_ = false;
  bus::Wake wake_;
  std::shared_ptr<bus::Wake> records_ = std::make_shared<bus::Wake>();
  std::atomic<bool> arrived_ = false;

  mutable std::mutex mutex_;
  std::deque<BrokerSession::Event> events_;  // from Paho
  std::size_t event_bytes_ = 0;
  std::shared_ptr<bus::LiveRun> new_run_;
  std::unique_ptr<bus::LiveRun::Watch> new_watch_;
  std::deque<Outgoing> waiting_;  // for the broker
  std::string trouble_ = "it has not connected yet";

  // Of the thread work().
  std::unique_ptr<BrokerSession> link_;
  std::shared_ptr<bus::LiveRun> run_;
  std::unique_ptr<bus::LiveRun::Watch> watch_;
  std::map<std::uint64_t, BrokerSession::Message> in_flight_;
  std::uint64_t number_ = 0;
  std::int64_t next_attempt_ = 0, delay_ = 0, next_values_ = 0;
  bool connecting_ = false, asked_ = false;
  std::optional<bus::RunPhase> phase_;

  Orders commands_, requests_;
  std::thread thread_;
};

}  // namespace cotwin::gateway::mqtt
