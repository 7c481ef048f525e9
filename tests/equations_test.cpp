// docs/equations.md maps each equation of the paper to the function that implements it and to a test that exists.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <regex>
#include <string>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/places.h"

namespace equations_test {
namespace {

namespace fs = std::filesystem;

using cotwin::testing::content;

struct Row {
  std::string number, file, function, code, test;
};

std::vector<Row> rows() {
  std::ifstream in(fs::path(cotwin::places::source()) / "docs/equations.md");
  const std::regex pattern(R"(^\| ([^|]+?) \|.*\| `([^`]+)` \| `([^`]+)` \| `([^`]+)` \| `([^`]+)` \|$)");
  std::vector<Row> found;
  for (std::string line; std::getline(in, line);) {
    std::smatch match;
    if (std::regex_match(line, match, pattern)) found.push_back({match[1], match[2], match[3], match[4], match[5]});
  }
  return found;
}

/// C++ without comments. String literals stay.
std::string without_comments(const std::string& code) {
  std::string out;
  for (std::size_t i = 0; i < code.size(); ++i) {
    if (code.compare(i, 2, "//") == 0) {
      i = std::min(code.find('\n', i), code.size());
      out += '\n';
    } else if (code.compare(i, 2, "/*") == 0) {
      i = std::min(code.find("*/", i), code.size() - 2) + 1;
    } else if (code[i] == '"') {
      const std::size_t begin = i++;
      while (i < code.size() && code[i] != '"') i += code[i] == '\\' ? 2 : 1;
      out += code.substr(begin, i + 1 - begin);
    } else {
      out += code[i];
    }
  }
  return out;
}

std::string without_blanks(std::string text) {
  std::erase_if(text, [](unsigned char c) { return std::isspace(c) != 0; });
  return text;
}

/// The position after the bracket that closes the one at `open`; npos if there is none.
std::size_t after_closing(const std::string& code, std::size_t open) {
  const char opening = code[open], closing = opening == '(' ? ')' : '}';
  int depth = 0;
  for (std::size_t i = open; i < code.size(); ++i) {
    depth += (code[i] == opening) - (code[i] == closing);
    if (depth == 0) return i + 1;
  }
  return std::string::npos;
}

/// The bodies of all functions of this name that `code` (without comments) defines.
std::vector<std::string> bodies_of(const std::string& function, const std::string& code) {
  std::vector<std::string> found;
  const auto is_name = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; };
  for (std::size_t at = code.find(function + "("); at != std::string::npos; at = code.find(function + "(", at + 1)) {
    if (at > 0 && is_name(code[at - 1])) continue;
    std::size_t next = after_closing(code, at + function.size());
    if (next == std::string::npos) continue;
    next = code.find_first_not_of(" \n", next);
    if (next != std::string::npos && code.compare(next, 6, "const ") == 0) next = code.find_first_not_of(" \n", next + 6);
    if (next == std::string::npos || code[next] != '{') continue;  // a call or a declaration
    found.push_back(code.substr(next, after_closing(code, next) - next));
  }
  return found;
}

/// Whether the file's text defines the function with this code in its body.
bool implements(const std::string& text, const std::string& function, const std::string& code) {
  for (const std::string& body : bodies_of(function, without_comments(text))) {
    if (without_blanks(body).find(without_blanks(code)) != std::string::npos) return true;
  }
  return false;
}

std::string all_tests() {
  std::string text;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(cotwin::places::source()) / "tests")) {
    if (entry.path().extension() == ".cpp") text += content(entry.path());
  }
  return text;
}

TEST(Equations, AreImplementedByTheFunctionsThatTheMapNames) {
  ASSERT_GT(rows().size(), 20u);
  for (const Row& row : rows()) {
    EXPECT_TRUE(implements(content(fs::path(cotwin::places::source()) / row.file), row.function, row.code))
        << row.number << ": " << row.file << " defines no function " << row.function << " with the code " << row.code;
  }
}

// The same number in a comment, in a call, in a declaration or in another function is not the equation.
TEST(Equations, AreNotFoundInCommentsCallsAndOtherFunctions) {
  const std::string code = "tau = K * (theta - q)";
  EXPECT_TRUE(implements("double spring(double q) const {\n  tau = K *\n (theta - q);\n}", "spring", code));
  EXPECT_FALSE(implements("double spring(double q) {\n  // tau = K * (theta - q)  (2c)\n}", "spring", code));
  EXPECT_FALSE(implements("double spring(double q) {\n  /* tau = K * (theta - q) */\n}", "spring", code));
  EXPECT_FALSE(implements("double spring(double q);\nvoid f() { tau = K * (theta - q); }", "spring", code));
  EXPECT_FALSE(implements("void f() { spring(q); tau = K * (theta - q); }", "spring", code));
  EXPECT_FALSE(implements("double my_spring(double q) { tau = K * (theta - q); }", "spring", code));
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
}  // namespace equations_test
