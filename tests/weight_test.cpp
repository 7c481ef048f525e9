// Lines of code of each room, neither blank nor comment, against those that tests/weight.txt allows.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/places.h"

namespace weight_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Weights = std::map<std::string, std::size_t>;  // lines by room

/// The lines of a C, C++ or TypeScript file that have more than blanks and comments. Lines of a text that spans several count.
std::size_t lines_of_code(const std::string& file) {
  std::size_t lines = 0;
  bool code = false;
  const char* p = file.c_str();
  const auto pass = [&](const char* end, bool comment) {
    for (; p < end; ++p) {
      if (*p == '\n') {
        lines += code;
        code = false;
      } else {
        code = code || (!comment && std::strchr(" \t\r", *p) == nullptr);
      }
    }
  };
  const auto behind = [&](const char* from, const std::string& text) {
    const char* const found = std::strstr(from, text.c_str());
    return found != nullptr ? found + text.size() : file.c_str() + file.size();
  };
  const auto is_word = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; };
  for (;;) {
    const std::size_t plain = std::strcspn(p, "/\"'`\n");
    code = code || std::strspn(p, " \t\r") < plain;
    p += plain;
    if (*p == '\0') return lines + code;
    if (p[0] == '/' && p[1] == '/') {
      p += std::strcspn(p, "\n");
    } else if (p[0] == '/' && p[1] == '*') {
      pass(behind(p + 2, "*/"), true);
    } else if (*p == '"' && p > file.c_str() && p[-1] == 'R') {
      pass(behind(p + 1, ")" + std::string(p + 1, std::strcspn(p + 1, "(")) + "\""), false);
    } else if (*p == '"' || *p == '`' ||
               (*p == '\'' && !(p > file.c_str() && is_word(p[-1]) && is_word(p[1])))) {  // 1'000 is no text
      const char ends[] = {*p, '\\', *p == '`' ? *p : '\n', '\0'};
      const char* end = p + 1;
      for (end += std::strcspn(end, ends); *end == '\\' && end[1] != '\0'; end += std::strcspn(end, ends)) end += 2;
      pass(*end == '\0' || *end == '\n' ? end : end + 1, false);
    } else {
      pass(p + 1, false);
    }
  }
}

/// "models/anomaly"; "tests" for all tests, also those of the page.
std::string room_of(const fs::path& file) {
  std::vector<std::string> folders;
  for (const fs::path& part : file.parent_path()) folders.push_back(part.string());
  if (folders.front() == "tests" || folders.back() == "test") return "tests";
  return folders.size() > 1 ? folders[0] + "/" + folders[1] : folders[0];
}

Weights measured() {
  const fs::path root = cotwin::places::source();
  const std::set<std::string> kinds = {".h", ".cpp", ".c", ".inc", ".ts"}, of_fmi = {"fmu/fmi2.h", "fmu/fmi3.h"};
  Weights found;
  for (const char* floor : {"models", "components", "fmu", "master", "tests"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / floor)) {
      const fs::path file = entry.path().lexically_relative(root);
      if (!kinds.contains(file.extension().string()) || of_fmi.contains(file.generic_string())) continue;
      std::ifstream in(entry.path());
      std::stringstream text;
      text << in.rdbuf();
      found[room_of(file)] += lines_of_code(text.str());
    }
  }
  return found;
}

/// What is wrong with lines "models/anomaly 973" beside what is measured. What a room may be lighter: kSlack.
std::vector<std::string> faults(const Weights& measured, std::istream& file) {
  constexpr std::size_t kSlack = 20;
  const std::string list = "tests/weight.txt";
  const auto floor_of = [](const std::string& room) { return room.substr(0, room.find('/')); };
  Weights allowed, floors;
  std::vector<std::string> all;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    static const std::regex row(R"(([\w/-]+) (\d{1,9}))");
    std::smatch match;
    if (!std::regex_match(line, match, row) || !allowed.emplace(match[1], std::stoul(match[2])).second)
      all.push_back(list + ":" + std::to_string(number) + ": '" + line + "', expected a room and its lines of code, once");
  }
  for (const auto& [room, lines] : measured) floors[floor_of(room)] += lines;
  for (const auto& [room, lines] : measured) {
    const std::string has = room + " has " + std::to_string(lines) + " lines of code, " + list;
    const auto known = allowed.find(room);
    if (known == allowed.end()) {
      all.push_back(has + " does not have the room: add it in a commit of its own that names the issue which allows it");
    } else if (lines > known->second) {
      all.push_back(has + " allows " + std::to_string(known->second) + " (+" + std::to_string(lines - known->second) + "; " +
                    floor_of(room) + ": " + std::to_string(floors[floor_of(room)]) +
                    "): make it lighter, or raise the number in a commit of its own that names the issue which allows it");
    } else if (lines + kSlack < known->second) {
      all.push_back(has + " allows " + std::to_string(known->second) + ": lower it to " + std::to_string(lines));
    }
  }
  for (const auto& [room, lines] : allowed) {
    if (!measured.contains(room)) all.push_back(list + " has the room " + room + ", which has no code: remove it");
  }
  return all;
}

