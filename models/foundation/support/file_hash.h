#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

namespace cotwin {

/// 64-bit hash of a file's contents, to detect changes; not cryptographic. Of a folder (a bag): of its files, in the order of their names. Throws Error if it
/// cannot be read.
std::uint64_t hash_of_file(const std::filesystem::path& file);

/// 16 hexadecimal digits.
std::string hexadecimal(std::uint64_t hash);

}  // namespace cotwin
