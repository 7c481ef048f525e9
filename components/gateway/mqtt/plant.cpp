#include "components/gateway/mqtt/plant.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "components/gateway/live/streams.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::mqtt {

namespace {

using Json = nlohmann::ordered_json;

constexpr std::int64_t kIdle = 100'000'000;      // ns between two looks at the phase of the run
constexpr std::int64_t kLastWait = 500'000'000;  // ns for the last messages
constexpr std::size_t kMostCommandsInFlight = 16, kMostOrders = 64, kMostEvents = 512;
constexpr std::size_t kLargestMessage = 1 << 20, kLongestTopic = 1024;  // bytes
constexpr std::size_t kMostBytes = 8 << 20;                             // of messages that wait for one of the threads

void check_prefix(const PlantOptions& o) {
  const bool bad = o.prefix.empty() || o.prefix.size() > kLongestTopic / 2 || o.prefix.front() == '/' ||
                   o.prefix.front() == '$' || o.prefix.back() == '/' ||
                   o.prefix.find_first_of(std::string_view("+#\0", 3)) != std::string::npos;
  if (bad) throw Error(o.broker.place, "'" + o.prefix + "' is no prefix of topics, expected such as cotwin/cell_3");
}

std::size_t size_of(const BrokerSession::Message& m) {
  return m.topic.size() + m.payload.size() + m.response_topic.size() + m.correlation.size();
}

std::string online(bool is) { return is ? R"({"online":true})" : R"({"online":false})"; }

}  // namespace

Plant::Plant(PlantOptions options, Handler command, Handler request) : options_(std::move(options)) {
  check_prefix(options_);
  if (!(options_.rate_hz >= 0.001 && options_.rate_hz <= 100))
    throw Error(options_.broker.place, "rate of " + std::to_string(options_.rate_hz) + " Hz over MQTT, expected 0.001 to 100");
  link_ =
      std::make_unique<BrokerSession>(options_.broker, BrokerSession::Message{topic("status"), online(false), 1, true, "", ""},
                                      [this](BrokerSession::Event event) { happened(std::move(event)); });
  thread_ = std::thread([this] { work(); });
  commands_.handler = std::move(command);
  requests_.handler = std::move(request);
  for (Orders* orders : {&commands_, &requests_}) orders->thread = std::thread([this, orders] { answer(*orders); });
}

Plant::~Plant() { end(); }

void Plant::end() noexcept {
  if (ending_.exchange(true)) return;
  wake_.notify();
  records_->notify();
  thread_.join();
  for (Orders* orders : {&commands_, &requests_}) {
    {
      const std::lock_guard lock(mutex_);
      orders->waiting.clear();
    }
    orders->arrived.notify_all();
    orders->thread.join();
  }
}

std::string Plant::trouble() const {
  const std::lock_guard lock(mutex_);
  return trouble_;
}

void Plant::observe(std::shared_ptr<bus::LiveRun> run) {
  std::unique_ptr<bus::LiveRun::Watch> watch;
  if (!options_.names.empty()) watch = std::make_unique<bus::LiveRun::Watch>(run, options_.names, 0, records_);
  {
    const std::lock_guard lock(mutex_);
    new_run_ = std::move(run);
    new_watch_ = std::move(watch);
  }
  arrived_ = true;
  wake_.notify();
  records_->notify();
}

void Plant::event(const std::string& name, std::string json) {
  queue(topic(name), std::move(json), 1, false);
  arrived_ = true;
  wake_.notify();
  records_->notify();
}

void Plant::queue(std::string to, std::string payload, int qos, bool retained, std::string correlation) {
  BrokerSession::Message message{std::move(to), std::move(payload), qos, retained, "", std::move(correlation)};
  const std::lock_guard lock(mutex_);
  std::size_t bytes = size_of(message);
  for (const Outgoing& o : waiting_) bytes += size_of(o.message);
  while (!waiting_.empty() && (waiting_.size() >= options_.backlog || bytes > options_.backlog_bytes)) {
    bytes -= size_of(waiting_.front().message);
    waiting_.pop_front();
    ++counts_.dropped;
  }
  waiting_.push_back({0, std::move(message)});
}

