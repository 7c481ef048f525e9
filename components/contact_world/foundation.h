#pragma once
#include <span>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "components/unit/variables.h"
#include "models/scene/scene.h"

namespace cotwin::contact_world {

/// Variables of a body whose surface is an elastic foundation that may yield.
class Foundation {
 public:
  /// Throws Error if shapes of the body have different foundations.
  Foundation(const std::string& place, const std::string& name, const scene::Body& body);

  bool any() const { return stiffness_ > 0; }
  void declare(Variables& v, const std::string& prefix);
  void declare_state(Variables& v, const std::string& prefix);
  /// Puts the tunables into force, before the world is built.
  void take() { in_force_ = {stiffness_, yield_, breakthrough_}; }
  /// Gives what is in force to all shapes of the body with a foundation.
  void apply(scene::Body& body) const;
  /// Brings changed tunables into force. Throws Error `place.variables.…` for values that a foundation cannot have. Allocates nothing.
  void follow(const std::string& place, const std::string& variables, World& world, std::size_t body);
  /// To be called after the state in force was restored.
  void restored(World& world, std::size_t body) const;
  void write(const Yielding& result);
  void append_notes(std::vector<std::string>& notes) const;

 private:
  std::string name_;
  bool whole_ = false;
  double stiffness_ = 0, yield_ = 0, breakthrough_ = 0;  // tunables; a limit of 0: none
  std::vector<double> in_force_ = {0, 0, 0};             // state: the same in force
  double dent_ = 0, pressed_ = 0, yield_energy_ = 0;     // outputs
  bool pierced_ = false;
};

}  // namespace cotwin::contact_world
