#pragma once
#include <stdexcept>
#include <string>

namespace cotwin {

/// An error that a person must act on: a file, a connection, a parameter. The message has place, fact and expectation:
/// `link.dq -> drive.q: rad/s cannot feed rad`, `arm.urdf:12: link 'hand': mass -1 kg, expected > 0`.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
  Error(const std::string& place, const std::string& what) : std::runtime_error(place + ": " + what) {}  ///< "place: what"
};

}  // namespace cotwin
