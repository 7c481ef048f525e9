// The documents of the project: links lead to files and headings that exist, and the README stays short.
#include <gtest/gtest.h>

#include <cctype>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/places.h"

namespace documents_test {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> documents() {
  const fs::path root = cotwin::places::source();
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(root)) {
    if (entry.path().extension() == ".md") files.push_back(entry.path());
  }
  for (const char* folder : {"docs", "examples", "models", "components", "fmu", "master", "tests"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      if (entry.path().extension() == ".md") files.push_back(entry.path());
    }
  }
  return files;
}

/// The anchors of the headings, as web pages of repositories name them.
std::set<std::string> anchors(const fs::path& file) {
  std::set<std::string> found;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with('#')) continue;
    std::string anchor;
    for (const char c : line.substr(line.find_first_not_of("# "))) {
      const auto byte = static_cast<unsigned char>(c);
      if (std::isalnum(byte) != 0 || c == '-' || c == '_' || byte >= 0x80) anchor += static_cast<char>(std::tolower(byte));
      if (c == ' ') anchor += '-';
    }
    found.insert(anchor);
  }
  return found;
}

TEST(Documents, LinkToWhatExists) {
  const std::regex link(R"(\]\(([^)\s#]*)(?:#([^)\s]*))?\))");
  std::size_t links = 0;
  for (const fs::path& document : documents()) {
    const std::string text = cotwin::testing::content(document);
    for (std::sregex_iterator at(text.begin(), text.end(), link), end; at != end; ++at) {
      const std::string path = (*at)[1], anchor = (*at)[2];
      if (path.find("://") != std::string::npos || path.starts_with("mailto:")) continue;
      const fs::path target = path.empty() ? document : document.parent_path() / path;
      ++links;
      EXPECT_TRUE(fs::exists(target)) << document << ": " << path;
      if (!anchor.empty() && target.extension() == ".md" && fs::exists(target))
        EXPECT_TRUE(anchors(target).contains(anchor)) << document << ": " << path << "#" << anchor;
    }
  }
  EXPECT_GT(links, 100u);
}

TEST(Documents, TheReadmeIsShortAndItsPicturesAreSmall) {
  const fs::path root = cotwin::places::source();
  std::ifstream in(root / "README.md");
  EXPECT_LE(std::distance(std::istream_iterator<std::string>(in), std::istream_iterator<std::string>()), 1400) << "words";
  for (const auto& picture : fs::directory_iterator(root / "docs/pictures"))
    EXPECT_LE(picture.file_size(), 100'000u) << picture;
}

}  // namespace
}  // namespace documents_test
