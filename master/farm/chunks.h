#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "master/farm/farm.h"
#include "master/farm/registry.h"

/// Chunks of a study, whose runs other machines make. They share a folder with the owner of the registry, `chunks` in that of the study:
///   BATCH.json         chunks that were sent together, with all on which their runs depend
///   BATCH_K_N.rows     the N-th part of the runs of chunk K, counted from 0, that are over
///   BATCH_K.refused    the name of a node that cannot make chunk K, and why
///   BATCH_K.log        what the program of chunk K and the queue print
/// Each file appears at once and whole, and only the owner of the registry removes it. A run counts once, however often it comes.
namespace cotwin::master {

inline constexpr const char* kChunksFolder = "chunks";

using Ranges = std::vector<std::pair<std::int64_t, std::int64_t>>;  // of runs, first to last

struct Chunk {
  Ranges ranges;
  int attempt = 1;  // the number of times that these were sent, of which none came
};

struct Batch {
  std::string name;
  int threads = 1;  // of each chunk
  Facts facts;      // of the study, and "folder", in which it began
  std::vector<Chunk> chunks;
};

/// Throws Error if it cannot be written.
void write_batch(const std::filesystem::path& folder, const Batch& batch);
/// Throws Error.
Batch read_batch(const std::filesystem::path& file);
/// Throws Error for a run that a study of so many does not have.
void check_runs(const Batch& batch, std::int64_t runs);
std::vector<std::filesystem::path> files_of_batches(const std::filesystem::path& folder);

/// On a node: makes a chunk, and writes those of its runs that are over, each minute and at the end, also after `stops`. Throws Error if
/// they cannot be written.
void make_chunk(const Farm& farm, const Batch& batch, std::size_t index, const std::filesystem::path& folder,
                const std::function<bool()>& stops);
/// In a job of Slurm: tells why its node cannot make a chunk.
void refuse_chunk(const Batch& batch, std::size_t index, const std::filesystem::path& folder, const std::string& why);

/// The runs of a study that a chunk sent.
struct Part {
  Maker maker;
  std::vector<RunRow> rows;
};
/// Reads a part. Throws RequestError for text that is damaged or of another study than these facts.
Part read_part(std::string_view text, const Farm& farm, const Facts& facts);

/// Adds the runs of all parts in the folder to the registry and removes the parts.
class Merger {
 public:
  /// `tell`: gets a sentence on each part that cannot be read. Such a part is removed: its runs are missing.
  Merger(const Farm& farm, Facts facts, Registry& registry, std::filesystem::path folder,
         std::function<void(const std::string&)> tell);

  /// Returns whether there were parts. Throws Error if the registry cannot be written: then the parts remain.
  bool merge();
  bool is_over(std::int64_t run) const { return over_[static_cast<std::size_t>(run - 1)]; }
  std::int64_t over() const { return ended_; }
  std::int64_t failed() const { return failed_; }

 private:
  const Farm& farm_;
  Facts facts_;
  Registry& registry_;
  std::filesystem::path folder_;
  std::function<void(const std::string&)> tell_;
  std::vector<bool> over_;
  std::int64_t ended_ = 0, failed_ = 0;
  std::map<std::pair<std::string, std::int64_t>, std::int64_t> sessions_;  // by host and process
};

/// Adds a run, which no run in them follows.
void add(Ranges& ranges, std::int64_t run);
/// "1 to 12, 40, 42 to 47", the first ten of them.
std::string text_of(Ranges ranges);

}  // namespace cotwin::master