/// On Paho's threads.
void Plant::happened(BrokerSession::Event event) {
  if (event.kind == BrokerSession::Event::Kind::kMessage) ++counts_.received;
  {
    const std::lock_guard lock(mutex_);
    const bool is_message = event.kind == BrokerSession::Event::Kind::kMessage;
    const std::size_t bytes = size_of(event.message);
    if (is_message && (events_.size() >= kMostEvents || event.message.payload.size() > kLargestMessage ||
                       event_bytes_ + bytes > kMostBytes)) {
      ++counts_.ignored;
      return;
    }
    event_bytes_ += bytes;
    events_.push_back(std::move(event));
  }
  arrived_ = true;
  wake_.notify();
  records_->notify();
}

void Plant::work() {
  std::deque<BrokerSession::Event> events;
  while (!ending_) {
    const std::int64_t before = bus::monotonic_ns();
    // Paho looks only from time to time whether it may close a connection, and never answers who connects before.
    if (!connected_ && !connecting_ && before >= next_attempt_ && !link_->open()) {
      connecting_ = true;
      link_->connect();
    }
    std::int64_t next = before + kIdle;
    if (watch_ && connected_ && !asked_) next = std::min(next, std::max(next_values_, before));
    const bool asked = watch_ && asked_;
    (asked ? *records_ : wake_).wait([&] { return arrived_ || ending_ || (asked && watch_->ready()); }, next);
    const std::int64_t now = bus::monotonic_ns();
    if (arrived_.exchange(false)) {
      const std::lock_guard lock(mutex_);
      events.swap(events_);
      event_bytes_ = 0;
      if (new_run_) {
        run_ = std::move(new_run_);
        watch_ = std::move(new_watch_);
        phase_.reset();
        asked_ = watch_ != nullptr;
      }
    }
    for (const BrokerSession::Event& event : events) handle(event, now);
    events.clear();
    if (!connected_) continue;
    publish_phase();
    if (watch_) publish_values(now);
    send_waiting();
  }
  // The last state, as far as the broker takes it in time.
  if (connected_) {
    publish_phase();
    queue(topic("status"), online(false), 1, true);
    const std::int64_t limit = bus::monotonic_ns() + kLastWait;
    for (;;) {
      {
        const std::lock_guard lock(mutex_);
        events.swap(events_);
        event_bytes_ = 0;
      }
      arrived_ = false;
      for (const BrokerSession::Event& event : events) handle(event, bus::monotonic_ns());
      events.clear();
      send_waiting();
      bool all = false;
      {
        const std::lock_guard lock(mutex_);
        all = waiting_.empty() && in_flight_.empty();
      }
      if (all || !connected_ || bus::monotonic_ns() >= limit) break;
      wake_.wait([&] { return arrived_.load(); }, limit);
    }
    link_->disconnect();
  }
  connected_ = false;
  watch_.reset();
  link_.reset();
}

void Plant::handle(const BrokerSession::Event& event, std::int64_t now) {
  using Kind = BrokerSession::Event::Kind;
  switch (event.kind) {
    case Kind::kConnected:
      return begin_session();
    case Kind::kRefused:
      if (!connected_) return;
      link_->disconnect();
      return lose_session(event.text, now);
    case Kind::kLost:
      if (connected_ || connecting_) lose_session(event.text, now);  // else it was told before
      return;
    case Kind::kDelivered:
      if (in_flight_.erase(event.number) > 0) ++counts_.delivered;
      return;
    case Kind::kUndelivered:
      if (const auto found = in_flight_.find(event.number); found != in_flight_.end()) {
        const std::lock_guard lock(mutex_);
        if (found->second.qos > 0) waiting_.push_front({0, std::move(found->second)});
        in_flight_.erase(found);
      }
      return;
    case Kind::kMessage:
      break;
  }
  const BrokerSession::Message& message = event.message;
  Orders* const orders = message.topic == topic("commands")   ? &commands_
                         : message.topic == topic("requests") ? &requests_
                                                              : nullptr;
  const std::lock_guard lock(mutex_);
  const bool taken =
      orders != nullptr && orders->waiting.size() < kMostOrders && orders->bytes + size_of(message) <= kMostBytes;
  if (!taken || message.retained) ++counts_.ignored;
  if (!taken) return;
  orders->bytes += size_of(message);
  orders->waiting.push_back(message);
  orders->arrived.notify_one();
}

void Plant::begin_session() {
  connecting_ = false;
  connected_ = true;
  delay_ = 0;
  phase_.reset();
  ++counts_.connections;
  link_->subscribe({topic("commands"), topic("requests")});
  const std::lock_guard lock(mutex_);
  trouble_.clear();
  waiting_.push_front({0, {topic("status"), online(true), 1, true, "", ""}});
}

