#include "components/gateway/live/live.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "components/bus/errors.h"
#include "components/gateway/live/command.h"
#include "components/gateway/live/refusals.h"
#include "components/gateway/live/signal_json.h"
#include "components/services/json/json.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::live {

namespace {

using Json = nlohmann::ordered_json;
using bus::LiveRun;
using bus::RunVerb;
using http::Refusal;
using http::Request;
using http::Response;
using http::Scope;

constexpr std::int64_t kValuesWait = 1'000'000'000, kAnswerWait = 2'000'000'000;  // ns
constexpr std::size_t kMostNames = 256, kMostElements = LiveRun::kMaxWatched / 4;
// The other watchers are the threads that answer requests for values, at most 16 by default, and MQTT.
constexpr std::size_t kMostStreams = bus::Feed::kMaxReaders - 16;

/// The number of elements. Throws Error for unknown names and texts, and Refusal for more than one request may watch.
std::size_t count_elements(const LiveRun& run, const std::vector<std::string>& names) {
  std::size_t elements = 0;
  for (const std::string& name : names) {
    const bus::LiveElements e = run.find(name);
    if (e.signal->kind == Kind::kString) throw Error("run", "'" + name + "' is a text, which cannot be watched");
    elements += e.count;
  }
  if (elements > kMostElements)
    refuse(422,
           "the names stand for " + std::to_string(elements) + " values, expected at most " + std::to_string(kMostElements));
  return elements;
}

std::vector<std::string> names_of(const Request& request) {
  const std::string* const list = request.query_value("names");
  if (list == nullptr) refuse(400, "the query has no names, expected ?names=component.variable,…");
  std::vector<std::string> names;
  // Names of foreign variables may have commas in brackets: "A[1,2]".
  int depth = 0;
  std::string name;
  for (const char c : *list + ",") {
    if (c == '[') ++depth;
    if (c == ']') --depth;
    if (c != ',' || depth > 0) {
      name += c;
      continue;
    }
    if (!name.empty()) names.push_back(std::exchange(name, ""));
  }
  if (names.empty() || names.size() > kMostNames)
    refuse(400, "the query has " + std::to_string(names.size()) + " names, expected 1 to " + std::to_string(kMostNames));
  return names;
}

double number_in_query(const Request& request, const char* name, double fallback, double least, double most) {
  const std::string* const given = request.query_value(name);
  if (given == nullptr) return fallback;
  double value = 0;
  const auto [end, error] = std::from_chars(given->data(), given->data() + given->size(), value);
  if (error != std::errc() || end != given->data() + given->size() || !(value >= least && value <= most)) {
    refuse(400, std::string("the query has ") + name + "=" + *given + ", expected " + text::to_text(least) + " to " +
                    text::to_text(most));
  }
  return value;
}

/// What `/` answers where the build has no page.
constexpr const char* kIndex = R"(<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>Cotwin gateway</title>
</head>
<body>
<h1>Cotwin gateway</h1>
<p>This gateway answers programs. It has no run to show here: a scenario that runs with <code>cotwin run --view</code> has a page,
and so has one with a gateway, if Cotwin was built with nodejs and npm.</p>
<ul>
<li><a href="openapi.json">openapi.json</a>: all that can be asked, as OpenAPI 3.1</li>
<li><a href="health">health</a>: version</li>
<li><a href="work-masters">work-masters</a>: the services</li>
<li><a href="robots">robots</a></li>
<li><a href="run">run</a>: state of the run that this gateway is in</li>
</ul>
</body>
</html>
)";

Response give(std::string body) {
  Response response;
  response.body = std::move(body) + "\n";
  return response;
}

}  // namespace

Live::Live() : watches_(kMostStreams), elements_(LiveRun::kMaxWatched) {}

Live::~Live() { end(); }

void Live::observe(std::shared_ptr<LiveRun> run) {
  const std::lock_guard lock(mutex_);
  streams_.reset();
  run_ = std::move(run);
  streams_ = std::make_unique<Streams>(run_);
}

