#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <filesystem>
#include <span>
#include <vector>

#include "components/unit/unit_table.h"

/// Units that a program loads at run time. CMake writes the module of a unit from outside the source tree (cotwin_unit in
/// scripts/units.cmake): a shared library with one C function, cotwin_unit_module(). Module and program are compiled from the
/// same headers, share no code, and exchange C++ objects, so both must agree on their layout.
namespace cotwin {

/// The layout of the objects that cross the border, as the compiler of either side has it.
using UnitLayout = std::array<std::size_t, 7>;
// Only the thousands of the ABI's version: clang has 1002 and g++ 12 has 1017 for what both lay out alike.
inline constexpr UnitLayout kUnitLayout = {__GXX_ABI_VERSION / 1000, _GLIBCXX_USE_CXX11_ABI, EIGEN_MAX_ALIGN_BYTES,
                                           sizeof(Variable),         sizeof(Variables),      sizeof(Settings),
                                           sizeof(UnitType)};

inline constexpr unsigned kModuleFormat = 1;  // of the struct below

/// What a module shows. The first three members never change their places.
struct UnitModule {
  unsigned format;      // kModuleFormat
  const char* version;  // of cotwin and of its headers for units, "0.1.0 (interface 2b1c90aa)"
  UnitLayout layout;    // kUnitLayout
  const UnitType* types;
  std::size_t count;
};

/// The units that a program may use.
struct UnitCatalogue {
  std::vector<UnitType> types;                 // of the program, then of the modules
  std::vector<std::filesystem::path> modules;  // files that were loaded, without links; FMU libraries are in fmu/ beside each
};

/// The units of `own` and of the modules. `paths`: modules (x.so), and folders of which every *.so is a module. Modules stay
/// loaded until the process ends. Throws Error for a path that is no module, a module of another version, compiler ABI or
/// Eigen alignment, and a unit whose name is taken.
UnitCatalogue load_units(std::span<const UnitType> own, std::span<const std::filesystem::path> paths);

}  // namespace cotwin
