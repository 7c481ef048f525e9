// Runs the FMUs for Windows and ARM, as built by scripts/cross.sh, there (wine, qemu) and here with the same script
// (player/player.c): every unit with all of its variants, and a scenario as one FMU.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <set>
#include <sstream>

#include "fmu/archive/archive.h"
#include "fmu/archive/uri.h"
#include "fmu/check/check.h"
#include "fmu/check/pe.h"
#include "fmu/description/read.h"
#include "fmu/export/pack.h"
#include "fmu/import/library.h"
#include "master/twin/pack_twin.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/subjects.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cotwin::fmu {

static void PrintTo(Version version, std::ostream* out) { *out << "FMI " << static_cast<int>(version); }

namespace platforms_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::error_of;
using testing::Subject;

constexpr int kSteps = 100;
constexpr int kSaved = 40;      // the state is saved before this step
constexpr double kStep = 1e-3;  // s

/// Platforms differ in the C library (sin, exp, pow … by an ulp or two) and in the kernels' fused multiply-add. An adaptive
/// method may choose other steps, with other errors: up to 1e-9 was measured in accelerations, where 3e-10 rad and 2e-7 rad/s
/// are allowed.
constexpr double kRounding = 1e-8;

struct Platform {
  std::string name;     // name in cross.sh and FMI 2
  std::string tuple;    // name in FMI 3
  std::string player;   // below the folder of the cross builds
  std::string command;  // runs a program of this platform here
};

void PrintTo(const Platform& platform, std::ostream* out) { *out << platform.name; }

const std::vector<Platform>& platforms() {
  static const std::vector<Platform> all = {
      {"win64", "x86_64-windows", "win64/cotwin/tests/player.exe", "wine"},
      {"aarch64-linux", "aarch64-linux", "aarch64-linux/cotwin/tests/player", "qemu-aarch64-static -L /usr/aarch64-linux-gnu"}};
  return all;
}

/// The platform of this machine.
const Platform& here() {
  static const Platform own{platform_folders(Version::k2).front(), own_platform(), "", ""};
  return own;
}

fs::path cross() { return cross_folder().parent_path(); }

fs::path player(const Platform& platform) {
  return platform.name == here().name ? fs::path(COTWIN_PLAYER) : cross() / platform.player;
}

/// The reason why the platform cannot be tested; "" if it can.
std::string obstacle(const Platform& platform) {
  if (platform.tuple == own_platform()) return "is this machine's own";
  if (std::string(COTWIN_SANITIZERS).size() > 0) return "the player is built without sanitizers, this build with them";
  const fs::path built = cross() / platform.name / "built";
  if (!fs::exists(built)) return "no " + built.string() + ": scripts/cross.sh " + platform.name + " was not run";
  for (const auto& entry : fs::directory_iterator(library_folder() / here().tuple)) {
    if (entry.path().extension() == ".so" && entry.last_write_time() > fs::last_write_time(built))
      return entry.path().string() + " is newer than " + built.string() + ": run scripts/cross.sh " + platform.name + " again";
  }
  const std::string emulator = platform.command.substr(0, platform.command.find(' '));
  if (cotwin::testing::run_command({emulator, "--version"}).code != 0) return "no " + emulator;
  return "";
}

/// Whether the cross build made the library of that name: it may have been restricted to some.
bool was_built(const Platform& platform, const std::string& name) {
  std::ifstream in(cross() / platform.name / "built");
  std::set<std::string> names;
  for (std::string line; std::getline(in, line);) {
    if (!line.empty()) names.insert(line);
  }
  return names.empty() || names.contains(name);
}

/// The result of the tuner's swarm differs between platforms: it depends on comparisons, and a tenth of a second of smooth
/// motion leaves so much undetermined (condition 2e7) that inputs changed by 1e-16 change its masses as much on one machine.
/// Compared are the values that the samples alone determine, and the times of the results.
bool is_compared(const std::string& source, const ModelVariable& v) {
  static const std::set<std::string> determined = {"rms_prior", "rms_floor", "rank",    "samples",
                                                   "tunings",   "late",      "skipped", "warning"};
  return !source.starts_with("unit:tuner") || determined.contains(v.name.substr(0, v.name.find('[')));
}

