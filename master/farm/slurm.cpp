#include "master/farm/slurm.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <deque>
#include <fstream>
#include <optional>
#include <random>
#include <set>
#include <thread>

#include "master/workflows/watched.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file_hash.h"
#include "models/foundation/support/process.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using WallClock = std::chrono::steady_clock;

constexpr int kAttempts = 3;                     // of runs of which none comes
constexpr std::size_t kMostSent = 4000;          // chunks in the queue; Slurm's MaxJobCount is 10 000 by default, for all users
constexpr double kBriefest = 5, kLongest = 600;  // s, of a chunk
constexpr std::chrono::seconds kAnswer{60};      // of a program of Slurm
constexpr std::chrono::seconds kEnding{20};      // of chunks that were cancelled

/// A program of Slurm failed.
class SlurmError : public Error {
 public:
  using Error::Error;
};

/// Runs a program of Slurm. Throws SlurmError with its own message if it fails.
std::string ask(std::vector<std::string> command, const std::string& input = "") {
  const std::string name = command.front();
  Ended ended = run_process(std::move(command), input, kAnswer);
  if (ended.well()) return std::move(ended.out);
  if (ended.error == ENOENT) throw SlurmError(name, "is not installed, expected the programs of Slurm (Debian: slurm-client)");
  if (ended.error != 0) throw SlurmError(name, "cannot be started: " + system_reason(ended.error));
  if (ended.late) throw SlurmError(name, "timed out after " + std::to_string(kAnswer.count()) + " s");
  std::string message;
  for (std::string_view line : text::split(ended.err, '\n')) {
    line = text::trim(line);
    for (const std::string& start : {name + ": ", std::string("error: ")}) {
      if (line.starts_with(start)) line.remove_prefix(start.size());
    }
    if (!line.empty()) text::append(message, line, "; ");
  }
  throw SlurmError(name, message.empty() ? "failed without a message" : message);
}

/// What squeue says of a chunk.
struct Task {
  std::string batch;
  std::size_t index = 0;
  std::string state, node, reason;

  /// A task that is completing may do so for ever, with all of its results written.
  bool is_ended() const {
    static const std::set<std::string> kEnded = {"COMPLETED", "COMPLETING", "FAILED",       "CANCELLED",
                                                 "TIMEOUT",   "NODE_FAIL",  "PREEMPTED",    "BOOT_FAIL",
                                                 "DEADLINE",  "REVOKED",    "OUT_OF_MEMORY"};
    return kEnded.contains(state);
  }
  std::string told() const { return state + (state == "PENDING" && reason != "None" ? " (" + reason + ")" : ""); }
};

std::vector<Task> tasks_of(const std::set<std::string>& batches) {
  std::vector<Task> tasks;
  if (batches.empty()) return tasks;
  const std::string out = ask({"squeue", "--noheader", "--array", "--states=all", "--format=%j|%K|%T|%N|%r",
                               "--name=" + text::joined({batches.begin(), batches.end()}, ",")});
  for (const std::string_view line : text::split(out, '\n')) {
    const std::vector<std::string_view> words = text::split(line, '|');
    if (words.size() < 5) continue;
    const auto index = text::parse_integer(words[1]);
    if (index && *index >= 0)
      tasks.push_back({std::string(words[0]), static_cast<std::size_t>(*index), std::string(words[2]), std::string(words[3]),
                       std::string(words[4])});
  }
  return tasks;
}

void cancel(const std::set<std::string>& batches) {
  for (const std::string& batch : batches) ask({"scancel", "--name=" + batch});
}

std::set<std::string> names_of(const std::vector<fs::path>& batches) {
  std::set<std::string> names;
  for (const fs::path& file : batches) names.insert(file.stem().string());
  return names;
}

