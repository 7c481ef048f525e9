#pragma once
#include <cstddef>
#include <span>
#include <string>

/// Numbers as printable text, to the bit: eleven characters from '0' to 'o' each, six bits a character, the lowest first. The
/// tuner remembers thousands of numbers that mean nothing one by one. As text they are one variable of FMI 2, which has
/// scalars alone, and nobody looks through them for NaN in every step.
namespace cotwin::tuner {

inline constexpr std::size_t kCharacters = 11;

/// Writes the numbers at `to`, which has room for kCharacters each. Allocates nothing.
void write_numbers(std::span<const double> from, char* to);
/// Reads them back. Throws Error naming `place` for text of another length or with other characters; then `to` is undefined.
void read_numbers(const std::string& from, std::span<double> to, const char* place);

}  // namespace cotwin::tuner
