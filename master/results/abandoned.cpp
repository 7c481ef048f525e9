#include "master/results/abandoned.h"

#include <array>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "master/results/results_folder.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace fs = std::filesystem;

namespace {

/// The number of bytes up to the end of the last complete row.
std::uintmax_t whole_rows(const fs::path& file) {
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  std::array<char, 4096> part{};
  for (auto end = static_cast<std::streamoff>(in.tellg()); end > 0;) {
    const std::streamoff begin = std::max<std::streamoff>(0, end - static_cast<std::streamoff>(part.size()));
    in.seekg(begin);
    in.read(part.data(), end - begin);
    if (!in) return 0;
    for (std::streamoff i = end; i > begin; --i) {
      if (part[static_cast<std::size_t>(i - begin - 1)] == '\n') return static_cast<std::uintmax_t>(i);
    }
    end = begin;
  }
  return 0;
}

}  // namespace

bool keep_rows(const fs::path& file) {
  std::error_code error;
  const fs::path part = file.string() + ".part";
  if (!fs::is_regular_file(part, error)) return false;
  fs::resize_file(part, whole_rows(part), error);
  fs::rename(part, file, error);
  return !error;
}

bool close_abandoned_run(const fs::path& folder, pid_t process, const std::string& reason) {
  const fs::path record = folder / ResultsFolder::kRecord;
  try {
    const ResultsFolder unlocked(folder);  // removes the lock of a process that has ended
    std::ifstream in(record);
    auto j = nlohmann::ordered_json::parse(in, nullptr, false);
    if (!j.is_object() || j.value("process", pid_t{0}) != process || j.value("state", "") != "running") return false;
    const bool kept = keep_rows(folder / ResultsFolder::kSignals);
    j["state"] = "failed";
    j["reason"] = reason;
    write_file(record, j.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
    return kept;
  } catch (const std::exception&) {  // another run has begun there, a damaged run.json, or a full disk: stderr has the reason
    return false;
  }
}

}  // namespace cotwin::master
