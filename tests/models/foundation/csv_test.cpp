#include "models/foundation/formats/csv.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "tests/support/growth.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"

namespace cotwin::csv_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string error_of(const std::string& text, const csv::Options& options = {}) {
  try {
    csv::parse(text, "file.csv", {}, options);
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& name)
      : path_(std::filesystem::temp_directory_path() /
              (name + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) + "_" +
               std::to_string(reinterpret_cast<std::uintptr_t>(this)))) {}
  ~TemporaryFile() { std::filesystem::remove(path_); }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

TEST(Csv, SeparatorsQuotesByteOrderMarkLineEndsAndCommentsAreUnderstood) {
  const std::vector<double> t = {0, 0.5, 1}, q1 = {1, -2e-3, 3};
  for (const std::string text : {
           "t,q1\n0,1\n0.5,-2e-3\n1,3\n",
           "t;q1\r\n0;1\r\n0.5;-2e-3\r\n1;3",
           "t\tq1\n0\t1\n0.5\t-2e-3\n1\t3\n",
           "\xEF\xBB\xBF# made by a logger\n\nt , \"q1\"\n0, 1\n# a remark\n 0.5 ,\"-2e-3\"\n\n1,+3\n",
           "# two lines\n# t,q1\n0,1\n0.5,-2e-3\n1,3\n",
           "t,q1,\n0,1,\n0.5,-2e-3,\n1,3,\n",
           "t,q1\n0,1,\n0.5,-2e-3,\n1,3,\n",
       }) {
    const csv::Table table = csv::parse(text, "file.csv");
    EXPECT_THAT(table.names, ElementsAre("t", "q1")) << text;
    EXPECT_EQ(table.column("t"), t) << text;
    EXPECT_EQ(table.column("q1"), q1) << text;
  }
}

TEST(Csv, RowsHaveTheirLineNumbers) {
  const csv::Table table = csv::parse("# first\nt,q\n\n0,1\n# remark\r\n1,2\n", "file.csv");
  EXPECT_THAT(table.lines, ElementsAre(4, 6));
  EXPECT_EQ(table.place(1, 1), "file.csv:6: column 'q'");
}

TEST(Csv, UnusedColumnsMayContainAnything) {
  const csv::Table table = csv::parse("t,mode,q\n0,\"auto, fast\",1\n1,,2\n", "file.csv", {"q", "t"});
  EXPECT_THAT(table.names, ElementsAre("q", "t"));
  EXPECT_THAT(table.columns[0], ElementsAre(1, 2));
}

TEST(Csv, QuotedCellsKeepSeparatorsAndDoubledQuotes) {
  csv::Reader reader("name,\"a,\"\"b\"\"\"\n\"x,y\",1\n", "file.csv");
  EXPECT_THAT(reader.names(), ElementsAre("name", "a,\"b\""));
  ASSERT_TRUE(reader.next());
  EXPECT_EQ(reader.text(0), "x,y");
  EXPECT_EQ(reader.real(1), 1);
}

TEST(Csv, ErrorsHaveLineColumnFactAndExpectation) {
  EXPECT_EQ(error_of("t,tau3\n0,1\n1,abc\n"), "file.csv:3: column 'tau3': 'abc', expected a number");
  EXPECT_EQ(error_of("t,tau3\n0,\n"), "file.csv:2: column 'tau3': empty, expected a number");
  EXPECT_EQ(error_of("t,q\n0,1e999\n"), "file.csv:2: column 'q': '1e999', expected a number that fits a double");
  EXPECT_EQ(error_of("t,q\n0,1\n1\n"), "file.csv:3: 1 cell separated by comma, expected 2 as in the header");
  EXPECT_EQ(error_of("t,q\n0,1,2\n"), "file.csv:2: 3 cells separated by comma, expected 2 as in the header");
  EXPECT_EQ(error_of("t;q\n0;1,5\n"), "file.csv:2: column 'q': '1,5' has a decimal comma, expected a decimal point");
  EXPECT_EQ(error_of("t,q,q\n0,1,2\n"), "file.csv:1: column 'q' occurs twice, expected different names");
  EXPECT_EQ(error_of(""), "file.csv: is empty, expected a line of column names");
  EXPECT_EQ(error_of("\n# nothing\n"), "file.csv: is empty, expected a line of column names");
  EXPECT_EQ(error_of("0,1\n1,2\n"), "file.csv:1: the first row contains only numbers, expected column names");
  EXPECT_EQ(error_of("# one,two,three\n0,1\n"), "file.csv:2: the first row contains only numbers, expected column names");
  EXPECT_EQ(error_of("t,q\n0,\"1\n1,2\n"), "file.csv:2: a quoted cell does not end on its line, expected '\"'");
  EXPECT_EQ(error_of("t,q\n0,\"1\"2\n"), "file.csv:2: text follows the end of a quoted cell, expected a comma");
  EXPECT_EQ(error_of("t,q\r0,1\r1,2\r"), "file.csv:1: carriage return within the line, expected LF or CRLF at its end");
  EXPECT_EQ(error_of("\xFF\xFEt"), "file.csv: UTF-16 text, expected UTF-8: iconv -f UTF-16 -t UTF-8");
  EXPECT_EQ(error_of("t,q\n0,1\n", {'|'}), "file.csv: separator '|', expected a comma, a semicolon or a tab");
}

TEST(Csv, AMissingColumnSuggestsTheClosestName) {
  const csv::Table table = csv::parse("time,q1\n0,1\n", "file.csv");
  try {
    table.column("tine");
    FAIL();
  } catch (const Error& e) {
    EXPECT_STREQ(e.what(), "file.csv: has no column 'tine', did you mean 'time'?");
  }
  EXPECT_THROW(csv::load("there is no such file.csv"), Error);
  EXPECT_THROW(csv::load(std::filesystem::temp_directory_path()), Error);
}

