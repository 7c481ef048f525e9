// Included first in the mutated sources that scripts/mutation/mutate.py writes. Each place has a number; the environment variable COTWIN_MUTANT
// chooses the one that is changed. COTWIN_MUTANTS_REACHED names a file with a byte per place, which is set where the place is reached.
#pragma once
#include <fcntl.h>
#include <sys/mman.h>

#include <cstdlib>
#include <type_traits>

namespace cotwin_mutation {

inline constexpr int kMostPlaces = 65536;

inline const int chosen = [] {
  const char* number = std::getenv("COTWIN_MUTANT");
  return number ? std::atoi(number) : 0;
}();

inline unsigned char* const reached = []() -> unsigned char* {
  const char* file = std::getenv("COTWIN_MUTANTS_REACHED");
  const int descriptor = file ? ::open(file, O_RDWR | O_CLOEXEC) : -1;
  if (descriptor < 0) return nullptr;
  void* bytes = ::mmap(nullptr, kMostPlaces, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  return bytes == MAP_FAILED ? nullptr : static_cast<unsigned char*>(bytes);
}();

inline bool on(int place) {
  if (reached) reached[place] = 1;
  return chosen == place;
}

struct Sign;
struct Twice;
/// Vectors and matrices, and expressions of these.
template <class T>
concept Scaled = std::is_class_v<T> && !std::is_same_v<T, Sign> && !std::is_same_v<T, Twice> && requires(const T& x) {
  1.0 * x;
};

// a + b → a - b and back: a + Sign{n} * b. Unary: -Sign{n} * b.
struct Sign {
  int place;
  bool negative = false;
};
inline Sign operator-(Sign s) { return {s.place, !s.negative}; }
template <class T>
requires std::is_arithmetic_v<T>
auto operator*(Sign s, T x) { return on(s.place) != s.negative ? -x : +x; }
template <Scaled T>
auto operator*(Sign s, const T& x) {
  return (on(s.place) != s.negative ? -1.0 : 1.0) * x;
}

// a * b → 2 a * b: a * Twice{n} * b, and a / Twice{n} / b.
struct Twice {
  int place;
};
template <class T>
requires std::is_arithmetic_v<T>
auto operator*(T x, Twice t) { return on(t.place) ? x + x : +x; }
template <Scaled T>
auto operator*(const T& x, Twice t) {
  return (on(t.place) ? 2.0 : 1.0) * x;
}
template <class T>
auto operator/(const T& x, Twice t) {
  return x * t;
}

// A number → the next integer, or twice the number (0 → 1).
inline int number(int place, int x) { return on(place) ? x + 1 : x; }
inline double number(int place, double x) { return on(place) ? (x == 0 ? 1 : 2 * x) : x; }

// Comparisons, a <Less{n}> b and a ==Equal{n}== b: of integers the one that includes or excludes equality; of others, and of == and !=, the opposite.
template <class T>
inline constexpr bool discrete = std::is_integral_v<T> || std::is_enum_v<T>;

#define COTWIN_MUTATION_COMPARISON(Name, first, second, op, boundary)                      \
  struct Name {                                                                            \
    int place;                                                                             \
  };                                                                                       \
  template <class A>                                                                       \
  struct LeftOf##Name {                                                                    \
    const A& a;                                                                            \
    int place;                                                                             \
  };                                                                                       \
  template <class A>                                                                       \
  LeftOf##Name<A> operator first(const A& a, Name c) {                                     \
    return {a, c.place};                                                                   \
  }                                                                                        \
  template <class A, class B>                                                              \
  bool operator second(const LeftOf##Name<A>& left, const B& b) {                          \
    if (!on(left.place)) return static_cast<bool>(left.a op b);                            \
    if constexpr (discrete<A> && discrete<B>) return static_cast<bool>(left.a boundary b); \
    return !static_cast<bool>(left.a op b);                                                \
  }
COTWIN_MUTATION_COMPARISON(Less, <, >, <, <=)
COTWIN_MUTATION_COMPARISON(LessEqual, <, >, <=, <)
COTWIN_MUTATION_COMPARISON(Greater, <, >, >, >=)
COTWIN_MUTATION_COMPARISON(GreaterEqual, <, >, >=, >)
COTWIN_MUTATION_COMPARISON(Equal, ==, ==, ==, !=)
COTWIN_MUTATION_COMPARISON(NotEqual, ==, ==, !=, ==)
#undef COTWIN_MUTATION_COMPARISON

}  // namespace cotwin_mutation