/// The path as programs of the platform see it: wine shows this machine's files as drive Z.
std::string native(const Platform& platform, const fs::path& path) {
  if (platform.name != "win64") return path.string();
  std::string text = "Z:" + path.string();
  std::replace(text.begin(), text.end(), '/', '\\');
  return text;
}

std::string bits(double value) {
  char digits[17];
  std::snprintf(digits, sizeof digits, "%016llx", static_cast<unsigned long long>(std::bit_cast<std::uint64_t>(value)));
  return digits;
}

/// One unpacked FMU, and the variables that are read.
struct Piece {
  std::string source;
  fs::path folder;
  ModelDescription description;
  std::vector<const ModelVariable*> inputs, reals, others;  // reals: outputs and locals; others: outputs of other types

  std::size_t count(const std::vector<const ModelVariable*>& variables) const {
    const DescriptionIndex index(description);
    std::size_t n = 0;
    for (const ModelVariable* v : variables) n += index.elements(*v);
    return n;
  }
};

class Played : public ::testing::TestWithParam<std::tuple<Platform, Version>> {
 protected:
  const Platform& platform() const { return std::get<0>(GetParam()); }
  Version version() const { return std::get<1>(GetParam()); }

  void SetUp() override {
    const std::string why = obstacle(platform());
    if (why.empty()) return;
    // Where libraries were built for this test (.ci/run), skipping it would hide that they are missing.
    const bool required = std::getenv("COTWIN_REQUIRE_PLATFORMS") != nullptr && platform().tuple != own_platform() &&
                          std::string(COTWIN_SANITIZERS).empty();
    if (required) FAIL() << why;
    GTEST_SKIP() << why;
  }

  /// Packs for this machine and for the platform, and unpacks into a folder whose name cannot be written in any code page.
  Piece piece(const std::string& source, const std::function<void(const std::vector<std::string>&, const fs::path&)>& pack) {
    const fs::path archive = folder_.path() / (std::to_string(pieces_) + ".fmu");
    pack({here().name, platform().name}, archive);
    Piece piece{source, folder_.path() / ("Größe " + std::to_string(pieces_++) + " µ — 手"), {}, {}, {}, {}};
    fs::copy(unpack_archive(archive).path(), piece.folder, fs::copy_options::recursive);
    piece.description = load_model_description(piece.folder / "modelDescription.xml");
    for (const ModelVariable& v : piece.description.variables) {
      const bool output = v.causality == Causality::kOutput;
      if (v.type == Type::kFloat64 && v.causality == Causality::kInput) piece.inputs.push_back(&v);
      if (!is_compared(source, v)) continue;
      if (v.type == Type::kFloat64 && (output || v.causality == Causality::kLocal)) piece.reals.push_back(&v);
      // Most integers count solver steps, which rounding may change.
      const bool counts_samples = v.type == Type::kInt32 && source.starts_with("unit:tuner");
      if ((v.type == Type::kBoolean || v.type == Type::kString || counts_samples) && output) piece.others.push_back(&v);
    }
    return piece;
  }

  /// Plays the script and returns the lines of its output.
  std::vector<std::string> play(const Platform& where, const std::string& script) const {
    const fs::path file = folder_.path() / (where.name + ".txt");
    std::ofstream(file) << script;
    // One process at a time in wine's folder, which the first one creates.
    std::vector<std::string> command = cotwin::testing::words(where.command);
    if (where.command == "wine") command.insert(command.begin(), {"flock", std::string(COTWIN_WINE_FOLDER) + ".lock"});
    command.insert(command.end(), {player(where), native(where, file)});
    const std::string wine_folder = std::string("WINEPREFIX=") + COTWIN_WINE_FOLDER;
    const auto played =
        cotwin::testing::run_command(command, {.environment = {"LC_ALL=C.UTF-8", "WINEDEBUG=-all", wine_folder}});
    EXPECT_EQ(played.code, 0) << where.name << ": " << played.err;
    std::vector<std::string> lines;
    std::istringstream stream(played.out);
    for (std::string line; std::getline(stream, line);) lines.push_back(line);
    return lines;
  }

