#include "tests/benchmarks/fri/lines.h"

#include <sched.h>

#include <cstdio>
#include <cstdlib>
#include <stdexcept>

#include "components/io/link/datagram_queue.h"

namespace cotwin::benchmark {

namespace {

constexpr std::int64_t kMillisecond = 1'000'000;  // ns

int run_silently(const std::string& command) { return std::system((command + " >/dev/null 2>&1").c_str()); }

void change_netem(const std::string& what) {
  const std::string command = "tc qdisc change dev lo root netem " + what;
  if (run_silently(command) != 0) throw std::runtime_error("'" + command + "' failed, expected that netem accepts it");
}

}  // namespace

void RelayLine::disturb() {
  testing::Disturbance d;
  d.loss = 0.05;
  d.jitter = 2 * kMillisecond;
  d.duplicate = 0.05;
  d.reorder = 0.04;
  d.hold = 3 * kMillisecond;
  relay_.set(d);
}

void RelayLine::cut() {
  testing::Disturbance d;
  d.loss = 1;
  relay_.set(d);
}

std::unique_ptr<Netem> Netem::open(std::string& reason) {
  if (unshare(CLONE_NEWNET) != 0) {
    reason = "no permission for a network namespace, expected root";
    return nullptr;
  }
  if (run_silently("ip link set lo up") != 0) {
    reason = "'ip link set lo up' failed in a network namespace, expected iproute2";
    return nullptr;
  }
  if (run_silently("tc qdisc add dev lo root netem limit 10000") != 0) {
    reason = "'tc qdisc add dev lo root netem' failed, expected iproute2 and a kernel with sch_netem";
    return nullptr;
  }
  return std::unique_ptr<Netem>(new Netem);
}

void Netem::disturb() { change_netem("limit 10000 delay 1ms 1ms loss 5% duplicate 5% reorder 4%"); }

void Netem::clear() { change_netem("limit 10000 delay 0ms loss 0% duplicate 0% reorder 0%"); }

void Netem::cut() {
  change_netem("limit 10000 delay 0ms loss 100% duplicate 0% reorder 0%");
  cut_at_ = io::monotonic_now();
}

std::int64_t Netem::lost() const {
  FILE* pipe = popen("tc -s qdisc show dev lo", "r");
  long long dropped = -1;
  char line[256];
  while (pipe != nullptr && std::fgets(line, sizeof line, pipe) != nullptr) {
    long long sent = 0, packets = 0;
    if (std::sscanf(line, " Sent %lld bytes %lld pkt (dropped %lld", &sent, &packets, &dropped) == 3) break;
  }
  if (pipe != nullptr) pclose(pipe);
  return dropped;
}

}  // namespace cotwin::benchmark
