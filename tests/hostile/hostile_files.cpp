#include "tests/hostile/hostile_files.h"

#include <algorithm>
#include <array>
#include <cctype>

namespace cotwin::hostile {

namespace {

class Maker {
 public:
  Maker(const std::string& good, std::uint64_t seed) : good_(good), random_(seed) {}

  /// 0 to n − 1. Not std's distributions, which differ between libraries.
  std::size_t below(std::size_t n) { return static_cast<std::size_t>(random_() % std::max<std::size_t>(n, 1)); }

  std::string flipped() {
    std::string bytes = good_;
    for (std::size_t i = 0; i < 1 + below(20); ++i) bytes[below(bytes.size())] ^= static_cast<char>(1 + below(255));
    return bytes;
  }
  std::string cut_out() {
    std::string bytes = good_;
    const std::size_t begin = below(bytes.size());
    return bytes.erase(begin, 1 + below(200));
  }
  std::string doubled() {
    std::string bytes = good_;
    const std::size_t begin = below(bytes.size()), length = 1 + below(500), times = 1 + below(200);
    const std::string part = bytes.substr(begin, length);
    std::string more;
    for (std::size_t i = 0; i < times; ++i) more += part;
    return bytes.insert(begin, more);
  }
  std::string swapped() {
    const std::size_t a = below(good_.size()), b = a + below(good_.size() - a);
    return good_.substr(0, a) + good_.substr(b) + good_.substr(a, b - a);
  }
  /// Replaces a number by an unexpected one.
  std::string with_number() {
    static constexpr std::array kNumbers = {"1e308",  "-1e308",     "nan", "inf",  "-1",  "0",   "99999999999999999999",
                                            "1e-320", "2147483648", "",    "0x10", "1,5", "--1", "4294967295",
                                            "1e400",  "1e9"};
    std::string bytes = good_;
    for (int tries = 0; tries < 100; ++tries) {
      std::size_t begin = below(bytes.size());
      while (begin < bytes.size() && std::isdigit(static_cast<unsigned char>(bytes[begin])) == 0) ++begin;
      if (begin == bytes.size()) continue;
      std::size_t end = begin;
      while (end < bytes.size() && (std::isdigit(static_cast<unsigned char>(bytes[end])) != 0 || bytes[end] == '.')) ++end;
      bytes.replace(begin, end - begin, kNumbers[below(kNumbers.size())]);
      if (below(3) == 0) break;
    }
    return bytes;
  }
  /// Replaces a word by another word of the file.
  std::string with_word() {
    const auto word = [&]() -> std::pair<std::size_t, std::size_t> {
      std::size_t begin = below(good_.size());
      while (begin < good_.size() && std::isalpha(static_cast<unsigned char>(good_[begin])) == 0) ++begin;
      std::size_t end = begin;
      while (end < good_.size() && std::isalnum(static_cast<unsigned char>(good_[end])) != 0) ++end;
      return {begin, end - begin};
    };
    const auto [to, length] = word();
    const auto [from, other] = word();
    std::string bytes = good_;
    return bytes.replace(to, length, below(4) == 0 ? std::string(100'000, 'x') : good_.substr(from, other));
  }

 private:
  const std::string& good_;
  std::mt19937_64 random_;
};

}  // namespace

std::vector<File> variants(const std::string& good, std::size_t count, std::uint64_t seed, bool part_is_bad, bool is_text) {
  Maker maker(good, seed);
  std::string random(4096, '\0');
  for (char& c : random) c = static_cast<char>(maker.below(256));
  std::string deep;
  for (int i = 0; i < 200'000; ++i) deep += "<a>[{";
  std::vector<File> files = {{"", "empty", true},
                             {std::string(100'000, '\0'), "zeros", true},
                             {random, "random bytes", true},
                             {"\xFF\xFE" + good, "UTF-16", true},
                             {deep, "nested without end", true},
                             {std::string(3'000'000, '\n'), "lines without anything", true},
                             {std::string(3'000'000, '<'), "tags without end", true},
                             {good.substr(0, good.size() / 2), "the first half", part_is_bad},
                             {good.substr(good.size() / 2), "the second half", part_is_bad}};
  while (files.size() < count) {
    switch (files.size() % (is_text ? 7 : 4)) {
      case 0:
        files.push_back({maker.flipped(), "bytes changed", false});
        break;
      case 1:
        files.push_back({maker.cut_out(), "a part cut out", false});
        break;
      case 2:
        files.push_back({maker.doubled(), "a part repeated", false});
        break;
      case 3:
        files.push_back({maker.swapped(), "parts exchanged", false});
        break;
      default:
        files.push_back(maker.below(3) == 0 ? File{maker.with_word(), "a word replaced", false}
                                            : File{maker.with_number(), "a number replaced", false});
    }
  }
  return files;
}

}  // namespace cotwin::hostile
