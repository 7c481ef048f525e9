#include "components/gateway/live/streams.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::live {

namespace {

using Json = nlohmann::ordered_json;
using bus::LiveElements;
using bus::LiveRun;

constexpr std::int64_t kIdle = 100'000'000;      // ns between two looks at closed streams and the phase of the run
constexpr std::int64_t kFarewell = 300'000'000;  // ns for clients to take the last messages of a run
constexpr std::int64_t kAgain = 20'000'000;      // ns until a client that has not read the last message is tried again

Json element_json(const bus::LiveSignal& signal, double value) {
  if (signal.kind == Kind::kBoolean) return value != 0;
  if (signal.kind == Kind::kInteger) return static_cast<std::int32_t>(value);
  if (!std::isfinite(value)) return nullptr;
  return value;
}

/// A number for one element, else an array.
Json value_json(const LiveElements& e, const double* values) {
  if (e.count == 1) return element_json(*e.signal, *values);
  Json all = Json::array();
  for (std::size_t i = 0; i < e.count; ++i) all.push_back(element_json(*e.signal, values[i]));
  return all;
}

std::string name_of_elements(const LiveElements& e) {
  return e.count == e.signal->size ? e.signal->name : e.signal->name + "[" + std::to_string(e.first + 1) + "]";
}

Json values_json(std::span<const LiveElements> elements, const LiveRun::Sample& sample) {
  Json values = Json::object();
  const double* next = sample.values.data();
  for (const LiveElements& e : elements) {
    values[name_of_elements(e)] = value_json(e, next);
    next += e.count;
  }
  return values;
}

}  // namespace

std::string to_json(std::span<const LiveElements> elements, const LiveRun::Sample& sample, std::uint64_t lost) {
  return Json{
      {"tick", sample.tick}, {"time_s", sample.time.seconds()}, {"values", values_json(elements, sample)}, {"lost", lost}}
      .dump();
}

std::string to_json(const bus::RunPosition& p) {
  return Json{{"phase", text::word_of(p.phase, bus::kRunPhaseWords)},
              {"tick", p.tick},
              {"time_s", p.time.seconds()},
              {"changes", p.changes}}
      .dump();
}

Streams::Streams(std::shared_ptr<LiveRun> run) : run_(std::move(run)), thread_([this] { work(); }) {}

Streams::~Streams() { end(); }

void Streams::add(std::shared_ptr<http::Stream> to, const StreamOrder& order) {
  auto client = std::make_unique<Client>();
  client->watch = std::make_unique<LiveRun::Watch>(run_, order.names, order.every, order.every > 0 ? nullptr : records_);
  client->places[0] = order.watch;
  client->places[1] = order.elements;
  client->to = std::move(to);
  client->names = order.names;
  client->every = order.every;
  client->period = static_cast<std::int64_t>(1e9 / std::clamp(order.rate_hz, kLowest, kHighest));
  client->due = bus::monotonic_ns();
  client->asked = true;  // a watch begins with a request
  {
    const std::lock_guard lock(mutex_);
    incoming_.push_back(std::move(client));
  }
  arrived_ = true;
  wake_.notify();
  records_->notify();
}

void Streams::hurry() noexcept {
  hurried_ = true;
  wake_.notify();
  records_->notify();
}

void Streams::end() noexcept {
  if (ending_.exchange(true)) return;
  wake_.notify();
  records_->notify();
  if (thread_.joinable()) thread_.join();
}