void Live::end() noexcept {
  std::unique_ptr<Streams> streams;
  {
    const std::lock_guard lock(mutex_);
    streams = std::move(streams_);
  }
}

std::shared_ptr<LiveRun> Live::find_run() const {
  const std::lock_guard lock(mutex_);
  return run_;
}

std::shared_ptr<LiveRun> Live::run() const {
  std::shared_ptr<LiveRun> run = find_run();
  if (!run) refuse(503, "the run has not begun");
  return run;
}

std::string Live::state(http::Scopes scopes) const {
  const std::shared_ptr<LiveRun> r = run();
  const bus::RunFacts& f = r->facts();
  Json j = Json::parse(to_json(r->position()));
  j["scenario"] = f.scenario;
  j["start_s"] = f.start.seconds();
  j["stop_s"] = f.stop.seconds();
  j["tick_s"] = f.tick.seconds();
  j["ticks"] = f.ticks;
  j["clock"] = f.clock;
  j["has_page"] = f.page && f.page->shows_runs();
  j["can_pause"] = f.unpausable.empty();
  if (!f.unpausable.empty()) j["why_not"] = f.unpausable;
  j["signals"] = r->signals().size();
  j["commands"] = commands_.load();
  j["may"] = Json::array();
  for (const auto& [word, scope] : access::kScopeWords) {
    const bool is_command = scope != Scope::kRead && scope != Scope::kJobs;
    if (scopes.has(scope) && (!is_command || commands_)) j["may"].push_back(word);
  }
  return j.dump();
}

