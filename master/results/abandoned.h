#pragma once
#include <sys/types.h>

#include <filesystem>
#include <string>

/// Results that a process left behind when it was ended.
namespace cotwin::master {

/// Gives <file>.part its name <file>, without an incomplete last row. Returns whether there was such a file.
bool keep_rows(const std::filesystem::path& file);

/// Completes the results of a run in this folder that `process` has left without an end: rows, and run.json with the state "failed" and
/// the reason. Does nothing if that process has closed its run. Returns whether rows were kept.
bool close_abandoned_run(const std::filesystem::path& folder, pid_t process, const std::string& reason);

}  // namespace cotwin::master
