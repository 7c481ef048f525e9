#pragma once
#include <sys/types.h>

#include <filesystem>
#include <string>

/// Results that a process left behind when it was ended.
namespace cotwin::master {

/// Gives <file>.part its name <file>, without an incomplete last row. Returns what there is: "; the rows up to t = 0.5 s are in results/signals.csv",
/// with `shown` as its name; "" if there was no such file.
std::string keep_rows(const std::filesystem::path& file, const std::filesystem::path& shown);

/// Completes the results of a run in this folder that `process` has left without an end: rows, and run.json with the state "failed" and
/// the reason. Does nothing if that process has closed its run. Returns as keep_rows(), for the recording in the folder `shown`.
std::string close_abandoned_run(const std::filesystem::path& folder, const std::filesystem::path& shown, pid_t process,
                                const std::string& reason);

}  // namespace cotwin::master
