#pragma once
#include <cstdint>
#include <string>

#include "master/scenario/scenario.h"
#include "models/foundation/support/file_hash.h"
#include "models/foundation/support/file_store.h"

/// Identifies what determines the bits of a run: the program, and a scenario with the files that it names.
namespace cotwin::master {

/// Hash of everything in the scenario that a run depends on, including `--set`, and of the contents of FMUs and of files that
/// parameters and settings name. Independent of the scenario's folder.
std::uint64_t hash_of(const Scenario& scenario);
/// Hash of the robots, cells, clouds and start values that units have read, with the meshes that these name.
std::uint64_t hash_of(const FileStore& models);

/// This program.
struct Build {
  std::string version;     // "0.9.0"
  std::uint64_t file = 0;  // a hash of the executable
  std::string cpu;         // the instruction set of the kernels, e.g. "x86-64-v3"

  static auto fields(auto& b, auto each) { return each(b.version, b.file, b.cpu); }
  friend bool operator==(const Build&, const Build&) = default;
};

}  // namespace cotwin::master
