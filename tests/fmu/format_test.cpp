// Files that are written for other tools: model descriptions, archives and file URIs.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zip.h>

#include <fstream>
#include <sstream>

#include "fmu/archive/archive.h"
#include "fmu/archive/uri.h"
#include "fmu/description/model_description.h"
#include "models/foundation/support/error.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/standard_validator.h"
#include "tests/support/xmllint.h"

namespace cotwin::fmu::format_test {
namespace {

namespace fs = std::filesystem;
using std::string_literals::operator""s;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

// Model descriptions

/// A model description with every element of its version.
ModelDescription full(Version version) {
  const bool three = version == Version::k3;
  ModelDescription d;
  d.version = version;
  d.model_name = "a <model> & \"more\"";
  d.token = "{1}";
  d.description = "größer\nand lower";
  d.author = "someone";
  d.model_version = "1";
  d.copyright = "none";
  d.license = "any";
  d.generation_tool = "hand";
  d.generation_date = "2026-11-20T00:00:00Z";
  d.structured_names = true;
  Interface i;
  i.model_identifier = "model";
  i.needs_execution_tool = i.only_once_per_process = i.can_get_and_set_state = i.can_serialise_state = true;
  i.provides_directional_derivatives = i.variable_step = i.can_interpolate_inputs = i.can_run_asynchronously = true;
  i.provides_adjoint_derivatives = i.provides_per_element_dependencies = i.provides_intermediate_update = true;
  i.might_return_early = i.can_return_early_after_intermediate_update = i.has_event_mode = true;
  i.provides_evaluate_discrete_states = i.can_not_use_memory_functions = true;
  i.max_output_derivative_order = 2;
  i.recommended_input_smoothness = 1;
  i.fixed_internal_step = 1e-3;
  i.source_files = {"model.c"};
  d.model_exchange = d.co_simulation = i;
  if (three) d.scheduled_execution = i;
  UnitDefinition rad;
  rad.name = "rad";
  rad.rad = 1;
  UnitDefinition celsius;
  celsius.K = 1;
  celsius.offset = 273.15;
  celsius.factor = 2;
  d.units = {
      {"rad", rad, {{"deg", 57.29577951308232, 0, false}, {"offset", 1, 3, three}}}, {"degC", celsius, {}}, {"?", {}, {}}};
  TypeDefinition angle{"Angle", Type::kFloat64, "an angle", {"Angle", "rad", "deg", true, true, -1.0, 1.0, 0.5}, {}, "", {},
                       {}};
  TypeDefinition count{"Count", Type::kInt32, "", {"Count", "", "", false, false, 0.0, 9.0, {}}, {}, "", {}, {}};
  TypeDefinition choice{"Choice", Type::kEnumeration, "", {}, {{"one", 1, "first"}, {"two", 2, ""}}, "", {}, {}};
  TypeDefinition flag{"Flag", Type::kBoolean, "", {}, {}, "", {}, {}};
  TypeDefinition words{"Words", Type::kString, "", {}, {}, "", {}, {}};
  d.types = {angle, count, choice, flag, words};
  if (three) {
    d.types.push_back({"Blob", Type::kBinary, "", {}, {}, "image/png", 1000, {}});
    d.types.push_back(
        {"Tick", Type::kClock, "", {}, {}, "", {}, {true, 3, IntervalVariability::kConstant, 0.1, 0.2, true, 10, 1, 2}});
    d.types.push_back({"Small", Type::kUInt8, "", {"Count", "", "", false, false, 0.0, 255.0, {}}, {}, "", {}, {}});
    d.types.push_back({"Single", Type::kFloat32, "", {"", "", "", false, false, -1.5, 1.5, {}}, {}, "", {}, {}});
  }
  d.log_categories = {{"logEvents", "what happens"}};
  d.default_experiment = DefaultExperiment{0.0, 2.0, 1e-4, 1e-3};

  const auto add = [&](ModelVariable v) {
    v.reference = static_cast<std::uint32_t>(d.variables.size()) + 10;
    d.variables.push_back(std::move(v));
  };
  ModelVariable v;
  v.name = "time";
  v.causality = Causality::kIndependent;
  add(v);
  v = {};
  v.name = "x";
  v.numeric = {"Angle", "rad", "deg", true, false, -3.0, 3.0, 1.0};
  v.declared_type = "Angle";
  v.initial = Initial::kExact;
  v.start = std::vector<double>{0.25};
  v.reinit = true;
  add(v);
  v = {};
  v.name = "der(x)";
  v.causality = Causality::kOutput;
  v.initial = Initial::kCalculated;
  v.derivative = 1;
  add(v);
  v = {};
  v.name = "mode";
  v.type = Type::kEnumeration;
  v.declared_type = "Choice";
  v.causality = Causality::kParameter;
  v.variability = Variability::kTunable;
  v.start = std::vector<std::int64_t>{2};
  add(v);
  v = {};
  v.name = "on";
  v.type = Type::kBoolean;
  v.causality = Causality::kInput;
  v.variability = Variability::kDiscrete;
  v.can_handle_multiple_set = false;
  v.start = std::vector<bool>{true};
  add(v);
  v = {};
  v.name = "text";
  v.type = Type::kString;
  v.causality = Causality::kParameter;
  v.variability = Variability::kFixed;
  v.start = std::vector<std::string>{"a \"quoted\" <text>"};
  add(v);
  if (three) {
    v = {};
    v.name = "n";
    v.type = Type::kUInt64;
    v.causality = Causality::kStructuralParameter;
    v.variability = Variability::kFixed;
    v.start = std::vector<std::uint64_t>{18446744073709551615u};
    add(v);
    v = {};
    v.name = "matrix";
    v.type = Type::kFloat32;
    v.causality = Causality::kInput;
    v.dimensions = {{2, {}}, {{}, 16}};
    v.intermediate_update = true;
    v.start = std::vector<double>{1.5, -2.5};
    v.aliases = {{"other", "the same", ""}};
    add(v);
    v = {};
    v.name = "blobs";
    v.type = Type::kBinary;
    v.variability = Variability::kDiscrete;
    v.causality = Causality::kInput;
    v.mime_type = "image/png";
    v.max_size = 5;
    v.dimensions = {{2, {}}};
    v.start = std::vector<std::vector<std::uint8_t>>{{0, 255}, {16}};
    add(v);
    v = {};
    v.name = "words";
    v.type = Type::kString;
    v.variability = Variability::kDiscrete;
    v.causality = Causality::kInput;
    v.dimensions = {{2, {}}};
    v.start = std::vector<std::string>{"one", "two words"};
    add(v);
    v = {};
    v.name = "tick";
    v.type = Type::kClock;
    v.variability = Variability::kDiscrete;
    v.causality = Causality::kInput;
    v.clock = {false, 1, IntervalVariability::kTriggered, {}, 0, false, {}, {}, 0};
    add(v);
    v = {};
    v.name = "clocked";
    v.type = Type::kInt8;
    v.variability = Variability::kDiscrete;
    v.clocks = {20};
    v.previous = 22;
    v.start = std::vector<std::int64_t>{-128};
    v.numeric.min = -128;
    add(v);
    v = {};
    v.name = "before";
    v.type = Type::kInt8;
    v.variability = Variability::kDiscrete;
    v.clocks = {20};
    v.start = std::vector<std::int64_t>{1};
    add(v);
  }
  d.structure.outputs = {{2, std::vector<std::size_t>{1, 4}, {DependencyKind::kDependent, DependencyKind::kDiscrete}}};
  d.structure.derivatives = {{2, std::vector<std::size_t>{}, {}}};
  d.structure.initial_unknowns = {{2, std::nullopt, {}}};
  if (three) {
    d.structure.clocked_states = {{11, std::nullopt, {}}};
    d.structure.event_indicators = {{2, std::nullopt, {}}};
  }
  return d;
}

std::string to_xml(const ModelDescription& d) {
  std::ostringstream out;
  write(out, d);
  return out.str();
}

class Description : public ::testing::TestWithParam<Version> {};

TEST_P(Description, FollowsTheStandardWithEveryElement) {
  const auto standard = GetParam() == Version::k2 ? cotwin::testing::Standard::kFmi2 : cotwin::testing::Standard::kFmi3;
  EXPECT_THAT(cotwin::testing::schema_faults(to_xml(full(GetParam())), standard), ::testing::IsEmpty());
}

TEST_P(Description, ValidatesWithEveryElement) {
  const bool two = GetParam() == Version::k2;
  const fs::path schema = fs::path(places::public_data("schemas")) /
                          (two ? "fmi2/fmi2ModelDescription.xsd" : "fmi3-3.0.2/fmi3ModelDescription.xsd");
  if (!fs::exists(schema)) GTEST_SKIP() << "needs schemas (scripts/fetch_logs.py --tests)";
  TemporaryFolder folder;
  const fs::path file = folder.path() / "modelDescription.xml";
  std::ofstream(file) << to_xml(full(GetParam()));
  EXPECT_EQ(cotwin::testing::schema_errors(schema, file), "");
}

INSTANTIATE_TEST_SUITE_P(Fmi, Description, ::testing::Values(Version::k2, Version::k3),
                         [](const auto& version) { return std::string(version.param == Version::k2 ? "2" : "3"); });

TEST(Description, RefersByIndexInFmi2AndByReferenceInFmi3) {
  EXPECT_THAT(to_xml(full(Version::k2)),
              HasSubstr("<Unknown index=\"3\" dependencies=\"2 5\" dependenciesKind=\"dependent discrete\"/>"));
  EXPECT_THAT(to_xml(full(Version::k2)), HasSubstr("derivative=\"2\""));
  EXPECT_THAT(to_xml(full(Version::k3)),
              HasSubstr("<Output valueReference=\"12\" dependencies=\"11 14\" dependenciesKind=\"dependent discrete\"/>"));
  EXPECT_THAT(to_xml(full(Version::k3)), HasSubstr("derivative=\"11\""));
  EXPECT_THAT(to_xml(full(Version::k3)), HasSubstr("<Start value=\"00ff\"/>"));
}

TEST(Description, RefusesInFmi2WhatOnlyFmi3Has) {
  ModelDescription d = full(Version::k2);
  d.variables[1].dimensions = {{3, {}}};
  EXPECT_THAT([&] { to_xml(d); }, ThrowsMessage<Error>(HasSubstr("not exist in FMI 2")));
  d = full(Version::k2);
  d.variables[1].type = Type::kInt64;
  EXPECT_THAT([&] { to_xml(d); }, ThrowsMessage<Error>(HasSubstr("Int64")));
}

TEST(Description, WritesNaNAndInfinityAsXmlSchemaDoes) {
  ModelDescription d = full(Version::k3);
  d.variables[1].start = std::vector<double>{-HUGE_VAL, HUGE_VAL, std::nan("")};
  d.variables[1].dimensions = {{3, {}}};
  EXPECT_THAT(to_xml(d), HasSubstr("start=\"-INF INF NaN\""));
}

// Archives

struct RawEntry {
  std::string name, content;
  zip_uint32_t mode = S_IFREG | 0644;
};

/// An archive with any contents.
void write_raw(const fs::path& path, const std::vector<RawEntry>& entries) {
  int code = 0;
  zip_t* zip = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code);
  ASSERT_NE(zip, nullptr);
  for (const RawEntry& e : entries) {
    const zip_int64_t i = e.name.ends_with('/')
                              ? zip_dir_add(zip, e.name.c_str(), ZIP_FL_ENC_UTF_8)
                              : zip_file_add(zip, e.name.c_str(), zip_source_buffer(zip, e.content.data(), e.content.size(), 0),
                                             ZIP_FL_ENC_UTF_8);
    ASSERT_GE(i, 0) << e.name << ": " << zip_strerror(zip);
    zip_file_set_external_attributes(zip, static_cast<zip_uint64_t>(i), 0, ZIP_OPSYS_UNIX, e.mode << 16);
  }
  ASSERT_EQ(zip_close(zip), 0);
}

std::size_t temporary_folders() {
  std::size_t count = 0;
  for (const auto& entry : fs::directory_iterator(fs::temp_directory_path())) {
    count += entry.path().filename().string().starts_with("cotwin-") ? 1 : 0;
  }
  return count;
}

class Archives : public ::testing::Test {
 protected:
  /// Temporary files of this test alone, so that files that are left over can be counted.
  void SetUp() override { setenv("TMPDIR", own_.path().c_str(), 1); }
  void TearDown() override { unsetenv("TMPDIR"); }
  TemporaryFolder own_;
  fs::path archive_ = own_.path() / "x.fmu";
};

TEST_F(Archives, AreReadAsTheyWereWritten) {
  const fs::path file = own_.path() / "source.bin";
  const std::string big(3'000'000, 'x');
  std::ofstream(file, std::ios::binary) << big;
  const std::vector<ArchiveFile> files = {{"a.txt", "hello"s}, {"empty", ""s}, {"deep/down/größer.bin", file}};
  write_archive(archive_, files);
  EXPECT_EQ(read_archive_file(archive_, "a.txt"), "hello");
  EXPECT_EQ(list_archive(archive_).size(), 3u);
  fs::path place;
  {
    const TemporaryFolder folder = unpack_archive(archive_);
    place = folder.path();
    EXPECT_EQ(cotwin::testing::content(place / "a.txt"), "hello");
    EXPECT_EQ(cotwin::testing::content(place / "empty"), "");
    EXPECT_EQ(cotwin::testing::content(place / "deep/down/größer.bin"), big);
  }
  EXPECT_FALSE(fs::exists(place));
}

TEST_F(Archives, AreTheSameBytesForTheSameFiles) {
  const std::vector<ArchiveFile> files = {{"a.txt", "hello"s}, {"b/c", "world"s}};
  write_archive(archive_, files);
  const std::string first = cotwin::testing::content(archive_);
  setenv("TZ", "Pacific/Kiritimati", 1);
  write_archive(archive_, files);
  unsetenv("TZ");
  EXPECT_EQ(cotwin::testing::content(archive_), first);
}

TEST_F(Archives, AreRefusedWhenNamesLeaveTheirFolder) {
  for (const char* name : {"../evil", "a/../../evil", "/etc/passwd", "C:/evil", "a\\..\\..\\evil", "a//b", "./a", "a\nb"}) {
    write_raw(archive_, {{"modelDescription.xml", "<x/>"}, {name, "evil"}});
    EXPECT_THROW(unpack_archive(archive_), Error) << name;
    EXPECT_THROW(list_archive(archive_), Error) << name;
    EXPECT_THROW(read_archive_file(archive_, "modelDescription.xml"), Error) << name;
  }
  write_raw(archive_, {{"link", "/etc", S_IFLNK | 0777}, {"link/passwd", "evil"}});
  EXPECT_THROW(unpack_archive(archive_), Error);
  write_raw(archive_, {{"pipe", "", S_IFIFO | 0644}});
  EXPECT_THROW(unpack_archive(archive_), Error);
  write_raw(archive_, {{"a", "file"}, {"a/b", "file in a file"}});
  EXPECT_THROW(unpack_archive(archive_), Error);
  EXPECT_EQ(temporary_folders(), 0u) << "nothing is left on the disk";
}

// The build of the Reference FMUs packs a folder of Roberts.fmu twice.
TEST_F(Archives, MayHoldAFileTwiceIfItIsTheSame) {
  for (const char* second : {"one", "two"}) {
    write_raw(archive_, {{"file.txt", "one"}, {"copy.txt", second}});
    std::string bytes = cotwin::testing::content(archive_);
    for (std::size_t at = 0; (at = bytes.find("copy.txt", at)) != std::string::npos;) bytes.replace(at, 8, "file.txt");
    std::ofstream(archive_, std::ios::binary) << bytes;
    if (second == "one"s) {
      EXPECT_EQ(list_archive(archive_).size(), 1u);
      EXPECT_EQ(cotwin::testing::content(unpack_archive(archive_).path() / "file.txt"), "one");
    } else {
      EXPECT_THAT([&] { unpack_archive(archive_); }, ThrowsMessage<Error>(HasSubstr("'file.txt': appears twice")));
    }
  }
}

TEST_F(Archives, AreRefusedWhenTheyUnpackToTooMuch) {
  write_raw(archive_, {{"big", std::string(2'000'000, 'x')}, {"bigger", std::string(3'000'000, 'y')}});
  EXPECT_NO_THROW(unpack_archive(archive_));
  EXPECT_THROW(unpack_archive(archive_, {.entries = 1}), Error);
  EXPECT_THROW(unpack_archive(archive_, {.file_bytes = 2'500'000}), Error);
  EXPECT_THROW(unpack_archive(archive_, {.total_bytes = 4'000'000}), Error);
  EXPECT_THROW(unpack_archive(archive_, {.expansion = 100, .expansion_from = 1u << 20}), Error);
  // Each file is below the limit of expansion, both together are above it.
  EXPECT_THROW(unpack_archive(archive_, {.expansion = 100, .expansion_from = 4'000'000}), Error);
  EXPECT_EQ(temporary_folders(), 0u);
}

TEST_F(Archives, AreRefusedWhenTheyAreDamagedAndNothingIsLeft) {
  const std::vector<ArchiveFile> files = {{"a.txt", std::string(5000, 'a') + "b"}, {"b/c", "world"s}};
  write_archive(archive_, files);
  const std::string whole = cotwin::testing::content(archive_);
  int refused = 0;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    std::string damaged = whole;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x40);
    std::ofstream(archive_, std::ios::binary) << damaged;
    try {
      unpack_archive(archive_);  // some bytes have no effect, such as the time
    } catch (const Error&) {
      ++refused;
    }
    std::ofstream(archive_, std::ios::binary) << whole.substr(0, i);
    EXPECT_THROW(unpack_archive(archive_), Error) << "cut at " << i;
  }
  EXPECT_GT(refused, static_cast<int>(whole.size() / 4));
  EXPECT_EQ(temporary_folders(), 0u);
  EXPECT_THROW(unpack_archive(own_.path() / "missing.fmu"), Error);
  EXPECT_THROW(read_archive_file(archive_, "none"), Error);
}