  TemporaryFolder folder_;
  int pieces_ = 0;
};

void append_references(std::ostream& out, const std::vector<const ModelVariable*>& variables) {
  out << ' ' << variables.size();
  for (const ModelVariable* v : variables) out << ' ' << v->reference;
}

/// Inputs as smooth and small as those of the other tests, as bits.
void append_excitation(std::ostream& out, const Piece& piece, int number) {
  if (piece.inputs.empty()) return;
  out << "set";
  append_references(out, piece.inputs);
  out << ' ' << piece.count(piece.inputs);
  std::size_t channel = 0;
  const DescriptionIndex index(piece.description);
  for (const ModelVariable* v : piece.inputs) {
    const Numeric limits = index.effective(*v);
    for (std::size_t i = 0; i < index.elements(*v); ++i, ++channel) {
      const double wave = 0.1 * std::sin(0.013 * number + 0.7 * static_cast<double>(channel));
      out << ' ' << bits(std::min(std::max(wave, limits.min.value_or(-1)), limits.max.value_or(1)));
    }
  }
  out << '\n';
}

void append_steps(std::ostream& out, const Piece& piece, int begin, int end) {
  for (int i = begin; i < end; ++i) {
    append_excitation(out, piece, i);
    out << "step " << bits(i * kStep) << ' ' << bits(kStep) << "\nreal";
    append_references(out, piece.reals);
    out << ' ' << piece.count(piece.reals) << '\n';
  }
}

/// An instance without a resource path; then a run that saves its state; then the rest of the run in a fresh instance from the
/// bytes of the state.
std::string script_of(const Piece& piece, const Platform& where) {
  const bool two = piece.description.version == Version::k2;
  std::ostringstream out;
  const Interface& interface = *piece.description.co_simulation;
  const fs::path library = piece.folder / "binaries" / (two ? where.name : where.tuple) /
                           (interface.model_identifier + (where.name == "win64" ? ".dll" : ".so"));
  std::string resources = native(where, piece.folder / "resources" / "");
  if (two) {
    resources = uri_from_path(piece.folder / "resources");
    if (where.name == "win64") resources.insert(std::string("file://").size(), "/Z:");
  }
  out << "fmi " << (two ? 2 : 3) << "\nlibrary " << native(where, library) << "\ntoken " << piece.description.token
      << "\nnew\nresources " << resources << "\nnew\n";
  append_excitation(out, piece, 0);
  out << "initialise " << bits(0) << '\n';
  append_steps(out, piece, 0, kSaved);
  if (interface.can_serialise_state) out << "save\n";
  append_steps(out, piece, kSaved, kSteps);
  for (const ModelVariable* v : piece.others) {
    out << (v->type == Type::kBoolean ? "boolean" : v->type == Type::kInt32 ? "integer" : "text");
    append_references(out, {v});
    out << ' ' << piece.count({v}) << '\n';
  }
  if (interface.can_serialise_state) {
    out << "new\nrestore\n";
    append_steps(out, piece, kSaved, kSteps);
  }
  out << "unload\n";
  return out.str();
}

std::vector<double> reals(const std::string& line) {
  std::vector<double> values;
  std::istringstream in(line);
  for (std::string word; in >> word;) values.push_back(std::bit_cast<double>(std::stoull(word, nullptr, 16)));
  return values;
}

/// Below this value (in its SI unit) a variable is an error of the solver, and its digits are noise.
constexpr double kNoise = 1e-3;

/// Estimated errors in units of the tolerance are differences of two solutions that agree to about that tolerance (1e-9), which
/// leaves rounding of 1e-16 with a share of 1e-7 and more in them.
double bound_of(const std::string& variable) {
  static const std::set<std::string> estimates = {"error_estimate", "worst_error"};
  const std::string name = variable.substr(variable.rfind('.') + 1);  // "drive.error_estimate" in a twin
  return estimates.contains(name) ? 1e-5 : kRounding;
}

