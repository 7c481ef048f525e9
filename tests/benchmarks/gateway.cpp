// The gateway: time from a request to its whole answer, for 50 clients that send 100 requests a second together over connections that
// stay open. The peer is Python's http.server with an answer of the same size that is there already.
#include <atomic>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "components/gateway/api/api.h"
#include "components/gateway/http/server.h"
#include "components/gateway/jobs/jobs.h"
#include "components/services/json/control/control.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/http_client.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace {

using namespace cotwin;
using testing::http_request;
using testing::RawClient;

constexpr int kClients = 50;
const int kRounds = benchmark::shortened(20, 2);  // of each client
constexpr double kPeriod = 0.5;                   // s, between the requests of a client: 100 a second of all

const char* const kPeer = R"(
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    body = b"x" * int(sys.argv[1])
    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(200)
        self.send_header("Content-Length", str(len(self.body)))
        self.end_headers()
        self.wfile.write(self.body)
    def log_message(self, *unused):
        pass
class Server(ThreadingHTTPServer):
    request_queue_size = 128
server = Server(("127.0.0.1", 0), Handler)
print(server.server_address[1], flush=True)
server.serve_forever()
)";

struct Latency {
  double median = 0, p99 = 0;
  std::size_t bytes = 0;
};

double share(std::vector<double>& v, double part) {
  const auto at = static_cast<std::ptrdiff_t>(part * static_cast<double>(v.size() - 1));
  std::nth_element(v.begin(), v.begin() + at, v.end());
  return v[static_cast<std::size_t>(at)];
}

Latency measure_clients(std::uint16_t port, const std::string& request) {
  std::vector<std::vector<double>> times(kClients);
  std::atomic<int> failed = 0;
  std::atomic<std::size_t> bytes = 0;
  const auto begin = std::chrono::steady_clock::now() + std::chrono::milliseconds(200);
  std::vector<std::thread> threads;
  for (int c = 0; c < kClients; ++c) {
    threads.emplace_back([&, c] {
      RawClient client(port);
      for (int r = 0; r < kRounds; ++r) {
        std::this_thread::sleep_until(begin + std::chrono::duration<double>(kPeriod * (r + static_cast<double>(c) / kClients)));
        const double start = benchmark::wall_seconds();
        client.send(request);
        const testing::HttpReply reply = client.reply();
        times[static_cast<std::size_t>(c)].push_back(benchmark::wall_seconds() - start);
        if (reply.status != 200) ++failed;
        bytes = reply.body.size();
      }
    });
  }
  for (std::thread& t : threads) t.join();
  if (failed != 0) std::fprintf(stderr, "%d requests failed\n", failed.load());
  std::vector<double> all;
  for (const auto& each : times) all.insert(all.end(), each.begin(), each.end());
  return {share(all, 0.5), share(all, 0.99), bytes};
}

