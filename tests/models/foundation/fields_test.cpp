// Structures that list their members once: what is written is read again, and a member that no list names is found by the compiler.
#include "models/foundation/support/fields.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <array>
#include <limits>
#include <map>
#include <set>
#include <vector>

#include "models/foundation/support/error.h"

namespace cotwin::fields_test {

enum class Colour : std::uint8_t { kRed, kGreen };
constexpr Colour last(Colour) { return Colour::kGreen; }
enum class Level { kLow = 3, kMiddle, kHigh };
constexpr Level first(Level) { return Level::kLow; }
constexpr Level last(Level) { return Level::kHigh; }

struct Point {
  Eigen::Vector3d p{1, 2, 3};
  Colour colour = Colour::kGreen;

  static auto fields(auto& p, auto each) { return each(p.p, p.colour); }
  friend bool operator==(const Point&, const Point&) = default;
};

/// Another class that can write itself.
class Sealed {
 public:
  explicit Sealed(int value = 7) : value_(value) {}
  std::string serialise() const { return std::to_string(value_); }
  static Sealed deserialise(std::string_view bytes) {
    if (bytes.empty()) throw Error("is empty");
    return Sealed(std::stoi(std::string(bytes)));
  }
  friend bool operator==(const Sealed&, const Sealed&) = default;

 private:
  int value_;
};

/// Every kind of value.
struct Everything {
  bool yes = true;
  std::int8_t small = -8;
  std::uint16_t half = 500;
  int number = -70000;
  std::int64_t large = std::numeric_limits<std::int64_t>::min();
  std::size_t index = 12;
  float single = 0.1f;
  double real = -std::numeric_limits<double>::infinity();
  Level level = Level::kMiddle;
  std::string text = std::string("a\0b", 3);
  Eigen::Matrix<float, 2, 2> matrix{{1, 2}, {3, 4}};
  std::array<double, 3> array{1, 2, 3};
  std::array<Point, 2> points{};
  std::pair<int, std::string> pair{4, "four"};
  std::vector<bool> bits{true, false, true};
  std::vector<std::vector<Point>> lists{{Point{}}, {}};
  std::set<std::string> set{"x", "y"};
  std::map<std::string, std::uint64_t> map{{"n", 4}, {"m", 5}};
  std::optional<double> none, some = 0.5;
  std::optional<std::vector<std::size_t>> list = std::vector<std::size_t>{};
  std::variant<std::monostate, double, std::vector<std::string>> variant = std::vector<std::string>{"z"};
  std::shared_ptr<const Point> nothing;
  Sealed sealed{5};
  Point point;
  std::string place = "left out";

