#pragma once
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "components/unit/si.h"
#include "models/support/parameter_set.h"

namespace cotwin::master::ssp {

/// The definitions of one file, found by name: the first of each.
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

/// Units of measure of all files together. A file's own definitions hold in that file; one that another file, or the usual
/// meaning of its name, contradicts is kept under a name of its own.
class UnitTable {
 public:
  /// The name under which the table knows `name` as used in a file that defines `local`. Throws Error if neither a file nor
  /// si::parse knows it.
  std::string intern(const UnitDefinitions& local, const std::string& name, const std::string& place);
  /// A definition of the root document, known under its own name.
  void add(const UnitDefinition& definition) { keep(definition); }
  si::Measure measure(const std::string& name) const;
  /// Whether a measure that converts to `name` may have an offset, as °C has to K: then scaling a number depends on its
  /// measure.
  bool has_offsets(const std::string& name) const;
  const std::vector<UnitDefinition>& definitions() const { return definitions_.list(); }

 private:
  void keep(const UnitDefinition& definition);

  UnitDefinitions definitions_;
  std::vector<si::Measure> with_offset_;  // those of the definitions that have an offset, of different measures
};

}  // namespace cotwin::master::ssp
