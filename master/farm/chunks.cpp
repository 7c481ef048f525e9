#include "master/farm/chunks.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "components/services/json/request.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/file_hash.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;
using services::Json;
using services::Reader;
using services::RequestError;

constexpr int kMostNumber = std::numeric_limits<int>::max();
constexpr std::size_t kMostRanges = 10;
constexpr std::chrono::seconds kPartLength{60};
constexpr std::size_t kAnyValues = ~std::size_t{0};  // the size of its files follows from the study
constexpr std::size_t kPartRows = 100'000;           // some 25 MB with ten figures each

std::string as_text(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

/// Equal for equal facts.
std::string identity(const Facts& facts) {
  ByteWriter all;
  for (const auto& [name, value] : facts) {
    all.text(name);
    all.text(value);
  }
  return hexadecimal(cotwin::hash_of(all.bytes()));
}

const Json& array_of(Reader& r, const char* name) {
  const Json* array = r.any(name);
  if (array == nullptr || !array->is_array()) throw RequestError(r.pointer(name), "expected an array");
  return *array;
}

int number_of(Reader& r, const char* name, int most = kMostNumber) {
  const int number = r.integer(name, 1, most, 0);
  if (number == 0) throw RequestError(r.pointer(name), "is missing");
  return number;
}

Json json_of(const RunRow& row) {
  Json figures = Json::array();
  for (const double figure : row.figures) figures.push_back(std::isfinite(figure) ? Json(figure) : Json());
  return {{"run", row.run},          {"time", row.time},
          {"seconds", row.seconds},  {"success", row.success ? Json(*row.success) : Json()},
          {"failure", row.failure},  {"figures", figures},
          {"warnings", row.warnings}};
}

RunRow read_row(const Json& json, const std::string& pointer, const Farm& farm) {
  Reader r(json, pointer);
  RunRow row;
  row.run = number_of(r, "run", static_cast<int>(farm.study().design.runs));
  row.values = farm.study().design.point(row.run);
  row.time = r.number("time");
  row.seconds = r.not_negative("seconds", 0);
  row.failure = r.text("failure");
  if (const Json* success = r.any("success"); success != nullptr && !success->is_null()) {
    if (!success->is_boolean()) throw RequestError(r.pointer("success"), "expected true, false or null");
    row.success = success->get<bool>();
  }
  for (const Json& figure : array_of(r, "figures")) {
    if (!figure.is_number() && !figure.is_null()) throw RequestError(r.pointer("figures"), "expected numbers or null");
    row.figures.push_back(figure.is_null() ? std::nan("") : figure.get<double>());
  }
  const std::size_t expected = row.failure.empty() ? farm.figures().size() : 0;
  if (row.figures.size() != expected)
    throw RequestError(r.pointer("figures"),
                       "has " + std::to_string(row.figures.size()) + ", expected " + std::to_string(expected));
  row.warnings = r.texts("warnings", {}, nullptr);
  r.finish();
  return row;
}

Chunk read_chunk(const Json& json, const std::string& pointer) {
  Reader r(json, pointer);
  Chunk chunk;
  chunk.attempt = number_of(r, "attempt");
  for (const Json& range : array_of(r, "runs")) {
    const auto is_run = [](const Json& number) {
      return number.is_number_unsigned() && number > 0u && number <= unsigned{kMostNumber};
    };
    if (!range.is_array() || range.size() != 2 || !is_run(range[0]) || !is_run(range[1]) || range[0] > range[1])
      throw RequestError(r.pointer("runs"), "expected pairs of a first and a last run");
    chunk.ranges.emplace_back(range[0].get<std::int64_t>(), range[1].get<std::int64_t>());
  }
  r.finish();
  return chunk;
}

std::string place_of(const Batch& batch, std::size_t index) { return batch.name + "_" + std::to_string(index); }

}  // namespace

void write_batch(const fs::path& folder, const Batch& batch) {
  Json facts = Json::object(), chunks = Json::array();
  for (const auto& [name, value] : batch.facts) facts[name] = value;
  for (const Chunk& chunk : batch.chunks) chunks.push_back({{"attempt", chunk.attempt}, {"runs", chunk.ranges}});
  const Json all = {{"threads", batch.threads}, {"facts", facts}, {"chunks", chunks}};
  write_file(folder / (batch.name + ".json"), as_text(all) + "\n");
}

Batch read_batch(const fs::path& file) {
  try {
    const Json object = services::parse_object(text::read_file(file, "chunks of a study"), kAnyValues);
    Reader r(object);
    Batch batch;
    batch.name = file.stem().string();
    batch.threads = number_of(r, "threads");
    const Json& facts = *(r.has("facts") ? r.any("facts") : throw RequestError(r.pointer("facts"), "is missing"));
    Reader of_facts(facts, r.pointer("facts"));
    for (const auto& [name, unused] : facts.items()) batch.facts.emplace_back(name, of_facts.text(name.c_str()));
    const Json& chunks = array_of(r, "chunks");
    for (std::size_t k = 0; k < chunks.size(); ++k)
      batch.chunks.push_back(read_chunk(chunks[k], r.pointer("chunks") + "/" + std::to_string(k)));
    r.finish();
    return batch;
  } catch (const RequestError& error) {
    throw Error(file.string(), error.pointer().empty() ? error.detail() : error.pointer() + ": " + error.detail());
  }
}

