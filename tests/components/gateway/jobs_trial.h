#pragma once
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "components/gateway/jobs/jobs.h"
#include "tests/support/files.h"
#include "tests/support/patience.h"

/// Jobs with a shell script as worker. The service of a request chooses what the script does.
namespace cotwin::gateway::testing {

using cotwin::testing::TemporaryFolder;
using cotwin::testing::within_patience;

inline constexpr const char* kWorker = R"sh(
folder=$1
pause() { while [ ! -e "$folder/$1" ]; do sleep 0.01; done; }
while IFS= read -r line; do
  id=${line#*'"id":"'}; id=${id%%'"'*}
  request=${line#*'"request":'}; request=${request%\}}
  echo "$id" >> "$folder/log"
  reply() { printf '{"id":"%s","reply":{"of": %s, "verdict": {"light": "green", "findings": []}}}\n' "$id" "$request"; }
  case $line in
    *'"service":"gate"'*) pause open; reply ;;
    *'"service":"red"'*)
      case $line in *'"require"'*) unmet=', "unmet": "It cannot."' ;; *) unmet= ;; esac
      printf '{"id":"%s","reply":{"verdict": {"light": "red", "findings": []%s}}}\n' "$id" "$unmet" ;;
    *'"service":"progress"'*) printf '{"id":"%s","progress":0.25,"message":"a quarter"}\n' "$id"; pause open; reply ;;
    *'"service":"crash"'*) echo "out of order" >&2; kill -9 $$ ;;
    *'"service":"exit"'*) exit 3 ;;
    *'"service":"crash_once"'*) if [ -e "$folder/crashed" ]; then reply; else : > "$folder/crashed"; kill -11 $$; fi ;;
    *'"service":"hang"'*) while :; do sleep 1; done ;;
    *'"service":"garbage"'*) echo '{"id": "x", oops' ;;
    *'"service":"other"'*) printf '{"id":"somebody","reply":{}}\n' ;;
    *'"service":"no_line"'*) while :; do printf 'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx'; done ;;
    *'"service":"flood"'*) while :; do printf '{"id":"%s","progress":0.5}\n' "$id"; done ;;
    *'"service":"twice"'*) reply; reply ;;
    *'"service":"last"'*) reply; exit 0 ;;
    *'"service":"gate_last"'*) pause open; reply; exit 0 ;;
    *'"service":"refuse"'*)
      printf '{"id":"%s","problem":{"title":"No","detail":"T_s is 0","pointer":"/T_s"}}\n' "$id" ;;
    *'"service":"random"'*) printf '{"id":"%s","reply":{"of": "%s", "verdict": {"light": "green", "findings": []}}}\n' "$id" "$(cat /proc/sys/kernel/random/uuid)" ;;
    *'"service":"limits"'*)
      printf '{"id":"%s","reply":{"data_KiB":"%s","nice":"%s","open":"%s"}}\n' "$id" "$(ulimit -d)" "$(nice)" "$(readlink /proc/$$/fd/* | tr '\n' ' ')" ;;
    *) reply ;;
  esac
done
)sh";

/// In memory where that is possible, unless TMPDIR is given: the trials need no durability over a loss of power.
struct FoldersInMemory {
  FoldersInMemory() {
    if (access("/dev/shm", W_OK) == 0) setenv("TMPDIR", "/dev/shm", 0);
  }
};

/// What the worker writes for most services.
inline std::string reply_to(const std::string& request) {
  return R"({"of": )" + request + R"(, "verdict": {"light": "green", "findings": []}})";
}

struct Trial {
  explicit Trial(const std::string& name) : folder(name) {
    folder.write("worker.sh", kWorker);
    options.database = folder / "jobs.db";
    options.command = {"/bin/sh", (folder / "worker.sh").string(), folder.path().string()};
    options.back_off_s = 0.01;
    options.producer = "test 1";
  }
  /// The jobs that a worker was given, one line each.
  std::string log() const { return cotwin::testing::content(folder / "log"); }
  void open_gate() const { folder.write("open", ""); }

  FoldersInMemory first;
  TemporaryFolder folder;
  JobsOptions options;
};

/// Of a process, its folder below /proc. Empty if it has ended, also if that is while it is read: then the system tells an error, not an end.
inline std::string command_line(const std::filesystem::path& process) {
  std::ifstream in(process / "cmdline", std::ios::binary);
  std::string text;
  std::getline(in, text);  // throws nothing
  return text;
}

inline JobOrder order_of(const std::string& id, const std::string& service, const std::string& more = "") {
  JobOrder order;
  order.id = id;
  order.request = R"({"service": ")" + service + R"(", "robot": "lwr4")" + (more.empty() ? "" : ", " + more) + "}";
  return order;
}

inline bool reaches(Jobs& jobs, const std::string& id, JobState state) {
  return within_patience([&] {
    const auto job = jobs.find(id);
    return job && job->state == state;
  });
}

/// The job when it is done.
inline Job done(Jobs& jobs, const std::string& id) {
  const auto job = jobs.wait(id, 60);
  return job ? *job : Job{};
}

}  // namespace cotwin::gateway::testing
