#pragma once
#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

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

/// This program on this machine.
Build this_build();
/// Where units look up named data, in this order; `scenario_folder` may be empty.
std::vector<std::filesystem::path> model_folders(const std::filesystem::path& scenario_folder);
/// The URDF that is meant by its path or by the name of a robot in the model folders. Throws Error.
std::filesystem::path urdf_of(const std::string& robot);
/// `name` as that of a file or folder.
std::string file_name_of(const std::string& name);
/// Whether a path means an FMU: an archive (.fmu) or a folder with a modelDescription.xml.
bool is_fmu(const std::filesystem::path& path);

}  // namespace cotwin::master