/// The time in which 99.9 % of the requests of a client are answered, s, while 24 others send bodies of a megabyte: nested too deep, with too
/// many members, a long name, a number of 100 000 digits, and as many values as are allowed.
double measure_beside_others(std::uint16_t port, const std::string& request) {
  constexpr std::size_t kMiB = std::size_t{1} << 20;
  std::string members = "{", values = R"({"a":[0)", objects = "{";
  for (int i = 0; members.size() < kMiB - 20; ++i) members += (i > 0 ? ",\"" : "\"") + std::to_string(i) + "\":0";
  for (int i = 1; i < 99'000; ++i) values += ",0.5";
  for (int o = 0; o < 24; ++o) {
    objects += (o > 0 ? ",\"" : "\"") + std::to_string(o) + "\":{\"x\":0";
    for (int i = 0; i < 4000; ++i) objects += ",\"" + std::to_string(i) + "\":0";
    objects += "}";
  }
  std::vector<std::string> bodies = {
      "{\"a\":" + std::string(kMiB - 10, '['),     members + "}", "{\"" + std::string(kMiB - 10, 'x') + "\":1}",
      "{\"a\":" + std::string(100'000, '9') + "}", values + "]}", objects + "}"};
  for (std::string& body : bodies) body = http_request("POST", "/services/feasibility", body);
  std::atomic<bool> ends = false;
  std::vector<std::thread> others;
  for (std::size_t c = 0; c < 24; ++c) {
    others.emplace_back([&, c] {
      for (std::size_t k = c; !ends; ++k) {
        RawClient client(port);
        client.send(bodies[k % bodies.size()]);
        (void)client.reply();
      }
    });
  }
  std::vector<double> times;
  for (int i = 0; i < benchmark::shortened(1000, 20); ++i) {
    const double start = benchmark::wall_seconds();
    RawClient client(port);
    client.send(request);
    if (client.reply().status != 200) std::fprintf(stderr, "a request failed\n");
    times.push_back(benchmark::wall_seconds() - start);
  }
  ends = true;
  for (std::thread& t : others) t.join();
  return share(times, 0.999);
}

/// From the order to the end of four services after one another, without the time of the services themselves: as a chain, and as four
/// orders of a client who takes the duration from the first answer himself. Medians, s.
benchmark::Figures measure_chain() {
  const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("cotwin_chain_benchmark_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  std::vector<double> chain, single;
  {
    gateway::JobsOptions options;
    options.database = folder / "jobs.sqlite";
    options.command = {places::program(), "ask", "--worker"};
    options.producer = "benchmark";
    options.chains = {services::next_step, services::chain_reply, services::chain_problem, services::problem};
    gateway::Jobs jobs(options);
    const std::string move = R"("from_q_rad":[0,-0.9,0,1.2,0,0.6,0],"to_q_rad":[1.2,0.9,0,-1.2,0,-0.6,0])";
    const auto own_time = [&](const std::string& request) {
      gateway::JobOrder order;
      order.request = request;
      order.reuse = false;
      const double start = benchmark::wall_seconds();
      const gateway::JobReply stored = jobs.store(order);
      const auto job = jobs.wait(stored.id, 60);
      if (!job || job->result != gateway::JobResult::kSuccessful) std::fprintf(stderr, "a job failed\n");
      return benchmark::wall_seconds() - start - (job ? job->busy_s : 0);
    };
    const auto step = [&](const char* service, const std::string& T) {
      return R"({"service":")" + std::string(service) + "\"," + move + (T.empty() ? "" : ",\"T_s\":" + T) + "}";
    };
    (void)own_time(step("cycle_time", ""));  // starts the worker
    for (int i = 0; i < benchmark::shortened(41, 1); ++i) {
      const std::string T = "\"$1/T_s\"";
      chain.push_back(own_time(R"({"steps":[)" + step("cycle_time", "") + "," + step("energy", T) + "," + step("safety", T) +
                               "," + step("payload", T) + "]}"));
      single.push_back(own_time(step("cycle_time", "")) + own_time(step("energy", "1.983")) +
                       own_time(step("safety", "1.983")) + own_time(step("payload", "1.983")));
    }
  }
  std::filesystem::remove_all(folder);
  return {share(chain, 0.5), share(single, 0.5)};
}

}  // namespace

int main() {
  services::Robots robots({places::source() + "/models/robots"}, "lwr4");
  gateway::http::Router router;
  gateway::http::ServerOptions options;
  options.addresses = {"127.0.0.1"};
  options.authority.hosts = {"localhost"};
  gateway::add_general_routes(router, options.tickets, "benchmark");
  gateway::add_service_routes(router, robots, nullptr);
  const gateway::http::Server server(std::move(options), router);
  const std::string move = R"({"robot":"lwr4","from_q_rad":[0,-0.9,0,1.2,0,0.6,0],"to_q_rad":[1.2,0.9,0,-1.2,0,-0.6,0])";
  const std::string given = http_request("POST", "/services/feasibility", move + R"(,"T_s":1.6})");
  (void)measure_clients(server.port(), given);
  const Latency ours = measure_clients(server.port(), given);
  testing::RunOptions to_file;
  const std::string ports = std::filesystem::temp_directory_path() / ("cotwin_gateway_benchmark_" + std::to_string(::getpid()));
  to_file.out = ports;
  testing::Process python({"python3", "-c", kPeer, std::to_string(ours.bytes)}, to_file);
  std::uint16_t port = 0;
  for (int i = 0; i < 1000 && port == 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    if (std::FILE* const file = std::fopen(ports.c_str(), "r")) {
      unsigned number = 0;
      if (std::fscanf(file, "%u\n", &number) == 1) port = static_cast<std::uint16_t>(number);
      std::fclose(file);
    }
  }
  const Latency peer = port == 0 ? Latency{} : measure_clients(port, given);
  const double beside = measure_beside_others(server.port(), given);
  const double peer_beside = port == 0 ? 0 : measure_beside_others(port, given);
  python.signal(15);
  std::remove(ports.c_str());
  const char* const kPeerName = "python3 http.server with a fixed answer";
  benchmark::print({"feasibility over HTTP, T given, 100 requests/s, 50 clients, median", "ms", 1e3 * ours.median, kPeerName,
                    1e3 * peer.median, 2, false});
  benchmark::print({"the same, 99th percentile", "ms", 1e3 * ours.p99, kPeerName, 1e3 * peer.p99, 0, false});
  benchmark::print({"the same, one client beside 24 with bodies of 1 MiB, 99.9th percentile", "ms", 1e3 * beside, kPeerName,
                    1e3 * peer_beside, 100, false});
  const benchmark::Figures chain = measure_chain();
  benchmark::print({"a chain of four services as a job, beyond the services, median", "ms", 1e3 * chain.ours,
                    "four orders one after the other", 1e3 * chain.peer, 20, false});
  return 0;
}