/// Processors of a partition that are not down. Throws SlurmError where there is no such partition.
int processors_of(const std::string& partition) {
  std::vector<std::string> command = {"sinfo", "--noheader", "--format=%C"};
  if (!partition.empty()) command.push_back("--partition=" + partition);
  int all = 0, lines = 0;
  const std::string out = ask(std::move(command));
  for (const std::string_view line : text::split(out, '\n')) {
    const std::vector<std::string_view> parts = text::split(text::trim(line), '/');  // allocated, idle, other, all
    if (parts.size() != 4) continue;
    ++lines;
    for (std::size_t k = 0; k < 2; ++k) all += static_cast<int>(text::parse_integer(parts[k]).value_or(0));
  }
  if (lines == 0)
    throw SlurmError("sinfo", partition.empty() ? "tells no partition" : "knows no partition '" + partition + "'");
  return std::max(all, 1);
}

std::size_t most_in_array() {
  const std::string config = ask({"scontrol", "show", "config"});
  for (const std::string_view line : text::split(config, '\n')) {
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos || text::trim(line.substr(0, equals)) != "MaxArraySize") continue;
    const auto most = text::parse_integer(text::trim(line.substr(equals + 1)));
    if (most && *most > 0) return static_cast<std::size_t>(*most);
    throw Error("MaxArraySize", "of Slurm is " + std::string(text::trim(line.substr(equals + 1))) + ", expected job arrays");
  }
  throw Error("scontrol", "does not tell MaxArraySize");
}

std::string in_quotes(const std::string& word) {
  std::string all = "'";
  for (const char c : word) all += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return all + "'";
}

/// The first and the last line of a file that are not empty, in brief; "" where it cannot be read.
std::pair<std::string, std::string> ends_of(const fs::path& file) {
  std::pair<std::string, std::string> ends;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    const std::string_view text = text::trim(line).substr(0, 300);
    if (text.empty()) continue;
    if (ends.first.empty()) ends.first = text;
    ends.second = text;
  }
  return ends;
}

std::string in_words(const std::map<std::string, int>& states) {
  std::string all;
  for (const auto& [state, number] : states) text::append(all, std::to_string(number) + " " + state);
  return all;
}

/// A chunk in the queue.
struct Sent {
  std::string batch;
  std::size_t index = 0;
  Chunk chunk;
  std::optional<WallClock::time_point> ended{};  // since when Slurm does not have it, or says that it has ended
  std::string said = "not in the queue";         // by Slurm at last: "TIMEOUT on n1"
};

class Coordinator {
 public:
  Coordinator(const Farm& farm, const Facts& facts, Registry& registry, const fs::path& folder, const SlurmOptions& options,
              const FarmHooks& hooks, const std::function<void(const std::string&)>& tell)
      : farm_(farm),
        facts_(facts),
        registry_(registry),
        folder_(fs::absolute(folder) / kChunksFolder),
        options_(options),
        hooks_(hooks),
        tell_(tell),
        merger_(farm, facts, registry, folder_, tell),
        out_(static_cast<std::size_t>(farm.study().design.runs), false) {}

  bool fill() {
    make_folder(folder_);
    adopt();
    try {
      while (step()) {
        const WallClock::time_point next = WallClock::now() + options_.look;
        while (!hooks_.stops() && WallClock::now() < next)
          std::this_thread::sleep_for(std::min<std::chrono::milliseconds>(options_.look, std::chrono::milliseconds(20)));
      }
    } catch (...) {
      end_all();
      throw;
    }
    end_all();
    return is_complete();
  }

 private:
  bool is_complete() const { return merger_.over() == farm_.study().design.runs; }

  Ranges missing_of(const Ranges& ranges) const {
    Ranges missing;
    for (const auto& [first, last] : ranges) {
      for (std::int64_t run = first; run <= last; ++run) {
        if (!merger_.is_over(run)) add(missing, run);
      }
    }
    return missing;
  }

  void send(Sent sent) {
    for (const auto& [first, last] : sent.chunk.ranges) {
      for (std::int64_t run = first; run <= last; ++run) out_[static_cast<std::size_t>(run - 1)] = true;
    }
    sent_.push_back(std::move(sent));
  }

  /// Takes over the chunks of an earlier process.
  void adopt() {
    for (const fs::path& file : files_of_batches(folder_)) {
      try {
        const Batch batch = read_batch(file);
        if (batch.facts != facts_) throw Error(file.string(), "is of another study");
        check_runs(batch, farm_.study().design.runs);
        for (std::size_t k = 0; k < batch.chunks.size(); ++k) send({batch.name, k, batch.chunks[k]});
      } catch (const Error& error) {
        tell_(std::string(error.what()) + "; its runs are sent again");
      }
    }
  }

