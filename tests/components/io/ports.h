#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <thread>

#include "components/io/link/datagram_queue.h"
#include "components/unit/unit_table.h"
#include "tests/support/places.h"

namespace cotwin::io {

inline constexpr std::int64_t kPatience = 20'000'000'000;  // ns

inline Instance make(const std::string& query) {
  return make_unit("unit:io?" + query, {}, {std::filesystem::path(places::source()) / "models"}, unit_types());
}

/// Ports of a unit by name.
struct Ports {
  Instance instance;

  explicit Ports(const std::string& query) : instance(make(query)) {}
  void set(const std::string& name, const std::string& value) { assign_text(instance.variables.at(name), value); }
  std::span<double> reals(const std::string& name) { return instance.variables.at(name).reals(); }
  double real(const std::string& name, std::size_t i = 0) { return reals(name)[i]; }
  int integer(const std::string& name, std::size_t i = 0) { return instance.variables.at(name).integers()[i]; }
  bool boolean(const std::string& name, std::size_t i = 0) { return instance.variables.at(name).booleans()[i]; }
  DatagramQueue& datagrams() { return *static_cast<DatagramQueue*>(instance.unit->tick_source()); }
  /// Waits until so many datagrams have come that the next step will read.
  bool has(std::size_t count) {
    const std::int64_t deadline = monotonic_now() + kPatience;
    while (datagrams().waiting() < count && monotonic_now() < deadline) std::this_thread::yield();
    return datagrams().waiting() == count;
  }
  bool heard() { return instance.unit->tick_source()->wait(monotonic_now() + kPatience).has_value(); }
};

}  // namespace cotwin::io