void Streams::work() {
  while (!ending_) {
    std::int64_t next = bus::monotonic_ns() + kIdle;
    for (const auto& c : clients_) {
      if (c->every > 0 || !c->asked) next = std::min(next, std::max(c->due, c->again));
    }
    const bool asked = std::ranges::any_of(clients_, [](const auto& c) { return c->every == 0 && c->asked; });
    (asked ? *records_ : wake_)
        .wait(
            [&] {
              return arrived_ || hurried_ || ending_ || std::ranges::any_of(clients_, [](const auto& c) {
                       return c->every == 0 && c->asked && c->watch->ready();
                     });
            },
            next);
    if (arrived_.exchange(false)) {
      const std::lock_guard lock(mutex_);
      for (auto& c : incoming_) clients_.push_back(std::move(c));
      incoming_.clear();
    }
    const bool hurried = hurried_.exchange(false);
    const std::int64_t now = bus::monotonic_ns();
    std::erase_if(clients_, [&](const auto& c) { return !serve(*c, now, hurried); });
  }
  {
    const std::lock_guard lock(mutex_);
    for (auto& c : incoming_) clients_.push_back(std::move(c));
    incoming_.clear();
  }
  for (const auto& c : clients_) {
    send_rest(*c);
    send_phase(*c);
    c->to->close();
  }
  // The server, which may end now, would cut off what is still on its way.
  for (const std::int64_t last = bus::monotonic_ns() + kFarewell; bus::monotonic_ns() < last;) {
    if (std::ranges::all_of(clients_, [](const auto& c) { return c->to->waiting() == 0; })) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  clients_.clear();
}

/// False: the stream is closed.
bool Streams::serve(Client& c, std::int64_t now, bool hurried) {
  if (c.to->closed()) return false;
  send_phase(c);
  if (c.every > 0) {
    if (now < c.due) return true;
    c.due = std::max(c.due + c.period, now);
    if (c.to->waiting() == 0) send_records(c);
    return true;
  }
  if (c.asked && c.watch->ready()) {
    c.asked = false;
    if (c.to->waiting() > 0) {
      LiveRun::Sample left_out;
      (void)c.watch->pop_newest(left_out);
      if (!c.late_since) c.late_since = now;
      c.due = std::min(c.due, now);
      c.again = now + kAgain;
      return true;
    }
    if (c.late_since) c.left_out += static_cast<std::uint64_t>((now - *c.late_since) / c.period);
    c.late_since.reset();
    c.again = 0;
    send_newest(c);
    c.due = std::max(c.due, now) + c.period;
  } else if (!c.asked && now >= std::max(c.again, c.due - (hurried ? c.period : 0))) {
    c.asked = true;
    c.watch->request();
  }
  return true;
}

void Streams::send_newest(Client& c) {
  LiveRun::Sample sample;
  if (!c.watch->pop_newest(sample)) return;
  const std::int64_t changes = run_->position().changes;
  if (sample.tick == c.tick && changes == c.changes) return;  // a paused run
  c.tick = sample.tick;
  c.changes = changes;
  (void)c.to->send({"sample", std::to_string(++c.id), to_json(c.watch->elements(), sample, c.left_out)});
}

void Streams::send_records(Client& c) {
  Json records = Json::array();
  LiveRun::Sample sample;
  while (c.watch->take(sample)) {
    if (records.size() == kMostRecords) {
      ++c.left_out;
      continue;
    }
    records.push_back(
        Json{{"tick", sample.tick}, {"time_s", sample.time.seconds()}, {"values", values_json(c.watch->elements(), sample)}});
  }
  if (records.empty()) return;
  (void)c.to->send(
      {"samples", std::to_string(++c.id), Json{{"samples", records}, {"lost", c.watch->lost() + c.left_out}}.dump()});
}

/// The last records that there are.
void Streams::send_rest(Client& c) {
  if (c.every > 0) {
    send_records(c);
  } else if (c.watch->ready()) {
    send_newest(c);
  }
}

void Streams::send_phase(Client& c) {
  const bus::RunPosition position = run_->position();
  if (c.id > 0 && position.phase == c.phase) return;
  if (position.phase == bus::RunPhase::kEnded) send_rest(c);  // a client may stop reading at the end of the run
  c.phase = position.phase;
  (void)c.to->send({"run", std::to_string(++c.id), to_json(position)});
}

}  // namespace cotwin::gateway::live
