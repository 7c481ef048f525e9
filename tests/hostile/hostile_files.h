#pragma once
#include <cstdint>
#include <random>
#include <string>
#include <vector>

/// Files that are damaged, or were written to do harm, made from good ones by a seed.
namespace cotwin::hostile {

struct File {
  std::string bytes;
  std::string what;         // was done to it
  bool never_good = false;  // no reader may take it
};

/// `count` variants of `good`: those that need no chance first, then damage at places drawn from `seed`. `text`: it is text, of
/// which a part is never whole (XML, JSON); the bytes of an archive are as sensitive.
std::vector<File> variants(const std::string& good, std::size_t count, std::uint64_t seed, bool part_is_bad, bool is_text);

}  // namespace cotwin::hostile