TEST_F(Archives, LeaveNoHalfWrittenFile) {
  const std::vector<ArchiveFile> files = {{"a", "a"s}, {"b", own_.path() / "missing"}};
  EXPECT_THROW(write_archive(archive_, files), Error);
  EXPECT_FALSE(fs::exists(archive_));
  const std::vector<ArchiveFile> escaping = {{"../a", "a"s}};
  EXPECT_THROW(write_archive(archive_, escaping), Error);
}

// URIs

TEST(FileUri, ReadsEveryFormThatHostsWrite) {
  EXPECT_EQ(path_from_uri("file:///data/a%20b/%C3%BC"), fs::path("/data/a b/ü"));
  EXPECT_EQ(path_from_uri("file:/data/x"), fs::path("/data/x"));
  EXPECT_EQ(path_from_uri("file:/%2fa%4F%6f"), path_from_uri("file:/%2Fa%4f%6F"));  // the last digit, in both cases
  EXPECT_EQ(path_from_uri("file:/%6f%4f"), fs::path("/oO"));
  EXPECT_EQ(path_from_uri("file://localhost/data/x/"), fs::path("/data/x/"));
  EXPECT_EQ(path_from_uri("file:///C:/x"), fs::path("C:/x"));
  EXPECT_EQ(path_from_uri("/data/50%"), fs::path("/data/50%"));
  for (const char* wrong : {"http://x/y", "file://elsewhere/x", "file:///a%2", "file:///a%zz", "file:///a%00b"}) {
    EXPECT_THROW(path_from_uri(wrong), Error) << wrong;
  }
}