  /// Returns whether there is more to do.
  bool step() {
    if (merger_.merge()) answered_ = WallClock::now();
    hooks_.progress(merger_.over(), merger_.failed(), where_);
    if (hooks_.stops()) return false;
    if (!is_complete() && WallClock::now() < asks_) return true;
    asks_ = WallClock::now() + options_.ask;
    if (!is_complete()) look_into_queue();
    drop();
    if (is_complete()) return false;
    if (sent_.size() <= kMostSent / 2) fill_queue();
    if (WallClock::now() - answered_ > options_.patience)
      throw Error("Slurm", "has not answered for " + text::to_text(std::chrono::duration<double>(options_.patience).count()) +
                               " s: " + trouble_);
    if (!sent_.empty() || has_more()) return true;
    const std::int64_t missing = farm_.study().design.runs - merger_.over();
    tell_(text::counted(missing, "run") + (missing == 1 ? " is" : " are") + " missing: " + text_of(missing_of(given_up_)) +
          "; what their chunks printed is in " + folder_.string());
    return false;
  }

  void look_into_queue() {
    std::set<std::string> batches;
    for (const Sent& sent : sent_) batches.insert(sent.batch);
    std::map<std::pair<std::string, std::size_t>, Task> tasks;
    try {
      for (Task& task : tasks_of(batches)) tasks.insert_or_assign(std::pair(task.batch, task.index), task);
      answered_ = WallClock::now();
    } catch (const Error& error) {
      note(error);
      return;
    }
    std::map<std::string, int> states;
    for (Sent& sent : sent_) {
      const auto found = tasks.find({sent.batch, sent.index});
      const bool is_ended = found == tasks.end() || found->second.is_ended();
      if (found != tasks.end())
        sent.said = found->second.state + (found->second.node.empty() ? "" : " on " + found->second.node);
      if (!is_ended) ++states[found->second.told()];
      if (is_ended != sent.ended.has_value()) sent.ended = is_ended ? std::optional(WallClock::now()) : std::nullopt;
    }
    where_ = in_words(states);
  }

  /// Forgets the chunks whose runs are over, and those whose runs will not come.
  void drop() {
    std::error_code none;
    std::map<std::string, std::pair<std::string, Ranges>> lost;  // the first reason and the runs, by the reason without numbers
    std::set<std::string> batches;
    const std::size_t erased = std::erase_if(sent_, [&](const Sent& sent) {
      const fs::path file = folder_ / (sent.batch + "_" + std::to_string(sent.index));
      const Ranges missing = missing_of(sent.chunk.ranges);
      if (missing.empty()) {
        fs::remove(file.string() + ".log", none);
        return true;
      }
      const auto [node, refusal] = ends_of(file.string() + ".refused");
      std::string why;
      if (!node.empty()) {
        refusing_.insert(node);
        fs::remove(file.string() + ".refused", none);
        why = "the node " + node + " cannot make them, " + (refusal == node ? "its program says nothing" : refusal);
      } else if (sent.ended && WallClock::now() - *sent.ended > options_.grace) {
        why = "they were lost";
        for (const std::string& said : {sent.said, ends_of(file.string() + ".log").second}) text::append(why, said);
      } else {
        batches.insert(sent.batch);
        return false;
      }
      why = (lose(sent.chunk, missing) ? "runs are sent again, " : "runs are given up, ") + why;
      suspects_.insert(sent.batch);
      auto& [first, runs] = lost[without_numbers(why)];
      if (runs.empty()) first = why;
      runs.insert(runs.end(), missing.begin(), missing.end());
      return true;
    });
    for (const auto& [unused, told] : lost) tell_(told.first + ": " + text_of(told.second));
    if (erased == 0) return;
    for (const fs::path& file : files_of_batches(folder_)) {
      if (!batches.contains(file.stem().string())) fs::remove(file, none);
    }
  }

