#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "components/io/emulators/ethercat/devices.h"
#include "components/io/emulators/ethercat/emulated_wire.h"
#include "components/io/ethercat/master/master.h"
#include "models/foundation/support/error.h"

/// The cell of the paper on an emulated bus, with a master, for tests in simulated time.
namespace cotwin::ethercat {

inline constexpr std::int64_t kMs = 1'000'000;

inline ExpectedSlave expected(const char* device, std::uint32_t product, std::size_t inputs, std::size_t outputs) {
  ExpectedSlave e;
  e.device = device;
  e.vendor = kBeckhoff;
  e.product = product;
  e.input_bytes = inputs;
  e.output_bytes = outputs;
  return e;
}

/// EK1100, EL1809, EL2809 and EL5101 (32 bit), as in the paper's cell, with a master.
class Cell {
 public:
  explicit Cell(bool clocks = true, std::vector<double> drifts = {20e-6, -50e-6, 50e-6, 35e-6}, std::int64_t cable = 10) {
    const auto clock = [&](std::size_t i) {
      ClockOptions o;
      o.drift = drifts[i];
      o.start = 1'000'000'000 * (4 - i);
      o.seed = i;
      return o;
    };
    Connection c;
    c.cable = cable;
    bus.append(std::make_unique<Ek1100>(ek1100_options(clock(0))), c);
    bus.append(std::make_unique<El1809>(terminal_options(clock(1))), c);
    c.parent = 1;
    bus.append(std::make_unique<El2809>(terminal_options(clock(2))), c);
    c.parent = 2;
    bus.append(std::make_unique<El5101>(terminal_options(clock(3))), c);
    options.clocks = clocks;
    options.system_time = 800'000'000'000'000'000;
    slaves = {expected("EK1100", kEk1100, 0, 0), expected("EL1809", kEl1809, 2, 0), expected("EL2809", kEl2809, 0, 2),
              expected("EL5101", kEl5101, 10, 6)};
    slaves[3].name = "axis";
    slaves[3].pdos = {{0x1603}, {0x1a04}};
  }

  El1809& inputs() { return static_cast<El1809&>(bus.slave(1)); }
  El2809& outputs() { return static_cast<El2809&>(bus.slave(2)); }
  El5101& encoder() { return static_cast<El5101&>(bus.slave(3)); }

  void set_up() {
    Exchange exchange(wire);
    master = std::make_unique<Master>(set_up_bus(exchange, slaves, options), kMs, 20 * kMs, BusTime{0, options.system_time, 0});
    next = wire.now() + kMs;
  }
  void cycles(int n) {
    for (int i = 0; i < n; ++i) {
      wire.advance_to(next);
      next += kMs;
      master->cycle(wire);
    }
  }
  /// The message of the error with which setting up ends.
  std::string refusal() {
    try {
      set_up();
    } catch (const Error& e) {
      return e.what();
    }
    return "";
  }

  Bus bus;
  EmulatedWire wire{bus};
  SetupOptions options;
  std::vector<ExpectedSlave> slaves;
  std::unique_ptr<Master> master;
  std::int64_t next = 0;
};

}  // namespace cotwin::ethercat
