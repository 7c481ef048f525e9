// Example 26: the borders of chamfer and clearance, from the geometry of plate and peg.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "models/foundation/formats/csv.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace insertion_study_test {
namespace {

using cotwin::testing::run_program;
using cotwin::testing::RunResult;

TEST(InsertionStudy, HasTheBordersOfChamferAndClearance) {
  // Peg 15 mm, hole 15.25 mm (48 facets: their middles are 0.03 mm nearer), chamfer 2 mm.
  const cotwin::testing::TemporaryFolder folder("insertion");
  const std::filesystem::path scenario =
      std::filesystem::path(cotwin::places::source()) / "examples/26_uncertain_insertion/insertion.ssd";
  const RunResult made = run_program(
      {"farm", scenario, "--design", "grid", "--vary", "world.plate.p0[1]=0.5,0.5002,0.5005,0.501,0.502,0.5025,0.503", "--keep",
       "end compliance.p_q[3]", "--keep", "peak world.f_c[3]", "--success", "end compliance.p_q[3]<-0.034", "--success",
       "peak world.f_c[3]<100", "--out", folder / "out", "--quiet"});
  ASSERT_EQ(made.code, 0) << made.err;
  const RunResult rows = run_program({"farm", "export", folder / "out"});
  cotwin::csv::Reader reader(rows.out, "export");
  int runs = 0;
  while (reader.next()) {
    const double offset = reader.real(reader.column("world.plate.p0[1]")) - 0.5,
                 force = reader.real(reader.column("peak world.f_c[3]")),
                 height = reader.real(reader.column("end compliance.p_q[3]"));
    if (offset < 0.22e-3) {
      EXPECT_EQ(force, 0) << offset;
      EXPECT_NEAR(height, -0.035, 1e-4);
    } else if (offset < 2.1e-3) {
      EXPECT_GT(force, 10) << offset;
      EXPECT_LT(force, 150) << offset;
      EXPECT_LT(height, -0.034) << offset;
    } else {
      EXPECT_GT(force, 250) << offset;
    }
    EXPECT_EQ(reader.text(reader.column("success")), height < -0.034 && force < 100 ? "1" : "0") << offset;
    ++runs;
  }
  EXPECT_EQ(runs, 7);
}

}  // namespace
}  // namespace insertion_study_test
