#pragma once
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

/// Reads regular files only and opens them without blocking: a FIFO or a device may block or never end.
namespace cotwin::text {

struct CloseFile {
  void operator()(std::FILE* file) const { static_cast<void>(std::fclose(file)); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

/// Default limit for files that are read into memory as a whole, bytes.
inline constexpr std::uint64_t kMostBytes = std::uint64_t{256} << 20;

/// Opens a file to read bytes. Throws Error `file: cannot be read: reason, expected …` if it is missing, not readable, or a
/// folder, FIFO, device or socket. Checks the opened file, so that it cannot be exchanged in between.
File open_file(const std::filesystem::path& file, const std::string& expected);

/// All bytes of a file. Throws Error as open_file, and for more than `most` bytes, if possible before reading.
std::string read_file(const std::filesystem::path& file, const std::string& expected, std::uint64_t most = kMostBytes);

}  // namespace cotwin::text
