#pragma once
#include <CLI/CLI.hpp>
#include <string>

/// Manual pages from the description of the command line, in the format of man(7).
namespace cotwin::master {

/// The page of the program, cotwin.1.
std::string manual_of_program(const CLI::App& app, const std::string& version);

/// The page of a command, cotwin-COMMAND.1.
std::string manual_of_command(const CLI::App& app, const CLI::App& command, const std::string& version);

}  // namespace cotwin::master