TEST(FileUri, ConvertsBackToThePath) {
  for (const char* path : {"/data/a b", "/data/100% sure?", "/data/größer#1", "/data/a+b&c=d"}) {
    EXPECT_EQ(path_from_uri(uri_from_path(path)), fs::path(path));
  }
  EXPECT_EQ(uri_from_path("/a b"), "file:///a%20b");
}

TEST_F(Archives, AreRefusedForWhatTheyDeclareBeforeAnythingIsUnpacked) {
  // A file of 1 GB of text, which is read at once, from 1 MB of archive.
  const fs::path zeros = archive_.parent_path() / "zeros";
  std::ofstream(zeros) << ' ';
  fs::resize_file(zeros, 300u << 20);
  write_archive(archive_, std::vector<ArchiveFile>{{"modelDescription.xml", zeros}});
  const auto refused = [&](const std::string& why) {
    EXPECT_THAT([&] { unpack_archive(archive_); }, ThrowsMessage<Error>(HasSubstr(why)));
    EXPECT_THAT([&] { read_archive_file(archive_, "modelDescription.xml"); }, ThrowsMessage<Error>(HasSubstr(why)));
    EXPECT_THAT([&] { list_archive(archive_); }, ThrowsMessage<Error>(HasSubstr(why)));
    EXPECT_EQ(temporary_folders(), 0u);
  };
  refused("'modelDescription.xml': unpacks to 314572800 bytes, expected at most 268435456");
  write_archive(archive_, std::vector<ArchiveFile>{{"modelDescription.xml", "<a/>"s}, {"resources/table.bin", zeros}});
  refused("to 314572800, expected at most 200 times as many");
  fs::remove(zeros);

  std::string deep;
  for (int i = 0; i < 40; ++i) deep += "d/";
  write_raw(archive_, {{"modelDescription.xml", "<a/>"}, {deep + "f", ""}});
  refused("lies in more than 32 folders");
  write_raw(archive_, {{"modelDescription.xml", "<a/>"}, {std::string(2000, 'n'), ""}});
  refused("is not a file name, expected 1 to 1000 bytes");
}

TEST_F(Archives, OpeningAFifoDoesNotBlock) {
  fs::remove(archive_);
  ASSERT_EQ(mkfifo(archive_.c_str(), 0600), 0);
  alarm(60);
  EXPECT_THAT([&] { unpack_archive(archive_); }, ThrowsMessage<Error>(HasSubstr("is a FIFO, expected a zip archive")));
  EXPECT_THAT([] { list_archive("/dev/zero"); }, ThrowsMessage<Error>(HasSubstr("is a device, expected a zip archive")));
  alarm(0);
}

}  // namespace
}  // namespace cotwin::fmu::format_test
