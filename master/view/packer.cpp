#include "master/view/packer.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

constexpr double kSteps = 1 << 23;
constexpr std::size_t kMostGaps = 1000;  // listed ones
constexpr double kFar = 100;             // range over that of the middle 90 % of the numbers, above which float is used

struct Gap {
  std::size_t from, length;
  int what;  // 0 NaN, 1 ∞, −1 −∞
};

int what_is(double value) { return std::isnan(value) ? 0 : value > 0 ? 1 : -1; }

std::vector<Gap> gaps_of(std::span<const double> values) {
  std::vector<Gap> gaps;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (std::isfinite(values[i])) continue;
    const int what = what_is(values[i]);
    if (!gaps.empty() && gaps.back().from + gaps.back().length == i && gaps.back().what == what) {
      ++gaps.back().length;
    } else {
      gaps.push_back({i, 1, what});
    }
  }
  return gaps;
}

struct Range {
  double least = std::numeric_limits<double>::infinity(), largest = -least;
  bool whole = true;
};

Range range_of(std::span<const double> values) {
  Range range;
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    range.least = std::min(range.least, value);
    range.largest = std::max(range.largest, value);
    range.whole = range.whole && value == std::nearbyint(value);
  }
  if (range.least > range.largest) range.least = range.largest = 0;
  return range;
}

/// Whether a few numbers are so far from the others that steps over the whole range would be coarse for these.
bool has_far_numbers(std::span<const double> values, const Range& range) {
  constexpr std::size_t kSample = 20'000;
  std::vector<double> sample;
  const std::size_t stride = std::max<std::size_t>(1, values.size() / kSample);
  for (std::size_t i = 0; i < values.size(); i += stride) {
    if (std::isfinite(values[i])) sample.push_back(values[i]);
  }
  if (sample.empty()) return false;
  std::sort(sample.begin(), sample.end());
  const std::size_t last = sample.size() - 1;
  const double middle = sample[last * 95 / 100] - sample[last * 5 / 100];
  return range.largest - range.least > kFar * middle && range.largest > range.least;
}

/// Float32 bits as integers in the order of the numbers. Finite numbers beyond float32 become its largest ones.
std::int32_t ordered_bits(double value) {
  constexpr double kMost = std::numeric_limits<float>::max();
  const double held = std::isfinite(value) ? std::clamp(value, -kMost, kMost) : value;
  const auto bits = std::bit_cast<std::int32_t>(static_cast<float>(held));
  return bits < 0 ? bits ^ 0x7fffffff : bits;
}

template <class Integer>
using Unsigned = std::make_unsigned_t<Integer>;

/// The differences of this order, the first one from 0, modulo 2ᴺ.
template <class Integer>
std::vector<Integer> differences(std::vector<Integer> values, int order) {
  for (int k = 0; k < order; ++k) {
    Integer before = 0;
    for (Integer& value : values) {
      const Integer now = value;
      value = static_cast<Integer>(static_cast<Unsigned<Integer>>(now) - static_cast<Unsigned<Integer>>(before));
      before = now;
    }
  }
  return values;
}

/// The sign in the lowest bit: 0, −1, 1, −2 … become 0, 1, 2, 3 …
template <class Integer>
Unsigned<Integer> folded(Integer value) {
  const auto doubled = static_cast<Unsigned<Integer>>(static_cast<Unsigned<Integer>>(value) << 1);
  return value < 0 ? static_cast<Unsigned<Integer>>(~doubled) : doubled;
}

template <class Integer>
std::string bytes_of(const std::vector<Integer>& values, std::size_t width) {
  std::string bytes(values.size() * width, '\0');
  for (std::size_t i = 0; i < values.size(); ++i) {
    auto u = folded(values[i]);
    for (std::size_t k = 0; k < width; ++k) {
      bytes[k * values.size() + i] = static_cast<char>(u & 0xff);
      u = static_cast<decltype(u)>(u >> 8);
    }
  }
  return bytes;
}

/// The order of differences that has the fewest bits.
template <class Integer>
int best_order(const std::vector<Integer>& values) {
  int best = 0;
  double fewest = std::numeric_limits<double>::infinity();
  for (int order = 0; order <= 2; ++order) {
    double bits = 0;
    for (const Integer d : differences(values, order)) bits += static_cast<double>(std::bit_width(folded(d)));
    if (bits < fewest) {
      fewest = bits;
      best = order;
    }
  }
  return best;
}

}  // namespace

Packer::Json Packer::add_bytes(std::string_view bytes) {
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::string packed(size, '\0');
  constexpr int kLevel = 6;
  const int status = compress2(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(bytes.data()),
                               static_cast<uLong>(bytes.size()), kLevel);
  if (status != Z_OK) throw Error("zlib", "cannot compress " + std::to_string(bytes.size()) + " bytes");
  const Json where = {{"at", bytes_.size()}, {"size", size}, {"count", bytes.size()}};
  bytes_.append(packed, 0, size);
  bytes_.resize((bytes_.size() + 2) / 3 * 3, '\0');
  return where;
}

Packer::Json Packer::add_reals(std::span<const double> values) {
  const std::vector<Gap> gaps = gaps_of(values);
  const Range range = range_of(values);
  const double length = range.largest - range.least;
  const bool exact = range.whole && length <= kSteps;
  Json stream;
  std::vector<std::int32_t> integers(values.size());
  const bool as_float = gaps.size() > kMostGaps || !std::isfinite(length) ||
                        length / kSteps < std::numeric_limits<double>::min() * kSteps ||
                        (!exact && has_far_numbers(values, range));
  if (as_float && length > 0) {
    std::transform(values.begin(), values.end(), integers.begin(), ordered_bits);
    stream["kind"] = "float";
  } else {
    const double step = exact || length == 0 ? 1 : length / kSteps;
    std::int32_t last = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (std::isfinite(values[i])) last = static_cast<std::int32_t>(std::lround((values[i] - range.least) / step));
      integers[i] = last;
    }
    stream["kind"] = "steps";
    stream["least"] = range.least;
    stream["step"] = step;
    for (const Gap& gap : gaps) stream["gaps"].push_back({gap.from, gap.length, gap.what});
  }
  const int order = best_order(integers);
  stream.update(add_bytes(bytes_of(differences(std::move(integers), order), 4)));
  stream["count"] = values.size();
  stream["order"] = order;
  return stream;
}

Packer::Json Packer::add_integers(std::span<const std::int64_t> values) {
  std::vector<std::int64_t> integers(values.begin(), values.end());
  const int order = best_order(integers);
  Json stream = add_bytes(bytes_of(differences(std::move(integers), order), 7));
  stream["kind"] = "whole";
  stream["count"] = values.size();
  stream["order"] = order;
  return stream;
}

std::string Packer::base64() const { return to_base64(bytes_); }

std::string to_base64(std::string_view bytes) {
  static constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t there = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (k < there ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (std::size_t k = 0; k < 4; ++k) text += k <= there ? kDigits[group >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

}  // namespace cotwin::master