std::string Live::signals(const std::string& component) const {
  const std::shared_ptr<LiveRun> r = run();
  Json all = Json::array();
  for (const bus::LiveSignal& s : r->signals()) {
    if (component.empty() || s.component == component) all.push_back(describe(s));
  }
  return Json{{"signals", all}}.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// The newest values of these signals.
LiveRun::Sample Live::read(LiveRun::Watch& watch, const LiveRun& run) const {
  LiveRun::Sample sample;
  const std::int64_t limit = bus::monotonic_ns() + kValuesWait;
  constexpr std::int64_t kSlice = 20'000'000;
  while (!watch.wait(std::min(limit, bus::monotonic_ns() + kSlice))) {
    if (run.position().phase == bus::RunPhase::kEnded) refuse(409, "the run has ended");
    if (bus::monotonic_ns() >= limit) refuse(503, "the run has been within a tick for a second");
  }
  (void)watch.pop_newest(sample);
  return sample;
}

/// The places of a client among the watched values. Throws Refusal 429 if it has its share already.
std::shared_ptr<Shares::Share> Live::reserve_elements(const std::string& owner, std::size_t elements) const {
  std::size_t permitted = 0;
  auto share = elements_.take(owner, elements, permitted);
  if (!share)
    refuse(429, "this client would watch more than the " + std::to_string(permitted) +
                    " values that it may watch now: half of those that others leave");
  return share;
}

std::string Live::values(const std::vector<std::string>& names, const std::string& owner) const {
  const std::shared_ptr<LiveRun> r = run();
  try {
    const auto share = reserve_elements(owner, count_elements(*r, names));
    LiveRun::Watch watch(r, names, 0);
    const LiveRun::Sample sample = read(watch, *r);
    return to_json(watch.elements(), sample, 0);
  } catch (const Error&) {
    refuse_error();
  }
}

void Live::must_permit_commands() const {
  if (!commands_)
    refuse(403, "this gateway takes no commands to the run and sets no values (parameter commands of unit:gateway)");
}

void Live::must_permit(const RunRequest& request, http::Scopes scopes) {
  const auto must = [&](Scope scope, const std::string& what) {
    if (!scopes.has(scope)) refuse(403, "expected the scope " + http::Scopes(scope).words("") + " to " + what);
  };
  if (request.verb == RunVerb::kStop) return must(Scope::kEnd, "end the run");
  if (request.verb != RunVerb::kSet) return must(Scope::kTune, "pause and step the run");
  for (const LiveRun::Change& change : request.changes) {
    // Variables of a unit inside a packed twin have its name before theirs.
    const std::string name = "." + change.name.substr(0, change.name.find('['));
    must(name.ends_with(".acknowledge") ? Scope::kAcknowledge : Scope::kTune, "set " + change.name);
  }
}

std::string Live::ask(const RunRequest& request, http::Scopes scopes, const std::string& by) const {
  must_permit_commands();
  must_permit(request, scopes);
  const std::shared_ptr<LiveRun> r = run();
  if (r->position().phase == bus::RunPhase::kEnded) refuse(409, "the run has ended");
  std::optional<LiveRun::Answer> answer;
  try {
    LiveRun::Control control(r, by);
    if (request.verb == RunVerb::kSet) {
      control.set(request.changes, request.at);
    } else {
      if (!r->facts().unpausable.empty() && request.verb != RunVerb::kStop)
        refuse(409, "the run cannot pause: " + r->facts().unpausable, "/command");
      control.command(request.verb, request.ticks);
    }
    answer = control.wait(bus::monotonic_ns() + kAnswerWait);
  } catch (const Error&) {
    refuse_error();
  }
  if (!answer)
    refuse(503, "the run has been within a tick for two seconds; the request is withdrawn, unless the loop has just taken it");
  switch (answer->reply) {
    case bus::RunReply::kPast:
      refuse(409, "the time has passed: the run is at " + text::to_text(r->position().time.seconds()) + " s", "/time_s");
    case bus::RunReply::kFull:
      refuse(503, "too many values wait for their time");
    case bus::RunReply::kEnded:
      refuse(409, "the run has ended");
    case bus::RunReply::kDone:
      hurry_streams();
      break;
  }
  return Json{{"command", text::word_of(request.verb, bus::kRunVerbWords)},
              {"tick", answer->tick},
              {"time_s", r->time(answer->tick).seconds()},
              {"phase", text::word_of(r->position().phase, bus::kRunPhaseWords)}}
      .dump();
}

void Live::hurry_streams() const {
  const std::lock_guard lock(mutex_);
  if (streams_) streams_->hurry();
}

/// The page of the run, or one that names what there is.
Response Live::front() const {
  const std::shared_ptr<LiveRun> r = find_run();
  Response response;
  response.type = "text/html; charset=utf-8";
  response.body = r && r->facts().page ? r->facts().page->html() : kIndex;
  response.fields = {{"Content-Security-Policy", "frame-ancestors 'none'"}, {"Referrer-Policy", "no-referrer"}};
  return response;
}

void Live::add_page_routes(http::Router& router) {
  http::Route page;
  page.method = "GET";
  page.pattern = "/";
  page.id = "getPage";
  page.summary = "The run in a browser, or what this gateway has";
  page.scope = {};
  page.gives = "text/html";
  page.answers = {{200, "Html", "The page, without anything of the run", "text/html"}};
  router.add(page, [this](const Request&) { return front(); });

  http::Route content;
  content.method = "GET";
  content.pattern = "/run/page";
  content.id = "getPageContent";
  content.summary = "What the page shows of the run: robots, scene, events";
  content.tag = "run";
  content.answers = {{200, "PageContent", "It, in the form that the page of this version reads"},
                     http::problem_answer(404, "This gateway has no page of its run"),
                     http::problem_answer(503, "The run has not begun")};
  content.slow = true;  // it reads files
  router.add(content, [this](const Request&) {
    const std::shared_ptr<LiveRun> r = run();
    if (!r->facts().page || !r->facts().page->shows_runs())
      refuse(404, "this run has no page: the program that runs it gives none, or was built without one");
    return give(r->facts().page->content(*r));
  });
}

void Live::add_routes(http::Router& router) {
  add_schemas(router);
  add_page_routes(router);
  const auto route = [](const char* method, const char* pattern, const char* id, const char* summary, const char* schema) {
    http::Route r;
    r.method = method;
    r.pattern = pattern;
    r.id = id;
    r.summary = summary;
    r.tag = "run";
    r.answers = {{200, schema, "Done"},
                 http::problem_answer(503, "The run has not begun, or is within a long tick, or there is no room")};
    return r;
  };
  const http::Answer forbidden =
      http::problem_answer(403, "The token, or the local user, may not do this, or this gateway takes no commands");
  const http::Answer wrong = http::problem_answer(422, "An unknown name, or a value that is not permitted");
  const http::Answer ended = http::problem_answer(409, "The run has ended, cannot pause, or the time has passed");
  const http::Parameter names{"names", "query",
                              "signals, component.variable or component.variable[element], separated by commas",
                              R"({"type":"string"})", true};

  router.add(route("GET", "/run", "getRun", "State of the run", "Run"),
             [this](const Request& request) { return give(state(request.scopes)); });

  http::Route list = route("GET", "/run/signals", "listSignals", "The variables of the run", "Signals");
  list.parameters = {{"component", "query", "only those of this component"}};
  list.slow = true;  // a run may have thousands of variables
  router.add(list, [this](const Request& request) {
    const std::string* const component = request.query_value("component");
    return give(signals(component != nullptr ? *component : ""));
  });

  http::Route values_route = route("GET", "/run/values", "getValues", "Present values of signals, all of one tick", "Sample");
  values_route.parameters = {names};
  values_route.answers.push_back(wrong);
  values_route.answers.push_back(ended);
  values_route.slow = true;
  router.add(values_route, [this](const Request& request) { return give(values(names_of(request), request.owner)); });

  http::Route put = route("PUT", "/run/tunables/{name}", "setTunable", "Sets a tunable or a free input", "Accepted");
  put.scope = Scope::kTune | Scope::kAcknowledge;
  put.takes = "TunableValue";
  put.answers.push_back(forbidden);
  put.answers.push_back(wrong);
  put.answers.push_back(ended);
  put.slow = true;
  router.add(put, [this](const Request& request) {
    must_permit_commands();
    const std::string& name = request.part("name");
    const RunRequest set = read_change(request.body, name, [&] {
      try {
        (void)run()->find(name);
      } catch (const Error& error) {
        refuse(404, detail_of(error));
      }
    });
    return give(ask(set, request.scopes, request.by));
  });

  http::Route command =
      route("POST", "/run/commands", "commandRun", "Pause, resume, step, stop, or set several values at once", "Accepted");
  command.scope = Scope::kTune | Scope::kAcknowledge | Scope::kEnd;
  command.takes = "RunCommand";
  command.answers.push_back(forbidden);
  command.answers.push_back(wrong);
  command.answers.push_back(ended);
  command.slow = true;
  router.add(command, [this](const Request& request) {
    must_permit_commands();
    return give(ask(read_command(request.body), request.scopes, request.by));
  });

  http::Route events =
      route("GET", "/run/stream", "streamRun",
            "Values and state of the run as server-sent events, or over a WebSocket with the same messages", "");
  events.answers.front() = {200, "", "Messages, until the run ends", "text/event-stream"};
  events.messages = {{"run", "RunPosition", "At the beginning and when the phase changes"},
                     {"sample", "Sample", "The newest values (without every)"},
                     {"samples", "Samples", "The records since the last message (with every)"},
                     {"problem", "Problem", "Why the stream ends: there was no room any more"},
                     {"heartbeat", "Nothing", "There were no others for a while"}};
  events.gives = "text/event-stream";
  events.ticket = true;
  events.parameters = {
      names,
      {"rate_hz", "query",
       "most messages per second, 0.01 to 200; default 20; after a change of a value one comes early, in place of the next one",
       R"({"type":"number","minimum":0.01,"maximum":200,"default":20})"},
      {"every", "query", "ticks between two records, which are all sent; 0: the newest one with each message",
       R"({"type":"integer","minimum":0,"maximum":1000000000,"default":0})"}};
  events.answers.push_back(wrong);
  events.answers.push_back(ended);
  router.add(events, [this](const Request& request) {
    StreamOrder order;
    order.names = names_of(request);
    order.rate_hz = number_in_query(request, "rate_hz", 20, Streams::kLowest, Streams::kHighest);
    const double every = number_in_query(request, "every", 0, 0, 1e9);
    if (every != std::floor(every))
      refuse(400, "the query has every=" + *request.query_value("every") + ", expected an integer");
    order.every = static_cast<std::int64_t>(every);
    const std::shared_ptr<LiveRun> r = run();
    try {
      std::size_t permitted = 0;
      order.elements = reserve_elements(request.owner, count_elements(*r, order.names));
      order.watch = watches_.take(request.owner, 1, permitted);
      if (!order.watch)
        refuse(429,
               "this client has " + std::to_string(permitted) + " streams, expected no more: half of those that others leave");
    } catch (const Error&) {
      refuse_error();
    }
    if (r->position().phase == bus::RunPhase::kEnded) refuse(409, "the run has ended");
    Response response;
    response.stream = [this, order](const std::shared_ptr<http::Stream>& to) { begin(to, order); };
    return response;
  });
}

/// On the server's thread.
void Live::begin(const std::shared_ptr<http::Stream>& to, const StreamOrder& order) {
  const std::lock_guard lock(mutex_);
  try {
    if (!streams_) throw bus::RunEnded("run", "it has ended");
    streams_->add(to, order);
  } catch (const Error& error) {
    const int status = dynamic_cast<const bus::RunEnded*>(&error) != nullptr ? 409 : 503;
    (void)to->send(
        {"problem", "",
         Json{{"type", "about:blank"}, {"title", http::reason_of(status)}, {"status", status}, {"detail", detail_of(error)}}
             .dump()});
    to->close();
  }
}

void Live::fill(Json& request, const PostureName& posture) const {
  if (!request.is_object() || !request.contains("from") || request["from"] != "run") {
    if (request.is_object() && request.contains("from_signal"))
      refuse(422, "needs the member \"from\": \"run\"", "/from_signal");
    return;
  }
  for (const char* given : {"from_q_rad", "from_q_deg", "from_q"}) {
    if (request.contains(given)) refuse(422, "is given beside " + std::string(given) + ", expected one of the two", "/from");
  }
  const std::string member = posture ? posture(request) : "from_q_rad";
  const std::shared_ptr<LiveRun> r = run();
  std::string name;
  if (request.contains("from_signal")) {
    if (!request["from_signal"].is_string()) refuse(422, "expected the name of a signal", "/from_signal");
    name = request["from_signal"].get<std::string>();
  } else {
    std::string found;
    for (const bus::LiveSignal& s : r->signals()) {
      if (s.variable != "q" || s.kind != Kind::kReal || (s.role != Role::kOutput && s.role != Role::kState)) continue;
      found += (name.empty() ? "" : ", ") + s.name;
      name = s.name;
    }
    if (name.empty()) refuse(422, "no component of the run has an output q, expected from_signal", "/from");
    if (found != name)
      refuse(422, "several components of the run have an output q (" + found + "), expected from_signal", "/from");
  }
  LiveRun::Sample sample;
  try {
    if (r->find(name).signal->kind != Kind::kReal) refuse(422, "'" + name + "' is not real", "/from_signal");
    LiveRun::Watch watch(r, std::vector<std::string>{name}, 0);
    sample = read(watch, *r);
  } catch (const Error&) {
    refuse_error("/from_signal");
  }
  Json filled = Json::object();
  for (const auto& [key, value] : request.items()) {
    if (key == "from_signal") continue;
    if (key != "from") filled[key] = value;
    if (key == "from") filled[member] = sample.values;
  }
  request = std::move(filled);
}

}  // namespace cotwin::gateway::live