void Plant::lose_session(const std::string& why, std::int64_t now) {
  connected_ = false;
  connecting_ = false;
  ++counts_.lost;
  const auto seconds = [](double s) { return static_cast<std::int64_t>(1e9 * s); };
  delay_ = std::clamp(2 * delay_, seconds(options_.first_delay_s), seconds(options_.longest_delay_s));
  next_attempt_ = now + delay_;
  const std::lock_guard lock(mutex_);
  trouble_ = why.empty() ? "the connection was lost" : why;
  // Delivered at least once: what was not acknowledged is sent again.
  for (auto message = in_flight_.rbegin(); message != in_flight_.rend(); ++message) {
    const bool state = message->second.topic == topic("status") || message->second.topic == topic("run");
    if (message->second.qos > 0 && !state) waiting_.push_front({0, std::move(message->second)});
  }
  in_flight_.clear();
  std::erase_if(waiting_, [&](const Outgoing& o) {
    return o.message.qos == 0 || o.message.topic == topic("status") || o.message.topic == topic("run");
  });
}

void Plant::publish_phase() {
  if (!run_) return;
  const bus::RunPosition position = run_->position();
  if (phase_ == position.phase) return;
  phase_ = position.phase;
  queue(topic("run"), live::to_json(position), 1, true);
}

void Plant::publish_values(std::int64_t now) {
  if (asked_ && watch_->ready()) {
    asked_ = false;
    bus::LiveRun::Sample sample;
    (void)watch_->pop_newest(sample);
    next_values_ = std::max(next_values_ + static_cast<std::int64_t>(1e9 / options_.rate_hz), now);
    const std::string to = topic("values");
    {
      const std::lock_guard lock(mutex_);
      counts_.dropped += std::erase_if(waiting_, [&](const Outgoing& o) { return o.message.topic == to; });
    }
    queue(to, live::to_json(watch_->elements(), sample, 0), 0, false);
  } else if (!asked_ && now >= next_values_) {
    asked_ = true;
    watch_->request();
  }
}

/// Few at a time: what Paho holds for a broker that does not read has no limit of its own.
void Plant::send_waiting() {
  while (connected_ && in_flight_.size() < kMostCommandsInFlight) {
    Outgoing next;
    {
      const std::lock_guard lock(mutex_);
      if (waiting_.empty()) return;
      next = std::move(waiting_.front());
      waiting_.pop_front();
    }
    next.number = ++number_;
    if (!link_->publish(next.number, next.message)) {
      const std::lock_guard lock(mutex_);
      waiting_.push_front(std::move(next));
      return;
    }
    in_flight_.emplace(next.number, std::move(next.message));
  }
}

bool Plant::may_reply_to(const std::string& to) const {
  return !to.empty() && to.size() <= kLongestTopic && to.front() != '$' && to.find_first_of("+#") == std::string::npos &&
         to != topic("commands") && to != topic("requests");
}

void Plant::answer(Orders& orders) {
  for (;;) {
    BrokerSession::Message order;
    {
      std::unique_lock lock(mutex_);
      orders.arrived.wait(lock, [&] { return !orders.waiting.empty() || ending_; });
      if (ending_) return;
      order = std::move(orders.waiting.front());
      orders.waiting.pop_front();
      orders.bytes -= size_of(order);
    }
    PlantReply reply{503, R"({"title":"Service Unavailable","status":503,"detail":"this gateway does not answer that"})"};
    try {
      // The broker would give a retained message to every later session again.
      if (order.retained) {
        reply = {422,
                 Json{{"title", "Unprocessable Content"},
                      {"status", 422},
                      {"detail", "was published with the retain flag, which is not carried out, expected a message without it"}}
                     .dump()};
      } else if (orders.handler) {
        reply = orders.handler(order.payload);
      }
    } catch (const std::exception& error) {
      reply = {500, Json{{"title", "Internal Server Error"}, {"status", 500}, {"detail", text::reason_of(error)}}.dump()};
    }
    if (!may_reply_to(order.response_topic)) continue;
    const Json body = Json::parse(reply.body, nullptr, false);
    queue(order.response_topic, Json{{"status", reply.status}, {"reply", body.is_discarded() ? Json(reply.body) : body}}.dump(),
          1, false, order.correlation);
    arrived_ = true;
    wake_.notify();
    records_->notify();
  }
}

}  // namespace cotwin::gateway::mqtt