/// The largest difference of any real variable over the run, relative to the variable's largest value in the run or kNoise, and
/// as a share of what the variable is allowed.
struct Difference {
  double share = 0;
  double value = 0;
  std::string variable;
};
Difference difference(const Piece& piece, std::span<const std::string> a, std::span<const std::string> b) {
  const DescriptionIndex index(piece.description);
  std::vector<double> largest(piece.reals.size()), apart(piece.reals.size());
  for (std::size_t step = 0; step < kSteps; ++step) {
    const std::vector<double> x = reals(a[step]), y = reals(b[step]);
    EXPECT_EQ(x.size(), piece.count(piece.reals));
    EXPECT_EQ(x.size(), y.size());
    std::size_t k = 0;
    for (std::size_t v = 0; v < piece.reals.size(); ++v) {
      for (std::size_t i = 0; i < index.elements(*piece.reals[v]); ++i, ++k) {
        largest[v] = std::max(largest[v], std::abs(x.at(k)));
        apart[v] = std::max(apart[v], std::abs(x.at(k) - y.at(k)));
      }
    }
  }
  Difference found;
  for (std::size_t v = 0; v < piece.reals.size(); ++v) {
    const double relative = apart[v] / std::max(largest[v], kNoise);
    const double share = relative / bound_of(piece.reals[v]->name);
    if (share > found.share) found = {share, relative, piece.reals[v]->name};
  }
  return found;
}

TEST_P(Played, GivesTheSameResultsAsHereToRounding) {
  std::vector<Piece> all;
  for (const Subject& subject : testing::subjects(true)) {
    if (subject.version != version() || !was_built(platform(), parse_unit_source(subject.source).unit)) continue;
    PackRequest request = testing::request_for(subject);
    all.push_back(piece(subject.source, [&](const std::vector<std::string>& both, const fs::path& out) {
      request.platforms = both;
      pack_unit(request, out);
    }));
  }
  if (was_built(platform(), "twin"))
    all.push_back(piece("a scenario", [&](const std::vector<std::string>& both, const fs::path& out) {
      master::PackageOptions options;
      options.types = unit_types();
      options.folders = {testing::properties_folder(), fs::path(places::source()) / "models"};
      options.version = version();
      options.platforms = both;
      master::Scenario scenario = master::load_scenario(fs::path(places::source()) / "examples/02_free_motion_lwr4/twin.ssd");
      scenario.start = Time{};
      master::pack_twin(scenario, options, out);
    }));

  ASSERT_FALSE(all.empty());
  std::string script_here, script_there;
  for (const Piece& p : all) {
    script_here += script_of(p, here());
    script_there += script_of(p, platform());
  }
  const std::vector<std::string> expected = play(here(), script_here), seen = play(platform(), script_there);
  EXPECT_EQ(seen.size(), expected.size());
  std::size_t line = 0;
  for (const Piece& p : all) {
    SCOPED_TRACE(p.source);
    const bool resumed = p.description.co_simulation->can_serialise_state;
    const std::size_t length = kSteps + p.others.size() + (resumed ? kSteps - kSaved : 0);
    if (std::min(seen.size(), expected.size()) < line + length) break;  // it stopped here: see its output
    const std::span a = std::span(expected).subspan(line), b = std::span(seen).subspan(line);
    const Difference found = difference(p, a, b);
    EXPECT_LT(found.share, 1) << found.variable << " differs by " << found.value;
    std::cout << "[  differs ] " << p.source << ": by " << found.value << " at most"
              << (found.value > 0 ? ", in " + found.variable : "") << '\n';
    for (std::size_t i = 0; i < p.others.size(); ++i) EXPECT_EQ(b[kSteps + i], a[kSteps + i]) << p.others[i]->name;
    line += length;
    for (std::size_t i = kSaved; resumed && i < kSteps; ++i)
      ASSERT_EQ(b[kSteps + p.others.size() + i - kSaved], b[i]) << "from a saved state, step " << i;
  }
  EXPECT_EQ(line, seen.size());
}

