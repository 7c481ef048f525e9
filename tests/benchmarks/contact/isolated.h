#pragma once
#include <string>
#include <vector>

#include "tests/benchmarks/contact/cases.h"

namespace cotwin::benchmark {

/// The figures of a case in an engine; without figures the run failed.
struct Outcome {
  std::vector<Figure> figures;
  std::string failure;  // "does not end", "crashes"; "" if there are figures
};

/// Runs the case in a process of its own with at most `limit` seconds of processor time, so that an engine that aborts or does
/// not end leaves the others' figures.
Outcome run_isolated(const Case& what, const EngineKind& engine, unsigned limit);

}  // namespace cotwin::benchmark
