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
  /// Gives the parameters to all shapes of the body with a foundation.
  void apply(scene::Body& body) const;
  std::vector<double> parameters() const { return {stiffness_, yield_, breakthrough_}; }
  void write(const Yielding& result);
  void tell(std::vector<std::string>& notes) const;

 private:
  std::string name_;
  bool whole_ = false;
  double stiffness_ = 0, yield_ = 0, breakthrough_ = 0;  // parameters; a limit of 0: none
  double dent_ = 0, pressed_ = 0, yield_energy_ = 0;     // outputs
  bool pierced_ = false;
};

}  // namespace cotwin::contact_world
