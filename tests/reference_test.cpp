// docs/reference/ is exactly the output of `cotwin reference docs/reference`, and docs/library.md shows the unit that is installed as an example.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>

#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace reference_test {
namespace {

namespace fs = std::filesystem;

std::map<std::string, std::string> pages(const fs::path& folder) {
  std::map<std::string, std::string> found;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    std::ifstream in(entry.path());
    std::stringstream text;
    text << in.rdbuf();
    found[entry.path().filename().string()] = text.str();
  }
  return found;
}

TEST(Reference, IsWrittenFromTheUnitsDeclarations) {
  const fs::path folder = fs::temp_directory_path() / ("cotwin_reference_" + std::to_string(std::rand()));
  fs::remove_all(folder);
  const auto ran = cotwin::testing::run_program({"reference", folder});
  ASSERT_EQ(ran.code, 0) << ran.err;
  const auto written = pages(folder), kept = pages(fs::path(cotwin::places::source()) / "docs/reference");
  fs::remove_all(folder);
  ASSERT_FALSE(written.empty());
  for (const auto& [name, text] : written) {
    ASSERT_TRUE(kept.contains(name)) << "no page " << name << "; run: cotwin reference docs/reference";
    EXPECT_EQ(kept.at(name), text) << name
                                   << " differs from the declarations of the units; run: cotwin reference docs/reference";
  }
  EXPECT_EQ(kept.size(), written.size()) << "docs/reference has pages without a unit";
}

TEST(Library, ShowsTheUnitOfTheExample) {
  const fs::path source = cotwin::places::source();
  const std::string page = pages(source / "docs").at("library.md");
  for (const char* file : {"spring.h", "spring.cpp"}) {
    const std::string text = pages(source / "tests/install/consumer/spring").at(file);
    ASSERT_GT(text.size(), 500u);
    EXPECT_NE(page.find("```cpp\n" + text + "```\n"), std::string::npos) << "docs/library.md differs from " << file;
  }
}

}  // namespace
}  // namespace reference_test