  static auto fields(auto& e, auto each) {
    return each(e.yes, e.small, e.half, e.number, e.large, e.index, e.single, e.real, e.level, e.text, e.matrix, e.array,
                e.points, e.pair, e.bits, e.lists, e.set, e.map, e.none, e.some, e.list, e.variant, e.nothing, e.sealed,
                e.point);
  }
  static auto left_out(auto& e, auto each) { return each(e.place); }
  friend bool operator==(const Everything&, const Everything&) = default;
};

/// Lists of another use: of a point its colour alone.
struct Colours {
  static auto fields(Is<Point> auto& p, auto each) { return each(p.colour); }
  static auto left_out(Is<Point> auto& p, auto each) { return each(p.p); }
};

struct Forgetful {
  std::array<double, 2> a;
  std::optional<int> b;
  Point c;
  static auto fields(auto& f, auto each) { return each(f.a, f.c); }
};
static_assert(listed::has_members<Forgetful, 3> && !listed::has_members<Forgetful, 2> && !listed::has_members<Forgetful, 4>);
static_assert(listed::members_in<Forgetful, Forgetful>() == 2, "so that it cannot be written");
struct Based : Point {
  int d = 0;
};
static_assert(listed::has_members<Based, 3> && !listed::has_members<Based, 2>, "members of a base count one by one");
static_assert(!listed::Number<wchar_t> && !listed::Number<long double>, "whose width depends on the platform");
static_assert(listed::has_members<Everything, listed::members_in<Everything, Everything>()>);
static_assert(listed::members_in<Everything, Everything>() == 26 && listed::members_in<Colours, Point>() == 2);

namespace {

template <class Own = NoLists>
std::string written(const auto& value) {
  ByteWriter out;
  Putter<Own>(out).put(value);
  return out.take();
}
template <class T, class Own = NoLists>
T read(const std::string& bytes) {
  T value{};
  ByteReader in(as_bytes(bytes), "here");
  Getter<Own>(in).get(value);
  in.expect_end();
  return value;
}
template <class T>
std::string refusal(const std::string& bytes) {
  try {
    static_cast<void>(read<T>(bytes));
  } catch (const Error& error) {
    return error.what();
  }
  return "none";
}
std::string with_count(std::uint64_t count, const std::string& rest = {}) { return written(count) + rest; }

TEST(Fields, WritesAndReadsEachKindOfValue) {
  Everything other;
  other.none = 2;
  other.some.reset();
  other.variant = 1.5;
  other.nothing = std::make_shared<const Point>();
  other.lists.clear();
  for (const Everything& value : {Everything{}, other}) {
    const std::string bytes = written(value);
    Everything back = read<Everything>(bytes);
    EXPECT_EQ(written(back), bytes);
    ASSERT_EQ(back.nothing != nullptr, value.nothing != nullptr);
    EXPECT_TRUE(value.nothing == nullptr || *back.nothing == *value.nothing);
    back.nothing = value.nothing;
    EXPECT_TRUE(back == value);
    for (std::size_t i = 0; i < bytes.size(); ++i) EXPECT_THROW(read<Everything>(bytes.substr(0, i)), Error) << i;
    EXPECT_THROW(read<Everything>(bytes + "x"), Error);
  }
  Everything changed;
  changed.place = "elsewhere";
  EXPECT_EQ(written(changed), written(Everything{}));
}

TEST(Fields, HaveTheSameWidthOnEveryPlatform) {
  struct {
    std::string bytes;
    std::size_t width;
  } const cases[] = {{written(true), 1},
                     {written(1), 4},
                     {written(1u), 4},
                     {written(std::size_t{1}), 8},
                     {written(1.0), 8},
                     {written(Level::kLow), 4},
                     {written(std::string("ab")), 10},
                     {written(Point{}), 25}};
  for (const auto& c : cases) EXPECT_EQ(c.bytes.size(), c.width);
  EXPECT_EQ(written(std::vector<int>{1, -2}), std::string("\2\0\0\0\0\0\0\0\1\0\0\0\xfe\xff\xff\xff", 16));
}

TEST(Fields, ReadItemsWithoutBytes) {
  EXPECT_EQ(read<std::vector<std::monostate>>(with_count(0)).size(), 0u);
  EXPECT_EQ(refusal<std::vector<std::monostate>>(with_count(1)), "here: is damaged or cut short");
}

TEST(Fields, TakeTheListsOfAnotherUse) {
  Point point{{4, 5, 6}, Colour::kRed};
  EXPECT_EQ(written<Colours>(std::vector<Point>{point}), with_count(1, std::string(1, '\0')));
  point = read<Point, Colours>(std::string(1, '\0'));
  EXPECT_EQ(point, (Point{{1, 2, 3}, Colour::kRed})) << "what is left out keeps its default";
}

TEST(Fields, RefuseWhatIsNoSuchValue) {
  EXPECT_EQ(refusal<Colour>("\2"), "here: has the invalid enumeration value 2, expected 0 to 1");
  EXPECT_EQ(refusal<Level>(written(2)), "here: has the invalid enumeration value 2, expected 3 to 5");
  EXPECT_EQ(refusal<Level>(written(6)), "here: has the invalid enumeration value 6, expected 3 to 5");
  EXPECT_EQ((refusal<std::variant<int, double>>("\2")), "here: has a value of an unknown type");
  EXPECT_EQ(refusal<Sealed>(with_count(0)), "here: is empty");
  for (const std::uint64_t count : {std::uint64_t{3}, std::uint64_t{1} << 63, ~std::uint64_t{0}}) {
    EXPECT_EQ(refusal<std::vector<double>>(with_count(count, std::string(16, 'x'))), "here: is damaged or cut short");
    EXPECT_EQ(refusal<std::vector<std::string>>(with_count(count, std::string(16, '\0'))), "here: is damaged or cut short");
    EXPECT_EQ(refusal<std::set<int>>(with_count(count, std::string(11, 'x'))), "here: is damaged or cut short");
    EXPECT_EQ((refusal<std::map<std::string, int>>(with_count(count, std::string(35, '\0')))), "here: is damaged or cut short");
  }
}

TEST(Fields, AreSealedWithAVersionAndAHash) {
  const std::string bytes = sealed(1234, "content");
  const auto refused = [&](const std::string& other) {
    try {
      static_cast<void>(opened(1234, other, "x.bin", "is not a thing"));
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string("none");
  };
  EXPECT_EQ(opened(1234, bytes, "x.bin", "is not a thing").rest().size(), 7u);
  EXPECT_TRUE(is_sealed(1234, bytes));
  EXPECT_EQ(refused(sealed(1235, "content")), "x.bin: is not a thing");
  EXPECT_EQ(refused("content"), "x.bin: is not a thing");
  EXPECT_EQ(refused(bytes.substr(0, 8)), "x.bin: is cut short");
  EXPECT_EQ(refused(bytes + "x"), "x.bin: is damaged or cut short");
}

}  // namespace
}  // namespace cotwin::fields_test
