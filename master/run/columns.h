#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "components/unit/time.h"
#include "master/engine/wiring/members.h"

/// The variables that are recorded: by the user's choice (signals.csv), and for pages (view.bin).
namespace cotwin::master {

/// One variable of the recording: all of its elements, or one.
struct Column {
  std::vector<std::string> names;  // one per element
  Signal signal;
};

/// The variables that the scenario selects, in the order of components and declarations; without a selection, all outputs.
/// Patterns with * or ? match outputs, inputs, states and tunables; exact names match any variable but Strings. Throws Error at
/// the entry's place for a String and for a pattern without a match.
/// `clock`: variables of the run's clock, which patterns that begin with "clock." select, unless a component has that name;
/// their columns have a member past the end.
std::vector<Column> choose_columns(const Scenario& scenario, std::span<const Member> members, const Variables* clock = nullptr);

/// Rows in a second of the run, at least.
inline constexpr std::int64_t kViewRate = 60;

/// The variables that pages show where they are: joints, bodies, contacts, hands, obstacles, distances, energies. Found by their names, as
/// the stage of a page finds them; inputs of joint positions are copies of what other components compute and left out.
std::vector<Column> choose_view_columns(std::span<const Member> members);

/// Whether a recording of `columns` with rows every `interval` has all of `wanted` as often as pages want them.
bool has_all(std::span<const Column> columns, Duration interval, std::span<const Column> wanted);

/// Names, numbers of elements, units of measure and joints of columns as a list in JSON, with the time first.
std::string columns_json(std::span<const Column> columns);

/// The first line of view.bin. Rows follow: time (int64, ns), then a float32 per element; little-endian.
std::string view_heading(std::span<const Column> columns);

}  // namespace cotwin::master
