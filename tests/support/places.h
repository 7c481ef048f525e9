#pragma once
#include <string>

/// Folders and files that tests, benchmarks and fuzz targets need. These paths are compiled into one source file, so that a
/// compiler cache serves every checkout and build folder.
namespace cotwin::places {

/// The root of the source tree.
std::string source();
/// Public data that is not part of the repository; may not exist. Tests that need it are skipped without it.
std::string shared();
/// The program `cotwin` of this build.
std::string program();
/// The libraries of the units of linear_units.h as FMUs (PackRequest::libraries).
std::string linear_libraries();
/// The libraries of the FMUs below tests/fmu/fmus.
std::string foreign_libraries();

}  // namespace cotwin::places