std::vector<std::string> faults(const Weights& measured, const std::string& file) {
  std::istringstream in(file);
  return faults(measured, in);
}

TEST(Weight, OfNoRoomGrowsUnnoticed) {
  std::ifstream in(cotwin::places::source() + "/tests/weight.txt");
  ASSERT_TRUE(in) << "tests/weight.txt";
  for (const std::string& fault : faults(measured(), in)) ADD_FAILURE() << fault;
}

TEST(Weight, IsThatOfLinesWithMoreThanBlanksAndComments) {
  EXPECT_EQ(lines_of_code(""), 0u);
  EXPECT_EQ(lines_of_code("\n  \t\r\n// a\n/* b */ // c\n  /* d\n\n e */\n"), 0u);
  EXPECT_EQ(lines_of_code("int a;  // b\n}"), 2u);
  EXPECT_EQ(lines_of_code("/* a */ int b; /* c\n d */ int e;\n/* unfinished\n int f;"), 2u);
  EXPECT_EQ(lines_of_code("s = \"//\"; /* a\n */\n"), 1u);
  EXPECT_EQ(lines_of_code("s = \"\\\"/*\";\nint a;\n"), 2u);
  EXPECT_EQ(lines_of_code("char c = '\"'; /* a\n*/ char d = '\\'';\n"), 2u);
  EXPECT_EQ(lines_of_code("int n = 1'000; /* a\n'*/\n"), 1u);
  EXPECT_EQ(lines_of_code("s = R\"x(a\n\n// b)\"\n/* c\n)x\"; /* d\n*/"), 4u);
  EXPECT_EQ(lines_of_code("s = `a\n\n// b\n\\`c`; // d\n// e"), 3u);
  EXPECT_EQ(lines_of_code("x = a / b;\nx = a / /* c\n */ b;"), 3u);
}

TEST(Weight, IsCountedWhereAFileIs) {
  EXPECT_EQ(room_of("models/anomaly/watch.h"), "models/anomaly");
  EXPECT_EQ(room_of("models/robot/urdf/urdf.h"), "models/robot");
  EXPECT_EQ(room_of("fmu/new.h"), "fmu");
  EXPECT_EQ(room_of("tests/fmu/fmus/ball2.c"), "tests");
  EXPECT_EQ(room_of("master/view/page/source/dom.ts"), "master/view");
  EXPECT_EQ(room_of("master/view/page/test/page.test.ts"), "tests");
}

TEST(Weight, IsToldWhereItIsNotTheAllowedOne) {
  const Weights weights = {{"models/a", 100}, {"models/b", 50}, {"tests", 7}};
  EXPECT_THAT(faults(weights, "models/a 100\nmodels/b 70\ntests 7\n"), IsEmpty());
  EXPECT_THAT(
      faults(weights, "models/a 97\nmodels/b 50\ntests 7\n"),
      ElementsAre("models/a has 100 lines of code, tests/weight.txt allows 97 (+3; models: 150): make it lighter, or raise the "
                  "number in a commit of its own that names the issue which allows it"));
  EXPECT_THAT(faults(weights, "models/a 100\nmodels/b 71\ntests 7\n"),
              ElementsAre("models/b has 50 lines of code, tests/weight.txt allows 71: lower it to 50"));
  EXPECT_THAT(
      faults(weights, "models/a 100\nmodels/c 50\ntests 7\n"),  // moved
      ElementsAre(
          "models/b has 50 lines of code, tests/weight.txt does not have the room: add it in a commit of its own that names "
          "the issue which allows it",
          "tests/weight.txt has the room models/c, which has no code: remove it"));
  EXPECT_THAT(faults(weights, "models/a 100\nmodels/b 5o\nmodels/a 200\nmodels/b 50\ntests 7"),
              ElementsAre("tests/weight.txt:2: 'models/b 5o', expected a room and its lines of code, once",
                          "tests/weight.txt:3: 'models/a 200', expected a room and its lines of code, once"));
}

}  // namespace
}  // namespace weight_test
