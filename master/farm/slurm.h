#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "master/farm/chunks.h"

/// The runs of a study as job arrays of Slurm, by its programs sbatch, squeue, sinfo, scontrol and scancel. A chunk is judged by the runs
/// that it sent (master/farm/chunks.h); what Slurm says of it decides only how long to wait for them.
namespace cotwin::master {

struct SlurmOptions {
  std::string partition;                                         // empty: that of Slurm
  std::string program;                                           // path, the same on all nodes
  std::vector<std::pair<std::string, std::string>> environment;  // of the program
  int threads = 1;                                               // of each chunk
  std::chrono::milliseconds look{500};                           // at the parts that have come
  std::chrono::milliseconds ask{5000};                           // squeue
  std::chrono::milliseconds grace{60'000};                       // a network file system shows files late
  std::chrono::milliseconds patience{600'000};                   // without any answer of Slurm and any part
};

/// Throws Error where Slurm does not answer, or has no job arrays or no such partition. Empty: its default.
void check_slurm(const std::string& partition);

/// Makes the runs that the registry lacks, of which chunks may be in the queue already. `folder`: of the study. `tell` gets a sentence on
/// all that went wrong. Returns whether all are over; otherwise `stops`, or runs are missing, which `tell` got. Throws Error if the
/// registry cannot be written, or Slurm takes no chunk or does not answer.
bool fill_on_slurm(const Farm& farm, const Facts& facts, Registry& registry, const std::filesystem::path& folder,
                   const SlurmOptions& options, const FarmHooks& hooks, const std::function<void(const std::string&)>& tell);

/// What squeue says of the chunks of a study: "3 RUNNING, 2 PENDING (Resources)"; "" where none is in the queue. Throws Error if it does
/// not answer.
std::string chunks_in_slurm(const std::filesystem::path& folder);
/// Ends the chunks of a study that are in the queue, and forgets them. Throws Error if Slurm does not answer.
void cancel_in_slurm(const std::filesystem::path& folder);

/// The number of runs in a chunk: so many that it takes about a quarter of what all processors together still need, between 5 s and 10 min.
/// `seconds`: of a run; `missing`: runs; `processors`: of the cluster; `threads`: of a chunk.
std::int64_t runs_of_chunk(double seconds, std::int64_t missing, int processors, int threads);

}  // namespace cotwin::master
