#pragma once
#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <ranges>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>

#include "models/foundation/support/bytes.h"

/// Structures that list their members once, for all that writes, reads or hashes them. The list is a static function of the structure, which needs
/// no header for it:
///   struct Port {
///     std::string component, variable, place;
///     static auto fields(auto& p, auto each) { return each(p.component, p.variable); }
///     static auto left_out(auto& p, auto each) { return each(p.place); }  // a message's
///   };
/// `left_out` names the members that are not kept, if there are any. **A member in neither list does not compile**, but in classes (with private
/// members or constructors), whose list is the state that they keep. For an enumeration that is kept,
/// `constexpr Enum last(Enum)` beside it returns its last enumerator (and `first`, where that is not 0); others are refused.
/// Kept are numbers, enumerations, texts, matrices of Eigen of fixed size, optional and shared values, variants, pairs, arrays, lists, sets, maps, what has
/// serialise() and deserialise(), and structures with a list. Numbers have the same width in the bytes on every platform.
/// What holds only between members (an index is below a count) is checked behind the reading, before anybody uses the value.
namespace cotwin {

static_assert(sizeof(std::size_t) == 8, "an index has 8 bytes in the files");

/// A list of another use than the structure's own, for Putter<Own> and Getter<Own>: `static auto fields(Is<Port> auto& p, auto each)` in Own.
template <class T, class Structure>
concept Is = std::same_as<std::remove_const_t<T>, Structure>;

namespace listed {

/// A value of any type but S and its bases, so that members of a base count one by one.
template <class S, std::size_t>
struct Anything {
  template <class T>
  requires(!std::is_base_of_v<T, S>) operator T() const;
};
template <class S, std::size_t... I>
consteval bool takes(std::index_sequence<I...>) {
  return requires { S{Anything<S, I>{}...}; };
}
/// The number of members of an aggregate is the largest number of values from which it can be made.
template <class T, std::size_t count>
inline constexpr bool has_members = takes<T>(std::make_index_sequence<count>()) &&
                                    !takes<T>(std::make_index_sequence<count + 1>());

struct Count {
  auto operator()(auto&... members) const { return std::integral_constant<std::size_t, sizeof...(members)>(); }
};
template <class Own, class T>
inline constexpr bool has_list = requires(T& t) {
  Own::fields(t, Count());
};
template <class Own, class T>
using ListsOf = std::conditional_t<has_list<Own, T>, Own, T>;
template <class Lists, class T>
consteval std::size_t members_in() {
  std::size_t count = decltype(Lists::fields(std::declval<T&>(), Count()))::value;
  if constexpr (requires(T & t) { Lists::left_out(t, Count()); })
    count += decltype(Lists::left_out(std::declval<T&>(), Count()))::value;
  return count;
}

/// The types whose width is the same on every platform, unlike that of long.
template <class T, class... Numbers>
concept OneOf = (std::same_as<T, Numbers> || ...);
template <class T>
concept Number = OneOf<T, std::int8_t, std::uint8_t, std::int16_t, std::uint16_t, std::int32_t, std::uint32_t, std::int64_t,
                       std::uint64_t, float, double>;
template <class T>
concept Matrix = int{T::SizeAtCompileTime} >= 0;
template <class T>
concept Tuple = requires {
  std::tuple_size<T>::value;
};
template <class T>
concept Variant = requires {
  std::variant_size<T>::value;
};
template <class T>
concept Optional = requires(T value) {
  value.emplace(*value);
};
template <class T>
concept Shared = std::same_as<T, std::shared_ptr<typename T::element_type>>;
template <class T>
concept Serialised = requires(const T& value, std::string_view bytes) {
  T::deserialise(bytes), value.serialise();
};

/// Calls each(members…) with the members in the list of a structure.
template <class Own, class T>
void each_field(T& value, auto each) {
  using Structure = std::remove_const_t<T>;
  using Lists = ListsOf<Own, Structure>;
  static_assert(!std::is_aggregate_v<Structure> || has_members<Structure, members_in<Lists, Structure>()>,
                "the lists of a structure do not have as many members as it has");
  Lists::fields(value, each);
}

}  // namespace listed

struct NoLists {};

/// Writes values: `Putter(out).put(a, b)`.
template <class Own = NoLists>
class Putter {
 public:
  explicit Putter(ByteWriter& out) : out_(out) {}

  void put(const auto&... values) { (put_one(values), ...); }

 private:
  template <class T>
  void put_one(const T& value) {
    if constexpr (std::is_enum_v<T>) {
      out_.value(static_cast<std::underlying_type_t<T>>(value));
    } else if constexpr (std::same_as<T, bool>) {
      out_.value(static_cast<std::uint8_t>(value));
    } else if constexpr (listed::Number<T>) {
      out_.value(value);
    } else if constexpr (std::same_as<T, std::string>) {
      out_.text(value);
    } else if constexpr (listed::Matrix<T>) {
      out_.values(std::span(value.data(), std::size_t{T::SizeAtCompileTime}));
    } else if constexpr (listed::Optional<T> || listed::Shared<T>) {
      put(static_cast<bool>(value));
      if (value) put(*value);
    } else if constexpr (listed::Variant<T>) {
      put(static_cast<std::uint8_t>(value.index()));
      std::visit([this](const auto& alternative) { this->put(alternative); }, value);
    } else if constexpr (listed::Tuple<T>) {
      std::apply([this](const auto&... items) { this->put(items...); }, value);
    } else if constexpr (std::ranges::range<T>) {
      out_.value(static_cast<std::uint64_t>(value.size()));
      for (const auto& item : value) put(item);
    } else if constexpr (listed::Serialised<T>) {
      out_.text(value.serialise());
    } else if constexpr (!std::same_as<T, std::monostate>) {
      listed::each_field<Own>(value, [this](const auto&... members) { this->put(members...); });
    }
  }

