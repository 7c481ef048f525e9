#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "components/unit/unit.h"

namespace cotwin::io {

/// What a robot tells of its n joints, in SI and in the order and with the signs of the URDF.
struct Measured {
  explicit Measured(std::size_t n) : q(n), dq(n), ddq(n), tau(n), tau_e(n) {}

  std::vector<double> q, dq, ddq;  // rad, rad/s, rad/s²
  std::vector<double> tau;         // N.m, as its sensors or motors tell; 0 where has_tau is false
  std::vector<double> tau_e;       // N.m, exerted by the environment; 0 where has_tau_e is false
  bool has_tau = false, has_tau_e = false;
  bool fresh = false;   // something was measured within the last step
  bool done = false;    // nothing will be measured any more
  std::string warning;  // after initialise: what the user should know; else empty
};

/// What a robot is told.
struct Command {
  explicit Command(std::size_t n) : q(n), tau(n) {}

  std::vector<double> q;    // rad
  std::vector<double> tau;  // N.m
};

/// The way to a robot or to what stands for it. Behind it, a link knows bytes, files or buses; in front of it, Measured and
/// Command in SI. One of the four virtual interfaces: strangers meet here. The call order is that of Unit.
class Link {
 public:
  virtual ~Link() = default;
  /// The link's own parameters and outputs, after the ports that all links share.
  virtual void declare(Variables&) = 0;
  /// Opens what has to be opened; `measured` holds at `start`. Throws Error where a human must act. May repeat.
  virtual void initialise(Time start, Measured& measured) = 0;
  /// Gives the command and takes what is measured at now + h. Allocates nothing, blocks on nothing.
  virtual StepResult step(Time now, Duration h, const Command& command, Measured& measured) = 0;
  /// False where a step reaches a robot and cannot be taken back.
  virtual bool restorable() const = 0;
};

}  // namespace cotwin::io
