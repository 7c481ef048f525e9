#include "components/gateway/gateway.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>

#include "components/gateway/api/api.h"
#include "components/gateway/api/catalogue.h"
#include "components/gateway/api/job_board.h"
#include "components/gateway/api/json_tools.h"
#include "components/gateway/http/server.h"
#include "components/services/json/control/control.h"
#include "components/services/json/json.h"
#include "components/services/robots.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file_hash.h"
#include "models/foundation/support/installation.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway {

namespace {

const char* const kPlace = "unit:gateway";
constexpr std::pair<const char*, bool> kLocalWrites[] = {{"owner", false}, {"all", true}};
constexpr double kNoPair = 1e12;  // m, the distance of unit:monitor where there is nobody

/// The items of a list "a, b", without blanks.
std::vector<std::string> items(const std::string& list) {
  std::vector<std::string> all;
  for (const std::string_view item : text::split(list, ',')) {
    if (const std::string_view name = text::trim(item); !name.empty()) all.emplace_back(name);
  }
  return all;
}

/// Version and program: another build of the same version may give other replies.
std::string producer_of(const std::string& program) {
  std::error_code none;
  const std::string version = COTWIN_VERSION;
  return std::filesystem::is_regular_file(program, none) ? version + " " + hexadecimal(hash_of_file(program)) : version;
}

}  // namespace

struct Gateway::Parameters {
  std::string address, tokens, certificate, key, hosts, origins, url_file, robot;
  std::int32_t port = 0, threads = 0, connections = 0;
  std::string database, program, persons, local_writes;
  double price_per_kWh = 0, co2_per_kWh = 0;
  std::int32_t workers = 0, address_connections = 0;
  bool operator==(const Parameters&) const = default;
};

/// The server and all that its routes use, in the order in which it is made.
struct Gateway::Running {
  Parameters parameters;
  std::vector<std::string> folders;
  std::shared_ptr<access::Audit> audit;
  std::string unphysical;
  services::Robots robots;
  std::optional<Jobs> jobs;
  std::shared_ptr<JobBoard> board;
  http::Router router;
  std::shared_ptr<access::Tickets> tickets = std::make_shared<access::Tickets>();
  std::optional<http::Server> server;
  std::uint64_t requests = 0, refused = 0, dropped = 0;  // before the last initialise

  Running(const Parameters& p, const std::vector<std::string>& robot_folders, const std::string& people,
          const std::string& of_inertias, RunSide& run_side)
      : parameters(p),
        folders(robot_folders),
        audit(run_side.audit()),
        unphysical(of_inertias),
        robots({robot_folders.begin(), robot_folders.end()}, p.robot, false, people, urdf_options()) {
    if (!p.robot.empty()) (void)robots.find(p.robot);
    if (!p.database.empty()) {
      jobs.emplace(job_options());
      board = std::make_shared<JobBoard>(*jobs);
      jobs->subscribe([&run_side](const JobChange& change) {
        if (change.kind != JobChange::Kind::kState && change.kind != JobChange::Kind::kRemoved) return;
        Json event = JobBoard::to_json(change.job);
        event["Event"] = change.kind == JobChange::Kind::kState ? "state" : "removed";
        event["Version"] = change.job.version;  // the same for an event that comes twice
        run_side.event("jobs/" + http::encode_segment(change.job.order.id), event.dump());
      });
    }
    add_general_routes(router, tickets, COTWIN_VERSION);
    const Fill complete = [this, &run_side](Json& request) { fill(request, run_side); };
    add_service_routes(router, robots, board, complete);
    if (board) add_job_routes(router, robots, board, complete);
    run_side.add_routes(router);
    server.emplace(options(), router);
  }
  // Those who wait get their answers while the server is still there. Jobs that run go back to the queue.
  ~Running() {
    if (board) board->stop();
    if (server) server->stop();
    if (jobs) jobs->close();
  }