void check_runs(const Batch& batch, std::int64_t runs) {
  for (const Chunk& chunk : batch.chunks) {
    for (const auto& [first, last] : chunk.ranges) {
      if (last > runs)
        throw Error(batch.name, "has the run " + std::to_string(last) + ", expected 1 to " + std::to_string(runs));
    }
  }
}

std::vector<fs::path> files_of_batches(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code none;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, none)) {
    if (entry.path().extension() == ".json") files.push_back(entry.path());
  }
  std::ranges::sort(files);
  return files;
}

void make_chunk(const Farm& farm, const Batch& batch, std::size_t index, const fs::path& folder,
                const std::function<bool()>& stops) {
  using Clock = std::chrono::steady_clock;
  const Maker maker = this_process(batch.threads);
  const std::string id = identity(batch.facts);
  Json rows = Json::array();
  int part = 0;
  Clock::time_point written = Clock::now();
  const auto write = [&] {
    if (rows.empty()) return;
    const Json all = {
        {"study", id}, {"host", maker.host}, {"process", maker.process}, {"threads", maker.threads}, {"rows", std::move(rows)}};
    write_file(folder / (place_of(batch, index) + "_" + std::to_string(part++) + ".rows"), as_text(all) + "\n");
    rows = Json::array();
    written = Clock::now();
  };
  check_runs(batch, farm.study().design.runs);
  const Ranges& ranges = batch.chunks.at(index).ranges;
  std::size_t range = 0;
  std::int64_t given = 0;
  const auto next = [&]() -> std::int64_t {
    if (range < ranges.size() && given == ranges[range].second) {
      given = 0;
      ++range;
    }
    if (range == ranges.size()) return 0;
    return given = given == 0 ? ranges[range].first : given + 1;
  };
  farm.run_all(batch.threads, next, stops, [&](std::span<const RunRow> over) {
    for (const RunRow& row : over) rows.push_back(json_of(row));
    if (rows.size() >= kPartRows || Clock::now() - written > kPartLength) write();
  });
  write();
}

void refuse_chunk(const Batch& batch, std::size_t index, const fs::path& folder, const std::string& why) {
  if (const char* node = std::getenv("SLURMD_NODENAME"))
    write_file(folder / (place_of(batch, index) + ".refused"), std::string(node) + "\n" + why + "\n");
}

Part read_part(std::string_view text, const Farm& farm, const Facts& facts) {
  const Json object = services::parse_object(text, kAnyValues);
  Reader r(object);
  if (r.text("study") != identity(facts)) throw RequestError(r.pointer("study"), "is another one, expected runs of this study");
  Part part;
  part.maker.host = r.text("host");
  part.maker.process = number_of(r, "process");
  part.maker.threads = number_of(r, "threads");
  const Json& rows = array_of(r, "rows");
  for (std::size_t k = 0; k < rows.size(); ++k)
    part.rows.push_back(read_row(rows[k], r.pointer("rows") + "/" + std::to_string(k), farm));
  r.finish();
  return part;
}

Merger::Merger(const Farm& farm, Facts facts, Registry& registry, fs::path folder, std::function<void(const std::string&)> tell)
    : farm_(farm),
      facts_(std::move(facts)),
      registry_(registry),
      folder_(std::move(folder)),
      tell_(std::move(tell)),
      over_(registry.over(farm.study().design.runs)) {
  const Registry::Totals totals = registry_.totals();
  ended_ = totals.done + totals.failed;
  failed_ = totals.failed;
}

bool Merger::merge() {
  std::set<fs::path> files;
  std::error_code none;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, none)) {
    if (entry.path().extension() == ".rows") files.insert(entry.path());
  }
  for (const fs::path& file : files) {
    std::string text;
    try {
      text = text::read_file(file, "runs of a chunk");
    } catch (const Error&) {
      continue;  // a network file system may show it later
    }
    Part part;
    try {
      part = read_part(text, farm_, facts_);
    } catch (const RequestError& error) {
      tell_(file.string() + " is not used: " + error.what());
    }
    std::erase_if(part.rows, [this](const RunRow& row) {
      const bool was_over = is_over(row.run);
      over_[static_cast<std::size_t>(row.run - 1)] = true;
      return was_over;
    });
    if (!part.rows.empty()) {
      const auto [session, is_new] = sessions_.try_emplace({part.maker.host, part.maker.process});
      if (is_new) session->second = registry_.begin_session(part.maker);
      registry_.add(part.rows, session->second);
      ended_ += static_cast<std::int64_t>(part.rows.size());
      failed_ += std::ranges::count_if(part.rows, [](const RunRow& row) { return !row.failure.empty(); });
    }
    fs::remove(file, none);
  }
  return !files.empty();
}

void add(Ranges& ranges, std::int64_t run) {
  if (!ranges.empty() && ranges.back().second == run - 1) {
    ranges.back().second = run;
  } else {
    ranges.emplace_back(run, run);
  }
}

std::string text_of(Ranges ranges) {
  std::ranges::sort(ranges);
  std::string all;
  std::size_t number = 0;
  for (std::size_t k = 0; k < ranges.size(); ++number) {
    const auto [first, begin_last] = ranges[k];
    std::int64_t last = begin_last;
    while (++k < ranges.size() && ranges[k].first == last + 1) last = ranges[k].second;
    if (number < kMostRanges) text::append(all, std::to_string(first) + (last > first ? " to " + std::to_string(last) : ""));
  }
  return all + (number > kMostRanges ? ", and others" : "");
}

}  // namespace cotwin::master
