#pragma once
#include <string>
#include <vector>

#include "components/unit/si.h"
#include "models/text/parameter_set.h"

namespace cotwin::master::ssp {

/// Units of measure of all files together. A file's own definitions hold in that file; one that another file, or the usual
/// meaning of its name, contradicts is kept under a name of its own.
class UnitTable {
 public:
  /// The name under which the table knows `name` as used in a file that defines `local`. Throws Error if neither a file nor
  /// si::parse knows it.
  std::string intern(const std::vector<UnitDefinition>& local, const std::string& name, const std::string& place);
  /// A definition of the root document, known under its own name.
  void add(const UnitDefinition& definition) { definitions_.push_back(definition); }
  si::Measure measure(const std::string& name) const;
  /// Whether a measure that converts to `name` may have an offset, as °C has to K: then scaling a number depends on its
  /// measure.
  bool has_offsets(const std::string& name) const;
  const std::vector<UnitDefinition>& definitions() const { return definitions_; }

 private:
  std::vector<UnitDefinition> definitions_;
};

}  // namespace cotwin::master::ssp
