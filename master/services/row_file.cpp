#include "master/services/row_file.h"

#include <bit>

#include "models/foundation/support/error.h"

namespace cotwin::master {

static_assert(std::endian::native == std::endian::little);

RowFile::RowFile(const std::filesystem::path& place) : file_(place), numpy_(place.extension() == ".npy") {
  if (!numpy_ && place.extension() != ".csv")
    throw Error(place.string(), "has the suffix '" + place.extension().string() + "', expected .csv or .npy");
}

void RowFile::begin(const std::vector<std::string>& columns, std::size_t rows) {
  if (!numpy_) {
    csv_ = std::make_unique<csv::Writer>(file_.stream(), columns);
    return;
  }
  std::string header = "{'descr': [";
  for (const std::string& name : columns) header += "('" + name + "', '<f8'), ";
  header += "], 'fortran_order': False, 'shape': (" + std::to_string(rows) + ",)}";
  constexpr std::size_t kBefore = 10, kAlignment = 64;
  header.append(kAlignment - (kBefore + header.size() + 1) % kAlignment, ' ');
  header += '\n';
  if (header.size() > 0xFFFF) throw Error("rows", std::to_string(columns.size()) + " columns, expected fewer in a file .npy");
  const char size[] = {static_cast<char>(header.size() & 0xFF), static_cast<char>(header.size() >> 8)};
  file_.stream() << "\x93NUMPY\x01" << '\0';
  file_.stream().write(size, 2) << header;
}

void RowFile::row(const std::vector<double>& values) {
  if (numpy_)
    file_.stream().write(reinterpret_cast<const char*>(values.data()),
                         static_cast<std::streamsize>(values.size() * sizeof(double)));
  else
    csv_->row(values);
  if (!file_.stream()) file_.commit();  // throws with the system's message
}

}  // namespace cotwin::master
