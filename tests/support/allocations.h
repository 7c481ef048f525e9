#pragma once
#include <cstdint>

namespace cotwin::testing {

/// The number of allocations of the calling thread so far (malloc, calloc, realloc, operator new). The difference of two values
/// is the number of allocations between them. Works with and without sanitizers.
std::uint64_t allocations();

}  // namespace cotwin::testing