TEST(Csv, NumbersAreWrittenSoThatTheyReadBackToTheSameBits) {
  std::mt19937_64 random(1);
  std::vector<double> values = {
      0.0, -0.0, 0.1, 1e-300, 5e-324, std::numeric_limits<double>::max(), std::numeric_limits<double>::infinity()};
  while (values.size() < 20000) {
    const double value = std::bit_cast<double>(random());
    if (!std::isnan(value)) values.push_back(value);
  }
  std::ostringstream out;
  const std::vector<std::string> names = {"t", "tau \"J\"[1]", "#c,d"};
  csv::Writer writer(out, names);
  for (std::size_t i = 0; i + 2 < values.size(); i += 3) writer.row(std::span(values).subspan(i, 3));
  const csv::Table table = csv::parse(out.str(), "file.csv");
  EXPECT_EQ(table.names, names);
  for (std::size_t i = 0; i + 2 < values.size(); i += 3) {
    for (std::size_t c = 0; c < 3; ++c) {
      ASSERT_EQ(std::bit_cast<std::uint64_t>(table.columns[c][i / 3]), std::bit_cast<std::uint64_t>(values[i + c]))
          << values[i + c];
    }
  }
}

TEST(Csv, AWriterRefusesRowsOfAnotherWidthThanItsHeader) {
  std::ostringstream out;
  csv::Writer writer(out, std::vector<std::string>{"a", "b"});
  writer.cell(1.0);
  EXPECT_THROW(writer.end_row(), Error);
}

TEST(Csv, FilesLargerThanTheReadersBufferReadLikeTextInMemory) {
  // Rows of all lengths, so that they end anywhere relative to the chunks of 1 MiB, and one row longer than a chunk.
  TemporaryFile file("cotwin_csv_large");
  std::string text = "t,comment\n";
  std::mt19937 random(2);
  for (int i = 0; i < 30000; ++i) {
    text += std::to_string(i) + "," + std::string(i == 20000 ? 3 << 20 : random() % 200, 'x') + (i % 3 == 0 ? "\r\n" : "\n");
  }
  std::ofstream(file.path(), std::ios::binary) << text;
  csv::Reader from_file(file.path()), from_text(text, "text");
  std::size_t rows = 0;
  while (from_file.next()) {
    ASSERT_TRUE(from_text.next());
    ASSERT_EQ(from_file.real(0), static_cast<double>(rows++));
    ASSERT_EQ(from_file.text(1), from_text.text(1));
    ASSERT_EQ(from_file.line(), rows + 1);
  }
  EXPECT_FALSE(from_text.next());
  EXPECT_EQ(rows, 30000u);
}

TEST(Csv, ReadingTakesTimeInProportionToTheFile) {
  const double ratio = testing::growth(40000, [](int rows) {
    TemporaryFile file("cotwin_csv_many_rows");
    {
      std::ofstream out(file.path(), std::ios::binary);
      out << "t,q1,q2,q3\n";
      for (int i = 0; i < rows; ++i) out << "0.123456789,-1.5,2.25e-3,4\n";
    }
    EXPECT_EQ(csv::load(file.path()).rows(), static_cast<std::size_t>(rows));
  });
  EXPECT_LT(ratio, 8);
}

TEST(Csv, ALineWithoutEndIsRefusedBeforeItFillsTheMemory) {
  TemporaryFile file("cotwin_csv_binary");
  {
    std::ofstream out(file.path(), std::ios::binary);
    const std::string block(1 << 20, '\1');
    for (int i = 0; i < 70; ++i) out << block;
  }
  try {
    csv::Reader reader(file.path());
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("line of more than 64 MiB, expected a table of text"));
  }
}

TEST(Csv, RealMeasurementsAreReadCompletely) {
  const std::string panda_log = places::public_data("measurements/panda_unisa.csv"),
                    ur10_log = places::public_data("measurements/ur10_unisa.csv");
  if (!std::filesystem::exists(panda_log) || !std::filesystem::exists(ur10_log))
    GTEST_SKIP() << "needs public measurements (scripts/fetch_logs.py)";
  const csv::Table panda = csv::load(panda_log);
  EXPECT_EQ(panda.rows(), 727u);
  EXPECT_EQ(panda.names.size(), 22u);
  EXPECT_EQ(panda.column("tau7")[0], 0.06056813);
  EXPECT_EQ(csv::load(ur10_log).rows(), 3441u);
}

// With a linear search for names among all columns this would take minutes.
TEST(Csv, TheTimeToReadATableGrowsWithItsColumnsAndNotWithTheirSquare) {
  constexpr std::size_t kColumns = 200'000;
  std::string text;
  std::vector<std::string> names;
  for (std::size_t c = 0; c < kColumns; ++c) {
    names.push_back("column_" + std::to_string(c));
    text += names.back() + ',';
  }
  text.back() = '\n';
  for (std::size_t c = 0; c < kColumns; ++c) text += std::to_string(c) + ',';
  text.back() = '\n';
  std::reverse(names.begin(), names.end());
  const csv::Table table = csv::parse(text, "wide.csv", names);
  EXPECT_EQ(table.columns.front(), std::vector<double>{kColumns - 1});
  EXPECT_EQ(table.columns.back(), std::vector<double>{0});
}

TEST(Csv, MoreColumnsThanAnyTableHasAreRefused) {
  const std::string text = "a" + std::string(5'000'000, ',') + "\n";
  try {
    csv::parse(text, "f.csv");
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("f.csv:1: more than 4000000 cells in a row"));
  }
}

}  // namespace
}  // namespace cotwin::csv_test
