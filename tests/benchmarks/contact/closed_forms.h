#pragma once
#include <string>
#include <vector>

#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {

/// Prints scenes with closed forms (tests/support/closed_forms.h) as a table in Markdown: engines as columns, steps and sizes as rows. A cell is
/// the figure; "wrong" if theory says another one, "told" if it is wrong and the program says so, "error" if the run ends with one. Returns the number of cells of Cotwin that are wrong and not told.
/// `filter`, `engine`: parts of names.
int print_closed_forms(const std::string& filter, const std::string& engine);

}  // namespace cotwin::benchmark