  /// Returns whether the runs are to be sent again.
  bool lose(const Chunk& chunk, const Ranges& missing) {
    const int attempt = missing == chunk.ranges ? chunk.attempt + 1 : 1;
    if (attempt <= kAttempts) {
      lost_.push_back({missing, attempt});
    } else {
      given_up_.insert(given_up_.end(), missing.begin(), missing.end());
    }
    return attempt <= kAttempts;
  }

  bool has_more() {
    const std::int64_t runs = farm_.study().design.runs;
    while (next_ <= runs && (merger_.is_over(next_) || out_[static_cast<std::size_t>(next_ - 1)])) ++next_;
    return !lost_.empty() || next_ <= runs;
  }

  /// Only if there are more. `runs`: at most so many, of those that were not sent before. Without runs where lost ones came after all.
  Chunk next_chunk(std::int64_t runs) {
    Chunk chunk;
    if (!lost_.empty()) {
      chunk = {missing_of(lost_.front().ranges), lost_.front().attempt};
      lost_.pop_front();
      return chunk;
    }
    for (; has_more() && runs > 0; --runs) add(chunk.ranges, next_++);
    return chunk;
  }

  void fill_queue() {
    bool answers = false;
    try {
      while (has_more() && sent_.size() < kMostSent) {
        if (most_ == 0) most_ = most_in_array();
        const int processors = processors_of(options_.partition);
        answers = true;
        const Registry::Totals totals = registry_.totals();
        const std::int64_t made = totals.done + totals.failed;
        const std::int64_t runs = runs_of_chunk(totals.seconds / static_cast<double>(std::max<std::int64_t>(made, 1)),
                                                farm_.study().design.runs - made, processors, options_.threads);
        Batch batch{new_name(), options_.threads, facts_, {}};
        while (has_more() && batch.chunks.size() < std::min(most_, kMostSent - sent_.size())) {
          if (Chunk chunk = next_chunk(runs); !chunk.ranges.empty()) batch.chunks.push_back(std::move(chunk));
        }
        if (batch.chunks.empty()) return;
        write_batch(folder_, batch);
        submit(batch);
        for (std::size_t k = 0; k < batch.chunks.size(); ++k) send({batch.name, k, std::move(batch.chunks[k])});
      }
    } catch (const SlurmError& error) {
      if (is_first_ && sent_.empty()) throw;
      note(error);
      if (answers && sent_.empty() && !refusing_.empty()) give_up();
    }
  }

  void give_up() {
    while (has_more()) {
      const Chunk chunk = next_chunk(farm_.study().design.runs);
      given_up_.insert(given_up_.end(), chunk.ranges.begin(), chunk.ranges.end());
    }
  }

  /// If it fails, the chunks are to be sent again.
  void submit(const Batch& batch) {
    std::string log;  // in which % begins a name of sbatch
    for (const char c : folder_.string()) log += c == '%' ? std::string("%%") : std::string(1, c);
    std::vector<std::string> command = {"sbatch",
                                        "--parsable",
                                        "--no-requeue",
                                        "--ntasks=1",
                                        "--job-name=" + batch.name,
                                        "--array=0-" + std::to_string(batch.chunks.size() - 1),
                                        "--cpus-per-task=" + std::to_string(options_.threads),
                                        "--chdir=" + folder_.string(),
                                        "--output=" + log + "/" + batch.name + "_%a.log"};
    if (!options_.partition.empty()) command.push_back("--partition=" + options_.partition);
    if (!refusing_.empty()) command.push_back("--exclude=" + text::joined({refusing_.begin(), refusing_.end()}, ","));
    std::string script = "#!/bin/sh\n";
    for (const auto& [name, value] : options_.environment) script += "export " + name + "=" + in_quotes(value) + "\n";
    script += "export COTWIN_CPU=" + in_quotes(fact_of(facts_, "instruction set", "the study")) + "\n";
    const std::string program = in_quotes(options_.program), file = in_quotes((folder_ / batch.name).string());
    script += "if ! said=$(" + program + " --version 2>&1); then\n  refused=" + file + "_$SLURM_ARRAY_TASK_ID.refused\n" +
              "  printf '%s\\n%s\\n' \"$SLURMD_NODENAME\" \"$said\" >\"$refused.new\" && mv \"$refused.new\" \"$refused\"\n  "
              "exit 1\nfi\n" +
              "exec " + program + " farm chunk " + file + ".json \"$SLURM_ARRAY_TASK_ID\"\n";
    try {
      ask(std::move(command), script);
      is_first_ = false;
    } catch (const SlurmError& error) {
      if (std::string_view(error.what()).find("timed out") != std::string_view::npos) return;  // it may have been taken
      fs::remove(folder_ / (batch.name + ".json"));
      lost_.insert(lost_.end(), batch.chunks.begin(), batch.chunks.end());
      throw;
    }
    answered_ = WallClock::now();
  }