  /// What requests leave to the gateway: the present posture of the run, the service, and the context from which it is chosen, which is
  /// the same for all steps of a chain.
  void fill(Json& request, const RunSide& run_side) {
    const live::PostureName posture = [this](const Json& r) { return services::posture_member(robots, r, "from_q"); };
    const auto now = std::chrono::system_clock::now();
    std::optional<Json> context;
    std::map<Json, Json> starts;  // by robot
    must_settle(request, [&](Json& one, const std::string& pointer) {
      try {
        if (!one.contains("service")) {
          if (!context) context = context_of(run_side);
          add_context(one, *context, now);
          add_start(one, starts[one.value("robot", Json())], run_side, posture);
        }
        run_side.fill(one, posture);
      } catch (http::Refusal& refused) {
        refused.problem.pointer.insert(0, pointer);
        throw;
      }
    });
  }

  /// Tariff and nearness, as far as they are known.
  Json context_of(const RunSide& run_side) const {
    Json context = Json::object();
    if (parameters.price_per_kWh > 0) context["price_per_kWh"] = parameters.price_per_kWh;
    if (parameters.co2_per_kWh > 0) context["co2_kg_per_kWh"] = parameters.co2_per_kWh;
    if (parameters.persons.empty()) return context;
    const auto distance = run_side.least_value(parameters.persons);
    if (distance && *distance < kNoPair) context["person_m"] = std::max(0.0, *distance);
    return context;
  }

  static void add_context(Json& request, const Json& context, std::chrono::system_clock::time_point now) {
    for (const auto& [name, value] : context.items())
      if (!request.contains(name)) request[name] = value;
    if (!request.contains("deadline")) return;
    const auto time = request["deadline"].is_string() ? time_of(request["deadline"].get<std::string>()) : std::nullopt;
    if (!time) throw refusal(422, "is no time, expected one such as 2026-11-22T08:00:00Z", "/deadline");
    if (request.contains("deadline_s")) throw refusal(422, "is given beside deadline_s, expected one of them", "/deadline");
    request.erase("deadline");
    request["deadline_s"] = std::chrono::duration<double>(*time - now).count();
  }

  /// The posture of the run in a request that says nothing of its beginning. `start`: {member: posture} of an earlier one, or null.
  void add_start(Json& request, Json& start, const RunSide& run_side, const live::PostureName& posture) const {
    for (const char* given : {"from", "from_q_rad", "from_q_deg", "from_q", "series", "waypoints", "poses"})
      if (request.contains(given)) return;
    if (start.is_null()) {
      start = Json{{"from", "run"}};
      if (request.contains("robot")) start["robot"] = request["robot"];
      try {
        run_side.fill(start, posture);
        start.erase("robot");
      } catch (const http::Refusal& refused) {
        // The run does not have one robot: the service tells that it needs a start.
        if (refused.problem.status != 422) throw;
        start = Json::object();
      }
    }
    request.update(start);
  }

  robot::UrdfOptions urdf_options() const {
    robot::UrdfOptions options;
    robot::take_unphysical(unphysical, options);
    return options;
  }

  JobsOptions job_options() {
    JobsOptions o;
    o.database = parameters.database;
    const std::string program = parameters.program.empty() ? (installation() / "bin/cotwin").string() : parameters.program;
    o.command = {program, "ask", "--worker"};
    o.command.insert(o.command.end(), {"--robot", parameters.robot, "--unphysical", unphysical});
    for (const std::string& folder : folders) o.command.insert(o.command.end(), {"--robots", folder});
    o.workers = parameters.workers;
    o.producer = producer_of(program);
    o.robot_hash = [this](const std::string& name) { return hash_of_robot(name); };
    o.chains = {services::next_step, services::chain_reply, services::chain_problem, services::problem};
    return o;
  }