std::string name_of_play(const ::testing::TestParamInfo<std::tuple<Platform, Version>>& info) {
  std::string name = std::get<0>(info.param).name + (std::get<1>(info.param) == Version::k2 ? "_fmi2" : "_fmi3");
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Platforms, Played,
                         ::testing::Combine(::testing::ValuesIn(platforms()), ::testing::Values(Version::k2, Version::k3)),
                         name_of_play);

// Packing for other platforms, whether or not there are libraries for them here.

class PackedForPlatforms : public ::testing::Test {
 protected:
  void put(const std::string& file, const std::string& content) const {
    fs::create_directories((libraries() / file).parent_path());
    std::ofstream(libraries() / file) << content;
  }
  fs::path libraries() const { return folder_.path() / "libraries"; }
  PackRequest request(Version version, std::vector<std::string> names) const {
    PackRequest request = testing::request_for({"unit:compliance?robot=lwr4", version});
    request.platforms = std::move(names);
    request.libraries = libraries();
    return request;
  }
  std::vector<std::string> names(const PackRequest& request) const {
    const fs::path archive = folder_.path() / "x.fmu";
    pack_unit(request, archive);
    std::vector<std::string> all;
    for (const ArchiveEntry& entry : list_archive(archive)) all.push_back(entry.name);
    return all;
  }

  TemporaryFolder folder_;
};

TEST_F(PackedForPlatforms, UsesTheFolderNamesOfTheFmiVersion) {
  for (const char* file : {"x86_64-linux/compliance.so", "x86_64-windows/compliance.dll", "aarch64-linux/compliance.so"})
    put(file, "library");
  const std::vector<std::string> fmi2 = {"linux64", "win64", "aarch64-linux"},
                                 fmi3 = {"x86_64-linux", "x86_64-windows", "aarch64-linux"};
  for (const auto& list : {fmi2, fmi3}) {  // in the terms of either
    EXPECT_THAT(names(request(Version::k2, list)),
                ::testing::IsSupersetOf({"binaries/linux64/compliance.so", "binaries/win64/compliance.dll",
                                         "binaries/aarch64-linux/compliance.so"}));  // FMI 2.0.4, clause 2.3
    EXPECT_THAT(names(request(Version::k3, list)),
                ::testing::IsSupersetOf({"binaries/x86_64-linux/compliance.so", "binaries/x86_64-windows/compliance.dll",
                                         "binaries/aarch64-linux/compliance.so"}));
  }
}

TEST_F(PackedForPlatforms, TakesEveryPlatformAndEveryLicenseOnce) {
  put("x86_64-linux/compliance.so", "library");
  put("aarch64-linux/compliance.so", "library");
  put("x86_64-linux/licenses/a.txt", "a");
  put("x86_64-linux/licenses/b.txt", "b");
  put("aarch64-linux/licenses/b.txt", "b");
  put("aarch64-linux/licenses/c.txt", "c");
  const std::vector<std::string> all = names(request(Version::k2, {"linux64", "aarch64-linux", "x86_64-linux"}));
  std::vector<std::string> found;
  std::copy_if(all.begin(), all.end(), std::back_inserter(found), [](const std::string& name) {
    return name.starts_with("binaries/") || name.starts_with("documentation/licenses/");
  });
  EXPECT_THAT(found, ::testing::UnorderedElementsAre("binaries/linux64/compliance.so", "binaries/aarch64-linux/compliance.so",
                                                     "documentation/licenses/a.txt", "documentation/licenses/b.txt",
                                                     "documentation/licenses/c.txt"));
}

