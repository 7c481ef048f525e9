// Packages of RTDE against bytes written from UR's documentation: components/io/rtde/rtde.h.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include "components/io/rtde/rtde.h"
#include "tests/components/io/rtde/bytes.h"

namespace cotwin::rtde::codec_test {
namespace {

TEST(RtdeTypes, HaveTheSizesOfTheDocumentation) {
  const struct {
    const char* name;
    std::size_t bytes, values;
  } kTable[] = {{"BOOL", 1, 1},   {"UINT8", 1, 1},     {"UINT32", 4, 1},    {"UINT64", 8, 1},        {"INT32", 4, 1},
                {"DOUBLE", 8, 1}, {"VECTOR3D", 24, 3}, {"VECTOR6D", 48, 6}, {"VECTOR6INT32", 24, 6}, {"VECTOR6UINT32", 24, 6}};
  for (const auto& row : kTable) {
    ASSERT_TRUE(type_of(row.name)) << row.name;
    EXPECT_EQ(name_of(*type_of(row.name)), row.name);
    EXPECT_EQ(bytes_of(*type_of(row.name)), row.bytes) << row.name;
    EXPECT_EQ(values_of(*type_of(row.name)), row.values) << row.name;
  }
  EXPECT_FALSE(type_of("FLOAT"));
}

TEST(RtdeDirectory, HasTheQuantitiesOfTheDocumentationWithTheirTypes) {
  const Directory directory;
  const auto type = [&](const char* name) {
    return directory.find(name) == nullptr ? "" : std::string(name_of(directory.find(name)->type));
  };
  EXPECT_EQ(type("timestamp"), "DOUBLE");
  EXPECT_EQ(type("actual_q"), "VECTOR6D");
  EXPECT_EQ(type("joint_mode"), "VECTOR6INT32");
  EXPECT_EQ(type("actual_digital_input_bits"), "UINT64");
  EXPECT_EQ(type("runtime_state"), "UINT32");
  EXPECT_EQ(type("tool_output_mode"), "UINT8");
  EXPECT_EQ(type("elbow_position"), "VECTOR3D");
  EXPECT_EQ(type("output_bit_register_127"), "BOOL");
  EXPECT_EQ(type("input_int_register_47"), "INT32");
  EXPECT_EQ(type("input_bit_registers32_to_63"), "UINT32");
  for (const char* none :
       {"", "actual_Q", "actual_q ", "input_int_register_48", "output_bit_register_63", "output_bit_register_128"}) {
    EXPECT_EQ(type(none), "") << none;
  }
  EXPECT_TRUE(directory.find("input_double_register_24")->input && directory.find("input_double_register_24")->output);
  EXPECT_FALSE(directory.find("actual_q")->input);
  EXPECT_FALSE(directory.find("speed_slider_mask")->output);
  // 24 to 29 are six consecutive values.
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(directory.slot("input_double_register_" + std::to_string(24 + i)),
              directory.slot("input_double_register_24") + i);
  }
}

TEST(RtdeValues, AreBigEndian) {
  const Directory directory;
  Recipe recipe;
  Values values(directory.slots());
  const auto add = [&](const char* name, std::vector<double> numbers) {
    recipe.add(*directory.find(name));
    std::ranges::copy(numbers, values.begin() + static_cast<std::ptrdiff_t>(directory.slot(name)));
  };
  add("timestamp", {1});
  add("robot_mode", {-1});
  add("runtime_state", {2});
  add("actual_digital_input_bits", {0x10001});
  add("tool_output_mode", {255});
  add("output_bit_register_64", {1});
  add("elbow_position", {-2, 0.5, 0});
  const std::vector<std::uint8_t> expected =
      bytes("3ff0000000000000 ffffffff 00000002 0000000000010001 ff 01 c000000000000000 3fe0000000000000 0000000000000000");
  ASSERT_EQ(recipe.bytes(), expected.size());
  std::vector<std::uint8_t> written(recipe.bytes());
  write_values(recipe, values, written.data());
  EXPECT_EQ(written, expected);
  Values read(directory.slots());
  EXPECT_EQ(read_values(recipe, expected, read), Fault::kNone);
  EXPECT_EQ(read, values);
}

TEST(RtdeValues, AreLimitedToTheRangeOfTheirIntegers) {
  const Directory directory;
  Recipe recipe;
  recipe.add(*directory.find("robot_mode"));
  recipe.add(*directory.find("runtime_state"));
  recipe.add(*directory.find("tool_output_mode"));
  recipe.add(*directory.find("actual_digital_input_bits"));
  Values values(directory.slots());
  std::vector<std::uint8_t> written(recipe.bytes());
  for (double wrong : {1e300, -1e300, std::numeric_limits<double>::quiet_NaN()}) {
    for (const Field* field : recipe.fields()) values[field->slot] = wrong;
    write_values(recipe, values, written.data());
    EXPECT_EQ(written,
              wrong > 0 ? bytes("7fffffff ffffffff ff ffffffffffffffff") : bytes("80000000 00000000 00 0000000000000000"));
  }
}

TEST(RtdeValues, AreAllRefusedIfOneIsNotFiniteOrTheSizeIsWrong) {
  const Directory directory;
  Recipe recipe;
  recipe.add(*directory.find("input_int_register_24"));
  recipe.add(*directory.find("input_double_register_24"));
  Values values(directory.slots(), 7.0);
  const Values before = values;
  for (const char* wrong : {"00000001 7ff8000000000000", "00000001 7ff0000000000000", "00000001 fff0000000000000"}) {
    EXPECT_EQ(read_values(recipe, bytes(wrong), values), Fault::kNotFinite);
  }
  for (const char* wrong : {"", "00000001", "00000001 3ff00000000000", "00000001 3ff0000000000000 00"}) {
    EXPECT_EQ(read_values(recipe, bytes(wrong), values), Fault::kSize);
  }
  EXPECT_EQ(values, before);
}

TEST(RtdeStream, GivesPackagesHoweverTheBytesArrive) {
  const std::vector<std::uint8_t> stream = bytes("0005 56 0002 0003 76 0004 53 01 0007 55 01 aabbcc");
  for (std::size_t piece = 1; piece <= stream.size(); ++piece) {
    PackageReader reader;
    std::string kinds;
    std::size_t contents = 0;
    for (std::size_t at = 0; at < stream.size(); at += piece) {
      const std::size_t size = std::min(piece, stream.size() - at);
      std::copy_n(stream.begin() + static_cast<std::ptrdiff_t>(at), size, reader.space().begin());
      reader.received(size);
      while (const auto package = reader.next()) {
        kinds += static_cast<char>(package->kind);
        contents += package->contents.size();
      }
    }
    EXPECT_EQ(kinds, "VvSU") << piece;
    EXPECT_EQ(contents, 7u);
    EXPECT_FALSE(reader.broken());
  }
}

TEST(RtdeStream, EndsAtASizeThatNoPackageHas) {
  for (const char* wrong : {"0000 53", "0002 53", "2001 53", "ffff 55"}) {
    PackageReader reader;
    const std::vector<std::uint8_t> stream = bytes(std::string("0003 53 ") + wrong);
    std::ranges::copy(stream, reader.space().begin());
    reader.received(stream.size());
    EXPECT_TRUE(reader.next()) << wrong;  // the one before is good
    EXPECT_FALSE(reader.next());
    EXPECT_TRUE(reader.broken());
  }
  // The largest package fits.
  PackageReader reader;
  ASSERT_EQ(reader.space().size(), kMaxPackage);
  std::ranges::fill(reader.space(), std::uint8_t{0});
  reader.space()[0] = kMaxPackage >> 8;
  reader.space()[2] = 'U';
  reader.received(kMaxPackage);
  EXPECT_TRUE(reader.space().empty());
  const auto package = reader.next();
  ASSERT_TRUE(package);
  EXPECT_EQ(package->contents.size(), kMaxPackage - 3);
}

TEST(RtdeStream, TextMessagesHaveTheLayoutOfBothVersions) {
  PackageWriter writer;
  const auto written = [&](int version, bool to_client) {
    writer.clear();
    EXPECT_TRUE(writer.add_text(version, to_client, "no", "RTDE", Level::kWarning));
    return std::vector<std::uint8_t>(writer.waiting().begin(), writer.waiting().end());
  };
  EXPECT_EQ(written(1, true), bytes("0006 4d 02 6e6f"));
  EXPECT_EQ(written(2, true), bytes("000c 4d 02 6e6f 04 52544445 02"));
  EXPECT_EQ(written(1, false), bytes("000c 4d 02 6e6f 04 52544445 02"));
}

TEST(RtdeStream, APackageWithoutRoomIsLostWhole) {
  PackageWriter writer;
  std::size_t packages = 0;
  while (writer.add(Package::kData, 1000) != nullptr) ++packages;
  EXPECT_EQ(packages, PackageWriter::kCapacity / 1003);
  const std::size_t waiting = writer.waiting().size();
  EXPECT_EQ(waiting, packages * 1003);
  writer.sent(300);  // the socket took a part: there is no room for a whole package yet
  EXPECT_EQ(writer.add(Package::kData, 1000), nullptr);
  writer.sent(703);
  EXPECT_NE(writer.add(Package::kData, 1000), nullptr);
  EXPECT_EQ(writer.waiting().size(), waiting);
}

}  // namespace
}  // namespace cotwin::rtde::codec_test
