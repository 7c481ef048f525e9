#pragma once
#include <cstdint>
#include <random>
#include <string>
#include <vector>

/// Files that are damaged or malicious, made from good files by a seed.
namespace cotwin::hostile {

struct File {
  std::string bytes;
  std::string what;         // the change, for messages
  bool never_good = false;  // every reader must refuse it
};

/// `count` variants of `good`: first those that are not random, then damage at places drawn from `seed`. `text`: the file is
/// text, of which a part is never complete (XML, JSON); any byte of an archive may matter, too.
std::vector<File> variants(const std::string& good, std::size_t count, std::uint64_t seed, bool part_is_bad, bool is_text);

}  // namespace cotwin::hostile
