// Text to JSON: the same values as nlohmann's own reader gives, and bounds that are told with their place.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>
#include <string>

#include "components/services/json/json.h"
#include "models/foundation/support/text.h"

namespace cotwin::services::parse_test {
namespace {

using Json = nlohmann::ordered_json;

/// A value of up to `depth` levels, as text with blanks and numbers in all their forms.
class RandomText {
 public:
  explicit RandomText(unsigned seed) : random_(seed) {}
  std::string value(int depth) {
    const char* const plain[] = {"null",
                                 "true",
                                 "false",
                                 "0",
                                 "-0",
                                 "-0.0",
                                 "18446744073709551615",
                                 "-9223372036854775808",
                                 "1e-400",
                                 "0.1",
                                 "-2.5E+3",
                                 "123456789012345678901234567890",
                                 R"("")",
                                 R"("ä\u00e4\ud83d\ude00\n~/")"};
    const unsigned kind = random_() % (depth > 0 ? 18u : 14u);
    if (kind < 14) return blank() + plain[kind] + blank();
    std::string all;
    const unsigned members = random_() % 6;
    for (unsigned k = 0; k < members; ++k) {
      if (k > 0) all += ",";
      if (kind > 15) all += blank() + "\"" + std::string(random_() % 3, 'n') + std::to_string(k) + "\"" + blank() + ":";
      all += value(depth - 1);
    }
    return kind > 15 ? "{" + all + blank() + "}" : "[" + all + blank() + "]";
  }

 private:
  std::string blank() { return std::string(random_() % 2, " \n\t\r"[random_() % 4]); }
  std::mt19937 random_;
};

/// The message of the refusal, "" for none.
std::string refusal(std::string_view text, std::size_t most = kMostFileValues) {
  try {
    parse_json(text, most);
  } catch (const RequestError& error) {
    return error.pointer() + ": " + error.detail();
  }
  return "";
}

std::string members(int number) {
  std::string all = "{";
  for (int k = 0; k < number; ++k) all += (k > 0 ? ",\"" : "\"") + std::to_string(k) + "\":0";
  return all + "}";
}

TEST(RequestText, IsReadAsNlohmannReadsIt) {
  int structured = 0;
  for (unsigned seed = 0; seed < 2000; ++seed) {
    const std::string text = RandomText(seed).value(6);
    const Json expected = Json::parse(text);
    const Json read = parse_json(text);
    ASSERT_EQ(read.dump(), expected.dump()) << text;
    ASSERT_EQ(read, expected) << text;
    structured += expected.is_structured() && !expected.empty() ? 1 : 0;
  }
  EXPECT_GT(structured, 200);
}

TEST(RequestText, IsRefusedWhereNlohmannRefusesIt) {
  std::mt19937 random(7);
  int refused = 0, taken = 0;
  for (unsigned seed = 0; seed < 3000; ++seed) {
    std::string text = RandomText(seed).value(4);
    const std::size_t at = random() % text.size();
    text[at] = "{}[],:\"\\0-e.\x01\xff"[random() % 14];
    const bool whole = Json::accept(text);
    const std::string why = refusal(text);
    if (whole)
      ASSERT_TRUE(why.empty() || why.find(" twice, expected it once") != std::string::npos) << text << "\n" << why;
    else
      ASSERT_TRUE(why.find(": is not JSON: ") != std::string::npos || why.find(" twice, ") != std::string::npos) << text << "\n"
                                                                                                                 << why;
    ASSERT_EQ(why.find("json.exception"), std::string::npos) << why;
    ++(whole ? taken : refused);
  }
  EXPECT_GT(refused, 300);
  EXPECT_GT(taken, 100);
}

TEST(RequestText, HasBoundsThatAreToldWithTheirPlace) {
  EXPECT_EQ(refusal(members(4096)), "");
  EXPECT_EQ(refusal(members(4097)), ": has more than 4096 members, expected fewer");
  EXPECT_EQ(refusal(R"({"a/b":[1,)" + members(4097) + "]}"), "/a~1b/1: has more than 4096 members, expected fewer");
  EXPECT_EQ(refusal(R"({"a":{"b":1,"c":{},"b":2}})"), "/a: has the member 'b' twice, expected it once");
  EXPECT_EQ(refusal("[[1,2],{\"x\":[3]}]", 7), "");
  EXPECT_EQ(refusal("[[1,2],{\"x\":[3]}]", 6), "/1/x/0: is value 7, expected at most 6 in all");
  EXPECT_EQ(refusal("[[1,2],{\"x\":[3]}]", 5), "/1/x: is value 6, expected at most 5 in all");
  const auto nested = [](std::size_t levels) { return std::string(levels, '[') + std::string(levels, ']'); };
  EXPECT_EQ(refusal(nested(32)), "");
  std::string place;
  for (int k = 0; k < 32; ++k) place += "/0";
  EXPECT_EQ(refusal(nested(33)), place + ": is nested deeper than 32, expected less");
  EXPECT_EQ(refusal(std::string(1 << 20, '[')), place + ": is nested deeper than 32, expected less");
}

// Neither a name nor a text of a megabyte comes back in the message.
TEST(RequestText, IsToldInShortMessages) {
  const std::string kMuch(1 << 20, 'x');
  EXPECT_EQ(refusal("{\"a\":{\"" + kMuch + "\":{\"b\":1,\"b\":2}}}"), "/a: has the member 'b' twice, expected it once");
  EXPECT_EQ(refusal("{\"" + kMuch + "\":1,\"" + kMuch + "\":2}"),
            ": has the member '" + kMuch.substr(0, 40) + "…' twice, expected it once");
  EXPECT_LT(refusal("{\"a\":\"" + kMuch).size(), 400u);
  EXPECT_LT(refusal(std::string(100000, '9') + "e" + std::string(100000, '9')).size(), 400u);
}

}  // namespace
}  // namespace cotwin::services::parse_test
