#pragma once
#include <cstdint>

namespace cotwin::testing {

/// How often the calling thread has asked the heap for memory so far (malloc, calloc, realloc, operator new): the difference of
/// two readings is what the code between them allocated. Works with and without sanitizers.
std::uint64_t allocations();

}  // namespace cotwin::testing
