#pragma once
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "components/unit/joint_variables.h"
#include "components/unit/unit.h"

namespace cotwin::io {

/// rad/s (prismatic: m/s), largest default limit of commanded positions.
inline constexpr double kSafeSpeed = 0.5;
/// rad/s² (prismatic: m/s²), default limit of their acceleration.
inline constexpr double kSafeAcceleration = 20;

/// Measurements of a robot's n joints, in SI and in the order and with the signs of the URDF.
struct Measured {
  explicit Measured(std::size_t n) : q(n), dq(n), ddq(n), tau(n), tau_e(n) {}

  std::vector<double> q, dq, ddq;  // rad, rad/s, rad/s²
  std::vector<double> tau;         // N.m, measured by sensors or motors; 0 if has_tau is false
  std::vector<double> tau_e;       // N.m, exerted by the environment; 0 if has_tau_e is false
  bool has_tau = false, has_tau_e = false;
  bool fresh = false;    // measured within the last step
  double elapsed = 0;    // s, by the robot's clock, from the last measurement of an earlier step to this one; 0: not known
  double t = 0;          // s, time of the last measurement; kept by the unit
  bool between = false;  // the values are those of each instant, interpolated between measurements
  bool done = false;     // no further measurements
  std::string warning;   // after initialise(): warnings for the user; empty: none

  /// Adds a sentence to the warnings, once. Allocates nothing within what initialise() has reserved.
  void warn(std::string_view sentence) {
    if (warning.find(sentence) != std::string::npos) return;
    if (!warning.empty()) warning += "; ";
    warning += sentence;
  }
};

/// Commands to a robot.
struct Command {
  explicit Command(std::size_t n) : q(n), tau(n) {}

  std::vector<double> q;    // rad
  std::vector<double> tau;  // N.m
};

/// Connection to a robot or its substitute: converts between bytes, files or buses and Measured and Command in SI. One of the
/// virtual interfaces that extensions implement. The call order is that of Unit.
class Link {
 public:
  virtual ~Link() = default;
  /// Declares the link's own parameters and outputs, after the common ports.
  virtual void declare(Variables&, JointVariables&) = 0;
  /// Opens the connection and sets `measured` at `start`. Throws Error if the user must act. May be called again.
  virtual void initialise(Time start, Measured& measured) = 0;
  /// Sends the command and sets `measured` at now + h. Must not allocate or block.
  virtual StepResult step(Time now, Duration h, const Command& command, Measured& measured) = 0;
  /// False if a step acts on a real robot and cannot be undone.
  virtual bool restorable() const = 0;
  /// The clock of the robot or bus (Unit::tick_source); nullptr if there is none.
  virtual TickSource* tick_source() { return nullptr; }
  /// Whether the link is the robot's side of a connection: it declares all ports itself, measurements as inputs and commands as
  /// outputs.
  virtual bool is_robot() const { return false; }
  /// Commands without which the link must not drive the robot, as its parameters are at present (Variable::required).
  struct Needs {
    bool q = false, tau = false;
  };
  virtual Needs needs() const { return {}; }
  /// Appends sentences on the run so far (Unit::tell).
  virtual void append_notes(std::vector<std::string>&) const {}
  /// Brings what is behind the link to its safe state (Unit::end).
  virtual void end() noexcept {}
};

}  // namespace cotwin::io