TEST_F(PackedForPlatforms, NamesTheScriptThatMakesAMissingLibrary) {
  const Instance instance = testing::in_process(testing::request_for({"unit:compliance?robot=lwr4", Version::k3}));
  const UnitType nobody{"nobody", "a unit that is in no build", nullptr};
  const auto packing = [&](const std::string& platform) {
    return error_of([&] {
      pack({nobody, *instance.unit, instance.variables, "", nullptr, nullptr, {}}, request(Version::k3, {platform}),
           folder_.path() / "x.fmu");
    });
  };
  EXPECT_THAT(packing("win64"), ::testing::HasSubstr("platform x86_64-windows: no library of nobody, expected it from "
                                                     "scripts/cross.sh win64; looked for\n"));
  EXPECT_THAT(packing("aarch64-linux"), ::testing::HasSubstr("expected it from scripts/cross.sh aarch64-linux"));
  EXPECT_THAT(packing(own_platform()), ::testing::HasSubstr("expected it from the build of the units"));
  EXPECT_THAT(packing("aarch64-darwin"), ::testing::HasSubstr("expected it from a build for that platform"));
  EXPECT_THAT(packing("win64"), ::testing::HasSubstr((libraries() / "x86_64-windows/nobody.dll").string()));
}

TEST_F(PackedForPlatforms, RepeatsWhyAUnitWasLeftOut) {
  put("x86_64-windows/compliance.txt", "the unit compliance was not built: Foo::foo is missing for this platform");
  EXPECT_EQ(error_of([&] { names(request(Version::k3, {"win64"})); }),
            "platform x86_64-windows: the unit compliance was not built: Foo::foo is missing for this platform");

  put("x86_64-windows/twin.dll", "library");  // has no unit compliance inside
  master::PackageOptions options;
  options.types = unit_types();
  options.folders = {testing::properties_folder(), fs::path(places::source()) / "models"};
  options.platforms = {"win64"};
  options.libraries = libraries();
  const master::Scenario scenario = master::load_scenario(fs::path(places::source()) / "examples/02_free_motion_lwr4/twin.ssd");
  EXPECT_THAT(error_of([&] { master::pack_twin(scenario, options, folder_.path() / "twin.fmu"); }),
              ::testing::HasSubstr("the unit compliance was not built"));
}

/// A DLL that has only an import and an export table, written according to Microsoft's "PE Format": one section, whose
/// addresses are its offsets in the file plus 0x1000.
class Dll {
 public:
  explicit Dll(std::uint16_t machine = 0x8664) : bytes_(0x400, '\0') {
    put<std::uint16_t>(0, 0x5a4d);     // "MZ"
    put<std::uint32_t>(0x3c, 0x80);    // offset of the signature
    put<std::uint32_t>(0x80, 0x4550);  // "PE"
    put<std::uint16_t>(0x84, machine);
    put<std::uint16_t>(0x86, 1);             // sections
    put<std::uint16_t>(0x94, 240);           // bytes of the optional header
    put<std::uint16_t>(0x96, 0x2022);        // a DLL
    put<std::uint16_t>(0x98, 0x20b);         // 64 bits
    put<std::uint32_t>(0x98 + 108, 16);      // number of directories
    put<std::uint32_t>(0x98 + 112, 0x1200);  // exports
    put<std::uint32_t>(0x98 + 120, 0x1280);  // imports
    put<std::uint32_t>(0x188 + 12, 0x1000);  // the section: address, size, place
    put<std::uint32_t>(0x188 + 16, 0x400);
    put<std::uint32_t>(0x188 + 20, 0);
    put<std::uint32_t>(0x200 + 24, 2);  // names
    put<std::uint32_t>(0x200 + 32, 0x1240);
    put<std::uint32_t>(0x240, 0x1300);
    put<std::uint32_t>(0x244, 0x1310);
    put<std::uint32_t>(0x280 + 12, 0x1320);
    put<std::uint32_t>(0x294 + 12, 0x1330);
    text(0x300, "fmi3DoStep");
    text(0x310, "DllMain");
    text(0x320, "KERNEL32.dll");
    text(0x330, "VCRUNTIME140.dll");
  }
  template <class T>
  void put(std::size_t at, T value) {
    std::memcpy(bytes_.data() + at, &value, sizeof value);
  }
  void text(std::size_t at, const std::string& value) { bytes_.replace(at, value.size(), value); }
  const std::string& bytes() const { return bytes_; }
  fs::path write(const fs::path& file) const {
    fs::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << bytes_;
    return file;
  }

