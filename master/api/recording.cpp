#include "master/api/cotwin.h"
#include "models/support/csv.h"
#include "models/support/file.h"

namespace cotwin {

Recording load_recording(const std::filesystem::path& file) {
  constexpr std::uint64_t kMostBytes = std::uint64_t{16} << 30;
  std::string text = text::read_file(file, "a recording (CSV)", kMostBytes);
  Recording recording;
  // Whole rows end with a line feed; what follows the last one is the beginning of a row.
  const std::size_t last = text.rfind('\n');
  if (last != std::string::npos && last + 1 < text.size()) {
    text.resize(last + 1);
    recording.cut = true;
  }
  csv::Reader reader(text, file.filename().string());
  recording.names = reader.names();
  while (reader.next()) {
    for (std::size_t column = 0; column < recording.names.size(); ++column) recording.values.push_back(reader.real(column));
    ++recording.rows;
  }
  return recording;
}

}  // namespace cotwin
