#pragma once
#include <cstdint>
#include <string>

#include "master/ssp/scenario.h"
#include "models/support/file_hash.h"

/// What decides the bits of a run: a program, and a scenario with the files that it names.
namespace cotwin::master {

/// A hash of everything in the scenario that a run depends on, `--set` included, and of the contents of FMUs and of files that
/// parameters and settings name. Where the scenario lies does not count.
std::uint64_t hash_of(const Scenario& scenario);

/// The program that runs.
struct Build {
  std::string version;     // "0.9.0"
  std::uint64_t file = 0;  // a hash of the executable
  std::string cpu;         // the instruction set of the kernels, e.g. "x86-64-v3"
  friend bool operator==(const Build&, const Build&) = default;
};

}  // namespace cotwin::master
