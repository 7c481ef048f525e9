#pragma once
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace cotwin::testing {

/// The columns of a recording (signals.csv) by name. Empty if there is no such file.
inline std::map<std::string, std::vector<double>> read_recording(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::map<std::string, std::vector<double>> columns;
  std::vector<std::vector<double>*> order;
  std::string line, cell;
  std::getline(in, line);
  for (std::istringstream header(line); std::getline(header, cell, ',');) order.push_back(&columns[cell]);
  while (std::getline(in, line)) {
    std::istringstream row(line);
    for (std::size_t i = 0; i < order.size() && std::getline(row, cell, ','); ++i)
      order[i]->push_back(std::strtod(cell.c_str(), nullptr));
  }
  return columns;
}

}  // namespace cotwin::testing
