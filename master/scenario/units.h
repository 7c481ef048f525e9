#pragma once
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "components/unit/si.h"
#include "models/foundation/formats/parameter_set.h"

namespace cotwin::master::ssp {

/// The unit definitions of one file, with look-up by name. Of several with the same name the first is used.
class UnitDefinitions {
 public:
  UnitDefinitions() = default;
  explicit UnitDefinitions(std::vector<UnitDefinition> list) : list_(std::move(list)) {
    for (std::size_t i = 0; i < list_.size(); ++i) index_.emplace(list_[i].name, i);
  }
  const UnitDefinition* find(const std::string& name) const {
    const auto found = index_.find(name);
    return found == index_.end() ? nullptr : &list_[found->second];
  }
  void add(const UnitDefinition& definition) {
    if (index_.emplace(definition.name, list_.size()).second) list_.push_back(definition);
  }
  const std::vector<UnitDefinition>& list() const { return list_; }

 private:
  std::vector<UnitDefinition> list_;
  std::unordered_map<std::string, std::size_t> index_;
};

/// The units of measure of all files. A definition applies only in its own file. If it contradicts that of another file or the
/// standard meaning of its name, it is stored under a different name.
class UnitTable {
 public:
  /// Returns the name in this table of the unit `name` of a file with the definitions `local`. Throws Error if neither a file
  /// nor si::parse() defines it.
  std::string intern(const UnitDefinitions& local, const std::string& name, const std::string& place);
  /// Adds a definition of the root document under its own name.
  void add(const UnitDefinition& definition);
  si::Measure measure(const std::string& name) const;
  /// Returns whether a unit convertible to `name` can have an offset, like °C to K. Scaling a number then depends on its unit.
  bool has_offsets(const std::string& name) const;
  const std::vector<UnitDefinition>& definitions() const { return definitions_.list(); }

 private:
  UnitDefinitions definitions_;
  std::vector<si::Measure> with_offset_;  // measures of definitions with an offset, one of each dimension
};

}  // namespace cotwin::master::ssp