  /// Of all files that answers about the robot depend on. Of a request that names no robot: also of its name.
  std::string hash_of_robot(const std::string& name) {
    const std::string& robot = name.empty() ? parameters.robot : name;
    (void)robots.find(robot);  // refuses a robot whose files cannot be read
    std::string hash = (unphysical == "error" ? "" : unphysical + ":") + (name.empty() ? robot + ":" : "");
    for (const std::filesystem::path& file : robots.files_of(robot)) {
      std::error_code none;
      if (std::filesystem::is_regular_file(file, none)) hash += hexadecimal(hash_of_file(file));
      hash += '.';
    }
    return hash;
  }

  http::ServerOptions options() const {
    http::ServerOptions o;
    o.place = kPlace;
    o.tickets = tickets;
    for (const std::string& address : items(parameters.address)) {
      if (address == "localhost") {
        o.addresses.push_back("127.0.0.1");
        o.if_there.push_back("::1");
      } else {
        o.addresses.push_back(address);
      }
    }
    o.port = static_cast<std::uint16_t>(parameters.port);
    o.certificate = parameters.certificate;
    o.key = parameters.key;
    o.token_file = parameters.tokens;
    o.local_writes = text::choose(std::string(kPlace) + ".local_writes", parameters.local_writes, kLocalWrites);
    o.audit = audit;
    o.authority.hosts = {"localhost"};
    for (const std::string& host : items(parameters.hosts)) {
      const std::optional<std::string> name = access::host_of(host);
      if (name != host)
        throw Error(std::string(kPlace) + ".hosts",
                    "'" + host + "' is no host, expected names or addresses in lower case without ports");
      o.authority.hosts.push_back(host);
    }
    o.authority.origins = items(parameters.origins);
    for (const std::string& origin : o.authority.origins)
      access::check_origin_setting(origin, std::string(kPlace) + ".origins");
    o.limits.connections = static_cast<std::size_t>(parameters.connections);
    o.limits.address_connections = static_cast<std::size_t>(parameters.address_connections);
    o.threads = parameters.threads;
    return o;
  }
};

void Gateway::declare_settings(SettingList& s) {
  s.set_first_variables(
      {"address", "port", "tokens", "certificate", "key", "robot", "database", "commands", "mqtt", "requests"});
  s.text("robots", "robots", "folders with robots that requests may name, FOLDER/NAME/robot.urdf, separated by commas");
  s.unphysical();
}

Gateway::Gateway(Settings& settings) : unphysical_(settings.choice("unphysical")) {
  for (const std::string& folder : items(settings.text("robots"))) robot_folders_.push_back(settings.file(folder).string());
  try {
    people_ = settings.file("people/iso_ts_15066.csv").string();
  } catch (const Error&) {
    // One beside the robots counts, if there is one; the service safety tells where it needs one.
  }
}

Gateway::~Gateway() { end(); }

