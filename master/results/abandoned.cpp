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

/// The number of bytes before byte `end` up to the end of the last complete row.
std::uintmax_t whole_rows(std::ifstream& in, std::streamoff end) {
  std::array<char, 4096> part{};
  while (end > 0) {
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

std::string keep_rows(const fs::path& file, const fs::path& shown) {
  std::error_code error;
  const fs::path part = file.string() + ".part";
  if (!fs::is_regular_file(part, error)) return "";
  std::ifstream in(part, std::ios::binary | std::ios::ate);
  const std::uintmax_t end = whole_rows(in, in.tellg());
  const std::uintmax_t last = end > 0 ? whole_rows(in, static_cast<std::streamoff>(end) - 1) : 0;
  in.seekg(static_cast<std::streamoff>(last));
  std::string time;
  std::getline(in, time, ',');
  fs::resize_file(part, end, error);
  fs::rename(part, file, error);
  if (error) return "";
  if (last == 0) return "; no row was written yet";  // that is the header
  return "; the rows up to t = " + time.substr(0, time.find('\n')) + " s are in " + shown.string();
}

std::string close_abandoned_run(const fs::path& folder, const fs::path& shown, pid_t process, const std::string& reason) {
  const fs::path record = folder / ResultsFolder::kRecord;
  try {
    const ResultsFolder unlocked(folder);  // removes the lock of a process that has ended
    std::ifstream in(record);
    auto j = nlohmann::ordered_json::parse(in, nullptr, false);
    if (!j.is_object() || j.value("process", pid_t{0}) != process || j.value("state", "") != "running") return "";
    const std::string kept = keep_rows(folder / ResultsFolder::kSignals, shown / ResultsFolder::kSignals);
    j["state"] = "failed";
    j["reason"] = reason;
    write_file(record, j.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
    return kept;
  } catch (const std::exception&) {  // another run has begun there, a damaged run.json, or a full disk: stderr has the reason
    return "";
  }
}

}  // namespace cotwin::master