  ByteWriter& out_;
};

/// The smallest number of bytes of a T, at least 1: with empty texts and lists, without optional values.
template <class T, class Own = NoLists>
std::size_t least_bytes() {
  static const std::size_t bytes = [] {
    ByteWriter least;
    Putter<Own>(least).put(T{});
    return std::max<std::size_t>(least.bytes().size(), 1);
  }();
  return bytes;
}

/// Reads what a Putter with the same lists has written: `Getter(in).get(a, b)`. Throws Error at the place of `in` for bytes that are no such value; allocates no more than the
/// size of the bytes times a constant.
template <class Own = NoLists>
class Getter {
 public:
  explicit Getter(ByteReader& in) : in_(in) {}

  void get(auto&... values) { (get_one(values), ...); }

 private:
  template <class T>
  void get_one(T& value) {
    if constexpr (std::is_enum_v<T>) {
      get_enumerator(value);
    } else if constexpr (std::same_as<T, bool>) {
      value = in_.value<std::uint8_t>() != 0;
    } else if constexpr (listed::Number<T>) {
      value = in_.value<T>();
    } else if constexpr (std::same_as<T, std::string>) {
      value = in_.text();
    } else if constexpr (listed::Matrix<T>) {
      in_.values(std::span(value.data(), std::size_t{T::SizeAtCompileTime}));
    } else if constexpr (listed::Optional<T>) {
      value.reset();
      if (value_of<bool>()) value.emplace(value_of<typename T::value_type>());
    } else if constexpr (listed::Shared<T>) {
      value.reset();
      if (value_of<bool>())
        value = std::make_shared<typename T::element_type>(value_of<std::remove_const_t<typename T::element_type>>());
    } else if constexpr (listed::Variant<T>) {
      get_alternative<0>(value, in_.value<std::uint8_t>());
    } else if constexpr (listed::Tuple<T>) {
      std::apply([this](auto&... items) { this->get(items...); }, value);
    } else if constexpr (requires { value.resize(0); }) {
      value.resize(in_.count(least_bytes<typename T::value_type, Own>()));
      for (std::size_t i = 0; i < value.size(); ++i) get_item(value, i);
    } else if constexpr (std::ranges::range<T>) {
      value.clear();
      for (std::size_t n = in_.count(least_bytes<typename T::value_type, Own>()); n > 0; --n) value.insert(value_of<Item<T>>());
    } else if constexpr (listed::Serialised<T>) {
      const std::string bytes = in_.text();
      try {
        value = T::deserialise(bytes);
      } catch (const Error& error) {
        in_.fail(error.what());
      }
    } else if constexpr (!std::same_as<T, std::monostate>) {
      listed::each_field<Own>(value, [this](auto&... members) { this->get(members...); });
    }
  }

  template <class T>
  struct ItemOf {
    using Type = typename T::value_type;
  };
  template <class T>
  requires requires { typename T::mapped_type; }
  struct ItemOf<T> {
    using Type = std::pair<typename T::key_type, typename T::mapped_type>;
  };
  template <class T>
  using Item = typename ItemOf<T>::Type;

  template <class T>
  T value_of() {
    T value{};
    get(value);
    return value;
  }
  template <class T>
  void get_item(T& list, std::size_t i) {
    if constexpr (std::same_as<typename T::value_type, bool>) {
      list[i] = value_of<bool>();
    } else {
      get(list[i]);
    }
  }
  template <class T>
  void get_enumerator(T& value) {
    using Number = std::underlying_type_t<T>;
    Number least = 0;
    if constexpr (requires { first(value); }) least = static_cast<Number>(first(value));
    const auto number = in_.value<Number>(), most = static_cast<Number>(last(value));
    if (number < least || number > most)
      in_.fail("has the invalid enumeration value " + std::to_string(number) + ", expected " + std::to_string(least) + " to " +
               std::to_string(most));
    value = static_cast<T>(number);
  }
  template <std::size_t I, class T>
  void get_alternative(T& value, std::size_t index) {
    if constexpr (I == std::variant_size_v<T>) {
      in_.fail("has a value of an unknown type");
    } else if (I == index) {
      get(value.template emplace<I>());
    } else {
      get_alternative<I + 1>(value, index);
    }
  }

  ByteReader& in_;
};

/// The bytes of a file of this format: `magic`, which names the format and its version, the hash of `content`, and `content`.
inline std::string sealed(std::uint64_t magic, std::string content) {
  ByteWriter head;
  head.value(magic);
  head.value(hash_of(content));
  return std::move(content.insert(0, head.bytes()));
}
inline bool is_sealed(std::uint64_t magic, std::string_view bytes) {
  return bytes.size() >= sizeof magic && std::memcmp(bytes.data(), &magic, sizeof magic) == 0;
}
/// A reader of the content. Throws Error `place: REFUSAL` for another format or version, and for bytes that are damaged or cut short.
inline ByteReader opened(std::uint64_t magic, std::string_view bytes, const std::string& place, const std::string& refusal) {
  ByteReader in(as_bytes(bytes), place);
  if (!is_sealed(magic, bytes) || in.value<std::uint64_t>() != magic) in.fail(refusal);
  if (in.value<std::uint64_t>() != hash_of(bytes.substr(2 * sizeof magic))) in.fail("is damaged or cut short");
  return in;
}

}  // namespace cotwin