  std::string new_name() const {
    std::string name;
    for (const char c : farm_.study().name.substr(0, 40)) name += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
    std::random_device random;
    return name + "-" + hexadecimal((std::uint64_t{random()} << 32) | random());
  }

  /// Ends what is still in the queue. The runs that are over by then come into the registry.
  void end_all() noexcept {
    try {
      std::set<std::string> batches = suspects_;
      for (const fs::path& file : files_of_batches(folder_)) batches.insert(file.stem().string());
      cancel(batches);
      const WallClock::time_point end = WallClock::now() + kEnding;
      while (!is_complete() && WallClock::now() < end) {
        const std::vector<Task> tasks = tasks_of(batches);
        if (std::ranges::all_of(tasks, [](const Task& task) { return task.is_ended() && task.state != "COMPLETING"; })) break;
        std::this_thread::sleep_for(options_.look);
      }
      merger_.merge();
      hooks_.progress(merger_.over(), merger_.failed(), "");
    } catch (const std::exception& error) {
      tell_(std::string("the chunks in the queue: ") + error.what());
    }
    std::error_code none;
    if (is_complete()) {
      fs::remove_all(folder_, none);
    } else {
      for (const fs::path& file : files_of_batches(folder_)) fs::remove(file, none);
    }
  }

  void note(const Error& error) {
    if (trouble_ != error.what()) tell_(error.what());
    trouble_ = error.what();
  }

  const Farm& farm_;
  const Facts& facts_;
  Registry& registry_;
  const fs::path folder_;
  const SlurmOptions& options_;
  const FarmHooks& hooks_;
  const std::function<void(const std::string&)>& tell_;
  Merger merger_;
  std::vector<bool> out_;  // runs that were sent
  std::int64_t next_ = 1;  // the first run that may not have been sent
  std::vector<Sent> sent_;
  std::deque<Chunk> lost_;  // to be sent again
  Ranges given_up_;
  std::set<std::string> refusing_;  // nodes
  std::set<std::string> suspects_;  // batches with lost chunks, which may still run
  std::size_t most_ = 0;            // chunks of a job array
  bool is_first_ = true;
  std::string where_, trouble_;
  WallClock::time_point answered_ = WallClock::now(), asks_ = answered_;
};

}  // namespace

std::int64_t runs_of_chunk(double seconds, std::int64_t missing, int processors, int threads) {
  const double all = static_cast<double>(missing) * seconds / std::max(processors, threads);
  const double runs = std::clamp(all / 4, kBriefest, kLongest) * threads / std::max(seconds, 1e-6);
  return std::clamp(static_cast<std::int64_t>(runs), std::int64_t{threads}, std::max<std::int64_t>(missing, threads));
}

void check_slurm(const std::string& partition) {
  most_in_array();
  processors_of(partition);
}

bool fill_on_slurm(const Farm& farm, const Facts& facts, Registry& registry, const fs::path& folder,
                   const SlurmOptions& options, const FarmHooks& hooks, const std::function<void(const std::string&)>& tell) {
  return Coordinator(farm, facts, registry, folder, options, hooks, tell).fill();
}

std::string chunks_in_slurm(const fs::path& folder) {
  std::map<std::string, int> states;
  for (const Task& task : tasks_of(names_of(files_of_batches(folder / kChunksFolder)))) {
    if (!task.is_ended()) ++states[task.told()];
  }
  return in_words(states);
}

void cancel_in_slurm(const fs::path& folder) {
  const std::vector<fs::path> files = files_of_batches(folder / kChunksFolder);
  cancel(names_of(files));
  for (const fs::path& file : files) fs::remove(file);
}

}  // namespace cotwin::master
