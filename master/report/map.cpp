#include "master/report/map.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "master/report/gnuplot.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::report {

namespace {

using Json = nlohmann::ordered_json;

double number_of(const Json& value) {
  if (value.is_boolean()) return value.get<bool>() ? 1 : 0;
  return value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>();
}

std::string table_of(const Json& goals) {
  std::vector<std::string> names;
  for (const auto& [name, unused] : goals.items())
    if (!name.starts_with("q")) names.push_back(name);  // postures are in the reply
  std::ostringstream text;
  csv::Writer writer(text, names);
  for (std::size_t k = 0; k < goals["feasible_share"].size(); ++k) {
    for (const std::string& name : names) writer.cell(number_of(goals[name][k]));
    writer.end_row();
  }
  return text.str();
}

struct Axis {
  std::string name;
  std::vector<double> at;  // of each place
  double step = 0;
};

/// The two axes along which the grid has more than one place.
std::vector<Axis> axes_of(const Json& goals, const std::string& place) {
  std::vector<Axis> axes;
  for (const char* name : {"x_m", "y_m", "z_m"}) {
    if (!goals.contains(name)) break;
    const auto at = goals[name].get<std::vector<double>>();
    const std::set<double> values(at.begin(), at.end());
    if (values.size() < 2) continue;
    axes.push_back(
        {std::string(1, name[0]) + " [m]", at, (*values.rbegin() - *values.begin()) / static_cast<double>(values.size() - 1)});
  }
  if (axes.size() != 2)
    throw Error(place,
                "shows a grid of two dimensions, but the goals have " + std::to_string(axes.size()) + ", expected a file .csv");
  return axes;
}

/// "least energy [J]" of "energy_J".
std::string title_of(const std::string& cost) {
  const std::size_t at = cost.rfind('_');
  const std::string unit = cost.substr(at + 1);
  return "least " + (unit == "s" || unit == "J" ? cost.substr(0, at) + " [" + unit + "]" : cost);
}

std::string picture_of(const Json& goals, const std::string& place) {
  const std::vector<Axis> axes = axes_of(goals, place);
  std::vector<std::string> costs;
  for (const auto& [name, unused] : goals.items())
    if (!name.ends_with("_m") && !name.starts_with("q") && name != "reached" && name != "feasible_share") costs.push_back(name);
  const std::size_t columns = std::min<std::size_t>(costs.size(), 3), rows = (costs.size() + columns - 1) / columns;
  std::string script = "set encoding utf8\nset terminal svg noenhanced size " + std::to_string(380 * columns) + "," +
                       std::to_string(340 * rows) + " font 'Arial,11' background rgb 'white'\nset multiplot layout " +
                       std::to_string(rows) + "," + std::to_string(columns) +
                       "\nset size ratio -1\nset key off\nset tics nomirror\n"
                       "set palette defined (0 '#440154', 1 '#3b528b', 2 '#21918c', 3 '#5ec962', 4 '#fde725')\n";
  script += "set xlabel " + Gnuplot::quoted(axes[0].name) + "\nset ylabel " + Gnuplot::quoted(axes[1].name) + "\n";
  for (std::size_t i = 0; i < 2; ++i) {
    const auto [least, most] = std::ranges::minmax(axes[i].at);
    script += std::string(i == 0 ? "set xrange [" : "set yrange [") + text::to_text(least - axes[i].step / 2) + ":" +
              text::to_text(most + axes[i].step / 2) + "]\n";
  }
  for (const std::string& cost : costs) {
    std::string found, others;
    for (std::size_t k = 0; k < goals[cost].size(); ++k) {
      const std::string at = text::to_text(axes[0].at[k]) + " " + text::to_text(axes[1].at[k]);
      if (!goals[cost][k].is_null())
        found += at + " " + goals[cost][k].dump() + "\n";
      else if (goals["reached"][k] == true)
        others += at + "\n";
    }
    const std::string box = "(" + text::to_text(axes[0].step / 2) + "):(" + text::to_text(axes[1].step / 2) + ")";
    script += "set title " + Gnuplot::quoted(title_of(cost)) + "\n$found << EOD\n" + found + "EOD\n$others << EOD\n" + others +
              "EOD\nplot ";
    if (!others.empty())
      script += "$others using 1:2:" + box + " with boxxyerror fillstyle solid noborder linecolor rgb '#c8c8c8'";
    if (!found.empty())
      script += std::string(others.empty() ? "" : ", ") + "$found using 1:2:" + box +
                ":3 with boxxyerror fillstyle solid noborder linecolor palette";
    if (found.empty() && others.empty()) script += "NaN";
    script += "\n";
  }
  return Gnuplot().run(script);
}

}  // namespace

void check_map_file(const std::filesystem::path& file) {
  if (file.extension() != ".csv" && file.extension() != ".svg")
    throw Error(file.string(), "has the suffix '" + file.extension().string() + "', expected .csv or .svg");
}

void write_map(const std::filesystem::path& file, const Json& reply) {
  check_map_file(file);
  if (!reply.contains("goals"))
    throw Error(file.string(),
                "shows goals, but the request has only one, expected to_grid or to_postures, and a detail above verdict");
  const Json& goals = reply["goals"];
  write_file(file, file.extension() == ".csv" ? table_of(goals) : picture_of(goals, file.string()));
}

}  // namespace cotwin::report