void Gateway::declare(Variables& v) {
  v.parameter("address", address_,
              "addresses to listen at, separated by commas; localhost: 127.0.0.1 and, if there, ::1. Addresses that other "
              "machines reach "
              "need tokens, certificate and key");
  v.parameter("port", port_, "TCP port; 0: a free one").range(0, 65535);
  v.parameter(
      "tokens", tokens_,
      "file of tokens that clients must send, lines `SCOPE[,SCOPE] TOKEN [name=NAME] [until=TIME]`, mode 600; read again "
      "when it changes; empty: no tokens");
  v.parameter("certificate", certificate_, "file of the certificate and its chain, PEM, for TLS; empty: no TLS");
  v.parameter("key", key_, "file of the certificate's key, PEM, mode 600");
  v.parameter("hosts", hosts_,
              "names beside localhost and the addresses by which clients may call the gateway, separated by commas");
  v.parameter("origins", origins_,
              "origins of web pages that may call the gateway, such as https://mes.example:8443, separated by commas");
  v.parameter("url_file", url_file_, "file to which the URL is written at the start; empty: none");
  v.parameter("robot", robot_, "robot of requests that name none; empty: each must name one");
  v.parameter("threads", threads_,
              "threads that compute answers; up to 14 more while there are long requests of several clients")
      .range(1, 64);
  v.parameter("connections", connections_, "most connections at the same time").range(1, 10000);
  v.parameter("database", database_, "SQLite file of the jobs and their results, made if it is missing; empty: no jobs");
  v.parameter("program", program_, "program whose `ask --worker` computes jobs; empty: the cotwin of this installation");
  v.parameter("workers", workers_, "processes that compute jobs at the same time").range(1, 256);
  v.output("requests", requests_, "1", "number of requests that were answered").discrete();
  v.output("refused", refused_, "1", "number of those with a status of 400 and above, and of connections beyond the limit")
      .discrete();
  v.output("open", open_, "1", "number of connections at present").discrete();
  v.output("streams", streams_, "1", "number of open event streams and WebSockets").discrete();
  v.output("dropped", dropped_, "1", "number of streams that were closed because their clients were too slow").discrete();
  run_side_.declare(v);
  v.parameter("commands", commands_,
              "whether clients may pause, step and stop the run and set its values; false: they can only watch it");
  v.parameter("address_connections", address_connections_, "most connections of one address at the same time").range(1, 10000);
  v.parameter("persons", persons_,
              "signal of the run that has distances of persons in m, such as monitor.distance, for requests that name no "
              "service; the least "
              "one counts; empty: unknown");
  v.parameter("local_writes", local_writes_,
              "who may change something without tokens: owner: the user who runs the gateway, and root; all: all users of this "
              "machine. The others may read");
  v.parameter("price_per_kWh", price_per_kWh_, "1", "price of a kilowatt hour, in any currency, for the same; 0: unknown")
      .range(0, 1e9);
  v.parameter("co2_per_kWh", co2_per_kWh_, "kg", "CO2 of a kilowatt hour, for the same; 0: unknown").range(0, 1e9);
}

Gateway::Parameters Gateway::parameters() const {
  return {address_,     tokens_,  certificate_,        key_,      hosts_,   origins_, url_file_,     robot_,
          port_,        threads_, connections_,        database_, program_, persons_, local_writes_, price_per_kWh_,
          co2_per_kWh_, workers_, address_connections_};
}

void Gateway::initialise(Time) {
  const Parameters wanted = parameters();
  run_side_.permit_commands(commands_);
  if (!running_ || !(running_->parameters == wanted)) {
    run_side_.end();
    running_.reset();
    run_side_.begin();  // before the jobs, whose events go there
    running_ = std::make_unique<Running>(wanted, robot_folders_, people_, unphysical_, run_side_);
    if (!url_file_.empty()) write_file(url_file_, running_->server->url() + "\n");
  }
  run_side_.begin();
  run_side_.serve([this](Json& request) {
    running_->fill(request, run_side_);
    if (is_long(request))
      throw refusal(422, "takes long, expected an immediate service over MQTT: order a job over HTTP", "/service");
    return services::answer_object(running_->robots, request);
  });
  const http::Server::Counts& c = running_->server->counts();
  running_->requests = c.requests;
  running_->refused = c.refused;
  running_->dropped = c.dropped;
  write_outputs();
}

StepResult Gateway::step(Time, Duration) {
  write_outputs();
  return StepResult::kDone;
}

void Gateway::write_outputs() {
  const http::Server::Counts& c = running_->server->counts();
  const auto since = [](const std::atomic<std::uint64_t>& count, std::uint64_t before) {
    return static_cast<double>(count.load() - before);
  };
  requests_ = since(c.requests, running_->requests);
  refused_ = since(c.refused, running_->refused);
  dropped_ = since(c.dropped, running_->dropped);
  open_ = since(c.open, 0);
  streams_ = since(c.streams, 0);
}

std::string Gateway::url() const { return running_ ? running_->server->url() : ""; }

void Gateway::append_notes(std::vector<std::string>& sentences) const {
  run_side_.append_notes(sentences);
  if (requests_ == 0) return;
  sentences.push_back("answered " + text::to_text(requests_) + " requests, of which " + text::to_text(refused_) +
                      " were refused");
}

void Gateway::end() noexcept {
  run_side_.end();
  running_.reset();
}

}  // namespace cotwin::gateway
