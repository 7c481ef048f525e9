#pragma once
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace cotwin {

/// A setting of a kind of unit, chosen before the unit has variables: the number of joints, the method.
struct Setting {
  enum class Kind : std::uint8_t { kText, kInteger, kBoolean, kChoice };

  std::string name;  // unique within the unit
  Kind kind = Kind::kText;
  std::vector<std::string> choices;  // of kChoice
  long long min = std::numeric_limits<long long>::min();
  long long max = std::numeric_limits<long long>::max();  // of kInteger; both ends belong to the range
  std::optional<std::string> fallback;                    // the default; none: the setting must be given
  std::string fallback_rule;                              // in words, if the unit computes the default; else empty
  std::string description;                                // one sentence
};

std::string_view name_of(Setting::Kind kind);
/// "inside, outside", "1 to 1000", "true, false"; empty for a text.
std::string allowed_values(const Setting& setting);
/// The default as text: "inside", "none" for an empty text, "required", or the rule by which it is computed.
std::string default_value(const Setting& setting);

/// The settings of a kind of unit, declared once. Settings checks values against this list; `cotwin describe`, the reference
/// pages, `--set` and the shell completion use it.
class SettingList {
 public:
  /// Properties of a setting, set after its declaration.
  class Declared {
   public:
    Declared(SettingList& list, std::size_t index) : list_(list), index_(index) {}
    /// The setting must be given.
    Declared& required();
    /// The unit computes the default from other settings by `rule`, given in words.
    Declared& fallback_rule(std::string rule);

   private:
    SettingList& list_;
    std::size_t index_;
  };

  Declared text(std::string name, std::string fallback, std::string description);
  Declared integer(std::string name, long long fallback, long long min, long long max, std::string description);
  Declared boolean(std::string name, bool fallback, std::string description);
  /// The first of the choices is the default.
  Declared choice(std::string name, std::vector<std::string> choices, std::string description);

  /// The settings that Settings::robot() reads: `robot`, `unphysical`, `lock`, `passive`.
  Declared robot(std::string description);
  /// The settings that Settings::cell() reads: `scene`, `robot`, `robots`, `unphysical`, `robot_shapes` with these choices, `lock`,
  /// `passive`.
  void cell(std::vector<std::string> shapes = {"all", "hulls", "none"});
  /// The setting of robot::take_unphysical().
  void unphysical();

  /// At most ten variables that a first scenario with the unit needs, for its reference page.
  void set_first_variables(std::vector<std::string> names) { first_variables_ = std::move(names); }
  std::span<const std::string> first_variables() const { return first_variables_; }

  std::span<const Setting> all() const { return list_; }
  auto begin() const { return list_.begin(); }
  auto end() const { return list_.end(); }
  /// Returns nullptr if there is no setting of that name.
  const Setting* find(std::string_view name) const;
  std::vector<std::string> names() const;

 private:
  Declared add(Setting setting);
  void joints_of_robot(const std::string& several);

  std::vector<Setting> list_;
  std::vector<std::string> first_variables_;
};

}  // namespace cotwin