 private:
  std::string bytes_;
};

TEST(Pe, FindsExportedSymbolsAndNeededLibraries) {
  const TemporaryFolder folder;
  const PeLibrary pe = read_pe(Dll().write(folder.path() / "x.dll"));
  EXPECT_EQ(pe.machine, "x86_64");
  EXPECT_THAT(pe.exported, ::testing::ElementsAre("DllMain", "fmi3DoStep"));
  EXPECT_THAT(pe.needed, ::testing::ElementsAre("KERNEL32.dll", "VCRUNTIME140.dll"));
  EXPECT_EQ(read_pe(Dll(0xaa64).write(folder.path() / "y.dll")).machine, "aarch64");
  EXPECT_TRUE(is_part_of_windows("KERNEL32.dll"));
  EXPECT_TRUE(is_part_of_windows("api-ms-win-crt-runtime-l1-1-0.dll"));
  EXPECT_FALSE(is_part_of_windows("VCRUNTIME140.dll"));
}

TEST(Pe, RefusesTruncatedAndDamagedFiles) {
  const TemporaryFolder folder;
  const fs::path file = folder.path() / "x.dll";
  const std::string whole = Dll().bytes();
  for (std::size_t n = 0; n < 0x33f; ++n) {  // the last name ends at 0x340
    std::ofstream(file, std::ios::binary) << whole.substr(0, n);
    EXPECT_THROW(read_pe(file), Error) << n << " bytes";
  }
  std::uint32_t random = 1;
  for (int i = 0; i < 2000; ++i) {
    std::string damaged = whole;
    for (int k = 0; k < 5; ++k) {
      random = random * 1664525u + 1013904223u;
      damaged[(random >> 8) % damaged.size()] = static_cast<char>(random);
    }
    std::ofstream(file, std::ios::binary) << damaged;
    try {
      static_cast<void>(read_pe(file));
    } catch (const Error&) {
    }
  }
}

TEST(Check, ListsTheNeedsAndErrorsOfEachPlatformsLibrary) {
  const TemporaryFolder folder;
  const fs::path fmu = folder.path() / "fmu";
  const fs::path libraries = folder.path() / "libraries";
  for (const char* file : {"x86_64-linux/compliance.so", "x86_64-windows/compliance.dll"}) {
    fs::create_directories((libraries / file).parent_path());
    std::ofstream(libraries / file) << "library";
  }
  PackRequest request = testing::request_for({"unit:compliance?robot=lwr4", Version::k3});
  request.libraries = libraries;
  request.platforms = {"linux64", "win64"};
  pack_unit(request, folder.path() / "x.fmu");
  fs::copy(unpack_archive(folder.path() / "x.fmu").path(), fmu, fs::copy_options::recursive);
  Dll(0xaa64).write(fmu / "binaries/x86_64-windows/compliance.dll");
  std::vector<std::string> texts;
  for (const Finding& f : check_fmu(fmu, false)) texts.push_back(std::to_string(static_cast<int>(f.level)) + " " + f.text);
  const std::string dll = " binaries/x86_64-windows/compliance.dll ";
  EXPECT_THAT(
      texts,
      ::testing::IsSupersetOf(
          {"0" + dll + "is for aarch64, expected x86_64",
           "1" + dll + "needs VCRUNTIME140.dll, which is neither part of Windows nor in the archive",
           "1" + dll + "exports 1 symbols other than fmi2* and fmi3*, which can collide with those of other libraries: DllMain",
           "2" + dll + "needs KERNEL32.dll, VCRUNTIME140.dll"}));
  EXPECT_THAT(texts,
              ::testing::Contains(::testing::HasSubstr("compliance.so cannot be used: compliance.so: is not an ELF file")));
}

}  // namespace
}  // namespace platforms_test
}  // namespace cotwin::fmu
