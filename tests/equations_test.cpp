// docs/equations.md maps each equation of the paper to a file that cites its number and to a test that exists.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <string>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/places.h"

namespace {

namespace fs = std::filesystem;

using cotwin::testing::content;

struct Row {
  std::string number, file, test;
};

std::vector<Row> rows() {
  std::ifstream in(fs::path(cotwin::places::source()) / "docs/equations.md");
  const std::regex pattern(R"(^\| ([^|]+?) \|.*\| `([^`]+)` \| `([^`]+)` \|$)");
  std::vector<Row> found;
  for (std::string line; std::getline(in, line);) {
    std::smatch match;
    if (std::regex_match(line, match, pattern)) found.push_back({match[1], match[2], match[3]});
  }
  return found;
}

std::string all_tests() {
  std::string text;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(cotwin::places::source()) / "tests")) {
    if (entry.path().extension() == ".cpp") text += content(entry.path());
  }
  return text;
}

TEST(Equations, AreAllCitedWhereTheMapSays) {
  ASSERT_GT(rows().size(), 10u);
  for (const Row& row : rows()) {
    EXPECT_NE(content(fs::path(cotwin::places::source()) / row.file).find(row.number), std::string::npos)
        << row.file << " does not cite " << row.number;
  }
}

TEST(Equations, HaveTheTestsThatTheMapNames) {
  const std::string tests = all_tests();
  for (const Row& row : rows()) {
    const std::size_t dot = row.test.find('.');
    ASSERT_NE(dot, std::string::npos) << row.test;
    const std::string declared = "(" + row.test.substr(0, dot) + ", " + row.test.substr(dot + 1) + ")";
    EXPECT_NE(tests.find(declared), std::string::npos) << "no test " << row.test << " for " << row.number;
  }
}

}  // namespace
