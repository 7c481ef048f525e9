#include "master/api/cotwin.h"
#include "master/results/results.h"
#include "models/bag/bag.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/file.h"
#include "models/trajectory/columns.h"

namespace cotwin {

namespace {

[[maybe_unused]] const bool reads_bags = (bag::start(), true);

}  // namespace

Recording load_recording(const std::filesystem::path& file, const std::string& t_column, double t_unit,
                         const std::string& topic) {
  constexpr std::uint64_t kMostBytes = std::uint64_t{16} << 30;
  const bool is_bag = csv::is_bag(file);
  std::string text = is_bag ? "" : text::read_file(file, "a recording (CSV)", kMostBytes);
  Recording recording;
  // Whole rows end with a line feed; what follows the last one is the beginning of a row.
  const std::size_t last = text.rfind('\n');
  if (last != std::string::npos && last + 1 < text.size()) {
    text.resize(last + 1);
    recording.cut = true;
  }
  const std::unique_ptr<csv::Source> table =
      is_bag ? csv::open(file, {.topic = topic}) : std::make_unique<csv::Reader>(text, file.filename().string());
  csv::Source& reader = *table;
  const std::size_t time = trajectory::find_time_column(reader, file.string(), t_column, " or its name, t_column");
  recording.names = reader.names();
  recording.names.erase(recording.names.begin() + static_cast<std::ptrdiff_t>(time));
  recording.names.insert(recording.names.begin(), "time");
  try {
    const nlohmann::json record =
        nlohmann::json::parse(text::read_file(file.parent_path() / "run.json", "JSON"), nullptr, false);
    const report::ColumnFacts facts = report::column_facts(record);
    for (std::string& name : recording.names) {
      const auto fact = facts.find(name);
      recording.units.push_back(fact == facts.end() ? name == "time" ? "s" : "" : fact->second.unit);
      recording.joints.push_back(fact == facts.end() ? "" : fact->second.joint);
      if (fact != facts.end()) name = fact->second.name;
    }
  } catch (const Error&) {  // there is none
  }
  while (reader.next()) {
    recording.values.push_back(t_unit * reader.real(time));
    for (std::size_t column = 0; column < recording.names.size(); ++column) {
      if (column != time) recording.values.push_back(reader.real(column));
    }
    ++recording.rows;
  }
  return recording;
}

}  // namespace cotwin
