#pragma once
#include <cstddef>
#include <vector>

namespace cotwin::master {

/// Strongly connected components of the graph whose edges are `edges[node]`, the components in topological order (sources
/// first), nodes within a component ascending.
std::vector<std::vector<std::size_t>> strong_components(const std::vector<std::vector<std::size_t>>& edges);

}  // namespace cotwin::master
