#pragma once
#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/program/folders.h"
#include "master/run/identity.h"

/// The subcommands of the program `cotwin`, a file each.
namespace cotwin::master {

enum ExitCode { kExitDone = 0, kExitRunFailed = 1, kExitBadInput = 2, kExitSignalled = 128 };  // 128 + the signal's number

/// What the command line asks for; returns the exit code, throws Error for bad input.
using Chosen = std::function<int()>;

/// Each adds subcommands to the program; the one that is named on the command line becomes `chosen`.
void add_run(CLI::App& app, Chosen& chosen);
void add_pack(CLI::App& app, Chosen& chosen);
void add_inspection(CLI::App& app, Chosen& chosen);  // info, check
void add_catalogue(CLI::App& app, Chosen& chosen);   // units, describe, reference
void add_tune(CLI::App& app, Chosen& chosen);
void add_excite(CLI::App& app, Chosen& chosen);
void add_perturb(CLI::App& app, Chosen& chosen);
void add_completion(CLI::App& app, Chosen& chosen);

/// The units of this program, of the modules that COTWIN_UNITS lists (separated by ':') and of those that --units names. Loaded
/// at the first call. Throws Error.
std::span<const UnitType> units();
/// Where the FMU libraries of their units are.
std::vector<std::filesystem::path> libraries_of_modules();
/// Adds the option --units to a command.
void add_units_option(CLI::App& command);

/// This program, with the modules that it has loaded, on this machine.
Build this_build();
/// `name` as that of a file or folder.
std::string file_name_of(const std::string& name);
/// Whether a path means an FMU: an archive (.fmu) or a folder with a modelDescription.xml.
bool is_fmu(const std::filesystem::path& path);

}  // namespace cotwin::master
