// Any bytes are a table or an Error with its place. A table that was read and written again is read as the same table.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <sstream>
#include <string_view>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"

namespace {

bool same(const cotwin::csv::Table& a, const cotwin::csv::Table& b) {
  if (a.names != b.names || a.rows() != b.rows()) return false;
  for (std::size_t c = 0; c < a.columns.size(); ++c) {
    for (std::size_t r = 0; r < a.rows(); ++r) {
      const double x = a.columns[c][r], y = b.columns[c][r];
      if (!(x == y || (std::isnan(x) && std::isnan(y)))) return false;
    }
  }
  return true;
}

bool ends_in_empty_name(const cotwin::csv::Table& table) { return table.names.back().empty(); }

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    cotwin::csv::Reader reader(text, "fuzz.csv");
    while (reader.next()) {
      for (std::size_t c = 0; c < reader.names().size(); ++c) {
        if (reader.text(c).size() > size) std::abort();
      }
    }
  } catch (const cotwin::Error& e) {
    if (std::string_view(e.what()).substr(0, 8) != "fuzz.csv") std::abort();
  }
  try {
    const cotwin::csv::Table table = cotwin::csv::parse(text, "fuzz.csv");
    if (ends_in_empty_name(table)) return 0;  // an empty last name looks like a separator at the end
    std::ostringstream out;
    cotwin::csv::Writer writer(out, table.names);
    for (std::size_t r = 0; r < table.rows(); ++r) {
      for (const auto& column : table.columns) writer.cell(column[r]);
      writer.end_row();
    }
    const std::string written = out.str();
    if (!same(table, cotwin::csv::parse(written, "written.csv", {}, {','}))) std::abort();
  } catch (const cotwin::Error& e) {
    if (std::string_view(e.what()).substr(0, 8) != "fuzz.csv") std::abort();
  }
  return 0;
}
