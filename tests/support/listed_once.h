#pragma once
#include <gtest/gtest.h>

#include <set>
#include <type_traits>
#include <typeinfo>

namespace cotwin::testing {

/// That the lists of each structure (models/foundation/support/fields.h) name no member twice, and that the compiler counts its members.
template <class... Structures>
void expect_each_member_once() {
  const auto check = []<class T>(T value) {
    static_assert(std::is_aggregate_v<T>, "so that its members are counted");
    std::multiset<const void*> named;
    const auto name = [&](const auto&... members) { (named.insert(&members), ...); };
    T::fields(value, name);
    if constexpr (requires { T::left_out(value, name); }) T::left_out(value, name);
    EXPECT_EQ(std::set<const void*>(named.begin(), named.end()).size(), named.size()) << typeid(T).name();
  };
  (check(Structures{}), ...);
}

}  // namespace cotwin::testing
